//! The sections of Figures 1 to 4: pictures with their captions, and the means beside them.

use super::figures::{Figures, TERMS};
use crate::optimum::Best;
use crate::published;
use crate::published::{FIGURE_2, FIGURE_3};
use crate::results::Results;
use crate::terms::Terms;
use bdpm_auto::adaptive::optimize::NEAR_OPTIMUM;
use bdpm_report::number::{count, fixed, shown, significant};
use bdpm_report::{header, table};
use maud::{Markup, html};

pub fn figure_1(results: &Results, figures: &Figures) -> Markup {
    let file = &results.noise[0];
    let caption = html! {
        "The image after " (count(file.noise.iterations as f64)) " iterations. The boxes are the region "
        "that all means are about, “" (results.experiment.conditions.region.name) "”: "
        (results.region.len()) " pixels."
    };
    html! { div .figures { (figures.image.figure(boxes(results), &caption)) } }
}

fn boxes(results: &Results) -> &[[f64; 4]] {
    &results.experiment.conditions.region.rectangles
}

pub fn figure_2(results: &Results, figures: &Figures) -> Markup {
    let [terms, _] = &results.terms;
    let [sampled, formula] = FIGURE_2;
    html! {
        div .figures {
            (figures.rms[0].figure(boxes(results), &html! {
                "√V sampled over " (terms.iterations) " iterations. Region mean "
                (shown(terms.sampled)) " W/(m² sr); " span .paper { (sampled) " in the paper's unit" } "."
            }))
            (figures.rms[1].figure(boxes(results), &html! {
                "√V by formula (1) from the same iterations. Region mean "
                (shown(terms.formula)) " W/(m² sr); " span .paper { (formula) " in the paper's unit" } "."
            }))
            (figures.rms[2].figure(boxes(results), &html! {
                "Formula less sample. The region means have the ratio " (shown(terms.ratio)) "; "
                span .paper { (fixed(formula / sampled, 5)) " in the paper" } "."
            }))
        }
    }
}

pub fn figure_3(results: &Results, figures: &Figures) -> Markup {
    html! {
        div .figures {
            @for (picture, terms) in figures.terms.iter().zip(&results.terms) {
                (picture.figure(boxes(results), &html! {
                    "Roots of the three terms of (1) as red, green and blue on one linear scale, N_F = "
                    (terms.light_paths) ", N_B = " (terms.camera_paths) "."
                }))
            }
        }
        h3 { "The same one by one, N_B = 25" }
        div .figures {
            @for (k, picture) in figures.single.iter().enumerate() {
                (picture.figure(&[], &html! {
                    (TERMS[k])
                    @if k == 2 {
                        ": measured at N_B = 100, where it is more certain, and pooled over 5 by 5 "
                        "pixels before the root"
                    }
                    "."
                }))
            }
        }
        (table("", &html! {
                    "Region means of the roots: W/(m² sr) here; over the mean RMS here | "
                    span .paper { "paper" }
                }, &html! {
                (header(&["N_B", "C", "B", "F", "√V formula", "√V sampled"]))
                tbody {
                    @for (terms, published) in results.terms.iter().zip(FIGURE_3) {
                        (terms_row(terms, published))
                    }
                }
            }))
    }
}

fn terms_row(terms: &Terms, published: published::Terms) -> Markup {
    html! {
        tr {
            th scope="row" { (terms.camera_paths) }
            @for k in 0..3 {
                td {
                    (shown(terms.roots[k]))
                    span .minor { (shown(terms.shares[k])) }
                    span .minor .paper { (fixed(published.roots[k] / published.total, 4)) }
                    @if terms.negative[k] > 0 {
                        span .minor { (terms.negative[k]) " pixels < 0" }
                    }
                }
            }
            td { (shown(terms.formula)) }
            td { (shown(terms.sampled)) }
        }
    }
}

pub fn figure_4(results: &Results, figures: &Figures) -> Markup {
    let optima = &results.optima;
    let flat = |best: &Best| {
        html! { (count(best.flat[0])) " to " (count(best.flat[1])) }
    };
    html! {
        div .figures .wide {
            figure .plot {
                (figures.here)
                figcaption {
                    "Here: RMS over the least at N_B = 25. Curves by formula (1) and the time model from "
                    "a single run, points from noise sampled and times measured at each pair of counts, "
                    "with standard errors."
                }
            }
            figure .plot {
                (figures.published)
                figcaption {
                    "The paper: points of Table 1 with their rounding, and the curve that Figure 3a and "
                    "the times of Table 2 imply at N_B = 25."
                }
            }
        }
        (table("", &html! {
                    "The best number of light paths at N_B = 25: here; here in an image of so many "
                    "pixels that light paths take the share of the time that they take in Table 2, by "
                    "the time model; by the paper’s other numbers; and as its authors read it off"
                }, &html! {
                (header(&["", "here", &format!("{:.0}² pixels", optima.pixels.sqrt()), "?implied", "?read off"]))
                tbody {
                    tr {
                        th scope="row" { "best N_F" }
                        td { (shown(optima.here.light_paths)) }
                        td { (shown(optima.rescaled.light_paths)) }
                        td .paper { (count(optima.implied.light_paths.value)) }
                        td .paper { (count(optima.published)) }
                    }
                    tr {
                        th scope="row" { "N_F within " (100.0 * NEAR_OPTIMUM) " % of the least RMS" }
                        td { (flat(&optima.here)) } td { (flat(&optima.rescaled)) }
                        td .paper { (flat(&optima.implied)) } td {}
                    }
                    @for (k, name) in ["√(t/s), from the times", "√(p/q), from the noise"]
                        .into_iter().enumerate() {
                        tr {
                            th scope="row" { (name) }
                            td { (significant(optima.here.factors[k])) }
                            td { (significant(optima.rescaled.factors[k])) }
                            td .paper { (significant(optima.implied.factors[k])) } td {}
                        }
                    }
                }
            }))
        p {
            "An iteration takes the time t + s N_F and leaves the variance q + p/N_F; the best N_F is "
            "√(t/s) √(p/q). With N_B free as well, the least noise here is at N_F = "
            (count(optima.free.light_paths.value)) " and N_B = " (count(optima.free.camera_paths)) "."
        }
    }
}
