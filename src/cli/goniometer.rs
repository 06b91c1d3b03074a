//! `bdpm goniometer SCENE`.

use super::interrupts::catch_interrupts;
use super::outputs::{self, Attempts, Output};
use super::progress::{Progress, ProgressFormat};
use super::render::default_output;
use super::{positive_time, print_plain_notes, reported, say};
use bdpm::accel::Intersect;
use bdpm::base::atomic::write_atomically;
use bdpm::base::error::{Error, Result};
use bdpm::base::math::luminance;
use bdpm::base::photometry::LUMENS_PER_WATT;
use bdpm::image_io::digits;
use bdpm::import::luminaire_frame;
use bdpm::job;
use bdpm::light::grouped_intensities::{Estimate, Group, GroupedIntensities};
use bdpm::light::photometry::{LuminaireDescription, OpeningShape, write_eulumdat, write_lm63};
use bdpm::light::polar_plot::polar_plot;
use bdpm::light::step_blur::StepBlur;
use bdpm::load::{LoadOptions, load_with};
use bdpm::measurement::goniometer::{Goniometer, GoniometerGrid, Measured};
use bdpm::measurement::normal_loss;
use bdpm::scene::backend::{self, Backend};
use bdpm::scene::{IntensityDistribution, Scene};
use glam::DVec3;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Measuring time unless --time or --iterations is given.
const DEFAULT_TIME: Duration = Duration::from_secs(10);
/// Minimum number of iterations: fewer have no standard error that is worth its name.
const MIN_ITERATIONS: u64 = 4;

#[derive(clap::Args)]
pub struct Args {
    /// Read the model: .toml, .gltf, .glb, .obj, .xml or .pbrt, or a folder with scene.toml
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// Write the distribution as an IES file (LM-63-2002) [default: SCENE.ies]
    #[arg(long, short, value_name = "OUT.ies")]
    output: Option<PathBuf>,
    /// Write the distribution as an EULUMDAT file as well
    #[arg(long, value_name = "OUT.ldt")]
    eulumdat: Option<PathBuf>,
    /// Write a polar plot as well
    #[arg(long, value_name = "OUT.svg")]
    plot: Option<PathBuf>,
    /// Measure for about this time, such as 30 (seconds) or 2m [default: 10s]
    #[arg(long, value_name = "TIME", value_parser = positive_time)]
    time: Option<Duration>,
    /// Stop after N iterations instead
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(MIN_ITERATIONS..),
          conflicts_with = "time")]
    iterations: Option<u64>,
    /// Trace NF light paths per iteration
    #[arg(long, value_name = "NF", default_value_t = 100_000,
          value_parser = clap::value_parser!(u32).range(1..))]
    light_paths: u32,
    /// Measure at multiples of this angle from the nadir, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 5.0)]
    gamma_step: f64,
    /// Measure in C planes at multiples of this angle, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 15.0)]
    c_step: f64,
    /// Take this vector as the nadir, gamma = 0 [default: 0,-1,0]
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    down: Option<DVec3>,
    /// Take the plane toward this vector as C0 [default: 1,0,0]
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    c0: Option<DVec3>,
    /// State this flux of the lamps in the files, lm [default: absolute photometry]
    #[arg(long, value_name = "LM")]
    lamp_lumen: Option<f64>,
    /// State this electric power in the files, W
    #[arg(long, value_name = "W", default_value_t = 0.0)]
    watts: f64,
    /// Refuse a scene if a part of it would be skipped
    #[arg(long)]
    strict: bool,
    /// Seed all random numbers with S
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Use this many threads, without effect on the result [default: all processors]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Intersect rays by this backend [default: embree if built with it, else bvh]
    #[arg(long, value_parser = super::settings_args::backend())]
    accel: Option<Backend>,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
    /// Show only errors
    #[arg(long, short)]
    quiet: bool,
}

fn vector(text: &str) -> std::result::Result<DVec3, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) if DVec3::new(x, y, z).is_finite() => Ok(DVec3::new(x, y, z)),
        _ => Err("give three numbers such as 0,-1,0".into()),
    }
}

/// A value with its standard error.
#[derive(Serialize)]
struct WithError {
    value: f64,
    standard_error: f64,
    unit: &'static str,
}

impl WithError {
    fn new(measured: Measured, unit: &'static str) -> Self {
        Self { value: measured.value, standard_error: measured.error, unit }
    }

    fn text(&self) -> String {
        let digits = digits(self.value, self.standard_error);
        format!("{:.digits$} ± {:.digits$} {}", self.value, self.standard_error, self.unit)
    }
}

