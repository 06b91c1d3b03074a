//! Values that follow from the published numbers alone, and contradictions between them.

use super::published::{
    CAMERA_PATHS, FIGURE_3, LIGHT_PATHS, TABLE_1, TABLE_1_CAMERA_PATHS, TABLE_2, TIME, Table2Column,
};
use bdpm_auto::adaptive::optimize::predict::{RenderTime, Source};
use bdpm_auto::timing::TimeModel;
use bdpm_auto::timing::fit::fit;
use bdpm_auto::timing::measure::{Phase, TimeSample};
use bdpm_core::noise::Coefficients;
use serde::Serialize;

/// The coefficients that Figure 3a implies, as if its region were one pixel: the inverse of
/// [`Coefficients::paper_terms`].
// theory.md (94)
pub fn coefficients() -> Coefficients {
    let (n_light, n_camera) = (f64::from(LIGHT_PATHS), f64::from(CAMERA_PATHS[0]));
    let [c, b, f] = FIGURE_3[0].roots.map(|root| root * root);
    let b = b * n_camera / (1.0 - 1.0 / n_light);
    let f = f * n_light / (1.0 - 1.0 / n_camera);
    Coefficients { a: c * n_light * n_camera - b - f, b, f }
}

/// The times of the phases in Table 2, with the errors of rounding to their last digit.
pub fn times() -> Vec<TimeSample> {
    let phases = [Phase::Camera, Phase::Light, Phase::Merge];
    let of_row = |row: &Table2Column| {
        let (light_paths, camera_paths) = (row.light_paths.into(), CAMERA_PATHS[0].into());
        phases.into_iter().zip(row.parts).map(move |(phase, seconds)| {
            let last_digit = if phase == Phase::Merge && seconds > 2.0 { 0.1 } else { 0.01 };
            // Standard deviation of what is evenly distributed over a digit.
            let error = Some(last_digit / 12f64.sqrt());
            TimeSample { phase, light_paths, camera_paths, seconds, error }
        })
    };
    // "About 0" is no number.
    TABLE_2.iter().flat_map(of_row).filter(|sample| sample.seconds > 0.0).collect()
}

/// The time model that Table 2 implies, as if for an image of one pixel.
///
/// # Panics
/// Never: the table is fixed.
// theory.md (94)
pub fn time_model() -> TimeModel {
    fit(&times(), 1.0).expect("the table has times of all phases").model
}

/// RMS of one iteration that Figure 3a implies for any counts.
pub fn rms(n_light: f64, n_camera: f64) -> f64 {
    coefficients().variance(n_light, n_camera).sqrt()
}

/// The number of light paths with the least noise that Figure 3a and the times of Table 2 imply, at
/// `N_B = 25`.
pub fn best_light_paths() -> f64 {
    let render = RenderTime { model: time_model(), time: TIME };
    let source = Source::Given(coefficients());
    source.best_light_paths(CAMERA_PATHS[0].into(), &render).light_paths.value
}

/// Two printed numbers that cannot both be right.
#[derive(Clone, Debug, Serialize)]
pub struct Inconsistency {
    /// Where the number is.
    pub place: String,
    /// As printed.
    pub printed: f64,
    /// Value that other printed numbers imply, or its bound.
    pub implied: f64,
    /// How that follows.
    pub reason: String,
}

/// Where the paper's numbers disagree with each other by more than their last digit.
pub fn inconsistencies() -> Vec<Inconsistency> {
    let mut all = Inconsistencies::default();
    all.check_figure_3();
    all.check_tables();
    all.0
}

/// Those found so far.
#[derive(Default)]
struct Inconsistencies(Vec<Inconsistency>);

impl Inconsistencies {
    /// Adds a number that rounding does not explain.
    fn check(&mut self, place: &str, printed: f64, implied: f64, last_digit: f64, reason: &str) {
        if (printed - implied).abs() > 0.5 * last_digit {
            let (place, reason) = (place.into(), reason.into());
            self.0.push(Inconsistency { place, printed, implied, reason });
        }
    }

