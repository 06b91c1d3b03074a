//! Chooses the radii of merges in media, over those at surfaces.
//!
//! Trials at the radii of the best candidate, with half and with twice its scale, tell how noise
//! and time depend on the scale. In the second only merges in media have nested radii, which
//! measures their bias alone. theory.md (93j)

use super::beam_times::MOST_TIMED;
use super::bias_law::{BiasLaw, BiasPrior};
use super::candidate_cost::{Best, CandidateCost, ClassBias, InMedia, RenderTime};
use super::model::{ImageScale, Model};
use super::pilot::{Finalist, Pilot};
use super::trial::Trial;
use crate::timing::TimeModel;
use bdpm_core::base::error::Result;
use bdpm_core::noise::Coefficients;
use bdpm_core::render::NestedPart;
use bdpm_core::settings::{MEDIUM_SCALES, MediumQuery, Settings};
use bdpm_core::transport::kernel::ByClass;
use bdpm_core::transport::photon::PhotonClass;
use std::ops::RangeInclusive;

/// Scales of the trials over that of the candidate.
const TRIED: [f64; 2] = [0.5, 2.0];

/// Steps of the scale that are compared: powers of the root of 2.
const STEPS: RangeInclusive<i32> = -4..=4;

/// Another scale is worth it if its squared error, or its time, is less than this share.
const WORTHWHILE: f64 = 0.95;

/// The scale of a step.
fn scale_at(own: f64, step: i32) -> f64 {
    own * 2f64.powf(0.5 * f64::from(step))
}

/// A quantity that changes from scale to scale: a constant and a power of the scale.
#[derive(Clone, Copy, Debug)]
struct Power {
    constant: f64,
    /// At the scale 1.
    varying: f64,
    exponent: i32,
}

impl Power {
    /// Through the values at two scales. No part is below 0.
    fn through(exponent: i32, [one, other]: [(f64, f64); 2]) -> Self {
        let power = |scale: f64| scale.powi(exponent);
        let varying = (one.1 - other.1) / (power(one.0) - power(other.0));
        let most = (one.1 / power(one.0)).min(other.1 / power(other.0));
        let varying = varying.clamp(0.0, most.max(0.0));
        // Where a part is cut off, the mean of both values counts.
        let rest = [one, other].map(|(scale, value)| value - varying * power(scale));
        Self { constant: (0.5 * (rest[0] + rest[1])).max(0.0), varying, exponent }
    }

    fn at(&self, scale: f64) -> f64 {
        self.constant + self.varying * scale.powi(self.exponent)
    }
}

/// Noise, bias and time of a candidate as functions of the scale.
struct ScaleModel {
    /// Second moment of the pairs, relative: `a + f`.
    pairs: Power,
    /// Light main effect, relative.
    light: Power,
    /// Camera main effect, relative.
    camera: f64,
    /// Bias of merges in media by their radius.
    bias: BiasLaw,
    /// Time per pair.
    merge_pair: Power,
    times: TimeModel,
    /// The larger merge radius at surfaces, scene units.
    reach: f64,
    /// Biases of the classes at the scale of the candidate.
    merged: ByClass<ClassBias>,
    own_scale: f64,
}

impl ScaleModel {
    fn new(
        model: &Model,
        best: &Best,
        trials: [&Trial; 2],
        weights: &[f64],
        image: ImageScale,
    ) -> Self {
        let scales = TRIED.map(|factor| factor * best.in_media.scale);
        let exponent = match model.technique.medium_query {
            Some(MediumQuery::Points) => 3,
            _ => 2,
        };
        let [small, large] = trials.map(|trial| trial.relative(weights).clamped());
        let through = |exponent, values: [f64; 2]| {
            Power::through(exponent, [(scales[0], values[0]), (scales[1], values[1])])
        };
        let reach = best.radii[0].max(best.radii[1]);
        let widest = reach * scales[1];
        let prior =
            BiasPrior::new(PhotonClass::Diffuse, model.technique, widest / image.image_width());
        Self {
            pairs: through(-exponent, [small.a + small.f, large.a + large.f]),
            light: through(-exponent, [small.f, large.f]),
            camera: 0.5 * (small.b + large.b),
            bias: BiasLaw::measured(trials[1], widest, weights, prior),
            merge_pair: through(exponent, trials.map(|trial| trial.times.merge_pair)),
            times: best.times(),
            reach,
            merged: model.merged(best.radii),
            own_scale: best.in_media.scale,
        }
    }

