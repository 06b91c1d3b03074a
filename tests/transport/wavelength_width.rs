//! The kernel over wavelengths where camera paths and photons have one: nested widths, its bias and
//! the noise law.

use crate::common::dispersive_box::glass;
use crate::common::*;
use bdpm::Renderer;
use bdpm::Settings;
use bdpm::film::radiance::luminance;
use bdpm::noise::Measure;
use bdpm::noise::merge_bias::MergeBias;
use bdpm::render::RenderConfig;
use bdpm::scene::{Emitter, Medium, Mesh, RefractiveIndex, Scene, Spot};
use bdpm::settings::{Bias, Kernel};
use glam::{DVec3, Vec3};
use std::sync::Arc;

const SIDE: u32 = 12;

/// Angle of the edge of the beam from its axis.
const EDGE: f32 = 0.175;

/// Iterations that measure the bias.
const ITERATIONS: usize = 150;

/// A ball of strong dispersion between a spot and a plane far behind it. The camera at the place of
/// the spot sees the plane through the ball. It sees the edge of the beam sharply, because camera
/// paths and photons of one wavelength arrive at the same place. Other wavelengths arrive up to
/// half a unit away. With `fog`, a medium is between all objects.
fn seen_through_a_ball(fog: bool) -> Arc<Scene> {
    let ball = sphere(Vec3::ZERO, 0.5, 4, false, 1);
    let normals = ball.positions.iter().map(|p| p.normalize()).collect();
    let meshes = vec![square(-4.0 * Vec3::Z, Vec3::Z, 6.0, 0), Mesh { normals, ..ball }];
    let position = Vec3::new(0.001, 0.0, 2.0);
    let spot = Spot {
        position,
        direction: -position.normalize(),
        intensity: Vec3::splat(100.0),
        cos_inner: f64::from(EDGE - 0.0005).cos(),
        cos_outer: f64::from(EDGE + 0.0005).cos(),
        falloff: bdpm::scene::Falloff::default(),
    };
    let glass = glass(RefractiveIndex::Abbe { index: 1.5, abbe: 4.0 });
    let scene = scene(
        meshes,
        vec![gray(0.5, 0.0), glass],
        vec![Emitter::Spot(spot)],
        camera(2.0 * Vec3::Z, 2.0 * EDGE.tan() * Vec3::X, 4.0),
    );
    if !fog {
        return scene;
    }
    let [absorption, scattering] = [0.1, 0.4].map(Vec3::splat);
    let fog = Medium { name: "fog".into(), absorption, scattering, asymmetry: 0.0, priority: 0 };
    Arc::unwrap_or_clone(scene).with_filling_medium(Some(fog.into())).unwrap().into()
}

fn wide() -> Settings {
    Settings {
        light_paths: 20_000,
        radius: 0.15,
        caustic_radius: 0.15,
        wavelength_width: 0.6,
        // Few of the balls are cut by surfaces, which are looked up farther away for larger ones.
        medium_scale: 0.1,
        ..settings(SIDE, SIDE)
    }
}

/// The same paths merged within radii and a width that are `share` of those of `settings`.
fn scaled(settings: &Settings, share: f32) -> Settings {
    Settings {
        radius: share * settings.radius,
        caustic_radius: share * settings.caustic_radius,
        wavelength_width: f64::from(share) * settings.wavelength_width,
        ..settings.clone()
    }
}

