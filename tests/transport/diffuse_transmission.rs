//! Sheets that reflect and transmit diffusely: closed-form radiance on both sides, furnaces, and
//! all strategies against each other and the path tracer.

use crate::common::several_ways::{WAYS, WEIGHTINGS, assert_white_sheets, diffuse_sheet as sheet};
use crate::common::*;
use bdpm::Settings;
use bdpm::scene::bsdf::{Bsdf, DiffuseTransmission};
use bdpm::scene::{Directional, Emitter, Material, Medium, MediumBoundary, Mesh, Scene, Texture};
use bdpm::settings::{Direct, Kernel, Strategy};
use bdpm::transport::reference::PathTracer;
use glam::{Vec2, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

/// Direct light, the merge vertex, and the kernel: everything by which photons may merge.
pub(super) const STRATEGIES: [(Direct, u32, Kernel); 7] = [
    (Direct::Connect, 1, Kernel::Disc),
    (Direct::Connect, MIS, Kernel::Area),
    (Direct::PhotonMap, 1, Kernel::Disc),
    (Direct::PhotonMap, 1, Kernel::Area),
    (Direct::PhotonMap, 2, Kernel::Area),
    (Direct::PhotonMap, MIS, Kernel::Disc),
    (Direct::PhotonMap, MIS, Kernel::Area),
];

fn material(bsdf: Bsdf) -> Material {
    Material::new("sheet", bsdf)
}

/// Shading normal of the sheet where it has one.
const TILTED: Vec3 = Vec3::new(0.36, 0.48, 0.8);

/// A sheet `z = 0` of reflectance 0.3 and transmittance 0.6, seen from above, and its radiance. The
/// sun shines on it from above (1) or below (-1): even irradiance leaves no bias of merging.
fn lit_sheet(side: f32, is_tilted: bool) -> (Arc<Scene>, f64) {
    let normals = if is_tilted { vec![TILTED; 4] } else { vec![] };
    let plane = Mesh { normals, ..square(Vec3::ZERO, Vec3::Z, 1.0, 0) };
    let to_sun = Vec3::new(-0.3, 0.1, side).normalize();
    let sun = Emitter::Directional(Directional::new(-to_sun, Vec3::splat(10.0)));
    let camera = camera(Vec3::new(2.3, 0.3, 1.5), Vec3::new(0.1, 0.1, 0.0), 2.0);
    let scene = scene(vec![plane], vec![material(sheet(0.3, 0.6))], vec![sun], camera);
    let normal = if is_tilted { TILTED } else { Vec3::Z };
    let irradiance = 10.0 * f64::from(normal.dot(to_sun).abs());
    // theory.md (27a)
    (scene, irradiance * if side > 0.0 { 0.3 } else { 0.6 } / PI)
}

/// Irradiance `E` on one side of a sheet gives the radiance `r E / pi` there and `t E / pi` on the
/// other side, whatever finds the light.
#[test]
fn sheets_have_closed_form_radiance_on_both_sides() {
    for (side, is_tilted) in [(-1.0, false), (1.0, false), (-1.0, true), (1.0, true)] {
        let (scene, expected) = lit_sheet(side, is_tilted);
        for (direct, merge_vertex, kernel) in STRATEGIES {
            let settings = by_way(Settings {
                direct,
                merge_vertex,
                kernel,
                light_paths: 20_000,
                ..settings(4, 4)
            });
            let mean = mean_luminance(&scene, &accel(&scene), settings, 60);
            println!("{side} {is_tilted} {direct:?} {merge_vertex} {kernel:?}: {mean:?}");
            mean.assert_is(expected, 3e-3);
        }
    }
}

/// Textures of both shares, and the factor of colors at vertices, which belongs to the reflectance.
#[test]
fn textures_and_vertex_colors_change_the_share_that_they_belong_to() {
    for (side, factor) in [(-1.0, 0.5), (1.0, 0.25 * 0.8)] {
        let (scene, expected) = lit_sheet(side, false);
        let gray = |share: f32| {
            let code = (255.0 * encoded(share)).round() as u8;
            Some(Arc::new(Texture::new(1, 1, vec![[code, code, code, 255]])))
        };
        let mesh = Mesh {
            uvs: vec![Vec2::ZERO; 4],
            colors: vec![Vec3::splat(0.8); 4],
            ..square(Vec3::ZERO, Vec3::Z, 1.0, 0)
        };
        let own = Material {
            albedo_texture: gray(0.25),
            transmittance_texture: gray(0.5),
            ..material(sheet(0.3, 0.6))
        };
        let lights = scene.lights().emitters().to_vec();
        let scene = crate::common::scene(vec![mesh], vec![own], lights, scene.camera);
        for direct in [Direct::Connect, Direct::PhotonMap] {
            let settings = Settings { direct, light_paths: 20_000, ..settings(4, 4) };
            let mean = mean_luminance(&scene, &accel(&scene), settings, 60);
            // Codes of 8 bits
            mean.assert_is(factor * expected, 8e-3);
        }
    }
}

/// The sRGB value of a linear share.
fn encoded(share: f32) -> f32 {
    1.055 * share.powf(1.0 / 2.4) - 0.055
}

#[test]
fn white_sheets_in_a_furnace_have_its_radiance() {
    assert_white_sheets(false, &WAYS[1..], &WEIGHTINGS[..2]);
    assert_white_sheets(true, &WAYS[..1], &WEIGHTINGS[4..]);
}

/// A closed box of two rooms that a curtain divides. The lamp is in the room behind, in a shade
/// that is a smooth ball.
pub(super) fn curtain([curtain, shade]: [Bsdf; 2]) -> Arc<Scene> {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
    }
    meshes.push(square(0.1 * Vec3::Y, -Vec3::Y, 1.0, 1));
    let center = Vec3::new(0.1, 0.55, 0.1);
    let ball = sphere(center, 0.3, 3, false, 2);
    let normals = ball.positions.iter().map(|p| (*p - center).normalize()).collect();
    meshes.push(Mesh { normals, ..ball });
    meshes.push(square(center, Vec3::new(0.3, -0.4, 1.0), 0.08, 3));
    let materials = vec![gray(0.6, 0.0), material(curtain), material(shade), gray(0.0, 60.0)];
    let lights = vec![point_light(Vec3::new(-0.6, 0.6, -0.5), 0.3)];
    let camera = camera(Vec3::new(-0.7, -0.85, 0.3), Vec3::new(0.3, 0.5, -0.2), 75.0);
    scene(meshes, materials, lights, camera)
}

