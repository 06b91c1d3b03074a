//! Where everything emits 1 and reflects half, radiance is 2 everywhere, and merging has no excuse:
//! the kernel by true area is exact at edges, steps, gaps and thin walls, on floors under blocks
//! and on doubled faces, at every radius; the disc is not.

use crate::common::*;
use bdpm::noise::Measure;
use bdpm::scene::bsdf::Bsdf;
use bdpm::scene::{Emitter, Material, Mesh, Scene};
use bdpm::settings::{Direct, Kernel};
use bdpm::{Renderer, Settings};
use glam::{Quat, Vec3};
use std::sync::Arc;

const RADIANCE: f64 = 2.0;

/// Independent images per answer.
const IMAGES: usize = 8;

/// Pixels across and down, and of a tile.
const SIDE: u32 = 32;
const TILE: u32 = 4;

/// Largest standardized deviation of 64 tiles from 8 images (Student's t of 7 degrees of freedom):
/// one in some hundred sets of seeds exceeds it.
const MOST: f64 = 9.0;

/// Everything emits 1 from its front and reflects half, on the back as well or not at all.
fn glowing(two_sided: bool) -> Material {
    let bsdf = Bsdf::Lambertian { albedo: Vec3::splat(0.5), two_sided };
    Material { emission: Vec3::ONE, ..Material::new("glowing", bsdf) }
}

