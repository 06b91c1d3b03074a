//! The safe layer over Embree: batches, lifetimes, threads, refusals. `scripts/valgrind.sh` runs
//! this file under valgrind, so it stays small.

use crate::shapes::{Mesh, Random, coherent_rays, room};
use bdpm_accel::bvh::Bvh;
use bdpm_accel::embree::{CommittedScene, Device, DeviceConfig, EmbreeError, Isa};
use bdpm_accel::{Coherence, Hit, Intersect, MeshError, Ray, TriangleMesh};
use glam::{DAffine3, DVec3, Vec3};
use std::num::NonZero;

fn under_valgrind() -> bool {
    std::env::var_os("BDPM_TEST_EMBREE").is_some() // scripts/valgrind.sh
}

/// valgrind knows no AVX-512, and runs one thread at a time.
fn device() -> Device {
    if under_valgrind() { device_with(Isa::Avx2).unwrap() } else { Device::new().unwrap() }
}

fn device_with(isa: Isa) -> Result<Device, EmbreeError> {
    let threads = NonZero::new(1).filter(|_| under_valgrind());
    Device::with_config(DeviceConfig { isa: Some(isa), threads })
}

/// Devices of every packet width that this processor has.
fn devices() -> Vec<Device> {
    let widest = if under_valgrind() { Isa::Avx2 } else { Isa::Avx512 };
    let devices = [Isa::Sse2, Isa::Avx2, widest].map(device_with).into_iter().flatten();
    let mut devices: Vec<Device> = devices.collect();
    devices.dedup_by_key(|device| device.native_packet_size());
    assert_eq!(devices[0].native_packet_size(), 4, "every processor here has SSE2");
    devices
}

fn scene(meshes: &[Mesh]) -> CommittedScene {
    let views: Vec<_> = meshes.iter().map(Mesh::view).collect();
    CommittedScene::from_meshes(&device(), &views).unwrap()
}

const BOTH: [Coherence; 2] = [Coherence::Coherent, Coherence::Incoherent];

fn assert_same(ray: &Ray, one: &Hit, other: &Hit) {
    assert_eq!(one.is_miss(), other.is_miss(), "{ray:?}");
    if one.is_miss() {
        assert_eq!((one, other), (&Hit::MISS, &Hit::MISS));
    } else {
        assert!((one.t - other.t).abs() < 1e-5, "{one:?} {other:?}");
    }
}

#[test]
fn batches_of_every_length_answer_as_single_rays_do() {
    let scene = scene(&[Mesh::bumpy_ball(12)]);
    let mut random = Random(1);
    let mut rays = random.incoherent_rays(50);
    rays.extend(coherent_rays(50));
    for i in (0..100).step_by(7) {
        rays[i].t_far = 0.3;
    }
    let hits: Vec<Hit> = rays.iter().map(|ray| scene.closest_hit(ray)).collect();
    let occluded: Vec<bool> = rays.iter().map(|ray| scene.is_occluded(ray)).collect();
    assert!(hits.iter().any(Hit::is_miss) && !hits.iter().all(Hit::is_miss));
    for (hit, &occluded) in hits.iter().zip(&occluded) {
        assert_eq!(!hit.is_miss(), occluded);
    }

    for length in 0..=rays.len() {
        for coherence in BOTH {
            // Old contents of the slots must not show through, and later slots stay unchanged.
            let stale = Hit { t: -7.0, u: 7.0, v: 7.0, mesh: 7, triangle: 7 };
            let mut batch = vec![stale; length + 1];
            scene.closest_hits(&rays[..length], &mut batch[..length], coherence);
            for ((ray, one), other) in rays.iter().zip(&hits).zip(&batch[..length]) {
                assert_same(ray, one, other);
            }
            assert_eq!(batch[length], stale);

            for stale in [false, true] {
                let mut batch = vec![stale; length + 1];
                scene.occlusions(&rays[..length], &mut batch[..length], coherence);
                assert_eq!(batch[..length], occluded[..length]);
                assert_eq!(batch[length], stale);
            }
        }
    }
}

