//! Meshes at several places: Embree's instances against the BVH, which holds a copy at each place.
#![cfg(feature = "embree")]

use crate::common::shapes::{Mesh, Random};
use bdpm::accel::bvh::Bvh;
use bdpm::accel::embree::{CommittedScene, Device, EmbreeError};
use bdpm::accel::{Coherence, Geometry, Hit, Instance, Intersect, MeshError, Ray};
use glam::{DAffine3, DMat3, DVec3, Vec3};

fn device() -> Device {
    Device::new().unwrap()
}

fn turned(axis: DVec3, angle: f64) -> DMat3 {
    DMat3::from_axis_angle(axis.normalize(), angle)
}

/// A closed room with balls and boxes in it: turned, stretched, sheared and mirrored.
fn room() -> (Vec<Mesh>, Vec<Instance>) {
    let meshes = vec![
        Mesh::cuboid(Vec3::ZERO, Vec3::ONE, 0.0),
        Mesh::bumpy_ball(40),
        Mesh::default(),
        Mesh::cuboid(Vec3::new(3.0, -1.0, 2.0), Vec3::new(1.0, 2.0, 3.0), 0.4),
    ];
    let tilt = turned(DVec3::new(1.0, 2.0, -0.5), 1.1);
    let stretch = DMat3::from_diagonal(DVec3::new(0.1, 0.3, 0.2));
    let mirror = DMat3::from_diagonal(DVec3::new(-0.2, 0.2, 0.2));
    let place = |mesh, matrix: DMat3, [x, y, z]: [f64; 3]| Instance {
        mesh,
        to_scene: Some(DAffine3::from_mat3_translation(matrix, DVec3::new(x, y, z))),
    };
    let places = vec![
        place(1, tilt * stretch, [0.5, 0.4, 0.1]),
        Instance { mesh: 0, to_scene: None },
        place(1, mirror * tilt, [-0.5, 0.4, -0.3]),
        place(2, tilt, [0.0; 3]),
        place(3, 0.1 * tilt, [-0.4, -0.5, 0.3]),
        place(1, tilt * stretch * tilt, [0.1, -0.6, -0.5]),
        place(3, stretch * turned(DVec3::Z, 0.7), [0.0, 0.0, 0.0]),
        // One instance of two meshes.
        place(1, 0.3 * mirror, [0.7, -0.8, 0.7]),
        place(3, 0.3 * mirror, [0.7, -0.8, 0.7]),
    ];
    (meshes, places)
}

fn geometry<'a>(meshes: &'a [Mesh], places: &[Instance]) -> Geometry<'a> {
    Geometry { meshes: meshes.iter().map(Mesh::view).collect(), instances: places.to_vec() }
}

/// The point of a hit by its barycentric weights.
fn point(geometry: &Geometry, hit: &Hit) -> Vec3 {
    let place = &geometry.instances[hit.mesh as usize];
    let positions = geometry.positions(place);
    let [a, b, c] = geometry.mesh(place).triangles[hit.triangle as usize];
    let at = |index: u32| positions[index as usize];
    (1.0 - hit.u - hit.v) * at(a) + hit.u * at(b) + hit.v * at(c)
}

