//! The paper's estimator (halves) and the one from all pairs, compared on the same paths.

use bdpm_auto::adaptive::optimize::predict::Predicted;
use bdpm_core::noise::Coefficients;
use bdpm_core::noise::film::BATCHES;
use bdpm_core::noise::image::{NoiseImage, Statistic};
use serde::Serialize;

/// One of the paper's averages minus the squared luminance, by both estimators.
#[derive(Clone, Debug, Serialize)]
pub struct EstimatorRow {
    /// Name of the average.
    pub name: &'static str,
    /// Region mean by all pairs, squared luminance.
    pub pairs: Predicted,
    /// Region mean by halves.
    pub halves: Predicted,
    /// Halves minus pairs. The error is smaller than either's, because the paths are the same.
    pub difference: Predicted,
    /// Iterations that the halves need for the accuracy of one with all pairs, in single pixels:
    /// the variance of the halves over that of the pairs, both summed over the pixels.
    pub per_pixel: Predicted,
    /// Iterations that the halves need for that accuracy in the mean over the region.
    pub region: Predicted,
}

/// Compares two measurements of the same iterations over a region.
///
/// # Panics
/// If they are of different numbers of iterations.
pub fn compare(pairs: &NoiseImage, halves: &NoiseImage, region: &[usize]) -> Vec<EstimatorRow> {
    assert_eq!(pairs.iterations, halves.iterations, "the iterations are the same");
    type Of = fn(Coefficients) -> f64;
    let quantities: [(&'static str, Of); 3] =
        [("C2 - L²", |c| c.a + c.b + c.f), ("B - L²", |c| c.b), ("F - L²", |c| c.f)];
    quantities.into_iter().map(|(name, of)| row(name, pairs, halves, region, of)).collect()
}

fn row(
    name: &'static str,
    pairs: &NoiseImage,
    halves: &NoiseImage,
    region: &[usize],
    of: impl Fn(Coefficients) -> f64,
) -> EstimatorRow {
    let values = |noise: &NoiseImage| -> Vec<[f64; BATCHES]> {
        let batches = |&pixel: &usize| noise.batches[pixel].map(|sample| of(sample.coefficients));
        region.iter().map(batches).collect()
    };
    let (pairs, halves) = (values(pairs), values(halves));
    let (pairs_mean, halves_mean) = (mean(&pairs), mean(&halves));
    let mut difference = halves_mean;
    difference.iter_mut().zip(pairs_mean).for_each(|(halves, pairs)| *halves -= pairs);
    EstimatorRow {
        name,
        pairs: predicted(&pairs_mean),
        halves: predicted(&halves_mean),
        difference: predicted(&difference),
        per_pixel: ratio_of_variances(&halves, &pairs),
        region: ratio_of_variances(&[halves_mean], &[pairs_mean]),
    }
}

/// Mean over the pixels, batch by batch.
fn mean(pixels: &[[f64; BATCHES]]) -> [f64; BATCHES] {
    let mut sums = [0.0; BATCHES];
    for batches in pixels {
        sums.iter_mut().zip(batches).for_each(|(sum, x)| *sum += x / pixels.len() as f64);
    }
    sums
}

/// Mean over batches of equally many iterations, with its standard error.
fn predicted(batches: &[f64; BATCHES]) -> Predicted {
    let n = BATCHES as f64;
    let value = batches.iter().sum::<f64>() / n;
    let squares: f64 = batches.iter().map(|x| (x - value).powi(2)).sum();
    Predicted { value, error: Some((squares / (n * (n - 1.0))).sqrt()) }
}

/// Ratio of two variances over the batches, each summed over the pixels. The error is that of the
/// jackknife over batches.
fn ratio_of_variances(above: &[[f64; BATCHES]], below: &[[f64; BATCHES]]) -> Predicted {
    let ratio = |left_out: Option<usize>| {
        let squares = |pixels: &[[f64; BATCHES]]| -> f64 {
            let of_pixel = |batches: &[f64; BATCHES]| {
                let kept = || {
                    let all = batches.iter().enumerate();
                    all.filter(|(k, _)| Some(*k) != left_out).map(|(_, x)| x)
                };
                let mean = kept().sum::<f64>() / kept().count() as f64;
                kept().map(|x| (x - mean).powi(2)).sum::<f64>()
            };
            pixels.iter().map(of_pixel).sum()
        };
        squares(above) / squares(below)
    };
    let left_out: Vec<f64> = (0..BATCHES).map(|k| ratio(Some(k))).collect();
    let Statistic { value, error, .. } = Statistic::jackknife(ratio(None), &left_out);
    Predicted { value, error: Some(error) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn normals(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            let mut uniform = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 11) as f64 / (1u64 << 53) as f64
            };
            (0..12).map(|_| uniform()).sum::<f64>() - 6.0
        }
    }

    #[test]
    fn known_ratios_are_estimated_within_their_errors() {
        let mut normal = normals(1);
        let mut pixels = |scale: f64, n: usize| -> Vec<[f64; BATCHES]> {
            (0..n).map(|_| [(); BATCHES].map(|()| scale * normal())).collect()
        };
        for n in [1, 100] {
            let found = ratio_of_variances(&pixels(3.0, n), &pixels(1.0, n));
            let error = found.error.unwrap();
            assert!((found.value - 9.0).abs() < 3.0 * error, "{found:?}");
            // Two chi-squares of 15 degrees of freedom for each pixel.
            let expected = 9.0 * (4.0 / (15.0 * n as f64)).sqrt();
            assert!((0.4..2.5).contains(&(error / expected)), "{error} {expected}");
        }
    }

    #[test]
    fn error_of_a_mean_is_its_standard_deviation() {
        let mut normal = normals(2);
        let (mut square, mut claimed) = (0.0, 0.0);
        for _ in 0..2000 {
            let Predicted { value, error } = predicted(&[(); BATCHES].map(|()| normal()));
            square += value * value / 2000.0;
            claimed += error.unwrap().powi(2) / 2000.0;
        }
        assert!((claimed / square - 1.0).abs() < 0.15, "{claimed} {square}");
    }
}
