//! How much error a render without options has over the best settings found by search, after the same time: the table
//! of `docs/regret.md`.
//!
//! ```sh
//! cargo run --release --example regret -- cornell-box 128 5 20         # scene, pixels along a side, seconds
//! ```
//!
//! - The *reference* is two long renders at narrow radii, [`REFERENCE`] seconds each. An error is the root of the mean
//!   of `(x - A)(x - B)/(L^2 + 0.01 mean(L)^2)`: the noise of either reference does not meet itself. `L` is the mean of
//!   both over 5 by 5 pixels.
//! - The *grid* is all strategies at radii over 16-fold, both kernels at the scene's radius, and caustic radii of a
//!   quarter and of all of it. Each is rendered for [`MEASURED`] seconds at counts that the program chooses for it
//!   (docs/optimum.md tells what these lose). Its squared error less its noise is its squared bias; its noise falls
//!   with the time.
//! - The three that should have the least error after the time are rendered, in turn with renders without options,
//!   each with [`SEEDS`]. The regret is the root mean square of the latter's errors over that of the best of the three.
//!
//! A line before it has the least error of each strategy of the grid, and of discs.
//!
//! What was done is kept in `target/regret`, so that it can be stopped and goes on where it was.

use bdpm::image::film::{luminance, luminance_weights, pool};
use bdpm::import::load;
use bdpm::optimize::Objective;
use bdpm::render::block::Combined;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::{Direct, Kernel, PartialSettings, Strategy};
use bdpm::steer::Steer;
use bdpm::steer::autopilot::Autopilot;
use bdpm::steer::goal::{Goal, Standing, importance};
use bdpm::steer::technique::{self, End, Open, Scored, Technique};
use bdpm::{Renderer, Settings};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::PathBuf;
use std::time::{Duration, Instant};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Seconds of each half of a reference.
const REFERENCE: f64 = 60.0;
/// Seconds of each place of the grid.
const MEASURED: f64 = 3.0;
/// Radii of the grid over that of the scene.
const RADII: [f32; 5] = [4.0, 2.0, 1.0, 0.5, 0.25];
/// Caustic radii over these.
const CAUSTICS: [f32; 2] = [1.0, 0.25];
/// Of the renders that are compared.
const SEEDS: [u64; 2] = [1, 2];
/// How many of the grid are rendered.
const FINALISTS: usize = 3;

const ALL: Open =
    Open { strategy: true, direct: true, kernel: true, radius: true, caustic_radius: true };
const NONE: Open =
    Open { strategy: false, direct: false, kernel: false, radius: false, caustic_radius: false };

/// A scene at a size.
struct Subject<'a> {
    base: Renderer<'a>,
    name: String,
}

/// An image and what the program says of it.
struct Image {
    luminance: Vec<f64>,
    chosen: Scored,
    /// Relative squared noise.
    noise2: f64,
    /// Relative RMS error that was promised.
    promised: Option<f64>,
}

/// A place of the grid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Place {
    technique: Technique,
    radius: f32,
    caustic_radius: f32,
}

/// What one had in [`MEASURED`] seconds, relative.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Found {
    noise2: f64,
    bias2: f64,
}

/// A render that is compared.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Run {
    /// Squared relative error.
    square: f64,
    promised: Option<f64>,
    what: Place,
}

