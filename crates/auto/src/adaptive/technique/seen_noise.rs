//! The noise that counts: what a denoiser leaves, or what is seen in an image that stays as it is.
//! theory.md, (93g)

use super::candidate_cost::{Best, CandidateCost, ClassBias, RenderTime};
use super::{End, Technique};
use crate::adaptive::denoised_noise::{left_by_denoiser, shares_photons};
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

/// [`LEAST_DENOISED_SHARE`] where noise is visible, which is removed as far as possible. Noise of
/// shared photons alone stays, and the time of the denoiser is better spent on more of them.
const LEAST_VISIBLE_SHARE: f64 = 1.25;

/// Iterations of merging at the first vertex before its photons no longer look like spots. With
/// fewer its noise counts by the square of what is missing, where it is visible: no trial sees
/// enough of the photons that make spots.
const FEW_SPOTTED: f64 = 8.0;

/// Factor on the noise of merging at the first vertex that a denoiser leaves, where noise is
/// visible: it takes photons for texture. In `scenes/smoke` at 1920x1080, 21 % were predicted and
/// 15 % left. Merging at the second vertex left 6 and 9 % of predicted 37 and 25 %: its few bright
/// pixels vanish.
const TEXTURE: f64 = 4.0;

/// Factor on the noise of photons and of the suffixes of a cache, which short measurements see too
/// low: they miss rare ones that carry much. Where light comes through windows, images had up to
/// 1.9 times the squared error that was predicted, and 30 times in one of four classrooms. In the
/// dark room of `scenes/keyhole`, caches had 2 to 4 times the squared error that was predicted, and
/// one of six renders took one. Predictions of camera paths alone were right within 1.3.
const RARE_PHOTONS: f64 = 2.0;

/// Factor on the noise of techniques whose photons are those of caustics alone, beside techniques
/// without photons. In two rooms whose trials told them apart by less than a tenth, images had 1.33
/// and 1.45 times the squared error.
const CAUSTICS_DOUBT: f64 = 1.3;

/// Weight of the squared error after averaging over several pixels, beside that of single pixels.
/// Grain vanishes in averages, and discs of shared photons stay.
const SPOTS: f64 = 4.0;

impl CandidateCost {
    /// The best counts for the noise that counts, from the coefficients of the image. Averages over
    /// several pixels keep the share `blur` of the noise of shared photons. `caustics` is the share
    /// of photons of caustics in `a`.
    pub fn evaluate_image(
        &self,
        (technique, [blur, caustics]): (Technique, [f64; 2]),
        image: &Coefficients,
        time: &RenderTime,
        merged: &ByClass<ClassBias>,
        radii: ByClass<f64>,
    ) -> Best {
        let Technique { strategy, merge_vertex, .. } = technique;
        let own = Self { strategy, ..*self };
        // Photons of caustics are few beside the noise of camera paths, and look like grain.
        let of_denoiser = if strategy.has_only_caustics() { blur } else { 1.0 };
        let [left, averaged] = [of_denoiser, blur]
            .map(|kept| left_by_denoiser(strategy, merge_vertex, *image, (kept, caustics)));
        let variance = |own: &Coefficients, best: &Best| {
            own.clamped().variance(best.light_paths, f64::from(best.camera_paths))
        };
        let raw = own.evaluate(image, time, merged, radii);
        let rare = rare_photons(strategy, image, &raw);
        let is_spotted = (strategy, merge_vertex) == (Strategy::Single, 1)
            && raw.is_noise_visible()
            && matches!(self.end, End::Time(_));
        let few = |best: &Best| match is_spotted {
            true => (FEW_SPOTTED / best.iterations).max(1.0).powi(2),
            false => 1.0,
        };
        let spots = SPOTS * (raw.noise2 / VISIBLE_NOISE.powi(2)).min(1.0).powi(2);
        if self.denoises {
            let best = own.evaluate(&left, time, merged, radii);
            let before_denoising = variance(image, &best) / variance(&left, &best);
            let best = Best { before_denoising, ..best };
            let is_noisy = best.noise_before_denoising() > LEAST_DENOISED_NOISE;
            let share = match best.is_noise_visible() {
                true => LEAST_VISIBLE_SHARE,
                false => LEAST_DENOISED_SHARE,
            };
            let is_shared = shares_photons(strategy, merge_vertex);
            // Short trials see too much noise that all pixels share: in 3 s of `scenes/materials`
            // at 1920x1080 a third of 22 % was left, where nothing was expected to go.
            let is_grain = best.is_noise_visible() && !is_shared;
            if is_noisy && (before_denoising > share || is_grain) {
                // Large discs stay in sight, while small ones look like grain.
                let counts = left + averaged * spots;
                let discs = (variance(&counts, &best) / variance(&left, &best)).max(1.0);
                let discs = if is_shared { discs } else { 1.0 };
                let texture = if is_spotted { TEXTURE } else { 1.0 };
                let seen = discs * rare * few(&best).max(texture);
                return Best { coefficients: *image, seen, ..best };
            }
        }
        let counts = *image + averaged * spots;
        let best = own.evaluate(&counts, time, merged, radii);
        let seen = (variance(&counts, &best) / variance(image, &best)).max(1.0);
        let (noise2, seen) = (best.noise2 / seen, seen * few(&best) * rare);
        Best { coefficients: *image, noise2, seen, ..best }
    }
}

