//! One number for the variances of many pixels: the aggregate that the counts minimize.

use bdpm_core::film::radiance::luminance_weights;
use serde::{Deserialize, Serialize};

/// How the variances of the pixels are combined into the number to minimize.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Objective {
    /// Mean variance, `mean_p V_p`.
    Pooled,
    /// Mean variance weighted by `1/(L_p^2 + 0.01 mean(L)^2)`: dark pixels count as much as bright
    /// ones.
    #[default]
    Relative,
    /// The paper's mean RMS, squared: `(mean_p sqrt(V_p))^2`.
    MeanRms,
    /// The 99.5th percentile of the variances; for fewer than 200 pixels their maximum.
    MaxRms,
}

impl Objective {
    /// Weights of the variances of pixels of these luminances, W/(m^2 sr); their mean is 1.
    pub(crate) fn weights(self, luminance: &[f64]) -> Vec<f64> {
        match self {
            Self::Relative => {
                // theory.md, section 20 (`relative`)
                let weights = luminance_weights(luminance);
                let scale = luminance.len() as f64 / weights.iter().sum::<f64>();
                // Neither 0/0 nor an infinite weight, as of a black image.
                let is_valid = scale.is_finite() && scale > 0.0;
                weights.iter().map(|own| if is_valid { own * scale } else { 1.0 }).collect()
            }
            _ => vec![1.0; luminance.len()],
        }
    }

    /// The aggregate of weighted variances, squared luminance.
    // theory.md, section 20 (table of A)
    pub(crate) fn aggregate(self, variances: impl ExactSizeIterator<Item = f64>) -> f64 {
        let count = variances.len().max(1) as f64;
        let root = |variance: f64| variance.max(0.0).sqrt();
        match self {
            Self::Pooled | Self::Relative => variances.sum::<f64>() / count,
            Self::MeanRms => (variances.map(root).sum::<f64>() / count).powi(2),
            Self::MaxRms => percentile(&mut variances.collect::<Vec<_>>()),
        }
    }

    /// The aggregate of `pixels` pixels is convex in the logarithms of the counts.
    pub(super) fn is_convex(self, pixels: usize) -> bool {
        self != Self::MaxRms || above_percentile(pixels) == 0
    }
}

/// Number of the `count` values that lie above their 99.5th percentile.
pub(super) fn above_percentile(count: usize) -> usize {
    count - (count * 199).div_ceil(200)
}

/// The value at the index `ceil(0.995 count) - 1` of the sorted values; 0 for none.
fn percentile(values: &mut [f64]) -> f64 {
    let above = above_percentile(values.len());
    match above {
        0 => values.iter().copied().fold(0.0, f64::max),
        _ => *values.select_nth_unstable_by(values.len() - above - 1, f64::total_cmp).1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentile_of_200_values_leaves_out_one() {
        for (count, expected) in [(0, 0.0), (1, 1.0), (199, 199.0), (200, 199.0), (1000, 995.0)] {
            let mut values: Vec<_> = (1..=count).rev().map(f64::from).collect();
            assert_eq!(percentile(&mut values), expected);
        }
    }

    #[test]
    fn relative_weights_prefer_dark_pixels_and_accept_black_ones() {
        let of = |luminance: &[f64]| Objective::Relative.weights(luminance);
        let weights = of(&[0.0, 1.0, 2.0]);
        assert!((weights.iter().sum::<f64>() - 3.0).abs() < 1e-12);
        assert!((weights[0] / weights[1] - 101.0).abs() < 1e-9);
        assert_eq!(of(&[0.0; 3]), [1.0; 3]);
        assert!(of(&[]).is_empty());
    }

    #[test]
    fn objectives_are_written_in_kebab_case() {
        assert_eq!(serde_json::to_string(&Objective::MeanRms).unwrap(), "\"mean-rms\"");
        assert_eq!(Objective::default(), Objective::Relative);
    }
}
