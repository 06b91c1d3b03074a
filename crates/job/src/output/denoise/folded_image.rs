//! The image of each fold of the iterations, and of all other folds. The guides of the denoiser.

use super::seen_lights::isolated_lights;
use super::window::Window;
use bdpm_core::base::math::Rgb;
use bdpm_core::film::features::FeatureFolds;
use bdpm_core::film::folds::DENOISE_FOLDS;
use bdpm_core::film::radiance::{luminance, total};
use bdpm_core::render::block::{Block, CombinedImage};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Maximum RMS noise of guides that need no denoising of their own: a step of 8-bit colors.
const MAX_CLEAN_NOISE: f64 = 1.0 / 256.0;

/// Guides of a denoiser: albedo and normals, row by row. Images that are not known are empty.
#[derive(Clone, Debug, Default)]
pub struct Guides {
    /// Albedo in [0, 1].
    pub albedo: Vec<Rgb>,
    /// Means of unit normals.
    pub normal: Vec<Vec3>,
    /// True if they have hardly any noise. Noisy guides have to be denoised as well.
    pub clean: bool,
}

impl Guides {
    /// The guides of a window of an image of this many columns.
    #[must_use]
    pub fn crop(&self, window: Window, image_width: u32) -> Self {
        if self.albedo.is_empty() {
            return self.clone();
        }
        let albedo = window.crop(&self.albedo, image_width);
        Self { albedo, normal: window.crop(&self.normal, image_width), clean: self.clean }
    }
}

/// Guides from all iterations. Each pixel has its albedo and normal, however the iterations are
/// dealt to folds.
pub fn guides(image: &CombinedImage, features: Option<&FeatureFolds>) -> Guides {
    let Some(features) = features else { return Guides::default() };
    let film = &image.blocks()[0].film;
    let mut both = vec![(Rgb::ZERO, Vec3::ZERO); film.pixels()];
    film.sums.zip_pixels(&mut both, |both, at| {
        let guide = features.mean(at, |_| true);
        *both = (guide.albedo, guide.normal);
    });
    let (albedo, normal) = both.into_iter().unzip();
    let clean = guide_noise(image, features).is_some_and(|noise| noise < MAX_CLEAN_NOISE);
    Guides { albedo, normal, clean }
}

/// RMS noise per channel of the guides from all folds; `None` unless the features are kept in
/// folds.
fn guide_noise(image: &CombinedImage, features: &FeatureFolds) -> Option<f64> {
    if !features.is_folded() {
        return None;
    }
    let film = &image.blocks()[0].film;
    let mut variance = vec![0.0; film.pixels()];
    film.sums.zip_pixels(&mut variance, |variance, at| {
        let mean = features.mean(at, |_| true);
        let deviation2 = |fold: usize| {
            let guide = features.mean(at, |f| f == fold);
            f64::from((guide.albedo - mean.albedo).length_squared())
                + f64::from((guide.normal - mean.normal).length_squared())
        };
        *variance = (0..DENOISE_FOLDS).map(deviation2).sum::<f64>()
            / (DENOISE_FOLDS * (DENOISE_FOLDS - 1) * 6) as f64;
    });
    Some((total(&variance, |v| *v) / variance.len() as f64).sqrt())
}

/// An image whose iterations are dealt out to `n` folds.
pub struct FoldedImage<'a> {
    image: &'a CombinedImage<'a>,
    n: usize,
}

/// Sums over the weighted blocks of an image, in a window, times a scale.
pub(super) fn sums(
    image: &CombinedImage,
    window: Window,
    scale: f64,
    of: impl Fn(&Block, usize) -> DVec3 + Sync,
) -> Vec<DVec3> {
    let blocks = image.blocks();
    let mut sums = vec![DVec3::ZERO; window.len()];
    let rows = sums.par_chunks_mut(window.width as usize).zip(window.y..window.y + window.height);
    rows.for_each(|(row, y)| {
        let indices = blocks[0].film.sums.row(y).skip(window.x as usize);
        for (sum, at) in row.iter_mut().zip(indices) {
            for (block, weight) in blocks.iter().zip(image.weights()) {
                *sum += of(block, at) * (weight * scale);
            }
        }
    });
    sums
}

