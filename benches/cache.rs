//! The cache of `--strategy gather`: building it, and a look-up, which is the `gamma` of this
//! technique. At the end, the time of all look-ups of an image over that of the short camera paths
//! that they end. `BDPM_SCENE` takes another scene than `scenes/cornell-box`.

#![allow(missing_docs)]

mod paired;
mod subject;

use bdpm::accel::Intersect;
use bdpm::base::rng::{Stream, StreamKey};
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::Strategy;
use bdpm::transport::camera_paths::{CameraPass, CameraPaths};
use bdpm::transport::kernel::MergeKernel;
use bdpm::transport::merge::{Merge, MergeOptions, MergeOutput};
use bdpm::transport::photon_map::PhotonMap;
use bdpm::transport::suffix_cache::{SuffixCache, SuffixRecord, SuffixRecorder};
use bdpm::{Scene, Settings};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use paired::{Ratio, measures, timed};
use std::sync::Arc;
use subject::{camera_phase, scene};

fn pass<'a>(
    scene: &'a Scene,
    accel: &'a Arc<dyn Intersect>,
    settings: &'a Settings,
    cache: Option<&'a SuffixCache>,
) -> CameraPass<'a> {
    CameraPass {
        scene,
        view: scene.camera.view(settings.width, settings.height),
        accel: &**accel,
        settings,
        key: StreamKey::new(1, Stream::CameraPath, 0),
        gather_early: false,
        hides_lights: false,
        points: None,
        cache,
        light_edges: None,
    }
}

/// The records of full paths, as many as the image has camera paths.
fn records(pass: &CameraPass) -> Vec<SuffixRecord> {
    let mut paths = CameraPaths::default();
    paths.suffixes = Some(SuffixRecorder::default());
    let (mut all, mut first) = (Vec::new(), 0);
    let mut ids = subject::ids(pass.settings);
    // There are no photons.
    let (map, mut output) = (PhotonMap::default(), MergeOutput::default());
    let merge = Merge::new(&map, 2, MergeKernel::disc(1.0), MergeOptions::default());
    loop {
        paths.clear();
        paths.trace(pass, ids.by_ref().take(CameraPaths::BATCH));
        if paths.direct.is_empty() {
            return all;
        }
        let own = |own: SuffixRecord| SuffixRecord { path: own.path + first, ..own };
        all.extend(paths.end_suffixes((&merge, 1.0), &mut output).into_iter().map(own));
        first += paths.direct.len() as u32;
    }
}

/// Looks up all records. Returns how many are found.
fn find_all(cache: &SuffixCache, records: &[SuffixRecord]) -> usize {
    let find = |own: &&SuffixRecord| cache.find(own.at, own.distance).is_some();
    records.iter().filter(find).count()
}

fn cache(criterion: &mut Criterion) {
    let (scene, settings) = scene();
    let settings = Settings { strategy: Strategy::Gather, merge_vertex: 2, ..settings };
    let accel = build(Backend::Embree, &scene).unwrap();
    let records = records(&pass(&scene, &accel, &settings, None));
    let cache = SuffixCache::new(&records, scene.bounds(), settings.radius);
    let mut group = criterion.benchmark_group("cache");
    group.throughput(Throughput::Elements(records.len() as u64));
    group.bench_function("look-up", |bencher| bencher.iter(|| find_all(&cache, &records)));
    group.bench_function("build", |bencher| {
        bencher.iter(|| SuffixCache::new(&records, scene.bounds(), settings.radius));
    });
    group.finish();
    if !measures() {
        return;
    }
    // One record for each path that a look-up ends: the first that is found.
    let mut ended = vec![false; settings.pixels() * settings.camera_paths as usize];
    let mut first = records.clone();
    first.retain(|own| {
        let is_found = cache.find(own.at, own.distance).is_some();
        let ended = &mut ended[own.path as usize];
        let is_first = is_found && !*ended;
        *ended |= is_found;
        is_first
    });
    let pass = pass(&scene, &accel, &settings, Some(&cache));
    let mut paths = CameraPaths::default();
    let share = Ratio::new(
        || timed(|| find_all(&cache, &first)),
        || timed(|| camera_phase(&pass, &mut paths, |_| {})),
    );
    println!("time of {} look-ups over that of the camera paths: {share}", first.len());
}

criterion_group!(benches, cache);
criterion_main!(benches);
