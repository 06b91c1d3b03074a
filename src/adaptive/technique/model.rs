//! The error of a technique at any radii and counts, from a few trials.
//!
//! Merged flux is spread over the area of a disc: the second moment of a pair goes as `1/r^2`. Light paths are
//! shared by what a pixel's camera paths see, which is the disc convolved with the pixel's own area: `f` goes as
//! `1/(r^2 + g^2)`. Both kinds of photons add, each at its own radius; `b` does not depend on either. theory.md (93a).

use super::Technique;
use super::bias::{Bias, Typical};
use super::candidate_cost::{Best, CandidateCost, Merged};
use super::census::Surfaces;
use super::trial::Trial;
use crate::film::annulus::left_at_half;
use crate::noise::Coefficients;
use crate::settings::policy::*;
use crate::timing::TimeModel;
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;
use std::array::from_fn;
use std::f64::consts::PI;

const EVERY: usize = PhotonClass::Caustic as usize;
const LAST: usize = PhotonClass::Diffuse as usize;

/// What a technique costs at any radii.
pub struct Model {
    pub technique: Technique,
    /// The largest radius to choose, over that which was asked for.
    largest: f32,
    /// The smallest radii of the trials that are modeled.
    smallest: ByClass<f64>,
    /// Second moment of the pairs, relative, times the squared radius.
    pairs: ByClass<f64>,
    /// The light main effect, relative, times the squared radius and footprint.
    light: ByClass<f64>,
    /// The camera main effect, relative.
    camera: f64,
    bias: ByClass<Option<Bias>>,
    /// Whether one trial alone tells of it: not what either class of photons does by itself.
    is_one_trial: bool,
    /// Radius of a disc of the area that a pixel sees.
    footprint: f64,
    /// With the time of merging per pair over the squared reach.
    times: TimeModel,
    surfaces: Surfaces,
}