impl Subject<'_> {
    /// What `key` led to before, or does now.
    fn kept<T: Serialize + DeserializeOwned>(
        &self,
        key: &str,
        make: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("target/regret");
        fs::create_dir_all(&folder)?;
        let file = folder.join(format!("{}-{key}.json", self.name));
        if let Ok(text) = fs::read_to_string(&file) {
            return Ok(serde_json::from_str(&text)?);
        }
        let made = make()?;
        let new = file.with_extension("new");
        fs::write(&new, serde_json::to_string(&made)?)?;
        fs::rename(new, file)?;
        Ok(made)
    }

    /// Renders for so many seconds, with what is open chosen for that.
    fn render(&self, settings: Settings, open: Open, seconds: f64) -> Result<Image> {
        let start = Instant::now();
        let base = self.base.like(settings)?;
        let choice = technique::choose(&base, open, End::Time(seconds))?;
        let chosen = *choice.best();
        let time = Some(Duration::from_secs_f64(seconds));
        let objective = Objective::Relative;
        let goal = Goal { time, objective, bias2: chosen.bias.powi(2), ..Goal::default() };
        let mut pilot = Autopilot::new(goal, chosen.times);
        let mut renderer = base.like(chosen.apply(base.settings()))?;
        while start.elapsed().as_secs_f64() < seconds {
            let measure = pilot.steer(&mut renderer, start.elapsed().as_secs_f64())?;
            renderer.iterate(measure);
        }
        let blocks = renderer.blocks();
        let importance = importance(blocks, objective);
        let weights = pilot.weights(blocks, &importance);
        let standing = Standing::new(blocks, weights.clone(), &importance);
        let image = Combined::new(blocks, weights);
        let pixels = image.mean().into_iter().map(|value| luminance(value.as_dvec3()));
        Ok(Image {
            luminance: pixels.collect(),
            chosen,
            noise2: standing.counted.unwrap_or(f64::NAN),
            promised: pilot.promise().and_then(|promise| promise.error),
        })
    }

    /// One half of the reference.
    fn half(&self, seed: u64) -> Result<Vec<f64>> {
        let own = self.base.settings();
        let radius = 0.25 * own.radius;
        let narrow = Settings { radius, caustic_radius: 0.4 * radius, seed, ..own.clone() };
        let strategy = Open { strategy: true, ..NONE };
        Ok(self.render(narrow, strategy, REFERENCE)?.luminance)
    }

    fn places(&self) -> Vec<Place> {
        let Settings { radius, .. } = *self.base.settings();
        let place = |(strategy, merge_vertex, direct), kernel, factor, caustics| Place {
            technique: Technique { strategy, merge_vertex, direct, kernel },
            radius: factor * radius,
            caustic_radius: caustics * factor * radius,
        };
        let strategies = [
            (Strategy::Single, 1, Direct::Connect),
            (Strategy::Single, 1, Direct::PhotonMap),
            (Strategy::Single, 2, Direct::Connect),
            (Strategy::Mis, 2, Direct::Connect),
        ];
        let mut all = Vec::new();
        for strategy in strategies {
            for factor in RADII {
                for caustics in CAUSTICS {
                    all.push(place(strategy, Kernel::Area, factor, caustics));
                }
            }
            for factor in [4.0, 1.0] {
                all.push(place(strategy, Kernel::Disc, factor, 1.0));
            }
        }
        all
    }

    fn settings(&self, place: &Place, seed: u64) -> Settings {
        let Place { technique, radius, caustic_radius } = *place;
        let Technique { strategy, merge_vertex, direct, kernel } = technique;
        let own = self.base.settings().clone();
        Settings { strategy, merge_vertex, direct, kernel, radius, caustic_radius, seed, ..own }
    }
}

/// Two images of the same, independent of each other, and weights of the pixels.
struct Reference {
    halves: [Vec<f64>; 2],
    weights: Vec<f64>,
}

impl Reference {
    fn new(subject: &Subject) -> Result<Self> {
        let half = |seed: u64| subject.kept(&format!("reference-{seed}"), || subject.half(seed));
        let halves = [half(101)?, half(102)?];
        let mean: Vec<_> = halves[0].iter().zip(&halves[1]).map(|(a, b)| [0.5 * (a + b)]).collect();
        let Settings { width, height, .. } = *subject.base.settings();
        let around: Vec<f64> = pool(&mean, width, height).into_iter().map(|[l]| l).collect();
        Ok(Self { halves, weights: luminance_weights(&around) })
    }