/// Mean luminance of the image, with its standard error, by path tracing alone.
fn path_traced(scene: &Arc<Scene>, settings: &Settings, iterations: u32) -> Estimate {
    let accel = accel(scene);
    let mut tracer = PathTracer::new(scene, &*accel, settings);
    let (mut before, mut samples) = (0.0, Vec::new());
    for i in 1..=iterations {
        tracer.iterate(64);
        let sum = tracer.film().mean_luminance() * f64::from(i);
        samples.push(sum - before);
        before = sum;
    }
    Estimate::from_samples(&samples)
}

/// Light through a shade and a curtain, seen on the curtain and in the room before it: every
/// strategy has the mean of the path tracer, which shares only the scene.
#[test]
fn light_behind_a_curtain_is_that_of_the_path_tracer() {
    let colored = |reflectance, transmittance| {
        Bsdf::DiffuseTransmission(DiffuseTransmission::new(reflectance, transmittance))
    };
    let scene = curtain([
        colored(Vec3::new(0.3, 0.5, 0.2), Vec3::new(0.6, 0.3, 0.4)),
        colored(Vec3::splat(0.2), Vec3::new(0.7, 0.6, 0.4)),
    ]);
    assert_is_path_traced(
        &scene,
        &[&STRATEGIES[..], &[(Direct::Connect, 2, Kernel::Area)]].concat(),
    );
}