/// Nested differences and the annulus are differences of images of the same paths within smaller
/// radii and widths.
#[test]
fn nested_merges_equal_renders_at_those_radii_and_widths() {
    for (fog, merge_vertex, kernel, tolerance) in [
        (false, 1, Kernel::Disc, 2e-4),
        (false, 2, Kernel::Disc, 2e-4),
        (true, 1, Kernel::Disc, 0.05),
        // The areas of the images reach to different distances.
        (false, 1, Kernel::Area, 0.05),
    ] {
        let (scene, whole) =
            (seen_through_a_ball(fog), Settings { merge_vertex, kernel, ..wide() });
        let accel = accel(&scene);
        let iterated = |settings: Settings| {
            let renderer = Renderer::new(&scene, &accel, settings).unwrap();
            let mut renderer = renderer.configure(RenderConfig::with_pixel_batches()).unwrap();
            (0..4).for_each(|_| drop(renderer.iterate(Measure::Pairs)));
            renderer
        };
        let mean = |renderer: &Renderer| renderer.film().sums.map_rows(|sums| sums.radiance / 4.0);
        let measured = iterated(Settings { bias: Bias::Reduce, ..whole.clone() });
        let [inner, half] = [0.5f32.sqrt(), 0.5].map(|s| mean(&iterated(scaled(&whole, s))));
        // At the radii of `half`, but over all of the wavelengths.
        let radii = Settings { wavelength_width: 0.6, ..scaled(&whole, 0.5) };
        let radii = mean(&iterated(radii));
        let annulus = measured.block().statistics.annulus.as_ref().unwrap();
        let noise = measured.block().noise_image().unwrap();
        let annulus: Vec<DVec3> = (0..annulus.folds()[0].values().len())
            .map(|at| {
                let classes = annulus.folds().iter().flat_map(|fold| fold.values()[at].classes);
                classes.map(|moments| moments.sum.as_dvec3() / 4.0).sum()
            })
            .collect();
        let from_annulus: DVec3 = annulus.into_iter().sum();
        let (mut squares, mut differences) = ([0.0; 3], [0.0; 3]);
        let whole = mean(&measured);
        for (pixel, estimate) in noise.pixels.iter().enumerate() {
            let [a, b, c, r] = [&whole, &inner, &half, &radii].map(|of| luminance(of[pixel]));
            let nested = estimate.noise.nested;
            let terms = [(nested[0], a - b), (nested[1], b - c), (c - r, 0.0)];
            for (k, (found, expected)) in terms.into_iter().enumerate() {
                squares[k] += expected * expected;
                differences[k] += (found - expected).powi(2);
            }
        }
        let what = format!("fog {fog}, k = {merge_vertex}, {kernel:?}");
        let total = |of: &[DVec3]| of.iter().sum::<DVec3>();
        let off = (from_annulus - (total(&whole) - total(&half))).length() / total(&whole).length();
        println!("{what}: {squares:?} {differences:?} {off}");
        for k in 0..2 {
            assert!(squares[k] > 0.0);
            assert!(differences[k] < tolerance * tolerance * squares[k], "{what}, {k}");
        }
        assert!(off < tolerance, "{what}: {off}");
        // The width matters.
        assert!(differences[2] > 0.001 * (squares[0] + squares[1]), "{what}");
    }
}

/// Beside the beam it is dark, but photons of other wavelengths are there, and those of other
/// places within the radius.
#[test]
fn measured_bias_has_that_of_the_width() {
    let scene = &seen_through_a_ball(false);
    let accel = accel(scene);
    let view = scene.camera.view(SIDE, SIDE);
    let is_dark = |pixel: &usize| {
        let (x, y) = (*pixel as u32 % SIDE, *pixel as u32 / SIDE);
        let (ray, _) = scene.camera_ray(&view, x as f32 + 0.5, y as f32 + 0.5, [0.5; 2]);
        ray.direction.angle_between(-Vec3::Z) > EDGE
    };
    let region: Vec<usize> = (0..(SIDE * SIDE) as usize).filter(is_dark).collect();
    let mean = |settings: &Settings| {
        let samples = pixel_samples(scene, &accel, settings.clone(), ITERATIONS);
        let mean = |i: usize| {
            region.iter().map(|&pixel| samples[pixel][i]).sum::<f64>() / region.len() as f64
        };
        Estimate::from_samples(&(0..ITERATIONS).map(mean).collect::<Vec<f64>>())
    };
    let wide = Settings { seed: 2, ..wide() };
    let narrow = Settings { wavelength_width: 0.05, ..wide.clone() };
    let exact = Settings { caustic_radius: 0.01, light_paths: 100_000, ..narrow.clone() };
    let [exact, narrow, merged] = [&exact, &narrow, &wide].map(mean);
    let noise = far_counts::measure(scene, &accel, wide, ITERATIONS, Measure::Pairs);
    let estimated = MergeBias::new(&noise, &region).mean;
    println!("{exact:?} {narrow:?} {merged:?} {estimated:?}");
    let (real, of_width) = (merged.mean - exact.mean, merged.mean - narrow.mean);
    let error = merged.error.hypot(exact.error).hypot(estimated.error);
    // A fifteenth of the radius and a twelfth of the width have a bias, too.
    let most = 3.0 * error + real / 12.0;
    assert!((estimated.value - real).abs() < most, "{estimated:?} {real} +- {error}");
    assert!(of_width > 4.0 * error, "{of_width} does not stand out from {error}");
}

#[test]
fn noise_through_a_ball_is_predicted() {
    for (merge_vertex, wavelength_width) in [(1, 0.06), (2, 0.3)] {
        let settings = Settings { merge_vertex, wavelength_width, ..wide() };
        let (name, scene) = (format!("ball k = {merge_vertex}"), &seen_through_a_ball(false));
        far_counts::Subject {
            name,
            scene,
            settings,
            few: 300,
            iterations: 2500,
            quiet: 0.9,
            most: 0.06,
        }
        .assert_far_counts(&[(6000, 4, 300), (300, 60, 400)]);
    }
}
