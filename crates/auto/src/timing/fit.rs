//! The five coefficients of a [`TimeModel`] from measured times of the phases.
//!
//! Each phase is fitted by itself (docs/explanation/theory.md, section 19), with `S` for the camera
//! paths of the whole image:
//!
//! | phase | time of an iteration |
//! |---|---|
//! | light | `o_l + light_path N_F` |
//! | camera | `o_c + camera_path S` |
//! | merge | `o_m + look_up S + merge_pair N_F S` |
//! | rest | `o_r + r_l N_F + r_c S + r_p N_F S` |
//!
//! `fixed` is the sum of the four `o`. In the rest, threads wait for the one that builds the photon
//! map or renders the last tile. This time grows with the counts: `r_l`, `r_c`, `r_p` are added to
//! `light_path`, `camera_path`, `merge_pair`, so that the model's sum is wall-clock time.
//!
//! No coefficient is negative. If the measured sizes do not distinguish some terms, the term of the
//! highest order takes all of their time, see [`Timings::notes`].

use super::least_squares::{independent, least_squares};
use super::measure::{Phase, TimeSample};
use super::{COEFFICIENTS, TimeModel, Timings};
use bdpm_core::base::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// Refinements of the weights: the iteration's time hardly changes after the first.
const ROUNDS: usize = 3;

/// Resolution of the clock, seconds.
const CLOCK: f64 = 1e-9;

/// Standard errors of a model's coefficients, in their units; `None` if there are too few samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeErrors {
    /// Standard error of [`TimeModel::fixed`].
    pub fixed: Option<f64>,
    /// Standard error of [`TimeModel::light_path`].
    pub light_path: Option<f64>,
    /// Standard error of [`TimeModel::camera_path`].
    pub camera_path: Option<f64>,
    /// Standard error of [`TimeModel::look_up`].
    pub look_up: Option<f64>,
    /// Standard error of [`TimeModel::merge_pair`].
    pub merge_pair: Option<f64>,
}

impl TimeErrors {
    /// The errors in the order of [`TimeModel::seconds`].
    pub(super) fn seconds(&self) -> [Option<f64>; 5] {
        [self.fixed, self.light_path, self.camera_path, self.look_up, self.merge_pair]
    }
}

/// A measured time beside the fitted one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FittedTime {
    /// The phase.
    pub phase: Phase,
    /// `N_F`.
    pub light_paths: f64,
    /// `N_B`, per pixel.
    pub camera_paths: f64,
    /// Seconds per iteration.
    pub measured: f64,
    /// Standard error of `measured`, seconds.
    pub error: Option<f64>,
    /// Seconds per iteration by the phase's own fit.
    pub fitted: f64,
}

/// A quantity that a phase's time may be proportional to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Term {
    One,
    LightPaths,
    CameraPaths,
    Pairs,
}

impl Term {
    fn of(self, sample: &TimeSample, pixels: f64) -> f64 {
        match self {
            Self::One => 1.0,
            Self::LightPaths => sample.light_paths,
            Self::CameraPaths => pixels * sample.camera_paths,
            Self::Pairs => sample.light_paths * pixels * sample.camera_paths,
        }
    }

    /// Index of the coefficient of the model, in the order of [`TimeModel::seconds`], that this
    /// term of a phase adds to.
    fn coefficient(self, phase: Phase) -> usize {
        match (self, phase) {
            (Self::One, _) => 0,
            (Self::LightPaths, _) => 1,
            (Self::CameraPaths, Phase::Merge) => 3,
            (Self::CameraPaths, _) => 2,
            (Self::Pairs, _) => 4,
        }
    }

    /// The terms of a phase. Of those that the sizes do not distinguish, the first one stays.
    fn all_of(phase: Phase) -> &'static [Self] {
        match phase {
            Phase::Light => &[Self::LightPaths, Self::One],
            Phase::Camera => &[Self::CameraPaths, Self::One],
            Phase::Merge => &[Self::Pairs, Self::CameraPaths, Self::One],
            Phase::Rest => &[Self::One, Self::LightPaths, Self::CameraPaths, Self::Pairs],
        }
    }
}

/// A term of one phase with its coefficient, and the variance of that where it is known.
type FittedTerm = (Term, f64, Option<f64>);

