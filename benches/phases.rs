//! The three phases of an iteration beside their limit, raw Embree packets on the same rays; the
//! cost of measuring; and what a second thread gains. Ratios of one run are printed at the end.

#![allow(missing_docs)]

mod home;
mod raw;
mod subject;

use bdpm::accel::backend::{Backend, build};
use bdpm::accel::{AccelInfo, Coherence, Hit, Intersect, Ray, TriangleMesh};
use bdpm::camera_paths::{CameraPass, CameraPaths};
use bdpm::light_paths::LightPaths;
use bdpm::merge::Merge;
use bdpm::noise::Measure;
use bdpm::photon_map::PhotonMap;
use bdpm::rng::{Stream, StreamKey};
use bdpm::{Renderer, Settings};
use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use home::median;
use raw::{Packets, RawScene};
use std::sync::Mutex;
use std::time::Duration;
use subject::{BATCH, Sum, camera_phase, scene};

/// Keeps all rays that go through it.
struct Recorder<'a> {
    accel: &'a dyn Intersect,
    packets: Mutex<Vec<Packets>>,
}

impl<'a> Recorder<'a> {
    fn new(accel: &'a dyn Intersect) -> Self {
        Self { accel, packets: Mutex::default() }
    }

    fn into_packets(self) -> Vec<Packets> {
        self.packets.into_inner().unwrap()
    }
}

impl Intersect for Recorder<'_> {
    fn closest_hits(&self, rays: &[Ray], hits: &mut [Hit], coherence: Coherence) {
        self.packets.lock().unwrap().push(Packets::closest(rays, coherence));
        self.accel.closest_hits(rays, hits, coherence);
    }

    fn occlusions(&self, rays: &[Ray], occluded: &mut [bool], coherence: Coherence) {
        self.packets.lock().unwrap().push(Packets::any(rays, coherence));
        self.accel.occlusions(rays, occluded, coherence);
    }

    fn closest_hit(&self, ray: &Ray) -> Hit {
        self.accel.closest_hit(ray)
    }

    fn is_occluded(&self, ray: &Ray) -> bool {
        self.accel.is_occluded(ray)
    }

    fn describe(&self) -> AccelInfo {
        self.accel.describe()
    }
}

fn bench_raw(criterion: &mut Criterion, group: &str, raw: &RawScene, packets: &[Packets]) {
    let mut group = criterion.benchmark_group(group);
    group.bench_function("raw packets on the same rays", |bencher| {
        let trace = |packets: &mut Vec<Packets>| raw.trace(packets);
        bencher.iter_batched_ref(|| packets.to_vec(), trace, BatchSize::LargeInput);
    });
}

fn phases(criterion: &mut Criterion) {
    let (scene, settings) = scene();
    let accel = build(Backend::Embree, &scene).unwrap();
    let geometry = scene.geometry();
    let copy = |place| (geometry.positions(place), geometry.mesh(place).triangles);
    let copies: Vec<_> = geometry.places.iter().map(copy).collect();
    let raw = RawScene::new(
        copies.iter().map(|(positions, triangles)| TriangleMesh { positions, triangles }),
    );
    // One thread, so that a phase's time is the time of its work.
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();

    let key = StreamKey::new(1, Stream::CameraPath, 0);
    let view = scene.camera.view(settings.width, settings.height);
    let pass = CameraPass {
        scene: &scene,
        view,
        accel: &*accel,
        settings: &settings,
        key,
        gather_early: false,
    };
    let mut paths = CameraPaths::default();
    let recorder = Recorder::new(&*accel);
    camera_phase(&CameraPass { accel: &recorder, ..pass }, &mut paths, |_| ());
    bench_raw(criterion, "camera", &raw, &recorder.into_packets());
    let mut group = criterion.benchmark_group("camera");
    let count = settings.pixels() as u64 * u64::from(settings.camera_paths);
    group.throughput(Throughput::Elements(count));
    group.bench_function("phase", |bencher| {
        bencher.iter(|| camera_phase(&pass, &mut paths, |_| ()));
    });
    group.finish();

    for light_paths in [1000, 100_000] {
        let settings = Settings { light_paths, ..settings.clone() };
        let name = format!("light/{light_paths}");
        let (mut light, mut map) = (LightPaths::default(), PhotonMap::default());
        let recorder = Recorder::new(&*accel);
        one.install(|| light.trace(&scene, &recorder, &settings, light_paths, 0));
        bench_raw(criterion, &name, &raw, &recorder.into_packets());
        let mut group = criterion.benchmark_group(&name);
        group.throughput(Throughput::Elements(u64::from(light_paths)));
        group.bench_function("phase", |bencher| {
            bencher.iter(|| {
                one.install(|| light.trace(&scene, &*accel, &settings, light_paths, 0));
                map.build(&light, settings.radius);
            });
        });
        group.throughput(Throughput::Elements(light.len() as u64));
        group.bench_function("map alone", |bencher| {
            bencher.iter(|| map.build(&light, settings.radius));
        });
        group.finish();

        // Merging alone, on camera paths that are ready.
        let mut batches = Vec::new();
        camera_phase(&pass, &mut paths, |paths| {
            if batches.len() < 8 {
                batches.push(paths.clone());
            }
        });
        let merge = Merge::new(&map, settings.merge_vertex);
        let mut group = criterion.benchmark_group(format!("merge/{light_paths}"));
        group.throughput(Throughput::Elements(8 * u64::from(BATCH)));
        group.bench_function("phase", |bencher| {
            bencher.iter(|| {
                let mut sum = Sum::default();
                batches.iter().for_each(|batch| merge.visit(batch, &mut sum));
                sum.light
            });
        });
        group.finish();
    }
}

fn iterations(criterion: &mut Criterion) {
    let (scene, settings) = scene();
    let accel = build(Backend::Embree, &scene).unwrap();
    for light_paths in [1000, 100_000] {
        let settings = Settings { light_paths, ..settings.clone() };
        let mut group = criterion.benchmark_group(format!("iteration/{light_paths}"));
        for (name, measure, threads) in [
            ("production, 1 thread", Measure::Off, 1),
            ("measuring, 1 thread", Measure::Pairs, 1),
            ("production, 2 threads", Measure::Off, 2),
        ] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut renderer = Renderer::new(&scene, &*accel, settings.clone()).unwrap();
            group.bench_function(name, |bencher| {
                bencher.iter(|| pool.install(|| renderer.iterate(measure)));
            });
        }
        group.finish();
    }
}

fn ratios(_: &mut Criterion) {
    let ratio = |what: &str, group: &str, one: &str, other: &str| {
        if let (Some(one), Some(other)) = (median(group, one), median(group, other)) {
            println!("{what}: {:.2}", one / other);
        }
    };
    let raw = "raw packets on the same rays";
    ratio("camera phase over raw packets", "camera", "phase", raw);
    for count in ["1000", "100000"] {
        let light = format!("light/{count}");
        ratio(&format!("light phase over raw packets, N_F = {count}"), &light, "phase", raw);
        let iteration = format!("iteration/{count}");
        ratio(
            &format!("measuring over production iteration, N_F = {count}"),
            &iteration,
            "measuring, 1 thread",
            "production, 1 thread",
        );
        ratio(
            &format!("one thread over two, N_F = {count}"),
            &iteration,
            "production, 1 thread",
            "production, 2 threads",
        );
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    targets = phases, iterations, ratios
}
criterion_main!(benches);
