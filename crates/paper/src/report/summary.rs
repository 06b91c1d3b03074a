//! Comparisons with the paper, and contradictions in the paper.

use crate::findings::{Finding, Topic, Verdict};
use crate::results::Results;
use bdpm_auto::adaptive::optimize::predict::Predicted;
use bdpm_report::number::{fixed, shown, significant};
use bdpm_report::{header, table};
use maud::{Markup, html};

/// The result in a few lines.
pub fn summary(results: &Results) -> Markup {
    let of = |verdict: Verdict| results.findings.iter().filter(move |f| f.verdict == verdict);
    let count = |verdict| of(verdict).count();
    html! {
        p {
            "Of " (results.findings.len()) " quantities, "
            b .same { (count(Verdict::Same)) " are the same" } " as printed, "
            b .as-implied { (count(Verdict::AsImplied)) " are as implied" }
            " by the paper's other numbers but not as printed, "
            b .different { (count(Verdict::Different)) " are different" } ", and "
            b .uncertain { (count(Verdict::Uncertain)) " uncertain" }
            " with the errors of this run."
        }
        @for (verdict, heading) in [
            (Verdict::Different, "Different"),
            (Verdict::AsImplied, "As implied, not as printed"),
        ] {
            @if count(verdict) > 0 {
                h3 { (heading) }
                ul {
                    @for finding in of(verdict) {
                        li {
                            (finding.name) ": " (shown(finding.here)) " here, "
                            (significant(finding.printed)) " printed"
                            @if let Some(implied) = finding.implied {
                                ", " (significant(implied)) " implied"
                            }
                            ". " (sentence(&finding.reason))
                        }
                    }
                }
            }
        }
    }
}

/// All findings in tables, topic by topic.
pub fn findings(results: &Results) -> Markup {
    let topics = [Topic::Formula, Topic::Terms, Topic::Halving, Topic::LightPaths, Topic::Minimum];
    html! {
        p {
            "“Printed” is the number in the paper, “implied” follows from its other numbers by formula "
            "(1). Values are the same if they differ by no more than the tolerance and the standard error "
            "is no larger than that."
        }
        @for topic in topics {
            (table("findings cards", &html! { (topic.title()) }, &html! {
                    (header(&["*quantity", "printed", "implied", "here", "tolerance", "*verdict"]))
                    tbody {
                        @for finding in results.findings.iter().filter(|f| f.topic == topic) {
                            (row(finding))
                        }
                    }
                }))
        }
    }
}

fn row(finding: &Finding) -> Markup {
    let verdict = finding.verdict.text();
    html! {
        tr {
            th scope="row" .text { (finding.name) }
            td .paper data-label="printed" { (significant(finding.printed)) }
            td .paper data-label="implied" {
                @if let Some(implied) = finding.implied { (significant(implied)) } @else { "–" }
            }
            td data-label="here" { (shown(finding.here)) }
            td data-label="tolerance" { (finding.tolerance) }
            td .text {
                span .verdict .(verdict.replace(' ', "-")) { (verdict) }
                @if !finding.reason.is_empty() { span .minor { (sentence(&finding.reason)) } }
            }
        }
    }
}

/// Where printed numbers contradict each other.
pub fn inconsistencies(results: &Results) -> Markup {
    html! {
        p {
            "These follow from the printed numbers alone. They explain the values above that are “as "
            "implied”."
        }
        (table("findings cards", &html! {}, &html! {
                (header(&["*number", "printed", "implied", "*because"]))
                tbody {
                    @for found in &results.inconsistencies {
                        tr {
                            th scope="row" .text { (found.place) }
                            td .paper data-label="printed" { (fixed(found.printed, 5)) }
                            td .paper data-label="implied" { (fixed(found.implied, 5)) }
                            td .text { (sentence(&found.reason)) }
                        }
                    }
                }
            }))
    }
}

/// Halves beside all pairs.
pub fn estimators(results: &Results) -> Markup {
    let done = &results.experiment.done;
    let per_iteration = |index: usize| done[index].seconds / done[index].iterations as f64;
    let certain = |x: Predicted| x.error.is_some_and(|error| x.value.abs() <= 2.0 * error);
    let same = results.estimators.iter().filter(|row| certain(row.difference)).count();
    html! {
        p {
            "Both saw the same paths in the same " (done[0].iterations) " iterations. Of the "
            (results.estimators.len()) " averages, " (same) " agree within two standard errors of the "
            "difference. An iteration with halves took "
            (format!("{:.3}", per_iteration(1) / per_iteration(0)))
            " times as long as one with all pairs."
        }
        (table("", &html! {
                    "Region means in (W/(m² sr))², and the iterations that the halves need for the "
                    "accuracy of one iteration with all pairs"
                }, &html! {
                (header(&[
                    "*average", "all pairs", "halves", "difference", "iterations, single pixels",
                    "iterations, region mean",
                ]))
                tbody {
                    @for row in &results.estimators {
                        tr {
                            th scope="row" { (row.name) }
                            td { (shown(row.pairs)) }
                            td { (shown(row.halves)) }
                            td { (shown(row.difference)) }
                            td { (shown(row.per_pixel)) }
                            td { (shown(row.region)) }
                        }
                    }
                }
            }))
    }
}

/// With a capital and a full stop.
fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    letters
        .next()
        .map_or(String::new(), |first| format!("{}{}.", first.to_uppercase(), letters.as_str()))
}