#[test]
#[should_panic(expected = "one hit per ray")]
fn slices_of_different_length_panic() {
    let scene = scene(&room());
    scene.closest_hits(&coherent_rays(20), &mut [Hit::MISS; 19], Coherence::Coherent);
}

#[test]
fn every_packet_width_gives_the_same_answers() {
    let ball = Mesh::bumpy_ball(12);
    let rays = Random(2).incoherent_rays(100);
    let expected: Vec<Hit> = {
        let scene = scene(std::slice::from_ref(&ball));
        rays.iter().map(|ray| scene.closest_hit(ray)).collect()
    };
    for device in devices() {
        let scene = CommittedScene::from_meshes(&device, &[ball.view()]).unwrap();
        assert_eq!(scene.describe().packet_size, device.native_packet_size());
        for coherence in BOTH {
            let mut hits = vec![Hit::MISS; rays.len()];
            scene.closest_hits(&rays, &mut hits, coherence);
            let mut occluded = vec![false; rays.len()];
            scene.occlusions(&rays, &mut occluded, coherence);
            for (i, ray) in rays.iter().enumerate() {
                assert_same(ray, &expected[i], &hits[i]);
                assert_eq!(occluded[i], !expected[i].is_miss(), "{ray:?}");
            }
        }
    }
}

#[test]
fn empty_scene_has_no_hits() {
    let empty = scene(&[]);
    let no_triangles = scene(&[Mesh::default(), Mesh { triangles: vec![], ..Mesh::bumpy_ball(3) }]);
    for scene in [empty, no_triangles] {
        for coherence in BOTH {
            let mut hits = [Hit { mesh: 0, ..Hit::MISS }; 40];
            scene.closest_hits(&coherent_rays(40), &mut hits, coherence);
            assert_eq!(hits, [Hit::MISS; 40]);
            let mut occluded = [true; 40];
            scene.occlusions(&coherent_rays(40), &mut occluded, coherence);
            assert_eq!(occluded, [false; 40]);
        }
        assert_eq!(scene.describe().triangles, 0);
    }
}

#[test]
fn meshes_are_numbered_in_order_even_after_an_empty_one() {
    let mut builder = device().scene_builder().unwrap();
    let empty = builder.add_mesh(TriangleMesh { positions: &[], triangles: &[] }).unwrap();
    let ball = builder.add_mesh(Mesh::bumpy_ball(9).view()).unwrap();
    assert_eq!((empty.index(), ball.index()), (0, 1));
    let hit = builder.commit().unwrap().closest_hit(&Ray::new(Vec3::ZERO, Vec3::ONE));
    assert_eq!(hit.mesh, ball.index());
}

#[test]
fn a_scene_outlives_the_device_its_meshes_and_other_scenes() {
    let device = device();
    let other = device.scene_builder().unwrap();
    let scene = CommittedScene::from_meshes(&device, &[Mesh::bumpy_ball(9).view()]).unwrap();
    drop(device);
    assert!(!scene.closest_hit(&Ray::new(Vec3::ZERO, Vec3::X)).is_miss());
    drop(scene);
    // A build after the device's handle went reports memory through the callback still.
    assert!(other.commit().unwrap().closest_hit(&Ray::new(Vec3::ZERO, Vec3::X)).is_miss());
}

/// A scene of a ball at `places`, by way of one that is shared.
fn placed(device: &Device, mesh: &Mesh, places: &[DVec3]) -> CommittedScene {
    let mut builder = device.scene_builder().unwrap();
    let shared = builder.share(&[mesh.view()]).unwrap();
    for &at in places {
        builder.place(shared, DAffine3::from_translation(at)).unwrap();
    }
    builder.commit().unwrap()
}

