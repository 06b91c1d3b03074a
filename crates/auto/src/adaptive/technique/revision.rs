//! Revises the choice of the pilot from the first iterations of the image.
//!
//! The pilot has a small part of the time and a sample of the pixels. After an eighth of the time,
//! the image itself knows its noise, its times and its merge bias much better. If the image would
//! then have a clearly smaller error with other radii or with another technique, although it starts
//! from the beginning, it does. Its first iterations were a longer pilot: theory.md (93g).

use super::candidate_cost::CandidateCost;
use super::model::{ImageMeasurement, ImageScale};
use super::pilot::Finalist;
use super::trial::BIAS_TOLERANCE;
use super::{Candidate, End, Penalties, Selection};
use crate::adaptive::count_choice::fitted_times;
use crate::adaptive::optimize::Objective;
use crate::adaptive::stopping::importance;
use crate::timing::TimeModel;
use bdpm_core::noise::Coefficients;
use bdpm_core::render::Renderer;
use bdpm_core::render::annulus_moments::annulus_bias2;
use bdpm_core::render::block;
use bdpm_core::render::block::{Block, CombinedImage};
use bdpm_core::settings::Settings;
use bdpm_core::transport::photon::PhotonClass;
use serde::{Deserialize, Serialize};

/// Shares of the rendering time after which the choice may be revised. Later, starting again costs
/// more than other settings gain.
const CHECKS: [f64; 2] = [0.125, 0.25];

/// Minimum iterations of the image, so that half of the folds of the bias hold several.
const MIN_ITERATIONS: u64 = 8;

/// The image starts again if that leaves less than this share of the squared error, or of the time.
const WORTHWHILE: f64 = 0.75;

/// Factor on the predicted squared error of a technique that was tried on a sample of the pixels
/// only.
const SAMPLED: f64 = 2.0;

/// Factor for one that was never tried at its radii.
const UNTRIED: f64 = 4.0;

/// Factor on the squared error of other techniques that merge, once one was refuted: they may have
/// the same fault. Path tracing is what refuted it.
const DOUBT: f64 = 4.0;

/// A technique that an audit of the image refuted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Refuted {
    /// Rendering time until then, seconds, from the first iteration of the image.
    pub after: f64,
    /// The technique at its radii.
    pub instead_of: Candidate,
    /// Relative difference between its image and the audit.
    pub difference: f64,
}

/// A revised choice.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Revised {
    /// Rendering time until then, seconds, from the first iteration of the image.
    pub after: f64,
    /// The choice of the pilot, with the error or time that it would have led to by the
    /// measurements of the image.
    pub instead_of: Candidate,
}

/// Results of the pilot that the first iterations of the image check.
pub struct Revision {
    finalists: Vec<Finalist>,
    demand: CandidateCost,
    scale: ImageScale,
    /// Number of checks that were made.
    checks: usize,
}

/// Time that an image has had, and that it has left.
#[derive(Clone, Copy, Debug)]
pub struct TimeShare {
    /// Rendering time from the first iteration of the image, seconds.
    pub done: f64,
    /// Time until the end, seconds; `None` if an error ends the render.
    pub left: Option<f64>,
}

impl Revision {
    /// A revision of a choice among `finalists`, the best first.
    pub(super) fn new(finalists: Vec<Finalist>, demand: CandidateCost, scale: ImageScale) -> Self {
        Self { finalists, demand, scale, checks: 0 }
    }

    /// Predicted noise of the choice before it is denoised, relative.
    pub fn noise_before_denoising(&self) -> f64 {
        self.finalists[0].best.noise_before_denoising()
    }

    /// Whether the choice should be checked. `expected_left` is the forecast of the time that is
    /// left, seconds.
    pub fn is_due(&self, renderer: &Renderer, done: f64, expected_left: f64) -> bool {
        let check = CHECKS.get(self.checks);
        let has_begun = renderer.iterations() >= MIN_ITERATIONS;
        has_begun && check.is_some_and(|share| done >= share * (done + expected_left))
    }

    /// The demand on a render of this many seconds by all processes. An error stays the same.
    fn demand_in(&self, seconds: f64) -> CandidateCost {
        let end = match self.demand.end {
            End::Time(_) => End::Time(seconds * f64::from(self.demand.ranks)),
            error => error,
        };
        CandidateCost { end, ..self.demand }
    }

