//! A measurement as an HTML page without external resources.

use super::digits::{digits, digits_of, uncertainty};
use super::dimming::{self, full_strength};
use super::evidence::evidence;
use super::record::Record;
use bdpm::Measurement;
use bdpm::base::atomic::write_atomically;
use bdpm::base::error::Result;
use bdpm::light::false_color::{ColorScale, ValueGrid};
use bdpm::light::isolines::isolines_svg;
use bdpm::measurement::{Estimated, Judged, Limit, MeterPlace, Reading, SetReadings};
use bdpm::report::number::fixed;
use bdpm::report::picture::{Colors, Picture};
use bdpm::report::{document, header, table};
use bdpm::scene::Scene;
use maud::{Markup, PreEscaped, html};
use std::path::Path;

/// Grids are drawn with one pixel for each cell; the page scales them up without smoothing, to the
/// same width for all, with the scale beside them.
const STYLE: &str = "img{image-rendering:pixelated}\
    .picture{display:flex;flex-wrap:wrap;gap:.5rem 1.5rem;align-items:center}\
    .picture .pixels{flex:0 1 26rem}.picture .pixels img{width:100%;height:auto;max-height:30rem;object-fit:contain;\
    object-position:left}\
    .picture .scale{flex:0 1 16rem}.picture figcaption{flex:0 0 100%}\
    .lines svg{width:100%;max-width:36rem;height:auto;max-height:36rem}.points td{line-height:1.2}\
    code{overflow-wrap:anywhere}.files code{font-size:.8em}\
    .signature{margin-top:3rem}.signature span{display:inline-block;width:60%;border-bottom:1px solid}\
    @media print{h2,figure,tr{break-inside:avoid}h2{break-after:avoid}.scroll{overflow:visible}\
    table{font-size:.75em}}";

/// Grids with more columns or points do not fit on paper.
const MOST_COLUMNS: usize = 16;
const MOST_POINTS: usize = 320;

/// Width of the cells of isolines, units of their picture.
const CELL: f64 = 40.0;

/// Writes the page.
pub fn write(path: &Path, scene: &Scene, measurement: &Measurement) -> Result<()> {
    let page = page(&scene.name, measurement, &Record::new(scene)?).into_string();
    write_atomically(path, |file| file.write_all(page.as_bytes()))
}

fn page(scene: &str, measurement: &Measurement, record: &Record) -> Markup {
    let body = html! {
        main {
            h1 { "Light in " (scene) }
            p {
                "The true value is within the uncertainty of the value with a probability of 95 %. "
                "The noise is one standard deviation. The bias is a bound."
            }
            @for warning in &measurement.warnings { p { strong { "Note: " } (warning) "." } }
            (dimming::with_sliders(measurement, &results(measurement)))
            (evidence(measurement, record))
            p .signature { "Name, place and date: " span {} }
        }
        (dimming::script(measurement))
    };
    let sliders = if dimming::has_sliders(measurement) { dimming::STYLE } else { "" };
    document(&format!("Light in {scene}"), &format!("{STYLE}{sliders}"), &html! {}, &body)
}

/// Requirements, readings, maps and points. The script of pages with sliders writes their numbers
/// again: it counts on the order of tables, rows, cells and figures.
fn results(measurement: &Measurement) -> Markup {
    html! {
        (requirements(measurement))
        (readings(measurement))
        @for set in measurement.sets.iter().filter(|set| set.readings.len() > 1) {
            (maps(set))
            (points(set))
        }
    }
}

/// One row per requirement; nothing if there is none.
fn requirements(measurement: &Measurement) -> Markup {
    let of_set = |set: &SetReadings| -> Vec<Markup> {
        set.judged().iter().map(|own| requirement(set, own)).collect()
    };
    let all: Vec<Markup> = measurement.sets.iter().flat_map(of_set).collect();
    let names = ["*meters", "*requirement", "required", "found", "uncertainty", "*verdict"];
    let rows = html! { (header(&names)) tbody { @for row in &all { (row) } } };
    html! {
        @if !all.is_empty() {
            (table("requirements", &html! { "Requirements, decided by intervals of 95 %" }, &rows))
        }
    }
}

fn requirement(set: &SetReadings, own: &Judged) -> Markup {
    let Judged { what, unit, limit, required, found, verdict } = own;
    let is_ratio = unit.is_empty() && *limit == Limit::Least;
    let digits = if is_ratio { 3 } else { digits_of(found.expanded) };
    let factor = (!unit.is_empty()).then(|| set.maintenance_factor()).flatten();
    html! {
        tr {
            td .text { (set.name) }
            td .text {
                (what) @if let Some(factor) = factor { ", factor " (factor) }
                (full_strength(set, *limit))
            }
            td { (limit.describe()) " " (required) " " (unit) }
            td { (uncertainty(found.value, digits)) " " (unit) }
            td { (half_width(found.expanded, digits)) }
            td .text { strong { (verdict.describe()) } }
        }
    }
}

/// One row per single meter, rows for mean, minimum and maximum of grids, and rows for groups of
/// lights.
fn readings(measurement: &Measurement) -> Markup {
    let names = [
        "*meter",
        "*position",
        "*lights",
        "value",
        "uncertainty",
        "noise",
        "bias",
        "direct",
        "indirect",
    ];
    let rows = html! {
        (header(&names))
        tbody {
            @for set in &measurement.sets {
                @let single = set.readings.len() == 1;
                @let label = if single { set.name.clone() } else { format!("{}: mean", set.name) };
                (row([&label, &place(set), "all"], set, &set.mean))
                @for (group, _, mean) in &set.groups { (row(["", "", group], set, mean)) }
                @if !single { (extremes(set)) }
            }
        }
    };
    table("readings", &html! { "Readings with half of the width of their 95 % intervals" }, &rows)
}

