//! Predictions for any counts and for a given time, from measured coefficients.

use super::{CountLimits, MIN_ITERATIONS, Objective, Problem};
use crate::timing::TimeModel;
use bdpm_core::noise::Coefficients;
use bdpm_core::noise::image::{NoiseImage, NoiseSample, Statistic, mean, root};
use bdpm_core::settings::MAX_LIGHT_PATHS;
use serde::Serialize;

/// Coefficients, measured or given.
#[derive(Clone, Copy, Debug)]
pub enum Source<'a> {
    /// Measured, over a region given by its pixels.
    Measured(&'a NoiseImage, &'a [usize]),
    /// Known without uncertainty, as if for a single pixel.
    Given(Coefficients),
}

/// A value and its standard error, if that is known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Predicted {
    /// The value.
    pub value: f64,
    /// Its standard error.
    pub error: Option<f64>,
}

impl Predicted {
    /// The value and its standard error times these factors.
    pub(super) fn scaled(self, scale: f64, error_scale: f64) -> Self {
        Self { value: self.value * scale, error: self.error.map(|error| error * error_scale) }
    }
}

impl From<Predicted> for (f64, Option<f64>) {
    /// Value and standard error.
    fn from(Predicted { value, error }: Predicted) -> Self {
        (value, error)
    }
}

/// The noise at one pair of counts; luminances, W/(m^2 sr).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Prediction {
    /// `N_F`.
    pub light_paths: f64,
    /// `N_B`.
    pub camera_paths: f64,
    /// Pooled RMS of one iteration, `sqrt(mean_p V_p)`.
    pub pooled_rms: Predicted,
    /// Mean RMS of one iteration, `mean_p sqrt(V_p)`: the paper's.
    pub mean_rms: Predicted,
    /// The noise after a rendering time, if one was given.
    pub timed: Option<Timed>,
}

/// The noise after a rendering time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Timed {
    /// Time of one iteration, seconds.
    pub tau: f64,
    /// Iterations in the time, not rounded.
    pub iterations: f64,
    /// Pooled RMS after the time, `sqrt(tau V / T)`.
    pub pooled_rms: Predicted,
    /// Mean RMS after the time.
    pub mean_rms: Predicted,
}

/// The least pooled RMS after a given time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Optimum {
    /// `N_F`, not rounded, with its standard error.
    pub light_paths: Predicted,
    /// `N_B`.
    pub camera_paths: f64,
    /// The noise at these counts.
    pub prediction: Prediction,
}

/// A rendering time, and the time of an iteration.
#[derive(Clone, Copy, Debug)]
pub struct RenderTime {
    /// Time of one iteration.
    pub model: TimeModel,
    /// Rendering time, seconds.
    pub time: f64,
}

impl From<Statistic> for Predicted {
    /// The value as measured; an infinite error is unknown.
    fn from(statistic: Statistic) -> Self {
        let error = statistic.error.is_finite().then_some(statistic.error);
        Self { value: statistic.value, error }
    }
}

impl Source<'_> {
    /// A function of the pixels' coefficients, with its standard error.
    pub fn statistic(&self, of: impl Fn(&[NoiseSample]) -> f64) -> Predicted {
        match self {
            Self::Measured(noise, region) => noise.statistic(region, of).into(),
            Self::Given(coefficients) => {
                let sample = NoiseSample { coefficients: *coefficients, ..NoiseSample::default() };
                Predicted { value: of(&[sample]), error: None }
            }
        }
    }

    /// The noise at `n_light` light paths and `n_camera` camera paths.
    pub fn predict(&self, n_light: f64, n_camera: f64, render: Option<&RenderTime>) -> Prediction {
        let variance = |p: &NoiseSample| p.coefficients.variance(n_light, n_camera);
        let pooled_rms = self.statistic(|pixels| root(mean(pixels, variance)));
        let mean_rms = self.statistic(|pixels| mean(pixels, |p| root(variance(p))));
        let timed = render.map(|RenderTime { model, time }| {
            let tau = model.iteration(n_light, n_camera);
            let iterations = time / tau;
            // theory.md (77)
            let scale = iterations.sqrt().recip();
            let [pooled_rms, mean_rms] = [pooled_rms, mean_rms].map(|rms| rms.scaled(scale, scale));
            Timed { tau, iterations, pooled_rms, mean_rms }
        });
        Prediction { light_paths: n_light, camera_paths: n_camera, pooled_rms, mean_rms, timed }
    }

    /// The number of light paths with the least pooled RMS at `n_camera` camera paths.
    pub fn best_light_paths(&self, n_camera: f64, render: &RenderTime) -> Optimum {
        let light_paths =
            self.statistic(|pixels| best_light_paths(pooled(pixels), n_camera, render));
        let prediction = self.predict(light_paths.value, n_camera, Some(render));
        Optimum { light_paths, camera_paths: n_camera, prediction }
    }

    /// The pair of counts with the least pooled RMS, `N_B` being whole.
    pub fn optimum(&self, render: &RenderTime) -> Optimum {
        let coefficients = match self {
            Self::Measured(noise, region) => noise.mean_coefficients(region),
            Self::Given(coefficients) => *coefficients,
        };
        let bounds = CountLimits {
            light_paths: 1..=MAX_LIGHT_PATHS,
            camera_paths: 1..=u32::MAX,
            iteration_time: f64::INFINITY,
        };
        let RenderTime { model, time } = *render;
        let problem = Problem::new(&[coefficients], &[1.0], Objective::Pooled, model, &bounds);
        let best = problem.limited_to(time / MIN_ITERATIONS).uniform();
        self.best_light_paths(f64::from(best.camera_paths), render)
    }
}

