//! Denoising in a job: when the denoiser runs, the time that is reserved for it, and the error of
//! its result.

mod effort;
mod report;

pub use report::{DenoisedPromise, DenoisedReport};

use crate::output::denoise::{
    Denoised, ErrorSummary, Guides, Oidn, Quality, Validation, Window, denoise, guides,
};
use bdpm_auto::adaptive::error_interval::{ErrorInterval, SquaredPart};
use bdpm_auto::adaptive::stopping::Stop;
use bdpm_auto::adaptive::technique::LEAST_DENOISED_NOISE;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::noise::merge_bias::UPPER_BOUND;
use bdpm_core::render::Renderer;
use bdpm_core::render::block::CombinedImage;
use effort::{Effort, FULL};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Maximum share of the given time for all runs of the denoiser.
const DENOISE_SHARE: f64 = 0.12;

/// Maximum side of the image with which the time of the denoiser is measured, pixels.
const TIMED_SIDE: u32 = 128;

/// Factor by which the time of a run may exceed that of the small image per pixel.
const TIME_MARGIN: f64 = 1.5;

/// Pixels of an image from which on the denoiser divides it into parts that overlap, and the factor
/// on the time of a pixel: 1.29 us at 3840x2160 and .61 us at 1920x1080 on two cores.
const DIVIDED_PIXELS: f64 = 4e6;
const DIVIDED_FACTOR: f64 = 2.0;

/// Minimum number of iterations per fold before the error of a denoised image is estimated during
/// the render.
const MIN_ITERATIONS_PER_FOLD: u64 = 2;

/// Share of the time that estimating the error for a target may take during the render.
const CHECK_SHARE: f64 = 0.04;

/// Minimum of the time that rendering without the denoiser would still take to a target, as a
/// factor of the time of a check.
const MIN_SAVING: f64 = 3.0;

/// Range of the ratio between the rendering times of two estimates of the error, within which it
/// follows the expected decrease of the error.
const CHECK_GROWTH: Range<f64> = 1.1..2.0;

/// Maximum share of the raw image's squared error at the end that the denoised image is expected to
/// have. Denoising is given up above it.
const MAX_EXPECTED_SHARE: f64 = 0.85;

/// Assumed power of the time with which the squared error of denoised images decreases. It is below
/// 1, the power of noise, since the denoiser's bias decreases later. Only the next check and
/// promises depend on it.
pub const DENOISED_DECAY: f64 = 0.7;

/// Share of the given time after which the error at its end is promised.
const PROMISE_AFTER: f64 = 0.25;

/// Maximum share of the given time for all runs of the denoiser where less leaves the error of the
/// denoised image unknown: short renders of large images.
const SHORT_RENDER_SHARE: f64 = 0.25;

/// Minimum relative RMS noise that the pilot predicts for the end, above which a denoised image of
/// unknown error pays. A less noisy raw image would be the result anyway.
const MIN_NOISE_FOR_UNKNOWN_ERROR: f64 = 0.1;

/// Maximum time of denoising the final image after an interrupt. Systems that shut down and
/// schedulers kill programs 10 s or more after they asked them to end.
const AFTER_INTERRUPT: Duration = Duration::from_secs(5);

/// The denoiser and its latest result.
pub struct Denoising {
    /// Locked by one thread at a time. Pages read the other fields from several threads.
    oidn: Mutex<Oidn>,
    size: (u32, u32),
    effort: Effort,
    /// Time of a pixel of a small image in a run of [`Quality::Fast`], seconds.
    pixel_time: f64,
    /// Time of a run of [`Quality::Fast`] on the whole image.
    run_time: Duration,
    /// Time of the runs at the end, which is reserved from the given time.
    reserve: Duration,
    interrupt: Arc<AtomicBool>,
    /// True if an interrupt ended or prevented the denoising of the final image.
    is_interrupted: bool,
    /// True if the estimate at a part of the time showed that denoising does not pay.
    is_given_up: bool,
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
}

