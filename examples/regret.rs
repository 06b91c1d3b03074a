//! The error of a render without options over that of the best settings found by search, after the
//! same time: the table of `docs/measurements/regret.md`.
//!
//! ```sh
//! cargo run --release --example regret -- cornell-box 128 5 20         # scene, pixels along a side, seconds
//! ```
//!
//! - The *reference* and the error: `examples/references`.
//! - The *grid* is all strategies at radii over 16-fold, both kernels at the scene's radius, and
//!   caustic radii of a quarter and of all of it; path tracing and the cache without radii, and
//!   both with photons of caustics at caustic radii over 16-fold. Each is rendered for [`MEASURED`]
//!   seconds at counts that the program chooses for it (docs/measurements/optimum.md: what these
//!   lose). Its squared error less its noise is its squared bias; its noise falls with the time.
//! - The three that should have the least error after the time are rendered, in turn with renders
//!   without options, each with [`SEEDS`]. The regret is the root mean square of the latter's
//!   errors over that of the best of the three, and that of the worst seed.
//!
//! A line before it has the least error of each strategy of the grid, and of discs.
//!
//! What was done is kept in `target/measured`, so that it can be stopped and goes on where it was.

#[allow(dead_code)] // reads some of what it offers
mod references;

use bdpm::Settings;
use bdpm::adaptive::technique::{Candidate, FreeParameters, Technique};
use bdpm::settings::{Direct, Kernel, Strategy};
use references::{Image, Place, Reference, Result, Subject, with};
use serde::{Deserialize, Serialize};

/// Seconds of each place of the grid.
const MEASURED: f64 = 2.0;
/// Radii of the grid over that of the scene.
const RADII: [f32; 5] = [4.0, 2.0, 1.0, 0.5, 0.25];
/// Caustic radii over these.
const CAUSTICS: [f32; 2] = [1.0, 0.25];
/// Seeds of the renders that are compared.
const SEEDS: [u64; 3] = [1, 2, 3];
/// Number of techniques of the grid that are rendered in full.
const FINALISTS: usize = 3;

/// Relative errors of one technique after [`MEASURED`] seconds.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Found {
    noise2: f64,
    bias2: f64,
    /// Squared noise that a second more of rendering would leave, alone.
    cost: Option<f64>,
    /// Means of `a`, `b` and `f`.
    parts: [f64; 3],
}

/// A render that is compared.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Run {
    /// Squared relative error.
    square: f64,
    promised: Option<f64>,
    what: Place,
}

fn places(subject: &Subject) -> Vec<Place> {
    let Settings { radius, .. } = subject.settings;
    let place = |(strategy, merge_vertex, direct), kernel, factor, caustics| Place {
        technique: Technique {
            strategy,
            merge_vertex,
            direct,
            kernel,
            splitting: 1,
            medium_query: None,
        },
        radius: factor * radius,
        caustic_radius: caustics * factor * radius,
    };
    let strategies = [
        (Strategy::Single, 1, Direct::Connect),
        (Strategy::Single, 1, Direct::PhotonMap),
        (Strategy::Single, 2, Direct::Connect),
        (Strategy::Mis, 2, Direct::Connect),
        (Strategy::CutMis, 2, Direct::Connect),
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
    // Radii do not matter without photons. Point lights in glass are then missing, which the bias
    // tells.
    for strategy in [Strategy::Path, Strategy::Gather] {
        all.push(place((strategy, 2, Direct::Connect), Kernel::Area, 1.0, 1.0));
    }
    for strategy in [Strategy::PathCaustics, Strategy::GatherCaustics] {
        for caustics in RADII {
            all.push(place((strategy, 2, Direct::Connect), Kernel::Area, 1.0, caustics));
        }
    }
    all
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, side, times @ ..] = &arguments[..] else {
        return Err(
            "give a scene, a number of pixels and seconds, such as cornell-box 128 5 20".into()
        );
    };
    with(scene, side.parse()?, |subject, reference| {
        compare(subject, reference, (scene, side), times)
    })
}

fn compare(
    subject: &Subject,
    reference: &Reference,
    (scene, side): (&str, &str),
    times: &[String],
) -> Result<()> {
    let mut grid = Vec::new();
    for (index, place) in places(subject).into_iter().enumerate() {
        let found = subject.kept(&format!("place-{index}"), || {
            let image =
                subject.render(subject.settings(&place, 9), FreeParameters::NONE, MEASURED)?;
            let bias2 = reference.square(&image.luminance) - image.noise2;
            let Image { noise2, cost, parts, .. } = image;
            // Too few iterations fit in the time to tell.
            Ok(noise2.is_finite().then_some(Found { noise2, bias2, cost, parts }))
        })?;
        grid.extend(found.map(|found: Found| (place, found)));
    }
    for time in times {
        let seconds: f64 = time.parse()?;
        // Information, the reciprocal of the variance, adds up.
        let noise2 = |found: &Found| {
            let cost = found.cost.unwrap_or(found.noise2 * MEASURED);
            (found.noise2.recip() + (seconds - MEASURED) / cost).recip()
        };
        let expected = |found: &Found| noise2(found) + found.bias2.max(0.0);
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
                let own =
                    Technique { strategy, merge_vertex: vertex, direct, kernel, ..place.technique };
                place.technique == own
            })
        };
        println!(
            "strategies | {scene} | {side} | {seconds} s | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            area(Strategy::Single, 1, Direct::Connect),
            area(Strategy::Single, 1, Direct::PhotonMap),
            area(Strategy::Single, 2, Direct::Connect),
            area(Strategy::Mis, 2, Direct::Connect),
            area(Strategy::CutMis, 2, Direct::Connect),
            area(Strategy::Path, 2, Direct::Connect),
            area(Strategy::PathCaustics, 2, Direct::Connect),
            area(Strategy::Gather, 2, Direct::Connect),
            area(Strategy::GatherCaustics, 2, Direct::Connect),
            least(&|place| place.technique.kernel == Kernel::Disc),
        );
        best.truncate(FINALISTS);
        let mut squares = vec![0.0; best.len() + 1];
        let (mut promises, mut worst) = (Vec::new(), 0.0f64);
        let mut own = None;
        for seed in SEEDS {
            let settings = Settings { seed, ..subject.settings.clone() };
            let key = format!("{seconds}s-seed-{seed}");
            let automatic: Run = subject
                .kept(&key, || run(subject, reference, settings, FreeParameters::ALL, seconds))?;
            squares[best.len()] += automatic.square;
            worst = worst.max(automatic.square);
            promises.extend(automatic.promised.map(|error| error / automatic.square.sqrt()));
            own = Some(automatic.what);
            for (index, (place, _)) in best.iter().enumerate() {
                let settings = subject.settings(place, seed);
                let key = format!("{seconds}s-seed-{seed}-best-{index}");
                squares[index] += subject
                    .kept(&key, || {
                        run(subject, reference, settings, FreeParameters::NONE, seconds)
                    })?
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
            "| {scene} | {side} | {seconds} s | {:.2} | {:.2} | {:.2} % | {:.2} % | {} | {} | {} |",
            mine / least,
            worst.sqrt() / least,
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
    open: FreeParameters,
    seconds: f64,
) -> Result<Run> {
    let Image { luminance, chosen, promised, .. } = subject.render(settings, open, seconds)?;
    let promised = promised.map(|promised| promised.error);
    let Candidate { technique, radius, caustic_radius, .. } = chosen;
    let what = Place { technique, radius, caustic_radius };
    Ok(Run { square: reference.square(&luminance), promised, what })
}