    fn coefficients(&self, scale: f64) -> Coefficients {
        let pairs = self.pairs.at(scale);
        let f = self.light.at(scale).min(pairs);
        Coefficients { a: pairs - f, b: self.camera, f }.clamped()
    }

    /// Biases of the classes. That of media is part of both, and the rest does not depend on the
    /// scale.
    fn merged(&self, scale: f64) -> ByClass<ClassBias> {
        let in_media = |scale: f64| self.bias.at(self.reach * scale)[0];
        let all: f64 = self.merged.iter().map(|own| own.square).sum();
        let rest = (all - in_media(self.own_scale)).max(0.0);
        let factor = if all > 0.0 { (rest + in_media(scale)) / all } else { 1.0 };
        self.merged.map(|own| ClassBias {
            square: factor * own.square,
            error: factor * own.error,
            ..own
        })
    }

    fn times(&self, scale: f64) -> TimeModel {
        TimeModel { merge_pair: self.merge_pair.at(scale), ..self.times }
    }
}

impl Pilot<'_> {
    /// Chooses the scale in media of the best candidate.
    pub(super) fn try_medium_scales(
        &mut self,
        Finalist { model, best, .. }: &mut Finalist,
        weights: &[f64],
        seconds: f64,
    ) -> Result<()> {
        if !self.demand.open.medium_scale || model.technique.medium_query.is_none() {
            return Ok(());
        }
        let settings = best.settings(self.settings, model.technique);
        let limit = |step: &i32| scale_at(settings.medium_scale, *step);
        if ![STEPS.start(), STEPS.end()].map(limit).iter().all(|own| MEDIUM_SCALES.contains(own)) {
            return Ok(()); // Settings at the bounds are kept.
        }
        let mut trial = |factor: f64, nests: Option<NestedPart>| {
            let medium_scale = factor * settings.medium_scale;
            self.trial(&Settings { medium_scale, ..settings.clone() }, nests, seconds)
        };
        let [small, large] = TRIED;
        let trials = [trial(small, None)?, trial(large, Some(NestedPart::Media))?];
        let [small, large] = &trials;
        let scales = ScaleModel::new(model, best, [small, large], weights, self.scale());
        let at = |scale: f64| {
            let coefficients = scales.coefficients(scale);
            let start_up = model.time(best.radii).start_up;
            let time = RenderTime { times: scales.times(scale), start_up };
            let merged = scales.merged(scale);
            let in_media = InMedia { scale, ..best.in_media };
            let demand = CandidateCost { in_media, ..self.demand };
            let own = model.seen(best.radii);
            let mut own = demand.evaluate_image(own, &coefficients, &time, &merged, best.radii);
            own.tried = best.tried;
            own
        };
        let rank = |own: &Best| own.rank(&self.demand);
        let own = at(best.in_media.scale);
        let all = STEPS.map(|step| at(scale_at(best.in_media.scale, step)));
        let other = all.min_by(|one, other| rank(one).total_cmp(&rank(other)));
        if let Some(other) = other.filter(|other| rank(other) < WORTHWHILE * rank(&own)) {
            *best = self.with_beam_times((model, model.technique), other, MOST_TIMED)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_go_through_both_values() {
        let own = Power::through(-3, [(1.0, 5.0), (2.0, 1.5)]);
        assert!((own.at(1.0) - 5.0).abs() < 1e-12 && (own.at(2.0) - 1.5).abs() < 1e-12);
        assert!((own.constant - 1.0).abs() < 1e-12, "{own:?}");
        // Noise may ask for a growing or a steeper quantity.
        let growing = Power::through(-2, [(1.0, 1.0), (2.0, 1.2)]);
        assert_eq!((growing.constant, growing.varying), (1.1, 0.0));
        let steep = Power::through(-2, [(1.0, 8.0), (2.0, 1.0)]);
        assert!(steep.constant >= 0.0 && steep.varying >= 0.0, "{steep:?}");
        assert!(steep.at(1.0) > 4.0 && steep.at(2.0) >= 1.0, "{steep:?}");
    }
}
