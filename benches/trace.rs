//! Rays per second of both backends, single and in packets. For Embree, also raw packets of the
//! same rays that are ready in memory: the bound for the safe layer.

#![allow(missing_docs)]

#[cfg(feature = "embree")]
mod raw;
#[path = "../tests/common/shapes.rs"]
mod shapes;

use bdpm::accel::bvh::Bvh;
use bdpm::accel::{Coherence, Hit, HitPacket, Intersect, Ray, RayPacket};
use bdpm::simd::{LANES, Mask};
#[cfg(feature = "embree")]
use criterion::BatchSize;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
#[cfg(feature = "embree")]
use raw::{Packets, RawScene};
use shapes::{Mesh, Random, coherent_rays, room};
use std::hint::black_box;
use std::sync::Arc;
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
    build: impl Fn(&[Mesh]) -> Arc<dyn Intersect>,
) {
    for (scene_name, meshes) in scenes() {
        let scene = build(&meshes);
        println!("{scene_name}: {:?}", scene.describe());
        for (kind, coherence, rays) in ray_sets() {
            let mut group = criterion.benchmark_group(format!("{scene_name}/{kind}"));
            group.throughput(Throughput::Elements(RAYS as u64));
            let packets: Vec<_> = rays.chunks(LANES).map(RayPacket::of).collect();
            let mut hits = vec![HitPacket::default(); packets.len()];
            let mut occluded = vec![Mask::default(); packets.len()];
            group.bench_function(format!("{name}/closest/packets"), |bencher| {
                let rays = black_box(&packets);
                bencher.iter(|| scene.intersect(rays, RAYS, &mut hits, coherence));
            });
            let mut hits = vec![Hit::MISS; RAYS];
            group.bench_function(format!("{name}/closest/single"), |bencher| {
                bencher.iter(|| {
                    for (ray, hit) in black_box(&rays).iter().zip(&mut hits) {
                        *hit = scene.closest_hit(ray);
                    }
                });
            });
            group.bench_function(format!("{name}/occlusion/packets"), |bencher| {
                let rays = black_box(&packets);
                bencher.iter(|| scene.occlude(rays, RAYS, &mut occluded, coherence));
            });
            group.finish();
        }
    }
}

/// The bound: the same rays as packets that are ready in memory.
#[cfg(feature = "embree")]
fn bench_raw(criterion: &mut Criterion) {
    for (scene_name, meshes) in scenes() {
        let scene = RawScene::new(meshes.iter().map(Mesh::view));
        for (kind, coherence, rays) in ray_sets() {
            let mut group = criterion.benchmark_group(format!("{scene_name}/{kind}"));
            group.throughput(Throughput::Elements(RAYS as u64));
            for (query, packets) in [
                ("closest", Packets::closest(&rays, coherence)),
                ("occlusion", Packets::any(&rays, coherence)),
            ] {
                // Queries overwrite packets, so each round gets a copy, outside the timing.
                group.bench_function(format!("embree/{query}/raw-packets"), |bencher| {
                    bencher.iter_batched_ref(
                        || [packets.clone()],
                        |packets| scene.trace(packets),
                        BatchSize::LargeInput,
                    );
                });
            }
            group.finish();
        }
    }
}

fn backends(criterion: &mut Criterion) {
    #[cfg(feature = "embree")]
    {
        use bdpm::accel::embree::{CommittedScene, Device};
        bench_raw(criterion);
        bench_backend(criterion, "embree", |meshes| {
            let views: Vec<_> = meshes.iter().map(Mesh::view).collect();
            Arc::new(CommittedScene::from_meshes(&Device::new().unwrap(), &views).unwrap())
        });
    }
    bench_backend(criterion, "bvh", |meshes| {
        let views: Vec<_> = meshes.iter().map(Mesh::view).collect();
        Arc::new(Bvh::build(&views).unwrap())
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
