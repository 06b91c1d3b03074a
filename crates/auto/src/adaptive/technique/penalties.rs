//! Penalties of candidates, which their predicted errors do not contain.

use super::Technique;
use crate::adaptive::denoised_noise::shares_photons;
use serde::{Deserialize, Serialize};

/// Penalty on the squared error of techniques that merge: near ties go to path tracing, which has
/// no bias and no photons that a whole image shares. Short trials see too few of the photons that
/// make most of the noise, and predict less of it. In five of six interiors the squared error of
/// `mis` was 1.4 to 3.6 times that of `path`. In `dining-room` that of `single` was twice as large
/// (docs/measurements/interiors.md).
const MERGING_PENALTY: f64 = 4.0;

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
    /// For a prediction that no trial has confirmed.
    pub untried: f64,
}

impl Default for Penalties {
    /// No penalty.
    fn default() -> Self {
        Self { merging: 1.0, untried: 1.0 }
    }
}

impl Penalties {
    /// Those of a tried technique. The image may be denoised.
    pub(super) fn of(technique: Technique, denoises: bool) -> Self {
        let is_shared = shares_photons(technique.strategy, technique.merge_vertex);
        let shared = if denoises && is_shared { SHARED_PHOTONS_PENALTY } else { 1.0 };
        let merging = if technique.merges() { MERGING_PENALTY * shared } else { 1.0 };
        Self { merging, untried: 1.0 }
    }

    /// Product of all factors.
    pub fn total(&self) -> f64 {
        self.merging * self.untried
    }

    /// The reasons in words, as main clauses that `and` joins. Empty without a penalty.
    pub fn reasons(&self) -> String {
        let all = [
            (self.untried, "it was never tried at these radii"),
            (self.merging, "near ties go to path tracing"),
        ];
        let given = all.iter().filter(|(factor, _)| *factor > 1.0);
        given.map(|(_, reason)| *reason).collect::<Vec<_>>().join(" and ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::settings::{Direct, Kernel, Strategy};

    #[test]
    fn techniques_that_merge_must_be_clearly_better() {
        let technique = |strategy| Technique {
            strategy,
            merge_vertex: 2,
            direct: Direct::Connect,
            kernel: Kernel::Area,
            splitting: 1,
            medium_query: None,
        };
        let penalty = |strategy| Penalties::of(technique(strategy), false).total();
        assert_eq!(penalty(Strategy::Path), 1.0);
        assert!(penalty(Strategy::Single) > 1.0);
        assert_eq!(penalty(Strategy::Mis), penalty(Strategy::Single));
        let denoised = |strategy| Penalties::of(technique(strategy), true).total();
        assert!(denoised(Strategy::Mis) > penalty(Strategy::Mis));
        // It merges where no other pixel sees it.
        assert_eq!(denoised(Strategy::Single), penalty(Strategy::Single));
    }

    #[test]
    fn total_is_the_product_and_reasons_are_those_of_factors_above_one() {
        let none = Penalties::default();
        assert_eq!((none.total(), &none.reasons()[..]), (1.0, ""));
        let untried = Penalties { untried: 2.0, ..none };
        assert_eq!(untried.reasons(), "it was never tried at these radii");
        let all = Penalties { merging: 1.5, ..untried };
        assert_eq!((all.total(), all.reasons().matches(" and ").count()), (3.0, 1));
    }
}
