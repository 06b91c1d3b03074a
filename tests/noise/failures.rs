//! An error after the first iteration keeps the image.

use crate::common::thread_ranks::Mail;
use bdpm::adaptive::stopping::StoppedBy;
use bdpm::base::error::{Error, Result};
use bdpm::job::{PlantedFailure, Step};
use bdpm::load::Loaded;
use bdpm::settings::{PartialSettings, Strategy};
use bdpm::{Event, RenderJob, RenderResult, Stop};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

fn loaded() -> Loaded {
    bdpm::load(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box-classic")).unwrap()
}

fn job(loaded: &Loaded) -> RenderJob {
    let settings = PartialSettings { resolution: Some([40, 30]), ..Default::default() };
    RenderJob::new(loaded).settings(settings).stop(Stop::time(Duration::from_secs(2)))
}

/// Renders with a failure of a step, and returns the warnings beside the result.
fn with_failure(job: RenderJob, step: Step, iterations: u64) -> (RenderResult, Vec<String>) {
    let mut warnings = Vec::new();
    let result = job.plant_failure(PlantedFailure { step, iterations }).run(|event| {
        if let Event::Warning(warning) = event {
            warnings.push(warning);
        }
        ControlFlow::Continue(())
    });
    (result.unwrap(), warnings)
}

#[track_caller]
fn assert_has_image(result: &RenderResult) {
    let mean = result.state.image().mean_luminance();
    // Long renders have 0.165. Three iterations are within a few percent.
    assert!((mean / 0.165 - 1.0).abs() < 0.2, "{mean}");
    assert!(result.image.iter().all(|pixel| pixel.is_finite()));
    assert!(result.state.checkpoint().blocks.iter().any(|block| block.film.iterations > 0));
}

#[test]
fn failed_step_after_the_first_iteration_ends_the_render_with_the_image_so_far() {
    for step in [Step::Preparation, Step::Iteration, Step::Estimate] {
        let (result, _) = with_failure(job(&loaded()), step, 3);
        assert_eq!(result.stopped_by, StoppedBy::Failure, "{step}");
        assert!(result.state.renderer.iterations() >= 3, "{step}");
        let failure = result.failure().unwrap().to_string();
        assert!(failure.starts_with(&format!("{step} failed: planted")), "{failure}");
        assert_has_image(&result);
    }
}

#[test]
fn failed_first_iteration_is_an_error() {
    let planted = PlantedFailure { step: Step::Iteration, iterations: 0 };
    let failure = job(&loaded()).plant_failure(planted).render().err().unwrap().to_string();
    assert!(failure.starts_with("an iteration failed: planted"), "{failure}");
}

#[test]
fn time_of_zero_is_refused_with_advice() {
    let job = job(&loaded()).stop(Stop::time(Duration::ZERO));
    let shown = job.render().err().unwrap().to_string();
    let expected = "nothing can be rendered in a time of 0\nhelp: give a time above 0";
    assert!(shown.contains(expected), "{shown}");
}

#[test]
fn failed_audit_keeps_the_technique() {
    // A cache would audit itself.
    let settings = PartialSettings {
        resolution: Some([40, 30]),
        strategy: Some(Strategy::Mis),
        ..Default::default()
    };
    let job = job(&loaded()).settings(settings);
    let (result, warnings) = with_failure(job, Step::Audit, 1);
    assert_eq!(result.stopped_by, StoppedBy::Time);
    let expected = "the technique is kept: the audit failed: planted";
    assert!(warnings.iter().any(|warning| warning.starts_with(expected)), "{warnings:?}");
    assert_has_image(&result);
}

#[test]
fn raw_image_is_the_result_if_the_denoiser_fails() {
    for iterations in [1, u64::MAX] {
        let counts = PartialSettings {
            resolution: Some([40, 30]),
            light_paths: Some(2000),
            camera_paths: Some(2),
            ..Default::default()
        };
        let job = RenderJob::new(&loaded()).settings(counts).denoise(true);
        let (result, _) = with_failure(job.stop(Stop::iterations(8)), Step::Denoising, iterations);
        let failure = result.failure().map(Error::to_string);
        assert_eq!(failure.is_some(), iterations == 1, "{failure:?}");
        assert!(failure.is_none_or(|text| text.starts_with("denoising failed: planted")));
        assert_eq!(result.state.denoised().is_none(), iterations == 1);
        assert_has_image(&result);
    }
}

#[test]
fn image_is_there_if_its_error_is_not_computed() {
    let (result, _) = with_failure(job(&loaded()), Step::Result, 1);
    assert!(result.failure().unwrap().to_string().starts_with("the error of the result failed"));
    assert!(result.error.is_none() && result.stopped_by == StoppedBy::Time);
    assert_has_image(&result);
}

/// Renders as three ranks, whose jobs are those of `job`. Returns the result of each.
fn by_ranks(job: impl Fn(u32) -> RenderJob + Sync) -> (Result<RenderResult>, [Result<()>; 2]) {
    let mail = &Mail::new(3);
    let job = &job;
    thread::scope(|scope| {
        let follow = |rank| scope.spawn(move || job(rank).follow(&mail.rank(rank)));
        let others = [1, 2].map(follow);
        let result = job(0).run_on(&mail.rank(0), |_| ControlFlow::Continue(()));
        (result, others.map(|other| other.join().unwrap()))
    })
}

#[test]
fn failed_rank_leaves_the_image_of_the_others() {
    let loaded = loaded();
    let (result, others) = by_ranks(|rank| match rank {
        2 => job(&loaded).plant_failure(PlantedFailure { step: Step::Iteration, iterations: 1 }),
        _ => job(&loaded),
    });
    let result = result.unwrap();
    let failure = result.failure().unwrap().to_string();
    assert!(failure.starts_with("a rank stopped: rank 2: an iteration failed"), "{failure}");
    assert!(others.iter().all(Result::is_ok));
    assert_has_image(&result);
}

#[test]
fn ranks_end_if_the_first_one_cannot_render() {
    let loaded = loaded();
    let cannot_render = PartialSettings { light_paths: Some(0), ..Default::default() };
    let (result, others) = by_ranks(|rank| match rank {
        0 => job(&loaded).settings(cannot_render.clone()),
        _ => job(&loaded),
    });
    assert!(result.is_err() && others.iter().all(Result::is_ok));
}

#[test]
fn interrupt_before_the_first_image_ends_the_job_at_once() {
    let loaded = loaded();
    let slow = PartialSettings {
        resolution: Some([64, 64]),
        camera_paths: Some(u32::MAX),
        light_paths: Some(1000),
        ..Default::default()
    };
    for settings in [slow, PartialSettings::default()] {
        let interrupt = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&interrupt);
        // A pilot of 8 s, or one iteration of hours.
        let stop = match settings.camera_paths {
            Some(_) => Stop::iterations(1),
            None => Stop::time(Duration::from_secs(1000)),
        };
        let waiting = thread::spawn(move || {
            thread::sleep(Duration::from_millis(300));
            flag.store(true, Ordering::Relaxed);
            Instant::now()
        });
        let job = RenderJob::new(&loaded).settings(settings).stop(stop).interrupted_by(interrupt);
        let error = job.render().err().expect("no image");
        assert!(error.is_interrupt(), "{error}");
        println!("{:.2} s after the interrupt", waiting.join().unwrap().elapsed().as_secs_f64());
    }
}

