//! Daylight of a year as an HTML page without external resources.

use super::{Args, rows};
use crate::cli::measure::{Record, files_and_surfaces};
use bdpm::base::atomic::write_atomically;
use bdpm::base::error::Result;
use bdpm::daylight::{DaylightSet, DaylightYear, PointYear};
use bdpm::report::picture::{Colors, Picture};
use bdpm::report::{document, header, table};
use bdpm::scene::Scene;
use maud::{Markup, html};
use std::path::Path;

/// Grids are drawn with one pixel for each cell, which the page scales up without smoothing.
const STYLE: &str = "img{image-rendering:pixelated}\
    .picture{display:flex;flex-wrap:wrap;gap:.5rem 1.5rem;align-items:center}\
    .picture .pixels{flex:0 1 26rem}.picture .pixels img{width:100%;height:auto}\
    .picture .scale{flex:0 1 16rem}.picture figcaption{flex:0 0 100%}code{overflow-wrap:anywhere}\
    @media print{h2,figure,tr{break-inside:avoid}.scroll{overflow:visible}table{font-size:.75em}}";

/// Writes the page.
pub fn write(path: &Path, scene: &Scene, args: &Args, year: &DaylightYear) -> Result<()> {
    let record = Record::new(scene)?;
    let page = page(&scene.name, args, year, &record).into_string();
    write_atomically(path, |file| file.write_all(page.as_bytes()))
}

fn page(scene: &str, args: &Args, year: &DaylightYear, record: &Record) -> Markup {
    let [from, to] = args.occupied;
    let lines = html! {
        (header(&["*meters", "*quantity", "value"]))
        tbody {
            @for set in &year.sets {
                @for (what, value) in rows(args, set) {
                    tr { td .text { (set.name) } td .text { (what) } td { (value) } }
                }
            }
        }
    };
    let body = html! {
        main {
            h1 { "Daylight of a year in " (scene) }
            p {
                "Weather of " (year.place) ". " (year.occupied_hours) " hours count, from " (from) " to " (to)
                " o'clock on all days. An hour counts toward a share if its interval of 95 % does. The "
                "uncertainty of a share is that of hours whose intervals reach across the limit."
            }
            (table("year", &html! { "Values with half of the width of their intervals" }, &lines))
            @for set in &year.sets { (maps(args, set)) }
            (files_and_surfaces(record, year.time.as_secs_f64()))
        }
    };
    document(&format!("Daylight of a year in {scene}"), STYLE, &html! {}, &body)
}

/// Maps of a grid, and the hours of the year.
fn maps(args: &Args, set: &DaylightSet) -> Markup {
    let size = (set.grid[0], set.grid[1]);
    let map = |name, alt: &str, unit, of: &dyn Fn(&PointYear) -> f64| {
        let values: Vec<f64> = set.points.iter().map(of).collect();
        Picture::values((name, alt), size, &values, (Colors::Sequential, unit))
    };
    let by_month = set.by_month();
    let hours: Vec<f64> = by_month.iter().flatten().copied().collect();
    let names = ("hours", "illuminance by month and hour");
    let year = Picture::values(names, (24, 12), &hours, (Colors::Sequential, "lx"));
    html! {
        h2 { (set.name) }
        @if set.points.len() > 1 {
            (map("autonomy", "daylight autonomy", "%", &|own| own.autonomy.value).figure(&[], &html! {
                "Hours with at least " (args.autonomy) " lx. The first row is at the top."
            }))
            (map("sun", "hours of direct sun", "h", &|own| own.sun_hours).figure(&[], &html! {
                "Hours with over 1000 lx of direct sun."
            }))
        }
        (year.figure(&[], &html! {
            "Mean illuminance. Columns are the hours of the clock from 0:00, rows the months from January."
        }))
    }
}
