//! The fit of the time model: known coefficients come back, and its errors are what they say.

use bdpm::paper::implied;
use bdpm::timing::fit::fit;
use bdpm::timing::measure::{Phase, TimeSample};
use bdpm::timing::{TimeModel, Timings};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

const TRUTH: TimeModel = TimeModel {
    fixed: 8e-3,
    light_path: 3e-7,
    camera_path: 2e-7,
    look_up: 2e-8,
    merge_pair: 8e-13,
    pixels: 262_144.0,
};

const COUNTS: [(f64, f64); 8] = [
    (1e3, 1.0),
    (1e4, 1.0),
    (1e5, 1.0),
    (1e6, 1.0),
    (1e3, 2.0),
    (1e3, 4.0),
    (1e4, 4.0),
    (1e5, 4.0),
];

/// The true time of a phase: `fixed` in four parts; of the light paths, a third is waited for.
fn seconds(phase: Phase, light_paths: f64, camera_paths: f64) -> f64 {
    let camera = TRUTH.pixels * camera_paths;
    let fixed = 0.25 * TRUTH.fixed;
    match phase {
        Phase::Light => fixed + TRUTH.light_path * 2.0 / 3.0 * light_paths,
        Phase::Camera => fixed + TRUTH.camera_path * camera,
        Phase::Merge => fixed + (TRUTH.look_up + TRUTH.merge_pair * light_paths) * camera,
        Phase::Rest => fixed + TRUTH.light_path / 3.0 * light_paths,
    }
}

/// True times at all these counts, `change`d.
fn samples(
    counts: &[(f64, f64)],
    mut change: impl FnMut(f64) -> (f64, Option<f64>),
) -> Vec<TimeSample> {
    samples_of_iterations(counts, |seconds, _| change(seconds))
}

/// Samples at `counts`; `change` also gets the time of the whole iteration.
fn samples_of_iterations(
    counts: &[(f64, f64)],
    mut change: impl FnMut(f64, f64) -> (f64, Option<f64>),
) -> Vec<TimeSample> {
    let mut samples = Vec::new();
    for phase in Phase::ALL {
        for &(light_paths, camera_paths) in counts {
            let iteration = TRUTH.iteration(light_paths, camera_paths);
            let (seconds, error) = change(seconds(phase, light_paths, camera_paths), iteration);
            samples.push(TimeSample { phase, light_paths, camera_paths, seconds, error });
        }
    }
    samples
}

