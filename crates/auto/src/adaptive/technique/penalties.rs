//! Penalties of candidates, which their predicted errors do not contain.

use super::Technique;
use crate::adaptive::denoised_noise::shares_photons;
use bdpm_core::settings::Strategy;
use serde::{Deserialize, Serialize};

/// Penalty on the squared error of techniques that find lamps in rough surfaces only by random
/// sampling, because short trials miss most of that light. It replaces [`MERGING_PENALTY`]. In the
/// public scene `veach-mis` one of them was predicted 11 % relative error and had 77 %.
const RARE_LIGHT_PENALTY: f64 = 4.0;

/// Penalty on the squared error of techniques that merge: near ties go to path tracing, which has
/// no bias and no photons that a whole image shares.
const MERGING_PENALTY: f64 = 2.0;

/// [`MERGING_PENALTY`] of techniques that weigh merges against connections. In five of six
/// interiors the squared error of `mis` was 1.4 to 3.6 times that of `path`: trials predict it too
/// low (docs/measurements/interiors.md).
const WEIGHTED_PENALTY: f64 = 4.0;

/// Further penalty where an image is denoised and pixels share the photons. Short trials see few
/// of the photons that make spots: in scenes/materials, `mis` was predicted 5 % and had 8 %, final
/// gathering 6 % and 4 % (docs/measurements/denoising.md).
const SHARED_PHOTONS_PENALTY: f64 = 1.4;

/// Factors on the squared error of a candidate where candidates are compared. A factor of 1 is no
/// penalty. If an error ends the render, they are factors on the time of the candidate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Penalties {
    /// For merged photons.
    pub merging: f64,
    /// For light that short trials miss.
    pub rare_light: f64,
    /// For a prediction that no trial has confirmed.
    pub untried: f64,
}

impl Default for Penalties {
    /// No penalty.
    fn default() -> Self {
        Self { merging: 1.0, rare_light: 1.0, untried: 1.0 }
    }
}

impl Penalties {
    /// Those of a tried technique. Lamps may be seen in rough surfaces, and the image may be
    /// denoised.
    pub(super) fn of(technique: Technique, mirrors_lamps_roughly: bool, denoises: bool) -> Self {
        let is_rare = technique.strategy == Strategy::Single && mirrors_lamps_roughly;
        let is_shared = shares_photons(technique.strategy, technique.merge_vertex);
        let shared = if denoises && is_shared { SHARED_PHOTONS_PENALTY } else { 1.0 };
        let merging = match technique.merges() {
            true if technique.strategy.is_weighted() => WEIGHTED_PENALTY * shared,
            // Short trials are the reason for both penalties.
            true if is_rare => shared,
            true => MERGING_PENALTY * shared,
            false => 1.0,
        };
        Self { merging, rare_light: if is_rare { RARE_LIGHT_PENALTY } else { 1.0 }, untried: 1.0 }
    }

    /// Product of all factors.
    pub fn total(&self) -> f64 {
        self.merging * self.rare_light * self.untried
    }

    /// The reasons in words, as main clauses that `and` joins. Empty without a penalty.
    pub fn reasons(&self) -> String {
        let all = [
            (self.untried, "it was never tried at these radii"),
            (self.rare_light, "short trials miss lamps in rough surfaces"),
            (self.merging, "near ties go to path tracing"),
        ];
        let given = all.iter().filter(|(factor, _)| *factor > 1.0);
        given.map(|(_, reason)| *reason).collect::<Vec<_>>().join(" and ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::settings::{Direct, Kernel};

    #[test]
    fn techniques_that_merge_must_be_better_and_those_that_miss_lamps_by_more() {
        let technique = |strategy| Technique {
            strategy,
            merge_vertex: 2,
            direct: Direct::Connect,
            kernel: Kernel::Area,
            splitting: 1,
            medium_query: None,
        };
        let penalty = |strategy, rough| Penalties::of(technique(strategy), rough, false).total();
        assert_eq!(penalty(Strategy::Path, true), 1.0);
        assert!(penalty(Strategy::Mis, true) > 1.0);
        assert_eq!(penalty(Strategy::Mis, true), penalty(Strategy::Mis, false));
        // One doubt about short trials, not two.
        assert_eq!(penalty(Strategy::Single, true), RARE_LIGHT_PENALTY);
        assert!(penalty(Strategy::Single, true) > penalty(Strategy::Single, false));
        let denoised = |strategy| Penalties::of(technique(strategy), false, true).total();
        assert!(denoised(Strategy::Mis) > penalty(Strategy::Mis, false));
        // It merges where no other pixel sees it.
        assert_eq!(denoised(Strategy::Single), penalty(Strategy::Single, false));
    }

    #[test]
    fn total_is_the_product_and_reasons_are_those_of_factors_above_one() {
        let none = Penalties::default();
        assert_eq!((none.total(), &none.reasons()[..]), (1.0, ""));
        let untried = Penalties { untried: 2.0, ..none };
        assert_eq!(untried.reasons(), "it was never tried at these radii");
        let all = Penalties { merging: 1.5, rare_light: 4.0, ..untried };
        assert_eq!((all.total(), all.reasons().matches(" and ").count()), (12.0, 2));
    }
}
