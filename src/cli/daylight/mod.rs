//! `bdpm daylight SCENE --weather FILE.epw`: daylight of a year at the meters of a scene.

mod page;
mod tables;

use super::interrupts::catch_interrupts;
use super::outputs::{self, Attempts, Output};
use super::progress::{Progress, ProgressFormat};
use super::{human_time, json, positive_time, print, print_notes, say};
use bdpm::base::error::Result;
use bdpm::daylight::{DaylightJob, DaylightSet, DaylightYear, Thresholds};
use bdpm::import::read_meters;
use bdpm::job::thread_pool;
use bdpm::light::weather::Weather;
use bdpm::load::{LoadOptions, Loaded, load_with};
use bdpm::measurement::Estimated;
use bdpm::scene::MeterSet;
use bdpm::scene::backend::Backend;
use std::fmt::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Time between two lines about the progress.
const LINE_EVERY: Duration = Duration::from_secs(10);

#[derive(clap::Args)]
pub struct Args {
    /// Read a .toml, .gltf, .glb, .obj, .xml, .pbrt or .rad file, or a folder with scene.toml
    scene: PathBuf,
    /// Take the weather of a year from this .epw file
    #[arg(long, value_name = "FILE.epw")]
    weather: PathBuf,
    /// Measure the meters of this .csv, .toml or .pts file instead of those of the scene
    #[arg(long, value_name = "FILE")]
    meters: Option<PathBuf>,
    /// Trace paths for about this time, such as 30 (seconds) or 2m [default: 30s]
    #[arg(long, value_name = "TIME", value_parser = positive_time)]
    time: Option<Duration>,
    /// Trace this number of paths from each meter instead, rounded up to rounds of 1024
    #[arg(long, value_name = "N", conflicts_with = "time")]
    paths: Option<u64>,
    /// Turn the sky about the vertical, counterclockwise from above; at 0 north is -z
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true)]
    turn: f64,
    /// Reflect this share of daylight from the ground below the horizon, where the scene has none
    #[arg(long, value_name = "SHARE", default_value_t = 0.2, allow_negative_numbers = true)]
    ground: f64,
    /// Divide the sky into this number of patches, in which its light is even
    #[arg(long, value_name = "N", default_value = "577", value_parser = ["145", "577", "1297", "2305"])]
    sky_patches: String,
    /// Ask for this illuminance in daylight autonomy, lx
    #[arg(long, value_name = "LUX", default_value_t = 300.0, allow_negative_numbers = true)]
    autonomy: f64,
    /// Count the hours of the clock between these, on all days
    #[arg(long, value_name = "FROM-TO", default_value = "8-18", value_parser = hours)]
    occupied: [f64; 2],
    /// Write one row per meter to this file
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// Write a page with tables and maps to this file
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Start the random numbers from this seed
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
    /// Use this many threads, without effect on the result [default: all processors]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Intersect rays by this backend [default: embree if built with it, else bvh]
    #[arg(long, value_parser = super::settings_args::backend())]
    accel: Option<Backend>,
    /// Refuse a scene if a part of it would be skipped
    #[arg(long)]
    strict: bool,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
    /// Show only errors
    #[arg(long, short)]
    quiet: bool,
}

/// Divisions of the rows of sky patches with this number of patches in all.
fn division(patches: &str) -> usize {
    match patches {
        "145" => 1,
        "1297" => 3,
        "2305" => 4,
        _ => 2,
    }
}

/// Two hours of the clock, such as `8-18`.
fn hours(text: &str) -> std::result::Result<[f64; 2], String> {
    let numbers = text
        .split_once('-')
        .and_then(|(from, to)| Some([from.trim().parse().ok()?, to.trim().parse().ok()?]));
    numbers.ok_or_else(|| "give two hours of the clock, such as 8-18".to_owned())
}

/// The scene and the meters.
fn load(args: &Args) -> Result<(Loaded, Vec<MeterSet>)> {
    // Lamps do not count.
    let no_fallback_light = true;
    let options = LoadOptions { strict: args.strict, no_fallback_light, ..LoadOptions::default() };
    let loaded = load_with(&args.scene, &options)?;
    if !args.quiet {
        say(&format!("read {}", loaded.summary));
        print_notes(&loaded.warnings);
    }
    let sets = match &args.meters {
        Some(path) => read_meters(path, &loaded.scene)?,
        None => loaded.meters.clone(),
    };
    Ok((loaded, sets))
}

