//! Finds the best counts of a technique at given radii, and predicts the error or time they lead
//! to.

use super::start_up::StartUp;
use super::{Candidate, End, FreeParameters, Technique};
use crate::adaptive::count_choice::{least_light_paths, min_iterations_after_choice};
use crate::adaptive::stopping::{MIN_ITERATIONS_TO_TARGET, MIN_NOISE_SHARE};
use crate::bisect::bisect;
use crate::timing::TimeModel;
use bdpm_core::noise::Coefficients;
use bdpm_core::render::bias_correction::shrinkage_of_photons;
use bdpm_core::settings::Strategy;
use bdpm_core::transport::kernel::ByClass;

/// Camera paths per pixel that are compared: steps of at most a factor of 2, which costs 5 % of the
/// time at most (docs/measurements/optimum.md), up to counts that only very long renders can use.
pub const CAMERA_STEPS: [u32; 15] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192];

/// Share of the pixels, by their weight, that are taken to have the merge bias. Correcting the bias
/// adds noise to these pixels alone. Fixed by trial.
const BIASED_PIXELS: f64 = 0.15;

/// Iterations below which the error of an image is hardly known, and an image ends early or takes
/// longer than its time. Candidates with fewer are chosen only if their squared error is less by
/// the fourth power of what is missing: large images in a short time, whose first iteration
/// computes all areas.
const MIN_KNOWN_ITERATIONS: f64 = 2.0;

/// Standard errors of the squared bias that count in addition. Fixed by trial: with none,
/// `scenes/point-caustic` has 1.8 times the squared error, and with 1 `scenes/daylight` has 1.4
/// times.
const CAUTION: f64 = 0.3;

/// Goal of the render, and the limits of the choice.
#[derive(Clone, Copy, Debug)]
pub struct CandidateCost {
    /// Strategy of the candidate.
    pub strategy: Strategy,
    /// Time of all processes together, or the error to reach.
    pub end: End,
    /// Number of processes that share the iterations.
    pub ranks: u32,
    /// Light paths of an iteration that the memory allows.
    pub max_light_paths: u32,
    /// Light paths of an iteration; `None` for the best number.
    pub light_paths: Option<f64>,
    /// Settings that the pilot may choose.
    pub open: FreeParameters,
    /// Whether the merge bias is corrected where it stands out from the noise.
    pub corrects_bias: bool,
    /// Merge radii of the settings, scene units.
    pub requested: ByClass<f32>,
    /// Merges in media of the settings.
    pub in_media: InMedia,
    /// The image is denoised: what counts is the noise that is left.
    pub denoises: bool,
}

/// Merges in media.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InMedia {
    /// Merge radii over those at surfaces.
    pub scale: f64,
    /// Share of the merges that are done.
    pub share: f64,
}

/// Merge bias of a class of photons at one radius, and the noise that correcting it would add.
#[derive(Clone, Copy, Debug, Default)]
pub struct ClassBias {
    /// Squared relative bias at the radius.
    pub square: f64,
    /// Standard error of `square`.
    pub error: f64,
    /// Bias that is left at half the radius, over the bias of the outer annulus.
    pub left: f64,
    /// Coefficients `a` and `f` of the contribution of photons in the outer annulus, relative.
    pub outer: Coefficients,
}

/// Time of an image at some radii.
#[derive(Clone, Copy, Debug)]
pub struct RenderTime {
    /// Times of an iteration.
    pub times: TimeModel,
    /// Time to compute these areas; `None` without areas.
    pub start_up: Option<StartUp>,
}

/// The best counts of a technique at some radii, and the error and time that they lead to.
#[derive(Clone, Copy, Debug)]
pub struct Best {
    /// Merge radii, scene units.
    pub radii: ByClass<f64>,
    /// Merges in media.
    pub in_media: InMedia,
    pub(super) light_paths: f64,
    pub(super) camera_paths: u32,
    /// Iterations after all areas around gather points are known.
    pub(super) iterations: f64,
    pub(super) seconds: f64,
    pub(super) noise2: f64,
    pub(super) bias2: f64,
    pub(super) bias2_error: f64,
    pub(super) times: TimeModel,
    /// Relative coefficients of the image, before it is denoised.
    pub(super) coefficients: Coefficients,
    /// Variance before denoising over `noise2`.
    pub(super) before_denoising: f64,
    /// Factor on `noise2` where candidates are compared.
    pub(super) seen: f64,
    /// Whether a trial has measured the technique at these radii.
    pub tried: bool,
}