impl Denoising {
    /// Loads the denoiser and measures the time of a run on a small image. `stop` decides the
    /// effort: the best one whose time is at most 12 % of a given time, or 25 % if less leaves the
    /// error unknown. If not even that suffices, it is a single run, whatever its time. `interrupt`
    /// ends runs of the denoiser.
    pub fn new(
        threads: usize,
        size: (u32, u32),
        stop: &Stop,
        interrupt: Arc<AtomicBool>,
    ) -> Result<Self> {
        let start = Instant::now();
        let mut oidn = Oidn::new(threads)?.interrupted_by(Arc::clone(&interrupt));
        oidn.set_quality(Quality::Fast);
        let small = (size.0.min(TIMED_SIDE), size.1.min(TIMED_SIDE));
        let small_pixels = small.0 as usize * small.1 as usize;
        let gray = vec![Rgb::splat(0.5); small_pixels];
        let guides = Guides { albedo: gray.clone(), normal: gray.clone(), clean: true };
        let mut timed_run = || {
            let start = Instant::now();
            let denoised = oidn.denoise(small, &gray, &guides);
            denoised.map(|_| start.elapsed()).map_err(|error| match error.is_interrupt() {
                true => Error::interrupted(), // There is no image yet.
                false => error,
            })
        };
        // The first run also reads the library's weights.
        timed_run()?;
        let pixel_time = timed_run()?.min(timed_run()?).as_secs_f64() / small_pixels as f64;
        let new = Self {
            oidn: Mutex::new(oidn),
            size,
            effort: FULL,
            pixel_time,
            run_time: Duration::ZERO,
            reserve: Duration::ZERO,
            interrupt,
            is_interrupted: false,
            is_given_up: false,
            time: start.elapsed(),
            next_check: Duration::ZERO,
            latest: None,
            iterations: 0,
            promise: None,
        };
        Ok(new.for_size(size, stop))
    }

    /// The same denoiser for an image of this `size`.
    pub fn for_size(mut self, size: (u32, u32), stop: &Stop) -> Self {
        let pixels = f64::from(size.0) * f64::from(size.1);
        let factor = if pixels > DIVIDED_PIXELS { DIVIDED_FACTOR } else { 1.0 };
        let run_time = Duration::from_secs_f64(TIME_MARGIN * factor * pixels * self.pixel_time);
        let effort = match stop.time {
            Some(limit) => {
                let within = |share: f64| {
                    let allowed = limit.mul_f64(share).saturating_sub(self.time);
                    Effort::within(allowed.div_duration_f64(run_time), pixels)
                };
                let with_error = within(DENOISE_SHARE).filter(|effort| effort.folds > 0);
                let most = with_error.or_else(|| within(SHORT_RENDER_SHARE));
                // A short noisy render needs the denoiser more than any other.
                most.unwrap_or(Effort::single(pixels))
            }
            None if stop.error.is_some() => Effort::of_check(pixels),
            None => FULL,
        };
        let oidn = self.oidn.get_mut().unwrap_or_else(PoisonError::into_inner);
        oidn.set_quality(effort.quality);
        let reserve = run_time.mul_f64(effort.runs(pixels));
        Self { size, effort, run_time, reserve, ..self }
    }

    /// Time of a pixel in a run of [`Quality::Fast`], seconds.
    pub fn pixel_time(&self) -> f64 {
        TIME_MARGIN * self.pixel_time
    }

    /// Returns true if denoising can pay at this relative RMS noise, which is predicted for the end
    /// of a given time.
    pub fn can_pay(&self, noise: f64) -> bool {
        let is_error_known = self.effort.folds > 0;
        noise >= if is_error_known { LEAST_DENOISED_NOISE } else { MIN_NOISE_FOR_UNKNOWN_ERROR }
    }

    /// Approximate time of denoising the final image with its error; 0 once denoising is given up.
    pub fn reserve(&self) -> Duration {
        if self.is_given_up { Duration::ZERO } else { self.reserve }
    }

    /// Denoises the image, with its error if there is time for that. Keeps the latest result if the
    /// image has no new iterations. Does nothing once denoising is given up.
    ///
    /// An interrupt during the run gives up denoising: the raw image is there at once. After an
    /// earlier interrupt the run has 5 seconds, with the effort that fits in them.
    pub fn denoise(&mut self, renderer: &Renderer, image: &CombinedImage) -> Result<()> {
        let iterations = image.iterations();
        if self.is_given_up || self.latest.is_some() && iterations == self.iterations {
            return Ok(());
        }
        let was_interrupted = self.interrupt.load(Ordering::Relaxed);
        let end = was_interrupted.then(|| Instant::now() + AFTER_INTERRUPT);
        let effort =
            if was_interrupted { self.effort_after_interrupt() } else { Some(self.effort) };
        let denoised = effort.map(|effort| self.run(renderer, image, effort, end)).transpose();
        match denoised {
            Ok(Some(denoised)) => {
                self.latest = Some(denoised);
                self.iterations = iterations;
            }
            Err(error) if !error.is_interrupt() => return Err(error),
            _ => {
                self.is_interrupted = true;
                self.give_up();
            }
        }
        Ok(())
    }

