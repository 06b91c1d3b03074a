//! Lossless things in a closed sphere, in which they are invisible.

use super::several_ways::diffuse_sheet;
use super::{
    Estimate, MIS, accel, by_way, camera, gray, pixel_samples, scene, settings, sphere, square,
};
use bdpm::Settings;
use bdpm::scene::bsdf::Bsdf;
use bdpm::scene::{Material, Mesh, Scene};
use bdpm::settings::{Direct, Kernel};
use glam::Vec3;
use std::sync::Arc;

/// Techniques of direct light and merge vertices. `make test` sees sheets by the first four, and
/// `make check` by the others.
pub const EVERY_WAY: [(Direct, u32); 8] = [
    (Direct::Connect, MIS),
    (Direct::PhotonMap, 2),
    (Direct::Connect, 1),
    (Direct::PhotonMap, MIS),
    (Direct::Connect, 2),
    (Direct::Connect, 3),
    (Direct::PhotonMap, 1),
    (Direct::PhotonMap, 3),
];

const EMISSION: f32 = 3.0;
const ALBEDO: f32 = 0.4;
const EXPECTED: f64 = 5.0;

fn white(bsdf: Bsdf) -> Material {
    Material::new("white", bsdf)
}

pub fn ball(center: Vec3, radius: f32, material: u32) -> Mesh {
    sphere(center, radius, 4, false, material)
}

/// The sphere with `things` of `bsdfs` (materials 1, 2, ...) in it, seen from within.
pub fn furnace(things: Vec<Mesh>, bsdfs: &[Bsdf]) -> Arc<Scene> {
    let mut meshes = vec![sphere(Vec3::ZERO, 2.0, 4, true, 0)];
    meshes.extend(things);
    let mut materials = vec![gray(ALBEDO, EMISSION)];
    materials.extend(bsdfs.iter().map(|bsdf| white(*bsdf)));
    let camera = camera(Vec3::new(0.0, -1.6, 0.3), Vec3::ZERO, 62.0);
    scene(meshes, materials, vec![], camera)
}

/// A row of balls at `x = -0.75, 0, 0.75` and one of three above it.
pub fn place(column: i32, row: i32) -> Vec3 {
    Vec3::new(0.75 * column as f32, 0.0, 0.75 * row as f32)
}

/// Asserts that all pixels see `EXPECTED` less at most `loss` of it, by each of these techniques of
/// direct light and merge vertices.
pub fn assert_invisible_by(
    ways: &[(Direct, u32)],
    kernel: Kernel,
    scene: &Arc<Scene>,
    loss: f64,
    iterations: usize,
) {
    let accel = accel(scene);
    for &(direct, merge_vertex) in ways {
        let settings = by_way(Settings {
            direct,
            merge_vertex,
            light_paths: 5000,
            camera_paths: 12,
            radius: 0.15,
            caustic_radius: 0.15,
            seed: 2,
            kernel,
            ..settings(6, 6)
        });
        let all = pixel_samples(scene, &accel, settings, iterations);
        let mut image = Estimate { mean: 0.0, error: 0.0 };
        for (pixel, samples) in all.iter().enumerate() {
            let Estimate { mean, error } = Estimate::from_samples(samples);
            let (off, error) = (mean / EXPECTED - 1.0, error / EXPECTED);
            assert!(error < 0.03, "{direct:?} {merge_vertex} {pixel}: {error}");
            assert!(
                -loss - 4.5 * error < off && off < 1e-3 + 4.5 * error,
                "{direct:?}, k = {merge_vertex}, pixel {pixel}: off by {off} +- {error}"
            );
            image.mean += off / 36.0;
            image.error = image.error.hypot(error / 36.0);
        }
        // Pixels share light paths: their errors add up in part.
        let Estimate { mean, error } = image;
        assert!(
            -0.5 * loss - 8.0 * error < mean && mean < 8.0 * error,
            "{direct:?}, k = {merge_vertex}: off by {mean} +- {error}"
        );
    }
}

/// Asserts that white sheets are invisible.
pub fn assert_sheets_are_invisible(ways: &[(Direct, u32)]) {
    let sheet = |transmitted: f32| diffuse_sheet(1.0 - transmitted, transmitted);
    let things = vec![
        ball(place(-1, 0), 0.35, 1),
        ball(place(0, 0), 0.35, 2),
        square(place(1, 0), Vec3::new(0.3, 1.0, 0.2), 0.3, 3),
        square(place(0, 1), Vec3::new(-0.4, -1.0, 0.5), 0.3, 1),
    ];
    // Discs have a bias at the edges of sheets.
    let scene = furnace(things, &[sheet(0.4), sheet(1.0), sheet(0.8)]);
    assert_invisible_by(ways, Kernel::Area, &scene, 0.0, 1000);
}
