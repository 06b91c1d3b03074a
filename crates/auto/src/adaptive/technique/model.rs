//! Predicts the error of a technique at any radii and counts, from a few trials.
//!
//! A merge spreads the flux of a photon over the area of a disc, so that the second moment of a
//! pair is proportional to `1/r^2`. All camera paths of a pixel share the light paths that they
//! see. What they see is the disc convolved with the area of the pixel, so that `f` is proportional
//! to `1/(r^2 + g^2)`. The contributions of both classes of photons add, each at a radius of its
//! own. `b` does not depend on the radii: theory.md (93a).

use super::Technique;
use super::bias_law::BiasLaw;
use super::candidate_cost::{Best, CandidateCost, ClassBias, RenderTime};
use super::pair_time::PairTime;
use super::start_up::{StartUp, StartUpLaw};
use super::trial::Trial;
use crate::adaptive::denoised_noise::kept_by_averages;
use crate::timing::TimeModel;
use crate::timing::least_squares::not_negative_parts;
use bdpm_core::film::annulus::left_at_half;
use bdpm_core::noise::Coefficients;
use bdpm_core::transport::kernel::ByClass;
use bdpm_core::transport::photon::PhotonClass;
use std::array::from_fn;
use std::f64::consts::PI;
use std::ops::Range;

const EVERY: usize = PhotonClass::Caustic as usize;
const LAST: usize = PhotonClass::Diffuse as usize;

/// The largest radius of trials and of the choice, over that of the settings. The bias shows at a
/// large radius and falls from there as measured. Between the radii of two trials the noise is
/// known.
pub const LARGEST_SCALE: f32 = 4.0;

/// Radii that the choice compares: the largest radius over these powers of the root of 2. The
/// smallest is a sixteenth of the largest.
const RADIUS_STEPS: Range<i32> = 0..9;

/// Minimum share of the second moment that the fit gives to either class of photons. With a share
/// of 0 the radius of that class would cost nothing.
const MINIMUM_PART: f64 = 0.05;

/// Radii of merges, in pixels, from which on few photons are seen as discs.
const DISC_PIXELS: f64 = 4.0;

/// Pixels that must have received photons before a trial is trusted without the model: a photon map
/// that few pixels see looks less noisy than it is.
pub const ENOUGH_FOUND: f64 = 64.0;

/// The image that trials sample.
#[derive(Clone, Copy, Debug)]
pub struct ImageScale {
    /// Width of the full image, pixels.
    pub width: u32,
    /// Radius of a disc of the area that a pixel sees, scene units.
    pub footprint: f64,
}

/// Noise, bias and time of a technique as functions of the radii.
#[derive(Clone, Debug)]
pub struct Model {
    /// The technique.
    pub technique: Technique,
    /// Second moment of the pairs, relative, times the squared radius.
    pairs: ByClass<f64>,
    /// Light main effect, relative, times the squared radius and footprint.
    light: ByClass<f64>,
    /// Camera main effect, relative.
    camera: f64,
    bias: ByClass<Option<BiasLaw>>,
    /// Whether there was a single trial, which cannot separate the two classes of photons.
    is_one_trial: bool,
    /// Radius of a disc of the area that a pixel sees, scene units.
    footprint: f64,
    /// Times of an iteration, but for pairs.
    times: TimeModel,
    pair_time: PairTime,
    /// Start-up of the image.
    start_up: StartUpLaw,
}

/// What the iterations of an image have measured of its technique.
#[derive(Clone, Copy, Debug)]
pub struct ImageMeasurement {
    /// Merge radii, scene units.
    pub radii: ByClass<f64>,
    /// Relative coefficients, means over the image.
    pub coefficients: Coefficients,
    /// Squared relative bias of the outer annulus and its standard error, if it is measured.
    pub annulus_bias2: Option<ByClass<[f64; 2]>>,
    /// Times of an iteration.
    pub times: TimeModel,
}

