//! The pure-Rust BVH against brute force and against what is known; needs no Embree.

use crate::shapes::{Mesh, Random, coherent_rays, room};
use bdpm_accel::bvh::{Bvh, BvhError};
use bdpm_accel::{Coherence, Hit, Intersect, MeshError, Ray, TriangleMesh};
use glam::{DVec3, Vec3, Vec3Swizzles};

fn bvh(meshes: &[Mesh]) -> Bvh {
    Bvh::build(&meshes.iter().map(Mesh::view).collect::<Vec<_>>()).unwrap()
}

/// The nearest distance over all triangles, by the textbook formula (Cramer's rule) in f64.
fn brute_force(meshes: &[Mesh], ray: &Ray) -> Option<f64> {
    let mut nearest: Option<f64> = None;
    for mesh in meshes {
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|i| DVec3::from(mesh.positions[i as usize]));
            let (ab, ac) = (b - a, c - a);
            let (from, direction) = (DVec3::from(ray.origin) - a, DVec3::from(ray.direction));
            let p = direction.cross(ac);
            let determinant = ab.dot(p);
            let (u, q) = (from.dot(p) / determinant, from.cross(ab));
            let (v, t) = (direction.dot(q) / determinant, ac.dot(q) / determinant);
            let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
            if inside && t > f64::from(ray.t_near) && t < f64::from(ray.t_far) {
                nearest = Some(nearest.map_or(t, |n| n.min(t)));
            }
        }
    }
    nearest
}

#[test]
fn closest_hits_agree_with_brute_force() {
    let soup = Mesh::soup(300, &mut Random(1));
    for meshes in [room(), vec![Mesh::bumpy_ball(9), soup]] {
        let tree = bvh(&meshes);
        let mut random = Random(2);
        let mut differ = 0;
        let mut found = 0;
        for _ in 0..20_000 {
            let ray = random.ray();
            let (hit, expected) = (tree.closest_hit(&ray), brute_force(&meshes, &ray));
            assert_eq!(tree.is_occluded(&ray), !hit.is_miss(), "{ray:?}");
            found += usize::from(expected.is_some());
            differ += usize::from(match expected {
                None => !hit.is_miss(),
                Some(t) => {
                    let error = (f64::from(hit.t) - t) * f64::from(ray.direction.length());
                    hit.is_miss() || error.abs() > 1e-4
                }
            });
        }
        assert!(found > 5_000);
        // Silhouettes and ends of intervals within rounding; f64 decides them otherwise than f32.
        assert!(differ <= 2, "{differ}");
    }
}

#[test]
fn batches_answer_as_single_rays_do() {
    let tree = bvh(&room());
    let rays = coherent_rays(100);
    for length in 0..=rays.len() {
        for coherence in [Coherence::Coherent, Coherence::Incoherent] {
            let mut hits = vec![Hit::MISS; length];
            tree.closest_hits(&rays[..length], &mut hits, coherence);
            let mut occluded = vec![false; length];
            tree.occlusions(&rays[..length], &mut occluded, coherence);
            for ((ray, hit), &occluded) in rays.iter().zip(&hits).zip(&occluded) {
                assert_eq!(*hit, tree.closest_hit(ray));
                assert_eq!(occluded, tree.is_occluded(ray));
            }
        }
    }
}

#[test]
fn empty_tree_has_no_hits() {
    for tree in [bvh(&[]), bvh(&[Mesh::default()])] {
        let ray = Ray::new(Vec3::ZERO, Vec3::ONE);
        assert_eq!(tree.closest_hit(&ray), Hit::MISS);
        assert!(!tree.is_occluded(&ray));
        assert_eq!(tree.describe().triangles, 0);
    }
}

#[test]
fn one_triangle_is_hit_from_both_sides() {
    let mesh = Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]] };
    let tree = bvh(&[Mesh::default(), mesh]);
    for side in [-2.0, 2.0] {
        let ray = Ray::new(Vec3::new(0.25, 0.5, side), Vec3::Z * -side);
        let hit = Hit { t: 1.0, u: 0.25, v: 0.5, mesh: 1, triangle: 0 };
        assert_eq!(tree.closest_hit(&ray), hit);
        assert_eq!(tree.closest_hit(&Ray { t_far: 0.99, ..ray }), Hit::MISS);
        assert_eq!(tree.closest_hit(&Ray { t_near: 1.01, ..ray }), Hit::MISS);
    }
}

/// Rays in the planes of faces and along axes, where boxes are flat and reciprocals infinite.
#[test]
fn rays_along_axes_and_in_planes_of_faces_stay_inside() {
    let tree = bvh(&[Mesh::cuboid(Vec3::ZERO, Vec3::ONE, 0.0)]);
    for axis in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z] {
        for offset in [0.0, -0.0, 0.5, 1.0, -1.0] {
            let side = axis.yzx().abs() * offset + axis.zxy().abs() * offset;
            let hit = tree.closest_hit(&Ray::new(side, axis));
            assert!((hit.t - 1.0).abs() < 1e-6, "{axis} {side} {hit:?}");
        }
    }
}

#[test]
fn many_equal_and_degenerate_triangles_are_harmless() {
    let mut mesh = Mesh::cuboid(Vec3::ZERO, Vec3::ONE, 0.0);
    for _ in 0..5_000 {
        mesh.triangles.push(mesh.triangles[0]);
        mesh.triangles.push([1, 1, 1]);
    }
    let tree = bvh(&[mesh]);
    for ray in Random(3).incoherent_rays(1_000) {
        assert!(!tree.closest_hit(&ray).is_miss(), "{ray:?}");
    }
}

#[test]
fn bad_meshes_are_refused_as_embree_refuses_them() {
    let good = Mesh::bumpy_ball(3);
    let bad = TriangleMesh { positions: &[Vec3::ZERO, Vec3::NAN], triangles: &[] };
    let error = Bvh::build(&[good.view(), bad]).err().unwrap();
    assert!(
        matches!(
            error,
            BvhError::Mesh { mesh: 1, problem: MeshError::NotFinite { vertex: 1, .. } }
        ),
        "{error:?}"
    );
    let bad = TriangleMesh { positions: &[Vec3::ZERO], triangles: &[[0, 0, 9]] };
    let error = Bvh::build(&[bad]).err().unwrap();
    assert_eq!(
        error.to_string(),
        "mesh 0: triangle 0 uses vertex 9, but there are only 1 vertices"
    );
}
