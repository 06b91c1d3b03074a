//! Calibration: renders iterations of all [`sizes`] in turn and fits a time model to them.

use super::Timings;
use super::fit::fit;
use super::measure::{Recorder, SampleSize, sizes};
use super::setup::MeasurementSetup;
use bdpm_core::accel::Intersect;
use bdpm_core::base::error::Result;
use bdpm_core::noise::Measure;
use bdpm_core::render::{IterationReport, Renderer};
use bdpm_core::scene::Scene;
use bdpm_core::settings::Settings;
use bdpm_core::settings::provenance::Provenance;
use rayon::ThreadPool;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Minimum number of rounds, so that every time has an error.
const MIN_ROUNDS: u64 = 2;

/// Iterations of a size in a round. One more is rendered before them and not counted: its memory is
/// not in the caches yet.
const ITERATIONS: usize = 2;

/// Measured times of an iteration.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The fitted times, with their setup.
    pub timings: Timings,
    /// Rounds over all sizes.
    pub rounds: u64,
    /// Wall-clock time of measuring.
    pub time: Duration,
}

/// Measures the times of an iteration for about `time`, but at least two rounds.
///
/// Every round renders all sizes, so that a machine that slows down or has other work affects all
/// sizes alike. The path counts of `provenance` are ignored. `observer` gets the report of each
/// iteration and the time since the start, and may end the measurement; the result is then `None`.
///
/// # Errors
/// If the memory does not suffice, or no model fits the times.
pub fn calibrate(
    (scene, accel): (&Arc<Scene>, &Arc<dyn Intersect>),
    provenance: &Provenance,
    threads: &ThreadPool,
    time: Duration,
    mut observer: impl FnMut(&IterationReport, Duration) -> ControlFlow<()>,
) -> Result<Option<Calibration>> {
    let setup = MeasurementSetup::new(provenance, threads.current_num_threads());
    let sizes = sizes(provenance.settings.pixels());
    let mut recorder = Recorder::new(setup.threads);
    let start = Instant::now();
    let mut rounds = 0;
    // Begin a round only if at least half of it fits in the time.
    let half = |rounds: u64| start.elapsed().as_secs_f64() / (2 * rounds.max(1)) as f64;
    while rounds < MIN_ROUNDS || start.elapsed().as_secs_f64() + half(rounds) < time.as_secs_f64() {
        for &SampleSize { light_paths, camera_paths } in &sizes {
            // One renderer at a time: images at a high resolution are large.
            let settings = Settings { light_paths, camera_paths, ..provenance.settings.clone() };
            let mut renderer = Renderer::new(scene, accel, settings)?;
            for iteration in 0..=ITERATIONS {
                let report = threads.install(|| renderer.iterate(Measure::Off));
                if observer(&report, start.elapsed()).is_break() {
                    return Ok(None);
                }
                if iteration > 0 {
                    recorder.add(light_paths.into(), camera_paths.into(), &report.times);
                }
            }
        }
        rounds += 1;
    }
    let fit = fit(&recorder.samples(), setup.pixels())?;
    let timings = Timings { setup: Some(setup), ..fit };
    Ok(Some(Calibration { timings, rounds, time: start.elapsed() }))
}
