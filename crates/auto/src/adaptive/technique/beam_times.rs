//! Counts of techniques that merge along segments.
//!
//! A search in cells reads the photons near a point, so that its time is proportional to their
//! number, as the time model has it. A search along segments passes a tree whose boxes shrink as
//! photons get more: its time grows about as the root of their number, and trials have few photons.
//! One iteration of a sample of the pixels with all light paths tells the time there, and the law
//! of the root the time near it.

use super::End;
use super::candidate_cost::{Best, CandidateCost, RenderTime};
use super::model::Model;
use super::pilot::Pilot;
use super::trial_runner::{TrialRunner, stride};
use crate::timing::TimeModel;
use bdpm_core::base::error::Result;
use bdpm_core::noise::Measure;
use bdpm_core::render::RenderConfig;
use bdpm_core::settings::{MediumQuery, Settings};
use std::time::Duration;

/// Measurements at most: each is at the counts that the one before leads to.
const MOST_TIMED: u32 = 3;

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

impl Pilot<'_> {
    /// The best counts of a technique that merges along segments, by the times that merging takes
    /// there; those of `best` for others.
    pub(super) fn with_beam_times(&mut self, model: &Model, mut best: Best) -> Result<Best> {
        let technique = model.technique;
        if technique.medium_query != Some(MediumQuery::Beams) {
            return Ok(best);
        }
        let most = match self.demand.end {
            End::Time(time) => SHARE * time,
            End::Error(_) => SHARE * best.seconds,
        };
        let demand = CandidateCost { medium_scale: best.medium_scale, ..self.demand };
        let (start_up, coefficients) = (model.time(best.radii).start_up, best.coefficients);
        for _ in 0..MOST_TIMED {
            let n_light = best.light_paths.min(most / best.times.light_path).max(LEAST_LIGHT_PATHS);
            let settings = Settings {
                light_paths: n_light as u32,
                ..best.scored(technique).apply(self.settings)
            };
            let times = self.runner.beam_times(settings, &best.times)?;
            let at = |light_paths: f64| {
                let time = RenderTime { times: at_count(&times, n_light, light_paths), start_up };
                let demand = CandidateCost { light_paths: Some(light_paths), ..demand };
                model.evaluate(&coefficients, &time, &demand, best.radii)
            };
            let largest = f64::from(demand.max_light_paths) / LEAST_LIGHT_PATHS;
            let steps = (2.0 * largest.log2()).max(0.0) as i32;
            let all =
                (0..=steps).map(|step| at(LEAST_LIGHT_PATHS * 2f64.powf(0.5 * f64::from(step))));
            let rank = |own: &Best| own.rank(&demand) * too_long(&times, own, &demand);
            let next = all.min_by(|one, other| rank(one).total_cmp(&rank(other)));
            let next = Best { tried: best.tried, ..next.expect("there is a step") };
            let ratio = next.light_paths / n_light;
            best = next;
            if (SAME_COUNT.recip()..SAME_COUNT).contains(&ratio) {
                break;
            }
        }
        Ok(best)
    }
}

/// Times at a number of light paths, from those at another one: the time of merging a camera path
/// grows as the root of the number.
fn at_count(times: &TimeModel, known: f64, light_paths: f64) -> TimeModel {
    TimeModel { merge_pair: times.merge_pair * (known / light_paths).sqrt(), ..*times }
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
        let merging = |light_paths: f64| {
            let times = TimeModel { look_up: 0.0, ..at_count(&times(), 1000.0, light_paths) };
            times.parts(light_paths, 1.0)[3]
        };
        assert!((merging(4000.0) / merging(1000.0) - 2.0).abs() < 1e-9);
        assert!((merging(1000.0) / (times().merge_pair * 1e4 * 1000.0) - 1.0).abs() < 1e-9);
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
