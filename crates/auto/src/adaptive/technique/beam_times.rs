//! Counts of techniques that merge along segments.
//!
//! A search in cells reads the photons near a point, so that its time is proportional to their
//! number, as the time model has it. A search along segments passes a tree whose boxes shrink as
//! photons get more: its time grows about as the root of their number, and trials have few photons.
//! One iteration of a sample of the pixels with all light paths tells the time there, and the law
//! of the root the time near it.

use super::End;
use super::candidate_cost::{Best, CandidateCost, InMedia, RenderTime};
use super::model::Model;
use super::pilot::Pilot;
use super::trial_runner::{TrialRunner, stride};
use crate::timing::TimeModel;
use bdpm_core::base::error::Result;
use bdpm_core::noise::{Coefficients, Measure};
use bdpm_core::render::RenderConfig;
use bdpm_core::settings::{MediumQuery, Settings};
use std::time::Duration;

/// Measurements at most: each is at the counts that the one before leads to.
pub const MOST_TIMED: u32 = 3;

/// Factor on the number of light paths, or its reciprocal, within which the law is good enough.
const SAME_COUNT: f64 = 1.5;

/// Share of the time of the image that the light paths of one measurement may take.
const SHARE: f64 = 0.01;

/// Camera paths of a measurement.
const TIMED_PATHS: f64 = 4096.0;

/// The smallest number of light paths that is compared. Others are it times powers of the root of
/// 2.
const LEAST_LIGHT_PATHS: f64 = 256.0;

/// Iterations that should fit in the time, and those of images whose camera paths alone take long.
const MANY_ITERATIONS: f64 = 16.0;
const FEW_ITERATIONS: f64 = 3.0;

/// Time of an iteration of those images over that of its camera paths.
const LONGEST_OVER_BASE: f64 = 4.0;

/// Factor on the least squared error up to which counts are nearly as good.
const NEARLY_AS_GOOD: f64 = 1.2;

/// Shares of the merges in media are powers of 1/2 down to this one.
const MOST_HALVINGS: i32 = 6;

/// Relative variance of camera paths that leaving out merges in media adds, times `1/p - 1` for the
/// share `p` of them: as if half of the light came from media in all pixels.
const LIGHT_OF_MEDIA: f64 = 0.25;

/// The coefficients where a share of the merges in media is done, from those where another share
/// is. Trials are too short to tell media from surfaces: all of `a` and `b` counts as that of
/// media. theory.md (37o)
fn coefficients_at(known: &Coefficients, from: f64, to: f64) -> Coefficients {
    let added = |share: f64| LIGHT_OF_MEDIA * (share.recip() - 1.0);
    let b = (known.b - added(from)).max(0.0) * from / to + added(to);
    Coefficients { a: known.a * from / to, b, f: known.f }
}

impl Pilot<'_> {
    /// The best counts and share of the merges of a technique that merges along segments, by at
    /// most `most_timed` measurements of the time of merging; those of `best` for others.
    pub(super) fn with_beam_times(
        &mut self,
        model: &Model,
        mut best: Best,
        most_timed: u32,
    ) -> Result<Best> {
        let technique = model.technique;
        if technique.medium_query != Some(MediumQuery::Beams) {
            return Ok(best);
        }
        let most = match self.demand.end {
            End::Time(time) => SHARE * time,
            End::Error(_) => SHARE * best.seconds,
        };
        let (start_up, coefficients) = (model.time(best.radii).start_up, best.coefficients);
        // Trials or the lane measured the coefficients at this share.
        let known_share = best.in_media.share;
        for _ in 0..most_timed {
            let timed = best.light_paths.min(most / best.times.light_path).max(LEAST_LIGHT_PATHS);
            let own = best.scored(technique).apply(self.settings);
            let settings = Settings { light_paths: timed as u32, ..own };
            let times = self.runner.beam_times(settings, &best.times)?;
            let at = |share: f64, light_paths: f64| {
                let known = (timed, best.in_media.share);
                let times = at_count(&times, known, (light_paths, share));
                let in_media = InMedia { share, ..best.in_media };
                let light_paths = Some(light_paths);
                let demand = CandidateCost { light_paths, in_media, ..self.demand };
                let coefficients = coefficients_at(&coefficients, known_share, share);
                let time = RenderTime { times, start_up };
                model.evaluate(&coefficients, &time, &demand, best.radii)
            };
            let largest = f64::from(self.demand.max_light_paths) / LEAST_LIGHT_PATHS;
            let steps = (2.0 * largest.log2()).max(0.0) as i32;
            let count = |step: i32| LEAST_LIGHT_PATHS * 2f64.powf(0.5 * f64::from(step));
            let shares: Vec<f64> = match self.demand.open.medium_share {
                true => (0..=MOST_HALVINGS).map(|halvings| 0.5f64.powi(halvings)).collect(),
                false => vec![best.in_media.share],
            };
            let of_share = |share: f64| (0..=steps).map(move |step| at(share, count(step)));
            let rank =
                |own: Best| (own.rank(&self.demand) * too_long(&times, &own, &self.demand), own);
            let all = shares.into_iter().flat_map(of_share).map(rank);
            let next = Best { tried: best.tried, ..most_photons(all.collect()) };
            let ratio = next.light_paths / timed;
            best = next;
            if (SAME_COUNT.recip()..SAME_COUNT).contains(&ratio) {
                break;
            }
        }
        Ok(best)
    }
}

