//! Dispersion: directions of each wavelength, white that stays white, and one image by all
//! strategies.

use crate::common::several_ways::WEIGHTINGS;
use crate::common::several_ways::weighted;
use crate::common::*;
use bdpm::Renderer;
use bdpm::Settings;
use bdpm::accel::{Intersect, Ray};
use bdpm::base::rng::{Rng, Stream, StreamKey};
use bdpm::base::spectrum::Wavelength;
use bdpm::noise::Measure;
use bdpm::scene::bsdf::{Bsdf, Dielectric, RoughDielectric};
use bdpm::scene::{Dispersion, Material, Mesh, RefractiveIndex, Scene};
use bdpm::settings::{Direct, Kernel};
use bdpm::transport::reference::PathTracer;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

fn medium(name: &str) -> RefractiveIndex {
    RefractiveIndex::named(name).unwrap()
}

/// Glass of this medium in air.
pub fn glass(inside: RefractiveIndex) -> Material {
    let bsdf = Bsdf::Dielectric(Dielectric::new(inside.at_d() as f32));
    let dispersion = Dispersion::new(inside, RefractiveIndex::Constant(1.0)).map(Arc::new);
    Material { dispersion, ..Material::new("glass", bsdf) }
}

/// Follows a ray of one wavelength through the surfaces that it meets, reflected at those of
/// `reflected` and refracted at the others. Returns its last direction; `None` if it cannot take
/// this way.
fn follow(
    scene: &Scene,
    accel: &dyn Intersect,
    mut ray: Ray,
    wavelength: Wavelength,
    reflected: &[bool],
) -> Option<DVec3> {
    let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
    for &is_reflected in reflected {
        let hit = accel.closest_hit(&ray);
        if hit.is_miss() {
            return None;
        }
        let mut surface = scene.surface(&ray, &hit);
        surface.disperse(&mut Some(wavelength), &mut rng);
        let wi = direction(&surface, is_reflected, &mut rng)?;
        ray = Ray::new(surface.start(wi), wi);
    }
    accel.closest_hit(&ray).is_miss().then(|| ray.direction.as_dvec3().normalize())
}

/// The reflected or the refracted direction at a smooth interface, whichever is asked for.
fn direction(surface: &bdpm::scene::Surface, is_reflected: bool, rng: &mut Rng) -> Option<Vec3> {
    (0..10_000).find_map(|_| {
        let wi = surface.scatter_flux(rng)?.wi;
        ((wi.dot(surface.normal) > 0.0) == is_reflected).then_some(wi)
    })
}

/// A prism of this apex angle along `z`, with the apex up.
fn prism(apex: f64, material: u32) -> Mesh {
    let (sin, cos) = (0.5 * apex).sin_cos();
    let corner = |x: f64, y: f64, z: f32| Vec3::new(x as f32, y as f32, z);
    let ends =
        [-1.0, 1.0].map(|z| [corner(0.0, 0.0, z), corner(-sin, -cos, z), corner(sin, -cos, z)]);
    let [[a, b, c], [d, e, f]] = ends;
    let positions = vec![a, b, c, d, e, f];
    let mut triangles = vec![[0, 2, 1], [3, 4, 5]];
    for [i, j] in [[0, 1], [1, 2], [2, 0]] {
        triangles.extend([[i, j, j + 3], [i, j + 3, i + 3]]);
    }
    Mesh { name: "prism".into(), positions, triangles, material, ..Mesh::default() }
}

#[test]
fn prism_deviates_each_wavelength_by_snells_law() {
    let apex = PI / 3.0;
    for name in ["N-BK7", "SF11", "water"] {
        let eye = camera(Vec3::new(0.0, 0.0, 9.0), Vec3::ZERO, 40.0);
        let scene = scene(vec![prism(apex, 0)], vec![glass(medium(name))], vec![], eye);
        let accel = accel(&scene);
        let mut seen = Vec::new();
        for wavelength in Wavelength::all().step_by(93) {
            let n = medium(name).at(wavelength.nanometers());
            // Toward the middle of the left face, at an angle of incidence close to that of least
            // deviation.
            let incidence = (1.02 * n * (0.5 * apex).sin()).asin();
            let tilt = incidence - 0.5 * apex;
            let into = DVec3::new(tilt.cos(), tilt.sin(), 0.0);
            let middle = 0.5 * DVec3::new(-(0.5 * apex).sin(), -(0.5 * apex).cos(), 0.0);
            let ray = Ray::new((middle - 2.0 * into).as_vec3(), into.as_vec3());
            let out = follow(&scene, &*accel, ray, wavelength, &[false, false]).unwrap();
            let first = (incidence.sin() / n).asin();
            let exit = (n * (apex - first).sin()).asin();
            let expected = incidence + exit - apex;
            let deviation = into.dot(out).acos();
            assert!((deviation - expected).abs() < 2e-6, "{name} {n}: {deviation} {expected}");
            seen.push(deviation);
        }
        assert!(seen.is_sorted_by(|a, b| a > b), "blue is deviated most");
    }
}

/// Scattering angle of a ray at the impact parameter `b` of a unit sphere of the index `n`, after
/// `k` reflections inside.
fn deviation(b: f64, n: f64, k: u32) -> f64 {
    let (i, r) = (b.asin(), (b / n).asin());
    2.0 * (i - r) + f64::from(k) * (PI - 2.0 * r)
}

