//! The best counts of a technique for a time or an error, and what they lead to.

use super::census::Surfaces;
use super::trial::Trial;
use super::{Candidate, End, FreeParameters, Technique};
use crate::noise::Coefficients;
use crate::render::bias_correction::shrinkage;
use crate::settings::Settings;
use crate::settings::policy::*;
use crate::timing::TimeModel;
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;

use std::array::from_fn;

const EVERY: usize = PhotonClass::Caustic as usize;
const LAST: usize = PhotonClass::Diffuse as usize;

/// What is asked for.
pub struct CandidateCost {
    /// A time is that of all processes together.
    pub end: End,
    /// How many these are.
    pub ranks: u32,
    pub most_light_paths: u32,
    pub open: FreeParameters,
    /// Whether bias is taken off where it stands out from the noise.
    pub reduces: bool,
    /// Radii that were asked for.
    pub wished: ByClass<f32>,
}

/// What merging with a class of photons adds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Merged {
    /// Squared relative bias at the radius, and its standard error.
    pub bias2: f64,
    pub error: f64,
    /// What of the bias is left at half the radius, over that beyond it.
    pub left: f64,
    /// Coefficients `a` and `f` of what photons beyond half the radius bring, relative.
    pub outer: Coefficients,
}

/// The best radii and counts of a technique, and what they lead to.
#[derive(Clone, Copy, Debug)]
pub struct Best {
    pub radii: ByClass<f64>,
    light_paths: f64,
    camera_paths: u32,
    seconds: f64,
    noise2: f64,
    bias2: f64,
    bias2_error: f64,
    times: TimeModel,
    pub tried: bool,
}

impl CandidateCost {
    /// Share of the time that areas take before they are known, at some reach, about.
    pub fn share(&self, trial: &Trial, weights: &[f64], surfaces: &Surfaces, reach: f64) -> f64 {
        let Best { light_paths, camera_paths, seconds, times, .. } =
            self.noise(trial, weights, &Surfaces::default());
        let camera_paths = f64::from(camera_paths);
        let visits = camera_paths * seconds / times.iteration(light_paths, camera_paths);
        surfaces.cost(reach, visits) / seconds
    }

    fn noise(&self, trial: &Trial, weights: &[f64], surfaces: &Surfaces) -> Best {
        let coefficients = trial.relative(weights);
        let none = <ByClass<Merged>>::default();
        self.evaluate(&coefficients, &trial.times, none, trial.radii, surfaces)
    }

    /// The best counts: theory.md (93c), at the camera paths of [`CAMERA_STEPS`].
    pub fn evaluate(
        &self,
        coefficients: &Coefficients,
        times: &TimeModel,
        merged: ByClass<Merged>,
        radii: ByClass<f64>,
        surfaces: &Surfaces,
    ) -> Best {
        let reach = radii[EVERY].max(radii[LAST]);
        let Coefficients { a, b, f } = coefficients.clamped();
        let mut best: Option<Best> = None;
        for camera_paths in CAMERA_STEPS {
            let n_camera = f64::from(camera_paths);
            let [base, per_light_path] = times.in_light_paths(n_camera);
            let (camera, light) = (b / n_camera, a / n_camera + f);
            let longest = match self.end {
                End::Time(time) => time / least_iterations_after_choice(self.ranks),
                End::Error(_) => f64::INFINITY,
            };
            if base > longest && best.is_some() {
                break;
            }
            let allowed = ((longest - base) / per_light_path).max(base / per_light_path);
            let optimum = (base * light / (per_light_path * camera)).sqrt();
            let most = f64::from(self.most_light_paths).min(allowed);
            let light_paths = if optimum.is_nan() { 2.0 } else { optimum.min(most).max(2.0) };
            let tau = base + per_light_path * light_paths;
            // theory.md (93f)
            let first = |seconds: f64| surfaces.cost(reach, n_camera * seconds / tau);
            let variance = camera + light / light_paths;
            // Squared noise and bias where the variance of an iteration is left to such a share.
            let left_at = |share: f64| {
                let parts: ByClass<[f64; 2]> = from_fn(|class| {
                    let merged = &merged[class];
                    let Coefficients { a, f, .. } = merged.outer;
                    self.reduced(merged, share * (a / n_camera + f) / light_paths)
                });
                let [noise2, bias2] = [0, 1].map(|at| parts[0][at] + parts[1][at]);
                [share * variance + noise2, bias2]
            };
            let (seconds, [noise2, bias2]) = match self.end {
                End::Time(time) => {
                    let least = LEAST_TIME_SHARE * time;
                    let left = (time - first(time)).max(least);
                    (time, left_at(tau / (time - first(left)).max(least)))
                }
                End::Error(error) => {
                    let share = share_for(error * error, &left_at);
                    let share = share.max(LEAST_NOISE_SHARE * error * error / variance);
                    // theory.md (91)
                    let known = (tau / share).max(LEAST_ITERATIONS_TO_TARGET as f64 * tau);
                    (known + first(known), left_at(share))
                }
            };
            let own = Best {
                radii,
                light_paths,
                camera_paths,
                seconds,
                noise2,
                bias2,
                bias2_error: merged.iter().map(|m| m.error * m.error).sum::<f64>().sqrt(),
                times: *times,
                tried: false,
            };
            if best.is_none_or(|best| own.rank(self) < best.rank(self)) {
                best = Some(own);
            }
        }
        best.expect("there is a step")
    }

