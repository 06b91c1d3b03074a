//! The error of a technique at any radii and counts, from a few trials.
//!
//! Merged flux is spread over the area of a disc: the second moment of a pair goes as `1/r^2`. Light paths are
//! shared by what a pixel's camera paths see, which is the disc convolved with the pixel's own area: `f` goes as
//! `1/(r^2 + g^2)`. Both kinds of photons add, each at its own radius; `b` does not depend on either. theory.md (93a).

use super::census::Census;
use super::trial::Trial;
use super::{End, Open, Scored, Technique};
use crate::noise::Coefficients;
use crate::noise::bias::weighted_square;
use crate::noise::image::Statistic;
use crate::settings::policy::*;
use crate::settings::{Direct, Kernel, Settings};
use crate::timing::TimeModel;
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;
use std::array::from_fn;
use std::f64::consts::PI;

const EVERY: usize = PhotonClass::EveryVertex as usize;
const LAST: usize = PhotonClass::LastVertex as usize;

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
    /// Radius of a disc of the area that a pixel sees.
    footprint: f64,
    /// With the time of merging per pair over the squared reach.
    times: TimeModel,
    surfaces: Surfaces,
}

/// What areas of surfaces cost an image before they are known.
#[derive(Clone, Debug, Default)]
pub struct Surfaces {
    /// At two radii, of each vertex at which they are asked for; none without areas.
    pub census: Vec<[(f64, Census); 2]>,
    /// Pixels of the image over threads.
    pub pixels_per_thread: f64,
}

impl Surfaces {
    /// Seconds at a reach after so many camera paths per pixel.
    pub fn cost(&self, reach: f64, visits: f64) -> f64 {
        let of = |census: &[(f64, Census); 2]| Census::between(*census, reach).cost(visits);
        self.pixels_per_thread * self.census.iter().map(of).sum::<f64>()
    }
}

/// Squared relative bias at a radius, and how it falls.
#[derive(Clone, Copy, Debug)]
struct Bias {
    radius: f64,
    square: f64,
    error: f64,
    /// From a radius to `1/sqrt(2)` of it.
    falls_to: f64,
}

/// Squared bias of light of a kind where nothing is known of it.
#[derive(Clone, Copy, Debug)]
struct Typical {
    square: f64,
    falls_to: f64,
}

impl Typical {
    /// At a radius in widths of what the image shows.
    fn new(class: PhotonClass, technique: Technique, radius: f64) -> Self {
        match (class, technique.kernel) {
            (PhotonClass::LastVertex, Kernel::Area) => {
                Self { square: TYPICAL_BIAS * radius.powi(3), falls_to: TYPICAL_FALL }
            }
            (PhotonClass::LastVertex, Kernel::Disc) => {
                Self { square: DISC_BIAS * TYPICAL_BIAS * radius.powi(3), falls_to: DISC_FALL }
            }
            (PhotonClass::EveryVertex, _) => {
                let direct = technique.direct;
                let scale = TYPICAL_SHARP_BIAS[usize::from(direct == Direct::PhotonMap)];
                Self { square: scale * radius.powi(2), falls_to: TYPICAL_SHARP_FALL }
            }
        }
    }
}

impl Bias {
    /// Of a trial at this radius: theory.md (93d).
    fn new(trial: &Trial, radius: f64, weights: &[f64], typical: Typical) -> Self {
        let (Statistic { value, error, .. }, falls_to) = weighted_square(&trial.noise, weights);
        let spread = PRIOR_SPREAD * typical.square;
        let certainty = spread.powi(2) / (spread.powi(2) + error * error);
        let mixed =
            |measured: f64, typical: f64| certainty * measured + (1.0 - certainty) * typical;
        Self {
            radius,
            square: mixed(value, typical.square).max(LEAST_OF_PRIOR * typical.square),
            error: error.min(spread),
            falls_to: mixed(falls_to, typical.falls_to),
        }
    }
}

/// What is asked for.
pub struct Demand {
    pub end: End,
    pub most_light_paths: u32,
    pub open: Open,
    /// Radii that were asked for.
    pub wished: ByClass<f32>,
}

