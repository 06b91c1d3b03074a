//! The table that `bdpm measure` prints.

use super::digits::{UNKNOWN, digits, digits_of, uncertainty};
use crate::cli::human_time;
use bdpm::Measurement;
use bdpm::measurement::{Estimated, Judged, Limit, Reading, SetReadings};
use std::fmt::Write;

pub fn text(measurement: &Measurement) -> String {
    let mut text = String::new();
    let names = measurement.sets.iter().map(|set| set.name.chars().count() + 12);
    let width = names.max().unwrap_or(0).max(20);
    writeln!(
        text,
        "{:<width$} {:>11} {:>10} {:>7} {:>10} {:>10} {:>11} {:>11}",
        "meter", "value", "+- 95 %", "", "noise", "bias", "direct", "indirect"
    )
    .expect(PLAIN);
    for set in &measurement.sets {
        rows(&mut text, set, width);
    }
    for set in &measurement.sets {
        for own in set.judged() {
            writeln!(text, "{}: {}", set.name, judgment(&own, set)).expect(PLAIN);
        }
    }
    let readings = measurement.sets.iter().flat_map(|set| &set.readings);
    if readings.into_iter().any(|own| own.is_known() && !own.has_uncertainty()) {
        writeln!(text, "uncertainties are unknown after one iteration: give a longer --time")
            .expect(PLAIN);
    }
    for technique in &measurement.techniques {
        writeln!(text, "{technique}").expect(PLAIN);
    }
    let time = human_time(measurement.time.as_secs_f64());
    let state = if measurement.reached { "" } else { "; the target was not reached" };
    writeln!(text, "in {time}{state}").expect(PLAIN);
    text
}

/// Strings take everything.
const PLAIN: &str = "strings take everything";

fn rows(text: &mut String, set: &SetReadings, width: usize) {
    let mut line = |name: &str, reading: &Reading| {
        if !reading.is_known() {
            writeln!(text, "{name:<width$} {UNKNOWN:>11}").expect(PLAIN);
            return;
        }
        let digits = digits(reading);
        let number = |value: f64| format!("{value:.digits$}");
        writeln!(
            text,
            "{name:<width$} {:>11} {:>10} {:>7} {:>10} {:>10} {:>11} {:>11}",
            format!("{} {}", number(reading.value), set.unit()),
            uncertainty(reading.expanded, digits),
            if reading.value > 0.0 && reading.has_uncertainty() {
                format!("{:.2} %", 100.0 * reading.relative(0.0))
            } else {
                String::new()
            },
            uncertainty(reading.noise, digits),
            uncertainty(reading.bias, digits),
            number(reading.direct),
            number(reading.indirect()),
        )
        .expect(PLAIN);
    };
    let name = &set.name;
    if set.readings.len() == 1 {
        line(name, &set.readings[0]);
        for (group, readings, _) in &set.groups {
            line(&format!("  {group}"), &readings[0]);
        }
        return;
    }
    line(&format!("{name}: mean"), &set.mean);
    for (group, _, mean) in &set.groups {
        line(&format!("  {group}"), mean);
    }
    for (label, extreme) in ["minimum", "maximum"].iter().zip(set.extremes()) {
        let name = format!("{name}: {label}");
        writeln!(text, "{name:<width$} {}", extreme_text(&extreme, set.unit())).expect(PLAIN);
    }
    let [columns, rows] = set.grid;
    let [uniformity, diversity] = [set.uniformity(), set.diversity()].map(|own| ratio(&own));
    writeln!(
        text,
        "{name}: {columns} by {rows} meters, uniformity U0 {uniformity}, diversity Ud {diversity}"
    )
    .expect(PLAIN);
}

/// A requirement, what was found, and whether that is enough.
fn judgment(own: &Judged, set: &SetReadings) -> String {
    let Judged { what, unit, limit, required, found, verdict } = own;
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let is_ratio = unit.is_empty() && *limit == Limit::Least;
    let digits = if is_ratio { 3 } else { digits_of(found.expanded) };
    let [value, expanded] = [found.value, found.expanded].map(|own| uncertainty(own, digits));
    let factor = set.maintenance_factor().filter(|_| !unit.is_empty());
    let factor = factor.map_or(String::new(), |own| format!(" (maintenance factor {own})"));
    let (limit, verdict) = (limit.describe(), verdict.describe());
    format!("{what} {value}{unit} +- {expanded}{factor}, {limit} {required}{unit}: {verdict}")
}

/// A minimum or maximum in the columns of values and uncertainties.
fn extreme_text(extreme: &Estimated, unit: &str) -> String {
    if !extreme.value.is_finite() {
        return format!("{UNKNOWN:>11}");
    }
    let digits = digits_of(extreme.expanded);
    let Estimated { value, expanded } = *extreme;
    let relative = match expanded.is_finite() && value > 0.0 {
        true => format!("{:.2} %", 100.0 * expanded / value),
        false => String::new(),
    };
    let (value, expanded) = (format!("{value:.digits$} {unit}"), uncertainty(expanded, digits));
    format!("{value:>11} {expanded:>10} {relative:>7}")
}

/// A ratio with its uncertainty.
fn ratio(own: &Estimated) -> String {
    if !own.value.is_finite() {
        return UNKNOWN.to_owned();
    }
    format!("{:.3} +- {}", own.value, uncertainty(own.expanded, 3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm::scene::MeterKind;
    use std::time::Duration;

    /// A dark meter of a grid: its minimum is 0, and so are the uniformities.
    #[test]
    fn dark_meters_are_0() {
        let lit = Reading { value: 350.0, noise: 1.0, bias: 0.0, expanded: 2.0, direct: 300.0 };
        let dark = Reading { expanded: 0.25, ..Reading::default() };
        let mut grid = SetReadings::single("grid", MeterKind::Irradiance, lit);
        (grid.grid, grid.readings) = ([3, 1], vec![lit, dark, Reading::default()]);
        let text = text(&Measurement {
            sets: vec![grid, SetReadings::single("shade", MeterKind::Irradiance, dark)],
            reached: true,
            time: Duration::ZERO,
            techniques: Vec::new(),
            warnings: Vec::new(),
        });
        assert!(
            !text.contains("NaN") && !text.contains("inf") && !text.contains("unknown"),
            "{text}"
        );
        assert!(text.contains("U0 0.000 +- 0.00") && text.contains("0.00 lx       0.25"), "{text}");
    }

    #[test]
    fn uncertainties_of_one_iteration_are_unknown() {
        let one = Reading {
            value: 350.0,
            noise: f64::NAN,
            bias: 0.0,
            expanded: f64::INFINITY,
            direct: 300.0,
        };
        for expanded in [f64::INFINITY, f64::NAN] {
            let reading = Reading { expanded, ..one };
            let mut grid = SetReadings::single("grid", MeterKind::Irradiance, reading);
            (grid.grid, grid.readings) = ([2, 1], vec![reading; 2]);
            let set = SetReadings::single("desk", MeterKind::Irradiance, reading);
            let text = text(&Measurement {
                sets: vec![set, grid],
                reached: false,
                time: Duration::ZERO,
                techniques: Vec::new(),
                warnings: Vec::new(),
            });
            assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
            assert!(text.contains("350.0 lx    unknown"), "{text}");
            assert!(text.contains("after one iteration: give a longer --time"), "{text}");
        }
    }
}
