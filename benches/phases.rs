//! The phases of an iteration for Criterion's statistics, and ratios at the end. Each ratio is of
//! two that run in turn: a phase and its limit, raw Embree packets on the same rays; iterations
//! that measure noise and that do not; one thread and two, beside arithmetic alone. `BDPM_SCENE`
//! takes another scene than `scenes/cornell-box`.

#![allow(missing_docs)]

mod paired;
mod raw;
mod subject;

use bdpm::accel::{AccelInfo, Coherence, Hit, HitPacket, Intersect, Ray, RayPacket, TriangleMesh};
use bdpm::base::rng::{Stream, StreamKey};
use bdpm::noise::Measure;
use bdpm::scene::backend::{Backend, build};
use bdpm::simd::{LANES, Mask};
use bdpm::transport::camera_paths::{CameraPass, CameraPaths};
use bdpm::transport::light_paths::LightPaths;
use bdpm::transport::photon_map::PhotonMap;
use bdpm::{Renderer, Scene, Settings};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use paired::{Ratio, measures, timed};
use raw::{Packets, RawScene};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::cell::RefCell;
use std::sync::Arc;
use std::sync::{Mutex, OnceLock};
use std::time::Duration;
use subject::{camera_phase, scene};

const LIGHT_PATHS: [u32; 2] = [1000, 100_000];

/// Keeps all rays that go through it.
struct Recorder<'a> {
    accel: &'a Arc<dyn Intersect>,
    /// For closest hits and for occlusion, coherent ones and others.
    rays: Mutex<[[Vec<Ray>; 2]; 2]>,
}

impl<'a> Recorder<'a> {
    fn new(accel: &'a Arc<dyn Intersect>) -> Self {
        Self { accel, rays: Mutex::default() }
    }

    /// The rays in full packets, however few came at a time.
    fn into_packets(self) -> Vec<Packets> {
        let [closest, any] = self.rays.into_inner().unwrap();
        let packets = |rays: [Vec<Ray>; 2], packets: fn(&[Ray], Coherence) -> Packets| {
            let [coherent, others] = rays;
            [packets(&coherent, Coherence::Coherent), packets(&others, Coherence::Incoherent)]
        };
        [packets(closest, Packets::closest), packets(any, Packets::any)]
            .into_iter()
            .flatten()
            .collect()
    }

    fn record(&self, kind: usize, coherence: Coherence, rays: &[RayPacket], count: usize) {
        let list =
            &mut self.rays.lock().unwrap()[kind][usize::from(coherence != Coherence::Coherent)];
        list.extend((0..count).map(|ray| rays[ray / LANES].get(ray % LANES)));
    }
}

impl Intersect for Recorder<'_> {
    fn intersect(
        &self,
        rays: &[RayPacket],
        count: usize,
        hits: &mut [HitPacket],
        coherence: Coherence,
    ) {
        self.record(0, coherence, rays, count);
        self.accel.intersect(rays, count, hits, coherence);
    }

    fn occlude(
        &self,
        rays: &[RayPacket],
        count: usize,
        occluded: &mut [Mask],
        coherence: Coherence,
    ) {
        self.record(1, coherence, rays, count);
        self.accel.occlude(rays, count, occluded, coherence);
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

/// One thread, so that a phase's time is the time of its work. It is this one: waking another up
/// takes as long as tracing hundreds of light paths.
fn one_thread() -> &'static ThreadPool {
    static ONE: OnceLock<ThreadPool> = OnceLock::new();
    let here = || ThreadPoolBuilder::new().num_threads(1).use_current_thread().build().unwrap();
    ONE.get_or_init(here)
}

fn camera_pass<'a>(
    scene: &'a Arc<Scene>,
    accel: &'a Arc<dyn Intersect>,
    settings: &'a Settings,
) -> CameraPass<'a> {
    let view = scene.camera.view(settings.width, settings.height);
    let key = StreamKey::new(1, Stream::CameraPath, 0);
    CameraPass {
        scene,
        view,
        accel: &**accel,
        settings,
        key,
        gather_early: false,
        hides_lights: false,
        points: None,
        cache: None,
        light_edges: None,
    }
}

/// The phases alone.
fn phases(criterion: &mut Criterion) {
    let (scene, settings) = scene();
    let accel = build(Backend::Embree, &scene).unwrap();
    let one = one_thread();
    let pass = camera_pass(&scene, &accel, &settings);
    let mut paths = CameraPaths::default();
    let mut group = criterion.benchmark_group("camera");
    let count = settings.pixels() as u64 * u64::from(settings.camera_paths);
    group.throughput(Throughput::Elements(count));
    group.bench_function("phase", |bencher| {
        bencher.iter(|| camera_phase(&pass, &mut paths, |_| ()));
    });
    group.finish();
    for light_paths in LIGHT_PATHS {
        let settings = Settings { light_paths, ..settings.clone() };
        let (mut light, mut map) = (LightPaths::default(), PhotonMap::default());
        let mut group = criterion.benchmark_group(format!("light/{light_paths}"));
        group.throughput(Throughput::Elements(u64::from(light_paths)));
        group.bench_function("paths", |bencher| {
            let mut trace = || light.trace(&scene, &*accel, &settings, light_paths, 0);
            bencher.iter(|| one.install(&mut trace));
        });
        group.throughput(Throughput::Elements(light.len() as u64));
        group.bench_function("map", |bencher| {
            bencher.iter(|| one.install(|| map.build(&light, settings.radius)));
        });
        group.finish();
    }
}