    /// The best choice without the technique of the `selection`, which an audit refuted by this
    /// relative difference; `None` if no other was tried.
    pub fn without_refuted(
        &mut self,
        selection: &Selection,
        time: TimeShare,
        difference: f64,
    ) -> Option<Selection> {
        let instead_of = *selection.best();
        let again = self.demand_in(time.left.unwrap_or(0.0));
        let is_other = |own: &Finalist| own.model.technique != instead_of.technique;
        let rank = |own: &Finalist| {
            let doubt = if own.model.technique.merges() { DOUBT } else { 1.0 };
            doubt * own.best.after(&self.demand, &again).rank(&again) * own.penalties.total()
        };
        let others = self.finalists.iter().enumerate().filter(|(_, own)| is_other(own));
        let (index, _) = others.min_by(|(_, a), (_, b)| rank(a).total_cmp(&rank(b)))?;
        let next = self.finalists.swap_remove(index);
        self.finalists.retain(is_other);
        let best =
            next.best.after(&self.demand, &again).scored(next.model.technique, next.penalties);
        self.finalists.insert(0, next);
        self.checks = CHECKS.len();
        let mut candidates = selection.candidates.clone();
        candidates.retain(|own| own.technique != best.technique);
        candidates.insert(0, best);
        let refuted = Some(Refuted { after: time.done, instead_of, difference });
        Some(Selection { candidates, revised: None, refuted, ..selection.clone() })
    }

    /// The choice by all that the image has measured, if it is worth starting again. `selection` is
    /// the present choice.
    pub fn revise(
        &mut self,
        renderer: &Renderer,
        selection: &Selection,
        time: TimeShare,
    ) -> Option<Selection> {
        self.checks += 1;
        let measured = measure(renderer, &selection.best().times)?;
        let TimeShare { done, left } = time;
        let left = left.unwrap_or(0.0);
        let present = &self.finalists[0];
        // The image has measured its technique at the radii in media that were chosen for it.
        let medium_scale = present.best.medium_scale;
        let [whole, again] = [done + left, left]
            .map(|seconds| CandidateCost { medium_scale, ..self.demand_in(seconds) });
        let model = present.model.matched(&measured.image, self.scale);
        let mut same = CandidateCost { requested: measured.image.radii.map(|r| r as f32), ..whole };
        (same.open.radius, same.open.caustic_radius) = (false, false);
        let going_on = model.best(&same);
        // Rendering time that going on would take, or the error it would leave.
        let rank_of_going_on = match self.demand.end {
            End::Time(_) => going_on.rank(&same),
            End::Error(_) => (going_on.rank(&same) - done * f64::from(self.demand.ranks)).max(0.0),
        };
        // The pilot missed light if the image has more noise than it predicted; others may have
        // missed it as well.
        let surprise = (going_on.rank(&same) / present.best.rank(&self.demand)).max(1.0).sqrt();
        let own = model.best(&again);
        // The bias at larger radii is not known: light may leak through walls there.
        let grows =
            own.radii.iter().zip(measured.image.radii).any(|(own, present)| *own > 1.001 * present);
        // The image has measured the present choice.
        let measured_penalties = Penalties { untried: 1.0, ..present.penalties };
        let rank = if grows { f64::INFINITY } else { own.rank(&again) };
        let mut best = (rank, 0, own, measured_penalties);
        for (index, finalist) in self.finalists.iter().enumerate().skip(1) {
            if finalist.luminance < (1.0 - BIAS_TOLERANCE) * measured.least_luminance {
                continue; // Its trials missed light that the image has found.
            }
            let other = finalist.best.after(&self.demand, &again);
            let caution = if other.tried { SAMPLED } else { UNTRIED };
            let penalties = Penalties { untried: caution * surprise, ..finalist.penalties };
            let rank = other.rank(&again) * penalties.total() / measured_penalties.total();
            if rank < best.0 {
                best = (rank, index, other, penalties);
            }
        }
        let (rank, index, other, penalties) = best;
        let is_worthwhile = rank < WORTHWHILE * rank_of_going_on;
        if !is_worthwhile {
            return None; // Also if a rank is not a number.
        }
        self.checks = CHECKS.len();
        let mut candidates: Vec<Candidate> = selection.candidates.clone();
        let instead_of = going_on.scored(present.model.technique, measured_penalties);
        candidates[0] = instead_of;
        candidates.insert(0, other.scored(self.finalists[index].model.technique, penalties));
        let revised = Some(Revised { after: done, instead_of });
        Some(Selection { candidates, revised, ..selection.clone() })
    }
}

/// Measurements of the image so far.
struct Measured {
    image: ImageMeasurement,
    /// Mean luminance less two standard errors, as if all pixels saw the same photons, W/(m^2 sr).
    least_luminance: f64,
}

