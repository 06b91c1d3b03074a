//! Lights that emit by a picture: light paths, connections and sight carry the same light, and as
//! much as the picture holds.

use crate::common::*;
use bdpm::base::math::{Rgb, luminance};
use bdpm::base::rng::{Stream, StreamKey};
use bdpm::noise::Measure;
use bdpm::scene::{
    Camera, Emitter, FieldOfView, Material, Mesh, Receiver, Sampling, Scene, Texture,
};
use bdpm::settings::Direct;
use bdpm::{Renderer, Settings};
use glam::{DVec3, Vec2, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

/// Texels across and down.
const SIDE: usize = 4;
const FACTOR: f32 = 3.0;

/// A panel of corners `(-1, -1)` to `(1, 1)` at height 1 that looks down, `u` along x, `v` along y.
fn panel() -> Mesh {
    let mesh = square(Vec3::Z, -Vec3::Z, 1.0, 1);
    let uvs = mesh.positions.iter().map(|p| 0.5 * (p.truncate() + Vec2::ONE)).collect();
    Mesh { uvs, ..mesh }
}

/// Codes of its texels, rows from the top (+y); a part is black.
fn texels() -> Vec<[u8; 4]> {
    let code = |i: usize| if i.is_multiple_of(3) { 0 } else { (i * 37 % 256) as u8 };
    (0..SIDE * SIDE).map(|i| [code(i), code(i + 1), code(i / 2), 255]).collect()
}

/// Radiance of the texel in this column and row.
fn radiance(column: usize, row: usize) -> Rgb {
    let linear = |code: u8| {
        let x = f32::from(code) / 255.0;
        if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    };
    let [r, g, b, _] = texels()[row * SIDE + column];
    FACTOR * Vec3::new(linear(r), linear(g), linear(b))
}

fn lamp() -> Material {
    let sampling = Sampling { nearest: true, ..Sampling::default() };
    let texture = Texture::new(SIDE as u32, SIDE as u32, texels()).sampled(sampling);
    Material { emission_texture: Some(Arc::new(texture)), ..gray(0.0, FACTOR) }
}

/// The panel above a floor of albedo 0.5, both seen from below the panel.
fn panel_scene() -> Arc<Scene> {
    let floor = square(Vec3::ZERO, Vec3::Z, 3.0, 0);
    let camera = camera(Vec3::new(0.0, 0.0, 0.95), Vec3::new(0.3, 0.2, 0.0), 50.0);
    scene(vec![floor, panel()], vec![gray(0.5, 0.0), lamp()], vec![], camera)
}

/// Irradiance of the floor at a point: midpoints of `n` times `n` parts of each texel, and the
/// formula of form factors between parallel planes.
fn irradiance(x: f64, y: f64) -> f64 {
    let n = 40;
    let parts = SIDE * n;
    let mut sum = DVec3::ZERO;
    for i in 0..parts {
        for j in 0..parts {
            let place = |k: usize| 2.0 * (k as f64 + 0.5) / parts as f64 - 1.0;
            let distance2 = (place(i) - x).powi(2) + (place(j) - y).powi(2) + 1.0;
            let area = (2.0 / parts as f64).powi(2);
            let row = SIDE - 1 - j / n;
            sum += radiance(i / n, row).as_dvec3() * (area / (distance2 * distance2));
        }
    }
    f64::from(luminance(sum.as_vec3()))
}

#[test]
fn light_paths_start_where_and_as_the_picture_is_bright() {
    let scene = panel_scene();
    assert!(scene.lights().emitters().iter().all(|e| matches!(e, Emitter::Textured(_))));
    let texel_power = |i: usize| (radiance(i % SIDE, i / SIDE) * (0.25 * PI as f32)).as_dvec3();
    let power: DVec3 = (0..SIDE * SIDE).map(texel_power).sum();
    let off = scene.lights().power().as_dvec3() / power - 1.0;
    assert!(off.abs().max_element() < 0.02, "the power it is chosen by: {off}");

    let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
    let n = 400_000;
    let mut sums = [(DVec3::ZERO, DVec3::ZERO); SIDE * SIDE];
    for _ in 0..n {
        let start = scene.lights().emit(&mut rng);
        assert!(start.direction.z < 0.0 && (start.origin.z - 1.0).abs() < 1e-4);
        let index = |x: f32| ((0.5 * (x + 1.0) * SIDE as f32) as usize).min(SIDE - 1);
        let texel = (SIDE - 1 - index(start.origin.y)) * SIDE + index(start.origin.x);
        let flux = start.flux.as_dvec3();
        sums[texel].0 += flux / f64::from(n);
        sums[texel].1 += flux * flux / f64::from(n);
    }
    for (texel, (mean, square)) in sums.into_iter().enumerate() {
        let error = ((square - mean * mean) / f64::from(n)).map(f64::sqrt);
        let off = (mean - texel_power(texel)).abs();
        assert!(off.cmple(4.5 * error + 1e-5).all(), "{texel}: {mean} {}", texel_power(texel));
    }
}

#[test]
fn connections_give_the_irradiance_of_the_picture() {
    let scene = panel_scene();
    let mut rng = StreamKey::new(2, Stream::Test, 0).rng(0);
    for (x, y) in [(0.0, 0.0), (0.7, -0.4), (-2.0, 1.0)] {
        let samples: Vec<f64> = (0..200_000)
            .map(|_| {
                let from = Vec3::new(x as f32, y as f32, 0.0);
                let at = Receiver { position: from, normal: Some(Vec3::Z) };
                let light = scene.lights().connect(at, &mut rng);
                light.map_or(0.0, |light| f64::from(luminance(light.irradiance) * light.wi.z))
            })
            .collect();
        Estimate::from_samples(&samples).assert_is(irradiance(x, y), 1e-3);
    }
}

#[test]
fn photons_and_connections_light_the_floor_alike() {
    // A small part of the floor, seen through a long lens.
    let (x, y) = (0.4, -0.3);
    let mut scene = panel_scene();
    Arc::make_mut(&mut scene).camera = camera(Vec3::new(2.0, -0.3, 0.9), Vec3::new(x, y, 0.0), 1.5);
    let expected = 0.5 / PI * irradiance(f64::from(x), f64::from(y));
    for direct in [Direct::Connect, Direct::PhotonMap] {
        let settings = Settings {
            direct,
            light_paths: 40_000,
            radius: 0.05,
            caustic_radius: 0.05,
            ..settings(4, 4)
        };
        mean_luminance(&scene, &accel(&scene), settings, 200).assert_is(expected, 6e-3);
    }
}

#[test]
fn camera_sees_the_picture() {
    let mut scene = panel_scene();
    // From straight below, +y at the top and +x on the left.
    let fov = FieldOfView::X(2.0 * 0.1_f32.atan().to_degrees());
    let from = Vec3::new(0.0, 0.0, -9.0);
    Arc::make_mut(&mut scene).camera = Camera::look(from, Vec3::Z, Vec3::Y, fov).unwrap();
    let scene =
        crate::common::scene(vec![panel()], scene.materials().to_vec(), vec![], scene.camera);
    let accel = accel(&scene);
    let mut renderer = Renderer::new(&scene, &accel, settings(4, 4)).unwrap();
    renderer.iterate(Measure::Off);
    for (pixel, value) in renderer.film().mean().into_iter().enumerate() {
        let expected = radiance(SIDE - 1 - pixel % SIDE, pixel / SIDE);
        assert!((value - expected).length() < 1e-4, "{pixel}: {value} {expected}");
    }
}
