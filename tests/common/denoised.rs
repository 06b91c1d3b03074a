//! The reported error of denoised images beside their error against a long reference.

use bdpm::accel::Intersect;
use bdpm::base::math::luminance;
use bdpm::film::aov::AovSelection;
use bdpm::film::folds::DENOISE_FOLDS;
use bdpm::film::radiance::Film;
use bdpm::noise::Measure;
use bdpm::output::denoise::{
    CrossValidation, FoldedImage, Mix, Oidn, Window, denoise_around, guides, importance,
    isolated_lights, mixed,
};
use bdpm::render::RenderConfig;
use bdpm::render::block::CombinedImage;
use bdpm::{Renderer, Scene, Settings};
use std::sync::Arc;

/// A long render of the same settings with other random numbers.
pub struct Reference {
    /// Row by row.
    pub luminance: Vec<f64>,
    /// Variance of the reference's own noise, per pixel.
    pub variance: Vec<f64>,
}

impl Reference {
    pub fn of(film: &Film) -> Self {
        let luminance = film.mean().into_iter().map(|value| f64::from(luminance(value)));
        let variance = film.variance_of_mean().expect("several iterations");
        Self { luminance: luminance.collect(), variance }
    }

    /// Renders a reference of `iterations`.
    #[allow(dead_code)] // examples go on with theirs
    pub fn render(
        scene: &Arc<Scene>,
        accel: &Arc<dyn Intersect>,
        settings: &Settings,
        n: u64,
    ) -> Self {
        let settings = Settings { seed: settings.seed + 1_000_003, ..settings.clone() };
        let mut renderer = Renderer::new(scene, accel, settings).unwrap();
        (0..n).for_each(|_| drop(renderer.iterate(Measure::Off)));
        Self::of(renderer.film())
    }

    /// The weighted mean square of what an image is off by, less what the reference's own noise
    /// adds.
    pub fn error(&self, image: impl Iterator<Item = f64>, weights: &[f64]) -> f64 {
        let own = self.luminance.iter().zip(&self.variance).zip(weights);
        let sum: f64 = image.zip(own).map(|(x, ((l, v), w))| w * ((x - l).powi(2) - v)).sum();
        sum / weights.iter().filter(|weight| **weight > 0.0).count().max(1) as f64
    }
}

/// Measured and reported error of a denoised image.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    /// Measured squared relative errors of the raw image, the denoised image, and their mix.
    pub raw: f64,
    pub unmixed: f64,
    pub mixed: f64,
    /// Reported squared error of the mix, and its standard error.
    pub reported: f64,
    pub error: f64,
    /// Deviation of the reported from the measured error in blocks of 16 by 16 pixels, in standard
    /// errors: mean square, and number of blocks.
    pub z2: f64,
    pub blocks: usize,
    /// Mean share of the raw image.
    pub share: f64,
}

/// Renders so many iterations and compares.
pub fn compare(
    scene: &Arc<Scene>,
    accel: &Arc<dyn Intersect>,
    settings: &Settings,
    iterations: u64,
    (reference, oidn): (&Reference, &mut Oidn),
) -> Found {
    let kept = AovSelection { folds: true, features: true, light: false, halves: false };
    let config = RenderConfig { aovs: kept, ..RenderConfig::default() };
    let mut renderer =
        Renderer::new(scene, accel, settings.clone()).unwrap().configure(config).unwrap();
    (0..iterations).for_each(|_| drop(renderer.iterate(Measure::Off)));
    let image = CombinedImage::new(renderer.blocks(), vec![1.0]);
    let parts = FoldedImage::new(&image, DENOISE_FOLDS).unwrap();
    let size = image.resolution();
    let guides = guides(&image, renderer.shared().features.as_ref());
    let guides = oidn.prefilter(size, guides).unwrap();
    let folds =
        CrossValidation::new(&parts, |_, radiance| oidn.denoise(size, radiance, &guides)).unwrap();
    let raw = image.mean();
    let kept = isolated_lights(&image, Window::whole(size), |_| true);
    let denoised = denoise_around(&kept, &raw, |rest| oidn.denoise(size, rest, &guides)).unwrap();
    let weights = importance(&denoised);
    let mix = Mix::new(&folds, &weights, Some(size));
    let (of_folds, delivered) = (folds.mixed(&mix), mixed(&raw, &denoised, &mix.shares));
    let rgb = |image: &[glam::Vec3], weights: &[f64]| {
        reference.error(image.iter().map(|value| f64::from(luminance(*value))), weights)
    };
    let estimate = of_folds.estimate(&weights);
    let (mut z2, mut blocks) = (0.0, 0);
    for block in 0..size.0.div_ceil(16) * size.1.div_ceil(16) {
        let (left, top) = (block % size.0.div_ceil(16), block / size.0.div_ceil(16));
        let inside = |pixel: usize| {
            let (x, y) = (pixel as u32 % size.0, pixel as u32 / size.0);
            x / 16 == left && y / 16 == top
        };
        let own = weights.iter().enumerate();
        let own: Vec<f64> = own.map(|(p, w)| if inside(p) { *w } else { 0.0 }).collect();
        let reported = of_folds.estimate(&own);
        if reported.standard_error > 0.0 {
            z2 += ((reported.squared - rgb(&delivered, &own)) / reported.standard_error).powi(2);
            blocks += 1;
        }
    }
    let share = mix.shares.iter().map(|share| f64::from(*share)).sum::<f64>();
    Found {
        raw: rgb(&raw, &weights),
        unmixed: rgb(&denoised, &weights),
        mixed: rgb(&delivered, &weights),
        reported: estimate.squared,
        error: estimate.standard_error,
        z2: z2 / f64::from(blocks.max(1) as u32),
        blocks,
        share: share / weights.len() as f64,
    }
}