/// `None` before noise and times are known.
fn measure(renderer: &Renderer, pilot_times: &TimeModel) -> Option<Measured> {
    let blocks = renderer.blocks();
    let importance = importance(blocks, Objective::Relative);
    let weights = block::weights(blocks, &importance);
    let coefficients = block::coefficients(blocks)?;
    let cells = coefficients.len() as f64;
    let weighted = |(own, weight): (&Coefficients, &f64)| *own * *weight;
    let relative: Coefficients = coefficients.iter().zip(&importance).map(weighted).sum();
    let relative = relative * cells.recip();
    // All iterations are sampled, and only some measure coefficients: rare light is in the former.
    let Block { film, counts, .. } = renderer.block();
    let sampled = film.cell_variance()?;
    let sampled: f64 = sampled.iter().zip(&importance).map(|(own, weight)| own * weight).sum();
    let sampled = sampled * film.iterations as f64 / cells;
    let predicted = relative.variance(f64::from(counts.light_paths), counts.camera_paths.mean());
    let more_noise = (sampled / predicted).max(1.0);
    let annulus_bias2 = annulus_bias2(blocks, &weights, &importance);
    let image = CombinedImage::new(blocks, weights);
    let (variance, _) = image.pooled_variance()?;
    let light_paths =
        |block: &Block| f64::from(block.counts.light_paths) * block.film.iterations as f64;
    let f = coefficients.iter().map(|own| own.f.max(0.0)).sum::<f64>() / cells;
    let error2 = variance / cells + f / blocks.iter().map(light_paths).sum::<f64>();
    let Settings { radius, caustic_radius, .. } = *renderer.settings();
    let mut radii = [f64::from(radius); 2];
    radii[PhotonClass::Caustic as usize] = f64::from(caustic_radius);
    Some(Measured {
        image: ImageMeasurement {
            radii,
            coefficients: relative * (more_noise * image.set_factor()),
            annulus_bias2,
            times: fitted_times(pilot_times, blocks),
        },
        least_luminance: image.mean_luminance() - 2.0 * error2.sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adaptive::technique::{FreeParameters, pilot};
    use bdpm_core::noise::Measure;
    use bdpm_core::scene::backend::{Backend, build};
    use bdpm_core::settings::{Bias, PartialSettings};
    use bdpm_load::load;

    /// The radius of a revised choice over that of an image that merges within this radius, or
    /// within that of the pilot. The render is so long that bias decides, however fast the machine.
    fn revised_radius(radius: Option<f32>) -> Option<f32> {
        const SECONDS: f64 = 1e5;
        let loaded =
            load(format!("{}/../../scenes/cornell-box", env!("CARGO_MANIFEST_DIR"))).unwrap();
        let given = PartialSettings {
            resolution: Some([24, 24]),
            strategy: Some(bdpm_core::settings::Strategy::Single),
            bias: Some(Bias::Reduce),
            ..PartialSettings::default()
        };
        let settings = Settings::resolve(&given, &loaded.defaults, loaded.scene.size()).unwrap();
        let accel = build(Backend::Bvh, &loaded.scene).unwrap();
        let renderer = Renderer::new(&loaded.scene, &accel, settings.clone()).unwrap();
        let open = FreeParameters {
            radius: true,
            caustic_radius: true,
            bias: true,
            ..FreeParameters::NONE
        };
        let (selection, mut revision) =
            pilot::run(&renderer, open, End::Time(SECONDS), 0.5, false).unwrap();
        // As if the pilot had chosen it: a revision keeps the scale with which the image was
        // measured.
        revision.finalists[0].best.medium_scale = 3.0;
        let chosen = selection.apply(&settings);
        let radius = radius.unwrap_or(chosen.radius);
        let settings = Settings {
            light_paths: 2000,
            camera_paths: 2,
            radius,
            caustic_radius: radius,
            ..chosen
        };
        let mut renderer = renderer.with_settings(settings.clone()).unwrap();
        for _ in 0..40 {
            renderer.iterate(Measure::Pairs);
            renderer.iterate(Measure::Off);
        }
        let is_due = |revision: &Revision, share: f64| {
            revision.is_due(&renderer, share * SECONDS, (1.0 - share) * SECONDS)
        };
        assert!(!is_due(&revision, 0.1) && is_due(&revision, 0.13));
        let time = TimeShare { done: 0.1 * SECONDS, left: Some(0.9 * SECONDS) };
        let revised = revision.revise(&renderer, &selection, time)?;
        assert_eq!(revised.candidates.len(), selection.candidates.len() + 1);
        assert_eq!(revised.revised.unwrap().instead_of.medium_scale, 3.0);
        if revised.best().technique == selection.best().technique {
            assert_eq!(revised.best().medium_scale, 3.0);
        }
        assert!(!is_due(&revision, 0.3), "an image starts again once");
        Some(revised.best().radius / settings.radius)
    }

    #[test]
    fn an_image_with_far_too_large_radii_starts_again_with_smaller_ones() {
        // A quarter of the box.
        let radius = revised_radius(Some(140.0)).expect("its bias is many times the error");
        assert!(radius < 0.5, "{radius}");
    }

    #[test]
    fn an_image_as_the_pilot_chose_it_goes_on() {
        assert_eq!(revised_radius(None), None);
    }
}