    /// Squared relative error.
    fn square(&self, image: &[f64]) -> f64 {
        let [a, b] = &self.halves;
        let terms =
            (0..image.len()).map(|i| self.weights[i] * (image[i] - a[i]) * (image[i] - b[i]));
        terms.sum::<f64>() / image.len() as f64
    }
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, side, times @ ..] = &arguments[..] else {
        return Err(
            "give a scene, a number of pixels and seconds, such as cornell-box 128 5 20".into()
        );
    };
    let loaded = load(&PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes").join(scene))?;
    let accel = &*build(Backend::default(), &loaded.scene)?;
    let side: u32 = side.parse()?;
    let wishes = PartialSettings { resolution: Some([side; 2]), ..Default::default() };
    let settings = Settings::resolve(&wishes, &loaded.defaults, loaded.scene.size())?;
    let base = Renderer::new(&loaded.scene, accel, settings)?;
    let subject = Subject { base, name: format!("{scene}-{side}") };
    let reference = Reference::new(&subject)?;

    let mut grid = Vec::new();
    for (index, place) in subject.places().into_iter().enumerate() {
        let found = subject.kept(&format!("place-{index}"), || {
            let image = subject.render(subject.settings(&place, 9), NONE, MEASURED)?;
            let bias2 = reference.square(&image.luminance) - image.noise2;
            Ok(Found { noise2: image.noise2, bias2 })
        })?;
        grid.push((place, found));
    }
    for time in times {
        let seconds: f64 = time.parse()?;
        let expected = |found: &Found| found.noise2 * MEASURED / seconds + found.bias2.max(0.0);
        let mut best: Vec<_> = grid.iter().filter(|(_, found)| found.noise2 > 0.0).collect();
        best.sort_by(|one, other| expected(&one.1).total_cmp(&expected(&other.1)));
        // The second table: the least error of each strategy, at its best radii.
        let least = |of: &dyn Fn(&Place) -> bool| {
            let own = best.iter().find(|(place, _)| of(place));
            own.map_or("-".into(), |(_, found)| format!("{:.2} %", 100.0 * expected(found).sqrt()))
        };
        let area = |strategy, vertex, direct| {
            least(&move |place: &Place| {
                let kernel = Kernel::Area;
                place.technique == Technique { strategy, merge_vertex: vertex, direct, kernel }
            })
        };
        println!(
            "strategies | {scene} | {side} | {seconds} s | {} | {} | {} | {} | {} |",
            area(Strategy::Single, 1, Direct::Connect),
            area(Strategy::Single, 1, Direct::PhotonMap),
            area(Strategy::Single, 2, Direct::Connect),
            area(Strategy::Mis, 2, Direct::Connect),
            least(&|place| place.technique.kernel == Kernel::Disc),
        );
        best.truncate(FINALISTS);
        let mut squares = vec![0.0; best.len() + 1];
        let mut promises = Vec::new();
        let mut own = None;
        for seed in SEEDS {
            let settings = Settings { seed, ..subject.base.settings().clone() };
            let key = format!("{seconds}s-seed-{seed}");
            let automatic: Run =
                subject.kept(&key, || run(&subject, &reference, settings, ALL, seconds))?;
            squares[best.len()] += automatic.square;
            promises.extend(automatic.promised.map(|error| error / automatic.square.sqrt()));
            own = Some(automatic.what);
            for (index, (place, _)) in best.iter().enumerate() {
                let settings = subject.settings(place, seed);
                let key = format!("{seconds}s-seed-{seed}-best-{index}");
                squares[index] += subject
                    .kept(&key, || run(&subject, &reference, settings, NONE, seconds))?
                    .square;
            }
        }
        let errors: Vec<f64> =
            squares.iter().map(|square| (square / SEEDS.len() as f64).abs().sqrt()).collect();
        let (mine, others) = errors.split_last().expect("one");
        let least = others.iter().copied().fold(f64::INFINITY, f64::min);
        let winner = best[others.iter().position(|&error| error == least).expect("one")].0;
        let describe = |place: &Place| {
            let Place { technique, radius, caustic_radius } = place;
            format!("{}, {radius:.3}, {caustic_radius:.3}", technique.describe())
        };
        println!(
            "| {scene} | {side} | {seconds} s | {:.2} | {:.2} % | {:.2} % | {} | {} | {} |",
            mine / least,
            100.0 * mine,
            100.0 * least,
            promises.iter().map(|p| format!("{p:.2}")).collect::<Vec<_>>().join(", "),
            own.as_ref().map(describe).unwrap_or_default(),
            describe(&winner),
        );
    }
    Ok(())
}

/// A render and its error.
fn run(
    subject: &Subject,
    reference: &Reference,
    settings: Settings,
    open: Open,
    seconds: f64,
) -> Result<Run> {
    let Image { luminance, chosen, promised, .. } = subject.render(settings, open, seconds)?;
    let Scored { technique, radius, caustic_radius, .. } = chosen;
    let what = Place { technique, radius, caustic_radius };
    Ok(Run { square: reference.square(&luminance), promised, what })
}