/// The best of all; where noise is visible, that with the most light paths of those that are nearly
/// as good. Few of them draw discs and specks, whose noise short trials see too low.
fn most_photons(mut ranked: Vec<(f64, Best)>) -> Best {
    ranked.sort_by(|one, other| one.0.total_cmp(&other.0));
    let (least, best) = ranked[0];
    let near = if best.is_noise_visible() { NEARLY_AS_GOOD } else { 1.0 };
    ranked.retain(|(rank, _)| *rank <= near * least);
    // Of equal numbers, the first one has the least rank.
    let more = |one: Best, (_, other): &(f64, Best)| {
        if other.light_paths > one.light_paths { *other } else { one }
    };
    ranked.iter().fold(best, more)
}

/// Times at a number of light paths and a share of the merges, from those `known` at another pair:
/// the time of a merge grows as the root of the number of light paths.
fn at_count(times: &TimeModel, known: (f64, f64), (light_paths, share): (f64, f64)) -> TimeModel {
    let merge_pair = times.merge_pair * (known.0 / light_paths).sqrt() * share / known.1;
    TimeModel { merge_pair, ..*times }
}

/// Factor on the rank of counts of which too few iterations fit in the time. The law of the root
/// knows no end: more light paths always have less noise in the same time.
fn too_long(times: &TimeModel, own: &Best, demand: &CandidateCost) -> f64 {
    let End::Time(time) = demand.end else { return 1.0 };
    let [base, _] = times.in_light_paths(1.0);
    let longest = (LONGEST_OVER_BASE * base).clamp(time / MANY_ITERATIONS, time / FEW_ITERATIONS);
    (time / own.iterations / longest).max(1.0).powi(4)
}

impl TrialRunner<'_> {
    /// Times of an iteration with these settings on the whole image: those known, with the time of
    /// merging that a sample of the pixels takes with all light paths.
    fn beam_times(&mut self, settings: Settings, known: &TimeModel) -> Result<TimeModel> {
        let n_light = f64::from(settings.light_paths);
        let stride = stride(&settings, TIMED_PATHS);
        let settings = Settings { camera_paths: 1, guide: 0, sobol_set: 1, ..settings };
        let (mut renderer, _) = self.sample(settings, stride, RenderConfig::default())?;
        let before = renderer.area_work();
        let times = renderer.iterate(Measure::Off).times;
        renderer.check_interrupt()?;
        let busy = |time: Duration| time.as_secs_f64() / rayon::current_num_threads() as f64;
        let areas = renderer.area_work().since(before).time;
        let merge = busy(times.merge.saturating_sub(areas));
        let per_path = merge / renderer.settings().pixels() as f64;
        let merge_pair = (per_path - known.look_up).max(0.0) / n_light;
        let light_path = (busy(times.light) / n_light).max(known.light_path);
        Ok(TimeModel { light_path, merge_pair, ..*known })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adaptive::technique::candidate_cost::tests::{IMAGE, demand, time, times};

    #[test]
    fn four_times_the_light_paths_take_twice_the_time_of_merging() {
        let merging = |light_paths: f64, share: f64| {
            let times = at_count(&times(), (1000.0, 1.0), (light_paths, share));
            TimeModel { look_up: 0.0, ..times }.parts(light_paths, 1.0)[3]
        };
        assert!((merging(4000.0, 1.0) / merging(1000.0, 1.0) - 2.0).abs() < 1e-9);
        assert!((merging(4000.0, 0.5) / merging(1000.0, 1.0) - 1.0).abs() < 1e-9);
        assert!((merging(1000.0, 1.0) / (times().merge_pair * 1e4 * 1000.0) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn merges_that_are_left_out_add_noise_of_camera_paths() {
        let all = Coefficients { a: 6.0, b: 1.0, f: 2.0 };
        let quarter = coefficients_at(&all, 1.0, 0.25);
        assert_eq!(quarter, Coefficients { a: 24.0, b: 4.75, f: 2.0 });
        assert_eq!(coefficients_at(&quarter, 0.25, 1.0), all);
        assert_eq!(coefficients_at(&all, 1.0, 1.0), all);
    }

    #[test]
    fn most_light_paths_of_nearly_equal_counts_are_taken_where_noise_is_visible() {
        let merged = Default::default();
        let with = |noise: f64, light_paths: f64| {
            let coefficients = Coefficients { a: 0.0, b: noise, f: 0.0 };
            let demand = CandidateCost { light_paths: Some(light_paths), ..demand(End::Time(1.0)) };
            demand.evaluate(&coefficients, &time(), &merged, [1.0; 2])
        };
        for (noise, expected) in [(1e-6, 100.0), (1e4, 300.0)] {
            let all = [(1.0, 100.0), (1.1, 200.0), (1.15, 300.0), (1.3, 400.0)];
            let all = all.map(|(rank, light_paths)| (rank, with(noise, light_paths)));
            assert_eq!(all[0].1.is_noise_visible(), expected > 100.0);
            assert_eq!(most_photons(all.to_vec()).light_paths, expected);
        }
    }

    /// Camera paths of an iteration of these times take 5.1 ms.
    #[test]
    fn counts_whose_iterations_are_too_long_lose() {
        let factor = |seconds: f64, light_paths: f64| {
            let demand =
                CandidateCost { light_paths: Some(light_paths), ..demand(End::Time(seconds)) };
            let own = demand.evaluate(&IMAGE, &time(), &Default::default(), [1.0; 2]);
            assert_eq!(own.light_paths, light_paths);
            too_long(&times(), &own, &demand)
        };
        // Of 16 s an iteration may take one, of 16 ms four times what camera paths take or a third.
        assert_eq!(factor(16.0, 1e6), 1.0);
        assert!(factor(16.0, 1e7) > 10.0);
        assert_eq!(factor(0.016, 100.0), 1.0);
        assert!(factor(0.016, 2e4) > 2.0);
    }
}