#[test]
fn instances_are_hit_where_their_copies_are() {
    const RAYS: usize = 100_000;
    let (meshes, places) = room();
    let geometry = geometry(&meshes, &places);
    let bvh = Bvh::new(&geometry).unwrap();
    for watertight in [false, true] {
        let mut builder = device().scene_builder().unwrap();
        builder.add(&geometry).unwrap();
        builder.set_watertight(watertight).unwrap();
        let embree = builder.commit().unwrap();
        let mut random = Random(7);
        let rays: Vec<Ray> = (0..RAYS).map(|_| random.ray()).collect();
        for coherence in [Coherence::Coherent, Coherence::Incoherent] {
            let mut hits = vec![Hit::MISS; RAYS];
            let mut occluded = vec![false; RAYS];
            embree.closest_hits(&rays, &mut hits, coherence);
            embree.occlusions(&rays, &mut occluded, coherence);
            let (mut differ, mut seen) = (0, vec![0; places.len()]);
            for ((ray, hit), occluded) in rays.iter().zip(&hits).zip(occluded) {
                let expected = bvh.closest_hit(ray);
                // Ends of intervals and silhouettes within rounding.
                let close = (hit.t - expected.t).abs() * ray.direction.length() < 2e-4;
                let same = if hit.is_miss() { expected.is_miss() } else { close };
                differ += usize::from(!same || occluded == hit.is_miss());
                if !hit.is_miss() {
                    seen[hit.mesh as usize] += 1;
                    let along = ray.origin + hit.t * ray.direction;
                    assert!(point(&geometry, hit).distance(along) < 1e-3, "{hit:?} {ray:?}");
                }
            }
            println!("{seen:?}, {differ} differ");
            assert!(differ <= RAYS / 25_000, "{differ}");
            assert!(seen.iter().enumerate().all(|(i, &n)| (n > 30) == (i != 3)), "{seen:?}");
        }
        // One by one as in batches, also after an instance was hit by the same packet's lane.
        let mut hits = vec![Hit::MISS; 1000];
        embree.closest_hits(&rays[..1000], &mut hits, Coherence::Incoherent);
        for (ray, hit) in rays.iter().zip(&hits) {
            let one = embree.closest_hit(ray);
            assert_eq!((one.is_miss(), one.mesh), (hit.is_miss(), hit.mesh), "{ray:?}");
        }
    }
}

#[test]
fn a_shared_mesh_is_held_once() {
    let meshes = [Mesh::bumpy_ball(60)];
    let count = meshes[0].triangles.len();
    let places: Vec<Instance> = (0..100)
        .map(|i| DVec3::new(f64::from(i), 0.0, 0.0))
        .map(|at| Instance { mesh: 0, to_scene: Some(DAffine3::from_translation(at)) })
        .collect();
    let geometry = geometry(&meshes, &places);
    assert_eq!(geometry.instanced_triangles(), 100 * count);
    let many = CommittedScene::new(&device(), &geometry).unwrap().describe();
    let one = CommittedScene::from_meshes(&device(), &geometry.meshes).unwrap().describe();
    assert_eq!((many.triangles, one.triangles), (count, count));
    assert!(many.bytes < 2 * one.bytes, "{many:?} {one:?}");
    assert_eq!(Bvh::new(&geometry).unwrap().describe().triangles, 100 * count);
}

#[test]
fn instances_out_of_the_range_of_f32_are_refused() {
    let meshes = [Mesh::bumpy_ball(9)];
    let refused = |to_scene| {
        let mut builder = device().scene_builder().unwrap();
        builder.add_mesh(meshes[0].view()).unwrap();
        let ball = builder.share(&[meshes[0].view()]).unwrap();
        let error = builder.place(ball, to_scene).unwrap_err();
        // The scene works on.
        let id = builder.place(ball, DAffine3::from_translation(DVec3::X * 10.0)).unwrap();
        let hit = builder.commit().unwrap().closest_hit(&Ray::new(Vec3::X * 5.0, Vec3::X));
        assert_eq!(hit.mesh, id.index());
        let EmbreeError::Mesh { mesh: 1, problem } = error else { panic!("{error}") };
        problem
    };
    for scale in [0.0, 1e-12, 1e12, f64::NAN, f64::INFINITY] {
        assert_eq!(refused(DAffine3::from_scale(DVec3::splat(scale))), MeshError::Transform);
    }
    let flat = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
    assert_eq!(refused(flat), MeshError::Transform);
    let large = DMat3::from_diagonal(DVec3::splat(1e8));
    let far = DAffine3::from_mat3_translation(large, DVec3::X * 0.99995e12);
    assert!(matches!(refused(far), MeshError::TooFar { .. }));
    let bad = Mesh { positions: vec![Vec3::NAN], triangles: vec![] };
    let error = device().scene_builder().unwrap().share(&[bad.view()]).unwrap_err();
    assert!(matches!(error, EmbreeError::Mesh { mesh: 0, .. }), "{error}");
}