/// Factor on the noise for light that short measurements miss. Photons of caustics alone and the
/// suffixes of a cache make the noise of pairs and what pixels share, and all other noise is that
/// of camera paths.
fn rare_photons(strategy: Strategy, image: &Coefficients, best: &Best) -> f64 {
    if !strategy.shares_light() {
        return 1.0;
    }
    if !strategy.has_only_caustics() && !strategy.has_cache() {
        return RARE_PHOTONS;
    }
    let n_camera = f64::from(best.camera_paths);
    let own = image.clamped();
    let of_camera = Coefficients { a: 0.0, f: 0.0, ..own };
    let [camera, all] = [of_camera, own].map(|own| own.variance(best.light_paths, n_camera));
    let share = if all > 0.0 { camera / all } else { 0.0 };
    let least = if strategy.has_photons() { CAUSTICS_DOUBT } else { 1.0 };
    (share + (1.0 - share) * RARE_PHOTONS).max(least)
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

    /// Whether a denoiser is expected to remove noise.
    pub fn is_denoised(&self) -> bool {
        self.before_denoising > 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adaptive::technique::candidate_cost::tests::{MERGING, demand, time, times};

    #[test]
    fn noise_before_denoising_is_that_of_the_image() {
        let image = Coefficients { a: 2e7, b: 40.0, f: 1e4 };
        let merged = <ByClass<ClassBias>>::default();
        let technique = Technique { merge_vertex: 2, ..MERGING };
        let seconds = 100.0;
        for denoises in [false, true] {
            let demand = CandidateCost { denoises, ..demand(End::Time(seconds)) };
            let best =
                demand.evaluate_image((technique, [1.0, 0.0]), &image, &time(), &merged, [1.0; 2]);
            let (n_light, n_camera) = (best.light_paths, f64::from(best.camera_paths));
            let share = times().iteration(n_light, n_camera) / seconds;
            let expected = (share * image.variance(n_light, n_camera)).sqrt();
            let own = best.noise_before_denoising();
            assert!((own / expected - 1.0).abs() < 1e-9, "{own} {expected}");
            assert_eq!(best.noise2.sqrt() < 0.9 * own, denoises);
        }
    }

    /// What pixels share counts twice, also in a cache, and what camera paths find once.
    #[test]
    fn noise_of_rare_light_counts_twice() {
        let factor = |strategy, image: Coefficients| {
            let demand = demand(End::Time(1e5));
            let best = demand.evaluate(&image, &time(), &Default::default(), [1.0; 2]);
            rare_photons(strategy, &image, &best)
        };
        let shared = Coefficients { a: 0.0, b: 0.0, f: 1e4 };
        let own = Coefficients { a: 0.0, b: 1.0, f: 0.0 };
        for (strategy, of_shared, of_own) in [
            (Strategy::Path, 1.0, 1.0),
            (Strategy::Single, RARE_PHOTONS, RARE_PHOTONS),
            (Strategy::Gather, RARE_PHOTONS, 1.0),
            (Strategy::GatherCaustics, RARE_PHOTONS, CAUSTICS_DOUBT),
            (Strategy::PathCaustics, RARE_PHOTONS, CAUSTICS_DOUBT),
        ] {
            assert_eq!(factor(strategy, shared), of_shared, "{strategy:?}");
            assert_eq!(factor(strategy, own), of_own, "{strategy:?}");
        }
    }

    /// Of two images of equal noise, that whose pixels share it counts more, and with few
    /// iterations even more.
    #[test]
    fn spots_count_where_noise_is_visible() {
        let (single, path) = (MERGING, Technique { strategy: Strategy::Path, ..MERGING });
        let merged = <ByClass<ClassBias>>::default();
        let seen = |technique, image: Coefficients, blur, seconds| {
            let demand = demand(End::Time(seconds));
            let best =
                demand.evaluate_image((technique, [blur, 0.0]), &image, &time(), &merged, [1.0; 2]);
            (best.seen, best.iterations)
        };
        let discs = Coefficients { a: 0.0, b: 1.0, f: 1e7 };
        // Beside what all photons have.
        let seen = |technique: Technique, image, blur, seconds| {
            let (all, iterations) = seen(technique, image, blur, seconds);
            let rare = if technique.strategy.has_photons() { RARE_PHOTONS } else { 1.0 };
            (all / rare, iterations)
        };
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