/// Noise of the bias of a cache, which no prediction takes as corrected: it is measured for larger
/// parts of the image than pixels.
const NEVER_CORRECTED: Coefficients = Coefficients { a: 0.0, b: 0.0, f: 1e12 };

impl Technique {
    /// Bias that is left where the measured one is subtracted, over it, by photon class.
    fn left_at_half(&self) -> ByClass<f64> {
        left_at_half(self.kernel, self.strategy.has_cache())
    }
}

impl ImageScale {
    /// Width of what the image shows, scene units.
    pub fn image_width(&self) -> f64 {
        f64::from(self.width) * self.footprint * PI.sqrt()
    }
}

impl Model {
    /// Fits trials at different radii. `weights` are those of the pixels' squared errors.
    pub fn new(technique: Technique, trials: &[Trial], weights: &[f64], scale: ImageScale) -> Self {
        let ImageScale { footprint, .. } = scale;
        let across = scale.image_width();
        let measured: Vec<_> = trials.iter().map(|trial| trial.relative(weights)).collect();
        let g2 = footprint * footprint;
        let both = trials.iter().any(|trial| trial.has_caustic_photons);
        let inverse = |add: f64| -> Vec<ByClass<f64>> {
            let of = |radius: f64| (radius * radius + add).recip();
            trials.iter().map(|trial| trial.radii.map(of)).collect()
        };
        let moments: Vec<f64> = measured.iter().map(|c| c.a + c.f).collect();
        let shared: Vec<f64> = measured.iter().map(|c| c.f).collect();
        let [_, has_diffuse] = technique.classes();
        let shares = [both && technique.merges(), has_diffuse];
        let bias = PhotonClass::ALL.map(|class| {
            // The last trial that measured the bias of this class, or the prior if none did.
            let trial = trials.iter().rfind(|trial| trial.nests == Some(class));
            let radius = trial.unwrap_or(&trials[0]).radii[class as usize];
            let prior = BiasLaw::typical(class, technique, radius, across);
            let law = trial.map_or(prior, |trial| prior.measured(trial, weights));
            shares[class as usize].then_some(law)
        });
        let reached = |trial: &Trial| Some((technique.reach(trial.radii), trial.start_up?));
        Self {
            technique,
            pairs: parts(&inverse(0.0), &moments, shares),
            light: parts(&inverse(g2), &shared, shares),
            camera: measured.iter().map(|c| c.b).sum::<f64>() / measured.len() as f64,
            bias,
            is_one_trial: trials.len() == 1,
            footprint,
            times: mean_times(trials),
            pair_time: PairTime::of(technique, trials),
            start_up: StartUpLaw::of(trials.iter().filter_map(reached)),
        }
    }

    /// Relative coefficients at some radii: theory.md (93a).
    fn coefficients(&self, radii: ByClass<f64>) -> Coefficients {
        let over = |parts: &ByClass<f64>, add: f64| -> f64 {
            parts.iter().zip(radii).map(|(part, r)| part / (r * r + add)).sum()
        };
        let pairs = over(&self.pairs, 0.0);
        let f = over(&self.light, self.footprint.powi(2)).min(pairs);
        Coefficients { a: pairs - f, b: self.camera, f }.clamped()
    }

    /// The best counts at some radii, where the image has these coefficients and times.
    pub fn evaluate(
        &self,
        coefficients: &Coefficients,
        time: &RenderTime,
        demand: &CandidateCost,
        radii: ByClass<f64>,
    ) -> Best {
        let shares = [self.blur(radii), self.caustics(radii)];
        let merged = self.merged(radii);
        demand.evaluate_image((self.technique, shares), coefficients, time, &merged, radii)
    }

