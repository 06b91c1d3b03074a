//! Correction of the merge bias: the contribution of the outer annulus, and the corrected images.

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

/// Sums over iterations that measure and others, with a renderer of these settings.
fn rendered<'a>(from: &Renderer, settings: Settings, iterations: u64) -> Renderer {
    let mut renderer = from.with_settings(settings).unwrap();
    for iteration in 0..iterations {
        let measure = if iteration % 3 == 0 { Measure::Pairs } else { Measure::Off };
        renderer.iterate(measure);
    }
    renderer
}

/// Root mean square error of the outer annulus's contribution, relative to that contribution. The truth is the
/// difference of two images from the same photons, at the radii and at half the radii.
fn amiss(scene: &Arc<Scene>, settings: &Settings) -> f64 {
    let accel = accel(scene);
    let from = Renderer::new(scene, &accel, settings.clone()).unwrap();
    let whole = rendered(&from, Settings { bias: Bias::Reduce, ..settings.clone() }, 7);
    let (radius, caustic_radius) = (0.5 * settings.radius, 0.5 * settings.caustic_radius);
    let half = rendered(&from, Settings { radius, caustic_radius, ..settings.clone() }, 7);
    let beyond = whole.block().beyond.as_ref().unwrap();
    assert_eq!(beyond.iterations(), [4, 3]);
    let (mut square, mut apart) = (0.0, 0.0);
    let sums = whole.film().sums().iter().zip(half.film().sums()).zip(beyond.pixels());
    for ((whole, half), told) in sums {
        let expected = whole.radiance - half.radiance;
        let told: DVec3 =
            told.iter().flat_map(|side| side.classes).map(|moments| moments.sum.as_dvec3()).sum();
        square += expected.length_squared();
        apart += (told - expected).length_squared();
    }
    assert!(square > 0.0);
    (apart / square).sqrt()
}

#[test]
fn outer_annulus_matches_the_difference_of_two_radii() {
    let start = Settings { radius: 0.2, caustic_radius: 0.1, ..settings(20, 15) };
    let single = |merge_vertex, direct| Settings { merge_vertex, direct, ..start.clone() };
    for (scene, settings) in [
        ("box", single(1, Direct::Connect)),
        ("box", single(2, Direct::Connect)),
        ("mirror-ball", single(1, Direct::Connect)),
        ("mirror-ball", Settings { caustic_radius: 0.2, ..single(1, Direct::PhotonMap) }),
        ("wide-gloss-ball", single(1, Direct::PhotonMap)),
    ] {
        let apart = amiss(&named(scene), &settings);
        assert!(apart < 1e-4, "{scene}: {apart}");
        // Areas within twice the radius know more of what surrounds a point.
        let apart = amiss(&named(scene), &Settings { kernel: Kernel::Area, ..settings });
        assert!(apart < 0.05, "{scene} with areas: {apart}");
    }
}

#[test]
fn images_differ_only_by_the_correction() {
    let scene = named("mirror-ball");
    let accel = accel(&scene);
    let start = Settings { radius: 0.2, caustic_radius: 0.2, ..settings(20, 15) };
    for strategy in [Strategy::Single, Strategy::Mis] {
        let keep = Settings { strategy, merge_vertex: 2, ..start.clone() };
        let from = Renderer::new(&scene, &accel, keep.clone()).unwrap();
        let kept = rendered(&from, keep.clone(), 12);
        let reduced = rendered(&from, Settings { bias: Bias::Reduce, ..keep }, 12);
        // Classes of equal radii are summed apart: another order of additions.
        for (one, other) in kept.film().mean().iter().zip(reduced.film().mean()) {
            assert!((*one - other).abs().max_element() <= 1e-5 * one.max_element());
        }
        let image = CombinedImage::new(reduced.blocks(), vec![1.0]);
        let reduction = image.reduction().unwrap();
        let merged = reduced.film().mean();
        for ((mean, merged), off) in image.mean().iter().zip(merged).zip(&reduction.amount) {
            assert_eq!(*mean, merged - *off);
        }
        assert!(CombinedImage::new(kept.blocks(), vec![1.0]).reduction().is_none());
    }
}

#[test]
fn corrected_images_have_smaller_errors_and_report_them() {
    let scene = furnished_box();
    let accel = accel(&scene);
    // Discs lose a lot along edges within a wide radius.
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
        let told = image.reduction().map_or(0.0, |reduction| {
            let noise: f64 = image.variance_of_mean().unwrap().iter().sum();
            (noise + reduction.bias2.iter().sum::<f64>()) / truth.len() as f64
        });
        (found.sqrt(), told.max(0.0).sqrt())
    };
    let (kept, _) = error(&rendered(&from, wide.clone(), 200));
    let reduced = rendered(&from, Settings { bias: Bias::Reduce, ..wide }, 200);
    let (found, told) = error(&reduced);
    println!("kept {kept}, reduced {found}, told {told}; {FOLDS} sides");
    // Half the radius has half the loss, and more noise.
    assert!(found < 0.65 * kept, "{found} of {kept}");
    assert!((told / found - 1.0).abs() < 0.25, "{told} for {found}");
}
