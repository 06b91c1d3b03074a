//! `render --denoise`: when the denoiser runs, what of the time is kept for it, and what came of it.

use crate::adaptive::stopping::Stop;
use crate::base::error::{Error, Result};
use crate::base::math::Rgb;
use crate::film::folds::DENOISE_FOLDS;
use crate::output::denoise::{Denoised, ErrorSummary, Guides, Oidn, denoise};
use crate::render::Renderer;
use crate::render::block::CombinedImage;
use crate::settings::policy::{
    CHECK_GROWTH, CHECK_SHARE, DENOISE_PROMISE_AFTER, DENOISE_PROMISE_SHARE, DENOISE_SHARE,
    DENOISED_FALL, LEAST_PER_PART, UPPER_BOUND,
};
use serde::Serialize;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The denoiser and what it made last.
pub struct Denoising {
    /// Shared by no two threads; pages read all else from several.
    oidn: Mutex<Oidn>,
    size: (u32, u32),
    /// Parts to be left out in turn; 0 where the time is too short for that.
    parts: usize,
    is_timed: bool,
    /// Time of a run with clean guides; of others it is [`NOISY`] times that.
    run: Duration,
    /// Of all runs.
    pub time: Duration,
    /// When the error is found next, in time of rendering.
    next_check: Duration,
    /// What was denoised last with its error, if that was found.
    pub latest: Option<Denoised>,
    /// Of how many iterations that is.
    iterations: u64,
    /// What was expected of the error when part of the time had passed.
    pub promise: Option<DenoisedPromise>,
    /// Why the final image could not be denoised, if it could not.
    pub failure: Option<Error>,
}

/// The relative error of the denoised image that was expected at the end.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct DenoisedPromise {
    /// Relative RMS error at the end, noise and the biases of denoiser and merging.
    pub error: f64,
    /// Rendering time when this was said, seconds.
    pub said_after: f64,
}

/// What the report tells.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct DenoisedReport {
    /// Relative RMS error, the denoiser's bias included, of an image of `(parts - 1)/parts` of the samples.
    pub relative_error: Option<f64>,
    /// The same with the merge bias.
    pub total_error: Option<f64>,
    /// Squares of the first with what they consist of.
    pub error: Option<ErrorSummary>,
    /// The promised error, if one was made.
    pub promise: Option<DenoisedPromise>,
    /// Time of all runs of the denoiser.
    pub seconds: f64,
}

impl Denoising {
    /// Loads the denoiser and lets it run to see how long that takes; for an image to be rendered in a time, if
    /// that is given.
    pub fn new(threads: usize, size: (u32, u32), time: Option<Duration>) -> Result<Self> {
        let mut oidn = Oidn::new(threads)?;
        let pixels = size.0 as usize * size.1 as usize;
        let gray = vec![Rgb::splat(0.5); pixels];
        let guides = Guides { albedo: gray.clone(), normal: gray.clone(), clean: true };
        let mut timed = || {
            let start = Instant::now();
            oidn.denoise(size, &gray, &guides).map(|_| start.elapsed())
        };
        // The first run also reads the library's weights.
        let (first, run) = (timed()?, timed()?);
        let most = |time: Duration| time.mul_f64(DENOISE_SHARE).div_duration_f64(run) as usize;
        let parts = time.map_or(DENOISE_FOLDS, |time| fitting(most(time).saturating_sub(1)));
        Ok(Self {
            oidn: Mutex::new(oidn),
            size,
            parts,
            is_timed: time.is_some(),
            run,
            time: first + run,
            next_check: Duration::ZERO,
            latest: None,
            iterations: 0,
            promise: None,
            failure: None,
        })
    }

    /// Time that denoising at the end takes, about.
    pub fn reserve(&self) -> Duration {
        self.run * (self.parts as u32 + 1)
    }

    /// Denoises the image, with its error if there is time for that, unless that is what was done last.
    pub fn denoise(&mut self, renderer: &Renderer, image: &CombinedImage) -> Result<()> {
        let iterations = image.iterations();
        if self.latest.is_none() || iterations != self.iterations {
            self.latest = Some(self.once(renderer, image, self.parts)?);
            self.iterations = iterations;
        }
        Ok(())
    }

    /// The same without its error.
    pub fn preview(&mut self, renderer: &Renderer, image: &CombinedImage) -> Result<Denoised> {
        self.once(renderer, image, 0)
    }

    fn once(
        &mut self,
        renderer: &Renderer,
        image: &CombinedImage,
        parts: usize,
    ) -> Result<Denoised> {
        let start = Instant::now();
        let size = self.size;
        let oidn = self.oidn.get_mut().unwrap_or_else(PoisonError::into_inner);
        let run = |radiance: &[Rgb], guides: &Guides| oidn.denoise(size, radiance, guides);
        // Where guides have to be denoised as well, as many parts as take no longer; unless time does not matter.
        let fewer = if self.is_timed { fitting(parts / NOISY) } else { parts };
        let parts = |clean: bool| if clean { parts } else { fewer };
        let denoised = denoise(image, renderer.shared().features.as_ref(), parts, run);
        self.time += start.elapsed();
        denoised
    }

    /// What is known of the whole image's error.
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

    /// Whether the error is to be found now, after so much time: for a target now and then, for a time once.
    pub fn is_due(&self, elapsed: Duration, iterations: u64, stop: &Stop) -> bool {
        if self.parts == 0 || iterations < LEAST_PER_PART * self.parts as u64 {
            return false;
        }
        let promises = stop.time.is_some_and(|time| {
            self.promise.is_none()
                && elapsed >= time.mul_f64(DENOISE_PROMISE_AFTER)
                && self.reserve() <= time.mul_f64(DENOISE_PROMISE_SHARE)
        });
        let cost = self.reserve().div_f64(CHECK_SHARE);
        promises || stop.error.is_some() && elapsed >= self.next_check.max(cost)
    }

    /// Tells, of an error that was just found, whether it is small enough; plans the next time to find it, and promises.
    pub fn reaches(&mut self, elapsed: Duration, stop: &Stop) -> bool {
        let Some(error) = self.error().copied() else { return false };
        if let (Some(time), None) = (stop.time, self.promise) {
            let left = elapsed.as_secs_f64() / time.as_secs_f64().max(elapsed.as_secs_f64());
            let squared = error.squared.max(0.0) * left.powf(DENOISED_FALL) + stop.bias2;
            let said_after = elapsed.as_secs_f64();
            self.promise = Some(DenoisedPromise { error: squared.sqrt(), said_after });
        }
        let Some(wanted) = stop.error else { return false };
        let over = error.bound(UPPER_BOUND) / stop.noise2(wanted);
        let growth = over.powf(DENOISED_FALL.recip()).clamp(CHECK_GROWTH.start, CHECK_GROWTH.end);
        let pause = self.reserve().div_f64(CHECK_SHARE);
        self.next_check = (elapsed + pause).max(elapsed.mul_f64(growth));
        over <= 1.0
    }
}

/// Runs of the denoiser that denoising guides makes of one.
const NOISY: usize = 3;

/// The most parts up to so many that tell an error.
fn fitting(most: usize) -> usize {
    [DENOISE_FOLDS, DENOISE_FOLDS / 2].into_iter().find(|parts| *parts <= most).unwrap_or(0)
}
