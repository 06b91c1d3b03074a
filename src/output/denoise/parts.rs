//! An image in parts of equal composition.

use crate::base::math::Rgb;
use crate::film::features::FeatureFolds;
use crate::film::folds::DENOISE_FOLDS;
use crate::film::radiance::{luminance, total};
use crate::render::block::{Block, CombinedImage};
use glam::{DVec3, Vec3};

/// Noise of guides that need no denoising of their own, RMS: less than a step of 8-bit colors.
const CLEAN: f64 = 1.0 / 256.0;

/// What guides a denoiser: albedo and normals, row by row; nothing of what is not known.
#[derive(Clone, Debug, Default)]
pub struct Guides {
    /// Albedo in [0, 1].
    pub albedo: Vec<Rgb>,
    /// Means of unit normals.
    pub normal: Vec<Vec3>,
    /// Whether there is hardly any noise in them: where there is, they have to be denoised as well.
    pub clean: bool,
}

/// Guides of the parts that are taken.
pub(super) fn guides(
    image: &CombinedImage,
    features: Option<&FeatureFolds>,
    takes: impl Fn(usize) -> bool + Sync,
) -> Guides {
    let Some(features) = features else { return Guides::default() };
    let film = &image.blocks()[0].film;
    let mut both = vec![(Rgb::ZERO, Vec3::ZERO); film.pixels()];
    film.sums.zip_pixels(&mut both, |both, at| {
        let guide = features.mean(at, &takes);
        *both = (guide.albedo, guide.normal);
    });
    let (albedo, normal) = both.into_iter().unzip();
    Guides { albedo, normal, clean: false }
}

/// Whether guides of all parts have hardly any noise.
pub(super) fn are_clean(image: &CombinedImage, features: Option<&FeatureFolds>) -> bool {
    guide_noise(image, features).is_some_and(|noise| noise < CLEAN)
}

/// RMS of the noise that guides of all parts have, per channel; nothing unless parts are told apart.
fn guide_noise(image: &CombinedImage, features: Option<&FeatureFolds>) -> Option<f64> {
    let features = features.filter(|features| features.is_folded())?;
    let film = &image.blocks()[0].film;
    let mut variance = vec![0.0; film.pixels()];
    film.sums.zip_pixels(&mut variance, |variance, at| {
        let mean = features.mean(at, |_| true);
        let off = |part: usize| {
            let own = features.mean(at, |p| p == part);
            f64::from((own.albedo - mean.albedo).length_squared())
                + f64::from((own.normal - mean.normal).length_squared())
        };
        *variance = (0..DENOISE_FOLDS).map(off).sum::<f64>()
            / (DENOISE_FOLDS * (DENOISE_FOLDS - 1) * 6) as f64;
    });
    Some((total(&variance, |v| *v) / variance.len() as f64).sqrt())
}

/// An image as `n` images of as many samples.
pub struct InParts<'a> {
    image: &'a CombinedImage<'a>,
    features: Option<&'a FeatureFolds>,
    n: usize,
    /// Whether guides are clean, of all parts.
    clean: bool,
}

impl<'a> InParts<'a> {
    /// `None` unless all blocks keep parts, and each of `n` of them has at least one iteration.
    pub fn new(
        image: &'a CombinedImage<'a>,
        features: Option<&'a FeatureFolds>,
        n: usize,
    ) -> Option<Self> {
        let divides = n >= 4 && DENOISE_FOLDS.is_multiple_of(n);
        let kept = image.blocks().iter().all(|block| block.statistics.folds.is_some());
        let features = features.filter(|features| features.is_folded());
        if !(divides && kept) {
            return None;
        }
        let own = Self { image, features, n, clean: are_clean(image, features) };
        (0..n).all(|part| own.weight(|p| p % n == part) > 0.0).then_some(own)
    }

    /// Width and height, pixels.
    pub fn resolution(&self) -> (u32, u32) {
        self.image.resolution()
    }

    /// How many parts.
    pub fn len(&self) -> usize {
        self.n
    }

    /// Never.
    pub fn is_empty(&self) -> bool {
        self.n == 0
    }

    /// Weight of all iterations of the finest parts that are taken.
    fn weight(&self, takes: impl Fn(usize) -> bool) -> f64 {
        let own = |(block, weight): (&Block, &f64)| {
            let parts = block.statistics.folds.as_ref().expect("kept");
            let taken = (0..DENOISE_FOLDS).filter(|&part| takes(part));
            weight * taken.map(|part| parts.iterations()[part]).sum::<u64>() as f64
        };
        self.image.blocks().iter().zip(self.image.weights()).map(own).sum()
    }

    fn mean(&self, takes: impl Fn(usize) -> bool + Sync) -> Vec<DVec3> {
        let blocks = self.image.blocks();
        let scale = self.weight(&takes).recip();
        let mut sums = vec![DVec3::ZERO; blocks[0].film.pixels()];
        for (block, weight) in blocks.iter().zip(self.image.weights()) {
            let parts = block.statistics.folds.as_ref().expect("kept");
            block.film.sums.zip_pixels(&mut sums, |sum, at| {
                let taken = parts.at(at).enumerate().filter(|(part, _)| takes(*part));
                *sum += taken.map(|(_, part)| part.as_dvec3()).sum::<DVec3>() * (weight * scale);
            });
        }
        sums
    }

    /// What guides a denoiser of all parts.
    pub fn guides(&self) -> Guides {
        Guides { clean: self.clean, ..guides(self.image, self.features, |_| true) }
    }

    /// Luminance of a part, row by row.
    pub fn luminance_of(&self, part: usize) -> Vec<f32> {
        self.mean(|p| p % self.n == part).iter().map(|value| luminance(*value) as f32).collect()
    }

    /// Radiance of all other parts, row by row, and what guides a denoiser of these.
    pub fn without(&self, part: usize) -> (Vec<Rgb>, Guides) {
        let others = |p: usize| p % self.n != part;
        let radiance = self.mean(others).iter().map(|value| value.as_vec3()).collect();
        (radiance, Guides { clean: self.clean, ..guides(self.image, self.features, others) })
    }
}