/// The best radii and counts of a technique, and what they lead to.
#[derive(Clone, Copy, Debug)]
pub struct Best {
    radii: ByClass<f64>,
    light_paths: f64,
    camera_paths: u32,
    seconds: f64,
    noise2: f64,
    bias2: f64,
    bias2_error: f64,
    times: TimeModel,
    pub tried: bool,
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
        let measured: Vec<_> = trials.iter().map(|trial| relative(trial, weights)).collect();
        let g2 = footprint * footprint;
        let both = trials.iter().any(|trial| trial.any_at_every_vertex);
        let inverse = |add: f64| -> Vec<ByClass<f64>> {
            let of = |radius: f64| (radius * radius + add).recip();
            trials.iter().map(|trial| trial.radii.map(of)).collect()
        };
        let moments: Vec<f64> = measured.iter().map(|c| c.a + c.f).collect();
        let shared: Vec<f64> = measured.iter().map(|c| c.f).collect();
        let mut bias = [None; 2];
        for trial in trials {
            if let Some(class) = trial.nests {
                let radius = trial.radii[class as usize];
                let typical = Typical::new(class, technique, radius / across);
                bias[class as usize] = Some(Bias::new(trial, radius, weights, typical));
            }
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

    /// Squared bias and its standard error: theory.md (93b).
    fn bias(&self, radii: ByClass<f64>) -> [f64; 2] {
        let mut sums = [0.0; 2];
        for (bias, radius) in self.bias.iter().zip(radii) {
            let Some(Bias { radius: known, square, error, falls_to }) = *bias else { continue };
            let scale = falls_to.powf(4.0 * (known / radius).log2());
            sums[0] += scale * square.max(0.0);
            sums[1] += (scale * error).powi(2);
        }
        [sums[0], sums[1].sqrt()]
    }

    fn times(&self, radii: ByClass<f64>) -> TimeModel {
        let reach = radii[EVERY].max(radii[LAST]);
        TimeModel { merge_pair: self.times.merge_pair * reach * reach, ..self.times }
    }

    /// The best radii and counts.
    pub fn best(&self, demand: &Demand) -> Best {
        let Demand { open, wished, .. } = demand;
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
            for &every in if every.is_empty() { &none[..] } else { &every[..] } {
                let mut radii = [last; 2];
                radii[EVERY] = every;
                let own = demand.evaluate(
                    &self.coefficients(radii),
                    &self.times(radii),
                    self.bias(radii),
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
    pub fn tried_at(&self, trial: &Trial, weights: &[f64], demand: &Demand) -> Best {
        let radii = trial.radii;
        let own = relative(trial, weights);
        // What few pixels have found looks quiet, and so do radii smaller than all others.
        let is_small = (0..2).any(|class| radii[class] < self.smallest[class]);
        let coefficients = if is_small || found(trial, weights) < ENOUGH_FOUND {
            let model = self.coefficients(radii);
            Coefficients { a: own.a.max(model.a), f: own.f.max(model.f), ..own }
        } else {
            own
        };
        let bias = self.bias(radii);
        let best = demand.evaluate(&coefficients, &trial.times, bias, radii, &self.surfaces);
        Best { tried: true, ..best }
    }
}

impl Demand {
    /// Squared noise, or the time that it takes to be small enough, at the best counts by a single trial.
    pub fn noise2(&self, trial: &Trial, weights: &[f64], surfaces: &Surfaces) -> f64 {
        self.noise(trial, weights, surfaces).rank(self)
    }

    /// Share of the time that areas take before they are known, at some reach, about.
    pub fn share(&self, trial: &Trial, weights: &[f64], surfaces: &Surfaces, reach: f64) -> f64 {
        let Best { light_paths, camera_paths, seconds, times, .. } =
            self.noise(trial, weights, &Surfaces::default());
        let camera_paths = f64::from(camera_paths);
        let visits = camera_paths * seconds / times.iteration(light_paths, camera_paths);
        surfaces.cost(reach, visits) / seconds
    }

    fn noise(&self, trial: &Trial, weights: &[f64], surfaces: &Surfaces) -> Best {
        let coefficients = relative(trial, weights);
        self.evaluate(&coefficients, &trial.times, [0.0; 2], trial.radii, surfaces)
    }

    /// The best counts: theory.md (93c), at the camera paths of [`CAMERA_STEPS`].
    fn evaluate(
        &self,
        coefficients: &Coefficients,
        times: &TimeModel,
        [bias2, bias2_error]: [f64; 2],
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
                End::Time(time) => time / LEAST_ITERATIONS_AFTER_CHOICE,
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
            let cost = tau * (camera + light / light_paths);
            // theory.md (93f)
            let first = |seconds: f64| surfaces.cost(reach, n_camera * seconds / tau);
            let (seconds, noise2) = match self.end {
                End::Time(time) => {
                    let least = LEAST_TIME_SHARE * time;
                    let left = (time - first(time)).max(least);
                    (time, cost / (time - first(left)).max(least))
                }
                End::Error(error) => {
                    let noise2 = (error * error - bias2).max(LEAST_NOISE_SHARE * error * error);
                    // theory.md (91)
                    let known = (cost / noise2).max(LEAST_ITERATIONS_TO_TARGET as f64 * tau);
                    (known + first(known), noise2)
                }
            };
            let own = Best {
                radii,
                light_paths,
                camera_paths,
                seconds,
                noise2,
                bias2,
                bias2_error,
                times: *times,
                tried: false,
            };
            if best.is_none_or(|best| own.rank(self) < best.rank(self)) {
                best = Some(own);
            }
        }
        best.expect("there is a step")
    }
}

impl Best {
    /// The less, the better.
    pub fn rank(&self, demand: &Demand) -> f64 {
        match demand.end {
            End::Time(_) => self.noise2 + self.bias2,
            // Where the bias alone is too much, the less of it, the better.
            End::Error(error) => self.seconds * (self.bias2 / (error * error)).max(1.0).powi(4),
        }
    }

    /// What the program tells of it.
    pub fn scored(&self, technique: Technique) -> Scored {
        let Self { radii, camera_paths, seconds, noise2, bias2, bias2_error, times, tried, .. } =
            *self;
        Scored {
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

/// Mean coefficients of a trial over weighted pixels. As long as few pixels have found something, what they would find
/// where light is spread evenly counts as one more: theory.md (93e).
fn relative(trial: &Trial, weights: &[f64]) -> Coefficients {
    let weighted = trial.noise.pixels.iter().zip(weights);
    let sum: Coefficients = weighted.map(|(pixel, &w)| pixel.noise.coefficients * w).sum();
    let mean = (sum * (weights.len() as f64).recip()).clamped();
    let more = (trial.even - (mean.a + mean.f)).max(0.0) / (found(trial, weights) + 1.0);
    Coefficients { f: mean.f + more, ..mean }
}

/// About how many pixels have found something: theory.md (93e).
pub fn found(trial: &Trial, weights: &[f64]) -> f64 {
    let (mut sum, mut squares) = (0.0, 0.0);
    for (pixel, &weight) in trial.noise.pixels.iter().zip(weights) {
        let Coefficients { a, f, .. } = pixel.noise.coefficients;
        sum += (a + f) * weight;
        squares += ((a + f) * weight).powi(2);
    }
    if squares > 0.0 { sum * sum / squares } else { 0.0 }
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

/// Means over trials; that of merging per squared reach.
fn mean_times(trials: &[Trial]) -> TimeModel {
    let count = trials.len() as f64;
    let mean = |of: &dyn Fn(&Trial) -> f64| trials.iter().map(of).sum::<f64>() / count;
    TimeModel {
        fixed: mean(&|trial| trial.times.fixed),
        light_path: mean(&|trial| trial.times.light_path),
        camera_path: mean(&|trial| trial.times.camera_path),
        look_up: mean(&|trial| trial.times.look_up),
        merge_pair: mean(&|trial| {
            let reach = trial.radii[EVERY].max(trial.radii[LAST]);
            trial.times.merge_pair / (reach * reach)
        }),
        pixels: trials[0].times.pixels,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times() -> TimeModel {
        let (light_path, camera_path, look_up, merge_pair) = (2e-7, 5e-7, 1e-8, 1e-12);
        TimeModel { fixed: 1e-4, light_path, camera_path, look_up, merge_pair, pixels: 1e4 }
    }

    fn demand(end: End) -> Demand {
        let open =
            Open { strategy: true, direct: true, kernel: true, radius: true, caustic_radius: true };
        Demand { end, most_light_paths: 1 << 24, open, wished: [1.0; 2] }
    }

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
    fn counts_are_the_best_of_all_that_are_tried() {
        let coefficients = Coefficients { a: 2e4, b: 0.04, f: 1e4 };
        let none = Surfaces::default();
        let at = |end| demand(end).evaluate(&coefficients, &times(), [1e-5, 0.0], [1.0; 2], &none);
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

    #[test]
    fn longer_renders_take_smaller_radii() {
        let technique = Technique {
            strategy: crate::settings::Strategy::Single,
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
            footprint: 0.1,
            times: times(),
            surfaces: Surfaces::default(),
        };
        let radius = |time| model.best(&demand(End::Time(time))).radii[LAST];
        let radii = [1.0, 100.0, 1e4].map(radius);
        assert!(radii[0] > radii[1] && radii[1] > radii[2], "{radii:?}");
        // A user's radius stays.
        let open = Open { radius: false, ..demand(End::Time(1.0)).open };
        let fixed = Demand { open, wished: [0.5, 0.7], ..demand(End::Time(1.0)) };
        assert_eq!(model.best(&fixed).radii[LAST], f64::from(0.7f32));
    }
}