impl CandidateCost {
    /// The best counts: theory.md (93c), at the camera paths of [`CAMERA_STEPS`].
    pub fn evaluate(
        &self,
        coefficients: &Coefficients,
        time: &RenderTime,
        merged: &ByClass<ClassBias>,
        radii: ByClass<f64>,
    ) -> Best {
        let is_short = |n_camera: &u32| {
            *n_camera == CAMERA_STEPS[0]
                || time.times.in_light_paths(f64::from(*n_camera))[0] <= self.longest_iteration()
        };
        let steps = CAMERA_STEPS.into_iter().take_while(is_short);
        let all = steps.map(|n_camera| self.evaluate_at(n_camera, coefficients, time, merged));
        let best =
            all.reduce(|best, own| if own.rank(self) < best.rank(self) { own } else { best });
        Best { radii, ..best.expect("there is a step") }
    }

    /// The best number of light paths at so many camera paths per pixel.
    fn evaluate_at(
        &self,
        camera_paths: u32,
        coefficients: &Coefficients,
        RenderTime { times, start_up }: &RenderTime,
        merged: &ByClass<ClassBias>,
    ) -> Best {
        let Coefficients { a, b, f } = coefficients.clamped();
        let n_camera = f64::from(camera_paths);
        let (camera, light) = (b / n_camera, a / n_camera + f);
        let light_paths = self.light_paths(times, n_camera, [camera, light]);
        let tau = times.iteration(light_paths, n_camera);
        let variance = camera + light / light_paths;
        // Noise and bias after the variance of one iteration has fallen to this share of it.
        let error_at = |share: f64| {
            let of_class = |own: &ClassBias| {
                self.corrected(own, share * own.outer.variance(light_paths, n_camera))
            };
            merged
                .iter()
                .map(of_class)
                .fold([share * variance, 0.0], |sum, own| [sum[0] + own[0], sum[1] + own[1]])
        };
        // Each process computes the areas that its own camera paths need.
        let start_up = |seconds: f64| {
            let ranks = f64::from(self.ranks);
            let camera_paths = n_camera * times.pixels * seconds / (tau * ranks);
            start_up.map_or(0.0, |own| ranks * own.seconds(camera_paths))
        };
        let (iterations, seconds, [noise2, bias2]) =
            self.time_and_error(tau, variance, start_up, error_at);
        Best {
            radii: [0.0; 2],
            in_media: self.in_media,
            light_paths,
            camera_paths,
            iterations,
            seconds,
            noise2,
            bias2,
            bias2_error: merged.iter().map(|m| m.error * m.error).sum::<f64>().sqrt(),
            times: *times,
            coefficients: *coefficients,
            before_denoising: 1.0,
            seen: 1.0,
            tried: false,
        }
    }

    /// Maximum time of an iteration, seconds.
    fn longest_iteration(&self) -> f64 {
        match self.end {
            End::Time(time) => time / min_iterations_after_choice(self.ranks),
            End::Error(_) => f64::INFINITY,
        }
    }

    /// The best number of light paths at this number of camera paths, where an iteration has a
    /// variance without and with light paths. theory.md (93c)
    fn light_paths(&self, times: &TimeModel, n_camera: f64, [camera, light]: [f64; 2]) -> f64 {
        if let Some(known) = self.light_paths {
            return known;
        }
        let ([base, per_light_path], longest) =
            (times.in_light_paths(n_camera), self.longest_iteration());
        let allowed = ((longest - base) / per_light_path).max(base / per_light_path);
        let optimum = (base * light / (per_light_path * camera)).sqrt();
        let most = f64::from(self.max_light_paths).min(allowed);
        // Whether or not trials saw any light of them.
        let least = match self.strategy.shares_light() {
            true => least_light_paths(times, self.strategy.has_cache()),
            false => 0.0,
        };
        let optimum = if optimum.is_nan() { 0.0 } else { optimum };
        optimum.max(least).min(most).max(2.0)
    }

    /// Iterations and seconds to the end, and the error there, from the time of an iteration and
    /// its variance. `start_up` is the part of a time that goes to areas, and `error_at` noise and
    /// bias, squared, after that variance has fallen to a share. theory.md (93k)
    fn time_and_error(
        &self,
        tau: f64,
        variance: f64,
        start_up: impl Fn(f64) -> f64,
        error_at: impl Fn(f64) -> [f64; 2],
    ) -> (f64, f64, [f64; 2]) {
        match self.end {
            End::Time(time) => {
                // An image has at least one iteration.
                let iterating = (time - start_up(time)).max(tau.min(time));
                (iterating / tau, time, error_at(tau / iterating))
            }
            End::Error(error) => {
                let reaches = |share: f64| error_at(share).iter().sum::<f64>() >= error * error;
                let share = bisect([1e-15, 1e12], 1e-9, reaches)[0];
                let share = share.max(MIN_NOISE_SHARE * error * error / variance);
                // theory.md (91)
                let seconds = (tau / share).max(MIN_ITERATIONS_TO_TARGET as f64 * tau);
                (seconds / tau, seconds + start_up(seconds), error_at(share))
            }
        }
    }

