//! The race, the last round of the pilot: techniques at their real radii and numbers of light
//! paths.
//!
//! All parts of the race take the same time. After each of them the better half of the lanes goes
//! on, until one is left. What they have measured decides, not what was predicted. Where a lane
//! predicts clearly less error at other radii, a lane at these radii joins. theory.md, section 22a

use super::candidate_cost::CandidateCost;
use super::lane::{LANE_CAMERA_PATHS, Lane, LaneMeasurement};
use super::model::{ImageScale, Model};
use super::pilot::Finalist;
use super::trial::{BIAS_TOLERANCE, missed_share};
use super::trial_runner::TrialRunner;
use bdpm_core::base::error::Result;
use bdpm_core::film::radiance::luminance_weights;
use bdpm_core::noise::Coefficients;
use bdpm_core::settings::Settings;

/// Maximum number of lanes at the start.
const MOST_LANES: usize = 4;

/// Parts of the race, of equal times: from [`MOST_LANES`] to the last.
const PARTS: u32 = 3;

/// Iterations of a lane that fit in its first part.
const FIRST_ITERATIONS: f64 = 4.0;

/// Share of the time of an iteration for camera paths, if it has as many light paths as fit.
const CAMERA_SHARE: f64 = 0.6;

/// Minimum number of pixels of the sample.
const LEAST_PIXELS: f64 = 1024.0;

/// Other radii are worth a lane if their predicted squared error, or time, is less than this share.
const PROMISING: f64 = 0.85;

/// The race is over once the squared error, or time, of the next is larger than that of the first
/// by this factor.
const CLEAR: f64 = 4.0;

/// Other numbers of light paths than this factor or its reciprocal begin a lane anew: weights of
/// techniques depend on them.
const OTHER_WEIGHTS: f64 = 2.0;

/// Lanes that may join at a time.
const MOST_JOINING: usize = 2;

/// A technique at its radii.
struct Racer {
    finalist: Finalist,
    lane: Lane,
    /// The number of light paths by which its techniques are weighted.
    light_paths: f64,
    measured: Option<LaneMeasurement>,
    /// The model by all that the lane has measured.
    matched: Option<Model>,
}

/// What a lane has seen.
struct Seen {
    /// The larger merge radius.
    reach: f64,
    /// Bounds of its mean luminance, W/(m^2 sr).
    least: f64,
    most: f64,
}

/// What all lanes have in common.
pub struct Track<'a, 'b> {
    pub runner: &'b mut TrialRunner<'a>,
    pub settings: &'b Settings,
    pub demand: CandidateCost,
    pub scale: ImageScale,
}

/// Lets the best of `field` race for some seconds. Returns the best first, and those that did not
/// race last.
///
/// # Errors
/// As [`Renderer::new`](bdpm_core::render::Renderer::new), and if the user has interrupted the
/// program.
pub fn race(mut field: Vec<Finalist>, mut track: Track, seconds: f64) -> Result<Vec<Finalist>> {
    sort(&mut field, &track.demand);
    let lanes = field.iter().filter(|own| !own.is_reserve).count().clamp(1, MOST_LANES);
    let waiting = field.split_off(lanes);
    let part = seconds / f64::from(PARTS);
    let shape = track.shape(&field, part / lanes as f64 / FIRST_ITERATIONS);
    let racers = field.into_iter().map(|finalist| track.begin(finalist, shape));
    let mut racers = racers.collect::<Result<Vec<Racer>>>()?;
    let mut beaten: Vec<Racer> = Vec::new();
    for number in 1..=PARTS {
        let running = racers.len();
        for racer in &mut racers {
            racer.lane.go_on(track.runner, part / running as f64)?;
        }
        racers.append(&mut beaten);
        track.judge(&mut racers);
        racers.sort_by(|one, other| one.rank(&track.demand).total_cmp(&other.rank(&track.demand)));
        if number == PARTS {
            break;
        }
        let joining = racers[..running.div_ceil(2)].iter();
        let joining = joining.filter_map(|own| own.joining(&track.demand)).take(MOST_JOINING);
        let joining: Vec<Finalist> = joining.collect();
        if joining.is_empty() && is_decided(&racers, &track.demand) {
            break;
        }
        beaten = racers.split_off(running.div_ceil(2));
        for finalist in joining {
            racers.push(track.begin(finalist, shape)?);
        }
    }
    let ranked = racers.into_iter().map(|own| own.finalist);
    Ok(ranked.chain(waiting).collect())
}

