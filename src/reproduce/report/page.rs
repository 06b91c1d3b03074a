//! The page: sections in the order of the paper.

use super::figures::Figures;
use super::number::{count, fixed, shown, significant};
use super::plot::Marker;
use super::{summary, table, tables};
use crate::published::{FIGURE_2, FIGURE_3, TABLE_1_CAMERA_PATHS};
use crate::reproduce::folder::Identity;
use crate::reproduce::optimum::{Best, FLAT};
use crate::reproduce::results::Results;
use crate::reproduce::terms::Terms;
use maud::{DOCTYPE, Markup, PreEscaped, html};

const TITLE: &str = "Noise dependence on the number of rays: the experiment repeated";

/// All of it.
pub fn page(results: &Results, figures: &Figures) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (TITLE) }
                style { (PreEscaped(include_str!("style.css"))) }
            }
            body {
                main {
                    h1 { (TITLE) }
                    (introduction(results))
                    (summary::summary(results))
                    h2 { "Figure 1: the scene" }
                    (figure_1(results, figures))
                    h2 { "Figure 2: the noise of one iteration, sampled and by formula" }
                    (figure_2(results, figures))
                    h2 { "Figure 3: the three terms" }
                    (figure_3(results, figures))
                    h2 { "Figure 4: noise after a time" }
                    (figure_4(results, figures))
                    h2 { "Table 1: noise after 1000 s" }
                    (tables::table_1(results))
                    h2 { "Table 2: 25 camera paths per pixel" }
                    (tables::table_2_noise(results))
                    (tables::table_2_times(results))
                    h2 { "What is the same" }
                    (summary::findings(results))
                    h2 { "The paper's estimator and all pairs" }
                    (summary::estimators(results))
                    h2 { "Where the paper contradicts itself" }
                    (summary::inconsistencies(results))
                    h2 { "How this was measured" }
                    (setup(results))
                }
            }
        }
    }
}

fn introduction(results: &Results) -> Markup {
    let Identity { setup, settings, .. } = &results.experiment.identity;
    html! {
        p {
            "The paper shows that the variance of a pixel in one iteration of bidirectional photon "
            "mapping with N_F light paths and N_B camera paths per pixel is the sum of three terms "
            "(C, B and F), whose coefficients one run measures for all counts. Here its experiment is "
            "repeated with bdpm " (setup.version) ": " (results.experiment.done.len())
            " independent runs at " (settings.width) " by " (settings.height) " pixels, "
            (fixed(results.seconds / 60.0, 1)) " minutes of rendering. The paper gives no unit of "
            "light, so ratios are compared; ± are standard errors."
        }
    }
}

fn figure_1(results: &Results, figures: &Figures) -> Markup {
    let file = &results.noise[0];
    let caption = html! {
        "The image after " (count(file.noise.iterations as f64)) " iterations. The boxes are the region "
        "that all means are about, “" (results.experiment.identity.region.name) "”: "
        (results.region.len()) " pixels."
    };
    html! { div .figures { (figures.image.figure(boxes(results), &caption)) } }
}

fn boxes(results: &Results) -> &[[f64; 4]] {
    &results.experiment.identity.region.rectangles
}

fn figure_2(results: &Results, figures: &Figures) -> Markup {
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

fn figure_3(results: &Results, figures: &Figures) -> Markup {
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
                    (super::figures::TERMS[k])
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
                thead {
                    tr {
                        th scope="col" { "N_B" } th scope="col" { "C" } th scope="col" { "B" }
                        th scope="col" { "F" } th scope="col" { "√V formula" }
                        th scope="col" { "√V sampled" }
                    }
                }
                tbody {
                    @for (terms, published) in results.terms.iter().zip(FIGURE_3) {
                        (terms_row(terms, published))
                    }
                }
            }))
    }
}

