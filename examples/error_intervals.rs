//! How often the true error of an image lies in the range that was promised and in the range that
//! was reported: the table of `docs/measurements/predictions.md`.
//!
//! ```sh
//! cargo run --release --example error_intervals -- 128 2,4,8 2 cornell-box keyhole   # pixels, seconds, seeds, scenes
//! ```
//!
//! The true error is that against two references, whose own noise cancels: `examples/references`.
//! What was done is kept in `target/measured`, so that a stopped run continues.

#[allow(dead_code)] // reads some of what it offers
mod references;

use bdpm::Settings;
use bdpm::adaptive::error_interval::ErrorInterval;
use bdpm::adaptive::technique::FreeParameters;
use references::{Image, Reference, Result, Stated, Subject, with};
use serde::{Deserialize, Serialize};

/// A render: its true error, and what the program said of it.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Run {
    actual: f64,
    promised: Option<Stated>,
    reported: Option<Stated>,
}

/// Numbers of true errors below, in and above a range.
#[derive(Clone, Copy, Debug, Default)]
struct Coverage([u32; 3]);

impl Coverage {
    fn add(&mut self, stated: Option<&Stated>, actual: f64) {
        if let Some(Stated { interval: ErrorInterval { low, high }, .. }) = stated {
            self.0[usize::from(actual >= *low) + usize::from(actual > *high)] += 1;
        }
    }

    fn describe(&self) -> String {
        let [below, inside, above] = self.0;
        let all = below + inside + above;
        let share = 100.0 * f64::from(inside) / f64::from(all.max(1));
        format!("{inside} of {all} ({share:.0} %), {below} below, {above} above")
    }
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [side, times, seeds, scenes @ ..] = &arguments[..] else {
        return Err(
            "give pixels, seconds, seeds and scenes, such as 128 2,4,8 2 cornell-box".into()
        );
    };
    let (side, seeds): (u32, u64) = (side.parse()?, seeds.parse()?);
    let times: Vec<f64> =
        times.split(',').map(str::parse).collect::<std::result::Result<_, _>>()?;
    println!("| scene | time | true | promised | reported |\n|---|---|---|---|---|");
    let [mut promises, mut reports] = [Coverage::default(); 2];
    for scene in scenes {
        with(scene, side, |subject, reference| {
            for &seconds in &times {
                for seed in 1..=seeds {
                    let key = format!("interval-{seconds}s-{seed}");
                    let run = subject.kept(&key, || run(subject, reference, seed, seconds))?;
                    promises.add(run.promised.as_ref(), run.actual);
                    reports.add(run.reported.as_ref(), run.actual);
                    let [promised, reported] =
                        [run.promised, run.reported].map(|stated| describe(stated.as_ref()));
                    let actual = 100.0 * run.actual;
                    println!("| {scene} | {seconds} s | {actual:.2} % | {promised} | {reported} |");
                }
            }
            Ok(())
        })?;
    }
    println!("\npromised: {}\nreported: {}", promises.describe(), reports.describe());
    Ok(())
}

fn run(subject: &Subject, reference: &Reference, seed: u64, seconds: f64) -> Result<Run> {
    let settings = Settings { seed, ..subject.settings.clone() };
    let Image { luminance, promised, reported, .. } =
        subject.render(settings, FreeParameters::ALL, seconds)?;
    Ok(Run { actual: reference.square(&luminance).max(0.0).sqrt(), promised, reported })
}

fn describe(stated: Option<&Stated>) -> String {
    let percent = |share: f64| format!("{:.2}", 100.0 * share);
    match stated {
        Some(Stated { error, interval: ErrorInterval { low, high } }) => {
            format!("{} ({} to {}) %", percent(*error), percent(*low), percent(*high))
        }
        None => "-".into(),
    }
}
