//! The race, the last round of the pilot: techniques at their real radii and numbers of light
//! paths.
//!
//! All parts of the race take the same time. After each of them the better half of the lanes goes
//! on, until one is left. What they have measured decides, not what was predicted. Where a lane
//! predicts clearly less error at other radii, a lane at these radii joins. theory.md, section 22a

use super::candidate_cost::{Best, CandidateCost, InMedia};
use super::lane::{LANE_CAMERA_PATHS, Lane, LaneMeasurement, LaneShape};
use super::model::{ImageScale, Model};
use super::pilot::{Finalist, common_weights};
use super::trial::{BIAS_TOLERANCE, missed_light, missed_share};
use super::trial_runner::{TrialRunner, stride};
use super::{End, Technique};
use bdpm_core::base::error::Result;
use bdpm_core::settings::{MEDIUM_SCALES, Settings};
use std::ops::Range;

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

/// Factors on the number of light paths that need no new lane. Weights of techniques depend on it.
const SAME_WEIGHTS: Range<f64> = 0.5..2.0;

/// Factors on the radii in media of lanes that join.
const OTHER_SCALES: [f64; 2] = [0.5, 2.0];

/// Lanes at other radii or with other weights that may join at a time.
const MOST_JOINING: usize = 2;

/// A technique at its radii.
struct Racer {
    finalist: Finalist,
    lane: Lane,
    /// The number of light paths by which its techniques are weighted.
    light_paths: f64,
    /// The model by all that the lane has measured.
    matched: Option<Model>,
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
pub fn race(mut field: Vec<Finalist>, mut track: Track, seconds: f64) -> Result<Vec<Finalist>> {
    let rank = |own: &Finalist| own.best.rank(&track.demand);
    field.sort_by(|one, other| {
        one.is_reserve.cmp(&other.is_reserve).then(rank(one).total_cmp(&rank(other)))
    });
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
        let is_new = |own: &Finalist| racers.iter().all(|other| !other.is_like(own));
        let joining = racers[..running.div_ceil(2)].iter();
        let joining = joining.filter_map(|own| own.joining(&track.demand)).filter(is_new);
        let variants = racers[0].variants(&track.demand).into_iter().filter(is_new);
        let joining: Vec<Finalist> = joining.take(MOST_JOINING).chain(variants).collect();
        let clear = CLEAR * racers[0].rank(&track.demand);
        let is_decided = racers.get(1).is_none_or(|own| own.rank(&track.demand) > clear);
        if joining.is_empty() && is_decided {
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

impl Track<'_, '_> {
    /// Iterations that take about `seconds`.
    fn shape(&self, field: &[Finalist], seconds: f64) -> LaneShape {
        let per_path = |own: &Finalist| own.best.times.camera_path + own.best.times.look_up;
        let per_path = field.iter().map(per_path).fold(0.0, f64::max);
        let pixels = CAMERA_SHARE * seconds / (f64::from(LANE_CAMERA_PATHS) * per_path);
        let stride = stride(self.settings, pixels.max(LEAST_PIXELS));
        let has_sets = self.demand.open.sobol_set;
        LaneShape { stride, light: (1.0 - CAMERA_SHARE) * seconds, has_sets }
    }

    fn begin(&mut self, finalist: Finalist, shape: LaneShape) -> Result<Racer> {
        let candidate = finalist.best.scored(finalist.model.technique);
        let lane = self.runner.lane(&candidate, self.settings, shape)?;
        Ok(Racer { finalist, lane, light_paths: candidate.light_paths.into(), matched: None })
    }

    /// Ranks all lanes by what they have measured so far.
    fn judge(&mut self, racers: &mut [Racer]) {
        let weights = common_weights(racers.iter().map(|racer| racer.lane.luminances()));
        let measure = |racer: &Racer| racer.lane.measured(self.runner, &weights);
        let measured: Vec<Option<LaneMeasurement>> = racers.iter().map(measure).collect();
        let sharp = racers.iter().zip(&measured);
        let sharp = sharp.filter_map(|(racer, own)| Some((racer.reach(), own.as_ref()?.bounds)));
        let sharp: Vec<(f64, [f64; 2])> = sharp.collect();
        // Trials saw other pixels, whose mean luminance may differ by as much as missing light, so
        // that they tell its share alone.
        // Lanes that merge nothing are compared with the sharpest of the others.
        let reaches = sharp.iter().map(|(reach, _)| *reach).filter(|reach| *reach > 0.0);
        let sharpest = reaches.fold(f64::INFINITY, f64::min);
        for (racer, measured) in racers.iter_mut().zip(measured) {
            let Some(measured) = measured else { continue };
            let reach = if racer.reach() > 0.0 { racer.reach() } else { sharpest };
            let sharper = sharp.iter().filter(|(own, _)| *own < 1.01 * reach);
            let least = sharper.map(|(_, [least, _])| *least).fold(0.0, f64::max);
            let most = sharp.iter().filter(|(own, _)| *own < 0.99 * racer.reach());
            let most = most.map(|(_, [_, most])| *most).reduce(f64::max);
            racer.judge(&measured, self, [least, most.unwrap_or(f64::INFINITY)]);
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

    /// The best counts by what the lane has measured. Lanes that blur as little found at least the
    /// first of both luminances, and those that blur less at most the other.
    fn judge(&mut self, measured: &LaneMeasurement, track: &Track, [least, most]: [f64; 2]) {
        let LaneMeasurement { image, start_up, luminance, paths, .. } = measured;
        let model = self.finalist.model.matched(image, track.scale);
        let model = model.with_start_up(image.radii, *start_up);
        let share = missed_share(*luminance, least).max(self.finalist.missed);
        let missed = missed_light(model.technique.merges(), *paths, share);
        let coefficients = image.coefficients + missed;
        let time = model.time(image.radii);
        let demand = CandidateCost { in_media: self.finalist.best.in_media, ..track.demand };
        let best = model.evaluate(&coefficients, &time, &demand, image.radii);
        // Light that leaks through walls is bias, whatever the annulus shows.
        let leaked = (luminance / most - 1.0 - BIAS_TOLERANCE).max(0.0);
        let bias2 = best.bias2 + leaked * leaked;
        self.finalist.best = Best { tried: true, bias2, ..best };
        self.matched = Some(model);
    }

    /// A lane at other radii or with other weights that is predicted to be clearly better.
    fn joining(&self, demand: &CandidateCost) -> Option<Finalist> {
        let Self { finalist, matched, .. } = self;
        let model = matched.as_ref()?;
        let demand = &CandidateCost { in_media: finalist.best.in_media, ..*demand };
        let own = model.best(demand);
        let is_elsewhere = own.radii != finalist.best.radii;
        let is_better = is_elsewhere && own.rank(demand) < PROMISING * finalist.best.rank(demand);
        let best = match (is_better, self.has_weights_of(&finalist.best)) {
            (true, _) => own,
            (false, false) => Best { tried: false, ..finalist.best },
            (false, true) => return None,
        };
        let missed = finalist.missed;
        Some(Finalist { model: model.clone(), best, is_reserve: false, missed })
    }

    /// Lanes that no prediction asks for, beside the best one: with light paths that split, unless
    /// they would draw visible noise as spots, and with other radii in media. They have as many
    /// light paths as the best one: the time of a pair along segments depends on their number.
    fn variants(&self, demand: &CandidateCost) -> Vec<Finalist> {
        let Finalist { best, missed, .. } = self.finalist;
        let Some(model) = &self.matched else { return Vec::new() };
        let variant = |technique: Technique, factor: f64| {
            let model = model.variant(technique, factor);
            let in_media = InMedia { scale: factor * best.in_media.scale, ..best.in_media };
            let best = Best { in_media, light_paths: self.light_paths, tried: false, ..best };
            Finalist { model, best, is_reserve: false, missed }
        };
        let draws_spots = matches!(demand.end, End::Time(_)) && best.is_noise_visible();
        let splits = demand.open.splitting && !draws_spots;
        let split = model.technique.split().filter(|_| splits);
        let mut all: Vec<Finalist> = split.map(|split| variant(split, 1.0)).into_iter().collect();
        if demand.open.medium_scale && model.technique.medium_query.is_some() {
            let scaled = OTHER_SCALES.map(|factor| variant(model.technique, factor)).into_iter();
            all.extend(scaled.filter(|own| MEDIUM_SCALES.contains(&own.best.in_media.scale)));
        }
        all
    }

    /// Whether the lane of a finalist would repeat this one.
    fn is_like(&self, Finalist { model, best, .. }: &Finalist) -> bool {
        // Lanes measure at radii of single precision.
        let place = |best: &Best| (best.radii.map(|radius| radius as f32), best.in_media);
        let own = &self.finalist;
        (own.model.technique, place(&own.best)) == (model.technique, place(best))
            && self.has_weights_of(best)
    }

    /// Whether its techniques have the weights of these counts.
    fn has_weights_of(&self, best: &Best) -> bool {
        !self.finalist.model.technique.strategy.weighs_merges()
            || SAME_WEIGHTS.contains(&(best.light_paths / self.light_paths))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adaptive::technique::candidate_cost::tests::demand;
    use crate::adaptive::technique::model::tests::of_trial;
    use crate::adaptive::technique::{FreeParameters, SPLITTING};
    use crate::test_scene::TestScene;
    use bdpm_core::noise::Coefficients;

    /// Share of the merges in media that lanes do.
    const SHARE: f64 = 0.5;

    /// The lanes of a race of merging at vertex 1 at these radii in a scene, the best first.
    fn raced(scene: &str, open: FreeParameters, radii: &[f32]) -> Vec<Finalist> {
        let scene = TestScene::new(scene, [64, 48]);
        let own = Settings { merge_vertex: 1, medium_share: SHARE, ..scene.settings.clone() };
        let renderer = scene.renderer(&own);
        let mut runner = TrialRunner::new(&renderer, 0.0).unwrap();
        // So long that bias decides.
        let demand = demand(End::Time(1e6));
        let in_media = InMedia { scale: own.medium_scale, share: own.medium_share };
        let demand = CandidateCost { open, in_media, ..demand };
        let (model, scale) = of_trial(&mut runner, &own);
        let medium_query = open.medium_scale.then_some(own.medium_query);
        let model = model.variant(Technique { medium_query, ..model.technique }, 1.0);
        let finalist = |radius: &f32| {
            let radii = [f64::from(*radius); 2];
            let at = model.clone();
            let coefficients = Coefficients { a: 1e4, b: 1.0, f: 1e4 };
            let best = at.evaluate(&coefficients, &at.time(radii), &demand, radii);
            Finalist { model: at, best, is_reserve: false, missed: 0.0 }
        };
        let field = radii.iter().map(finalist).collect();
        let track = Track { runner: &mut runner, settings: &own, demand, scale };
        let ranked = race(field, track, 0.0).unwrap();
        assert!(ranked[0].best.tried);
        ranked
    }

    /// Within .4 photons of the bright side of the wall are merged on its dark side.
    #[test]
    fn radii_that_leak_light_through_walls_lose() {
        let open = FreeParameters { strategy: true, ..FreeParameters::NONE };
        for radii in [[0.05, 0.4], [0.4, 0.05]] {
            let ranked = raced("keyhole", open, &radii);
            let radii: Vec<f32> = ranked.iter().map(|own| own.best.radii[0] as f32).collect();
            assert_eq!(radii, [0.05, 0.4]);
        }
    }

    #[test]
    fn paths_that_split_and_other_radii_in_media_join_once() {
        let open = FreeParameters { splitting: true, medium_scale: true, ..FreeParameters::NONE };
        let ranked = raced("smoke", open, &[0.03]);
        assert!(ranked.iter().all(|own| own.best.in_media.share == SHARE));
        let of = |own: &Finalist| (own.model.technique.splitting, own.best.in_media.scale);
        let mut all: Vec<(u32, f64)> = ranked.iter().map(of).collect();
        // Lanes of the leader of the second part may join as well.
        let own = TestScene::new("smoke", [64, 48]).settings.medium_scale;
        for lane in [(1, 0.5 * own), (1, own), (1, 2.0 * own), (SPLITTING, own)] {
            assert!(all.contains(&lane), "{all:?}");
        }
        let count = all.len();
        all.sort_by(|one, other| one.partial_cmp(other).unwrap());
        all.dedup();
        assert_eq!(all.len(), count, "{all:?}");
    }
}