/// Beam or field angle in two planes, degrees, with standard errors; `null` if the intensity does
/// not fall that far.
#[derive(Serialize)]
struct Angles {
    /// Share of the maximum in the plane.
    share: f64,
    c0_c180: Option<f64>,
    c0_c180_standard_error: Option<f64>,
    c90_c270: Option<f64>,
    c90_c270_standard_error: Option<f64>,
    unit: &'static str,
}

impl Angles {
    fn new(own: &GroupedIntensities, share: f64) -> Self {
        let [c0, c90] = [0.0, 90.0].map(|c| own.opening_angle(c, share));
        let value = |own: Option<Estimate>| own.map(|own| own.value);
        let error = |own: Option<Estimate>| own.map(|own| own.error);
        Self {
            share,
            c0_c180: value(c0),
            c0_c180_standard_error: error(c0),
            c90_c270: value(c90),
            c90_c270_standard_error: error(c90),
            unit: "deg",
        }
    }

    fn text(&self) -> String {
        let angle = |value: Option<f64>, error: Option<f64>| match (value, error) {
            (Some(value), Some(error)) => format!("{value:.1} ± {error:.1} degrees"),
            _ => "none".to_owned(),
        };
        let c0 = angle(self.c0_c180, self.c0_c180_standard_error);
        let c90 = angle(self.c90_c270, self.c90_c270_standard_error);
        format!("C0-C180 {c0}, C90-C270 {c90}")
    }
}

#[derive(Serialize)]
struct Distribution {
    gamma: Vec<f64>,
    c: Vec<f64>,
    angle_unit: &'static str,
    /// For each gamma the intensity in each plane.
    intensity: Vec<Vec<f64>>,
    standard_error: Vec<Vec<f64>>,
    intensity_unit: &'static str,
}

#[derive(Serialize)]
struct GoniometerReport {
    files: Vec<String>,
    iterations: u64,
    light_paths: u64,
    flux: WithError,
    /// Flux of the sources in the model, lm.
    source_flux: f64,
    /// Flux that leaves over the flux of the sources.
    light_output_ratio: WithError,
    peak: WithError,
    /// Direction of the peak: gamma and C.
    peak_direction: [f64; 2],
    beam_angle: Angles,
    field_angle: Angles,
    distribution: Distribution,
    /// What lowers the accuracy of the files.
    notes: Vec<String>,
}

pub fn run(args: &Args) -> Result<String> {
    let ies = args.output.clone().unwrap_or_else(|| default_output(&args.scene, "ies"));
    let mut files = vec![Output::new("--output", &ies, Some("ies"))];
    let others = [("--eulumdat", &args.eulumdat, "ldt"), ("--plot", &args.plot, "svg")];
    for (what, path, extension) in others {
        files.extend(path.as_ref().map(|path| Output::new(what, path, Some(extension))));
    }
    outputs::check(&files)?;
    // Written so that NaN fails.
    if !args.lamp_lumen.is_none_or(|lumen| lumen > 0.0 && lumen.is_finite()) {
        return Err(Error::new("the flux of the lamps is not above 0", "give lumens above 0"));
    }
    let axes = luminaire_frame(args.down, args.c0, 0.0)?;
    let grid = GoniometerGrid::new(args.gamma_step, args.c_step, axes)?;
    let threads = job::thread_pool(args.threads.unwrap_or(0).into())?;
    let options =
        LoadOptions { strict: args.strict, no_fallback_light: true, ..LoadOptions::default() };
    let loaded = threads.install(|| load_with(&args.scene, &options))?;
    if !args.quiet {
        say(&format!("read {}", loaded.summary));
        print_plain_notes(&loaded.warnings);
        normal_loss(&loaded.scene).iter().for_each(|note| say(&format!("note: {note}")));
    }
    outputs::spare_inputs(&files)?;
    let scene = &loaded.scene;
    let accel = threads.install(|| backend::build(args.accel.unwrap_or_default(), scene))?;
    let measurement = threads.install(|| measure(args, scene, &*accel, grid))?;
    let own = measurement.distribution();
    write_files(args, &ies, &own, &scene.name)?;
    let files = files.iter().map(|file| file.path.display().to_string()).collect();
    let source = f64::from(luminance(scene.lights().power())) * f64::from(LUMENS_PER_WATT);
    let mut report = report(&measurement, source, files, args.light_paths);
    report.notes.extend(step_note(args, &measurement));
    if !args.quiet {
        report.notes.iter().for_each(|note| say(&format!("note: {note}")));
    }
    Ok(reported((args.json, args.quiet), &report, || report.text()))
}