#[test]
fn instances_outlive_the_device_and_what_they_show() {
    let device = device();
    let mut left = device.scene_builder().unwrap();
    let shared = left.share(&[Mesh::bumpy_ball(9).view()]).unwrap();
    left.place(shared, DAffine3::IDENTITY).unwrap();
    let scene = placed(&device, &Mesh::bumpy_ball(9), &[DVec3::X * 5.0, DVec3::X * 9.0]);
    drop((left, device)); // a builder that is left with places to come
    assert_eq!(scene.closest_hit(&Ray::new(Vec3::X * 9.0, Vec3::X)).mesh, 1);
}

#[test]
fn scenes_are_built_queried_and_dropped_by_threads_at_once() {
    let device = device();
    let mesh = Mesh::bumpy_ball(9);
    let rays = Random(5).incoherent_rays(200);
    std::thread::scope(|threads| {
        for _ in 0..4 {
            threads.spawn(|| {
                for _ in 0..10 {
                    let plain = CommittedScene::from_meshes(&device, &[mesh.view()]).unwrap();
                    let placed = placed(&device, &mesh, &[DVec3::ZERO]);
                    let mut hits = [vec![Hit::MISS; 200], vec![Hit::MISS; 200]];
                    plain.closest_hits(&rays, &mut hits[0], Coherence::Incoherent);
                    placed.closest_hits(&rays, &mut hits[1], Coherence::Incoherent);
                    for ((ray, one), other) in rays.iter().zip(&hits[0]).zip(&hits[1]) {
                        assert_same(ray, one, other);
                    }
                }
            });
        }
    });
}

#[test]
fn threads_query_one_scene_at_once() {
    let scene = std::sync::Arc::new(scene(&room()));
    let rays = Random(3).incoherent_rays(2_000);
    let mut expected = vec![Hit::MISS; rays.len()];
    scene.closest_hits(&rays, &mut expected, Coherence::Incoherent);
    std::thread::scope(|threads| {
        for _ in 0..4 {
            let (scene, rays, expected) = (scene.clone(), &rays, &expected);
            threads.spawn(move || {
                let mut hits = vec![Hit::MISS; rays.len()];
                for _ in 0..5 {
                    scene.closest_hits(rays, &mut hits, Coherence::Incoherent);
                    assert_eq!(&hits, expected);
                }
            });
        }
    });
}

#[test]
fn a_builder_moves_to_another_thread() {
    let builder = device().scene_builder().unwrap();
    let scene = std::thread::spawn(move || {
        let mut builder = builder;
        builder.add_mesh(Mesh::bumpy_ball(9).view()).unwrap();
        builder.commit().unwrap()
    });
    assert!(scene.join().unwrap().is_occluded(&Ray::new(Vec3::ZERO, Vec3::X)));
}

/// The error of a mesh that breaks a rule, added after a good one; and the scene works on.
fn refusal(positions: &[Vec3], triangles: &[[u32; 3]]) -> String {
    let mut builder = device().scene_builder().unwrap();
    builder.add_mesh(Mesh::bumpy_ball(9).view()).unwrap();
    let error = builder.add_mesh(TriangleMesh { positions, triangles }).unwrap_err();
    assert!(matches!(error, EmbreeError::Mesh { mesh: 1, .. }), "{error:?}");
    let scene = builder.commit().unwrap();
    assert!(scene.is_occluded(&Ray::new(Vec3::ZERO, Vec3::X)));
    error.to_string()
}

#[test]
fn bad_meshes_are_refused_with_their_place() {
    let corner = [Vec3::ZERO, Vec3::X, Vec3::Y];
    assert_eq!(
        refusal(&corner, &[[0, 1, 2], [0, 3, 1]]),
        "mesh 1: triangle 1 uses vertex 3, but there are only 3 vertices"
    );
    assert_eq!(
        refusal(&[], &[[0, 0, 0]]),
        "mesh 1: triangle 0 uses vertex 0, but there are only 0 vertices"
    );
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let mut positions = corner;
            positions[2][axis] = bad;
            let text = refusal(&positions, &[[0, 1, 2]]);
            assert!(text.starts_with("mesh 1: vertex 2 is not finite: ["), "{text}");
        }
    }
    let text = refusal(&[Vec3::ZERO, Vec3::X, Vec3::Y * -1e30], &[[0, 1, 2]]);
    assert!(text.starts_with("mesh 1: vertex 2 is too far out: "), "{text}");
    assert!(text.ends_with("coordinates must be at most 1e12"), "{text}");
}

