//! The time of an iteration, phase by phase and at several sizes each, as in the paper's Table 2.
//!
//! At its end it prints the fitted time model beside that table. `bdpm predict --timings
//! target/criterion` uses the result. Environment variables replace the defaults: `BDPM_SCENE` the
//! scene `scenes/cornell-box`, `BDPM_RESOLUTION=WxH` its resolution, `BDPM_STRATEGY=mis` or
//! `=single` its strategy, `BDPM_MERGE_VERTEX` its merge vertex, and `BDPM_THREADS` the number of
//! threads.

#![allow(missing_docs)]

mod home;

use bdpm::accel::Intersect;
use bdpm::load::load;
use bdpm::noise::Measure;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::provenance::Provenance;
use bdpm::settings::{PartialSettings, Strategy};
use bdpm::timing::Timings;
use bdpm::timing::criterion::{Entry, GROUP, Sidecar};
use bdpm::timing::measure::{Phase, SampleSize, sizes_of};
use bdpm::timing::setup::MeasurementSetup;
use bdpm::{Renderer, Result, Scene, Settings};
use criterion::{BenchmarkId, Criterion, SamplingMode, criterion_group, criterion_main};
use std::cell::Cell;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Scene, settings but for the counts, threads and backend.
struct MeasuredScene {
    scene: Arc<Scene>,
    settings: Settings,
    threads: rayon::ThreadPool,
    accel: Arc<dyn Intersect>,
    setup: MeasurementSetup,
}

impl MeasuredScene {
    fn new() -> Result<Self> {
        let variable = |name: &str| std::env::var(name).ok();
        let path = variable("BDPM_SCENE").unwrap_or_else(|| "scenes/cornell-box".into());
        let loaded = load(Path::new(&path))?;
        let resolution = variable("BDPM_RESOLUTION").map(|text| {
            let (width, height) = text.split_once('x').expect("BDPM_RESOLUTION is like 512x512");
            [width, height].map(|side| side.parse().expect("BDPM_RESOLUTION is like 512x512"))
        });
        let threads = variable("BDPM_THREADS")
            .map_or(0, |text| text.parse().expect("BDPM_THREADS is a number"));
        let threads = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let strategy = variable("BDPM_STRATEGY").map(|name| match &name[..] {
            "single" => Strategy::Single,
            "mis" => Strategy::Mis,
            _ => panic!("BDPM_STRATEGY is single or mis"),
        });
        let merge_vertex = variable("BDPM_MERGE_VERTEX")
            .map(|text| text.parse().expect("BDPM_MERGE_VERTEX is a number"));
        let wishes =
            PartialSettings { resolution, strategy, merge_vertex, ..PartialSettings::default() };
        let settings = Settings::resolve(&wishes, &loaded.defaults, loaded.scene.size())?;
        let scene = loaded.scene;
        let accel = threads.install(|| build(Backend::default(), &scene))?;
        let origin = Provenance {
            version: env!("CARGO_PKG_VERSION").into(),
            scene: scene.name.clone(),
            fingerprint: scene.fingerprint(),
            backend: Backend::default().name().into(),
            settings: settings.clone(),
        };
        let setup = MeasurementSetup::new(&origin, threads.current_num_threads());
        Ok(Self { scene, settings, threads, accel, setup })
    }

    /// The benchmarks of all phases.
    fn entries(&self) -> Vec<Entry> {
        let entry = |phase: Phase, SampleSize { light_paths, camera_paths }: SampleSize| Entry {
            id: format!("{}/{light_paths}x{camera_paths}", phase.name()),
            phase,
            light_paths,
            camera_paths,
        };
        let of =
            |phase| sizes_of(phase, self.settings.pixels()).into_iter().map(move |s| (phase, s));
        Phase::ALL.into_iter().flat_map(of).map(|(phase, size)| entry(phase, size)).collect()
    }

    /// Benchmarks one phase of whole iterations of the renderer; says whether it was to run.
    fn bench(&self, criterion: &mut Criterion, entry: &Entry) -> Result<bool> {
        let Entry { phase, light_paths, camera_paths, .. } = *entry;
        let settings = Settings { light_paths, camera_paths, ..self.settings.clone() };
        let mut renderer = Renderer::new(&self.scene, &self.accel, settings)?;
        let iterations = Cell::new(0);
        let mut group = criterion.benchmark_group(GROUP);
        group.sampling_mode(SamplingMode::Flat);
        let size = format!("{light_paths}x{camera_paths}");
        group.bench_function(BenchmarkId::new(phase.name(), size), |bencher| {
            bencher.iter_custom(|count| {
                iterations.set(iterations.get() + count);
                (0..count)
                    .map(|_| {
                        let report = self.threads.install(|| renderer.iterate(Measure::Off));
                        phase.time(&report.times, self.setup.threads)
                    })
                    .sum()
            });
        });
        group.finish();
        Ok(iterations.get() > 1)
    }
}

fn tau(criterion: &mut Criterion) {
    if let Err(error) = run(criterion) {
        eprintln!("error: {error}");
        std::process::exit(1);
    }
}

fn run(criterion: &mut Criterion) -> Result<()> {
    let measured = MeasuredScene::new()?;
    let folder = home::criterion_home().join(GROUP);
    // `cargo test --benches` and `--list` measure nothing and must not mark old results as stale.
    let arguments: Vec<String> = std::env::args().collect();
    let has = |name: &str| arguments.iter().any(|argument| argument == name);
    let measures = has("--bench") && !has("--test") && !has("--list");
    let sidecar = measures
        .then(|| Sidecar::begin(&folder, measured.setup.clone(), measured.entries()))
        .transpose()?;
    let mut complete = true;
    for entry in measured.entries() {
        complete &= measured.bench(criterion, &entry)?;
    }
    match sidecar {
        Some(sidecar) if complete => {
            sidecar.complete(&folder)?;
            let timings = Timings::from_criterion(&folder)?;
            println!("\n{}\nfor bdpm predict: --timings {}", timings.text(), folder.display());
        }
        Some(_) => println!("\nnot all benchmarks ran: no time model"),
        None => {}
    }
    Ok(())
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(3));
    targets = tau
}
criterion_main!(benches);
