//! The table that `bdpm optimize` prints.

use super::analyze_text::with_error;
use super::human_time;
use super::optimize::OptimizeReport;
use bdpm::adaptive::optimize::Objective;
use bdpm::adaptive::optimize::compared::{CountsRow, RowName};
use bdpm::adaptive::optimize::measured::Budget;
use bdpm::adaptive::optimize::predict::Predicted;
use bdpm::timing::setup::MeasurementSetup;
use std::fmt::Write;

pub fn text(report: &OptimizeReport) -> String {
    let mut text = String::new();
    let mut line = |content: &str| {
        writeln!(text, "{}", content.trim_end()).expect("strings take everything");
    };
    match &report.region {
        Some(region) => line(&format!("region {region}; luminances in W/(m^2 sr)")),
        None => line("given coefficients, without uncertainty"),
    }
    line(&format!("minimum {} {}\n", objective(report.objective), ending(report.budget)));
    let last = match report.budget {
        Budget::Unbounded => String::new(),
        Budget::Time(time) => format!("RMS after {}", human_time(time)),
        Budget::Rms(rms) => format!("seconds to {rms:.3e}"),
    };
    line(&format!(
        "{:<26} {:>10} {:>9} {:>11} {:>12}    {:<10} {:>12}    {:<10} {:>12}",
        "", "N_F", "N_B", "seconds", "RMS", "", "relative time", "", last
    ));
    for row in &report.rows {
        line(&self::row(row));
    }
    let best = report.rows.iter().find(|row| row.name == RowName::BestUniform);
    let [first, past] = report.flat_range;
    if let Some(best) = best {
        line(&format!(
            "\nN_F from {first} to {past} cost at most 1 % more at N_B = {}",
            best.camera_paths
        ));
    }
    for row in report.rows.iter().filter(|row| row.least_camera_paths < row.most_camera_paths) {
        line(&format!(
            "N_B per pixel: {} to {}, {:.3} on average",
            row.least_camera_paths, row.most_camera_paths, row.camera_paths
        ));
    }
    if let Some(most) = report.most_light_paths {
        line(&format!("at most {most} light paths fit in the memory"));
    }
    line(
        "recommended, with relative time 1: the shortest iteration whose cost is within 1 % of the least",
    );
    line("relative time is that for the same noise; seconds and RMS are those of one iteration");
    let setup = report.times.setup.as_ref();
    let setup = setup.map_or("an unknown setup".into(), MeasurementSetup::to_string);
    let certain = if report.times.errors.is_some() { "" } else { ", without uncertainty" };
    line(&format!("\ntime of an iteration from {}, for {setup}{certain}:", report.times.from));
    line(&report.times.table);
    for written in [&report.output, &report.plot].into_iter().flatten() {
        line(written);
    }
    text
}

fn objective(objective: Objective) -> &'static str {
    match objective {
        Objective::Pooled => "pooled RMS",
        Objective::Relative => "pooled RMS relative to the luminance",
        Objective::MeanRms => "mean RMS",
        Objective::MaxRms => "RMS of the pixel at the 99.5th percentile",
    }
}

fn ending(budget: Budget) -> String {
    match budget {
        Budget::Unbounded => "after any time".into(),
        Budget::Time(time) => format!("after {}", human_time(time)),
        Budget::Rms(rms) => format!("in the least time down to {rms:.4e}"),
    }
}

fn row(row: &CountsRow) -> String {
    let name = match row.name {
        RowName::BestUniform => "best everywhere alike",
        RowName::Uniform => "  shortest within 1 %",
        RowName::PerPixel => "best for each pixel",
        RowName::OneCameraPath => "N_B = 1 with its best N_F",
        RowName::OneEach => "one path each per pixel",
    };
    let shown = |value: Predicted| with_error(value.value, value.error);
    let camera_paths = match row.camera_paths {
        whole if whole.fract() == 0.0 => format!("{whole}"),
        mean => format!("{mean:.3}"),
    };
    let last = row.rms_after.or(row.time_to_target).map_or(String::new(), shown);
    let seconds = format!("{:.4e}", row.iteration_time);
    format!(
        "{name:<26} {:>10} {camera_paths:>9} {seconds:>11} {} {} {last}",
        row.light_paths,
        shown(row.rms),
        shown(row.relative_time),
    )
}
