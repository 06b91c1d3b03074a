//! Times as tables: the coefficients, and the residuals of their fit.

use super::file::Timings;
use super::fit::TimeErrors;
use std::fmt::Write;

/// All tables.
pub fn text(timings: &Timings) -> String {
    let (points, coefficients) = (points(timings), coefficients(timings));
    let setup = timings.setup.iter().fold(String::new(), |_, setup| format!("{setup}\n\n"));
    format!("{setup}{points}\n{coefficients}")
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
