//! Warns of times that their model does not fit, as on a machine that did other work meanwhile.

use bdpm::timing::Timings;
use bdpm::timing::fit::FittedTime;

/// Share of an iteration from which a residual is large. The optimum is flat, so that smaller ones
/// hardly change it.
const LARGE: f64 = 0.1;

/// Largest difference between measured and fitted time, as a share of the whole iteration: the last
/// column of the table of `bdpm calibrate`. `None` if nothing was measured.
pub fn largest_residual(timings: &Timings) -> Option<f64> {
    let share = |point: &FittedTime| {
        let iteration = timings.model.iteration(point.light_paths, point.camera_paths);
        (point.measured - point.fitted).abs() / iteration
    };
    timings.points.iter().map(share).filter(|share| share.is_finite()).reduce(f64::max)
}

/// A warning if the largest residual is large.
pub fn warning(residual: Option<f64>) -> Option<String> {
    let residual = residual.filter(|residual| *residual > LARGE)?;
    Some(format!(
        "warning: measured and fitted times differ by up to {:.0} % of an iteration\n\
         help: measure again when the machine has nothing else to do, or for longer: bdpm calibrate",
        100.0 * residual
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm::timing::TimeModel;
    use bdpm::timing::measure::Phase;

    #[test]
    fn only_residuals_above_10_percent_of_an_iteration_are_warned_of() {
        let model = TimeModel {
            fixed: 0.5,
            light_path: 0.0,
            camera_path: 0.0,
            look_up: 0.0,
            merge_pair: 0.0,
            pixels: 1.0,
        };
        let mut timings = Timings::from(model);
        assert_eq!(warning(largest_residual(&timings)), None);
        let point = |measured| FittedTime {
            phase: Phase::Light,
            light_paths: 1.0,
            camera_paths: 1.0,
            measured,
            error: None,
            fitted: 0.1,
        };
        // 40 % of a short phase, but only 8 % of the iteration.
        timings.points = vec![point(0.1), point(0.14)];
        assert!((largest_residual(&timings).unwrap() - 0.08).abs() < 1e-12);
        assert_eq!(warning(largest_residual(&timings)), None);
        timings.points.push(point(0.02));
        let shown = warning(largest_residual(&timings)).unwrap();
        assert!(shown.contains("up to 16 % of an iteration"), "{shown}");
    }
}
