//! The five coefficients of a [`TimeModel`] from measured times of the phases.
//!
//! Each phase is fitted by itself, with `S` for the camera paths of the whole image:
//!
//! | phase | time of an iteration |
//! |---|---|
// theory.md, section 19
//! | light | `o_l + light_path N_F` |
//! | camera | `o_c + camera_path S` |
//! | merge | `o_m + look_up S + merge_pair N_F S` |
//! | rest | `o_r + r_l N_F + r_c S + r_p N_F S` |
//!
//! `fixed` is the sum of the four `o`. In the rest, threads wait for the one that builds the photon
//! map or renders the last tile, which grows with the counts: `r_l`, `r_c`, `r_p` are added to
//! `light_path`, `camera_path`, `merge_pair`, so that the model's sum is wall-clock time.
//!
//! No coefficient is negative. Terms that the measured sizes cannot tell apart are left to the one
//! of the highest order, see [`Fit::notes`].

use super::model::TimeModel;
use super::sample::{Phase, Sample};
use super::solve;
use crate::base::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// Refinements of the weights: the iteration's time hardly changes after the first.
const ROUNDS: usize = 3;

/// Seconds that no clock tells apart.
const CLOCK: f64 = 1e-9;

/// A fitted model, how certain it is, and how well it fits.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The coefficients.
    pub model: TimeModel,
    /// Their standard errors.
    pub errors: TimeErrors,
    /// What they were fitted to.
    pub points: Vec<Point>,
    /// Coefficients that the measured sizes could not tell apart, for people to read.
    pub notes: Vec<String>,
}

/// Standard errors of a model's coefficients, in their units; `None` where the points are too few
/// to tell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeErrors {
    /// Of [`TimeModel::fixed`].
    pub fixed: Option<f64>,
    /// Of [`TimeModel::light_path`].
    pub light_path: Option<f64>,
    /// Of [`TimeModel::camera_path`].
    pub camera_path: Option<f64>,
    /// Of [`TimeModel::look_up`].
    pub look_up: Option<f64>,
    /// Of [`TimeModel::merge_pair`].
    pub merge_pair: Option<f64>,
}

/// A measured time beside the fitted one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Point {
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
    /// What the phase's own fit says, seconds.
    pub fitted: f64,
}

/// Something that a phase's time may be proportional to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Term {
    One,
    LightPaths,
    CameraPaths,
    Pairs,
}

impl Term {
    const ALL: [Self; 4] = [Self::One, Self::LightPaths, Self::CameraPaths, Self::Pairs];

    fn of(self, sample: &Sample, pixels: f64) -> f64 {
        match self {
            Self::One => 1.0,
            Self::LightPaths => sample.light_paths,
            Self::CameraPaths => pixels * sample.camera_paths,
            Self::Pairs => sample.light_paths * pixels * sample.camera_paths,
        }
    }

    /// The coefficient of a phase that it belongs to.
    fn coefficient(self, phase: Phase) -> &'static str {
        match (self, phase) {
            (Self::One, _) => "fixed",
            (Self::LightPaths, _) => "light_path",
            (Self::CameraPaths, Phase::Merge) => "look_up",
            (Self::CameraPaths, _) => "camera_path",
            (Self::Pairs, _) => "merge_pair",
        }
    }

    /// The terms of a phase; where some cannot be told apart, the first of them stays.
    fn all_of(phase: Phase) -> &'static [Self] {
        match phase {
            Phase::Light => &[Self::LightPaths, Self::One],
            Phase::Camera => &[Self::CameraPaths, Self::One],
            Phase::Merge => &[Self::Pairs, Self::CameraPaths, Self::One],
            Phase::Rest => &[Self::One, Self::LightPaths, Self::CameraPaths, Self::Pairs],
        }
    }
}

/// The coefficients of one phase by [`Term`], and their variances where they are known.
#[derive(Clone, Copy, Debug)]
struct PhaseFit {
    values: [f64; Term::ALL.len()],
    variances: [Option<f64>; Term::ALL.len()],
}