/// Name, value and standard error of the coefficients.
fn coefficients(fit: &Timings) -> [(&'static str, f64, Option<f64>); 5] {
    let (model, errors) = (&fit.model, fit.errors.unwrap());
    [
        ("fixed", model.fixed, errors.fixed),
        ("light_path", model.light_path, errors.light_path),
        ("camera_path", model.camera_path, errors.camera_path),
        ("look_up", model.look_up, errors.look_up),
        ("merge_pair", model.merge_pair, errors.merge_pair),
    ]
}

fn truth() -> [f64; 5] {
    let TimeModel { fixed, light_path, camera_path, look_up, merge_pair, .. } = TRUTH;
    [fixed, light_path, camera_path, look_up, merge_pair]
}

#[test]
fn exact_times_give_the_exact_model() {
    for error in [None, Some(0.0), Some(1e-3)] {
        let fit = fit(&samples(&COUNTS, |t| (t, error)), TRUTH.pixels).unwrap();
        for ((name, value, error), truth) in coefficients(&fit).into_iter().zip(truth()) {
            assert!((value / truth - 1.0).abs() < 1e-6, "{name}: {value} {truth}");
            assert!(error.unwrap().is_finite(), "{name}");
        }
        assert!(fit.notes.is_empty());
        assert_eq!(fit.points.len(), 32);
        for point in &fit.points {
            assert!((point.fitted / point.measured - 1.0).abs() < 1e-5, "{point:?}");
        }
    }
}

/// Normal deviates of variance 1.
struct Normal(Xoshiro128PlusPlus);

impl Normal {
    fn next(&mut self) -> f64 {
        let mut uniform = || (f64::from(self.0.next_u32()) + 0.5) / 2f64.powi(32);
        let (radius, angle) = ((-2.0 * uniform().ln()).sqrt(), std::f64::consts::TAU * uniform());
        radius * angle.cos()
    }
}

/// Mean and mean square of the deviations of all coefficients over their errors, over many seeds.
fn deviations(mut noisy: impl FnMut(f64, f64, &mut Normal) -> (f64, Option<f64>)) -> [[f64; 2]; 5] {
    const SEEDS: u64 = 1000;
    let mut sums = [[0.0; 2]; 5];
    for seed in 0..SEEDS {
        let mut normal = Normal(Xoshiro128PlusPlus::seed_from_u64(seed));
        let samples = samples_of_iterations(&COUNTS, |t, tau| noisy(t, tau, &mut normal));
        let fit = fit(&samples, TRUTH.pixels).unwrap();
        for (sum, ((_, value, error), truth)) in
            sums.iter_mut().zip(coefficients(&fit).into_iter().zip(truth()))
        {
            let z = (value - truth) / error.unwrap();
            sum[0] += z / SEEDS as f64;
            sum[1] += z * z / SEEDS as f64;
        }
    }
    println!("{sums:.3?}");
    sums
}

#[test]
fn noisy_times_deviate_by_their_reported_errors() {
    // Two percent of each time, known as Criterion reports it.
    for [mean, square] in deviations(|t, _, normal| {
        let error = 0.02 * t;
        (t + error * normal.next(), Some(error))
    }) {
        // Terms of the rest that are truly 0 come out above it: a little off the mean.
        assert!(mean.abs() < 0.25 && (0.7..1.15).contains(&square), "{mean} {square}");
    }
    // Far more than known, as of a model that bends away: the few residuals tell. Errors do not
    // know of the bounds, which makes them rather too large.
    for [mean, square] in
        deviations(|t, tau, normal| ((t + 5e-3 * tau * normal.next()).max(0.0), Some(1e-4 * t)))
    {
        assert!(mean.abs() < 0.5 && (0.4..2.2).contains(&square), "{mean} {square}");
    }
}

#[test]
fn coefficients_that_sizes_do_not_determine_are_noted() {
    // As in a render's pilot: two numbers of light paths, one of camera paths, one iteration each.
    let pilot = fit(&samples(&[(1e4, 4.0), (1e5, 4.0)], |t| (t, None)), TRUTH.pixels).unwrap();
    let [_, light, camera, look_up, pair] = coefficients(&pilot).map(|(_, value, _)| value);
    let camera_paths = 4.0 * TRUTH.pixels;
    let near = |value: f64, truth: f64| assert!((value / truth - 1.0).abs() < 1e-6, "{value}");
    near(light, TRUTH.light_path);
    near(pair, TRUTH.merge_pair);
    near(camera, TRUTH.camera_path + 0.25 * TRUTH.fixed / camera_paths);
    near(look_up, TRUTH.look_up + 0.25 * TRUTH.fixed / camera_paths);
    // At the measured counts and between, the time is right.
    for n in [1e4, 5e4, 1e5] {
        near(pilot.model.iteration(n, 4.0), TRUTH.iteration(n, 4.0));
    }
    assert_eq!(pilot.errors.unwrap().fixed, None);
    assert_eq!(
        pilot.notes,
        [
            "the sizes of the camera phase do not distinguish fixed from camera_path",
            "the sizes of the merge phase do not distinguish fixed from merge_pair and look_up",
        ]
    );
    // A single size: everything is proportional.
    let single = fit(&samples(&[(1e4, 4.0)], |t| (t, Some(1e-3))), TRUTH.pixels).unwrap();
    let model = single.model;
    assert_eq!((model.look_up, single.errors.unwrap().look_up, single.notes.len()), (0.0, None, 3));
    near(model.light_path * 1e4, seconds(Phase::Light, 1e4, 4.0));
    near(model.merge_pair * 1e4 * camera_paths, seconds(Phase::Merge, 1e4, 4.0));
    near(model.iteration(1e4, 4.0), TRUTH.iteration(1e4, 4.0));
    // One size given twice does not count as two sizes.
    let twice = fit(&samples(&[(1e4, 4.0); 2], |t| (t, None)), TRUTH.pixels).unwrap();
    assert_eq!(twice.notes, single.notes);
}

#[test]
fn no_coefficient_is_negative() {
    // Times that fall with the counts, as those of a machine that gets faster.
    let mut falling = samples(&COUNTS, |t| (t, Some(0.1 * t)));
    falling.iter_mut().for_each(|s| s.seconds = 1e-2 / s.light_paths / s.camera_paths);
    let fit = fit(&falling, TRUTH.pixels).unwrap();
    fit.model.validate().unwrap();
    assert_eq!((fit.model.light_path, fit.model.merge_pair), (0.0, 0.0));
    assert!(fit.model.fixed > 0.0);
}

#[test]
fn invalid_measurements_are_refused() {
    let good = samples(&COUNTS, |t| (t, None));
    let refused = |samples: &[TimeSample], expected: &str| {
        let shown = fit(samples, TRUTH.pixels).unwrap_err().to_string();
        assert!(shown.contains(expected) && shown.contains("\nhelp: measure"), "{shown}");
    };
    refused(&[], "no time of the light phase");
    refused(&good[..8], "no time of the camera phase");
    fit(&good[..24], TRUTH.pixels).expect("the rest may be unknown");
    for (change, expected) in [
        ((|s| s.seconds = f64::NAN) as fn(&mut TimeSample), "phase is NaN"),
        (|s| s.seconds = -1.0, "phase is -1"),
        (|s| s.error = Some(f64::INFINITY), "+- inf s"),
        (|s| s.light_paths = 0.0, "at 0 light paths"),
        (|s| s.camera_paths = 0.0, "and 0 camera paths"),
    ] {
        let mut bad = good.clone();
        change(&mut bad[9]);
        refused(&bad, expected);
    }
    let shown = fit(&samples(&COUNTS, |_| (0.0, None)), 1.0).unwrap_err().to_string();
    assert!(shown.contains("all timings are 0"), "{shown}");
}

#[test]
fn the_papers_times_give_the_papers_model() {
    let fit = fit(&implied::times(), 1.0).unwrap();
    for ((name, value, error), (published, tolerance)) in coefficients(&fit).into_iter().zip([
        (0.0, 1e-9),
        (5.67e-7, 1e-8),
        (6.0 / 25.0, 1e-4),
        (0.2 / 25.0, 4e-4),
        (5.03e-5 / 25.0, 1e-8),
    ]) {
        println!("{name}: {value:e} +- {error:?}, {published:e}");
        assert!((value - published).abs() < tolerance, "{name}: {value} {published}");
    }
    for (n, tau) in [(1e3, 6.25), (3e3, 6.35), (1e4, 6.71), (3e4, 7.73), (1e5, 11.29), (3e5, 21.46)]
    {
        let found = fit.model.iteration(n, 25.0);
        assert!((found / tau - 1.0).abs() < 3e-3, "{n}: {found} {tau}");
    }
}