pub fn run(args: &Args) -> Result<String> {
    let mut files = Vec::new();
    for (what, path, extension) in [("--csv", &args.csv, "csv"), ("--report", &args.report, "html")]
    {
        files.extend(path.as_ref().map(|path| Output::new(what, path, Some(extension))));
    }
    outputs::check(&files)?;
    let weather = Weather::read(&args.weather)?;
    let threads = Arc::new(thread_pool(args.threads.unwrap_or(0).into())?);
    let (loaded, sets) = threads.install(|| load(args))?;
    outputs::spare_inputs(&files)?;
    let format = if args.quiet { ProgressFormat::Nothing } else { ProgressFormat::Text };
    let interrupted = catch_interrupts(Progress::new(format))?;
    let mut last = Duration::ZERO;
    let year = DaylightJob::new(&loaded, weather)
        .meters(sets)
        .thresholds(Thresholds { autonomy: args.autonomy, occupied: args.occupied })
        .turned(args.turn)
        .ground(args.ground)
        .division(division(&args.sky_patches))
        .time(args.time.unwrap_or(Duration::from_secs(30)))
        .paths(args.paths)
        .seed(args.seed)
        .backend(args.accel.unwrap_or_default())
        .threads(threads)
        .interrupted_by(interrupted)
        .run(|progress| {
            if format != ProgressFormat::Nothing && progress.elapsed >= last + LINE_EVERY {
                last = progress.elapsed;
                let elapsed = human_time(progress.elapsed.as_secs_f64());
                say(&format!("{elapsed}: {} paths from each meter", progress.paths));
            }
        })?;
    let mut attempts = Attempts::default();
    if let Some(path) = &args.csv {
        attempts.add(path, || tables::write_csv(path, &year));
    }
    if let Some(path) = &args.report {
        attempts.add(path, || page::write(path, &loaded.scene, args, &year));
    }
    let result = if args.json {
        json(&tables::YearReport::new(&loaded.scene.name, args, &year))
    } else {
        text(args, &year)
    };
    if let Err(error) = attempts.finish() {
        // The result is printed even if a file cannot be written.
        print(&result)?;
        return Err(error);
    }
    Ok(result)
}

/// The lines that the program prints.
fn text(args: &Args, year: &DaylightYear) -> String {
    let mut text = String::new();
    let [from, to] = args.occupied;
    let _ =
        writeln!(text, "{}: {} hours from {from} to {to} o'clock", year.place, year.occupied_hours);
    for set in &year.sets {
        for (what, value) in rows(args, set) {
            let _ = writeln!(text, "{}: {what} {value}", set.name);
        }
    }
    let time = human_time(year.time.as_secs_f64());
    let _ = writeln!(text, "{} paths from each meter, in {time}", year.paths);
    text
}

/// What is said of a set: names and values with the halves of their intervals.
fn rows(args: &Args, set: &DaylightSet) -> Vec<(String, String)> {
    let lux = args.autonomy;
    let percent = |own: &Estimated| format!("{:.1} % +- {:.1}", own.value, own.expanded);
    let mut rows = Vec::new();
    if let [point] = &set.points[..] {
        rows.push((format!("daylight autonomy DA{lux}"), percent(&point.autonomy)));
        let names = ["below 100 lx", "100 to 300 lx", "300 to 3000 lx", "above 3000 lx"];
        for (name, own) in names.iter().zip(&point.useful) {
            rows.push((format!("hours {name}"), percent(own)));
        }
        rows.push(("hours of direct sun".to_owned(), format!("{:.0}", point.sun_hours)));
        let Estimated { value, expanded } = point.irradiation;
        rows.push(("irradiation".to_owned(), format!("{value:.0} kWh/m2 +- {expanded:.0}")));
    } else {
        rows.push((
            format!("spatial daylight autonomy sDA{lux},50%"),
            percent(&set.spatial_autonomy),
        ));
        let exposure = format!("{:.1} %", set.sunlight_exposure);
        rows.push(("annual sunlight exposure ASE1000,250".to_owned(), exposure));
    }
    let Estimated { value, expanded } = set.mean;
    rows.push(("mean illuminance".to_owned(), format!("{value:.0} lx +- {expanded:.0}")));
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hours_are_two_numbers() {
        assert_eq!(hours("8-18"), Ok([8.0, 18.0]));
        assert_eq!(hours("7.5 - 12"), Ok([7.5, 12.0]));
        assert!(hours("8").is_err() && hours("a-b").is_err());
    }
}
