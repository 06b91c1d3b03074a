//! The part of the page that says what the readings rest on, and what they leave out.

use super::record::Record;
use crate::cli::human_time;
use bdpm::Measurement;
use bdpm::report::number::fixed;
use bdpm::report::{header, table};
use maud::{Markup, html};

/// What holds for every measurement.
const ASSUMPTIONS: [&str; 5] = [
    "The intervals are those of the computation. Errors of the model, such as of reflectances, fluxes and geometry, are \
     not in them.",
    "683 lm are 1 W of white light. Colors are linear Rec. 709 instead of spectra.",
    "Polarization counts in clear panes alone.",
    "Luminaires shine from their luminous openings, with the intensities of their files.",
    "Light that no path has met is in no interval, unless a reading is 0.",
];

pub fn evidence(measurement: &Measurement, record: &Record) -> Markup {
    html! {
        h2 { "Light and surfaces" }
        (sources(record))
        (surfaces(record))
        h2 { "Computation" }
        p {
            (record.date) ", bdpm " (env!("CARGO_PKG_VERSION")) ", "
            (human_time(measurement.time.as_secs_f64())) "."
            @if !measurement.reached { " The target was not reached." }
            " Fingerprint of the scene: " code { (record.fingerprint) } "."
        }
        p { "Command: " code { (record.command) } }
        ul { @for technique in &measurement.techniques { li { (technique) } } }
        (files(record))
        h2 { "Assumptions" }
        ul { @for assumption in ASSUMPTIONS { li { (assumption) } } }
    }
}

/// The part of a page about daylight, where lamps do not count.
pub fn files_and_surfaces(record: &Record, seconds: f64) -> Markup {
    html! {
        h2 { "Surfaces" }
        (surfaces(record))
        h2 { "Computation" }
        p {
            (record.date) ", bdpm " (env!("CARGO_PKG_VERSION")) ", " (human_time(seconds))
            ". Fingerprint of the scene: " code { (record.fingerprint) } "."
        }
        p { "Command: " code { (record.command) } }
        (files(record))
    }
}

fn sources(record: &Record) -> Markup {
    let rows = html! {
        (header(&["*light source", "number", "luminous flux"]))
        tbody {
            @for source in &record.sources {
                tr {
                    td .text { (source.name) }
                    td { (source.count) }
                    td {
                        @match source.lumens {
                            Some(lumens) => { (fixed(lumens, 0)) " lm" }
                            None => {}
                        }
                    }
                }
            }
        }
    };
    table("sources", &html! { "Light sources, with the flux of all of one name" }, &rows)
}

fn surfaces(record: &Record) -> Markup {
    let rows = html! {
        (header(&["*material", "*kind", "reflectance"]))
        tbody {
            @for surface in &record.surfaces {
                tr {
                    td .text { (surface.name) }
                    td .text { (surface.kind) }
                    td {
                        @match surface.reflectance {
                            Some(own) => { (fixed(own.into(), 3)) }
                            None => { "textured" }
                        }
                    }
                }
            }
        }
    };
    table(
        "surfaces",
        &html! { "Surfaces, with the share of white light straight on that they reflect" },
        &rows,
    )
}

fn files(record: &Record) -> Markup {
    let rows = html! {
        (header(&["*file", "bytes", "*SHA-256"]))
        tbody {
            @for file in &record.files {
                tr {
                    td .text { (file.path.display()) }
                    td { (file.bytes) }
                    td .text { code { (file.sha256) } }
                }
            }
        }
    };
    table("files", &html! { "Files that were read" }, &rows)
}
