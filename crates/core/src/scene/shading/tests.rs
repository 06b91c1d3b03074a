//! Energy of diffuse reflection by smooth normals: theory.md (33a).

use super::*;
use crate::accel::{Intersect, Ray};
use crate::base::math::{cosine_hemisphere, uniform_sphere};
use crate::base::rng::{Stream, StreamKey};
use crate::scene::backend::{self, Backend};
use crate::scene::{Camera, FieldOfView, Material, Mesh, Scene};
use std::f32::consts::TAU;
use std::sync::Arc;

const ALBEDO: f32 = 0.99;

fn scene(mesh: Mesh) -> (Scene, Arc<dyn Intersect>) {
    let materials = vec![Material::new("white", Bsdf::diffuse(Vec3::splat(ALBEDO)))];
    let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
    let scene = Scene::new("one".into(), vec![mesh], materials, vec![], camera, vec![]).unwrap();
    let accel = backend::build(Backend::Bvh, &scene).unwrap();
    (scene, accel)
}

/// Mean and its standard error.
fn estimate(samples: impl Iterator<Item = f32>) -> (f64, f64) {
    let (mut count, mut sum, mut square) = (0.0, 0.0, 0.0);
    for sample in samples.map(f64::from) {
        count += 1.0;
        sum += sample;
        square += sample * sample;
    }
    let mean = sum / count;
    (mean, ((square / count - mean * mean) / (count - 1.0)).sqrt())
}

/// Weight of a camera path that continues from a surface; 0 if it is lost.
fn camera_weight(surface: &Surface, rng: &mut Rng) -> Option<(Vec3, f32)> {
    let at = surface.vertex(Transport::Radiance);
    let sample = surface.bsdf.sample(&at, Transport::Radiance, LobeSet::All, rng)?;
    surface.agrees(&at, sample.wi).then_some((sample.wi, sample.weight.x))
}

fn light_weight(surface: &Surface, rng: &mut Rng) -> Option<(Vec3, f32)> {
    surface
        .scatter_flux(&surface.vertex(Transport::Flux), rng)
        .map(|sample| (sample.wi, sample.weight.x))
}

type Continue = fn(&Surface, &mut Rng) -> Option<(Vec3, f32)>;
const KINDS: [Continue; 2] = [camera_weight, light_weight];

#[test]
fn uniform_light_is_reflected_by_the_albedo() {
    for (degrees, kept) in [(0.5f32, true), (6.0, true), (14.9, true), (30.0, false)] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let mesh = Mesh {
            positions: vec![Vec3::new(-1.0, -1.0, 0.0), Vec3::X, Vec3::Y],
            normals: vec![Vec3::new(sin, 0.0, cos); 3],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let (scene, accel) = scene(mesh);
        // Edges of coarse meshes lose the directions between both horizons.
        let share = if kept { 1.0 } else { 0.5 * (1.0 + f64::from(cos)) };
        for (kind, weight) in KINDS.into_iter().enumerate() {
            let mut rng =
                StreamKey::new(5, Stream::Test, kind as u64).rng(degrees.to_bits().into());
            let mut one = || {
                let from = cosine_hemisphere(Vec3::Z, rng.next_2d());
                let ray = Ray::new(from, -from);
                let surface = scene.surface(&ray, &accel.closest_hit(&ray));
                weight(&surface, &mut rng).map_or(0.0, |(_, weight)| weight)
            };
            let (mean, error) = estimate((0..60_000).map(|_| one()));
            let off = mean / (f64::from(ALBEDO) * share) - 1.0;
            assert!(error < 5e-3, "{degrees} {kind}: {error}");
            assert!(off.abs() < 4.0 * error + 1e-6, "{degrees} {kind}: off by {off} +- {error}");
        }
    }
}

/// A sphere of 32 by 16 facets, seen from inside, with the normals of the true sphere.
fn smooth_sphere() -> Mesh {
    let (around, down) = (32u32, 16u32);
    let point = |row: u32, column: u32| {
        let (sin, cos) = (std::f32::consts::PI * row as f32 / down as f32).sin_cos();
        let (y, x) = (TAU * column as f32 / around as f32).sin_cos();
        Vec3::new(sin * x, sin * y, cos)
    };
    let mut positions = vec![Vec3::Z];
    positions.extend((1..down).flat_map(|row| (0..around).map(move |column| point(row, column))));
    positions.push(-Vec3::Z);
    let last = positions.len() as u32 - 1;
    let index = |row: u32, column: u32| match row {
        0 => 0,
        row if row == down => last,
        row => 1 + (row - 1) * around + column % around,
    };
    let mut triangles = Vec::new();
    for (row, column) in (0..down).flat_map(|row| (0..around).map(move |column| (row, column))) {
        let [a, b] = [column, column + 1].map(|column| index(row, column));
        let [c, d] = [column, column + 1].map(|column| index(row + 1, column));
        if a != b {
            triangles.push([a, b, c]);
        }
        if c != d {
            triangles.push([b, d, c]);
        }
    }
    let normals = positions.iter().map(|point| -*point).collect();
    Mesh { positions, normals, triangles, ..Mesh::default() }
}

/// Flat facets would keep the albedo to the power of the number of bounces; without (33a) a smooth
/// sphere loses several percent of it.
#[test]
fn paths_in_a_closed_smooth_sphere_keep_the_energy_of_flat_facets() {
    let (scene, accel) = scene(smooth_sphere());
    // The flux of light paths scatters, so that these are more and shorter.
    for (kind, (bounces, paths)) in [(50, 8000), (20, 40_000)].into_iter().enumerate() {
        let weight = KINDS[kind];
        let mut rng = StreamKey::new(6, Stream::Test, kind as u64).rng(0);
        let mut survivors = 0;
        let mut one = || {
            let mut ray = Ray::new(Vec3::ZERO, uniform_sphere(rng.next_2d()));
            let mut carried = 1.0;
            for _ in 0..bounces {
                let surface = scene.surface(&ray, &accel.closest_hit(&ray));
                let Some((wi, weight)) = weight(&surface, &mut rng) else { return 0.0 };
                carried *= weight;
                ray = Ray::new(surface.start(wi), wi);
            }
            survivors += 1;
            carried
        };
        let (mean, error) = estimate((0..paths).map(|_| one()));
        let expected = f64::from(ALBEDO).powi(bounces);
        let (off, error) = (mean / expected - 1.0, error / expected);
        println!("{kind}: off by {off} +- {error}, {survivors} of {paths} survive");
        assert!(error < 0.006, "{kind}: {error}");
        // Facets of this size leave an error of a tenth of a percent that does not add up.
        assert!(off.abs() < 4.0 * error + 3e-3, "{kind}: off by {off} +- {error}");
        if kind == 0 {
            let survival = f64::from(survivors) / f64::from(paths);
            assert!(survival < 0.96, "{survival}: nothing was lost that needs to be restored");
        }
    }
}
