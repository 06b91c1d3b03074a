//! What a render has done so far, and what it expects of the rest.

use bdpm_auto::adaptive::stopping::{Convergence, Forecast, Stop};
use bdpm_core::film::PhaseTimes;
use bdpm_core::render::IterationReport;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Progress of an image after an iteration.
#[derive(Clone, Debug, Default)]
pub struct Status {
    /// Iterations of the image.
    pub iterations: u64,
    /// Latest estimate of noise and bias.
    pub convergence: Option<Convergence>,
    /// Forecast of noise and time at the end, once it is known.
    pub forecast: Option<Forecast>,
}

impl Status {
    /// The remaining seconds, if they are known, and the share of the work that is done after
    /// `elapsed` seconds.
    pub fn time_left(&self, stop: &Stop, elapsed: f64) -> (Option<f64>, f64) {
        let of_time = |time: Duration| elapsed / time.as_secs_f64().max(1e-9);
        let left = self.forecast.map(|forecast| forecast.seconds).or_else(|| {
            let rest = |time: Duration| (time.as_secs_f64() - elapsed).max(0.0);
            stop.time.filter(|_| stop.target.is_none() && stop.error.is_none()).map(rest)
        });
        let fraction = match (left, stop.iterations) {
            (_, Some(n)) => self.iterations as f64 / n as f64,
            (Some(left), None) => elapsed / (elapsed + left).max(1e-9),
            (None, None) => stop.time.map_or(0.0, of_time),
        };
        (left, fraction)
    }
}

/// Work of a run, of all its processes.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Totals {
    /// Iterations of this run.
    pub iterations: u64,
    /// Rays of this run.
    pub rays: u64,
    /// Light paths of this run.
    pub light_paths: u64,
    /// Photons of this run.
    pub photons: u64,
    /// Whether any photon came through glass or off mirrors only.
    pub found_caustics: bool,
    /// Pixel values that were not finite and were left out.
    pub non_finite: u64,
    /// Busy thread time of the phases, and wall-clock time.
    pub times: PhaseTimes,
}

/// A forecast of this run's rendering time.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct TimeForecast {
    /// Rendering time when it was made, seconds.
    pub said_after: f64,
    /// Forecast of the whole rendering time, seconds.
    pub seconds: f64,
    /// The time that rendering took in the end, seconds.
    pub took: f64,
}

/// Noise of the image at a time.
#[derive(Clone, Copy, Debug)]
pub struct NoiseAt {
    /// Rendering time of this run, seconds.
    pub seconds: f64,
    /// Variance relative to the squared luminance of each pixel or of the mean, by the objective.
    pub noise2: f64,
}

/// Exchange between several processes.
#[derive(Clone, Copy, Debug)]
pub struct Exchanged {
    /// Number of processes.
    pub ranks: u32,
    /// Time until the other processes were done.
    pub waiting: Duration,
    /// Time until their sums were added.
    pub adding: Duration,
    /// Bytes that rank 0 received.
    pub bytes: u64,
}

impl Exchanged {
    /// Nothing exchanged yet.
    pub(super) fn new(ranks: u32) -> Self {
        Self { ranks, waiting: Duration::ZERO, adding: Duration::ZERO, bytes: 0 }
    }
}

impl Totals {
    /// Adds an iteration.
    pub fn add(&mut self, report: &IterationReport) {
        self.iterations += 1;
        self.rays += report.rays;
        self.light_paths += report.light_paths;
        self.photons += report.photons as u64;
        self.found_caustics |= report.found_caustics;
        self.non_finite += report.non_finite.len() as u64;
        self.times += report.times;
    }

    /// Adds the work of another process.
    pub fn join(&mut self, other: &Self) {
        self.iterations += other.iterations;
        self.rays += other.rays;
        self.light_paths += other.light_paths;
        self.photons += other.photons;
        self.found_caustics |= other.found_caustics;
        self.non_finite += other.non_finite;
        self.times += other.times;
    }

    /// Rays per second of wall-clock time.
    pub fn rays_per_second(&self) -> f64 {
        self.rays as f64 / self.times.wall.as_secs_f64().max(1e-9)
    }
}