    /// Share of the noise of shared photons that averages over several pixels keep, at some radii.
    fn blur(&self, radii: ByClass<f64>) -> f64 {
        if self.technique.strategy.has_only_caustics() {
            return kept_by_averages(radii[EVERY], self.footprint);
        }
        let noise =
            |class: usize| self.light[class] / (radii[class].powi(2) + self.footprint.powi(2));
        let kept = |class: usize| noise(class) * kept_by_averages(radii[class], self.footprint);
        let sum = noise(EVERY) + noise(LAST);
        if sum > 0.0 { (kept(EVERY) + kept(LAST)) / sum } else { 1.0 }
    }

    /// Share of photons of caustics in the noise of pairs, at some radii.
    fn caustics(&self, radii: ByClass<f64>) -> f64 {
        let [caustic, diffuse] = from_fn(|class| self.pairs[class] / radii[class].powi(2));
        let all = caustic + diffuse;
        if all > 0.0 { caustic / all } else { 0.0 }
    }

    /// Merge bias of both classes of photons at some radii: theory.md (93b), (71f).
    fn merged(&self, radii: ByClass<f64>) -> ByClass<ClassBias> {
        from_fn(|class| {
            let Some(bias) = self.bias[class] else { return ClassBias::default() };
            let [square, error] = bias.at(radii[class]);
            let (r2, g2) = (radii[class].powi(2), self.footprint.powi(2));
            let pairs = 3.0 * self.pairs[class] / r2;
            let f = self.light[class] * ((0.25 * r2 + g2).recip() - (r2 + g2).recip());
            let f = f.min(pairs);
            let left = self.technique.left_at_half()[class];
            let outer = match self.technique.strategy.has_cache() && class == LAST {
                true => NEVER_CORRECTED,
                false => Coefficients { a: pairs - f, b: 0.0, f },
            };
            ClassBias { square, error, left, outer }
        })
    }

    /// Squared relative merge bias at some radii, without correction.
    pub fn bias2_at(&self, radii: ByClass<f64>) -> f64 {
        self.merged(radii).iter().map(|class| class.square.max(0.0)).sum()
    }

    /// Time at some radii.
    pub fn time(&self, radii: ByClass<f64>) -> RenderTime {
        let reach = self.technique.reach(radii);
        let times = TimeModel { merge_pair: self.pair_time.at(reach), ..self.times };
        RenderTime { times, start_up: self.start_up.at(reach) }
    }

    /// The model that agrees with this start-up at these radii.
    pub fn with_start_up(self, radii: ByClass<f64>, start_up: Option<StartUp>) -> Self {
        let Some(own) = start_up else { return self };
        let reach = self.technique.reach(radii);
        Self { start_up: self.start_up.through(reach, own), ..self }
    }

    /// The best radii and counts.
    pub fn best(&self, demand: &CandidateCost) -> Best {
        let CandidateCost { open, requested, .. } = demand;
        let [caustic, radius] = requested.map(f64::from);
        let largest = radius * f64::from(LARGEST_SCALE);
        let step = |step: i32| largest * 0.5f64.powf(0.5 * f64::from(step));
        let steps: Vec<f64> = RADIUS_STEPS.map(step).collect();
        let strategy = self.technique.strategy;
        let merges_diffuse = !strategy.has_cache() && !strategy.has_only_caustics();
        let last = if open.radius && merges_diffuse { steps.clone() } else { vec![radius] };
        // Both classes take steps of the larger radius where both are open.
        let every = |last: f64| match self.bias[EVERY] {
            _ if !open.caustic_radius => vec![caustic],
            // Without photons of the class its radius does not matter.
            None => vec![0.25 * last],
            Some(_) if self.is_one_trial && open.radius => vec![last],
            Some(_) => steps.clone(),
        };
        let all = last.into_iter().flat_map(|last| every(last).into_iter().map(move |r| [r, last]));
        let ranked = all.map(|radii| {
            let own = self.evaluate(&self.coefficients(radii), &self.time(radii), demand, radii);
            (self.with_discs(&own, self.technique.reach(radii)) * own.rank(demand), own)
        });
        let best = ranked.reduce(|best, own| if own.0 < best.0 { own } else { best });
        best.expect("there is a step").1
    }

