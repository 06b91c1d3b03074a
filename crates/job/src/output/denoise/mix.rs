//! The mix of the denoised and the raw image with the smallest estimated error in each
//! neighborhood.

use super::BOX_RADIUS;
use super::cross_validation::CrossValidation;
use super::pooling::boxes;
use bdpm_core::base::math::Rgb;
use rayon::prelude::*;

/// Shares of the raw image, in [0, 1], row by row.
#[derive(Clone, Debug)]
pub struct Mix {
    /// Estimated from all folds, for the final image.
    pub shares: Vec<f32>,
    /// For each fold, estimated from the other folds. The error of the mix is estimated with these
    /// shares.
    pub fold_shares: Vec<Vec<f32>>,
    /// Share of the pixels in whose neighborhood the denoiser alone has a larger error than the raw
    /// image.
    pub worse: f64,
}

impl Mix {
    /// Pools over squares of `2 BOX_RADIUS + 1` pixels of an image of this size, or over all pixels
    /// if they do not form an image. `weights` are those of squared errors.
    ///
    /// Let `u = R_-i - D_-i` and `v = B_i - D_-i`. The squared error of a mix with the share `a` is
    /// `(a u - v)^2` plus terms without `a`, so `a = mean uv / mean u^2` minimizes it. The share is
    /// reduced by the part of `a^2` that its standard error over the folds explains.
    pub fn new(validation: &CrossValidation, weights: &[f64], size: Option<(u32, u32)>) -> Self {
        let pooled = |index: usize| {
            let value = |pixel: usize| {
                let [fold, raw, denoised] =
                    [&validation.fold, &validation.raw, &validation.denoised]
                        .map(|images| f64::from(images[index][pixel]));
                let (u, v) = (raw - denoised, fold - denoised);
                (weights[pixel] * u * v, weights[pixel] * u * u)
            };
            let (uv, uu): (Vec<f64>, Vec<f64>) = (0..weights.len()).map(value).unzip();
            [uv, uu].map(|values| match size {
                Some((width, height)) => {
                    boxes(&values, (width as usize, height as usize), BOX_RADIUS as usize)
                }
                None => {
                    vec![values.iter().sum::<f64>() / values.len() as f64; values.len()]
                }
            })
        };
        let moments: Vec<[Vec<f64>; 2]> =
            (0..validation.fold_count()).into_par_iter().map(pooled).collect();
        let share = |pixel: usize, left_out: Option<usize>| {
            let taken = (0..validation.fold_count()).filter(|fold| Some(*fold) != left_out);
            best_share(taken.map(|fold| [moments[fold][0][pixel], moments[fold][1][pixel]]))
        };
        let shares = |left_out| {
            (0..weights.len()).into_par_iter().map(|pixel| share(pixel, left_out)).collect()
        };
        // Compare the raw image (a = 1) with the denoised one (a = 0).
        let is_worse = |pixel: &usize| {
            let [uv, uu] = [0, 1].map(|m| moments.iter().map(|of| of[m][*pixel]).sum::<f64>());
            uu < 2.0 * uv
        };
        let worse = (0..weights.len()).into_par_iter().filter(is_worse).count();
        Self {
            shares: shares(None),
            fold_shares: (0..validation.fold_count()).map(|fold| shares(Some(fold))).collect(),
            worse: worse as f64 / weights.len() as f64,
        }
    }
}

/// Mixes two images by the share of the raw one in each pixel.
pub fn mixed(raw: &[Rgb], denoised: &[Rgb], raw_shares: &[f32]) -> Vec<Rgb> {
    let pixels = raw.iter().zip(denoised).zip(raw_shares);
    pixels.map(|((raw, denoised), share)| denoised.lerp(*raw, *share)).collect()
}

/// The share from the moments `[mean uv, mean u^2]` of some folds.
fn best_share(moments: impl Iterator<Item = [f64; 2]> + Clone) -> f32 {
    let (mut n, mut uv, mut uu) = (0.0, 0.0, 0.0);
    for [fold_uv, fold_uu] in moments.clone() {
        (n, uv, uu) = (n + 1.0, uv + fold_uv, uu + fold_uu);
    }
    if uv <= 0.0 || uu <= 0.0 {
        return 0.0;
    }
    let share = uv / uu;
    let deviation2 = |[fold_uv, fold_uu]: [f64; 2]| (fold_uv - share * fold_uu).powi(2);
    // One fold shows no standard error.
    let error2 = match n {
        1.0 => 0.0,
        n => n / (n - 1.0) * moments.map(deviation2).sum::<f64>() / (uu * uu),
    };
    (share * (1.0 - error2 / (share * share)).max(0.0)).min(1.0) as f32
}

#[cfg(test)]
mod tests {
    use super::super::cross_validation::tests::{error, folds, of_all_samples, truth};
    use super::*;
    use bdpm_core::base::rng::{Stream, StreamKey};

    /// Squared errors of the raw image, the denoised image and the mix, from all samples, and the
    /// estimate for the mix.
    fn errors(contrast: f64, noise: (f64, f64), stream: u64) -> [f64; 4] {
        let truth = truth(contrast);
        let weights: Vec<f64> = truth.iter().map(|l| 1.0 / (l * l + 0.04)).collect();
        let mut rng = StreamKey::new(9, Stream::Test, stream).rng(0);
        let mut sums = [0.0; 4];
        for _ in 0..40 {
            let folds = folds(&truth, noise, &mut rng);
            let mix = Mix::new(&folds, &weights, Some((64, 64)));
            let [raw, denoised] = of_all_samples(&folds, 2);
            let pixels = raw.iter().zip(&denoised).zip(&mix.shares);
            let mixed = pixels.map(|((raw, denoised), share)| denoised + share * (raw - denoised));
            let images = [raw.clone(), denoised.clone(), mixed.collect()];
            for (sum, image) in sums.iter_mut().zip(images) {
                *sum += error(&[image], &truth, &weights);
            }
            sums[3] += folds.mixed(&mix).estimate(&weights).squared;
        }
        sums.map(|sum| sum / 40.0)
    }

    #[test]
    fn mix_is_no_worse_than_either_image_with_a_good_or_a_bad_denoiser() {
        // First a fine grating that a blur destroys, with little noise. Then much noise and little
        // detail.
        let [raw, denoised, mixed, estimated] = errors(1.0, (0.05, 0.0), 0);
        assert!(denoised > 4.0 * raw && mixed < raw, "{raw} {denoised} {mixed}");
        assert!((estimated / mixed - 1.0).abs() < 0.05, "{estimated} {mixed}");
        let [raw, denoised, mixed, estimated] = errors(0.02, (0.6, 0.0), 1);
        assert!(raw > 4.0 * denoised && mixed < 1.02 * denoised, "{raw} {denoised} {mixed}");
        assert!((estimated / mixed - 1.0).abs() < 0.1, "{estimated} {mixed}");
        let [raw, denoised, mixed, _] = errors(0.3, (0.2, 0.03), 2);
        assert!(mixed < raw && mixed < denoised, "{raw} {denoised} {mixed}");
    }
}
