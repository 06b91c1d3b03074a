//! The mix of the denoised and the raw image with the least estimated error, neighborhood by neighborhood.

use super::BOX_RADIUS;
use super::folds::{Folds, boxes};
use crate::base::math::Rgb;
use rayon::prelude::*;

/// Shares of the raw image, in [0, 1], row by row.
#[derive(Clone, Debug)]
pub struct Mix {
    /// By all parts: for the image that is delivered.
    pub shares: Vec<f32>,
    /// For each part by the others, which its error is then told with.
    pub of_folds: Vec<Vec<f32>>,
    /// Share of the pixels in whose neighborhood the denoiser alone has a larger error than the raw image.
    pub worse: f64,
}

impl Mix {
    /// Pools over squares of `2 BOX_RADIUS + 1` pixels, by these weights of squared errors.
    ///
    /// With `u = R_-i - D_-i` and `v = B_i - D_-i` the error of a mix with the share `a` is `(a u - v)^2` but for what
    /// does not depend on it, so that `a = mean uv / mean u^2`; it is drawn toward 0 by what its standard error over
    /// parts explains.
    pub fn new(folds: &Folds, weights: &[f64], (width, height): (u32, u32)) -> Self {
        let size = (width as usize, height as usize);
        let pooled = |fold: usize| {
            let value = |pixel: usize| {
                let [part, raw, denoised] = [&folds.part, &folds.raw, &folds.denoised]
                    .map(|images| f64::from(images[fold][pixel]));
                let (u, v) = (raw - denoised, part - denoised);
                (weights[pixel] * u * v, weights[pixel] * u * u)
            };
            let (uv, uu): (Vec<f64>, Vec<f64>) = (0..weights.len()).map(value).unzip();
            [uv, uu].map(|values| boxes(&values, size, BOX_RADIUS as usize))
        };
        let moments: Vec<[Vec<f64>; 2]> = (0..folds.len()).into_par_iter().map(pooled).collect();
        let share = |pixel: usize, left_out: Option<usize>| {
            let taken = (0..folds.len()).filter(|fold| Some(*fold) != left_out);
            best_share(taken.map(|fold| [moments[fold][0][pixel], moments[fold][1][pixel]]))
        };
        let shares = |left_out| {
            (0..weights.len()).into_par_iter().map(|pixel| share(pixel, left_out)).collect()
        };
        // Without the denoiser (a = 1) against without the raw image (a = 0).
        let is_worse = |pixel: &usize| {
            let [uv, uu] = [0, 1].map(|m| moments.iter().map(|of| of[m][*pixel]).sum::<f64>());
            uu < 2.0 * uv
        };
        let worse = (0..weights.len()).into_par_iter().filter(is_worse).count();
        Self {
            shares: shares(None),
            of_folds: (0..folds.len()).map(|fold| shares(Some(fold))).collect(),
            worse: worse as f64 / weights.len() as f64,
        }
    }

    /// Mixes two images.
    pub fn apply(&self, raw: &[Rgb], denoised: &[Rgb]) -> Vec<Rgb> {
        let pixels = raw.iter().zip(denoised).zip(&self.shares);
        pixels.map(|((raw, denoised), share)| denoised.lerp(*raw, *share)).collect()
    }
}

/// The share by the moments `[mean uv, mean u^2]` of some parts.
fn best_share(moments: impl Iterator<Item = [f64; 2]> + Clone) -> f32 {
    let (mut n, mut uv, mut uu) = (0.0, 0.0, 0.0);
    for [own_uv, own_uu] in moments.clone() {
        (n, uv, uu) = (n + 1.0, uv + own_uv, uu + own_uu);
    }
    if uv <= 0.0 || uu <= 0.0 {
        return 0.0;
    }
    let share = uv / uu;
    let off = |[own_uv, own_uu]: [f64; 2]| (own_uv - share * own_uu).powi(2);
    let error2 = n / (n - 1.0) * moments.map(off).sum::<f64>() / (uu * uu);
    (share * (1.0 - error2 / (share * share)).max(0.0)).min(1.0) as f32
}

#[cfg(test)]
mod tests {
    use super::super::folds::tests::{error, folds, truth};
    use super::*;
    use crate::base::rng::{Stream, StreamKey};

    /// Squared errors of the raw image, of what is denoised, and of the mix, and what is told of the last.
    fn errors(contrast: f64, noise: (f64, f64), stream: u64) -> [f64; 4] {
        let truth = truth(contrast);
        let weights: Vec<f64> = truth.iter().map(|l| 1.0 / (l * l + 0.04)).collect();
        let mut rng = StreamKey::new(9, Stream::Test, stream).rng(0);
        let mut sums = [0.0; 4];
        for _ in 0..40 {
            let folds = folds(&truth, noise, &mut rng);
            let mix = Mix::new(&folds, &weights, (64, 64));
            let mixed = folds.mixed(&mix);
            let of = |images: &[Vec<f32>]| error(images, &truth, &weights);
            sums[0] += of(&folds.raw);
            sums[1] += of(&folds.denoised);
            sums[2] += of(&mixed.denoised);
            sums[3] += mixed.estimate(&weights).squared;
        }
        sums.map(|sum| sum / 40.0)
    }

    #[test]
    fn a_mix_is_no_worse_than_either_where_the_denoiser_fails_and_where_it_does_not() {
        // A fine grating that a blur destroys, with little noise; and much noise with little to destroy.
        let [raw, denoised, mixed, told] = errors(1.0, (0.05, 0.0), 0);
        assert!(denoised > 4.0 * raw && mixed < raw, "{raw} {denoised} {mixed}");
        assert!((told / mixed - 1.0).abs() < 0.05, "{told} {mixed}");
        let [raw, denoised, mixed, told] = errors(0.02, (0.6, 0.0), 1);
        assert!(raw > 4.0 * denoised && mixed < 1.02 * denoised, "{raw} {denoised} {mixed}");
        assert!((told / mixed - 1.0).abs() < 0.1, "{told} {mixed}");
        let [raw, denoised, mixed, _] = errors(0.3, (0.2, 0.03), 2);
        assert!(mixed < raw && mixed < denoised, "{raw} {denoised} {mixed}");
    }
}
