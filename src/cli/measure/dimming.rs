//! The sliders of a page of `bdpm measure --by-light --report FILE.html`, and the numbers from
//! which its script computes what the meters read under dimmed lights.
//!
//! The script does what `SetReadings` does with the readings of all groups of lights: it adds
//! values, squares of noise, and biases, each times the factor of its group.

use super::page::has_table_of_points;
use bdpm::Measurement;
use bdpm::measurement::{Limit, Reading, SetReadings};
use bdpm::report::packed::{bytes, doubles, singles};
use bdpm::report::picture::{COVERED, Colors, MAX_STEPS};
use maud::{Markup, PreEscaped, html};

/// Style sheet of the sliders.
pub const STYLE: &str = include_str!("dimming.css");

/// End of the scale of sliders.
const SLIDER_END: f64 = 2.0;

/// Returns true if the lights were measured apart, so that the page has sliders.
pub fn has_sliders(measurement: &Measurement) -> bool {
    measurement.sets.iter().any(|set| !set.groups.is_empty())
}

/// The results of the page, with a slider for each group of lights before them. There are no
/// sliders if the lights were not measured apart.
pub fn with_sliders(measurement: &Measurement, results: &Markup) -> Markup {
    if !has_sliders(measurement) {
        return results.clone();
    }
    html! {
        div #dimming data-covered=(COVERED) data-steps=(MAX_STEPS)
            data-colors=(bytes(&Colors::Sequential.table().concat())) {
            (controls(measurement))
            @for set in &measurement.sets { (numbers(set)) }
            (results)
        }
    }
}

/// The script, at the end of pages with sliders.
pub fn script(measurement: &Measurement) -> Markup {
    html! {
        @if has_sliders(measurement) {
            script { (PreEscaped(include_str!("dimming.js"))) }
        }
    }
}

fn controls(measurement: &Measurement) -> Markup {
    let names = measurement.sets.first().into_iter().flat_map(|set| &set.groups);
    html! {
        div .controls role="group" aria-label="lights" {
            noscript {
                p { "The sliders need JavaScript." }
            }
            div .lights {
                @for (index, (name, ..)) in names.enumerate() { (slider(index, name)) }
            }
            // Below the sliders, which a longer text does not move under a finger.
            div .strengths {
                p #state { "All lights at full strength." }
                button #reset type="button" { "Full strength" }
            }
        }
    }
}

fn slider(index: usize, name: &str) -> Markup {
    let id = format!("light-{index}");
    html! {
        div .light data-name=(name) {
            label for=(id) { (name) }
            input type="range" id=(id) min="0" max=(SLIDER_END) step="0.01" value="1"
                autocomplete="off";
            input type="number" min="0" step="any" value="1" autocomplete="off"
                aria-label=(format!("{name}, number"));
        }
    }
}

/// The readings of a set under each group of lights, for the script. Values have 53 bits of
/// precision, since their digits are shown up to the uncertainty, and uncertainties 24 bits.
fn numbers(set: &SetReadings) -> Markup {
    let [columns, rows] = set.grid;
    let groups = set.groups.iter().zip(&set.open_of_groups);
    html! {
        div .measured hidden data-unit=(set.unit()) data-columns=(columns) data-rows=(rows)
            data-factor-of-all=(set.factor_of_all()) data-maintenance=(set.requirement.maintenance)
            data-required=(required(set)) data-table[has_table_of_points(set)] {
            @for ((_, readings, mean), open) in groups {
                @let all = |number: fn(&Reading) -> f64| {
                    readings.iter().map(number).collect::<Vec<f64>>()
                };
                @let biases = all(|own| own.bias);
                i data-mean=(doubles(&[mean.value, mean.noise, mean.bias, spread(mean), mean.direct]))
                    data-open=(open) data-value=(doubles(&all(|own| own.value)))
                    data-noise=(singles(&all(|own| own.noise))) data-spread=(singles(&all(spread)))
                    data-bias=[biases.iter().any(|own| *own != 0.0).then(|| singles(&biases))] {}
            }
        }
    }
}

/// Half of the width of the interval without the bias.
fn spread(reading: &Reading) -> f64 {
    reading.expanded - reading.bias
}

/// Name and required value of each requirement as JSON, in the order of their rows.
fn required(set: &SetReadings) -> String {
    let all: Vec<(&str, f64)> = set.judged().iter().map(|own| (own.what, own.required)).collect();
    serde_json::to_string(&all).expect("texts and finite numbers")
}

/// Says that a requirement does not follow the sliders, behind its name: glare is no sum over
/// lights.
pub fn full_strength(set: &SetReadings, limit: Limit) -> &'static str {
    let is_glare = limit == Limit::Most;
    if is_glare && !set.groups.is_empty() { ", all lights at full strength" } else { "" }
}
