//! Error of strategies and kernels after equal time at the radius of the scene: the table of
//! docs/measurements/strategies.md.
//!
//! ```sh
//! cargo run --release --example efficiency_table -- 10 cornell-box:128 cornell-box:512      # seconds, scenes and sizes
//! ```
//!
//! After the seconds may stand `only=area,half`, some of its rows. Counts are chosen for each
//! (docs/measurements/optimum.md), camera paths by pixel as well. What was done is kept in
//! `target/measured`. References: `examples/references`.

#[allow(dead_code)] // reads some of what it offers
mod references;

use bdpm::adaptive::technique::FreeParameters;
use bdpm::adaptive::technique::Technique;
use bdpm::settings::{Direct, Kernel, Strategy};
use references::{Place, Result, with};
use serde::{Deserialize, Serialize};

/// Each is rendered so often; squared errors are averaged.
const SEEDS: [u64; 2] = [21, 22];

/// Relative errors of one run.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Found {
    /// Squared error.
    square: f64,
    /// Part of the squared error that is noise, measured without the reference.
    noise2: f64,
    /// Means of `a`, `b` and `f`.
    parts: [f64; 3],
    /// Squared noise that a second more of rendering would leave, alone.
    cost: Option<f64>,
    /// Relative error that was promised.
    promised: Option<f64>,
    light_paths: u32,
    camera_paths: u32,
}

/// Compared techniques: name, strategy, merge vertex, kernel, and the caustic radius over the
/// radius.
const RIVALS: [(&str, Strategy, u32, Kernel, f32); 6] = [
    ("disc", Strategy::Single, 1, Kernel::Disc, 1.0),
    ("area", Strategy::Single, 1, Kernel::Area, 1.0),
    ("half", Strategy::Single, 1, Kernel::Area, 0.5),
    ("k = 1", Strategy::Single, 1, Kernel::Area, 0.25),
    ("k = 2", Strategy::Single, 2, Kernel::Area, 0.25),
    ("MIS", Strategy::Mis, 2, Kernel::Area, 0.25),
];

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [seconds, subjects @ ..] = &arguments[..] else {
        return Err("give seconds, and scenes with sizes such as cornell-box:128".into());
    };
    let time: f64 = seconds.parse()?;
    let (only, subjects) = match subjects {
        [first, rest @ ..] if first.starts_with("only=") => (first.strip_prefix("only="), rest),
        _ => (None, subjects),
    };
    let wanted = |name: &str| only.is_none_or(|only| only.split(',').any(|one| one == name));
    for subject in subjects {
        let (scene, side) = subject.split_once(':').ok_or("scenes have sizes: cornell-box:128")?;
        with(scene, side.parse()?, |subject, reference| {
            let mut first = None;
            for (name, strategy, merge_vertex, kernel, caustics) in RIVALS {
                if !wanted(name) {
                    continue;
                }
                let radius = subject.settings.radius;
                let technique = Technique {
                    strategy,
                    merge_vertex,
                    direct: Direct::Connect,
                    kernel,
                    splitting: 1,
                    medium_query: None,
                };
                let place = Place { technique, radius, caustic_radius: caustics * radius };
                let mut runs = Vec::new();
                for seed in SEEDS {
                    let key = format!("rival-{}-{seconds}s-{seed}", name.replace(' ', ""));
                    runs.push(subject.kept(&key, || {
                        let image = subject.render(
                            subject.settings(&place, seed),
                            FreeParameters::NONE,
                            time,
                        )?;
                        Ok(Found {
                            square: reference.square(&image.luminance),
                            noise2: image.noise2,
                            parts: image.parts,
                            cost: image.cost,
                            promised: image.promised.map(|promised| promised.error),
                            light_paths: image.chosen.light_paths,
                            camera_paths: image.chosen.camera_paths,
                        })
                    })?);
                }
                let mean = |of: fn(&Found) -> f64| runs.iter().map(of).sum::<f64>() / 2.0;
                let (square, noise2) = (mean(|run| run.square), mean(|run| run.noise2));
                let reference = *first.get_or_insert(square);
                let [a, b, f] =
                    [0, 1, 2].map(|part| runs.iter().map(|run| run.parts[part] / 2.0).sum::<f64>());
                println!(
                    "| {scene} | {side} | {name} | {:.2} % | {:.2} % | {:.2} % | {:.2} | {:.2} | {a:.2e} | {b:.3} | {f:.2e} | {} | {} | {:.2e} |",
                    100.0 * square.abs().sqrt(),
                    100.0 * noise2.sqrt(),
                    100.0 * (square - noise2).max(0.0).sqrt(),
                    reference / square,
                    runs[0].promised.unwrap_or(f64::NAN) / runs[0].square.abs().sqrt(),
                    runs[0].light_paths,
                    runs[0].camera_paths,
                    mean(|run| run.cost.unwrap_or(f64::NAN)),
                );
            }
            Ok(())
        })?;
    }
    Ok(())
}
