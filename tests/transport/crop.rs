//! A window of an image has the mean of the same pixels of the full image.

use bdpm::base::math::luminance;
use bdpm::load::Loaded;
use bdpm::scene::{Camera, FieldOfView, Optics};
use bdpm::settings::{PartialSettings, Settings};
use bdpm::{RenderJob, Stop, load};
use glam::Vec3;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box-classic");
const SEEDS: u64 = 16;
const FULL: [u32; 2] = [24, 18];
/// Left column, top row, width and height.
const WINDOW: [u32; 4] = [4, 5, 12, 9];

/// Luminance of each pixel for each seed.
fn images(loaded: &Loaded, crop: Option<[u32; 4]>, first_seed: u64) -> Vec<Vec<f64>> {
    let image = |seed| {
        let settings = PartialSettings {
            resolution: Some(FULL),
            crop,
            light_paths: Some(1000),
            camera_paths: Some(8),
            seed: Some(seed),
            ..Default::default()
        };
        let stop = Stop { iterations: Some(4), ..Stop::default() };
        let result = RenderJob::new(loaded).settings(settings).stop(stop).render().unwrap();
        result.image.iter().map(|pixel| f64::from(luminance(*pixel))).collect()
    };
    (first_seed..first_seed + SEEDS).map(image).collect()
}

/// Mean over the seeds and its squared standard error.
fn statistics(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = SEEDS as f64;
    let mean = values.clone().sum::<f64>() / n;
    (mean, values.map(|value| (value - mean).powi(2)).sum::<f64>() / (n * (n - 1.0)))
}

/// The squared difference of two means over its variance.
fn squared_score(a: (f64, f64), b: (f64, f64)) -> f64 {
    (a.0 - b.0).powi(2) / (a.1 + b.1)
}

#[test]
fn window_has_the_mean_of_its_pixels_in_the_full_image() {
    let loaded = load(SCENE).unwrap();
    let (part, full) = (images(&loaded, Some(WINDOW), 1), images(&loaded, None, 101));
    let [x0, y0, width, height] = WINDOW.map(|pixels| pixels as usize);
    // The index in the full image of a pixel of the window, which is moved by some columns.
    let index = |pixel: usize, moved: usize| {
        let (x, y) = (pixel % width, pixel / width);
        (y0 + y) * FULL[0] as usize + x0 + x + moved
    };
    let pixels = width * height;
    let part_sum = statistics(part.iter().map(|image| image.iter().sum()));
    let full_sum =
        statistics(full.iter().map(|image| (0..pixels).map(|pixel| image[index(pixel, 0)]).sum()));
    let score = squared_score(part_sum, full_sum);
    assert!(score < 16.0, "{part_sum:?} {full_sum:?}");
    // The mean over pixels of a square of Student's t with 30 degrees of freedom is 30/28.
    let mean_score = |moved: usize| {
        let scores = (0..pixels).map(|pixel| {
            let a = statistics(part.iter().map(|image| image[pixel]));
            let b = statistics(full.iter().map(|image| image[index(pixel, moved)]));
            squared_score(a, b)
        });
        scores.sum::<f64>() / pixels as f64
    };
    assert!(mean_score(0) < 2.0, "{}", mean_score(0));
    // The test notices a window that is one column off.
    assert!(mean_score(1) > 4.0, "{}", mean_score(1));
}

#[test]
fn window_has_the_rays_of_its_pixels_in_the_full_image() {
    let aperture_radius = 0.1;
    let field_of_view = FieldOfView::Y(60.0);
    let (width, disc_distance, disc_radius, exposure) = (0.3, 1.0, 0.2, 1.0);
    for optics in [
        Optics::Pinhole(field_of_view),
        Optics::Pinhole(FieldOfView::X(60.0)),
        Optics::ThinLens { field_of_view, aperture_radius, focus_distance: 2.0 },
        Optics::Sensor { width, disc_distance, disc_radius, exposure },
    ] {
        let camera = Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, optics).unwrap();
        let requested = PartialSettings {
            resolution: Some([40, 30]),
            crop: Some([7, 11, 20, 10]),
            ..Default::default()
        };
        let settings = Settings::resolve(&requested, &Default::default(), 1.0).unwrap();
        assert_eq!(settings.resolution(), (20, 10));
        let (full, window) = (camera.view(40, 30), camera.view_of(&settings));
        for (x, y) in [(0.0, 0.0), (19.5, 3.25), (20.0, 10.0)] {
            let lens = [0.3, 0.8];
            let (part, part_weight) = window.ray(x, y, lens);
            let (whole, whole_weight) = full.ray(x + 7.0, y + 11.0, lens);
            assert!((part.direction - whole.direction).length() < 1e-5, "{optics:?} {x} {y}");
            assert!((part.origin - whole.origin).length() < 1e-5, "{optics:?} {x} {y}");
            assert!((part_weight / whole_weight - 1.0).abs() < 1e-4, "{optics:?} {x} {y}");
        }
    }
}
