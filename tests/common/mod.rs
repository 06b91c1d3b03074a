//! Scenes with known answers, and means with standard errors.
#![allow(dead_code)] // each test binary uses its own part

pub mod automatic;
pub mod boxes;
pub mod cached_light;
pub mod caustics;
pub mod committed;
pub mod denoised;
pub mod dispersive_box;
pub mod desk;
pub mod far_counts;
pub mod fog;
pub mod glass_globe;
pub mod gltf;
pub mod html;
pub mod images;
pub mod klems;
pub mod material_noise;
pub mod mutate;
pub mod own_process;
pub mod program_output;
pub mod scene_case;
pub mod several_ways;
pub mod shapes;
pub mod strategies;
pub mod table;
pub mod thread_ranks;
pub mod true_bias;
pub mod white_furnace;

use bdpm::accel::Intersect;
use bdpm::film::radiance::luminance;
use bdpm::noise::Measure;
use bdpm::scene::bsdf::Bsdf;
use bdpm::scene::{Camera, Emitter, FieldOfView, Material, Mesh};
use bdpm::settings::{Bias, Direct, Kernel, MediumQuery, MisScales, Strategy};
use bdpm::{Renderer, Scene, Settings};
use glam::{DVec3, Vec3};
use std::collections::HashMap;
use std::sync::Arc;

/// A Lambertian material that may emit, both gray.
pub fn gray(albedo: f32, emission: f32) -> Material {
    let albedo = Vec3::splat(albedo);
    let bsdf = Bsdf::diffuse(albedo);
    Material { emission: Vec3::splat(emission), ..Material::new("gray", bsdf) }
}

/// A square of side 2 `half` around `center` whose front sees `normal`.
pub fn square(center: Vec3, normal: Vec3, half: f32, material: u32) -> Mesh {
    let (s, t) = normal.normalize().any_orthonormal_pair();
    let corner = |a: f32, b: f32| center + half * (a * s + b * t);
    let positions =
        vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    let triangles = vec![[0, 1, 2], [0, 2, 3]];
    let mesh = Mesh { name: "square".into(), positions, triangles, material, ..Mesh::default() };
    let [a, b, c] = [0, 1, 2].map(|i| mesh.positions[i]);
    assert!((b - a).cross(c - a).dot(normal) > 0.0);
    mesh
}

/// An icosahedron subdivided `levels` times (20 * 4^levels triangles), inscribed in a sphere;
/// fronts outside, or inside if `inward`.
pub fn sphere(center: Vec3, radius: f32, levels: u32, inward: bool, material: u32) -> Mesh {
    let phi = 0.5 * (1.0 + 5.0_f64.sqrt());
    let mut points: Vec<DVec3> = Vec::new();
    for (a, b) in [(1.0, phi), (-1.0, phi), (1.0, -phi), (-1.0, -phi)] {
        points.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
    }
    for point in &mut points {
        *point = point.normalize();
    }
    // Faces of the icosahedron: all triples of mutually nearest vertices.
    let near = |i: usize, j: usize| points[i].dot(points[j]) > 0.4;
    let mut faces = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if near(i, j) && near(j, k) && near(i, k) {
                    let turn = points[i].cross(points[j]).dot(points[k]);
                    faces.push(if turn > 0.0 { [i, j, k] } else { [i, k, j] });
                }
            }
        }
    }
    assert_eq!(faces.len(), 20);
    for _ in 0..levels {
        let mut middles = HashMap::new();
        let mut middle = |i: usize, j: usize| {
            *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                points.push((points[i] + points[j]).normalize());
                points.len() - 1
            })
        };
        faces = faces
            .iter()
            .flat_map(|&[i, j, k]| {
                let (a, b, c) = (middle(i, j), middle(j, k), middle(k, i));
                [[i, a, c], [a, j, b], [c, b, k], [a, b, c]]
            })
            .collect();
    }
    let index = |i: usize| i as u32;
    let triangles = faces
        .iter()
        .map(|&[i, j, k]| if inward { [i, k, j] } else { [i, j, k] }.map(index))
        .collect();
    let positions = points.iter().map(|p| center + radius * p.as_vec3()).collect();
    Mesh { name: "sphere".into(), positions, triangles, material, ..Mesh::default() }
}

/// Total area of a mesh, in f64.
pub fn area(mesh: &Mesh) -> f64 {
    let corner = |i: u32| mesh.positions[i as usize].as_dvec3();
    let double =
        |&[i, j, k]: &[u32; 3]| (corner(j) - corner(i)).cross(corner(k) - corner(i)).length();
    0.5 * mesh.triangles.iter().map(double).sum::<f64>()
}

/// A gray isotropic point light.
pub fn point_light(position: Vec3, intensity: f32) -> Emitter {
    Emitter::Point { position, intensity: Vec3::splat(intensity) }
}

/// A pinhole at `from` looking at `to`.
pub fn camera(from: Vec3, to: Vec3, fov_x_deg: f32) -> Camera {
    let direction = to - from;
    let up = direction.any_orthogonal_vector();
    Camera::look(from, direction, up, FieldOfView::X(fov_x_deg)).unwrap()
}

/// A scene without regions.
pub fn scene(
    meshes: Vec<Mesh>,
    materials: Vec<Material>,
    lights: Vec<Emitter>,
    camera: Camera,
) -> Arc<Scene> {
    Scene::new("test".into(), meshes, materials, lights, camera, Vec::new()).unwrap().into()
}

