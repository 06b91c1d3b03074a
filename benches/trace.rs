//! Rays per second of both backends, single and batched; and for Embree the same rays as raw
//! packets that are ready in memory, which is the bound that the batches aim at.

#![allow(missing_docs)]

#[path = "../tests/shapes/mod.rs"]
mod shapes;

use bdpm::accel::bvh::Bvh;
use bdpm::accel::{Coherence, Hit, Intersect, Ray};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use shapes::{Mesh, Random, coherent_rays, room};
use std::hint::black_box;
use std::time::Duration;

const RAYS: usize = 1 << 14;

fn scenes() -> [(&'static str, Vec<Mesh>); 2] {
    let cube = Mesh::cuboid(glam::Vec3::ZERO, glam::Vec3::ONE, 0.0);
    [("room-36", room()), ("ball-217k", vec![Mesh::bumpy_ball(330), cube])]
}

fn ray_sets() -> [(&'static str, Coherence, Vec<Ray>); 2] {
    [
        ("coherent", Coherence::Coherent, coherent_rays(RAYS)),
        ("incoherent", Coherence::Incoherent, Random(1).incoherent_rays(RAYS)),
    ]
}

fn bench_backend(
    criterion: &mut Criterion,
    name: &str,
    build: impl Fn(&[Mesh]) -> Box<dyn Intersect>,
) {
    for (scene_name, meshes) in scenes() {
        let scene = build(&meshes);
        println!("{scene_name}: {:?}", scene.describe());
        for (kind, coherence, rays) in ray_sets() {
            let mut group = criterion.benchmark_group(format!("{scene_name}/{kind}"));
            group.throughput(Throughput::Elements(RAYS as u64));
            let mut hits = vec![Hit::MISS; RAYS];
            let mut occluded = vec![false; RAYS];
            group.bench_function(format!("{name}/closest/batch"), |bencher| {
                bencher.iter(|| scene.closest_hits(black_box(&rays), &mut hits, coherence));
            });
            group.bench_function(format!("{name}/closest/single"), |bencher| {
                bencher.iter(|| {
                    for (ray, hit) in black_box(&rays).iter().zip(&mut hits) {
                        *hit = scene.closest_hit(ray);
                    }
                });
            });
            group.bench_function(format!("{name}/occlusion/batch"), |bencher| {
                bencher.iter(|| scene.occlusions(black_box(&rays), &mut occluded, coherence));
            });
            group.finish();
        }
    }
}

#[cfg(feature = "embree")]
mod raw {
    //! Embree without the safe layer: the scene's set-up and packets as C code would make them.
    #![allow(unsafe_code)]

    use super::*;
    use criterion::BatchSize;
    use embree4_sys::*;

    #[repr(align(64))]
    struct Valid([i32; 16]);

    fn scene(meshes: &[Mesh]) -> (RTCDevice, RTCScene) {
        // SAFETY: Embree's set-up sequence; buffers are filled to the length that they are made
        // with, from meshes whose indices are in range.
        unsafe {
            let device = rtcNewDevice(std::ptr::null());
            let scene = rtcNewScene(device);
            rtcSetSceneBuildQuality(scene, RTCBuildQuality::RTC_BUILD_QUALITY_HIGH);
            for mesh in meshes {
                let geometry = rtcNewGeometry(device, RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE);
                let (vertex, float3) =
                    (RTCBufferType::RTC_BUFFER_TYPE_VERTEX, RTCFormat::RTC_FORMAT_FLOAT3);
                let (index, uint3) =
                    (RTCBufferType::RTC_BUFFER_TYPE_INDEX, RTCFormat::RTC_FORMAT_UINT3);
                let (positions, triangles) = (&mesh.positions, &mesh.triangles);
                rtcSetNewGeometryBuffer(geometry, vertex, 0, float3, 12, positions.len())
                    .cast::<glam::Vec3>()
                    .copy_from_nonoverlapping(positions.as_ptr(), positions.len());
                rtcSetNewGeometryBuffer(geometry, index, 0, uint3, 12, triangles.len())
                    .cast::<[u32; 3]>()
                    .copy_from_nonoverlapping(triangles.as_ptr(), triangles.len());
                rtcCommitGeometry(geometry);
                rtcAttachGeometry(scene, geometry);
                rtcReleaseGeometry(geometry);
            }
            rtcCommitScene(scene);
            assert_eq!(rtcGetDeviceError(device), RTCError::RTC_ERROR_NONE);
            (device, scene)
        }
    }

    fn packet(rays: &[Ray]) -> RTCRayHit16 {
        let mut packet = RTCRayHit16::default();
        for (lane, ray) in rays.iter().enumerate() {
            packet.ray.org_x[lane] = ray.origin.x;
            packet.ray.org_y[lane] = ray.origin.y;
            packet.ray.org_z[lane] = ray.origin.z;
            packet.ray.tnear[lane] = ray.t_near;
            packet.ray.dir_x[lane] = ray.direction.x;
            packet.ray.dir_y[lane] = ray.direction.y;
            packet.ray.dir_z[lane] = ray.direction.z;
            packet.ray.tfar[lane] = ray.t_far;
        }
        packet.ray.mask = [!0; 16];
        packet.hit.geomID = [RTC_INVALID_ID; 16];
        packet.hit.instID[0] = [RTC_INVALID_ID; 16];
        packet
    }

    pub fn bench(criterion: &mut Criterion) {
        let valid = Valid([-1; 16]);
        for (scene_name, meshes) in scenes() {
            let (device, scene) = scene(&meshes);
            for (kind, coherence, rays) in ray_sets() {
                let flags = match coherence {
                    Coherence::Coherent => RTCRayQueryFlags::RTC_RAY_QUERY_FLAG_COHERENT,
                    Coherence::Incoherent => RTCRayQueryFlags::RTC_RAY_QUERY_FLAG_INCOHERENT,
                };
                let feature_mask = RTCFeatureFlags::RTC_FEATURE_FLAG_ALL;
                let mut closest =
                    RTCIntersectArguments { flags, feature_mask, ..Default::default() };
                let mut any = RTCOccludedArguments { flags, feature_mask, ..Default::default() };
                let packets: Vec<_> = rays.chunks_exact(16).map(packet).collect();
                let occlusion: Vec<_> = packets.iter().map(|packet| packet.ray).collect();

                let mut group = criterion.benchmark_group(format!("{scene_name}/{kind}"));
                group.throughput(Throughput::Elements(RAYS as u64));
                // Queries overwrite packets, so each round gets a copy, outside the timing.
                group.bench_function("embree/closest/raw-packets", |bencher| {
                    let trace = |packets: &mut Vec<RTCRayHit16>| {
                        for packet in packets {
                            // SAFETY: a committed scene; all structs are aligned and complete.
                            unsafe {
                                rtcIntersect16(valid.0.as_ptr(), scene, packet, &mut closest);
                            }
                        }
                    };
                    bencher.iter_batched_ref(|| packets.clone(), trace, BatchSize::LargeInput);
                });
                group.bench_function("embree/occlusion/raw-packets", |bencher| {
                    let trace = |packets: &mut Vec<RTCRay16>| {
                        for packet in packets {
                            // SAFETY: as above.
                            unsafe { rtcOccluded16(valid.0.as_ptr(), scene, packet, &mut any) };
                        }
                    };
                    bencher.iter_batched_ref(|| occlusion.clone(), trace, BatchSize::LargeInput);
                });
                group.finish();
            }
            // SAFETY: released once; no query is under way.
            unsafe {
                rtcReleaseScene(scene);
                rtcReleaseDevice(device);
            }
        }
    }
}

fn backends(criterion: &mut Criterion) {
    #[cfg(feature = "embree")]
    {
        use bdpm::accel::embree::{CommittedScene, Device};
        raw::bench(criterion);
        bench_backend(criterion, "embree", |meshes| {
            let views: Vec<_> = meshes.iter().map(Mesh::view).collect();
            Box::new(CommittedScene::from_meshes(&Device::new().unwrap(), &views).unwrap())
        });
    }
    bench_backend(criterion, "bvh", |meshes| {
        let views: Vec<_> = meshes.iter().map(Mesh::view).collect();
        Box::new(Bvh::build(&views).unwrap())
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    targets = backends
}
criterion_main!(benches);
