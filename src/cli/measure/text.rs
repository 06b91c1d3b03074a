//! The table that `bdpm measure` prints.

use super::digits::{digits, digits_of};
use crate::cli::human_time;
use bdpm::Measurement;
use bdpm::measurement::{Estimated, Reading, SetReadings, unit};
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
            writeln!(text, "{name:<width$} {:>11}", "unknown").expect(PLAIN);
            return;
        }
        let digits = digits(reading);
        let number = |value: f64| format!("{value:.digits$}");
        writeln!(
            text,
            "{name:<width$} {:>11} {:>10} {:>7} {:>10} {:>10} {:>11} {:>11}",
            format!("{} {}", number(reading.value), unit(set.kind)),
            number(reading.expanded),
            if reading.value > 0.0 {
                format!("{:.2} %", 100.0 * reading.relative(0.0))
            } else {
                String::new()
            },
            number(reading.noise),
            number(reading.bias),
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
        writeln!(text, "{name:<width$} {}", extreme_text(&extreme, unit(set.kind))).expect(PLAIN);
    }
    let [columns, rows] = set.grid;
    let [uniformity, diversity] = [set.uniformity(), set.diversity()].map(|own| ratio(&own));
    writeln!(
        text,
        "{name}: {columns} by {rows} meters, uniformity U0 {uniformity}, diversity Ud {diversity}"
    )
    .expect(PLAIN);
}

/// A minimum or maximum in the columns of values and uncertainties.
fn extreme_text(extreme: &Estimated, unit: &str) -> String {
    if extreme.value.is_nan() {
        return format!("{:>11}", "unknown");
    }
    let digits = digits_of(extreme.expanded);
    let Estimated { value, expanded } = *extreme;
    let relative = format!("{:.2} %", 100.0 * expanded / value);
    format!("{:>11} {expanded:>10.digits$} {relative:>7}", format!("{value:.digits$} {unit}"))
}

/// A ratio with its uncertainty.
fn ratio(own: &Estimated) -> String {
    if own.value.is_nan() {
        return "unknown".to_owned();
    }
    format!("{:.3} +- {:.3}", own.value, own.expanded)
}