impl<'a> FoldedImage<'a> {
    /// `None` unless all blocks keep folds, and each of `n` folds has at least one iteration.
    pub fn new(image: &'a CombinedImage<'a>, n: usize) -> Option<Self> {
        let divides = n >= 2 && DENOISE_FOLDS.is_multiple_of(n);
        let kept = image.blocks().iter().all(|block| block.statistics.folds.is_some());
        if !(divides && kept) {
            return None;
        }
        let folded = Self { image, n };
        folded.has_iterations(n).then_some(folded)
    }

    /// Whether each of `n` folds has at least one iteration.
    fn has_iterations(&self, n: usize) -> bool {
        (0..n).all(|fold| self.weight(|f| f % n == fold) > 0.0)
    }

    /// Whether the [`DENOISE_FOLDS`] folds that make up the folds have iterations.
    pub fn has_parts(&self) -> bool {
        self.has_iterations(DENOISE_FOLDS)
    }

    /// Width and height, pixels.
    pub fn resolution(&self) -> (u32, u32) {
        self.image.resolution()
    }

    /// Number of folds, `n`.
    pub fn fold_count(&self) -> usize {
        self.n
    }

    /// Weight of all iterations in the [`DENOISE_FOLDS`] folds for which `takes` returns true.
    fn weight(&self, takes: impl Fn(usize) -> bool) -> f64 {
        let block_weight = |(block, weight): (&Block, &f64)| {
            let folds = block.statistics.folds.as_ref().expect("kept");
            let taken = (0..DENOISE_FOLDS).filter(|&fold| takes(fold));
            weight * taken.map(|fold| folds.iterations()[fold]).sum::<u64>() as f64
        };
        self.image.blocks().iter().zip(self.image.weights()).map(block_weight).sum()
    }

    /// Mean radiance in a window over the iterations of the [`DENOISE_FOLDS`] folds for which
    /// `takes` returns true.
    fn mean(&self, window: Window, takes: impl Fn(usize) -> bool + Sync) -> Vec<DVec3> {
        let scale = self.weight(&takes).recip();
        sums(self.image, window, scale, |block, at| {
            let folds = block.statistics.folds.as_ref().expect("kept");
            let taken = folds.at(at).enumerate().filter(|(fold, _)| takes(*fold));
            taken.map(|(_, radiance)| radiance.as_dvec3()).sum()
        })
    }

    /// Luminance of a fold in a window, row by row.
    pub fn luminance_of(&self, window: Window, fold: usize) -> Vec<f32> {
        self.luminance(window, |f| f % self.n == fold)
    }

    /// Luminance in a window of each of the [`DENOISE_FOLDS`] folds that make up one of `n` folds,
    /// row by row.
    pub fn parts_of(&self, window: Window, fold: usize) -> Vec<Vec<f32>> {
        let parts = (0..DENOISE_FOLDS).filter(|f| f % self.n == fold);
        parts.map(|part| self.luminance(window, |f| f == part)).collect()
    }

    /// Radiance of all other folds in a window, row by row.
    pub fn without(&self, window: Window, fold: usize) -> Vec<Rgb> {
        self.mean(window, |f| f % self.n != fold).iter().map(|value| value.as_vec3()).collect()
    }

    /// Isolated light sources that pixels see in all other folds in a window, row by row.
    pub fn seen_without(&self, window: Window, fold: usize) -> Vec<Rgb> {
        isolated_lights(self.image, window, |f| f % self.n != fold)
    }

    fn luminance(&self, window: Window, takes: impl Fn(usize) -> bool + Sync) -> Vec<f32> {
        self.mean(window, takes).iter().map(|value| luminance(*value) as f32).collect()
    }
}