    /// The effort that fits in the time after an interrupt; `None` if there is none.
    fn effort_after_interrupt(&self) -> Option<Effort> {
        if self.reserve <= AFTER_INTERRUPT {
            return Some(self.effort);
        }
        let pixels = f64::from(self.size.0) * f64::from(self.size.1);
        Effort::within(AFTER_INTERRUPT.div_duration_f64(self.run_time), pixels)
    }

    /// Gives up denoising: the raw image is the result.
    pub fn give_up(&mut self) {
        self.is_given_up = true;
        self.latest = None;
    }

    /// Denoises the image without its error.
    pub fn preview(&mut self, renderer: &Renderer, image: &CombinedImage) -> Result<Denoised> {
        self.run(renderer, image, Effort { folds: 0, ..self.effort }, None)
    }

    /// Runs the denoiser, which ignores an interrupt until `end`.
    fn run(
        &mut self,
        renderer: &Renderer,
        image: &CombinedImage,
        effort: Effort,
        end: Option<Instant>,
    ) -> Result<Denoised> {
        let start = Instant::now();
        let size = self.size;
        let oidn = self.oidn.get_mut().unwrap_or_else(PoisonError::into_inner);
        oidn.set_quality(effort.quality);
        oidn.run_until(end);
        let mut guides = guides(image, renderer.shared().features.as_ref());
        if effort.prefilter {
            guides = oidn.prefilter(size, guides)?;
        }
        let seed = renderer.settings().seed;
        let validation = Validation { folds: effort.folds, tiles: effort.tiles, seed };
        let whole = Window::whole(size);
        let denoised = denoise(image, validation, |window, radiance| {
            if window == whole {
                return oidn.denoise(size, radiance, &guides);
            }
            oidn.denoise(window.size(), radiance, &guides.crop(window, size.0))
        });
        self.time += start.elapsed();
        denoised
    }

    /// The estimated error of the whole image.
    pub fn error(&self) -> Option<&ErrorSummary> {
        self.latest.as_ref()?.error.as_ref().map(|error| &error.whole)
    }

    /// The error of the latest denoised image, for reports. `bias` is the squared merge bias.
    pub fn report(&self, bias: SquaredPart) -> DenoisedReport {
        let error = self.error().copied();
        let interval = error.map(|error| {
            let value = error.squared.max(0.0);
            let noise = SquaredPart { value, deviation: error.standard_error };
            ErrorInterval::new(noise, bias, false)
        });
        let total = |error: ErrorSummary| (error.stated() + bias.value).sqrt();
        DenoisedReport {
            relative_error: error.map(|error| error.relative()),
            total_error: error.map(total),
            interval,
            error,
            promise: self.promise,
            is_raw: self.is_given_up || self.latest.as_ref().is_some_and(|latest| latest.is_raw),
            is_interrupted: self.is_interrupted,
            seconds: self.time.as_secs_f64(),
        }
    }

    /// Returns true if the error should be estimated after this rendering time: repeatedly for a
    /// target, once for the promise of a given time. `remaining` is the forecast of the time to the
    /// target without the denoiser, if it is known.
    pub fn is_due(
        &self,
        elapsed: Duration,
        iterations: u64,
        stop: &Stop,
        remaining: Option<Duration>,
    ) -> bool {
        let folds = self.effort.folds as u64;
        if self.is_given_up || folds == 0 || iterations < MIN_ITERATIONS_PER_FOLD * folds {
            return false;
        }
        let is_promise_due = stop.time.is_some_and(|time| {
            self.promise.is_none()
                && elapsed >= time.mul_f64(PROMISE_AFTER)
                && self.time + 2 * self.reserve <= time.mul_f64(DENOISE_SHARE)
        });
        let is_check_due = stop.error.is_some()
            && elapsed >= self.next_check.max(self.reserve.div_f64(CHECK_SHARE))
            && remaining.is_some_and(|remaining| remaining > self.reserve.mul_f64(MIN_SAVING));
        is_promise_due || is_check_due
    }

