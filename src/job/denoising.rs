//! Denoising in a job: when the denoiser runs, the time that is reserved for it, and the error of its result.

use crate::adaptive::stopping::Stop;
use crate::base::error::{Error, Result};
use crate::base::math::Rgb;
use crate::film::folds::DENOISE_FOLDS;
use crate::noise::bias::UPPER_BOUND;
use crate::output::denoise::{Denoised, ErrorSummary, Guides, Oidn, denoise};
use crate::render::Renderer;
use crate::render::block::CombinedImage;
use serde::Serialize;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Maximum share of the time for denoising at the end. If leaving out every fold takes longer, fewer folds are
/// left out.
const DENOISE_SHARE: f64 = 0.25;

/// Minimum number of iterations per fold before the error of a denoised image is estimated during the render.
const MIN_ITERATIONS_PER_FOLD: u64 = 2;

/// Share of the time that estimating the error during the render may take.
const CHECK_SHARE: f64 = 0.2;

/// Range of the ratio between the rendering times of two estimates of the error, within which it follows the
/// expected decrease of the error.
const CHECK_GROWTH: Range<f64> = 1.1..2.0;

/// Assumed power of the time with which the squared error of denoised images decreases. It is below 1, the power of
/// noise, since the denoiser's bias decreases later. Only the next check and promises depend on it.
const DENOISED_DECAY: f64 = 0.7;

/// Share of the given time after which the error at its end is promised.
const PROMISE_AFTER: f64 = 0.25;

/// Maximum share of the time that this estimate may take.
const PROMISE_SHARE: f64 = 0.1;

/// Factor by which denoising the guides prolongs a run of the denoiser.
const NOISY_GUIDES: usize = 3;

/// The denoiser and its latest result.
pub struct Denoising {
    /// Locked by one thread at a time. Pages read the other fields from several threads.
    oidn: Mutex<Oidn>,
    size: (u32, u32),
    /// Number of folds that are left out in turn; 0 if the time is too short for that.
    folds: usize,
    is_timed: bool,
    /// Time of a run with clean guides. Noisy guides multiply it by [`NOISY_GUIDES`].
    run_time: Duration,
    /// Time of all runs.
    pub time: Duration,
    /// Rendering time at which the error is estimated next.
    next_check: Duration,
    /// Latest denoised image, with its error if that was estimated.
    pub latest: Option<Denoised>,
    /// Number of iterations in `latest`.
    iterations: u64,
    /// The error that was promised for the end, once a part of the time had passed.
    pub promise: Option<DenoisedPromise>,
    /// The error of the denoiser if it could not denoise the final image.
    pub failure: Option<Error>,
}

/// A promise about the relative error of the denoised image at the end.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct DenoisedPromise {
    /// Relative RMS error at the end: noise and the biases of denoiser and merging.
    pub error: f64,
    /// Rendering time at which the promise was made, seconds.
    pub said_after: f64,
}

/// Error and time of denoising, for reports.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct DenoisedReport {
    /// Relative RMS error, including the denoiser's bias, of an image of `(n - 1)/n` of the samples.
    pub relative_error: Option<f64>,
    /// Relative RMS error including the merge bias as well.
    pub total_error: Option<f64>,
    /// Squared errors and their components.
    pub error: Option<ErrorSummary>,
    /// The promised error, if one was made.
    pub promise: Option<DenoisedPromise>,
    /// Time of all runs of the denoiser, seconds.
    pub seconds: f64,
}

impl Denoising {
    /// Loads the denoiser and measures the time of a run. If `time` is given, the number of folds is chosen such
    /// that the final denoising fits in its share of it.
    pub fn new(threads: usize, size: (u32, u32), time: Option<Duration>) -> Result<Self> {
        let mut oidn = Oidn::new(threads)?;
        let pixels = size.0 as usize * size.1 as usize;
        let gray = vec![Rgb::splat(0.5); pixels];
        let guides = Guides { albedo: gray.clone(), normal: gray.clone(), clean: true };
        let mut timed_run = || {
            let start = Instant::now();
            oidn.denoise(size, &gray, &guides).map(|_| start.elapsed())
        };
        // The first run also reads the library's weights.
        let (first, run_time) = (timed_run()?, timed_run()?);
        let max_runs =
            |time: Duration| time.mul_f64(DENOISE_SHARE).div_duration_f64(run_time) as usize;
        let folds =
            time.map_or(DENOISE_FOLDS, |time| largest_split(max_runs(time).saturating_sub(1)));
        Ok(Self {
            oidn: Mutex::new(oidn),
            size,
            folds,
            is_timed: time.is_some(),
            run_time,
            time: first + run_time,
            next_check: Duration::ZERO,
            latest: None,
            iterations: 0,
            promise: None,
            failure: None,
        })
    }