/// Sorts by predicted rank, reserves last.
fn sort(field: &mut [Finalist], demand: &CandidateCost) {
    let order = |own: &Finalist| (own.is_reserve, own.best.rank(demand));
    field.sort_by(|one, other| {
        let ((one_last, one), (other_last, other)) = (order(one), order(other));
        one_last.cmp(&other_last).then(one.total_cmp(&other))
    });
}

/// Whether the first of all lanes is alone or clearly better than the others.
fn is_decided(ranked: &[Racer], demand: &CandidateCost) -> bool {
    ranked.get(1).is_none_or(|own| own.rank(demand) > CLEAR * ranked[0].rank(demand))
}

/// Size of the iterations of lanes.
#[derive(Clone, Copy)]
struct Shape {
    /// One pixel of each square of this many by this many pixels.
    stride: u32,
    /// Time of the light paths of an iteration with their merges, seconds.
    light: f64,
}

impl Track<'_, '_> {
    /// Iterations that take about `seconds`.
    fn shape(&self, field: &[Finalist], seconds: f64) -> Shape {
        let per_path = |own: &Finalist| own.best.times().camera_path + own.best.times().look_up;
        let per_path = field.iter().map(per_path).fold(0.0, f64::max);
        let pixels = CAMERA_SHARE * seconds / (f64::from(LANE_CAMERA_PATHS) * per_path);
        let [width, height] = [self.settings.width, self.settings.height];
        let all = f64::from(width) * f64::from(height);
        let stride = (all / pixels.max(LEAST_PIXELS)).sqrt() as u32;
        let stride = stride.clamp(1, width.min(height));
        Shape { stride, light: (1.0 - CAMERA_SHARE) * seconds }
    }

    fn begin(&mut self, finalist: Finalist, shape: Shape) -> Result<Racer> {
        let Finalist { model, best, .. } = &finalist;
        let candidate = best.scored(model.technique);
        let light_paths = f64::from(candidate.light_paths);
        let shape = (shape.stride, shape.light, self.demand.open.sobol_set);
        let lane = self.runner.lane(&candidate, self.settings, shape)?;
        Ok(Racer { finalist, lane, light_paths, measured: None, matched: None })
    }

    /// Ranks all lanes by what they have measured so far.
    fn judge(&mut self, racers: &mut [Racer]) {
        let mut luminance: Vec<f64> = Vec::new();
        for racer in &*racers {
            let own = racer.lane.luminances();
            luminance.resize(own.len(), 0.0);
            luminance.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        }
        let count = racers.len() as f64;
        luminance.iter_mut().for_each(|sum| *sum /= count);
        let weights = luminance_weights(&luminance);
        for racer in &mut *racers {
            racer.measured = racer.lane.measured(self.runner, &weights);
        }
        let sharp: Vec<Seen> = racers.iter().filter_map(Racer::seen).collect();
        // Trials saw other pixels, whose mean luminance may differ by as much as missing light, so
        // that they tell its share alone.
        // Lanes that merge nothing are compared with the sharpest of the others.
        let reaches = sharp.iter().map(|own| own.reach).filter(|reach| *reach > 0.0);
        let sharpest = reaches.fold(f64::INFINITY, f64::min);
        for racer in racers {
            let reach = if racer.reach() > 0.0 { racer.reach() } else { sharpest };
            let sharper = sharp.iter().filter(|own| own.reach < 1.01 * reach);
            let least = sharper.map(|own| own.least).fold(0.0, f64::max);
            let most = sharp.iter().filter(|own| own.reach < 0.99 * racer.reach());
            let most = most.map(|own| own.most).reduce(f64::max);
            racer.judge(self, [least, most.unwrap_or(f64::INFINITY)]);
        }
    }
}

impl Racer {
    fn rank(&self, demand: &CandidateCost) -> f64 {
        match self.finalist.best.tried {
            true => self.finalist.best.rank(demand),
            false => f64::INFINITY,
        }
    }

    /// The larger of both radii; 0 without merges, which blur nothing.
    fn reach(&self) -> f64 {
        let Finalist { model, best, .. } = &self.finalist;
        model.technique.reach(best.radii)
    }

    fn seen(&self) -> Option<Seen> {
        let LaneMeasurement { luminance, error, .. } = self.measured.as_ref()?;
        let [least, most] = [-2.0, 2.0].map(|errors| luminance + errors * error);
        Some(Seen { reach: self.reach(), least, most })
    }