/// Fits samples of an image of `pixels` pixels, in any order. The light, camera and merge phases
/// need one sample each at least; for errors, one more size than the phase has coefficients, or
/// samples with errors. A few iterations of a render are enough. With two numbers of light paths
/// and a single one of camera paths, the camera phase is taken as proportional to its paths.
///
/// Residuals are weighted by their variance. It is the sum of the sample's own variance and that of
/// a deviation of the model. The deviation is relative to the whole iteration's time at the
/// sample's counts, because predictions need that time: the times of light paths matter where they
/// are many. It is common to the samples of a phase, and as large as it takes for the residuals to
/// have the expected size (Mandel and Paule, 1970). So a model that does not follow the measured
/// times has large errors.
///
/// # Errors
/// If samples are missing, or are not times.
pub fn fit(samples: &[TimeSample], pixels: f64) -> Result<Timings> {
    samples.iter().try_for_each(check)?;
    for phase in [Phase::Light, Phase::Camera, Phase::Merge] {
        if samples.iter().all(|sample| sample.phase != phase) {
            return Err(Error::new(
                format!("no time of the {} phase was measured", phase.name()),
                "measure the light, camera and merge phases",
            ));
        }
    }
    // The iteration's time is that of the model of the round before; at first the phase's own.
    let mut fit = fit_phases(samples, pixels, |sample| sample.seconds);
    for _ in 0..ROUNDS {
        let model = fit.model;
        fit = fit_phases(samples, pixels, |s| model.iteration(s.light_paths, s.camera_paths));
    }
    fit.model.validate()?;
    Ok(fit)
}

/// Fits all phases; deviations are relative to `scale`, seconds.
fn fit_phases(samples: &[TimeSample], pixels: f64, scale: impl Fn(&TimeSample) -> f64) -> Timings {
    let (mut points, mut notes) = (Vec::new(), Vec::new());
    let (mut seconds, mut variances) = ([0.0; 5], [Some(0.0); 5]);
    for phase in Phase::ALL {
        let own: Vec<TimeSample> = samples.iter().filter(|s| s.phase == phase).copied().collect();
        let scales: Vec<f64> = own.iter().map(|sample| scale(sample).max(CLOCK)).collect();
        let (parts, note) = fit_phase(phase, &own, &scales, pixels);
        notes.extend(note);
        points.extend(own.iter().map(|sample| {
            let TimeSample { phase, light_paths, camera_paths, seconds: measured, error } = *sample;
            let fitted = parts.iter().map(|(term, own, _)| own * term.of(sample, pixels)).sum();
            FittedTime { phase, light_paths, camera_paths, measured, error, fitted }
        }));
        for (term, own, variance) in &parts {
            let index = term.coefficient(phase);
            seconds[index] += own;
            variances[index] = variances[index].zip(*variance).map(|(sum, own)| sum + own);
        }
    }
    let [fixed, light_path, camera_path, look_up, merge_pair] =
        variances.map(|variance: Option<f64>| variance.map(f64::sqrt));
    let errors = TimeErrors { fixed, light_path, camera_path, look_up, merge_pair };
    let model = TimeModel::new(seconds, pixels);
    Timings { model, errors: Some(errors), points, notes, setup: None }
}

/// Refuses numbers that cannot be measured times.
fn check(sample: &TimeSample) -> Result<()> {
    let TimeSample { phase, light_paths, camera_paths, seconds, error } = *sample;
    // Written so that NaN fails.
    let time = |x: f64| x >= 0.0 && x.is_finite();
    let count = |x: f64| x >= 1.0 && x.is_finite();
    if time(seconds) && time(error.unwrap_or(0.0)) && count(light_paths) && count(camera_paths) {
        return Ok(());
    }
    Err(Error::new(
        format!(
            "a time of the {} phase is {seconds} +- {} s at {light_paths} light paths and \
             {camera_paths} camera paths",
            phase.name(),
            error.unwrap_or(0.0)
        ),
        "measure again: times and their errors are at least 0, counts at least 1",
    ))
}

/// Fits one phase. The text names coefficients that had to be left out.
fn fit_phase(
    phase: Phase,
    samples: &[TimeSample],
    scales: &[f64],
    pixels: f64,
) -> (Vec<FittedTerm>, Option<String>) {
    let terms = Term::all_of(phase);
    let column = |term: Term| samples.iter().map(|s| term.of(s, pixels)).collect();
    let columns: Vec<Vec<f64>> = terms.iter().map(|&term| column(term)).collect();
    let kept = independent(&columns);
    let used: Vec<&[f64]> = kept.iter().map(|&index| &columns[index][..]).collect();
    let solution = least_squares(&used, samples, scales);

    let variance = |place: usize| solution.variances.as_ref().map(|all| all[place]);
    let of =
        |(place, &index): (usize, &usize)| (terms[index], solution.values[place], variance(place));
    let mut parts: Vec<FittedTerm> = kept.iter().enumerate().map(of).collect();
    let left: Vec<usize> = (0..terms.len()).filter(|index| !kept.contains(index)).collect();
    // The rest may leave terms out: their time belongs to `fixed`.
    if left.is_empty() || phase == Phase::Rest {
        return (parts, None);
    }
    // The time of a term that is left out is in another one: its value is unknown, not 0.
    parts.extend(left.iter().map(|&index| (terms[index], 0.0, None)));
    let names = |indices: &[usize]| {
        let names = indices.iter().map(|&index| COEFFICIENTS[terms[index].coefficient(phase)]);
        names.collect::<Vec<_>>().join(" and ")
    };
    let note = format!(
        "the sizes of the {} phase do not distinguish {} from {}",
        phase.name(),
        names(&left),
        names(&kept)
    );
    (parts, Some(note))
}
