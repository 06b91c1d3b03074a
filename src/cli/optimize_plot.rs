//! The paper's Figure 4: RMS after a time against the number of light paths, as SVG.

use super::human_time;
use bdpm::adaptive::optimize::Problem;
use bdpm::adaptive::optimize::measured::Budget;
use bdpm::base::atomic::write_atomically;
use bdpm::base::error::{Error, Result};
use bdpm::report::noise_plot::{NoisePlot, rms_label};
use std::ops::RangeInclusive;
use std::path::Path;

/// Numbers of camera paths per pixel that have a curve, besides the best one.
const CAMERA_PATHS: [u32; 4] = [1, 5, 25, 100];

/// Light paths at both ends over the best number.
const SPREAD: f64 = 50.0;

/// Top of the plot over the least RMS.
const HEIGHT: f64 = 3.5;

/// Writes the plot. An unbounded budget is shown as one second of rendering.
pub fn plot(
    path: &Path,
    problem: &Problem,
    light_paths: &RangeInclusive<u32>,
    budget: Budget,
) -> Result<()> {
    let best = problem.uniform();
    let time = match budget {
        Budget::Unbounded => 1.0,
        Budget::Time(time) => time,
        Budget::Rms(rms) => best.cost / (rms * rms),
    };
    let best_rms = (best.cost / time).sqrt();
    let no_noise = || Error::new("there is no noise to plot", "leave out the plot").at(path);
    if !(best_rms > 0.0 && best_rms.is_finite()) {
        return Err(no_noise());
    }
    let center = f64::from(best.light_paths);
    let left = (center / SPREAD).max(f64::from(*light_paths.start()));
    let right = (center * SPREAD).min(f64::from(*light_paths.end())).max(2.0 * left);
    let mut camera_paths = CAMERA_PATHS.to_vec();
    if !camera_paths.contains(&best.camera_paths) {
        camera_paths.push(best.camera_paths);
        camera_paths.sort_unstable();
    }
    let label = format!(
        "minimum {}: N_F = {}, N_B = {}",
        rms_label(best_rms, 0.1 * best_rms),
        best.light_paths,
        best.camera_paths
    );
    let shown = if time < 1.0 { format!("{time:.2e} s") } else { human_time(time) };
    let plot = NoisePlot {
        alt: "Noise against the number of light paths",
        rms_name: &format!("RMS after {shown}, W/(m² sr)"),
        rms: &|n, m| (problem.evaluate_uniform((n as u32).max(1), m).cost / time).sqrt(),
        camera_paths: &camera_paths,
        curves: &camera_paths,
        points: &[],
        minimum: (center, best.camera_paths, label),
        light_paths: [left, right],
        limits: [0.9 * best_rms, HEIGHT * best_rms],
    };
    let svg = plot.svg().ok_or_else(no_noise)?.into_string();
    write_atomically(path, |file| file.write_all(svg.as_bytes()))
}