/// Asserts that photons by these strategies and camera paths have the mean of the path tracer.
pub(super) fn assert_is_path_traced(scene: &Arc<Scene>, strategies: &[(Direct, u32, Kernel)]) {
    let accel = accel(scene);
    let base = Settings {
        light_paths: 40_000,
        camera_paths: 16,
        radius: 0.05,
        caustic_radius: 0.05,
        seed: 3,
        ..settings(12, 12)
    };
    let reference = path_traced(scene, &base, 160);
    println!("path tracer: {reference:?}");
    assert!(reference.error < 6e-3 * reference.mean, "{reference:?} says little");
    let path = Settings { strategy: Strategy::Path, merge_vertex: 2, ..base.clone() };
    let by_photons = strategies.iter().map(|&(direct, merge_vertex, kernel)| {
        by_way(Settings { direct, merge_vertex, kernel, ..base.clone() })
    });
    for settings in by_photons.chain([path]) {
        let what = format!("{:?} {:?} {:?}", settings.strategy, settings.direct, settings.kernel);
        // Discs lose the light of photons that edges cut off.
        let bias = if settings.kernel == Kernel::Disc { 3e-2 } else { 6e-3 };
        let found = mean_luminance(scene, &accel, settings, 40);
        let error = found.error.hypot(reference.error);
        let off = found.mean / reference.mean - 1.0;
        println!("{what}: off by {off:+.4} +- {:.4}", error / reference.mean);
        assert!(error < 0.01 * reference.mean, "{what}: {found:?} says little");
        assert!(off.abs() < 4.0 * error / reference.mean + bias, "{what}: {found:?} {reference:?}");
    }
}

/// A sheet bounds media: ink on the side of the light and nothing on the other, where transmitted
/// light goes on.
#[test]
fn light_goes_on_in_the_medium_behind_a_sheet() {
    let (from, to) = (Vec3::new(3.0, 0.5, 1.5), Vec3::new(0.7, 0.2, 0.0));
    // The back is below, where the light is: it absorbs.
    let position = Vec3::new(0.4, 0.3, -2.0);
    let ink = Arc::new(Medium::absorbing("ink", Vec3::splat(0.5), 1.0));
    let boundary = Some(MediumBoundary { interior: Some(ink), exterior: None });
    let mut meshes = vec![square(Vec3::ZERO, Vec3::Z, 4.0, 0)];
    // Closed below by black walls, so that the point light is inside.
    meshes.push(square(Vec3::new(0.0, 0.0, -8.0), -Vec3::Z, 4.0, 0));
    for side in [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y] {
        meshes.push(square(4.0 * side - 4.0 * Vec3::Z, side, 4.0, 0));
    }
    for mesh in &mut meshes[1..] {
        mesh.material = 1;
    }
    let own = Material { boundary: boundary.clone(), ..material(sheet(0.3, 0.6)) };
    let black = Material { boundary, ..material(sheet(0.0, 0.0)) };
    let lights = vec![point_light(position, 10.0)];
    let scene = scene(meshes, vec![own, black], lights, camera(from, to, 2.0));
    let to_light = position - to;
    let distance = f64::from(to_light.length());
    let cos = f64::from(to_light.z.abs()) / distance;
    let expected = 10.0 * cos / distance.powi(2) * 0.5_f64.powf(distance) * 0.6 / PI;
    for direct in [Direct::Connect, Direct::PhotonMap] {
        let settings = Settings {
            direct,
            light_paths: 20_000,
            radius: 0.04,
            caustic_radius: 0.04,
            ..settings(4, 4)
        };
        let iterations = if direct == Direct::Connect { 50 } else { 800 };
        mean_luminance(&scene, &accel(&scene), settings, iterations).assert_is(expected, 3e-3);
    }
}