/// An axis-aligned box, its fronts outside or inside; faces of `cuts` by `cuts` squares.
fn cuboid(min: Vec3, max: Vec3, inward: bool, cuts: u32) -> Mesh {
    let mut mesh = Mesh { name: "box".into(), ..Mesh::default() };
    for axis in 0..3 {
        for high in [false, true] {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let first = mesh.positions.len() as u32;
            for (i, j) in (0..=cuts).flat_map(|i| (0..=cuts).map(move |j| (i, j))) {
                let mut corner = if high { max } else { min };
                let at = |axis: usize, i: u32| {
                    min[axis] + (max[axis] - min[axis]) * (i as f32 / cuts as f32)
                };
                (corner[u], corner[v]) = (at(u, i), at(v, j));
                mesh.positions.push(corner);
            }
            for (i, j) in (0..cuts).flat_map(|i| (0..cuts).map(move |j| (i, j))) {
                let a = first + i * (cuts + 1) + j;
                let [a, b, c, d] = [a, a + cuts + 1, a + cuts + 2, a + 1];
                let quad = if high == inward { [a, d, c, b] } else { [a, b, c, d] };
                mesh.triangles.extend([[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]);
            }
        }
    }
    mesh
}

/// A material that emits nothing and whose front reflects all, which is as bright as [`glowing`]:
/// two such surfaces in one place emit no more than one. The back is black: light inside a white
/// block on the floor would be brighter than outside, because the processor decides which of two
/// coincident faces a ray hits.
fn reflecting() -> Material {
    Material::new("reflecting", Bsdf::Lambertian { albedo: Vec3::ONE, two_sided: false })
}

fn white(mesh: Mesh) -> Mesh {
    Mesh { material: 1, ..mesh }
}

fn solid(min: [f32; 3], max: [f32; 3]) -> Mesh {
    cuboid(min.into(), max.into(), false, 1)
}

/// In a room two units wide, seen from a corner.
fn furnace(things: Vec<Mesh>, two_sided: bool, cuts: u32) -> Arc<Scene> {
    furnace_with(vec![], things, two_sided, cuts)
}

/// [`furnace`] with further lights.
fn furnace_with(lights: Vec<Emitter>, things: Vec<Mesh>, two_sided: bool, cuts: u32) -> Arc<Scene> {
    let mut meshes = vec![cuboid(Vec3::NEG_ONE, Vec3::ONE, true, cuts)];
    meshes.extend(things);
    let camera = camera(Vec3::new(-0.9, -0.95, 0.75), Vec3::new(0.2, 0.1, -0.6), 75.0);
    scene(meshes, vec![glowing(two_sided), reflecting()], lights, camera)
}

/// Largest deviation of a tile from the answer in standard errors, and the image's mean with its
/// own.
fn deviation(scene: &Arc<Scene>, kernel: Kernel, radius: f32) -> (f64, [f64; 2]) {
    let accel = accel(scene);
    let render = |seed: usize| {
        let settings = Settings {
            kernel,
            radius,
            // Photons of both classes meet at the same edges.
            caustic_radius: 0.5 * radius,
            direct: Direct::PhotonMap,
            light_paths: 30_000,
            seed: seed as u64,
            ..settings(SIDE, SIDE)
        };
        let mut renderer = Renderer::new(scene, &accel, settings).unwrap();
        (0..3).for_each(|_| drop(renderer.iterate(Measure::Off)));
        let tiles = (SIDE / TILE) as usize;
        let mut means = vec![0.0; tiles * tiles];
        for (pixel, value) in renderer.film().mean().into_iter().enumerate() {
            let (x, y) = (pixel as u32 % SIDE / TILE, pixel as u32 / SIDE / TILE);
            means[y as usize * tiles + x as usize] += f64::from(value.x) / f64::from(TILE * TILE);
        }
        means
    };
    let images: Vec<Vec<f64>> = (0..IMAGES).map(render).collect();
    let statistic = |values: Vec<f64>| {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let scatter = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
        [mean, (scatter / n).sqrt()]
    };
    let worst = (0..images[0].len()).map(|tile| {
        let [mean, error] = statistic(images.iter().map(|image| image[tile]).collect());
        (mean - RADIANCE).abs() / error
    });
    let whole = |image: &Vec<f64>| image.iter().sum::<f64>() / image.len() as f64;
    (worst.fold(0.0, f64::max), statistic(images.iter().map(whole).collect()))
}

fn assert_exact(name: &str, scene: &Arc<Scene>, radii: &[f32]) {
    for &radius in radii {
        let (worst, [mean, error]) = deviation(scene, Kernel::Area, radius);
        println!("{name}, radius {radius}: {worst:.1}, {mean:.4} +- {error:.4}");
        assert!(worst < MOST, "{name}, radius {radius}: {worst}");
        assert!((mean - RADIANCE).abs() < 5.0 * error, "{name}, {radius}: {mean} +- {error}");
        assert!(error < 2e-3 * RADIANCE, "{name}, {radius}: {error}");
    }
    let (worst, [mean, error]) = deviation(scene, Kernel::Disc, radii[radii.len() - 1]);
    assert!(worst > 2.0 * MOST, "{name}: the disc is as good, {worst}, {mean} +- {error}");
}

#[test]
fn light_inside_of_a_thin_block_stays_there() {
    // The insides of its faces are nearer than a quarter of the radius and have the normals of the
    // outsides.
    let block = solid([-0.6, -0.4, -0.6], [0.6, -0.396, 0.6]);
    let lamp = point_light(Vec3::new(0.1, -0.398, 0.1), 1.0);
    let scene = furnace_with(vec![lamp], vec![block], true, 1);
    assert_exact("lamp in a thin block", &scene, &[0.05, 0.2]);
}

#[test]
fn edges_and_corners_of_rooms() {
    for cuts in [1, 7] {
        assert_exact("a room", &furnace(vec![], true, cuts), &[0.05, 0.3]);
    }
}

#[test]
fn thin_walls_steps_and_gaps_smaller_than_the_radius() {
    let things = vec![
        solid([-0.3, -0.2, -0.6], [0.3, -0.18, 0.1]),
        solid([-0.3, 0.2, -0.8], [0.2, 0.5, -0.7]),
        solid([-0.3, 0.2, -0.65], [0.2, 0.5, -0.5]),
    ];
    for two_sided in [true, false] {
        assert_exact("in the air", &furnace(things.clone(), two_sided, 1), &[0.1, 0.25]);
    }
}

/// Turned about an axis that no coordinate has.
fn tilted(point: Vec3) -> Vec3 {
    let turn = Quat::from_axis_angle(Vec3::new(1.0, 2.0, 0.7).normalize(), 0.4);
    turn * point + Vec3::new(0.0, 0.1, -0.4)
}

#[test]
fn layers_just_near_enough_and_just_too_far() {
    // Steps of 1/16, between which a quarter of the radii lies. Numbers without rounding: faces of
    // a solid meet.
    let steps = (0..4).map(|i| {
        let (left, height) = (0.125 * i as f32 - 0.3125, 0.0625 * i as f32 - 0.125);
        let mut step = solid([left, -0.25, -0.5], [left + 0.109_375, 0.25, height]);
        step.positions.iter_mut().for_each(|position| *position = tilted(*position));
        step
    });
    let mut scene = furnace(steps.collect(), true, 1);
    let [from, to] = [Vec3::new(-0.1, 0.0, 0.8), Vec3::new(-0.05, 0.05, 0.0)].map(tilted);
    Arc::make_mut(&mut scene).camera = camera(from, to, 80.0);
    assert_exact("layers", &scene, &[0.24, 0.26]);
}

#[test]
fn light_does_not_leak_from_a_panel_to_the_ceiling_above() {
    // All light is on the panel's underside; the camera between looks up.
    const GAP: f32 = 0.05;
    let meshes = vec![
        square(Vec3::ZERO, Vec3::NEG_Z, 1.0, 0),
        square(Vec3::new(0.0, 0.0, -GAP), Vec3::NEG_Z, 0.5, 0),
    ];
    let at = Vec3::new(0.0, 0.0, -0.5 * GAP);
    let lamps = vec![point_light(Vec3::NEG_Z, 1.0)];
    // Not quite upward: then no direction would be up.
    let camera = camera(at, at + Vec3::new(0.01, 0.0, 1.0), 60.0);
    let scene = scene(meshes, vec![gray(0.5, 0.0)], lamps, camera);
    let accel = accel(&scene);
    let light_above = |kernel, radius| {
        let (direct, light_paths) = (Direct::PhotonMap, 20_000);
        let own = settings(8, 8);
        let own = Settings { kernel, radius, caustic_radius: radius, direct, light_paths, ..own };
        let mut renderer = Renderer::new(&scene, &accel, own).unwrap();
        renderer.iterate(Measure::Off);
        renderer.film().mean().into_iter().map(|value| f64::from(value.x)).sum::<f64>()
    };
    for radius in [3.9 * GAP, 4.1 * GAP] {
        assert_eq!(light_above(Kernel::Area, radius), 0.0);
    }
    assert!(light_above(Kernel::Disc, 1.1 * GAP) > 0.0);
}

#[test]
fn blocks_on_and_in_the_floor_sheets_and_doubled_faces() {
    let things = vec![
        // On the floor, and sunk in it.
        solid([-0.5, -0.3, -1.0], [0.0, 0.1, -0.6]),
        solid([0.3, -0.4, -1.2], [0.7, 0.0, -0.9]),
        // A sheet a ten thousandth of the radius above the floor.
        square(Vec3::new(-0.35, 0.5, -1.0 + 2e-5), Vec3::Z, 0.25, 0),
        // One block twice.
        white(solid([0.2, 0.3, -1.0], [0.6, 0.7, -0.8])),
        white(solid([0.2, 0.3, -1.0], [0.6, 0.7, -0.8])),
    ];
    assert_exact("on the floor", &furnace(things, false, 1), &[0.2]);
}

fn two_balls(levels: [u32; 2]) -> Arc<Scene> {
    let [fine, coarse] = levels;
    let ball = |x: f32, levels| sphere(Vec3::new(x, 0.1, -0.5), 0.3, levels, false, 0);
    furnace(vec![ball(-0.4, fine), ball(0.35, coarse)], true, 1)
}

#[test]
fn balls_of_fine_and_coarse_facets_have_exact_areas() {
    assert_exact("balls", &two_balls([3, 1]), &[0.05, 0.14]);
}

/// Of the 5120 facets of the finer ball, about 570 are within reach: more than the bound on the
/// work of a query allows, so that photons are merged within smaller radii there.
#[test]
fn balls_of_more_facets_than_the_bound_have_exact_areas() {
    assert_exact("balls", &two_balls([4, 1]), &[0.2]);
}

/// All of a small ball is within reach of each of its points: a disc of the radius would be ten
/// times its area.
#[test]
fn balls_of_many_facets_that_are_smaller_than_the_radius_have_exact_areas() {
    let ball = |x: f32, z: f32| sphere(Vec3::new(x, 0.1, z), 0.1, 3, false, 0);
    let balls = vec![ball(-0.4, -0.7), ball(0.0, -0.4), ball(0.35, -0.6)];
    assert_exact("small balls", &furnace(balls, true, 1), &[0.3]);
}