impl Model {
    /// From trials at different radii, with weights of the pixels' squared errors; of an image so many pixels wide
    /// that see discs of the radius `footprint`.
    pub fn new(
        (technique, largest): (Technique, f32),
        trials: &[Trial],
        weights: &[f64],
        (width, footprint): (u32, f64),
        surfaces: &Surfaces,
    ) -> Self {
        let across = f64::from(width) * footprint * PI.sqrt();
        let measured: Vec<_> = trials.iter().map(|trial| trial.relative(weights)).collect();
        let g2 = footprint * footprint;
        let both = trials.iter().any(|trial| trial.has_caustic_photons);
        let inverse = |add: f64| -> Vec<ByClass<f64>> {
            let of = |radius: f64| (radius * radius + add).recip();
            trials.iter().map(|trial| trial.radii.map(of)).collect()
        };
        let moments: Vec<f64> = measured.iter().map(|c| c.a + c.f).collect();
        let shared: Vec<f64> = measured.iter().map(|c| c.f).collect();
        let mut bias = [None; 2];
        let mut classes = vec![PhotonClass::Diffuse];
        classes.extend(both.then_some(PhotonClass::Caustic));
        for class in classes {
            // The last one that tells it, or what is typical.
            let trial = trials.iter().rfind(|trial| trial.nests == Some(class));
            let radius = trial.unwrap_or(&trials[0]).radii[class as usize];
            let typical = Typical::new(class, technique, radius / across);
            bias[class as usize] = Some(match trial {
                Some(trial) => Bias::new(trial, radius, weights, typical),
                None => Bias::typical(radius, typical),
            });
        }
        Self {
            technique,
            largest,
            smallest: from_fn(|class| {
                trials.iter().map(|trial| trial.radii[class]).fold(f64::INFINITY, f64::min)
            }),
            pairs: parts(&inverse(0.0), &moments, both),
            light: parts(&inverse(g2), &shared, both),
            camera: measured.iter().map(|c| c.b).sum::<f64>() / measured.len() as f64,
            bias,
            is_one_trial: trials.len() == 1,
            footprint,
            times: mean_times(trials),
            surfaces: surfaces.clone(),
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

    /// What merging with either class adds: theory.md (93b), (71f).
    fn merged(&self, radii: ByClass<f64>) -> ByClass<Merged> {
        from_fn(|class| {
            let Some(bias) = self.bias[class] else { return Merged::default() };
            let [bias2, error] = bias.at(radii[class]);
            let (r2, g2) = (radii[class].powi(2), self.footprint.powi(2));
            let pairs = 3.0 * self.pairs[class] / r2;
            let f = self.light[class] * ((0.25 * r2 + g2).recip() - (r2 + g2).recip());
            let f = f.min(pairs);
            let left = left_at_half(self.technique.kernel)[class];
            Merged { bias2, error, left, outer: Coefficients { a: pairs - f, b: 0.0, f } }
        })
    }

    fn times(&self, radii: ByClass<f64>) -> TimeModel {
        let reach = radii[EVERY].max(radii[LAST]);
        TimeModel { merge_pair: self.times.merge_pair * reach * reach, ..self.times }
    }

    /// The best radii and counts.
    pub fn best(&self, demand: &CandidateCost) -> Best {
        let CandidateCost { open, wished, .. } = demand;
        let steps = |is_open: bool, wished: f32| -> Vec<f64> {
            let wished = f64::from(wished);
            if !is_open {
                return vec![wished];
            }
            (RADIUS_STEPS)
                .map(|step| wished * f64::from(self.largest) * 0.5f64.powf(0.5 * f64::from(step)))
                .collect()
        };
        let last = steps(open.radius, wished[LAST]);
        let every = match self.bias[EVERY] {
            // Both steps are those of the larger radius where both are open.
            Some(_) => steps(
                open.caustic_radius,
                if open.caustic_radius { wished[LAST] } else { wished[EVERY] },
            ),
            None => vec![],
        };
        let mut best: Option<Best> = None;
        for &last in &last {
            // Without such photons their radius is of no concern.
            let none = [if open.caustic_radius { 0.25 * last } else { f64::from(wished[EVERY]) }];
            let same = [last];
            let every = match &every[..] {
                [] => &none[..],
                _ if self.is_one_trial && open.caustic_radius && open.radius => &same[..],
                every => every,
            };
            for &every in every {
                let mut radii = [last; 2];
                radii[EVERY] = every;
                let own = demand.evaluate(
                    &self.coefficients(radii),
                    &self.times(radii),
                    self.merged(radii),
                    radii,
                    &self.surfaces,
                );
                if best.is_none_or(|best| own.rank(demand) < best.rank(demand)) {
                    best = Some(own);
                }
            }
        }
        best.expect("there is a step")
    }

    /// The counts and what they lead to by a trial at the very radii, if that has found enough.
    pub fn tried_at(&self, trial: &Trial, weights: &[f64], demand: &CandidateCost) -> Best {
        let radii = trial.radii;
        let own = trial.relative(weights);
        // What few pixels have found looks quiet, and so do radii smaller than all others.
        let is_small = (0..2).any(|class| radii[class] < self.smallest[class]);
        let coefficients = if is_small || trial.found(weights) < ENOUGH_FOUND {
            let model = self.coefficients(radii);
            Coefficients { a: own.a.max(model.a), f: own.f.max(model.f), ..own }
        } else {
            own
        };
        let merged = self.merged(radii);
        let mut best = demand.evaluate(&coefficients, &trial.times, merged, radii, &self.surfaces);
        best.tried = true;
        best
    }
}

/// Parts of either class, at least 0, that add up to `values` with the factors `inverse` of trials: by least squares
/// of relative deviations.
fn parts(inverse: &[ByClass<f64>], values: &[f64], both: bool) -> ByClass<f64> {
    let rows = inverse.iter().zip(values).filter(|(_, value)| **value > 0.0);
    let rows: Vec<[f64; 2]> = rows.map(|(inverse, value)| inverse.map(|x| x / value)).collect();
    let product = |i: usize, j: usize| rows.iter().map(|row| row[i] * row[j]).sum::<f64>();
    let sum = |i: usize| rows.iter().map(|row| row[i]).sum::<f64>();
    let alone = |class: usize| {
        let mut found = [0.0; 2];
        found[class] = if rows.is_empty() { 0.0 } else { sum(class) / product(class, class) };
        found
    };
    if !both {
        return alone(LAST);
    }
    let determinant = product(0, 0) * product(1, 1) - product(0, 1).powi(2);
    let found = [
        (sum(0) * product(1, 1) - sum(1) * product(0, 1)) / determinant,
        (sum(1) * product(0, 0) - sum(0) * product(0, 1)) / determinant,
    ];
    match found {
        // One trial, or several at the same radii.
        [x, y] if !(x.is_finite() && y.is_finite()) => alone(LAST),
        // The class whose part would be negative has next to none.
        [x, _] if x < 0.0 => [LEAST_PART * alone(0)[0], alone(1)[1]],
        [_, y] if y < 0.0 => [alone(0)[0], LEAST_PART * alone(1)[1]],
        _ => found,
    }
}

/// Means over trials; that of merging per squared reach, by least squares: within small ones it hardly shows.
fn mean_times(trials: &[Trial]) -> TimeModel {
    let count = trials.len() as f64;
    let mean = |of: &dyn Fn(&Trial) -> f64| trials.iter().map(of).sum::<f64>() / count;
    let reach2 = |trial: &Trial| trial.radii[EVERY].max(trial.radii[LAST]).powi(2);
    TimeModel {
        fixed: mean(&|trial| trial.times.fixed),
        light_path: mean(&|trial| trial.times.light_path),
        camera_path: mean(&|trial| trial.times.camera_path),
        look_up: mean(&|trial| trial.times.look_up),
        merge_pair: mean(&|trial| trial.times.merge_pair * reach2(trial))
            / mean(&|trial| reach2(trial).powi(2)),
        pixels: trials[0].times.pixels,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::adaptive::technique::candidate_cost::tests::{demand, times};
    use crate::adaptive::technique::{End, FreeParameters};
    use crate::settings::{Direct, Kernel, Strategy};

    #[test]
    fn parts_of_both_classes_are_told_apart() {
        let inverse = [[1.0, 0.25], [0.0625, 4.0], [1.0, 1.0]];
        let value = |[x, y]: [f64; 2]| inverse.map(|[a, b]| a * x + b * y);
        let found = parts(&inverse, &value([3.0, 5.0]), true);
        assert!((found[0] - 3.0).abs() < 1e-9 && (found[1] - 5.0).abs() < 1e-9, "{found:?}");
        // Noise may ask for a negative part.
        let found = parts(&inverse, &value([-0.1, 5.0]), true);
        assert!(found[0] > 0.0 && found[0] < 0.3 && (found[1] - 5.0).abs() < 0.2, "{found:?}");
        let found = parts(&inverse, &inverse.map(|[_, b]| 7.0 * b), false);
        assert!(found[EVERY] == 0.0 && (found[LAST] - 7.0).abs() < 1e-9, "{found:?}");
        let one = parts(&inverse[..1], &[2.0], true);
        assert!(one.iter().all(|part| part.is_finite()), "{one:?}");
    }

    #[test]
    fn longer_renders_take_smaller_radii() {
        let technique = Technique {
            strategy: Strategy::Single,
            merge_vertex: 1,
            direct: Direct::Connect,
            kernel: Kernel::Area,
        };
        let bias = Bias { radius: 4.0, square: 0.01, error: 0.001, falls_to: TYPICAL_FALL };
        let mut known = [None; 2];
        known[LAST] = Some(bias);
        let (mut pairs, mut light) = ([0.0; 2], [0.0; 2]);
        (pairs[LAST], light[LAST]) = (1e4, 6e3);
        let camera = 0.04;
        let model = Model {
            technique,
            largest: 4.0,
            smallest: [0.0; 2],
            pairs,
            light,
            camera,
            bias: known,
            is_one_trial: false,
            footprint: 0.1,
            times: times(),
            surfaces: Surfaces::default(),
        };
        let radius = |time| model.best(&demand(End::Time(time))).radii[LAST];
        let radii = [1.0, 100.0, 1e4].map(radius);
        assert!(radii[0] > radii[1] && radii[1] > radii[2], "{radii:?}");
        // A user's radius stays.
        let open = FreeParameters { radius: false, ..demand(End::Time(1.0)).open };
        let fixed = CandidateCost { open, wished: [0.5, 0.7], ..demand(End::Time(1.0)) };
        assert_eq!(model.best(&fixed).radii[LAST], f64::from(0.7f32));
    }
}
