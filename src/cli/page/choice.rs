//! What was chosen, and by how much it beats the others.

use super::Snapshot;
use super::sections::percent;
use crate::cli::human_time;
use crate::cli::render_report::describe_counts;
use bdpm::adaptive::technique::{Candidate, Selection};
use bdpm::image_io::number;
use bdpm::output::page::number::count;
use bdpm::output::page::table;
use maud::{Markup, html};

/// Less than this share of a difference is none.
const NOTABLE: f64 = 0.005;

/// The technique with all that were tried, and the counts.
pub fn section(moment: &Snapshot) -> Markup {
    let block = moment.image.blocks().last().expect("an image has a block");
    html! {
        section {
            h2 { "How it is rendered" }
            @if let Some(chosen) = moment.state.selection.as_ref() { (technique(chosen)) } @else {
                p { "Nothing was tried beside the settings that were given." }
            }
            p {
                "An iteration takes " (describe_counts(block)) "."
                @if let Some(promise) = moment.state.promise() {
                    " One light path and one camera path per pixel would take "
                    (number(promise.gain_over_one_each)) " times as long to the same noise."
                }
            }
        }
    }
}

fn technique(chosen: &Selection) -> Markup {
    let best = chosen.best();
    let others = &chosen.candidates[1..];
    html! {
        p {
            @if chosen.open.any() { "Chosen in " } @else { "Tried in " } (human_time(chosen.seconds)) ": "
            b { (best.technique.describe()) } "."
            " Photons are merged within " (number(best.radius.into())) " scene units, those of caustics within "
            (number(best.caustic_radius.into())) "."
            @if let Some(guided) = &chosen.guide {
                " " (guided.describe().replacen("light", "Light", 1)) "."
            }
            @if let Some(next) = chosen.runner_up() {
                " The next best, " (next.technique.describe()) ", " (beaten(best, next)) "."
            }
        }
        @if !others.is_empty() {
            (table("cards candidates", &html! {
                "All that came into question, by a pilot on a sample of the pixels: the error at the end with "
                "the best radii and numbers of paths of each"
            }, &html! {
                thead {
                    tr {
                        th scope="col" .text { "technique" }
                        th scope="col" { "error" } th scope="col" { "noise" } th scope="col" { "bias" }
                        th scope="col" { "time" } th scope="col" { "radius" } th scope="col" { "caustics" }
                        th scope="col" { "light paths" } th scope="col" { "camera paths" }
                    }
                }
                tbody {
                    (row(best, best))
                    @for other in others { (row(best, other)) }
                }
            }))
        }
    }
}

/// How far another technique is behind.
fn beaten(best: &Candidate, other: &Candidate) -> String {
    let (time, error) = (other.seconds / best.seconds, other.error / best.error);
    if time > 1.0 + NOTABLE {
        format!("would take {time:.2} times as long")
    } else if error > 1.0 + NOTABLE {
        format!("would have {error:.2} times the error")
    } else if error < 1.0 - NOTABLE {
        format!("looked like {error:.2} times the error, but there was no time to try it")
    } else {
        "would do as well, within what can be told".to_owned()
    }
}

fn row(best: &Candidate, own: &Candidate) -> Markup {
    let is_best = std::ptr::eq(best, own);
    html! {
        tr .chosen[is_best] {
            th scope="row" .text {
                (own.technique.describe())
                span .minor {
                    @if is_best { "chosen" } @else { (beaten(best, own)) }
                    @if !own.tried { "; not tried at these radii" }
                }
            }
            td data-label="error" { (percent(own.error)) }
            td data-label="noise" { (percent(own.noise)) }
            td data-label="bias" { (percent(own.bias)) }
            td data-label="time" { (human_time(own.seconds)) }
            td data-label="radius" { (number(own.radius.into())) }
            td data-label="caustics" { (number(own.caustic_radius.into())) }
            td data-label="light paths" { (count(own.light_paths)) }
            td data-label="camera paths" { (count(own.camera_paths)) }
        }
    }
}
