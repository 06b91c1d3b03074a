//! The bound on the work of an area query: points with too many triangles in reach have smaller
//! radii.

use crate::common::*;
use bdpm::scene::{Material, Mesh, Scene};
use bdpm::simd::{LANES, Vec3s};
use bdpm::transport::area::disc::half_plane;
use bdpm::transport::area::{Areas, MAX_LEVEL, PointAreas, Query};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_SQRT_2, PI};
use std::sync::Arc;

/// Merge radius of the tests.
const RADIUS: f32 = 0.25;

/// The radii of one query: the merge radius and both nested ones.
const RADII: [f32; 3] = [RADIUS, FRAC_1_SQRT_2 * RADIUS, 0.5 * RADIUS];

/// Squares along each side of the floor, with few and with too many triangles in reach of a point.
const COARSE: u32 = 4;
const FINE: u32 = 192;

/// With too many triangles in reach along the edges, but not at the corners.
const MIXED: u32 = 96;

/// A floor two units wide, of `cuts` by `cuts` squares.
fn floor(cuts: u32, opacity: Option<f32>) -> Arc<Scene> {
    let mut mesh = Mesh { name: "floor".into(), ..Mesh::default() };
    let at = |i: u32| 2.0 * i as f32 / cuts as f32 - 1.0;
    for (i, j) in (0..=cuts).flat_map(|i| (0..=cuts).map(move |j| (i, j))) {
        mesh.positions.push(Vec3::new(at(i), at(j), 0.0));
    }
    for (i, j) in (0..cuts).flat_map(|i| (0..cuts).map(move |j| (i, j))) {
        let a = i * (cuts + 1) + j;
        let [b, c, d] = [a + cuts + 1, a + cuts + 2, a + 1];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    let material = Material { opacity, ..gray(0.5, 0.0) };
    let camera = camera(Vec3::new(0.1, 0.2, 3.0), Vec3::ZERO, 60.0);
    scene(vec![mesh], vec![material], vec![], camera)
}

/// The point in the middle of the second triangle of each square along the edge `x = -1`: areas at
/// [`RADII`] and the level, in the order of the squares.
fn areas_along_edge(scene: &Arc<Scene>, areas: &Areas, order: &[u32]) -> Vec<([f32; 3], u8)> {
    let ask = |&square: &u32| {
        let triangle = 2 * square + 1;
        let mesh = &scene.meshes()[0];
        let corners = mesh.triangles[triangle as usize].map(|i| mesh.positions[i as usize]);
        let mut position = Vec3s::default();
        let middle = corners.into_iter().sum::<Vec3>() / 3.0;
        (0..LANES).for_each(|lane| position.set(lane, middle));
        let facet = [areas.facet(0, triangle, true); LANES];
        let query = Query { position: &position, facet: &facet, wanted: &[true; LANES] };
        let PointAreas { areas, domain } = areas.areas(&query, &RADII);
        (areas.map(|lanes| lanes[3]), domain[3].level())
    };
    order.par_iter().map(ask).collect()
}

/// Areas of a scene before any query.
fn fresh(scene: &Arc<Scene>) -> Areas {
    Areas::of_scene(scene, &*accel(scene), RADIUS)
}

fn assert_close(found: f32, expected: f32) {
    assert!((found - expected).abs() < 1e-4 * expected, "{found}, not {expected}");
}

#[test]
fn points_with_few_triangles_in_reach_take_the_area() {
    let scene = floor(COARSE, None);
    // The middle of the triangle is a third of the square away from the edge.
    let height = 2.0 / COARSE as f32 / 3.0;
    // Corners of the floor are out of reach of the squares in between.
    for (areas, level) in areas_along_edge(&scene, &fresh(&scene), &[1, 2]) {
        assert_eq!(level, 0);
        for (area, radius) in areas.into_iter().zip(RADII) {
            assert_close(area, half_plane(height, radius * radius));
        }
        assert!(areas[0] < 0.95 * PI * RADIUS * RADIUS);
    }
}

#[test]
fn points_with_many_triangles_in_reach_take_the_area_within_a_quarter_of_the_radii() {
    // The middle of the triangle is a third of the square away from the edge.
    let height = 2.0 / FINE as f32 / 3.0;
    for (opacity, share) in [(None, 1.0), (Some(0.5), 0.5)] {
        let scene = floor(FINE, opacity);
        // Corners of the floor are out of reach.
        let squares: Vec<u32> = (32..FINE - 32).collect();
        for (areas, level) in areas_along_edge(&scene, &fresh(&scene), &squares) {
            assert_eq!(level, 2);
            for (area, radius) in areas.into_iter().zip(RADII.map(|radius| 0.25 * radius)) {
                assert_close(area, share * half_plane(height / radius, 1.0) * radius * radius);
            }
        }
    }
}

#[test]
fn points_with_too_many_triangles_within_the_smallest_radius_take_the_disc() {
    let shrink = 0.5f32.powi(MAX_LEVEL.into());
    for (opacity, share) in [(None, 1.0), (Some(0.5), 0.5)] {
        let scene = floor(FINE, opacity);
        // Too many are in reach within `RADIUS`, which is the smallest radius of these areas.
        let areas = Areas::of_scene(&scene, &*accel(&scene), RADIUS / shrink);
        for (areas, level) in areas_along_edge(&scene, &areas, &[1, FINE / 2]) {
            assert_eq!(level, MAX_LEVEL);
            for (area, radius) in areas.into_iter().zip(RADII.map(|radius| shrink * radius)) {
                assert_close(area, share * PI * radius * radius);
            }
        }
    }
}

#[test]
fn areas_do_not_depend_on_earlier_queries_or_threads() {
    let scene = floor(MIXED, None);
    let forward: Vec<u32> = (0..MIXED).collect();
    let backward: Vec<u32> = forward.iter().rev().copied().collect();
    let on = |threads: usize, order: &[u32]| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let areas = fresh(&scene);
            let first = areas_along_edge(&scene, &areas, order);
            assert_eq!(first, areas_along_edge(&scene, &areas, order), "a second query differs");
            first
        })
    };
    let expected = on(1, &forward);
    let smaller = expected.iter().filter(|(_, level)| *level > 0).count();
    assert!(smaller > 0 && smaller < expected.len(), "{smaller} of {}", expected.len());
    assert_eq!(on(4, &forward), expected);
    let mut reversed = on(1, &backward);
    reversed.reverse();
    assert_eq!(reversed, expected);
}
