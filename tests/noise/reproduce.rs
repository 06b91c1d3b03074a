//! The paper's experiment: stopping and going on, and what its numbers are in a longer run.

use bdpm::Renderer;
use bdpm::accel::Intersect;
use bdpm::load::{Loaded, load};
use bdpm::noise::Measure;
use bdpm::noise::image::NoiseImage;
use bdpm::noise::region;
use bdpm::paper::folder::{Conditions, Experiment, Folder};
use bdpm::paper::measurement::{Measurement, Purpose};
use bdpm::paper::published::{CAMERA_PATHS, FIGURE_3, LIGHT_PATHS};
use bdpm::paper::results::Results;
use bdpm::paper::run::{Run, SceneContext};
use bdpm::paper::terms::{Terms, share};
use bdpm::render::RenderConfig;
use bdpm::scene::Scene;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::provenance::Provenance;
use bdpm::settings::{Kernel, PartialSettings, Settings};
use bdpm::timing::setup::MeasurementSetup;
use std::fs;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

fn loaded(side: u32) -> (Arc<Scene>, Arc<dyn Intersect>, Settings) {
    let Loaded { scene, defaults, .. } = load("scenes/cornell-box").unwrap();
    let kernel = Some(Kernel::Disc);
    let wishes = PartialSettings { resolution: Some([side, side]), kernel, ..Default::default() };
    let settings = Settings::resolve(&wishes, &defaults, scene.size()).unwrap();
    let settings = Settings { caustic_radius: settings.radius, ..settings };
    let accel = build(Backend::default(), &scene).unwrap();
    (scene, accel, settings)
}

fn box_filter() -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap()
}

/// An experiment without a time budget takes the fewest iterations, whatever the machine.
fn conditions(scene: &Arc<Scene>, settings: &Settings) -> Conditions {
    let origin = Provenance {
        version: "1".into(),
        scene: scene.name.clone(),
        fingerprint: scene.fingerprint(),
        backend: Backend::default().name().into(),
        settings: settings.clone(),
    };
    Conditions {
        setup: MeasurementSetup::new(&origin, 2),
        accel: "some".into(),
        settings: settings.clone(),
        region: region::find(Some("side-walls"), &scene.regions).unwrap(),
        time: 0.0,
    }
}

/// Runs in `folder`, stopping after every `stop` iterations.
fn run(path: &Path, stop: usize) -> (Experiment, usize) {
    let (scene, accel, settings) = loaded(8);
    let threads = box_filter();
    let context = SceneContext { scene: &scene, accel: &accel, threads: &threads };
    for starts in 1.. {
        let folder = Folder::new(path).unwrap();
        let experiment = folder.open(conditions(&scene, &settings)).unwrap();
        let mut run = Run::new(context, folder, experiment);
        let mut iterations = 0;
        let complete = run.run(|_| {
            iterations += 1;
            if iterations == stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        if complete.unwrap() {
            return (run.experiment().clone(), starts);
        }
    }
    unreachable!()
}

#[test]
fn stopped_experiment_continues_with_equal_results() {
    let [whole, pieces] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let (expected, _) = run(whole.path(), usize::MAX);
    // Cells begin again; the longest takes 48 iterations.
    let (found, starts) = run(pieces.path(), 50);
    assert!(starts > 20, "{starts}");
    assert_eq!(found.done.len(), Measurement::all().len());
    for (found, expected) in found.done.iter().zip(&expected.done) {
        assert_eq!(found.measurement, expected.measurement);
        assert_eq!(found.iterations, 32);
        assert_eq!(found.pooled_rms, expected.pooled_rms, "{}", found.measurement.name());
        assert_eq!(found.mean_rms, expected.mean_rms);
        assert_eq!(found.times.is_empty(), found.measurement.purpose != Purpose::Cell);
    }
    let folders = [whole.path(), pieces.path()].map(|path| Folder::new(path).unwrap());
    for part in &Measurement::all()[..3] {
        let [a, b] = folders.each_ref().map(|folder| folder.load_noise(part).unwrap());
        assert_eq!(a, b);
    }
    assert!(!pieces.path().join("under-way.ckpt").exists());
    // The sampled noise of the two estimators is that of the same paths.
    assert_eq!(expected.done[0].pooled_rms, expected.done[1].pooled_rms);

    let results = Results::new(&folders[0], expected).unwrap();
    for row in &results.estimators {
        let error = row.difference.error.unwrap();
        assert!(row.difference.value.abs() <= 4.0 * error + 1e-12, "{row:?}");
    }
}

#[test]
fn another_experiment_is_not_continued() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, _, settings) = loaded(16);
    let files = Folder::new(folder.path()).unwrap();
    let begun = conditions(&scene, &settings);
    let experiment = files.open(begun.clone()).unwrap();
    files.save(&experiment).unwrap();
    assert_eq!(files.open(begun.clone()).unwrap(), experiment);

    let other =
        Conditions { settings: Settings { seed: 9, ..settings }, time: 60.0, ..begun.clone() };
    let shown = files.open(other).unwrap_err().to_string();
    assert!(shown.contains("its seed is 1, not 9; its time is 0.0, not 60.0"), "{shown}");
    assert!(shown.contains("experiment.json") && shown.contains("\nhelp: "), "{shown}");

    fs::write(folder.path().join("experiment.json"), "{}").unwrap();
    let shown = files.open(begun).unwrap_err().to_string();
    assert!(shown.contains("not an experiment under way: missing field"), "{shown}");
}

fn measure(n_camera: u32, seed: u64, iterations: u64) -> (NoiseImage, Vec<usize>) {
    let (scene, accel, settings) = loaded(64);
    let region = region::find(Some("side-walls"), &scene.regions).unwrap();
    let settings = Settings { light_paths: LIGHT_PATHS, camera_paths: n_camera, seed, ..settings };
    let renderer = Renderer::new(&scene, &accel, settings).unwrap();
    let mut renderer = renderer.configure(RenderConfig::with_pixel_batches()).unwrap();
    box_filter().install(|| (0..iterations).for_each(|_| drop(renderer.iterate(Measure::Pairs))));
    let noise = renderer.block().noise_image().unwrap();
    let pixels = region::pixels(&region, &noise).unwrap();
    (noise, pixels)
}

/// The shares of Figure 3a within the tolerances of the open values, and three standard errors.
#[test]
fn the_terms_have_the_published_shares() {
    let [few, many] = CAMERA_PATHS;
    let (noise, region) = measure(few, 1, 400);
    let terms = Terms::new(&noise, &region);
    let (at_many, _) = measure(many, 2, 96);
    let f = share(&at_many, &region, 2, [LIGHT_PATHS.into(), few.into()]);
    let found = [terms.shares[0], terms.shares[1], f];
    for (k, tolerance) in [0.01, 0.004, 0.003].into_iter().enumerate() {
        let published = FIGURE_3[0].roots[k] / FIGURE_3[0].total;
        let error = found[k].error.unwrap();
        println!("{k}: {:.4} +- {error:.4}, {published:.4}", found[k].value);
        assert!(error < 2.0 * tolerance, "{error}");
        assert!((found[k].value - published).abs() < tolerance + 3.0 * error, "{:?}", found[k]);
    }
    let ratio = terms.ratio;
    println!("formula over sample: {ratio:?}");
    assert!((ratio.value - 1.0).abs() < 3.0 * ratio.error.unwrap());
    // The sampled noise falls as the root of the camera paths, but for the light paths' own.
    let halved = Terms::new(&at_many, &region).sampled.value / terms.sampled.value;
    assert!((0.45..0.55).contains(&halved), "{halved}");
}