    /// Noise that the correction adds, and bias that it leaves, for a class of photons. `variance`
    /// is that of the contribution of the outer annulus: theory.md (71f).
    fn corrected(&self, own: &ClassBias, variance: f64) -> [f64; 2] {
        let ClassBias { square, left, .. } = *own;
        if !self.corrects_bias {
            return [0.0, square];
        }
        let outer = square / (1.0 + left).powi(2);
        let share = shrinkage_of_photons(outer / BIASED_PIXELS, variance);
        [BIASED_PIXELS * share * share * variance, (1.0 - share + left).powi(2) * outer]
    }
}

impl Best {
    /// Cost that the choice minimizes: the squared error after the time, or the time to the error.
    pub fn rank(&self, demand: &CandidateCost) -> f64 {
        match demand.end {
            // The error of too few iterations is not known.
            End::Time(_) => {
                let few = (MIN_KNOWN_ITERATIONS / self.iterations).max(1.0);
                let bias2 = self.bias2 + CAUTION * self.bias2_error;
                (self.seen * self.noise2 + bias2) * few.powi(4)
            }
            // The fourth power prefers less bias where no time is long enough.
            End::Error(error) => self.seconds * (self.bias2 / (error * error)).max(1.0).powi(4),
        }
    }

    /// The same settings where `later` leaves another time than `demand`: the noise falls with the
    /// time.
    pub fn after(&self, demand: &CandidateCost, later: &CandidateCost) -> Self {
        match (demand.end, later.end) {
            (End::Time(before), End::Time(seconds)) => {
                let share = seconds / before;
                let (iterations, noise2) = (self.iterations * share, self.noise2 / share);
                Self { iterations, seconds, noise2, ..*self }
            }
            _ => *self,
        }
    }

