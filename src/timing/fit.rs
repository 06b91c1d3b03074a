//! The five coefficients of a [`TimeModel`] from measured times of the phases.
//!
//! Each phase is fitted by itself, with `S` for the camera paths of the whole image:
//!
//! | phase | time of an iteration |
//! |---|---|
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
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

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
    const COUNT: usize = 4;

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
    values: [f64; Term::COUNT],
    variances: [Option<f64>; Term::COUNT],
}

/// Fits samples of an image of so many pixels, in any order. The light, camera and merge phases need
/// one each at least, and the errors at least one more size than the phase has coefficients, or
/// samples with errors. What [`Recorder::samples`](super::sample::Recorder::samples) of a few
/// iterations of a render returns will do: with two numbers of light paths and a single one of camera
/// paths, the camera phase is taken as proportional to its paths.
///
/// Residuals are weighted by their variance, which is that of the sample plus that of a relative
/// deviation common to the phase; the latter is just so large that residuals are as large as they
/// should be (Mandel and Paule, 1970). Thus a model that is off by a few percent counts small times as
/// much as large ones, and says so in its errors.
///
/// # Errors
/// If samples are missing, or are no times.
pub fn fit(samples: &[Sample], pixels: f64) -> Result<Fit> {
    samples.iter().try_for_each(check)?;
    let mut points = Vec::new();
    let mut notes = Vec::new();
    let mut phases = Vec::new();
    for phase in Phase::ALL {
        let own: Vec<Sample> = samples.iter().filter(|s| s.phase == phase).copied().collect();
        if own.is_empty() && phase != Phase::Rest {
            return Err(Error::new(
                format!("no time of the {} phase was measured", phase.name()),
                "measure the light, camera and merge phases",
            ));
        }
        let (fit, note) = fit_phase(phase, &own, pixels);
        notes.extend(note);
        points.extend(own.iter().map(|sample| {
            let terms = [Term::One, Term::LightPaths, Term::CameraPaths, Term::Pairs];
            let fitted = terms.map(|term| fit.values[term as usize] * term.of(sample, pixels));
            let Sample { phase, light_paths, camera_paths, seconds: measured, error } = *sample;
            let fitted = fitted.into_iter().sum();
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
    let (fixed, fixed_error) = all(Term::One, &Phase::ALL);
    let (light_path, light_path_error) = all(Term::LightPaths, &[Phase::Light, Phase::Rest]);
    let (camera_path, camera_path_error) = all(Term::CameraPaths, &[Phase::Camera, Phase::Rest]);
    let (look_up, look_up_error) = all(Term::CameraPaths, &[Phase::Merge]);
    let (merge_pair, merge_pair_error) = all(Term::Pairs, &[Phase::Merge, Phase::Rest]);
    let model = TimeModel { fixed, light_path, camera_path, look_up, merge_pair, pixels };
    model.validate()?;
    let errors = TimeErrors {
        fixed: fixed_error,
        light_path: light_path_error,
        camera_path: camera_path_error,
        look_up: look_up_error,
        merge_pair: merge_pair_error,
    };
    Ok(Fit { model, errors, points, notes })
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
fn fit_phase(phase: Phase, samples: &[Sample], pixels: f64) -> (PhaseFit, Option<String>) {
    let terms = Term::all_of(phase);
    let column = |term: Term| samples.iter().map(|s| term.of(s, pixels)).collect();
    let columns: Vec<Vec<f64>> = terms.iter().map(|&term| column(term)).collect();
    let kept = solve::independent(&columns);
    let used: Vec<&[f64]> = kept.iter().map(|&index| &columns[index][..]).collect();
    let solution = solve::fit(&used, samples);

    // A term that is left out is part of another one: its share is not known to be 0, only merged.
    let mut fit = PhaseFit { values: [0.0; 4], variances: [Some(0.0); 4] };
    for (place, &index) in kept.iter().enumerate() {
        let term = terms[index] as usize;
        fit.values[term] = solution.values[place];
        fit.variances[term] = solution.variances.as_ref().map(|all| all[place]);
    }
    let names = |left: bool| {
        let mut names = (0..terms.len()).filter(|i| kept.contains(i) != left);
        let first = names.next().map(|i| terms[i].coefficient(phase).to_owned());
        names.fold(first, |all, i| {
            all.map(|all| format!("{all} and {}", terms[i].coefficient(phase)))
        })
    };
    // What the rest does not tell by itself belongs to `fixed`, as it should.
    let note = names(true).filter(|_| phase != Phase::Rest).map(|left| {
        for (index, term) in terms.iter().enumerate() {
            if !kept.contains(&index) {
                fit.variances[*term as usize] = None;
            }
        }
        let kept = names(false).unwrap_or_default();
        format!("the sizes of the {} phase do not tell {left} from {kept}", phase.name())
    });
    (fit, note)
}