/// A closed box with a block in it, lit by a point and a small panel.
pub fn furnished_box() -> Arc<Scene> {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
        for side in [axis, -axis] {
            let center = Vec3::new(0.2, -0.1, -0.7);
            meshes.push(square(center + 0.3 * side, side, 0.3, 1));
        }
    }
    meshes.push(square(Vec3::new(0.0, 0.0, 0.95), -Vec3::Z, 0.2, 2));
    let materials = vec![gray(0.5, 0.0), gray(0.7, 0.0), gray(0.0, 4.0)];
    let lights = vec![point_light(Vec3::new(-0.5, 0.4, 0.3), 0.3)];
    let camera = camera(Vec3::new(-0.9, -0.85, 0.2), Vec3::new(0.3, 0.2, -0.5), 80.0);
    scene(meshes, materials, lights, camera)
}

/// Settings to start from.
pub fn settings(width: u32, height: u32) -> Settings {
    Settings {
        width,
        height,
        crop: None,
        light_paths: 1000,
        camera_paths: 4,
        radius: 0.1,
        caustic_radius: 0.1,
        medium_scale: 4.0,
        medium_share: 1.0,
        medium_query: MediumQuery::Points,
        wavelength_width: 0.06,
        bias: Bias::Keep,
        kernel: Kernel::Disc,
        merge_vertex: 1,
        strategy: Strategy::Single,
        direct: Direct::Connect,
        guide: 0,
        sobol_set: 1,
        splitting: 1,
        light_visibility: 0,
        seed: 1,
        mis_scales: None,
    }
}

/// Stands for a merge vertex; paths are sampled by several techniques.
pub const MIS: u32 = 0;

/// Replaces the merge vertex [`MIS`] by multiple importance sampling over all vertices.
pub fn by_way(settings: Settings) -> Settings {
    if settings.merge_vertex != MIS {
        return settings;
    }
    // All tests of a scene have the same weights, whatever their numbers of camera paths.
    let mis_scales = Some(MisScales { light_paths: settings.light_paths, scales: [0.4; 2] });
    Settings { merge_vertex: 2, strategy: Strategy::Mis, mis_scales, ..settings }
}

/// The default backend for a scene.
pub fn accel(scene: &Arc<Scene>) -> Arc<dyn Intersect> {
    bdpm::scene::backend::build(Default::default(), scene).unwrap()
}

/// A mean and its standard error.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    pub mean: f64,
    pub error: f64,
}

impl Estimate {
    /// From independent samples.
    pub fn from_samples(samples: &[f64]) -> Self {
        let n = samples.len() as f64;
        let mean = samples.iter().sum::<f64>() / n;
        let variance = samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
        Self { mean, error: (variance / n).sqrt() }
    }

    /// Asserts that it is `expected` within 4 standard errors, besides a systematic relative error.
    #[track_caller]
    pub fn assert_is(self, expected: f64, systematic: f64) {
        let tolerance = 4.0 * self.error + systematic * expected.abs();
        let Self { mean, error } = self;
        let relative = mean / expected - 1.0;
        assert!(
            (mean - expected).abs() <= tolerance,
            "{mean} +- {error}, expected {expected}: off by {relative:.5} relative"
        );
        // A test that any value passes is none.
        assert!(error < 0.02 * expected.abs(), "{mean} +- {error} says little about {expected}");
    }
}

/// Mean luminance of the image over `iterations`, with its standard error from batches.
pub fn mean_luminance(
    scene: &Arc<Scene>,
    accel: &Arc<dyn Intersect>,
    settings: Settings,
    iterations: usize,
) -> Estimate {
    let mut renderer = Renderer::new(scene, accel, settings).unwrap();
    let mut before = 0.0;
    let mut samples = Vec::new();
    for i in 1..=iterations {
        let report = renderer.iterate(Measure::Off);
        assert!(report.non_finite.is_empty());
        let sum = renderer.film().mean_luminance() * i as f64;
        samples.push(sum - before);
        before = sum;
    }
    Estimate::from_samples(&samples)
}

/// Value of each pixel in each iteration: `samples[pixel][iteration]`, luminance.
pub fn pixel_samples(
    scene: &Arc<Scene>,
    accel: &Arc<dyn Intersect>,
    settings: Settings,
    iterations: usize,
) -> Vec<Vec<f64>> {
    let pixels = settings.pixels();
    let mut renderer = Renderer::new(scene, accel, settings).unwrap();
    let mut before = vec![0.0; pixels];
    let mut samples = vec![Vec::with_capacity(iterations); pixels];
    for _ in 0..iterations {
        renderer.iterate(Measure::Off);
        let sums = renderer.film().sums.map_rows(|sums| luminance(sums.radiance));
        for ((samples, sum), before) in samples.iter_mut().zip(&sums).zip(&before) {
            samples.push(sum - before);
        }
        before = sums;
    }
    samples
}

/// Mean of each pixel, row by row, with the standard error, luminance.
pub fn pixel_means(scene: &Arc<Scene>, settings: Settings, iterations: u64) -> Vec<[f64; 2]> {
    let accel = accel(scene);
    let mut renderer = Renderer::new(scene, &accel, settings).unwrap();
    for _ in 0..iterations {
        renderer.iterate(Measure::Off);
    }
    let variance = renderer.film().variance_of_mean().unwrap();
    let sums = renderer.film().sums.map_rows(|sums| luminance(sums.radiance));
    let mean = |(sum, variance): (f64, &f64)| [sum / iterations as f64, variance.sqrt()];
    sums.into_iter().zip(&variance).map(mean).collect()
}
