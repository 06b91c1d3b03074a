//! Correction of the merge bias: contribution of the outer annulus, and error of corrected images.

use crate::common::boxes::named;
use crate::common::{accel, furnished_box, settings};
use bdpm::film::annulus::FOLDS;
use bdpm::film::radiance::luminance;
use bdpm::noise::Measure;
use bdpm::render::block::CombinedImage;
use bdpm::settings::{Bias, Direct, Kernel, Strategy};
use bdpm::{Renderer, Scene, Settings};
use glam::DVec3;
use std::sync::Arc;

/// Renders measured and other iterations with these settings.
fn rendered(from: &Renderer, settings: Settings, iterations: u64) -> Renderer {
    let mut renderer = from.with_settings(settings).unwrap();
    for iteration in 0..iterations {
        let measure = if iteration % 3 == 0 { Measure::Pairs } else { Measure::Off };
        renderer.iterate(measure);
    }
    renderer
}

/// Relative RMS error of the annulus against the difference of images at the radii and at half of
/// them, from the same photons.
fn annulus_error(scene: &Arc<Scene>, settings: &Settings) -> f64 {
    let accel = accel(scene);
    let from = Renderer::new(scene, &accel, settings.clone()).unwrap();
    let whole = rendered(&from, Settings { bias: Bias::Reduce, ..settings.clone() }, 7);
    let (radius, caustic_radius) = (0.5 * settings.radius, 0.5 * settings.caustic_radius);
    let half = rendered(&from, Settings { radius, caustic_radius, ..settings.clone() }, 7);
    let annulus = whole.block().statistics.annulus.as_ref().unwrap();
    assert_eq!(annulus.iterations(), [4, 3]);
    let (mut square, mut difference) = (0.0, 0.0);
    let sums = whole.film().sums.values().iter().zip(half.film().sums.values());
    for (at, (whole, half)) in sums.enumerate() {
        let expected = whole.radiance - half.radiance;
        let folds = annulus.folds().iter().flat_map(|fold| fold.values()[at].classes);
        let annulus: DVec3 = folds.map(|moments| moments.sum.as_dvec3()).sum();
        square += expected.length_squared();
        difference += (annulus - expected).length_squared();
    }
    assert!(square > 0.0);
    (difference / square).sqrt()
}

#[test]
fn annulus_matches_difference_of_images_at_two_radii() {
    let start = Settings { radius: 0.2, caustic_radius: 0.1, ..settings(20, 15) };
    let single = |merge_vertex, direct| Settings { merge_vertex, direct, ..start.clone() };
    for (scene, settings) in [
        ("box", single(1, Direct::Connect)),
        ("box", single(2, Direct::Connect)),
        ("mirror-ball", single(1, Direct::Connect)),
        ("mirror-ball", Settings { caustic_radius: 0.2, ..single(1, Direct::PhotonMap) }),
        // Few enough facets within reach, so that radii do not shrink.
        (
            "wide-gloss-ball",
            Settings { radius: 0.1, caustic_radius: 0.05, ..single(1, Direct::PhotonMap) },
        ),
    ] {
        let error = annulus_error(&named(scene), &settings);
        assert!(error < 1e-4, "{scene}: {error}");
        // The areas of both images reach to different distances
        let error = annulus_error(&named(scene), &Settings { kernel: Kernel::Area, ..settings });
        assert!(error < 0.05, "{scene} with areas: {error}");
    }
}

#[test]
fn corrected_image_is_uncorrected_image_less_correction() {
    let scene = named("mirror-ball");
    let accel = accel(&scene);
    let start = Settings { radius: 0.2, caustic_radius: 0.2, ..settings(20, 15) };
    for strategy in [Strategy::Single, Strategy::Mis] {
        let keep = Settings { strategy, merge_vertex: 2, ..start.clone() };
        let from = Renderer::new(&scene, &accel, keep.clone()).unwrap();
        let kept = rendered(&from, keep.clone(), 12);
        let reduced = rendered(&from, Settings { bias: Bias::Reduce, ..keep }, 12);
        // Classes of equal radii are added separately, which changes the order of additions
        for (one, other) in kept.film().mean().iter().zip(reduced.film().mean()) {
            assert!((*one - other).abs().max_element() <= 1e-5 * one.max_element());
        }
        let image = CombinedImage::new(reduced.blocks(), vec![1.0]);
        let correction = image.bias_correction().unwrap();
        let merged = reduced.film().mean();
        for ((mean, merged), bias) in image.mean().iter().zip(merged).zip(&correction.correction) {
            assert_eq!(*mean, merged - *bias);
        }
        assert!(CombinedImage::new(kept.blocks(), vec![1.0]).bias_correction().is_none());
    }
}

#[test]
fn correction_reduces_error_and_estimates_the_rest() {
    let scene = furnished_box();
    let accel = accel(&scene);
    // A wide disc loses light along edges
    let wide = Settings { radius: 0.3, light_paths: 4000, ..settings(32, 24) };
    let from = Renderer::new(&scene, &accel, wide.clone()).unwrap();
    let truth = Settings {
        radius: 0.05,
        kernel: Kernel::Area,
        light_paths: 100_000,
        seed: 2,
        ..wide.clone()
    };
    let truth = rendered(&from, truth, 120).film().mean();
    let error = |renderer: &Renderer| {
        let image = CombinedImage::new(renderer.blocks(), vec![1.0]);
        let square = |(one, other): (&glam::Vec3, &glam::Vec3)| {
            luminance((*one - *other).as_dvec3()).powi(2)
        };
        let found = image.mean().iter().zip(&truth).map(square).sum::<f64>() / truth.len() as f64;
        let estimate = image.bias_correction().map_or(0.0, |correction| {
            let noise: f64 = image.variance_of_mean().unwrap().iter().sum();
            (noise + correction.bias2.iter().sum::<f64>()) / truth.len() as f64
        });
        (found.sqrt(), estimate.max(0.0).sqrt())
    };
    let (kept, _) = error(&rendered(&from, wide.clone(), 200));
    let reduced = rendered(&from, Settings { bias: Bias::Reduce, ..wide }, 200);
    let (found, estimate) = error(&reduced);
    println!("kept {kept}, reduced {found}, estimated {estimate}; {FOLDS} folds");
    // Half the radius has half the loss, and more noise
    assert!(found < 0.65 * kept, "{found} of {kept}");
    assert!((estimate / found - 1.0).abs() < 0.25, "{estimate} for {found}");
}
