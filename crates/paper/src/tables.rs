//! Tables 1 and 2 and the points of Figure 4: noise and times at many counts, measured one by one,
//! beside what the formula and the time model say from a single run.
//!
//! The RMS is the pooled one, `sqrt(mean_p V_p)`. The paper's mean of roots, `mean_p sqrt(V_p)`, is
//! low if it is sampled from few iterations of heavy-tailed values. The tables show by how much.

use super::folder::Measured;
use super::measurement::Purpose;
use super::published::{CAMERA_PATHS, TABLE_2, TIME};
use super::terms::{corrected, mean_rms, pooled_rms, quotient};
use bdpm_auto::adaptive::optimize::predict::Predicted;
use bdpm_auto::timing::TimeModel;
use bdpm_auto::timing::measure::Phase;
use bdpm_core::noise::image::NoiseImage;
use serde::Serialize;
use std::fmt::Write;

/// One pair of counts; luminances in W/(m^2 sr), times in seconds.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Cell {
    /// `N_F`.
    pub light_paths: u32,
    /// `N_B`.
    pub camera_paths: u32,
    /// Iterations whose noise was measured.
    pub iterations: u64,
    /// Pooled RMS of one iteration, sampled.
    pub sampled: Predicted,
    /// Pooled RMS by formula (1), from the run at the paper's counts.
    pub formula: Predicted,
    /// The paper's mean RMS, sampled and not corrected, over that by formula.
    pub mean_of_roots: Predicted,
    /// Time of an iteration, median.
    pub time: Predicted,
    /// Times of the camera, light and merge phase, and the rest.
    pub parts: [f64; 4],
    /// Time of an iteration by the time model.
    pub model_time: f64,
    /// Pooled RMS after [`TIME`], from the sampled noise and the measured time.
    pub after: Predicted,
    /// Pooled RMS after [`TIME`] by formula and time model.
    pub model_after: Predicted,
}

impl Cell {
    fn new(measured: &Measured, noise: &NoiseImage, region: &[usize], model: &TimeModel) -> Self {
        let counts = measured.measurement;
        let (n, m) = (f64::from(counts.light_paths), f64::from(counts.camera_paths));
        let of = |phase: Phase| {
            let found = measured.times.iter().find(|sample| sample.phase == phase);
            found.map_or((0.0, None), |sample| (sample.seconds, sample.error))
        };
        let phases = [Phase::Camera, Phase::Light, Phase::Merge, Phase::Rest].map(of);
        let squares: Option<f64> = phases.iter().map(|(_, error)| error.map(|e| e * e)).sum();
        let value = phases.iter().map(|(seconds, _)| seconds).sum();
        let time = Predicted { value, error: squares.map(f64::sqrt) };
        let sampled = measured.rms();
        let formula = corrected(noise.statistic(region, |pixels| pooled_rms(pixels, n, m)));
        let roots = corrected(noise.statistic(region, |pixels| mean_rms(pixels, n, m)));
        let sampled_roots = Predicted {
            value: measured.mean_rms.value,
            error: Some(measured.mean_rms.error).filter(|error| error.is_finite()),
        };
        let model_time = model.iteration(n, m);
        Self {
            light_paths: counts.light_paths,
            camera_paths: counts.camera_paths,
            iterations: measured.iterations,
            sampled,
            formula,
            mean_of_roots: quotient(sampled_roots, roots),
            time,
            parts: phases.map(|(seconds, _)| seconds),
            model_time,
            after: after(sampled, time),
            model_after: after(formula, Predicted { value: model_time, error: Some(0.0) }),
        }
    }

    /// Iterations in [`TIME`].
    pub fn iterations_in_time(&self) -> f64 {
        TIME / self.time.value
    }

    /// RMS after [`TIME`] over that of another cell by formula and time model, which are far more
    /// certain than a sample.
    pub fn over(&self, reference: &Self) -> Predicted {
        quotient(self.after, reference.model_after)
    }
}

/// RMS after [`TIME`] of iterations of the RMS `rms` and the time `time`: `sqrt(tau V / T)`.
fn after(rms: Predicted, time: Predicted) -> Predicted {
    let value = rms.value * (time.value / TIME).sqrt();
    let relative = |x: Predicted| x.error.map(|error| error / x.value);
    let error = relative(rms).zip(relative(time)).map(|(rms, time)| value * rms.hypot(0.5 * time));
    Predicted { value, error }
}

/// All measured cells.
pub fn cells(
    done: &[Measured],
    noise: &NoiseImage,
    region: &[usize],
    model: &TimeModel,
) -> Vec<Cell> {
    let cells = done.iter().filter(|measured| measured.measurement.purpose == Purpose::Cell);
    cells.map(|measured| Cell::new(measured, noise, region, model)).collect()
}

/// The cell at these counts.
pub fn find(cells: &[Cell], light_paths: u32, camera_paths: u32) -> Option<&Cell> {
    cells.iter().find(|c| (c.light_paths, c.camera_paths) == (light_paths, camera_paths))
}

/// The model's times at the counts of Table 2 beside the published ones, in seconds and over their
/// own camera time: machines differ, shapes less.
pub fn beside_table_2(model: &TimeModel) -> String {
    let n_camera = f64::from(CAMERA_PATHS[0]);
    let mut text = format!(
        "one iteration at N_B = {n_camera}, the paper's Table 2 on the left, here on \
         the right\n{:>7} | {:^51} | {:^38}\n{:>7} | {:>12} {:>12} {:>12} {:>12} | {:>12} {:>12} \
         {:>12}\n",
        "",
        "seconds",
        "over the camera time",
        "N_F",
        "camera",
        "light",
        "merge",
        "whole",
        "light",
        "merge",
        "whole",
    );
    for row in TABLE_2 {
        let (n_light, [camera, light, merge]) = (f64::from(row.light_paths), row.parts);
        let parts = model.parts(n_light, n_camera);
        let [_, here_light, here_camera, here_merge] = parts;
        let paper = [camera, light, merge, camera + light + merge];
        let here = [here_camera, here_light, here_merge, parts.iter().sum()];
        write!(text, "{n_light:>7}").expect("strings take everything");
        let mut columns = |scales: [f64; 2], first: usize| {
            text.push_str(" |");
            for (paper, here) in paper.iter().zip(here).skip(first) {
                write!(text, " {:>5.2} {:>6.3}", paper / scales[0], here / scales[1])
                    .expect("strings take everything");
            }
        };
        columns([1.0; 2], 0);
        columns([camera, here_camera], 1);
        text.push('\n');
    }
    text
}
