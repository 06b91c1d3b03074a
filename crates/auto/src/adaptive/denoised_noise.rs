//! What a denoiser leaves of the noise of an image, by the terms of the law.
//!
//! A denoiser averages noise that is independent between pixels, such as that of camera paths. All
//! pixels of an iteration share its light paths: that noise looks like spots of light, which a
//! denoiser keeps. So the terms of `V = a/(N_F N_B) + b/N_B + f/N_F` leave different shares, and
//! technique, radii and counts of an image that is denoised are those with the least of the rest.

use bdpm_core::noise::Coefficients;
use bdpm_core::settings::Strategy;

/// Share of the squared noise of independent pixels that is left. Open Image Denoise left 1/24 to
/// 1/82 in rooms at 1280x720 (docs/measurements/denoising.md).
const OF_SINGLE_PIXELS: f64 = 1.0 / 40.0;

/// Pixels that a denoiser averages.
const AVERAGED: f64 = 1.0 / OF_SINGLE_PIXELS;

/// Share of the noise of shared photons that an average over several pixels keeps: that of discs of
/// this radius over the area that they then cover. A pixel sees a disc of radius `footprint`.
pub fn kept_by_averages(radius: f64, footprint: f64) -> f64 {
    let (disc, pixel) = (radius * radius, footprint * footprint);
    let kept = (disc + pixel) / (disc + AVERAGED * pixel);
    if kept.is_finite() { kept } else { 1.0 }
}

/// Whether photons are merged where the camera sees them, so that neighboring pixels share them.
/// Later vertices are elsewhere for every camera path, as are those that look light up in a cache.
pub fn shares_photons(strategy: Strategy, merge_vertex: u32) -> bool {
    let merges_early = strategy.weighs_merges() || merge_vertex == 1;
    strategy.has_photons() && merges_early && !strategy.has_cache()
}

/// Coefficients of the noise that is left of an image by this strategy after a denoiser, from those
/// of the image. It keeps the share `kept` of the noise of shared photons: 1 for a denoiser, which
/// takes discs of a few pixels for texture, and [`kept_by_averages`] for averages over as many
/// pixels.
///
/// Photons of caustics are merged at first vertices by every strategy. `caustics` is their share of
/// `a`, as far as it is known.
pub fn left_by_denoiser(
    strategy: Strategy,
    merge_vertex: u32,
    Coefficients { a, b, f }: Coefficients,
    (kept, caustics): (f64, f64),
) -> Coefficients {
    let is_shared = shares_photons(strategy, merge_vertex);
    let of_others = if is_shared { kept } else { OF_SINGLE_PIXELS };
    let of_pairs = caustics * kept + (1.0 - caustics) * of_others;
    // The light paths that all pixels see change their light together.
    let of_light = if is_shared { kept } else { 1.0 };
    Coefficients { a: of_pairs * a, b: OF_SINGLE_PIXELS * b, f: of_light * f }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averages_keep_discs_and_remove_grain() {
        let kept = [0.0, 1.0, 4.0, 100.0].map(|radius| kept_by_averages(radius, 1.0));
        assert_eq!(kept[0], OF_SINGLE_PIXELS, "a point is as small as a pixel");
        assert!(kept.is_sorted() && kept[2] < 0.4 && kept[3] > 0.99, "{kept:?}");
        assert_eq!(kept_by_averages(2.0, 0.0), 1.0, "pixels of no area see the same discs");
    }

    #[test]
    fn noise_of_camera_paths_vanishes_before_that_of_shared_photons() {
        let noise = Coefficients { a: 1.0, b: 1.0, f: 1.0 };
        let left = |strategy, vertex| left_by_denoiser(strategy, vertex, noise, (0.7, 0.0));
        for (strategy, vertex) in [(Strategy::Single, 1), (Strategy::Mis, 2), (Strategy::CutMis, 2)]
        {
            let Coefficients { a, b, f } = left(strategy, vertex);
            assert!(b < 0.2 * a && a == f, "{strategy:?}");
        }
        let Coefficients { a, b, f } = left(Strategy::Single, 2);
        assert!(a == b && b < 0.2 * f);
        let half = left_by_denoiser(Strategy::Single, 2, noise, (0.7, 0.5));
        assert!((half.a - 0.5 * (0.7 + a)).abs() < 1e-12, "half of the pairs are of caustics");
    }
}
