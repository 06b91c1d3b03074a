//! Times as tables: the coefficients, the residuals of their fit, and the published times beside.

use super::file::Timings;
use super::fit::TimeErrors;
use crate::published::{CAMERA_PATHS, TABLE_2};
use std::fmt::Write;

/// All tables.
pub fn text(timings: &Timings) -> String {
    let [points, coefficients, beside] =
        [points(timings), coefficients(timings), beside_table_2(timings)];
    let setup = timings.setup.iter().fold(String::new(), |_, setup| format!("{setup}\n\n"));
    format!("{setup}{points}\n{coefficients}\n{beside}")
}

/// The five coefficients with their standard errors, a line each.
pub fn coefficients(timings: &Timings) -> String {
    let model = &timings.model;
    let errors = timings.errors.unwrap_or_default();
    let TimeErrors { fixed, light_path, camera_path, look_up, merge_pair } = errors;
    let mut text = String::new();
    for (name, value, error, unit) in [
        ("fixed", model.fixed, fixed, "iteration"),
        ("light_path", model.light_path, light_path, "light path"),
        ("camera_path", model.camera_path, camera_path, "camera path"),
        ("look_up", model.look_up, look_up, "camera path"),
        ("merge_pair", model.merge_pair, merge_pair, "light path and camera path"),
    ] {
        let error = error.map_or(String::new(), |error| format!("+- {error:.1e}"));
        let row = format!("{name:<11} {value:>10.3e} {error:<10} s per {unit}");
        writeln!(text, "{row}").expect("strings take everything");
    }
    for note in &timings.notes {
        writeln!(text, "note: {note}").expect("strings take everything");
    }
    text
}

/// Measured times, a line each, with what the fit says; the residual also as a share of the whole
/// iteration.
fn points(timings: &Timings) -> String {
    let mut text = format!(
        "{:<7} {:>8} {:>4} {:>12}    {:<10} {:>10} {:>10} {:>13}\n",
        "phase", "N_F", "N_B", "seconds", "", "fitted", "residual", "of iteration"
    );
    for point in &timings.points {
        let error = point.error.map_or(String::new(), |error| format!("+- {error:.2e}"));
        let residual = point.measured - point.fitted;
        let iteration = timings.model.iteration(point.light_paths, point.camera_paths);
        // The time of a phase may be too small for a clock.
        let share = |whole: f64| match 100.0 * residual / whole {
            share if share.is_finite() => format!("{share:+.1} %"),
            _ => String::new(),
        };
        writeln!(
            text,
            "{:<7} {:>8} {:>4} {:>12.4e} {error:<13} {:>10.3e} {:>10} {:>13}",
            point.phase.name(),
            point.light_paths,
            point.camera_paths,
            point.measured,
            point.fitted,
            share(point.fitted),
            share(iteration),
        )
        .expect("strings take everything");
    }
    text
}

/// The model's times at the counts of Table 2 beside the published ones, in seconds and over their
/// own camera time: machines differ, shapes less.
fn beside_table_2(timings: &Timings) -> String {
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
        let parts = timings.model.parts(n_light, n_camera);
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