    fn check_figure_3(&mut self) {
        let [few, many] = FIGURE_3;
        let [_, n_many] = CAMERA_PATHS.map(f64::from);
        let at_many = coefficients().paper_terms(f64::from(LIGHT_PATHS), n_many).map(f64::sqrt);
        self.check(
            "Figure 3, C term at N_B = 100",
            many.roots[0],
            at_many[0],
            2e-5,
            "by (1) it falls as 1/sqrt(N_B) from its value at N_B = 25",
        );
        self.check(
            "Figure 3, F term, N_B = 100 over 25",
            many.roots[2] / few.roots[2],
            at_many[2] / few.roots[2],
            1e-3,
            "by (1) it grows as sqrt(1 - 1/N_B)",
        );
        let norm = few.roots.iter().map(|root| root * root).sum::<f64>().sqrt();
        if few.total < norm {
            self.check(
                "Figure 3, mean RMS at N_B = 25",
                few.total,
                norm,
                1e-5,
                "the root is convex in the three roots, so that the mean of the RMS is at least \
                 the root of the squared means of the terms",
            );
        }
    }

    fn check_tables(&mut self) {
        let [n_few, _] = CAMERA_PATHS.map(f64::from);
        for row in TABLE_2 {
            // The light paths' noise is what vanishes for infinitely many of them.
            let limit = rms(f64::INFINITY, n_few);
            if row.rms < limit {
                self.check(
                    &format!("Table 2, RMS of one iteration at N_F = {}", row.light_paths),
                    row.rms,
                    limit,
                    1e-3,
                    "below the limit for infinitely many light paths that Figure 3 implies; the \
                     root of a sample variance from few iterations is low",
                );
            }
        }
        let column = TABLE_1_CAMERA_PATHS.iter().position(|&n| n == CAMERA_PATHS[0]);
        for ((n, cells), row) in TABLE_1.iter().skip(1).zip(TABLE_2) {
            let printed = column.map(|column| cells[column]).expect("Table 1 has this column");
            self.check(
                &format!("Table 1, N_F = {n}, N_B = 25"),
                printed,
                row.rms * (row.time / TIME).sqrt(),
                // Both numbers are rounded.
                4e-3,
                "what the RMS and the time in Table 2 give for the same counts",
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figure_3_fixes_the_coefficients() {
        // theory.md (94).
        let c = coefficients();
        for (found, expected) in [(c.a, 3595.0), (c.b, 37.18), (c.f, 0.3788)] {
            assert!((found / expected - 1.0).abs() < 3e-4, "{found} {expected}");
        }
        let terms = c.paper_terms(1000.0, 25.0).map(f64::sqrt);
        for (found, printed) in terms.into_iter().zip(FIGURE_3[0].roots) {
            assert!((found / printed - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn implied_minimum_is_near_the_published_one() {
        let best = best_light_paths();
        assert!((3420.0..3460.0).contains(&best), "{best}");
        for row in TABLE_2 {
            let tau = time_model().iteration(row.light_paths.into(), 25.0);
            assert!((tau / row.time - 1.0).abs() < 0.02, "{tau} {}", row.time);
        }
    }

    #[test]
    fn known_contradictions_are_found_and_no_others() {
        let found = inconsistencies();
        let places: Vec<&str> = found.iter().map(|i| &i.place[..]).collect();
        assert_eq!(
            places,
            [
                "Figure 3, C term at N_B = 100",
                "Figure 3, F term, N_B = 100 over 25",
                "Figure 3, mean RMS at N_B = 25",
                "Table 2, RMS of one iteration at N_F = 100000",
                "Table 2, RMS of one iteration at N_F = 300000",
                "Table 1, N_F = 100000, N_B = 25",
            ]
        );
        assert!((found[0].implied - 0.1906).abs() < 1e-4);
        assert!((found[1].implied - 1.0155).abs() < 1e-4);
        assert!((found[3].implied - 1.219).abs() < 1e-3);
        assert!((found[5].implied - 0.128).abs() < 5e-4);
    }
}
