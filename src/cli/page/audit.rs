//! The audit of the picture: what agrees with path tracing, and a map of its squares.

use super::Snapshot;
use bdpm::job::{AuditReport, Verdict};
use bdpm::report::picture::{Colors, Picture};
use maud::{Markup, html};

/// The section; empty for pictures without an audit.
pub fn section(snapshot: &Snapshot) -> Markup {
    let report = match snapshot.report {
        Some(report) => report.audit.cloned(),
        None => snapshot.state.audit_report(),
    };
    html! {
        @if let Some(report) = report {
            section {
                h2 { "Audit" }
                p { (sentence(&report)) }
                (map(&report))
            }
        }
    }
}

fn sentence(report: &AuditReport) -> String {
    match report.verdict {
        Verdict::Differs => report.warning().unwrap_or_default().replace("\nhelp: ", ". Help: "),
        _ => report.describe() + ".",
    }
}

fn map(report: &AuditReport) -> Markup {
    let map = &report.map;
    let scores: Vec<f64> = map.scores.iter().map(|score| f64::from(*score)).collect();
    let name = ("audit", "difference between the picture and its audit");
    let colors = (Colors::Diverging, "standard errors");
    let picture = Picture::values(name, (map.width, map.height), &scores, colors);
    html! {
        div .figures .maps {
            figure .picture {
                div .pixels { (picture.image()) }
                (picture.scale())
                figcaption {
                    "Difference between the picture and path tracing, in squares of " (map.side)
                    " pixels, in standard errors. Positive squares of the picture are brighter. "
                    "Where nothing is wrong, two thirds of the squares lie within one standard error."
                }
            }
        }
    }
}
