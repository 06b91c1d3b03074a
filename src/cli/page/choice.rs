//! The chosen technique, and its advantage over the others.

use super::Snapshot;
use super::sections::percent;
use crate::cli::human_time;
use crate::cli::render_report::describe_counts;
use bdpm::adaptive::technique::{Candidate, Selection};
use bdpm::image_io::number;
use bdpm::report::number::count;
use bdpm::report::table;
use maud::{Markup, html};

/// Smaller relative differences are not shown.
const NOTABLE: f64 = 0.005;

/// The technique beside all that were tried, and the path counts.
pub fn section(snapshot: &Snapshot) -> Markup {
    let block = snapshot.image.blocks().last().expect("an image has a block");
    let settings = &snapshot.state.provenance.settings;
    html! {
        section {
            h2 { "How it is rendered" }
            @if let Some(chosen) = snapshot.state.selection.as_ref() { (technique(chosen)) } @else {
                p { "No technique was tried: the settings were given." }
            }
            p {
                "An iteration takes " (describe_counts(block, settings)) "."
                @if settings.shares_light() && let Some(promise) = snapshot.state.promise() {
                    " Iterations of one light path and one camera path per pixel would take "
                    (number(promise.gain_over_one_each)) " times as long for the same noise."
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
            @if best.technique.strategy.has_photons() {
                " Photons are merged within " (number(best.radius.into())) " scene units, those of caustics within "
                (number(best.caustic_radius.into())) "."
                @if best.technique.medium_query.is_some() {
                    " Radii in media are " (number(best.medium_scale)) " times as large."
                    @if best.medium_share < 1.0 {
                        " A share of " (number(best.medium_share)) " of the merges in media is done."
                    }
                }
                @if let Some(guided) = chosen.used_guide() { " It has " (guided.describe()) "." }
            }
            @if let Some(next) = chosen.runner_up() {
                " The next best, " (next.technique.describe()) ", " (disadvantage(best, next)) "."
            }
        }
        @if !others.is_empty() {
            (table("cards candidates", &html! {
                "All candidates, tried on a sample of the pixels: the error at the end with the best radii and path "
                "counts of each"
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

/// Disadvantage of another technique, in words.
fn disadvantage(best: &Candidate, other: &Candidate) -> String {
    let (time, error) = (other.seconds / best.seconds, other.error / best.error);
    if time > 1.0 + NOTABLE {
        format!("would take {time:.2} times as long")
    } else if error > 1.0 + NOTABLE {
        format!("would have {error:.2} times the error")
    } else if error < 1.0 - NOTABLE {
        let reason = match other.tried {
            true => "its noise looks more like spots",
            false => "it was not tried at these radii",
        };
        format!("has a predicted error {error:.2} times as large, but {reason}")
    } else {
        "would do equally well within the accuracy of the pilot".to_owned()
    }
}

fn row(best: &Candidate, candidate: &Candidate) -> Markup {
    let is_best = std::ptr::eq(best, candidate);
    html! {
        tr .chosen[is_best] {
            th scope="row" .text {
                (candidate.technique.describe())
                span .minor {
                    @if is_best { "chosen" } @else { (disadvantage(best, candidate)) }
                    @if !candidate.tried { "; not tried at these radii" }
                }
            }
            td data-label="error" { (percent(candidate.error)) }
            td data-label="noise" { (percent(candidate.noise)) }
            td data-label="bias" { (percent(candidate.bias)) }
            td data-label="time" { (human_time(candidate.seconds)) }
            td data-label="radius" { (number(candidate.radius.into())) }
            td data-label="caustics" { (number(candidate.caustic_radius.into())) }
            td data-label="light paths" { (count(candidate.light_paths)) }
            td data-label="camera paths" { (count(candidate.camera_paths)) }
        }
    }
}
