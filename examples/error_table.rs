//! The relative error of automatic renders beside those of single techniques at the radii of the scene, after the same
//! time: the table of `docs/automatic.md`.
//!
//! ```sh
//! cargo run --release --example error_table -- 10                             # seconds each
//! cargo run --release --example error_table -- 10 cornell-box 512             # one scene, pixels along a side
//! ```
//!
//! The reference is two renders of six times as long, of narrow radii. An error is the root of the mean of
//! `(x - A)(x - B)/(L^2 + 0.01 mean(L)^2)`: the noise of either reference does not meet itself. `L` is the mean of
//! both over 5 by 5 pixels.

use bdpm::image::film::{luminance, luminance_weights, pool};
use bdpm::import::load;
use bdpm::optimize::Objective;
use bdpm::render::block::Combined;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::{PartialSettings, Strategy};
use bdpm::steer::Steer;
use bdpm::steer::autopilot::Autopilot;
use bdpm::steer::goal::Goal;
use bdpm::steer::technique::{self, Chosen, End, Open};
use bdpm::{Renderer, Settings};
use std::path::Path;
use std::time::{Duration, Instant};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const SCENES: [&str; 4] = ["cornell-box", "cornell-box-classic", "caustic-sphere", "keyhole"];
const SIDES: [u32; 2] = [128, 512];
const SEEDS: [u64; 2] = [1, 2];

/// What is rendered, and for how long.
struct Subject<'a> {
    scene: &'a bdpm::Scene,
    accel: &'a dyn bdpm::accel::Intersect,
    settings: Settings,
}

impl Subject<'_> {
    /// Luminance of each pixel after `seconds`, and the technique if that is open.
    fn render(
        &self,
        settings: &Settings,
        open: bool,
        seconds: f64,
    ) -> Result<(Vec<f64>, Option<Chosen>)> {
        let start = Instant::now();
        let open_all = Open { strategy: true, direct: true, radius: true, caustic_radius: true };
        let chosen = if open {
            let asked = (open_all, End::Time(seconds));
            Some(technique::choose(self.scene, self.accel, settings, asked)?)
        } else {
            None
        };
        let own = chosen.as_ref().map_or(settings.clone(), |chosen| chosen.best().apply(settings));
        let time = Some(Duration::from_secs_f64(seconds));
        let goal = Goal { time, objective: Objective::Relative, ..Goal::default() };
        let mut pilot = Autopilot::new(goal, rayon::current_num_threads(), None);
        if let Some(chosen) = &chosen {
            pilot = pilot.starting_at(chosen.best());
        }
        let mut renderer = Renderer::new(self.scene, self.accel, own)?;
        while start.elapsed().as_secs_f64() < seconds {
            let measure = pilot.steer(&mut renderer, start.elapsed().as_secs_f64())?;
            renderer.iterate(measure);
        }
        let image = Combined::new(renderer.blocks(), pilot.weights(renderer.blocks()));
        let pixels = image.mean().into_iter().map(|value| luminance(value.as_dvec3()));
        Ok((pixels.collect(), chosen))
    }
}

/// Two images of the same, independent of each other, and weights of the pixels.
struct Reference {
    halves: [Vec<f64>; 2],
    weights: Vec<f64>,
}

impl Reference {
    fn new(subject: &Subject, seconds: f64) -> Result<Self> {
        let Settings { radius, .. } = subject.settings;
        let narrow = |seed| Settings {
            merge_vertex: 1,
            radius: 0.25 * radius,
            caustic_radius: 0.1 * radius,
            seed,
            ..subject.settings.clone()
        };
        let half = |seed| {
            Ok::<_, Box<dyn std::error::Error>>(subject.render(&narrow(seed), false, seconds)?.0)
        };
        let halves = [half(101)?, half(102)?];
        let mean: Vec<_> = halves[0].iter().zip(&halves[1]).map(|(a, b)| [0.5 * (a + b)]).collect();
        let Settings { width, height, .. } = subject.settings;
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
    let mut arguments = std::env::args().skip(1);
    let seconds: f64 = arguments.next().map_or(Ok(10.0), |text| text.parse())?;
    let wanted = arguments.next();
    let side: Option<u32> = arguments.next().map(|text| text.parse()).transpose()?;
    println!("| scene | pixels | k = 1 | k = 2 | MIS | automatic | expected | chosen |");
    println!("|---|---|---|---|---|---|---|---|");
    for name in SCENES.iter().filter(|name| wanted.as_ref().is_none_or(|wanted| wanted == *name)) {
        let loaded = load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name))?;
        let accel = &*build(Backend::default(), &loaded.scene)?;
        for side in SIDES.into_iter().filter(|own| side.is_none_or(|side| side == *own)) {
            let wishes = PartialSettings { resolution: Some([side; 2]), ..Default::default() };
            let settings = Settings::resolve(&wishes, &loaded.defaults, loaded.scene.size())?;
            let subject = Subject { scene: &loaded.scene, accel, settings };
            let reference = Reference::new(&subject, 6.0 * seconds)?;
            let mut cells = Vec::new();
            for (strategy, merge_vertex) in
                [(Strategy::Single, 1), (Strategy::Single, 2), (Strategy::Mis, 2)]
            {
                let own = Settings { strategy, merge_vertex, ..subject.settings.clone() };
                let (image, _) = subject.render(&own, false, seconds)?;
                cells.push(percent(reference.square(&image)));
            }
            let (mut square, mut last) = (0.0, None);
            for seed in SEEDS {
                let own = Settings { seed, ..subject.settings.clone() };
                let (image, chosen) = subject.render(&own, true, seconds)?;
                square += reference.square(&image) / SEEDS.len() as f64;
                last = chosen;
            }
            cells.push(percent(square));
            let best = *last.expect("a choice").best();
            cells.push(percent(best.error.powi(2)));
            let (technique, radius) = (best.technique.describe(), best.radius);
            println!(
                "| {name} | {side}x{side} | {} | {technique}, radius {radius:.3} |",
                cells.join(" | ")
            );
        }
    }
    Ok(())
}

/// The root, with the sign of what noise has made negative.
fn percent(square: f64) -> String {
    format!("{:.2} %", 100.0 * square.abs().sqrt().copysign(square))
}