fn terms_row(terms: &Terms, published: crate::published::Terms) -> Markup {
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

fn figure_4(results: &Results, figures: &Figures) -> Markup {
    let optima = &results.optima;
    let flat = |best: &Best| {
        html! { (count(best.flat[0])) " to " (count(best.flat[1])) }
    };
    html! {
        div .legend {
            @for n_camera in TABLE_1_CAMERA_PATHS {
                span { (PreEscaped(Marker(n_camera).to_string())) "N_B = " (n_camera) }
            }
            span { "◯ minimum at N_B = 25" }
        }
        div .figures .wide {
            figure .plot {
                (PreEscaped(&figures.here))
                figcaption {
                    "Here: RMS over the least at N_B = 25. Curves by formula (1) and the time model from "
                    "a single run, points from noise sampled and times measured at each pair of counts, "
                    "with standard errors."
                }
            }
            figure .plot {
                (PreEscaped(&figures.published))
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
                thead {
                    tr {
                        th {} th scope="col" { "here" }
                        th scope="col" { (fixed(optima.pixels.sqrt(), 0)) "² pixels" }
                        th scope="col" .paper { "implied" } th scope="col" .paper { "read off" }
                    }
                }
                tbody {
                    tr {
                        th scope="row" { "best N_F" }
                        td { (shown(optima.here.light_paths)) }
                        td { (shown(optima.rescaled.light_paths)) }
                        td .paper { (count(optima.implied.light_paths.value)) }
                        td .paper { (count(optima.published)) }
                    }
                    tr {
                        th scope="row" { "N_F within " (100.0 * FLAT) " % of the least RMS" }
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

fn setup(results: &Results) -> Markup {
    let Identity { setup, accel, settings, region, time_budget } = &results.experiment.identity;
    let unknown = "unknown".to_owned();
    let rectangles: Vec<String> = region.rectangles.iter().map(|r| format!("{r:?}")).collect();
    let iterations: f64 = results.experiment.done.iter().map(|done| done.iterations as f64).sum();
    let facts = [
        ("program", format!("bdpm {}, {} build", setup.version, setup.build)),
        ("intersections", accel.clone()),
        ("processor", setup.processor.clone().unwrap_or(unknown)),
        ("threads", setup.threads.to_string()),
        ("scene", format!("{}, fingerprint {}", setup.scene, setup.fingerprint)),
        ("resolution", format!("{} by {} pixels", settings.width, settings.height)),
        ("merge radius", format!("{} scene units", settings.radius)),
        ("merge vertex", settings.merge_vertex.to_string()),
        ("region", format!("{}: {}", region.name, rectangles.join(", "))),
        ("seed", settings.seed.to_string()),
        ("time", format!("{:.0} s of rendering, budget {time_budget} s", results.seconds)),
        ("iterations measured", count(iterations)),
    ];
    let settings_json = serde_json::to_string_pretty(settings).expect("plain numbers and texts");
    html! {
        dl { @for (name, value) in &facts { dt { (name) } dd { (value) } } }
        h3 { "Again" }
        pre {
            code {
                "bdpm reproduce --output DIR --resolution " (settings.width) "x" (settings.height)
                " --time-budget " (time_budget) "s --seed " (settings.seed)
                " --threads " (setup.threads)
            }
        }
        p {
            "The numbers of iterations follow from the time budget; each run's own seed is the seed plus "
            "its number. Beside this file: " code { "results.json" } " (every number here), "
            code { "table-1-and-2.csv" } ", " code { "findings.csv" } ", the noise of every pixel in "
            "three " code { ".exr" } " files for " code { "bdpm predict" }
            ", and the figures as files."
        }
        h3 { "Settings" }
        pre { code { (settings_json) } }
        h3 { "Times per path and pair" }
        pre { code { (crate::timing::report::coefficients(&results.timings)) } }
        (table("", &html! { "All runs" }, &html! {
                thead {
                    tr {
                        th scope="col" { "run" } th scope="col" { "iterations" }
                        th scope="col" { "seconds" } th scope="col" { "√V sampled, pooled, W/(m² sr)" }
                    }
                }
                tbody {
                    @for done in &results.experiment.done {
                        tr {
                            th scope="row" { (done.part.name()) }
                            td { (count(done.iterations as f64)) }
                            td { (fixed(done.seconds, 1)) }
                            td { (shown(done.rms())) }
                        }
                    }
                }
            }))
    }
}
