//! `bdpm predict NOISE.exr`.

use super::analyze_text::with_error;
use super::time_residuals::{largest_residual, warning};
use super::{json, positive_time, say};
use bdpm::adaptive::optimize::predict::{Optimum, Predicted, Prediction, RenderTime, Source};
use bdpm::base::error::{Error, Result};
use bdpm::noise::file::NoiseFile;
use bdpm::noise::{Coefficients, region};
use bdpm::settings::MAX_LIGHT_PATHS;
use bdpm::timing::fit::TimeErrors;
use bdpm::timing::setup::MeasurementSetup;
use bdpm::timing::{TimeModel, Timings};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

#[derive(clap::Args)]
pub struct Args {
    /// Read the noise from this file of `bdpm analyze`
    #[arg(value_name = "NOISE.exr", required_unless_present = "coefficients")]
    file: Option<PathBuf>,
    /// Use these coefficients instead of a file, without uncertainty
    #[arg(long, value_name = "a,b,f", conflicts_with_all = ["file", "region"],
          allow_hyphen_values = true)]
    coefficients: Option<String>,
    /// Predict for these numbers of light paths per iteration
    #[arg(long, value_name = "NF,...", value_delimiter = ',', required = true,
          value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_LIGHT_PATHS)))]
    light_paths: Vec<u32>,
    /// Predict for these numbers of camera paths per pixel and iteration
    #[arg(long, value_name = "NB,...", value_delimiter = ',', required = true,
          value_parser = clap::value_parser!(u32).range(1..))]
    camera_paths: Vec<u32>,
    /// Predict for this part of the image only [default: the whole image]
    ///
    /// Give a region's name in the scene file, or a rectangle in fractions of the image with the
    /// origin at the top left.
    #[arg(long, value_name = "NAME|X0,Y0,X1,Y1", allow_hyphen_values = true)]
    region: Option<String>,
    /// Read the time of an iteration from this file of `bdpm calibrate` or Criterion folder
    ///
    /// The folder is target/criterion after `cargo bench --bench tau`. The file may also be a JSON
    /// object with the keys fixed, light_path, camera_path, look_up, merge_pair (seconds) and
    /// pixels.
    #[arg(long, value_name = "T.json|FOLDER", requires = "time")]
    timings: Option<PathBuf>,
    /// Predict the noise after this rendering time, such as 1000 (seconds) or 1h
    #[arg(long, value_name = "TIME", requires = "timings", value_parser = positive_time)]
    time: Option<Duration>,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// Predicted noise, and the best counts.
#[derive(Serialize)]
struct PredictReport {
    region: Option<String>,
    /// Rendering time in seconds, if one was given.
    time: Option<f64>,
    /// Source of the time of an iteration, if a rendering time was given.
    times: Option<Times>,
    predictions: Vec<Prediction>,
    /// Best number of light paths for each given number of camera paths.
    best_light_paths: Vec<Optimum>,
    /// Best pair of counts.
    optimum: Option<Optimum>,
}

/// The time of an iteration with its errors.
#[derive(Serialize)]
pub struct Times {
    /// File or folder that was read.
    pub from: String,
    pub setup: Option<MeasurementSetup>,
    model: TimeModel,
    pub errors: Option<TimeErrors>,
    /// Largest difference between measured and fitted time over the time of the iteration.
    pub largest_residual: Option<f64>,
    #[serde(skip)]
    pub table: String,
}

impl Times {
    pub fn new(path: &Path, timings: &Timings) -> Self {
        Self {
            from: path.to_string_lossy().into_owned(),
            setup: timings.setup.clone(),
            model: timings.model,
            errors: timings.errors,
            largest_residual: largest_residual(timings),
            table: timings.coefficients_table(),
        }
    }

    /// Says that the times do not fit their model well.
    pub fn warn(&self) {
        let warning = warning(self.largest_residual);
        warning.iter().for_each(|warning| say(&format!("{}: {warning}", self.from)));
    }
}