/// Renders this many iterations with the best effort of the denoiser, which takes long at this
/// size on one thread. The interrupt is set after the last event, or within it.
fn denoised_until_interrupt(resolution: [u32; 2], is_earlier: bool) -> RenderResult {
    const ITERATIONS: u64 = 16;
    let settings = PartialSettings {
        resolution: Some(resolution),
        camera_paths: Some(1),
        light_paths: Some(1000),
        ..Default::default()
    };
    let interrupt = Arc::new(AtomicBool::new(false));
    let job = RenderJob::new(&loaded()).settings(settings).stop(Stop::iterations(ITERATIONS));
    let job = job.denoise(true).threads(Arc::new(bdpm::job::thread_pool(1).unwrap()));
    let result = job.interrupted_by(Arc::clone(&interrupt)).run(|event| {
        if let Event::Iterated(state) = event
            && state.renderer.iterations() == ITERATIONS
        {
            let flag = Arc::clone(&interrupt);
            let set = move || flag.store(true, Ordering::Relaxed);
            if is_earlier {
                set();
            } else {
                thread::spawn(move || {
                    thread::sleep(Duration::from_millis(500));
                    set();
                });
            }
        }
        ControlFlow::Continue(())
    });
    result.unwrap()
}

#[test]
fn interrupt_during_denoising_leaves_the_raw_image() {
    let result = denoised_until_interrupt([640, 480], false);
    assert_has_image(&result);
    assert!(result.failure().is_none());
    let denoised = result.denoised.unwrap();
    assert!(denoised.is_interrupted && denoised.is_raw, "{denoised:?}");
    assert!(result.state.denoised().is_none());
    // All runs take 10 s and more. The canceled one ends with the layer of the network that it is
    // in.
    println!("{:.2} s of denoising", denoised.seconds);
}

#[test]
fn interrupt_before_denoising_leaves_a_denoised_image() {
    let result = denoised_until_interrupt([40, 30], true);
    let denoised = result.denoised.unwrap();
    assert!(!denoised.is_interrupted && denoised.error.is_some(), "{denoised:?}");
    assert!(result.state.denoised().is_some());
}