/// A note if the steps are too coarse for the beam.
fn step_note(args: &Args, measurement: &Goniometer) -> Option<String> {
    let nodes = measurement.intensities();
    let values: Vec<f64> = nodes.iter().map(|node| node.value).collect();
    let greatest = nodes.iter().max_by(|a, b| a.value.total_cmp(&b.value))?;
    let blur = StepBlur::new(measurement.planes().len(), &values);
    blur.note([args.gamma_step, args.c_step], greatest.error / greatest.value)
}

/// Measures until the time is over, or for the given number of iterations.
fn measure(
    args: &Args,
    scene: &Scene,
    accel: &dyn Intersect,
    grid: GoniometerGrid,
) -> Result<Goniometer> {
    let mut measurement = Goniometer::new(scene, grid, args.seed, args.light_paths)
        .map_err(|error| error.at(&args.scene))?;
    let interrupted = catch_interrupts(Progress::new(ProgressFormat::Nothing))?;
    let start = Instant::now();
    let time = args.time.unwrap_or(DEFAULT_TIME);
    loop {
        measurement.iterate(scene, accel);
        let done = measurement.iterations();
        let is_last = match args.iterations {
            Some(iterations) => done >= iterations,
            None => done >= MIN_ITERATIONS && start.elapsed() >= time,
        };
        if is_last {
            break;
        }
        if interrupted.load(Ordering::Relaxed) {
            let advice = "let it finish, or shorten it with --time";
            return Err(Error::new("interrupted: nothing was written", advice));
        }
    }
    Ok(measurement)
}

/// Writes the measured distribution to all requested files.
fn write_files(args: &Args, ies: &Path, own: &IntensityDistribution, name: &str) -> Result<()> {
    let about = LuminaireDescription {
        name: name.to_owned(),
        origin: format!("bdpm {}, goniometer", env!("CARGO_PKG_VERSION")),
        opening: OpeningShape::Point,
        lamp_lumens: args.lamp_lumen,
        watts: args.watts,
    };
    let mut attempts = Attempts::default();
    let write =
        |path: &Path, text: String| write_atomically(path, |to| to.write_all(text.as_bytes()));
    attempts.add(ies, || write(ies, write_lm63(own, &about)));
    if let Some(path) = &args.eulumdat {
        attempts.add(path, || write(path, write_eulumdat(own, &about)?));
    }
    if let Some(path) = &args.plot {
        attempts.add(path, || write(path, polar_plot(own, name)));
    }
    attempts.finish()
}

fn report(
    measurement: &Goniometer,
    source_flux: f64,
    files: Vec<String>,
    light_paths: u32,
) -> GoniometerReport {
    let (gamma, c) = (measurement.gammas(), measurement.planes());
    let nodes = measurement.intensities();
    let table = |value: fn(&Measured) -> f64| {
        nodes.chunks(c.len()).map(|row| row.iter().map(value).collect()).collect()
    };
    let groups = measurement.groups().into_iter();
    let groups = groups.map(|(iterations, values)| Group { weight: iterations as f64, values });
    let own = GroupedIntensities::new(c.len(), groups.collect());
    let (peak, index) = (own.peak(), own.peak_node());
    let peak = Measured { value: peak.value, error: peak.error };
    let flux = measurement.flux();
    let ratio = Measured { value: flux.value / source_flux, error: flux.error / source_flux };
    GoniometerReport {
        files,
        iterations: measurement.iterations(),
        light_paths: measurement.iterations() * u64::from(light_paths),
        flux: WithError::new(flux, "lm"),
        source_flux,
        light_output_ratio: WithError::new(ratio, "1"),
        peak: WithError::new(peak, "cd"),
        peak_direction: [gamma[index / c.len()], c[index % c.len()]],
        beam_angle: Angles::new(&own, 0.5),
        field_angle: Angles::new(&own, 0.1),
        distribution: Distribution {
            intensity: table(|node| node.value),
            standard_error: table(|node| node.error),
            gamma,
            c,
            angle_unit: "deg",
            intensity_unit: "cd",
        },
        notes: Vec::new(),
    }
}

impl GoniometerReport {
    fn text(&self) -> String {
        let ratio = &self.light_output_ratio;
        let places = digits(ratio.value, ratio.standard_error);
        let [gamma, c] = self.peak_direction;
        format!(
            "flux                {}\nlight output ratio  {:.places$} ± {:.places$} of {:.1} lm\n\
             greatest intensity  {} at gamma {gamma}, C {c} degrees\nbeam angle (50 %)   {}\n\
             field angle (10 %)  {}\n{}: {} iterations, {} light paths\n",
            self.flux.text(),
            ratio.value,
            ratio.standard_error,
            self.source_flux,
            self.peak.text(),
            self.beam_angle.text(),
            self.field_angle.text(),
            self.files.join(", "),
            self.iterations,
            self.light_paths
        )
    }
}