pub fn run(args: &Args) -> Result<String> {
    let timings = args.timings.as_deref().map(Timings::load).transpose()?;
    let render = match (&timings, args.time) {
        (Some(timings), Some(time)) => {
            Some(RenderTime { model: timings.model, time: time.as_secs_f64() })
        }
        _ => None,
    };
    let mut report = match (&args.coefficients, &args.file) {
        (Some(text), _) => {
            let source = Source::Given(coefficients(text)?);
            report(args, source, None, render.as_ref())
        }
        (None, Some(path)) => {
            let NoiseFile { noise, regions, facts, .. } = NoiseFile::read(path)?;
            if let (Some(timings), Some(from)) = (&timings, &args.timings) {
                let fits = timings.check_fits(&facts, noise.width, noise.height);
                fits.map_err(|e| e.at(from))?;
            }
            let region = region::find(args.region.as_deref(), &regions)?;
            let pixels = region::pixels(&region, &noise)?;
            report(args, Source::Measured(&noise, &pixels), Some(region.name), render.as_ref())
        }
        (None, None) => unreachable!("the parser requires one of them"),
    };
    report.times = timings.zip(args.timings.as_ref()).map(|(all, from)| Times::new(from, &all));
    report.times.iter().for_each(Times::warn);
    Ok(if args.json { json(&report) } else { text(&report) })
}

/// Reads `a,b,f`.
pub fn coefficients(text: &str) -> Result<Coefficients> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|x| x.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[a, b, f]) if [a, b, f].iter().all(|x| *x >= 0.0 && x.is_finite()) => {
            Ok(Coefficients { a, b, f })
        }
        _ => Err(Error::new(
            format!("`{text}` is not a list of coefficients"),
            "give three numbers a,b,f of at least 0, such as --coefficients 3595,37.18,0.3788",
        )),
    }
}

fn report(
    args: &Args,
    source: Source,
    region: Option<String>,
    render: Option<&RenderTime>,
) -> PredictReport {
    let counts = args.light_paths.iter().flat_map(|&n_light| {
        args.camera_paths.iter().map(move |&n_camera| (f64::from(n_light), f64::from(n_camera)))
    });
    let best = |render| {
        let camera_paths = args.camera_paths.iter();
        camera_paths.map(|&n| source.best_light_paths(f64::from(n), render)).collect()
    };
    PredictReport {
        region,
        time: render.map(|render| render.time),
        times: None,
        predictions: counts.map(|(n, m)| source.predict(n, m, render)).collect(),
        best_light_paths: render.map(best).unwrap_or_default(),
        optimum: render.map(|render| source.optimum(render)),
    }
}

fn text(report: &PredictReport) -> String {
    let mut text = String::new();
    let mut line = |content: &str| {
        writeln!(text, "{}", content.trim_end()).expect("strings take everything");
    };
    match &report.region {
        Some(region) => line(&format!("region {region}; luminances in W/(m^2 sr)")),
        None => line("given coefficients, without uncertainty"),
    }
    let value = |p: Predicted| with_error(p.value, p.error);
    let mut header = format!(
        "{:>10} {:>6} {:>12}    {:<10} {:>12}    {:<10}",
        "N_F", "N_B", "pooled RMS", "", "mean RMS", ""
    );
    if let Some(time) = report.time {
        write!(header, " {:>11} {:>11} {:>12}", "tau (s)", "iterations", format!("after {time} s"))
            .expect("strings take everything");
    }
    line(&header);
    let row = |p: &Prediction| {
        let mut row = format!(
            "{:>10} {:>6} {} {}",
            format!("{:.0}", p.light_paths),
            p.camera_paths,
            value(p.pooled_rms),
            value(p.mean_rms)
        );
        if let Some(timed) = &p.timed {
            let iterations = format!("{:.1}", timed.iterations);
            let (tau, rms) = (format!("{:.6}", timed.tau), value(timed.pooled_rms));
            write!(row, " {tau:>11} {iterations:>11} {rms}").expect("strings take everything");
        }
        row
    };
    report.predictions.iter().for_each(|p| line(&row(p)));
    if let Some(optimum) = &report.optimum {
        line("\nbest number of light paths for each number of camera paths, and best of all:");
        for best in report.best_light_paths.iter().chain([optimum]) {
            let error =
                best.light_paths.error.map_or(String::new(), |e| format!("  N_F +- {e:.0}"));
            line(&format!("{}{error}", row(&best.prediction)));
        }
    }
    if let Some(Times { from, setup, errors, table, .. }) = &report.times {
        let setup = setup.as_ref().map_or("an unknown setup".into(), MeasurementSetup::to_string);
        let certain = if errors.is_some() { "" } else { ", without uncertainty" };
        line(&format!("\ntime of an iteration from {from}, for {setup}{certain}:"));
        line(table);
    }
    text
}