/// Position of a single meter, or of the first and the last one of a grid, scene units.
fn place(set: &SetReadings) -> String {
    let at = |place: &MeterPlace| {
        let [x, y, z] = place.position.to_array().map(|x| (x * 1e4).round() / 1e4);
        format!("({x}, {y}, {z})")
    };
    match &set.places[..] {
        [] => String::new(),
        [only] => at(only),
        [first, .., last] => format!("{} to {}", at(first), at(last)),
    }
}

fn extremes(set: &SetReadings) -> Markup {
    let [least, most] = set.extremes();
    html! {
        (extreme("minimum", &least, set.unit()))
        (extreme("maximum", &most, set.unit()))
        (extreme("uniformity U0", &set.uniformity(), ""))
        (extreme("diversity Ud", &set.diversity(), ""))
    }
}

/// A row of a quantity of a whole grid.
fn extreme(label: &str, own: &Estimated, unit: &str) -> Markup {
    let digits = digits_of(own.expanded);
    html! {
        tr {
            td .text { (label) }
            td .text {}
            td .text {}
            @if own.value.is_nan() {
                td { "unknown" }
                td {}
            } @else {
                td { (fixed(own.value, digits)) " " (unit) }
                td { (half_width(own.expanded, digits)) }
            }
            @for _ in 0..4 { td {} }
        }
    }
}

/// Half of the width of an interval, or that it is unknown.
fn half_width(expanded: f64, digits: usize) -> String {
    let sign = if expanded.is_finite() { "±" } else { "" };
    format!("{sign}{}", uncertainty(expanded, digits))
}

/// A row with its texts: meter, position and lights.
fn row(texts: [&str; 3], set: &SetReadings, reading: &Reading) -> Markup {
    let Reading { value, noise, bias, expanded, direct } = *reading;
    let shown = |value: f64| fixed(value, digits(reading));
    if !reading.is_known() {
        return html! {
            tr {
                @for text in texts { td .text { (text) } }
                td { "unknown" }
                @for _ in 0..5 { td {} }
            }
        };
    }
    html! {
        tr {
            @for text in texts { td .text { (text) } }
            td { (shown(value)) " " (set.unit()) }
            td { (half_width(expanded, digits(reading))) }
            @for number in [noise, bias] { td { (uncertainty(number, digits(reading))) } }
            @for number in [direct, reading.indirect()] { td { (shown(number)) } }
        }
    }
}

/// Maps of the values and of their relative uncertainty.
fn maps(set: &SetReadings) -> Markup {
    let size = (set.grid[0], set.grid[1]);
    let map = |name, alt: &str, values: &[f64], unit| {
        let names = (name, alt);
        Picture::values(names, size, values, (Colors::Sequential, unit))
    };
    let values: Vec<f64> = set.readings.iter().map(|reading| reading.value).collect();
    // A reading of 0 with an uncertainty has no relative one.
    let of_one = |reading: &Reading| match reading.relative(0.0) {
        relative if relative.is_finite() => 100.0 * relative,
        _ => f64::NAN,
    };
    let relative: Vec<f64> = set.readings.iter().map(of_one).collect();
    let quantity = set.quantity();
    let alt = format!("{quantity} of {}", set.name);
    html! {
        h2 { (set.name) }
        (map("values", &alt, &values, set.unit()).figure(&[], &html! {
            "The " (quantity) " of the grid. The first row is at the top."
        }))
        (map("uncertainty", "uncertainty of each meter", &relative, "%").figure(&[], &html! {
            "Half of the width of the 95 % interval, relative."
        }))
        (lines(set))
    }
}

/// Isolines of a grid; nothing for a single row or column.
fn lines(set: &SetReadings) -> Markup {
    let [columns, rows] = set.grid;
    let values: Vec<f64> = set.readings.iter().map(|reading| reading.value).collect();
    let grid = ValueGrid::new(columns, rows, &values);
    let svg = isolines_svg(grid, &ColorScale::linear(grid).ticks(), set.unit(), CELL);
    // Within a page the name space is known, and pages name no address.
    let svg = svg.replacen(" xmlns=\"http://www.w3.org/2000/svg\"", "", 1);
    html! {
        @if columns > 1 && rows > 1 {
            figure .lines {
                (PreEscaped(svg))
                figcaption { "Lines of equal " (set.quantity()) "." }
            }
        }
    }
}

/// Returns true if the set is a grid whose points fit on paper.
pub fn has_table_of_points(set: &SetReadings) -> bool {
    (2..=MOST_POINTS).contains(&set.readings.len()) && set.grid[0] as usize <= MOST_COLUMNS
}

/// The readings of all points of a grid with their uncertainties, as they lie in the map.
fn points(set: &SetReadings) -> Markup {
    let columns = set.grid[0] as usize;
    let cell = |own: &Reading| {
        let digits = digits(own);
        html! {
            td {
                @if own.is_known() {
                    (fixed(own.value, digits)) br; small { (half_width(own.expanded, digits)) }
                } @else { "unknown" }
            }
        }
    };
    let rows = html! {
        tbody {
            @for row in set.readings.chunks(columns) { tr { @for own in row { (cell(own)) } } }
        }
    };
    let caption = html! { "All points of " (set.name) ", " (set.unit()) ", " (place(set)) };
    html! {
        @if has_table_of_points(set) {
            (table("points", &caption, &rows))
        } @else {
            p { "The grid has more points than fit here: " code { "--csv" } " lists them." }
        }
    }
}
