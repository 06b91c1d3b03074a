//! Penalties of candidates, which their predicted errors do not contain.

use serde::{Deserialize, Serialize};

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
