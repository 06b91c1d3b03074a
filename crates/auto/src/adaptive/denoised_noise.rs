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

/// Share of the squared noise of photons that neighboring pixels share. It left 1/1.6 to 1/7
/// (docs/measurements/denoising.md), but not of photons alone: they count in full. At a half, radii
/// were so small that scenes/point-caustic had 17 % where it has 9 to 13 %.
const OF_SHARED_PHOTONS: f64 = 1.0;

/// Whether photons are merged where the camera sees them, so that neighboring pixels share them.
/// Later vertices are elsewhere for every camera path.
pub fn shares_photons(strategy: Strategy, merge_vertex: u32) -> bool {
    strategy.has_photons() && (strategy.weighs_merges() || merge_vertex == 1)
}

/// Coefficients of the noise that is left of an image by this strategy after a denoiser, from those
/// of the image.
pub fn left_by_denoiser(
    strategy: Strategy,
    merge_vertex: u32,
    Coefficients { a, b, f }: Coefficients,
) -> Coefficients {
    let is_shared = shares_photons(strategy, merge_vertex);
    let of_pairs = if is_shared { OF_SHARED_PHOTONS } else { OF_SINGLE_PIXELS };
    Coefficients { a: of_pairs * a, b: OF_SINGLE_PIXELS * b, f: OF_SHARED_PHOTONS * f }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_of_camera_paths_vanishes_before_that_of_shared_photons() {
        let noise = Coefficients { a: 1.0, b: 1.0, f: 1.0 };
        let left = |strategy, vertex| left_by_denoiser(strategy, vertex, noise);
        for (strategy, vertex) in [(Strategy::Single, 1), (Strategy::Mis, 2), (Strategy::CutMis, 2)]
        {
            let Coefficients { a, b, f } = left(strategy, vertex);
            assert!(b < 0.2 * a && a == f, "{strategy:?}");
        }
        let Coefficients { a, b, f } = left(Strategy::Single, 2);
        assert!(a == b && b < 0.2 * f);
    }
}