    /// Approximate time of denoising the final image with its error.
    pub fn reserve(&self) -> Duration {
        self.run_time * (self.folds as u32 + 1)
    }

    /// Denoises the image, with its error if there is time for that. Keeps the latest result if the image has no
    /// new iterations.
    pub fn denoise(&mut self, renderer: &Renderer, image: &CombinedImage) -> Result<()> {
        let iterations = image.iterations();
        if self.latest.is_none() || iterations != self.iterations {
            self.latest = Some(self.run(renderer, image, self.folds)?);
            self.iterations = iterations;
        }
        Ok(())
    }

    /// Denoises the image without its error.
    pub fn preview(&mut self, renderer: &Renderer, image: &CombinedImage) -> Result<Denoised> {
        self.run(renderer, image, 0)
    }

    fn run(
        &mut self,
        renderer: &Renderer,
        image: &CombinedImage,
        folds: usize,
    ) -> Result<Denoised> {
        let start = Instant::now();
        let size = self.size;
        let oidn = self.oidn.get_mut().unwrap_or_else(PoisonError::into_inner);
        let run = |radiance: &[Rgb], guides: &Guides| oidn.denoise(size, radiance, guides);
        // Noisy guides have to be denoised as well: a timed job then leaves out fewer folds in the same time.
        let fewer = if self.is_timed { largest_split(folds / NOISY_GUIDES) } else { folds };
        let folds = |clean: bool| if clean { folds } else { fewer };
        let denoised = denoise(image, renderer.shared().features.as_ref(), folds, run);
        self.time += start.elapsed();
        denoised
    }

    /// The estimated error of the whole image.
    pub fn error(&self) -> Option<&ErrorSummary> {
        self.latest.as_ref()?.error.as_ref().map(|error| &error.whole)
    }

    /// The error of the latest denoised image, for reports.
    pub fn report(&self, stop: &Stop) -> DenoisedReport {
        let error = self.error().copied();
        let with_bias = |error: ErrorSummary| (error.squared.max(0.0) + stop.bias2).sqrt();
        DenoisedReport {
            relative_error: error.map(|error| error.relative()),
            total_error: error.map(with_bias),
            error,
            promise: self.promise,
            seconds: self.time.as_secs_f64(),
        }
    }

    /// Returns true if the error should be estimated after this rendering time: repeatedly for a target, once for
    /// the promise of a given time.
    pub fn is_due(&self, elapsed: Duration, iterations: u64, stop: &Stop) -> bool {
        if self.folds == 0 || iterations < MIN_ITERATIONS_PER_FOLD * self.folds as u64 {
            return false;
        }
        let is_promise_due = stop.time.is_some_and(|time| {
            self.promise.is_none()
                && elapsed >= time.mul_f64(PROMISE_AFTER)
                && self.reserve() <= time.mul_f64(PROMISE_SHARE)
        });
        let cost = self.reserve().div_f64(CHECK_SHARE);
        is_promise_due || stop.error.is_some() && elapsed >= self.next_check.max(cost)
    }

    /// Uses an error that was just estimated: makes the promise, plans the next estimate, and returns true if the
    /// error is small enough to stop.
    pub fn check_target(&mut self, elapsed: Duration, stop: &Stop) -> bool {
        let Some(error) = self.error().copied() else { return false };
        if let (Some(time), None) = (stop.time, self.promise) {
            let left = elapsed.as_secs_f64() / time.as_secs_f64().max(elapsed.as_secs_f64());
            let squared = error.squared.max(0.0) * left.powf(DENOISED_DECAY) + stop.bias2;
            let said_after = elapsed.as_secs_f64();
            self.promise = Some(DenoisedPromise { error: squared.sqrt(), said_after });
        }
        let Some(target) = stop.error else { return false };
        let excess = error.bound(UPPER_BOUND) / stop.noise2(target);
        let growth =
            excess.powf(DENOISED_DECAY.recip()).clamp(CHECK_GROWTH.start, CHECK_GROWTH.end);
        let pause = self.reserve().div_f64(CHECK_SHARE);
        self.next_check = (elapsed + pause).max(elapsed.mul_f64(growth));
        excess <= 1.0
    }
}

/// The largest usable number of folds that is at most `max_folds`; 0 if there is none.
fn largest_split(max_folds: usize) -> usize {
    [DENOISE_FOLDS, DENOISE_FOLDS / 2].into_iter().find(|n| *n <= max_folds).unwrap_or(0)
}