    /// The candidate that the program reports.
    pub fn scored(&self, technique: Technique) -> Candidate {
        let [caustic_radius, radius] = self.radii.map(|radius| radius as f32);
        Candidate {
            technique,
            radius,
            caustic_radius,
            medium_scale: self.in_media.scale,
            medium_share: self.in_media.share,
            light_paths: self.light_paths.round() as u32,
            camera_paths: self.camera_paths,
            seconds: self.seconds,
            error: (self.noise2 + self.bias2).sqrt(),
            noise: self.noise2.sqrt(),
            bias: self.bias2.sqrt(),
            bias2_error: self.bias2_error,
            times: self.times,
            tried: self.tried,
        }
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::adaptive::count_choice::MIN_ITERATIONS_AFTER_CHOICE;
    use crate::adaptive::technique::start_up::tests::constant;
    use bdpm_core::settings::{Direct, Kernel};

    /// Merging at vertex 1.
    pub const MERGING: Technique = Technique {
        strategy: Strategy::Single,
        merge_vertex: 1,
        direct: Direct::Connect,
        kernel: Kernel::Area,
        splitting: 1,
        medium_query: None,
    };

    /// Times of an iteration for the tests of this folder.
    pub fn times() -> TimeModel {
        let (light_path, camera_path, look_up, merge_pair) = (2e-7, 5e-7, 1e-8, 1e-12);
        TimeModel { fixed: 1e-4, light_path, camera_path, look_up, merge_pair, pixels: 1e4 }
    }

    /// These times without a start-up.
    pub fn time() -> RenderTime {
        RenderTime { times: times(), start_up: None }
    }

    /// A demand in which everything is open.
    pub fn demand(end: End) -> CandidateCost {
        CandidateCost {
            strategy: Strategy::Single,
            end,
            ranks: 1,
            max_light_paths: 1 << 24,
            light_paths: None,
            open: FreeParameters::ALL,
            corrects_bias: false,
            requested: [1.0; 2],
            in_media: InMedia { scale: 2.0, share: 1.0 },
            denoises: false,
        }
    }

    /// Coefficients of an image for the tests of this folder.
    pub const IMAGE: Coefficients = Coefficients { a: 2e4, b: 0.04, f: 1e4 };

    /// The best counts for that image without a bias, whose start-up takes some seconds.
    fn with_start_up(demand: &CandidateCost, seconds: f64) -> Best {
        let time = RenderTime { start_up: Some(constant(seconds)), ..time() };
        demand.evaluate(&IMAGE, &time, &Default::default(), [1.0; 2])
    }

    #[test]
    fn counts_are_the_best_of_all_steps() {
        let merged = [ClassBias::default(), ClassBias { square: 1e-5, ..ClassBias::default() }];
        let at = |end| demand(end).evaluate(&IMAGE, &time(), &merged, [1.0; 2]);
        let best = at(End::Time(100.0));
        let mut least = f64::INFINITY;
        for n_camera in CAMERA_STEPS {
            for step in 0..400 {
                let n_light = 10.0 * 1.04f64.powi(step);
                let tau = times().iteration(n_light, f64::from(n_camera));
                if tau <= 100.0 / MIN_ITERATIONS_AFTER_CHOICE {
                    let cost = tau * IMAGE.variance(n_light, f64::from(n_camera));
                    least = least.min(cost / 100.0);
                }
            }
        }
        assert!(
            (best.noise2 / least - 1.0).abs() < 2e-3 && best.noise2 <= least,
            "{best:?} {least}"
        );
        // Asking for the error that is reached after 100 s gives back these 100 s.
        let error = (best.noise2 + best.bias2).sqrt();
        let back = at(End::Error(error));
        assert!(back.seconds <= 100.0 * (1.0 + 1e-9) && back.seconds > 95.0, "{back:?}");
    }

    #[test]
    fn too_few_iterations_rank_lower_than_their_error() {
        let demand = demand(End::Time(100.0));
        let with = |seconds: f64| with_start_up(&demand, seconds);
        let many = with(0.0);
        assert!(many.iterations > 2.0 * MIN_KNOWN_ITERATIONS, "{many:?}");
        assert_eq!(many.rank(&demand), many.noise2 + many.bias2);
        let tau = 100.0 / many.iterations;
        // Counts are smaller then, so that there are more iterations.
        let enough = with(100.0 - tau);
        assert!(enough.iterations > 1.5 && enough.light_paths < many.light_paths, "{enough:?}");
        let few = with(100.0 - 0.3 * tau);
        assert!((1.0..MIN_KNOWN_ITERATIONS).contains(&few.iterations), "{few:?}");
        let expected = (few.noise2 + few.bias2) * (MIN_KNOWN_ITERATIONS / few.iterations).powi(4);
        assert!((few.rank(&demand) / expected - 1.0).abs() < 1e-9, "{few:?}");
        // A shorter time has fewer iterations, and more noise.
        let later = CandidateCost { end: End::Time(25.0), ..demand };
        let fewer = many.after(&demand, &later);
        let ratios = [many.iterations / fewer.iterations, fewer.noise2 / many.noise2];
        assert!(ratios.iter().all(|ratio| (ratio - 4.0).abs() < 1e-9), "{ratios:?}");
    }

    #[test]
    fn start_up_leaves_less_time_for_iterations() {
        let with = |end, seconds: f64, ranks| {
            with_start_up(&CandidateCost { ranks, ..demand(end) }, seconds)
        };
        let plain = with(End::Time(100.0), 0.0, 1);
        let quarter = with(End::Time(100.0), 25.0, 1);
        assert!((quarter.noise2 * 0.75 / plain.noise2 - 1.0).abs() < 1e-9, "{quarter:?} {plain:?}");
        // Each of two processes has its own start-up.
        let shared = with(End::Time(100.0), 12.5, 2);
        let alone = with(End::Time(100.0), 0.0, 2);
        assert!((shared.noise2 * 0.75 / alone.noise2 - 1.0).abs() < 1e-9, "{shared:?} {alone:?}");
        // An error is reached later by as much.
        let error = End::Error(plain.noise2.sqrt());
        let [early, late] = [0.0, 25.0].map(|seconds| with(error, seconds, 1).seconds);
        assert!((late - early - 25.0).abs() < 1e-6, "{early} {late}");
        // A start-up beyond the time leaves the noise of an iteration, not less.
        let endless = with(End::Time(100.0), 1e6, 1);
        let tau = times().iteration(endless.light_paths, f64::from(endless.camera_paths));
        let iteration = IMAGE.variance(endless.light_paths, f64::from(endless.camera_paths));
        assert!(tau < 100.0 && (endless.noise2 / iteration - 1.0).abs() < 1e-9, "{endless:?}");
    }
}
