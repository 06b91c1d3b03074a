//! The page: sections in the order of the paper.

use super::figures::Figures;
use super::{sections, summary, tables};
use crate::folder::Conditions;
use crate::results::Results;
use bdpm_report::number::{count, fixed, shown};
use bdpm_report::{document, header, table};
use maud::{Markup, html};

const TITLE: &str = "Noise dependence on the number of rays: the experiment repeated";

/// All of it.
pub fn page(results: &Results, figures: &Figures) -> Markup {
    let body = html! {
        main {
            h1 { (TITLE) }
            (introduction(results))
            (summary::summary(results))
            h2 { "Figure 1: the scene" }
            (sections::figure_1(results, figures))
            h2 { "Figure 2: the noise of one iteration, sampled and by formula" }
            (sections::figure_2(results, figures))
            h2 { "Figure 3: the three terms" }
            (sections::figure_3(results, figures))
            h2 { "Figure 4: noise after a time" }
            (sections::figure_4(results, figures))
            h2 { "Table 1: noise after 1000 s" }
            (tables::table_1(results))
            h2 { "Table 2: 25 camera paths per pixel" }
            (tables::table_2_noise(results))
            (tables::table_2_times(results))
            h2 { "Comparison with the paper" }
            (summary::findings(results))
            h2 { "The paper's estimator and all pairs" }
            (summary::estimators(results))
            h2 { "Where the paper contradicts itself" }
            (summary::inconsistencies(results))
            h2 { "How this was measured" }
            (setup(results))
        }
    };
    document(TITLE, include_str!("style.css"), &html! {}, &body)
}

fn introduction(results: &Results) -> Markup {
    let Conditions { setup, settings, .. } = &results.experiment.conditions;
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

fn setup(results: &Results) -> Markup {
    let Conditions { setup, accel, settings, region, time } = &results.experiment.conditions;
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
        ("time", format!("{:.0} s of rendering, budget {time} s", results.seconds)),
        ("iterations measured", count(iterations)),
    ];
    let settings_json = serde_json::to_string_pretty(settings).expect("plain numbers and texts");
    html! {
        dl { @for (name, value) in &facts { dt { (name) } dd { (value) } } }
        h3 { "Again" }
        pre {
            code {
                "bdpm reproduce --output DIR --resolution " (settings.width) "x" (settings.height)
                " --time " (time) "s --seed " (settings.seed)
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
        pre { code { (results.timings.coefficients_table()) } }
        (table("", &html! { "All runs" }, &html! {
                (header(&["run", "iterations", "seconds", "√V sampled, pooled, W/(m² sr)"]))
                tbody {
                    @for done in &results.experiment.done {
                        tr {
                            th scope="row" { (done.measurement.name()) }
                            td { (count(done.iterations as f64)) }
                            td { (fixed(done.seconds, 1)) }
                            td { (shown(done.rms())) }
                        }
                    }
                }
            }))
    }
}