    /// Factor on the rank of radii above [`DISC_PIXELS`] where the noise is visible, for the discs
    /// that they draw. Larger radii only save the time of tracing light paths: noise and the time
    /// of merges depend on the product of `N_F` and the squared radius. Short trials see too little
    /// of the noise of discs.
    fn with_discs(&self, best: &Best, radius: f64) -> f64 {
        let pixels = radius / (DISC_PIXELS * self.footprint * PI.sqrt());
        if best.is_noise_visible() { pixels.max(1.0).powi(4) } else { 1.0 }
    }

    /// The model that agrees with what an image has measured at its radii. How noise and bias
    /// depend on the radii stays as fitted.
    pub fn matched(&self, image: &ImageMeasurement, scale: ImageScale) -> Self {
        let ImageMeasurement { radii, coefficients: measured, annulus_bias2, times } = *image;
        let own = self.coefficients(radii);
        let measured = measured.clamped();
        let factor = |measured: f64, own: f64| if own > 0.0 { measured / own } else { 1.0 };
        let pairs = factor(measured.a + measured.f, own.a + own.f);
        let light = factor(measured.f, own.f);
        let left = self.technique.left_at_half();
        let bias = PhotonClass::ALL.map(|class| {
            let index = class as usize;
            let assumed = self.bias[index]?;
            let Some(annulus_bias2) = annulus_bias2 else { return Some(assumed) };
            // theory.md (71f): the annulus holds all of the bias but what is left at half the
            // radius.
            let measured = annulus_bias2[index].map(|own| (1.0 + left[index]).powi(2) * own);
            let (radius, across) = (radii[index], scale.image_width());
            let typical = BiasLaw::typical(class, self.technique, radius, across);
            Some(assumed.prior_at(radius).combined(measured, assumed.falls_to, &typical))
        });
        let reach = self.technique.reach(radii);
        Self {
            pairs: self.pairs.map(|part| pairs * part),
            light: self.light.map(|part| light * part),
            camera: measured.b,
            bias,
            pair_time: self.pair_time.through(reach, times.merge_pair),
            times: TimeModel { merge_pair: 0.0, ..times },
            is_one_trial: false,
            ..self.clone()
        }
    }

    /// The model of a technique that splits otherwise, or at this factor on the radii in media: as
    /// if all bias were that of media.
    pub fn variant(&self, technique: Technique, medium_factor: f64) -> Self {
        let scaled = |law: BiasLaw| BiasLaw { radius: law.radius / medium_factor, ..law };
        Self { technique, bias: self.bias.map(|law| law.map(scaled)), ..self.clone() }
    }
}

/// Fits one part of at least 0 for each class, so that the parts times the factors `inverse` of the
/// trials add up to `values`: least squares of relative deviations. One trial, or several at equal
/// radii, cannot separate the classes.
fn parts(inverse: &[ByClass<f64>], values: &[f64], shares: ByClass<bool>) -> ByClass<f64> {
    let rows: Vec<_> = inverse.iter().zip(values).filter(|(_, value)| **value > 0.0).collect();
    let column = |class: usize| -> Vec<f64> {
        let share = f64::from(u8::from(shares[class]));
        rows.iter().map(|(inverse, value)| share * inverse[class] / *value).collect()
    };
    let ones = vec![1.0; rows.len()];
    let [last, every] = not_negative_parts([column(LAST), column(EVERY)], &ones);
    // The class whose part would be negative contributes next to nothing.
    let part = |class: usize, part: Option<f64>| match part {
        Some(0.0) => not_negative_parts([column(class)], &ones)[0].map(|own| MINIMUM_PART * own),
        part => part,
    };
    [part(EVERY, every), part(LAST, last)].map(Option::unwrap_or_default)
}