/// Both backends hit all that validation lets pass.
#[test]
fn the_largest_coordinates_are_hit() {
    let large = TriangleMesh::MAX_COORDINATE;
    let positions = [Vec3::X * large, Vec3::Y * large, Vec3::NEG_ONE * large];
    let mesh = TriangleMesh { positions: &positions, triangles: &[[0, 1, 2]] };
    assert_eq!(mesh.validate(), Ok(()));
    let embree = CommittedScene::from_meshes(&device(), &[mesh]).unwrap();
    let bvh = Bvh::build(&[mesh]).unwrap();
    for direction in [Vec3::NEG_Z, Vec3::new(0.1, 0.1, -1.0)] {
        for origin in [Vec3::Z, Vec3::Z * large] {
            let ray = Ray::new(origin, direction);
            let (a, b) = (embree.closest_hit(&ray), bvh.closest_hit(&ray));
            assert!(!a.is_miss() && !b.is_miss(), "{ray:?} {a:?} {b:?}");
            assert!((a.t - b.t).abs() < 1e-4 * large, "{ray:?} {a:?} {b:?}");
        }
    }
    let beyond = [Vec3::X * large.next_up(); 3];
    let mesh = TriangleMesh { positions: &beyond, triangles: &[] };
    assert!(matches!(mesh.validate(), Err(MeshError::TooLarge { vertex: 0, .. })));
}

#[test]
fn degenerate_triangles_are_harmless() {
    let point = Mesh { positions: vec![Vec3::splat(0.1)], triangles: vec![[0, 0, 0]; 20] };
    let line = Mesh {
        positions: vec![Vec3::NEG_ONE, Vec3::ZERO, Vec3::ONE],
        triangles: vec![[0, 1, 2], [2, 2, 0], [1, 1, 2]],
    };
    let scene = scene(&[point, line, Mesh::cuboid(Vec3::ZERO, Vec3::ONE, 0.0)]);
    let mut rays = Random(4).incoherent_rays(200);
    rays.push(Ray::new(Vec3::new(0.5, 0.1, 0.1), -Vec3::X)); // through the point
    rays.push(Ray::new(Vec3::new(-0.5, 0.5, 0.0), Vec3::new(1.0, -1.0, 0.0))); // across the line
    let mut hits = vec![Hit::MISS; rays.len()];
    scene.closest_hits(&rays, &mut hits, Coherence::Incoherent);
    for (ray, hit) in rays.iter().zip(&hits) {
        assert_eq!(hit.mesh, 2, "{ray:?} {hit:?}");
        assert!(hit.t.is_finite() && hit.u.is_finite() && hit.v.is_finite());
    }
}

/// Ends that leave nothing between them, by number or for want of one.
#[test]
fn nothing_lies_in_an_empty_interval() {
    let scene = scene(&room());
    let ends = [f32::NEG_INFINITY, f32::MIN, -1.0, 0.0, f32::NAN];
    let rays: Vec<Ray> =
        ends.iter().map(|&t_far| Ray { t_far, ..Ray::new(Vec3::ZERO, Vec3::X) }).collect();
    for ray in &rays {
        assert!(!scene.is_occluded(ray) && scene.closest_hit(ray).is_miss(), "{ray:?}");
    }
    for coherence in BOTH {
        let mut occluded = [true; 5];
        scene.occlusions(&rays, &mut occluded, coherence);
        assert_eq!(occluded, [false; 5]);
        let mut hits = [Hit { mesh: 0, ..Hit::MISS }; 5];
        scene.closest_hits(&rays, &mut hits, coherence);
        assert_eq!(hits, [Hit::MISS; 5]);
    }
}