    /// The best counts by what the lane has measured. Lanes that blur as little found at least the
    /// first of both luminances, and those that blur less at most the other.
    fn judge(&mut self, track: &Track, [least, most]: [f64; 2]) {
        let Some(measured) = &self.measured else { return };
        let LaneMeasurement { image, start_up, luminance, paths, .. } = measured;
        let model = self.finalist.model.matched(image, track.scale);
        let model = model.with_start_up(image.radii, *start_up);
        // theory.md (93f)
        let share = missed_share(*luminance, least).max(self.finalist.missed);
        let missed = paths * share.powi(2);
        let missed = match model.technique.merges() {
            true => Coefficients { f: missed, ..Coefficients::default() },
            false => Coefficients { b: missed, ..Coefficients::default() },
        };
        let coefficients = image.coefficients + missed;
        let time = model.time(image.radii);
        let demand = CandidateCost { in_media: self.finalist.best.in_media, ..track.demand };
        let best = model.evaluate(&coefficients, &time, &demand, image.radii);
        // Light that leaks through walls is bias, whatever the annulus shows.
        let leaked = (luminance / most - 1.0 - BIAS_TOLERANCE).max(0.0);
        self.finalist.best = best.tried(true).with_bias(leaked);
        self.matched = Some(model);
    }

    /// A lane at other radii or with other weights that is predicted to be clearly better.
    fn joining(&self, demand: &CandidateCost) -> Option<Finalist> {
        let Self { finalist, matched, light_paths, .. } = self;
        let model = matched.as_ref()?;
        let own = model.best(demand);
        let is_elsewhere = own.radii != finalist.best.radii;
        let is_better = is_elsewhere && own.rank(demand) < PROMISING * finalist.best.rank(demand);
        let ratio = finalist.best.light_paths() / light_paths;
        let is_weighted = model.technique.strategy.weighs_merges();
        let has_other_weights =
            is_weighted && !(OTHER_WEIGHTS.recip()..OTHER_WEIGHTS).contains(&ratio);
        let best = match (is_better, has_other_weights) {
            (true, _) => own,
            (false, true) => finalist.best.tried(false),
            (false, false) => return None,
        };
        let missed = finalist.missed;
        Some(Finalist { model: model.clone(), best, is_reserve: false, missed })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adaptive::technique::candidate_cost::tests::demand;
    use crate::adaptive::technique::{End, FreeParameters, Technique};
    use bdpm_core::render::Renderer;
    use bdpm_core::scene::backend::{Backend, build};
    use bdpm_load::load;

    /// Radii of the lanes of a race in `scenes/keyhole`, the best first: the same technique at
    /// these radii.
    fn raced(radii: [f32; 2]) -> Vec<f32> {
        let loaded = load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/keyhole")).unwrap();
        let own = Settings::resolve(&Default::default(), &loaded.defaults, loaded.scene.size());
        let own = Settings { width: 64, height: 48, merge_vertex: 1, ..own.unwrap() };
        let accel = build(Backend::Bvh, &loaded.scene).unwrap();
        let renderer = Renderer::new(&loaded.scene, &accel, own.clone()).unwrap();
        let mut runner = TrialRunner::new(&renderer, 0.0).unwrap();
        let open = FreeParameters { strategy: true, ..FreeParameters::NONE };
        // So long that bias decides.
        let demand = CandidateCost { open, ..demand(End::Time(1e6)) };
        let scale = ImageScale { width: own.width, footprint: runner.footprint };
        let trial = runner.trial(&own, None, 0.0).unwrap();
        let weights = vec![1.0; trial.noise.pixels.len()];
        let model = Model::new(Technique::of(&own), &[trial], &weights, scale);
        let finalist = |radius: f32| {
            let radii = [f64::from(radius); 2];
            let at = model.clone();
            let coefficients = Coefficients { a: 1e4, b: 1.0, f: 1e4 };
            let best = at.evaluate(&coefficients, &at.time(radii), &demand, radii);
            Finalist { model: at, best, is_reserve: false, missed: 0.0 }
        };
        let field = radii.map(finalist).into_iter().collect();
        let track = Track { runner: &mut runner, settings: &own, demand, scale };
        let ranked = race(field, track, 0.0).unwrap();
        assert!(ranked[0].best.tried);
        ranked.iter().map(|own| own.best.radii[0] as f32).collect()
    }

    /// Within .4 photons of the bright side of the wall are merged on its dark side.
    #[test]
    fn radii_that_leak_light_through_walls_lose() {
        for radii in [[0.05, 0.4], [0.4, 0.05]] {
            assert_eq!(raced(radii), [0.05, 0.4]);
        }
    }
}
