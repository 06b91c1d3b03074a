//! Penalties of candidates, which their predicted errors do not contain.

use super::Technique;
use bdpm_core::settings::Strategy;
use serde::{Deserialize, Serialize};

/// Penalty on the squared error of techniques that find lamps in rough surfaces only by random
/// sampling, because short trials miss most of that light. In the scene `veach-mis`
/// (docs/measurements/mitsuba-equal-time.md) one of them was predicted 11 % relative error and had
/// 77 %.
const RARE_LIGHT_PENALTY: f64 = 4.0;

/// Penalty on the squared error of techniques that merge: near ties go to path tracing, which has
/// no bias and no photons that a whole image shares. In three interiors where predictions are near
/// ties, the squared error of `mis` was 2.7, 3.1 and 0.73 times that of `path`
/// (docs/measurements/interiors.md).
const MERGING_PENALTY: f64 = 1.4;

/// The same for an image that is denoised. A denoiser removes noise of single pixels; that of
/// photons, which many pixels share, stays and looks like spots of light. In a room where `mis` had
/// 1.4 times the squared error of `path`, it had 3.7 times after denoising
/// (docs/measurements/denoising.md).
const DENOISED_MERGING_PENALTY: f64 = 4.0;

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
    /// Those of a tried technique. Lamps may be seen in rough surfaces, and the image may be denoised.
    pub(super) fn of(technique: Technique, mirrors_lamps_roughly: bool, denoises: bool) -> Self {
        let is_rare = technique.strategy == Strategy::Single && mirrors_lamps_roughly;
        let merging = if denoises { DENOISED_MERGING_PENALTY } else { MERGING_PENALTY };
        Self {
            merging: if technique.merges() { merging } else { 1.0 },
            rare_light: if is_rare { RARE_LIGHT_PENALTY } else { 1.0 },
            untried: 1.0,
        }
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

    fn technique(strategy: Strategy) -> Technique {
        Technique {
            strategy,
            merge_vertex: 2,
            direct: Direct::Connect,
            kernel: Kernel::Area,
            splitting: 1,
            medium_query: None,
        }
    }

    #[test]
    fn photons_must_be_better_by_more_where_the_image_is_denoised() {
        let merging = |strategy, denoises| Penalties::of(technique(strategy), false, denoises);
        for strategy in [Strategy::Single, Strategy::Mis, Strategy::CutMis] {
            let [raw, denoised] = [false, true].map(|denoises| merging(strategy, denoises).total());
            assert!(raw > 1.0 && denoised > 2.0 * raw, "{strategy:?}");
        }
        for denoises in [false, true] {
            assert_eq!(merging(Strategy::Path, denoises), Penalties::default());
        }
        let rare = Penalties::of(technique(Strategy::Single), true, false);
        assert!(rare.total() > merging(Strategy::Single, false).total());
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