/// A ray with bits from anywhere in some of its eight numbers.
fn mangled(ray: &Ray, random: &mut Random) -> Ray {
    let special = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, 1e-45, f32::MAX];
    let mut ray = *ray;
    for _ in 0..1 + random.bits() % 3 {
        let (place, kind) = (random.bits() as usize % 8, random.bits() as usize % 14);
        let bits = f32::from_bits(random.bits() as u32);
        let number = special.get(kind).copied().unwrap_or(bits);
        match place {
            0..3 => ray.origin[place] = number,
            3..6 => ray.direction[place - 3] = number,
            6 => ray.t_near = number,
            _ => ray.t_far = number,
        }
    }
    ray
}

/// No promise about the answers to rays that are no rays, only that they come and name something.
/// Sound rays beside them are answered as if alone, but for coherent ones, which Embree bounds
/// together.
#[test]
fn no_numbers_of_a_ray_do_harm() {
    let ball = Mesh::bumpy_ball(20);
    let triangles = ball.triangles.len() as u32;
    let count = if under_valgrind() { 500 } else { 20_000 };
    let mut random = Random(6);
    let sound = random.incoherent_rays(count);
    let sound: Vec<Ray> = sound.into_iter().chain(coherent_rays(count)).collect();
    let is_mangled = |i: usize| i.is_multiple_of(3);
    let mangle = |(i, ray)| if is_mangled(i) { mangled(ray, &mut random) } else { *ray };
    let rays: Vec<Ray> = sound.iter().enumerate().map(mangle).collect();
    for (device, watertight) in
        devices().iter().flat_map(|device| [(device, false), (device, true)])
    {
        let mut builder = device.scene_builder().unwrap();
        builder.set_watertight(watertight).unwrap();
        builder.add_mesh(Mesh::cuboid(Vec3::ZERO, Vec3::ONE, 0.0).view()).unwrap();
        let shared = builder.share(&[ball.view()]).unwrap();
        builder.place(shared, DAffine3::from_scale(DVec3::new(0.5, 0.3, 0.4))).unwrap();
        let scene = builder.commit().unwrap();
        let check = |i: usize, hit: &Hit| {
            let limit = [12, triangles].get(hit.mesh as usize).copied();
            assert!(hit.is_miss() || hit.triangle < limit.unwrap(), "{:?} {hit:?}", rays[i]);
        };
        for coherence in BOTH {
            let mut hits = vec![Hit::MISS; rays.len()];
            scene.closest_hits(&rays, &mut hits, coherence);
            let mut occluded = vec![false; rays.len()];
            scene.occlusions(&rays, &mut occluded, coherence);
            for (i, ray) in rays.iter().enumerate() {
                let one = scene.closest_hit(ray);
                check(i, &one);
                check(i, &hits[i]);
                let alone = scene.is_occluded(ray);
                if !is_mangled(i) {
                    assert_eq!(alone, !one.is_miss(), "{ray:?}");
                }
                if !is_mangled(i) && coherence == Coherence::Incoherent {
                    assert_same(ray, &one, &hits[i]);
                    assert_eq!(occluded[i], alone, "{ray:?}");
                }
            }
        }
    }
}

#[test]
fn describe_counts_triangles_and_bytes() {
    let mesh = Mesh::bumpy_ball(60);
    let info = scene(std::slice::from_ref(&mesh)).describe();
    println!("{info:?}");
    assert_eq!(info.triangles, mesh.triangles.len());
    let geometry = 12 * (mesh.positions.len() + mesh.triangles.len());
    assert!((geometry..100 * geometry).contains(&info.bytes), "{info:?}");
    assert!(info.name.starts_with("Embree 4."), "{info:?}");
}
