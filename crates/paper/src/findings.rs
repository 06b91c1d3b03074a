//! Quantities here and in the paper, and the verdict whether they agree.

use bdpm_auto::adaptive::optimize::predict::Predicted;
use bdpm_core::image_io::number;
use serde::Serialize;

/// A comparison of a quantity here and in the paper.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    /// Figure or table of the paper.
    pub topic: Topic,
    /// The quantity, without unit.
    pub name: String,
    /// As printed in the paper.
    pub printed: f64,
    /// Value that other printed numbers imply.
    pub implied: Option<f64>,
    /// Measured here.
    pub here: Predicted,
    /// Largest difference that counts as agreement: the paper leaves some values open.
    pub tolerance: f64,
    /// Result of the comparison.
    pub verdict: Verdict,
    /// Reason of the difference, or basis of the verdict.
    pub reason: String,
}

/// Figure or table that a finding belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Topic {
    /// Figure 2.
    Formula,
    /// Figure 3.
    Terms,
    /// Figure 3, from `N_B = 25` to `100`.
    Halving,
    /// Table 2, its row of the RMS of one iteration.
    LightPaths,
    /// Figure 4 and Table 1.
    Minimum,
}

/// Whether a quantity agrees with the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// As printed.
    Same,
    /// Not as printed, but as other printed numbers imply.
    AsImplied,
    /// Neither as printed nor as implied.
    Different,
    /// The standard error is too large for a verdict.
    Uncertain,
}

impl Topic {
    /// Heading of the topic.
    pub const fn title(self) -> &'static str {
        match self {
            Self::Formula => "Formula (1) against the sampled noise (Figure 2)",
            Self::Terms => "The three terms over their sum (Figure 3)",
            Self::Halving => "From 25 to 100 camera paths (Figure 3)",
            Self::LightPaths => "More light paths (Table 2)",
            Self::Minimum => "The minimum (Figure 4, Table 1)",
        }
    }
}

impl Verdict {
    /// The verdict in words.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Same => "same",
            Self::AsImplied => "as implied",
            Self::Different => "different",
            Self::Uncertain => "uncertain",
        }
    }

    /// Judges `here` by the printed and the implied value.
    fn new(here: Predicted, printed: f64, implied: Option<f64>, tolerance: f64) -> Self {
        let Some(error) = here.error else { return Self::Uncertain };
        let distance = |to: f64| (here.value - to).abs();
        // Written so that NaN is uncertain.
        if error <= tolerance && distance(printed) <= tolerance {
            Self::Same
        } else if error <= tolerance && implied.is_some_and(|x| distance(x) <= tolerance) {
            Self::AsImplied
        } else if [Some(printed), implied]
            .into_iter()
            .flatten()
            .all(|x| distance(x) > tolerance + 2.0 * error)
        {
            Self::Different
        } else {
            Self::Uncertain
        }
    }
}

/// A quantity here and in the paper, before the verdict; the fields are those of [`Finding`].
#[expect(missing_docs, reason = "see Finding")]
pub struct Comparison {
    pub topic: Topic,
    pub name: String,
    pub printed: f64,
    pub implied: Option<f64>,
    pub here: Predicted,
    pub tolerance: f64,
}

impl Comparison {
    /// Judges `here` by the printed and the implied value. `why` gives the reason of a verdict,
    /// unless the error is too large for one.
    pub fn judge(self, why: impl Fn(Verdict) -> String) -> Finding {
        let Self { topic, name, printed, implied, here, tolerance } = self;
        let verdict = Verdict::new(here, printed, implied, tolerance);
        let reason = match (verdict, here.error) {
            (Verdict::Uncertain, Some(error)) => {
                // The error falls as the root of the time. A tolerance of two errors is enough.
                let factor = (2.0 * error / tolerance).powi(2).max(2.0);
                let error = number(error);
                format!("the standard error {error} needs about {factor:.0} times the time budget")
            }
            (Verdict::Uncertain, None) => "the standard error is unknown".into(),
            _ => why(verdict),
        };
        Finding { topic, name, printed, implied, here, tolerance, verdict, reason }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verdicts_compare_the_error_with_the_tolerance() {
        let verdict = |value: f64, error: f64| {
            Verdict::new(Predicted { value, error: Some(error) }, 1.0, Some(1.2), 0.05)
        };
        assert_eq!(verdict(1.04, 0.01), Verdict::Same);
        assert_eq!(verdict(1.04, 0.06), Verdict::Uncertain);
        assert_eq!(verdict(1.18, 0.01), Verdict::AsImplied);
        assert_eq!(verdict(1.1, 0.01), Verdict::Different);
        assert_eq!(verdict(1.1, 0.03), Verdict::Uncertain);
        assert_eq!(verdict(2.0, 0.3), Verdict::Different);
        assert_eq!(verdict(2.0, 0.5), Verdict::Uncertain);
        assert_eq!(verdict(f64::NAN, 0.0), Verdict::Uncertain);
        let unknown = Predicted { value: 1.0, error: None };
        assert_eq!(Verdict::new(unknown, 1.0, None, 0.05), Verdict::Uncertain);
    }
}
