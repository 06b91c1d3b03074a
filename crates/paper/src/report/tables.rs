//! Tables 1 and 2 beside the published ones.

use crate::implied;
use crate::published::{CAMERA_PATHS, LIGHT_PATHS, TABLE_1, TABLE_1_CAMERA_PATHS, TABLE_2};
use crate::results::Results;
use crate::tables::{Cell, find};
use bdpm_report::number::{count, fixed, shown, significant};
use bdpm_report::{header, table};
use maud::{Markup, html};

/// Table 1: RMS after the time, over that of the reference cell.
pub fn table_1(results: &Results) -> Markup {
    let reference = reference(&results.cells);
    let column = TABLE_1_CAMERA_PATHS.iter().position(|&n| n == CAMERA_PATHS[0]).unwrap_or(0);
    let printed_reference = TABLE_1[1].1[column];
    let cell = |n_light: u32, n_camera: u32, printed: f64| {
        let cell = find(&results.cells, n_light, n_camera);
        html! {
            td {
                @if let (Some(cell), Some(reference)) = (cell, reference) {
                    (shown(cell.over(reference)))
                    span .minor {
                        (fixed(cell.model_after.value / reference.model_after.value, 3)) " formula"
                    }
                }
                span .minor .paper { (fixed(printed / printed_reference, 3)) " paper" }
            }
        }
    };
    html! {
        (table("", &html! {
                    "RMS of the region after 1000 s, over that by formula and time model at N_F = 1000, "
                    "N_B = 25"
                    @if let Some(reference) = reference {
                        " (" (shown(reference.model_after)) " W/(m² sr) here, "
                        (significant(printed_reference)) " in the paper’s unknown unit)"
                    }
                    ". Each cell: from sampled noise and measured time; from formula (1) and the time "
                    "model; in the paper."
                }, &html! {
                (header(&["N_F", "N_B = 5", "N_B = 10", "N_B = 25", "N_B = 100"]))
                tbody {
                    @for (n_light, printed) in TABLE_1 {
                        tr {
                            th scope="row" { (count(n_light)) }
                            @for (n_camera, printed) in TABLE_1_CAMERA_PATHS.into_iter().zip(printed) {
                                (cell(n_light, n_camera, printed))
                            }
                        }
                    }
                }
            }))
    }
}

/// Table 2: noise and number of iterations.
pub fn table_2_noise(results: &Results) -> Markup {
    let reference = reference(&results.cells);
    let [first, ..] = TABLE_2;
    html! {
        (table("", &html! {
                    "Noise at N_B = 25: pooled RMS of one iteration; the same over its first entry, by "
                    "formula here and as printed; the mean over pixels of sampled roots, which the paper "
                    "uses, over what the formula gives; RMS after 1000 s over its first entry; "
                    "iterations in 1000 s"
                }, &html! {
                (header(&[
                    "N_F", "√V sampled, W/(m² sr)", "√V by formula", "√V over the first", "?paper",
                    "mean of roots", "?paper", "√V_T over the first", "?paper", "N_I in 1000 s", "?paper",
                ]))
                tbody {
                    @for row in TABLE_2 {
                        @if let (Some(cell), Some(reference)) =
                            (find(&results.cells, row.light_paths, CAMERA_PATHS[0]), reference) {
                            tr {
                                th scope="row" { (count(row.light_paths)) }
                                td { (shown(cell.sampled)) }
                                td { (significant(cell.formula.value)) }
                                td { (fixed(cell.formula.value / reference.formula.value, 4)) }
                                td .paper { (fixed(row.rms / first.rms, 4)) }
                                td { (shown(cell.mean_of_roots)) }
                                td .paper { (fixed(row.rms / implied(row.light_paths), 4)) }
                                td { (shown(cell.over(reference))) }
                                td .paper { (fixed(row.rms_after / first.rms_after, 2)) }
                                td { (count(cell.iterations_in_time())) }
                                td .paper { (count(row.iterations)) }
                            }
                        }
                    }
                }
            }))
    }
}

/// Table 2: the time of an iteration and of its phases.
pub fn table_2_times(results: &Results) -> Markup {
    html! {
        (table("", &html! {
                    "Time of an iteration at N_B = 25: in milliseconds here, and with the camera phase "
                    "scaled to the paper's 6 s (here | "
                    span .paper { "paper" } ")"
                }, &html! {
                (header(&[
                    "N_F", "camera, ms", "light, ms", "merge, ms", "rest, ms", "τ, ms", "light, scaled",
                    "merge, scaled", "τ, scaled",
                ]))
                tbody {
                    @for row in TABLE_2 {
                        @if let Some(cell) = find(&results.cells, row.light_paths, CAMERA_PATHS[0]) {
                            (times(cell, row.parts, row.time))
                        }
                    }
                }
            }))
    }
}

fn times(cell: &Cell, [camera, light, merge]: [f64; 3], whole: f64) -> Markup {
    let scale = camera / cell.parts[0];
    let milliseconds = |seconds: f64| fixed(1e3 * seconds, 2);
    let beside = |here: f64, paper: String| {
        html! { td { (fixed(here * scale, 2)) " | " span .paper { (paper) } } }
    };
    html! {
        tr {
            th scope="row" { (count(cell.light_paths)) }
            @for part in cell.parts { td { (milliseconds(part)) } }
            td { (milliseconds(cell.time.value)) }
            (beside(cell.parts[1], if light == 0.0 { "≈ 0".into() } else { fixed(light, 2) }))
            (beside(cell.parts[2], fixed(merge, 2)))
            (beside(cell.time.value, fixed(whole, 2)))
        }
    }
}

/// RMS of one iteration that Figure 3 implies.
fn implied(n_light: u32) -> f64 {
    implied::rms(n_light.into(), CAMERA_PATHS[0].into())
}

fn reference(cells: &[Cell]) -> Option<&Cell> {
    find(cells, LIGHT_PATHS, CAMERA_PATHS[0])
}
