//! Dispersion: directions of each wavelength, white that stays white, and one image by all
//! strategies.

use crate::common::dispersive_box::{
    assert_equal, assert_means_of_the_path_tracer, ball_under_a_panel, base_settings, glass,
    rendered,
};
use crate::common::several_ways::{WEIGHTINGS, weighted};
use crate::common::*;
use bdpm::Settings;
use bdpm::accel::{Intersect, Ray};
use bdpm::base::rng::{Rng, Stream, StreamKey};
use bdpm::base::spectrum::Wavelength;
use bdpm::scene::bsdf::{Bsdf, RoughDielectric, Transport};
use bdpm::scene::{Material, Mesh, RefractiveIndex, Scene};
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

fn medium(name: &str) -> RefractiveIndex {
    RefractiveIndex::named(name).unwrap()
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
        let wi = surface.scatter_flux(&surface.vertex(Transport::Flux), rng)?.wi;
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

#[test]
fn all_strategies_and_the_path_tracer_have_one_mean_of_each_channel() {
    assert_means_of_the_path_tracer(true, &WEIGHTINGS[..1]);
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
