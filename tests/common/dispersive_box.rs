//! A ball of strong dispersion in a box: means of each channel.

use super::several_ways::{Weighting, weighted};
use super::{Estimate, accel, camera, gray, scene, settings, sphere, square};
use bdpm::noise::Measure;
use bdpm::scene::bsdf::{Bsdf, Dielectric};
use bdpm::scene::{Dispersion, Material, RefractiveIndex};
use bdpm::settings::{Direct, Kernel};
use bdpm::transport::reference::PathTracer;
use bdpm::{Renderer, Scene, Settings};
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// Glass of this medium in air.
pub fn glass(inside: RefractiveIndex) -> Material {
    let bsdf = Bsdf::Dielectric(Dielectric::new(inside.at_d() as f32));
    let dispersion = Dispersion::new(inside, RefractiveIndex::Constant(1.0)).map(Arc::new);
    Material { dispersion, ..Material::new("glass", bsdf) }
}

const SIDE: u32 = 16;
const TILE: u32 = 4;

/// Mean of each channel in each tile and iteration, from the sums of an image:
/// `[3 tile + channel][iteration]`.
fn samples(iterations: usize, mut next: impl FnMut() -> Vec<DVec3>) -> Vec<Vec<f64>> {
    let across = SIDE / TILE;
    let mut all = vec![Vec::with_capacity(iterations); (3 * across * across) as usize];
    let mut before = vec![DVec3::ZERO; (SIDE * SIDE) as usize];
    for _ in 0..iterations {
        let sums = next();
        let mut means = vec![0.0; all.len()];
        for (pixel, (sum, before)) in (0..).zip(sums.iter().zip(&before)) {
            let tile = pixel / SIDE / TILE * across + pixel % SIDE / TILE;
            for (channel, value) in (*sum - *before).to_array().into_iter().enumerate() {
                means[3 * tile as usize + channel] += value / f64::from(TILE * TILE);
            }
        }
        all.iter_mut().zip(means).for_each(|(series, mean)| series.push(mean));
        before = sums;
    }
    all
}

pub fn rendered(scene: &Arc<Scene>, settings: Settings, iterations: usize) -> Vec<Vec<f64>> {
    let accel = accel(scene);
    let mut renderer = Renderer::new(scene, &accel, settings).unwrap();
    samples(iterations, || {
        let report = renderer.iterate(Measure::Off);
        assert!(report.non_finite.is_empty());
        renderer.film().sums.map_rows(|sums| sums.radiance)
    })
}

/// Asserts that channels of tiles agree within their errors, and their means within `resolution`,
/// relative.
#[track_caller]
pub fn assert_equal(what: &str, own: &[Vec<f64>], other: &[Vec<f64>], resolution: f64) {
    let estimates = |all: &[Vec<f64>]| -> Vec<_> {
        all.iter().map(|samples| Estimate::from_samples(samples)).collect()
    };
    let (a, b) = (estimates(own), estimates(other));
    let mut squares = 0.0;
    for (a, b) in a.iter().zip(&b) {
        squares += (a.mean - b.mean).powi(2) / (a.error * a.error + b.error * b.error);
    }
    squares /= a.len() as f64;
    for channel in 0..3 {
        let whole = |all: &[Vec<f64>]| {
            let tiles: Vec<_> = all.iter().skip(channel).step_by(3).collect();
            let mean =
                |i: usize| tiles.iter().map(|tile| tile[i]).sum::<f64>() / tiles.len() as f64;
            Estimate::from_samples(&(0..tiles[0].len()).map(mean).collect::<Vec<_>>())
        };
        let (a, b) = (whole(own), whole(other));
        let error = a.error.hypot(b.error) / b.mean;
        let off = a.mean / b.mean - 1.0;
        println!("{what}, channel {channel}: {off:+.5} +- {error:.5}, squares {squares:.2}");
        assert!(error < resolution, "{what}: {error} says little");
        assert!(off.abs() < 4.0 * error, "{what}, channel {channel}: {off} +- {error}");
    }
    assert!(squares < 2.0, "{what}: {squares}");
}

/// A box with a panel, and a ball of strong dispersion that casts a caustic.
pub fn ball_under_a_panel(ball_material: Material) -> Arc<Scene> {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
    }
    meshes.push(square(Vec3::new(0.0, 0.0, 0.95), -Vec3::Z, 0.6, 1));
    meshes.push(sphere(Vec3::new(0.1, 0.1, -0.4), 0.35, 3, false, 2));
    let materials = vec![gray(0.5, 0.0), gray(0.0, 1.0), ball_material];
    scene(
        meshes,
        materials,
        vec![],
        camera(Vec3::new(-0.9, -0.85, 0.2), Vec3::new(0.2, 0.2, -0.5), 70.0),
    )
}

pub fn base_settings() -> Settings {
    Settings {
        kernel: Kernel::Area,
        light_paths: 8000,
        camera_paths: 8,
        radius: 0.04,
        caustic_radius: 0.04,
        merge_vertex: 2,
        seed: 5,
        ..settings(SIDE, SIDE)
    }
}

/// Asserts that images by these weights have the mean of the path tracer in each channel, and
/// images with merges at vertex 2 alone if `merges_once`.
#[track_caller]
pub fn assert_means_of_the_path_tracer(merges_once: bool, weightings: &[Weighting]) {
    let scene = ball_under_a_panel(glass(RefractiveIndex::Abbe { index: 1.5, abbe: 5.0 }));
    let accel = accel(&scene);
    let mut tracer = PathTracer::new(&scene, &*accel, &settings(SIDE, SIDE));
    let reference = samples(250, || {
        tracer.iterate(256);
        tracer.film().sums.map_rows(|sums| sums.radiance)
    });
    for direct in [Direct::Connect, Direct::PhotonMap] {
        let settings = Settings { direct, ..base_settings() };
        if merges_once {
            let single = rendered(&scene, settings.clone(), 250);
            assert_equal(&format!("single, {direct:?}"), &single, &reference, 0.02);
        }
        for &weighting in weightings {
            let own = rendered(&scene, weighted(&settings, weighting), 250);
            assert_equal(&format!("{weighting:?}, {direct:?}"), &own, &reference, 0.02);
        }
    }
}