    /// The noise that is added and the bias that is left of a class of photons, whose bias beyond half the radius has
    /// this variance: theory.md (71f).
    fn reduced(&self, &Merged { bias2, left, .. }: &Merged, variance: f64) -> [f64; 2] {
        if !self.reduces {
            return [0.0, bias2];
        }
        let beyond = bias2 / (1.0 + left).powi(2);
        let share = shrinkage(beyond / BIASED_PIXELS, variance);
        [BIASED_PIXELS * share * share * variance, (1.0 - share + left).powi(2) * beyond]
    }
}

/// The share of the variance of an iteration at which squared noise and bias come to so much; 0 where the bias alone is
/// more.
fn share_for(error2: f64, left: &impl Fn(f64) -> [f64; 2]) -> f64 {
    let total = |share: f64| left(share).iter().sum::<f64>();
    let (mut low, mut high) = (0.0, 1.0);
    if total(low) > error2 {
        return low;
    }
    while total(high) < error2 && high < 1e12 {
        high *= 4.0;
    }
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if total(middle) < error2 {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

impl Best {
    /// The less, the better.
    pub fn rank(&self, demand: &CandidateCost) -> f64 {
        match demand.end {
            End::Time(_) => self.noise2 + self.bias2,
            // Where the bias alone is too much, the less of it, the better.
            End::Error(error) => self.seconds * (self.bias2 / (error * error)).max(1.0).powi(4),
        }
    }

    /// What the program tells of it.
    pub fn scored(&self, technique: Technique) -> Candidate {
        let Self { radii, camera_paths, seconds, noise2, bias2, bias2_error, times, tried, .. } =
            *self;
        Candidate {
            technique,
            radius: radii[LAST] as f32,
            caustic_radius: radii[EVERY] as f32,
            light_paths: self.light_paths.round() as u32,
            camera_paths,
            seconds,
            error: (noise2 + bias2).sqrt(),
            noise: noise2.sqrt(),
            bias: bias2.sqrt(),
            bias2_error,
            times,
            tried,
        }
    }

    /// The settings of a trial there.
    pub fn settings(&self, settings: &Settings, technique: Technique) -> Settings {
        self.scored(technique).apply(settings)
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    pub fn times() -> TimeModel {
        let (light_path, camera_path, look_up, merge_pair) = (2e-7, 5e-7, 1e-8, 1e-12);
        TimeModel { fixed: 1e-4, light_path, camera_path, look_up, merge_pair, pixels: 1e4 }
    }

    pub fn demand(end: End) -> CandidateCost {
        let open = FreeParameters::ALL;
        CandidateCost {
            end,
            ranks: 1,
            most_light_paths: 1 << 24,
            open,
            reduces: false,
            wished: [1.0; 2],
        }
    }

    #[test]
    fn counts_are_the_best_of_all_that_are_tried() {
        let coefficients = Coefficients { a: 2e4, b: 0.04, f: 1e4 };
        let none = Surfaces::default();
        let mut merged = <ByClass<Merged>>::default();
        merged[LAST].bias2 = 1e-5;
        let at = |end| demand(end).evaluate(&coefficients, &times(), merged, [1.0; 2], &none);
        let best = at(End::Time(100.0));
        let mut least = f64::INFINITY;
        for n_camera in CAMERA_STEPS {
            for step in 0..400 {
                let n_light = 10.0 * 1.04f64.powi(step);
                let tau = times().iteration(n_light, f64::from(n_camera));
                if tau <= 100.0 / LEAST_ITERATIONS_AFTER_CHOICE {
                    let cost = tau * coefficients.variance(n_light, f64::from(n_camera));
                    least = least.min(cost / 100.0);
                }
            }
        }
        assert!(
            (best.noise2 / least - 1.0).abs() < 2e-3 && best.noise2 <= least,
            "{best:?} {least}"
        );
        // The time to the error that this time leads to is this time.
        let error = (best.noise2 + best.bias2).sqrt();
        let back = at(End::Error(error));
        assert!(back.seconds <= 100.0 * (1.0 + 1e-9) && back.seconds > 95.0, "{back:?}");
    }
}