/// Means over trials, without the time of pairs.
fn mean_times(trials: &[Trial]) -> TimeModel {
    let count = trials.len() as f64;
    let mean = |of: fn(&TimeModel) -> f64| {
        trials.iter().map(|trial| of(&trial.times)).sum::<f64>() / count
    };
    TimeModel {
        fixed: mean(|times| times.fixed),
        light_path: mean(|times| times.light_path),
        camera_path: mean(|times| times.camera_path),
        look_up: mean(|times| times.look_up),
        merge_pair: 0.0,
        pixels: trials[0].times.pixels,
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::adaptive::technique::bias_law::TYPICAL_FALL;
    use crate::adaptive::technique::candidate_cost::tests::{MERGING, demand, times};
    use crate::adaptive::technique::trial_runner::TrialRunner;
    use crate::adaptive::technique::{End, FreeParameters};
    use bdpm_core::settings::Settings;

    /// A model by one trial of some settings without time, and the scale of their image.
    pub fn of_trial(runner: &mut TrialRunner, own: &Settings) -> (Model, ImageScale) {
        let scale = ImageScale { width: own.width, footprint: runner.footprint };
        let trial = runner.trial(own, None, 0.0).unwrap();
        let weights = vec![1.0; trial.noise.pixels.len()];
        (Model::new(Technique::of(own), &[trial], &weights, scale), scale)
    }

    #[test]
    fn parts_of_both_classes_are_separated() {
        let inverse = [[1.0, 0.25], [0.0625, 4.0], [1.0, 1.0]];
        let value = |[x, y]: [f64; 2]| inverse.map(|[a, b]| a * x + b * y);
        let found = parts(&inverse, &value([3.0, 5.0]), [true; 2]);
        assert!((found[0] - 3.0).abs() < 1e-9 && (found[1] - 5.0).abs() < 1e-9, "{found:?}");
        // Noise may ask for a negative part.
        let found = parts(&inverse, &value([-0.1, 5.0]), [true; 2]);
        assert!(found[0] > 0.0 && found[0] < 0.3 && (found[1] - 5.0).abs() < 0.2, "{found:?}");
        let found = parts(&inverse, &inverse.map(|[_, b]| 7.0 * b), [false, true]);
        assert!(found[EVERY] == 0.0 && (found[LAST] - 7.0).abs() < 1e-9, "{found:?}");
        let one = parts(&inverse[..1], &[2.0], [true; 2]);
        assert!(one.iter().all(|part| part.is_finite()), "{one:?}");
    }

    #[test]
    fn longer_renders_take_smaller_radii() {
        let bias = BiasLaw { radius: 4.0, square: 0.01, error: 0.001, falls_to: TYPICAL_FALL };
        let mut known = [None; 2];
        known[LAST] = Some(bias);
        let (mut pairs, mut light) = ([0.0; 2], [0.0; 2]);
        (pairs[LAST], light[LAST]) = (1e4, 6e3);
        let camera = 0.04;
        let model = Model {
            technique: MERGING,
            pairs,
            light,
            camera,
            bias: known,
            is_one_trial: false,
            footprint: 0.1,
            times: times(),
            pair_time: PairTime::default().through(1.0, times().merge_pair),
            start_up: StartUpLaw::default(),
        };
        let radius = |time| model.best(&demand(End::Time(time))).radii[LAST];
        let radii = [1.0, 100.0, 1e4].map(radius);
        assert!(radii[0] > radii[1] && radii[1] > radii[2], "{radii:?}");
        // A radius of the command line is kept.
        let open = FreeParameters { radius: false, ..demand(End::Time(1.0)).open };
        let fixed = CandidateCost { open, requested: [0.5, 0.7], ..demand(End::Time(1.0)) };
        assert_eq!(model.best(&fixed).radii[LAST], f64::from(0.7f32));
    }
}
