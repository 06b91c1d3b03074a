//! The table that `bdpm measure` prints.

use super::digits::digits;
use crate::cli::human_time;
use bdpm::Measurement;
use bdpm::measurement::{Reading, SetReadings, unit};
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
    let by_value = |a: &&Reading, b: &&Reading| a.value.total_cmp(&b.value);
    for (label, reading) in [
        ("minimum", set.readings.iter().min_by(by_value)),
        ("maximum", set.readings.iter().max_by(by_value)),
    ] {
        line(&format!("{name}: {label}"), reading.expect("a grid has meters"));
    }
    let [columns, rows] = set.grid;
    writeln!(text, "{name}: {columns} by {rows} meters, uniformity {:.3}", set.uniformity())
        .expect(PLAIN);
}