/// Fits samples of an image of so many pixels, in any order. The light, camera and merge phases need
/// one each at least, and the errors at least one more size than the phase has coefficients, or
/// samples with errors. What [`Recorder::samples`](super::sample::Recorder::samples) of a few
/// iterations of a render returns will do: with two numbers of light paths and a single one of camera
/// paths, the camera phase is taken as proportional to its paths.
///
/// Residuals are weighted by their variance: that of the sample, and that of a deviation of the model
/// relative to the whole iteration's time at the sample's counts, which is what predictions need: the
/// times of light paths matter where they are many. The relative deviation is common to the samples of
/// a phase and just so large that their residuals are as large as they should be (Mandel and Paule,
/// 1970), so that a model that bends away from the measured times says so in its errors.
///
/// # Errors
/// If samples are missing, or are no times.
pub fn fit(samples: &[Sample], pixels: f64) -> Result<Fit> {
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
fn fit_phases(samples: &[Sample], pixels: f64, scale: impl Fn(&Sample) -> f64) -> Fit {
    let (mut points, mut notes, mut phases) = (Vec::new(), Vec::new(), Vec::new());
    for phase in Phase::ALL {
        let own: Vec<Sample> = samples.iter().filter(|s| s.phase == phase).copied().collect();
        let scales: Vec<f64> = own.iter().map(|sample| scale(sample).max(CLOCK)).collect();
        let (fit, note) = fit_phase(phase, &own, &scales, pixels);
        notes.extend(note);
        points.extend(own.iter().map(|sample| {
            let Sample { phase, light_paths, camera_paths, seconds: measured, error } = *sample;
            let part = |term: Term| fit.values[term as usize] * term.of(sample, pixels);
            let fitted = Term::ALL.map(part).into_iter().sum();
            Point { phase, light_paths, camera_paths, measured, error, fitted }
        }));
        phases.push(fit);
    }
    let all = |term: Term, of: &[Phase]| {
        let parts = of.iter().map(|&phase| &phases[phase as usize]);
        let value: f64 = parts.clone().map(|fit| fit.values[term as usize]).sum();
        let variance: Option<f64> = parts.map(|fit| fit.variances[term as usize]).sum();
        (value, variance.map(f64::sqrt))
    };
    let fixed = all(Term::One, &Phase::ALL);
    let light_path = all(Term::LightPaths, &[Phase::Light, Phase::Rest]);
    let camera_path = all(Term::CameraPaths, &[Phase::Camera, Phase::Rest]);
    let look_up = all(Term::CameraPaths, &[Phase::Merge]);
    let merge_pair = all(Term::Pairs, &[Phase::Merge, Phase::Rest]);
    let model = TimeModel {
        fixed: fixed.0,
        light_path: light_path.0,
        camera_path: camera_path.0,
        look_up: look_up.0,
        merge_pair: merge_pair.0,
        pixels,
    };
    let errors = TimeErrors {
        fixed: fixed.1,
        light_path: light_path.1,
        camera_path: camera_path.1,
        look_up: look_up.1,
        merge_pair: merge_pair.1,
    };
    Fit { model, errors, points, notes }
}

/// Refuses what is no measurement.
fn check(sample: &Sample) -> Result<()> {
    let Sample { phase, light_paths, camera_paths, seconds, error } = *sample;
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

/// Fits one phase; says which coefficients had to be left out.
fn fit_phase(
    phase: Phase,
    samples: &[Sample],
    scales: &[f64],
    pixels: f64,
) -> (PhaseFit, Option<String>) {
    let terms = Term::all_of(phase);
    let column = |term: Term| samples.iter().map(|s| term.of(s, pixels)).collect();
    let columns: Vec<Vec<f64>> = terms.iter().map(|&term| column(term)).collect();
    let kept = solve::independent(&columns);
    let used: Vec<&[f64]> = kept.iter().map(|&index| &columns[index][..]).collect();
    let solution = solve::fit(&used, samples, scales);

    // A term that is left out is part of another one: its share is not known to be 0, only merged.
    let mut fit = PhaseFit { values: [0.0; 4], variances: [Some(0.0); 4] };
    for (place, &index) in kept.iter().enumerate() {
        let term = terms[index] as usize;
        fit.values[term] = solution.values[place];
        fit.variances[term] = solution.variances.as_ref().map(|all| all[place]);
    }
    let left: Vec<Term> =
        (0..terms.len()).filter(|i| !kept.contains(i)).map(|i| terms[i]).collect();
    // What the rest does not tell by itself belongs to `fixed`, as it should.
    if left.is_empty() || phase == Phase::Rest {
        return (fit, None);
    }
    left.iter().for_each(|&term| fit.variances[term as usize] = None);
    let names = |terms: &[Term]| {
        let names: Vec<_> = terms.iter().map(|term| term.coefficient(phase)).collect();
        names.join(" and ")
    };
    let kept: Vec<Term> = kept.iter().map(|&index| terms[index]).collect();
    let note = format!(
        "the sizes of the {} phase do not tell {} from {}",
        phase.name(),
        names(&left),
        names(&kept)
    );
    (fit, Some(note))
}