#[test]
fn bows_of_a_water_sphere_are_at_the_angles_of_theory() {
    let water = medium("water");
    let ball = sphere(Vec3::ZERO, 1.0, 6, false, 0);
    let normals = ball.positions.iter().map(|p| p.normalize()).collect();
    let eye = camera(Vec3::new(0.0, 0.0, 9.0), Vec3::ZERO, 40.0);
    let ball = Mesh { normals, ..ball };
    let scene = scene(vec![ball], vec![glass(water.clone())], vec![], eye);
    let accel = accel(&scene);
    // Primary and secondary bow, from the point opposite to the sun: red and violet.
    let expected = [[42.4, 40.6], [50.4, 53.6]];
    for (k, degrees) in (1..).zip(expected) {
        for (nanometers, about) in [656.0, 404.0].into_iter().zip(degrees) {
            let near = |w: &Wavelength| (w.nanometers() - nanometers).abs() as u64;
            let wavelength = Wavelength::all().min_by_key(near).unwrap();
            let mut bow: f64 = if k == 1 { 0.0 } else { 180.0 };
            let mut theory = bow;
            let n = water.at(wavelength.nanometers());
            let mut reflected = vec![true; k as usize + 2];
            (reflected[0], reflected[k as usize + 1]) = (false, false);
            for step in 0..4000 {
                let b = 0.7 + 0.299 * f64::from(step) / 4000.0;
                let ray = Ray::new(Vec3::new(b as f32, 1e-3, 5.0), -Vec3::Z);
                let Some(out) = follow(&scene, &*accel, ray, wavelength, &reflected) else {
                    continue;
                };
                // The sun shines along -z: its light comes back along +z.
                let angle = out.dot(DVec3::Z).acos().to_degrees();
                let exact = (PI - deviation(b, n, k)).abs().to_degrees();
                if k == 1 {
                    (bow, theory) = (bow.max(angle), theory.max(exact));
                } else {
                    (bow, theory) = (bow.min(angle), theory.min(exact));
                }
            }
            // The mesh is a polyhedron: rays meet it a little too deep.
            assert!((bow - theory).abs() < 0.1, "{k} {nanometers}: {bow} {theory}");
            assert!((bow - about).abs() < 0.25, "{k} {nanometers}: {bow} {about}");
        }
    }
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

fn rendered(scene: &Arc<Scene>, settings: Settings, iterations: usize) -> Vec<Vec<f64>> {
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
fn assert_equal(what: &str, own: &[Vec<f64>], other: &[Vec<f64>], resolution: f64) {
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
fn ball_under_a_panel(ball_material: Material) -> Arc<Scene> {
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

fn base_settings() -> Settings {
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

#[test]
fn all_strategies_and_the_path_tracer_have_one_mean_of_each_channel() {
    let scene = ball_under_a_panel(glass(RefractiveIndex::Abbe { index: 1.5, abbe: 5.0 }));
    let accel = accel(&scene);
    let mut tracer = PathTracer::new(&scene, &*accel, &settings(SIDE, SIDE));
    let reference = samples(250, || {
        tracer.iterate(256);
        tracer.film().sums.map_rows(|sums| sums.radiance)
    });
    for direct in [Direct::Connect, Direct::PhotonMap] {
        let settings = Settings { direct, ..base_settings() };
        let single = rendered(&scene, settings.clone(), 250);
        assert_equal(&format!("single, {direct:?}"), &single, &reference, 0.02);
        for weighting in WEIGHTINGS {
            let own = rendered(&scene, weighted(&settings, weighting), 250);
            assert_equal(&format!("{weighting:?}, {direct:?}"), &own, &reference, 0.02);
        }
    }
}

#[test]
fn glass_whose_dispersion_vanishes_is_as_bright_as_without_wavelengths() {
    let nearly = RefractiveIndex::Table(vec![[380.0, 1.5], [780.0, 1.5 + 1e-9]]);
    let material = glass(nearly);
    assert!(material.dispersion.is_some());
    let plain = Material { dispersion: None, ..material.clone() };
    let [spectral, rgb] = [material, plain]
        .map(|material| rendered(&ball_under_a_panel(material), base_settings(), 200));
    assert_equal("no dispersion", &spectral, &rgb, 0.02);
}

#[test]
fn dispersive_bodies_in_a_furnace_are_invisible() {
    let smooth = glass(medium("SF11"));
    let rough = Material {
        bsdf: Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.05)),
        ..glass(RefractiveIndex::Abbe { index: 1.5, abbe: 10.0 })
    };
    let mut meshes = vec![sphere(Vec3::ZERO, 2.0, 4, true, 0)];
    for (x, material) in [(-0.7, 1), (0.7, 2)] {
        meshes.push(sphere(Vec3::new(x, 0.0, 0.0), 0.5, 4, false, material));
    }
    let eye = camera(Vec3::new(0.0, -1.6, 0.3), Vec3::ZERO, 62.0);
    let scene = scene(meshes, vec![gray(0.4, 3.0), smooth, rough], vec![], eye);
    let settings = Settings { radius: 0.2, caustic_radius: 0.2, ..base_settings() };
    for weighting in [None].into_iter().chain(WEIGHTINGS.map(Some)) {
        let settings = match weighting {
            None => settings.clone(),
            Some(weighting) => weighted(&settings, weighting),
        };
        for samples in rendered(&scene, settings, 60).chunks_exact(3) {
            for samples in samples {
                let estimate = Estimate::from_samples(samples);
                // Facets lose half a percent.
                let off = (estimate.mean / 5.0 - 1.0).abs();
                assert!(off < 4.5 * estimate.error / 5.0 + 6e-3, "{weighting:?}: {estimate:?}");
            }
        }
    }
}
