//! The noise that counts: what a denoiser leaves, or what is seen in an image that stays as it is.
//! theory.md, (93g)

use super::candidate_cost::{Best, CandidateCost, ClassBias, RenderTime};
use super::{End, Technique};
use crate::adaptive::denoised_noise::left_by_denoiser;
use bdpm_core::noise::Coefficients;
use bdpm_core::settings::Strategy;
use bdpm_core::transport::kernel::ByClass;

/// Relative RMS noise from which on spots count in full, where the image is not denoised. At a
/// tenth of it nobody sees them.
pub const VISIBLE_NOISE: f64 = 0.1;

/// Relative RMS noise below which denoising does not pay: the time of the denoiser adds more noise
/// than its result removes. Measured: docs/measurements/denoising.md.
pub const LEAST_DENOISED_NOISE: f64 = 0.025;

/// Variance of an image over what a denoiser is expected to leave, from which on denoising pays.
const LEAST_DENOISED_SHARE: f64 = 2.0;

/// Iterations of merging at the first vertex before its photons no longer look like spots. With
/// fewer its noise counts by the square of what is missing, where it is visible: no trial sees
/// enough of the photons that make spots.
const FEW_SPOTTED: f64 = 8.0;

/// Weight of the squared error after averaging over several pixels, beside that of single pixels.
/// Grain vanishes in averages, and discs of shared photons stay.
const SPOTS: f64 = 4.0;

impl CandidateCost {
    /// The best counts for the noise that counts, from the coefficients of the image. Averages over
    /// several pixels keep the share `blur` of the noise of shared photons.
    pub fn evaluate_image(
        &self,
        (technique, blur): (Technique, f64),
        image: &Coefficients,
        time: &RenderTime,
        merged: &ByClass<ClassBias>,
        radii: ByClass<f64>,
    ) -> Best {
        let Technique { strategy, merge_vertex, .. } = technique;
        let own = Self { has_cache: strategy.has_cache(), ..*self };
        let [left, averaged] =
            [1.0, blur].map(|kept| left_by_denoiser(strategy, merge_vertex, *image, kept));
        let variance = |own: &Coefficients, best: &Best| {
            own.clamped().variance(best.light_paths, f64::from(best.camera_paths))
        };
        let raw = own.evaluate(image, time, merged, radii);
        if self.denoises {
            let best = own.evaluate(&left, time, merged, radii);
            let before_denoising = variance(image, &best) / variance(&left, &best);
            let best = Best { before_denoising, ..best };
            let is_noisy = best.noise_before_denoising() > LEAST_DENOISED_NOISE;
            if is_noisy && before_denoising > LEAST_DENOISED_SHARE {
                return best;
            }
        }
        let spots = SPOTS * (raw.noise2 / VISIBLE_NOISE.powi(2)).min(1.0).powi(2);
        let counts = *image + averaged * spots;
        let best = own.evaluate(&counts, time, merged, radii);
        let seen = variance(&counts, &best) / variance(image, &best);
        let seen = if seen >= 1.0 { seen } else { 1.0 };
        let is_spotted = (strategy, merge_vertex) == (Strategy::Single, 1)
            && raw.is_noise_visible()
            && matches!(self.end, End::Time(_));
        let few = if is_spotted { (FEW_SPOTTED / best.iterations).max(1.0) } else { 1.0 };
        Best { noise2: best.noise2 / seen, seen: seen * few.powi(2), ..best }
    }
}

impl Best {
    /// Noise of the image before it is denoised, relative.
    pub fn noise_before_denoising(&self) -> f64 {
        (self.noise2 * self.before_denoising).sqrt()
    }

    /// Whether noise is visible in the image, before it is denoised.
    pub fn is_noise_visible(&self) -> bool {
        self.noise_before_denoising() > VISIBLE_NOISE
    }

    /// Whether a denoiser is expected to remove most of the noise.
    pub fn is_denoised(&self) -> bool {
        self.before_denoising > 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adaptive::technique::candidate_cost::tests::{demand, time, times};
    use bdpm_core::settings::{Direct, Kernel};

    #[test]
    fn noise_before_denoising_is_that_of_the_image() {
        let image = Coefficients { a: 2e7, b: 40.0, f: 1e4 };
        let merged = <ByClass<ClassBias>>::default();
        let technique = Technique {
            strategy: Strategy::Single,
            merge_vertex: 2,
            direct: Direct::Connect,
            kernel: Kernel::Area,
            splitting: 1,
            medium_query: None,
        };
        let seconds = 100.0;
        for denoises in [false, true] {
            let demand = CandidateCost { denoises, ..demand(End::Time(seconds)) };
            let best = demand.evaluate_image((technique, 1.0), &image, &time(), &merged, [1.0; 2]);
            let (n_light, n_camera) = (best.light_paths, f64::from(best.camera_paths));
            let share = times().iteration(n_light, n_camera) / seconds;
            let expected = (share * image.variance(n_light, n_camera)).sqrt();
            let own = best.noise_before_denoising();
            assert!((own / expected - 1.0).abs() < 1e-9, "{own} {expected}");
            assert_eq!(best.noise2.sqrt() < 0.9 * own, denoises);
        }
    }

    /// Of two images of equal noise, that whose pixels share it counts more, and with few
    /// iterations even more.
    #[test]
    fn spots_count_where_noise_is_visible() {
        let single = Technique {
            strategy: Strategy::Single,
            merge_vertex: 1,
            direct: Direct::Connect,
            kernel: Kernel::Area,
            splitting: 1,
            medium_query: None,
        };
        let path = Technique { strategy: Strategy::Path, ..single };
        let merged = <ByClass<ClassBias>>::default();
        let seen = |technique, image: Coefficients, blur, seconds| {
            let demand = demand(End::Time(seconds));
            let best = demand.evaluate_image((technique, blur), &image, &time(), &merged, [1.0; 2]);
            (best.seen, best.iterations)
        };
        let discs = Coefficients { a: 0.0, b: 1.0, f: 1e7 };
        let (many, _) = seen(single, discs, 1.0, 10.0);
        assert!((1.5..=1.0 + SPOTS).contains(&many), "{many}");
        let (small, _) = seen(single, discs, 0.1, 10.0);
        assert!(small < 0.6 * many, "{small} {many}");
        let (grain, _) = seen(path, Coefficients { a: 0.0, b: 1e3, f: 0.0 }, 1.0, 10.0);
        assert!(grain < 1.2, "{grain}");
        let (invisible, _) = seen(single, discs, 1.0, 1e6);
        assert!(invisible < 1.1, "{invisible}");
        let (few, iterations) = seen(single, discs, 1.0, 0.02);
        assert!(iterations < FEW_SPOTTED && few > many, "{few} {iterations}");
    }
}