/// Work of so many paths in this many iterations in turn: a processor learns the branches of a few
/// rays by heart, which no render repeats.
fn iterations(paths: u32) -> u64 {
    u64::from((50_000 / paths).max(1))
}

/// Raw packets on what `record` traces in each of its iterations.
fn recorded(
    accel: &Arc<dyn Intersect>,
    iterations: u64,
    record: impl Fn(&Recorder, u64),
) -> Vec<Vec<Packets>> {
    let packets = |iteration| {
        let recorder = Recorder::new(accel);
        record(&recorder, iteration);
        recorder.into_packets()
    };
    (0..iterations).map(packets).collect()
}

/// Traces the packets of one iteration after the other.
fn raw<'a>(scene: &'a RawScene, packets: &'a [Vec<Packets>]) -> impl FnMut() -> Duration + use<'a> {
    let mut iterations = packets.iter().cycle();
    move || {
        // Queries overwrite packets.
        let mut own = iterations.next().unwrap().clone();
        timed(|| scene.trace(&mut own))
    }
}

/// Arithmetic in registers alone, in pieces for any thread: what a second one gains
/// where nothing waits for memory.
fn arithmetic() {
    (0..100).into_par_iter().for_each(|piece| {
        let mut rng = StreamKey::new(1, Stream::Test, 0).rng(piece);
        std::hint::black_box((0..100_000).map(|_| rng.next_1d()).fold(0.0, f32::max));
    });
}

/// Time of `work` with one thread over its time with two. Each runs long enough that waking up does
/// not matter: a processor that slept needs milliseconds to come back where others want it, too.
fn one_over_two(mut work: impl FnMut() + Send) -> Ratio {
    let [one, two] =
        [1, 2].map(|threads| ThreadPoolBuilder::new().num_threads(threads).build().unwrap());
    work(); // takes the memory
    let times = Duration::from_millis(200).div_duration_f64(timed(&mut work)).ceil() as u32;
    let work = RefCell::new(work);
    let on = |pool: &ThreadPool| {
        let work = &mut *work.borrow_mut();
        timed(|| pool.install(|| (0..times).for_each(|_| work())))
    };
    Ratio::new(|| on(&one), || on(&two))
}

fn raw_scene(scene: &Arc<Scene>) -> RawScene {
    let geometry = scene.geometry();
    let copy = |place| (geometry.positions(place), geometry.mesh(place).triangles);
    let copies: Vec<_> = geometry.instances.iter().map(copy).collect();
    RawScene::new(copies.iter().map(|(positions, triangles)| TriangleMesh { positions, triangles }))
}

fn ratios(_: &mut Criterion) {
    if !measures() {
        return;
    }
    let (scene, settings) = scene();
    let accel = build(Backend::Embree, &scene).unwrap();
    let limit = raw_scene(&scene);
    let one = one_thread();
    println!("\nmedian (quartiles) of rounds in turn");

    let pass = camera_pass(&scene, &accel, &settings);
    let mut paths = CameraPaths::default();
    let packets = recorded(&accel, 1, |recorder, _| {
        camera_phase(&CameraPass { accel: recorder, ..pass }, &mut CameraPaths::default(), |_| ());
    });
    let phase = || timed(|| camera_phase(&pass, &mut paths, |_| ()));
    let ratio = Ratio::new(phase, raw(&limit, &packets));
    let count = settings.pixels() as f64 * f64::from(settings.camera_paths);
    let ns = ratio.seconds.map(|time| time / count * 1e9);
    println!("camera phase over raw packets: {ratio}; {:.0} and {:.0} ns per path", ns[0], ns[1]);
    println!("arithmetic alone, one thread over two: {}", one_over_two(arithmetic));

    for light_paths in LIGHT_PATHS {
        let settings = Settings { light_paths, ..settings.clone() };
        let (mut light, mut map) = (LightPaths::default(), PhotonMap::default());
        let packets = recorded(&accel, iterations(light_paths), |recorder, iteration| {
            let mut light = LightPaths::default();
            one.install(|| light.trace(&scene, recorder, &settings, light_paths, iteration));
        });
        let mut turns = (0..iterations(light_paths)).cycle();
        let phase = || {
            let iteration = turns.next().unwrap();
            timed(|| {
                one.install(|| {
                    light.trace(&scene, &*accel, &settings, light_paths, iteration);
                    map.build(&light, settings.radius);
                });
            })
        };
        let ratio = Ratio::new(phase, raw(&limit, &packets));
        let ns = ratio.seconds.map(|time| time / f64::from(light_paths) * 1e9);
        let [own, raw] = ns;
        println!(
            "light phase over raw packets, N_F = {light_paths}: {ratio}; {own:.0} and {raw:.0} ns per path"
        );
        let renderer = || Renderer::new(&scene, &accel, settings.clone()).unwrap();
        let (mut first, mut second) = (renderer(), renderer());
        let ratio = Ratio::new(
            || timed(|| one.install(|| first.iterate(Measure::Pairs))),
            || timed(|| one.install(|| second.iterate(Measure::Off))),
        );
        println!("measuring over production iteration, N_F = {light_paths}: {ratio}");
        let mut renderer = renderer();
        let ratio = one_over_two(|| drop(renderer.iterate(Measure::Off)));
        println!("one thread over two, N_F = {light_paths}: {ratio}");
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    targets = phases, ratios
}
criterion_main!(benches);