    /// Uses an error that was just estimated: makes the promise, plans the next estimate, and
    /// returns true if the error is small enough to stop. Gives up denoising if it is not expected
    /// to pay at the end of a given time.
    pub fn check_target(&mut self, elapsed: Duration, stop: &Stop) -> bool {
        let Some(error) = self.error().copied() else { return false };
        if let (Some(time), None) = (stop.time, self.promise) {
            let left = elapsed.as_secs_f64() / time.as_secs_f64().max(elapsed.as_secs_f64());
            let squared = error.stated() * left.powf(DENOISED_DECAY);
            let said_after = elapsed.as_secs_f64();
            if squared > MAX_EXPECTED_SHARE * error.raw * left {
                self.give_up();
                return false;
            }
            self.promise =
                Some(DenoisedPromise { error: (squared + stop.bias2).sqrt(), said_after });
        }
        let Some(target) = stop.error else { return false };
        let excess = error.bound(UPPER_BOUND) / stop.noise2(target);
        let growth =
            excess.powf(DENOISED_DECAY.recip()).clamp(CHECK_GROWTH.start, CHECK_GROWTH.end);
        let pause = self.reserve.div_f64(CHECK_SHARE);
        self.next_check = (elapsed + pause).max(elapsed.mul_f64(growth));
        excess <= 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::effort::FAST;
    use super::*;
    use crate::output::denoise::DenoisedError;

    fn timed(time: Duration) -> Denoising {
        Denoising::new(2, (40, 30), &Stop::time(time), Arc::default()).unwrap()
    }

    #[test]
    fn denoising_is_a_single_run_in_a_time_that_it_would_exceed() {
        let short = timed(Duration::from_millis(1));
        assert_eq!(short.effort, Effort { folds: 0, ..FAST });
        assert!(short.reserve() > Duration::from_millis(1));
        let denoising = timed(Duration::from_secs(3600));
        assert_eq!(denoising.effort, FAST);
        assert!(denoising.time + denoising.reserve() <= Duration::from_secs(432));
    }

    #[test]
    fn effort_after_an_interrupt_fits_in_its_time() {
        let mut denoising = timed(Duration::from_secs(3600));
        assert_eq!(denoising.effort_after_interrupt(), Some(denoising.effort));
        let pixels = 40.0 * 30.0;
        for (seconds, folds) in [(0.6, Some(4)), (1.6, Some(2)), (4.0, Some(0)), (6.0, None)] {
            denoising.run_time = Duration::from_secs_f64(seconds);
            denoising.reserve = denoising.run_time.mul_f64(FULL.runs(pixels));
            let effort = denoising.effort_after_interrupt();
            assert_eq!(effort.map(|effort| effort.folds), folds, "{seconds} s");
        }
    }

    #[test]
    fn interrupt_before_the_first_run_is_an_interrupt_of_the_job() {
        let interrupt = Arc::new(AtomicBool::new(true));
        let stop = Stop::time(Duration::from_secs(3600));
        let error = Denoising::new(2, (40, 30), &stop, interrupt).err().unwrap();
        assert!(error.is_interrupt() && error.to_string().contains("no image"), "{error}");
    }

    #[test]
    fn denoising_is_given_up_if_the_raw_image_will_be_about_as_good() {
        for (squared, is_given_up) in [(0.9e-3, true), (0.2e-3, false)] {
            let mut denoising = timed(Duration::from_secs(100));
            let whole = ErrorSummary {
                squared,
                standard_error: 1e-5,
                unmixed: squared,
                unmixed_error: 1e-5,
                raw: 1e-3,
                raw_share: 0.0,
                worse: 0.0,
                folds: 8,
                tiles: None,
            };
            let error = DenoisedError { whole, map: Vec::new(), raw_share: Vec::new() };
            let image = Vec::new();
            denoising.latest = Some(Denoised { image, error: Some(error), is_raw: false });
            let stop = Stop::time(Duration::from_secs(100));
            assert!(!denoising.check_target(Duration::from_secs(25), &stop));
            assert_eq!(denoising.promise.is_none(), is_given_up);
            assert_eq!(denoising.latest.is_none(), is_given_up);
            assert_eq!(denoising.reserve().is_zero(), is_given_up);
        }
    }
}