/// Mean coefficients, not below 0.
fn pooled(pixels: &[NoiseSample]) -> Coefficients {
    let sum: Coefficients = pixels.iter().map(|p| p.coefficients).sum();
    (sum * (1.0 / pixels.len() as f64)).clamped()
}

/// Minimizes `(t + s x) (q + p/x)` over the light paths `x`: at `sqrt(t p / (s q))`, within bounds.
fn best_light_paths(c: Coefficients, n_camera: f64, render: &RenderTime) -> f64 {
    let [t, s] = render.model.in_light_paths(n_camera);
    let (p, q) = (c.a / n_camera + c.f, c.b / n_camera);
    // theory.md (86): the lowest limit is that of `Problem::least_sensible_time`.
    let longest = (render.time / MIN_ITERATIONS).max(2.0 * (t + s));
    let most = ((longest - t) / s).min(f64::from(MAX_LIGHT_PATHS));
    // theory.md (81)
    let best = (t * p / (s * q)).sqrt();
    // Without variance that light paths reduce, the ratio may be 0/0.
    let best = if p == 0.0 { 1.0 } else { best };
    best.min(most).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn render() -> RenderTime {
        let model = TimeModel {
            fixed: 0.01,
            light_path: 1e-6,
            camera_path: 4e-7,
            look_up: 1e-7,
            merge_pair: 1e-12,
            pixels: 10_000.0,
        };
        RenderTime { model, time: 1000.0 }
    }

    #[test]
    fn optimum_is_better_than_its_neighbors() {
        for (a, b, f) in [(3595.0, 37.18, 0.3788), (100.0, 1e-3, 50.0), (1.0, 1.0, 1.0)] {
            let source = Source::Given(Coefficients { a, b, f });
            let best = source.optimum(&render());
            let cost = |n: f64, m: f64| {
                source.predict(n, m, Some(&render())).timed.unwrap().pooled_rms.value
            };
            let (n, m) = (best.light_paths.value, best.camera_paths);
            let least = best.prediction.timed.unwrap().pooled_rms.value;
            assert!((cost(n, m) - least).abs() < 1e-12 * least);
            for other_m in [m - 1.0, m, m + 1.0, 2.0 * m].into_iter().filter(|&m| m >= 1.0) {
                for factor in [0.2, 0.8, 0.99, 1.01, 1.2, 5.0] {
                    let other = cost((n * factor).max(1.0), other_m);
                    assert!(other >= least * (1.0 - 1e-9), "{a} {b} {f}: {factor} {other_m}");
                }
            }
        }
    }

    #[test]
    fn optimum_is_finite_with_coefficients_of_0() {
        for (a, b, f) in [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)] {
            let best = Source::Given(Coefficients { a, b, f }).optimum(&render());
            let counts = [best.light_paths.value, best.camera_paths];
            assert!(counts.iter().all(|n| *n >= 1.0 && n.is_finite()), "{counts:?}");
            assert!(best.prediction.timed.unwrap().iterations > 15.0, "{best:?}");
        }
    }
}
