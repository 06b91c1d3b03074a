//! `bdpm optimize NOISE.exr`.

use super::optimize_plot::plot;
use super::optimize_text::text;
use super::outputs::{self, Attempts, Output};
use super::predict::{Times, coefficients};
use super::settings_args::{OBJECTIVE, word};
use super::{json, positive_time};
use bdpm::Settings;
use bdpm::adaptive::optimize::NEAR_OPTIMUM;
use bdpm::adaptive::optimize::Objective;
use bdpm::adaptive::optimize::compared::{ComparedCounts, CountsRow};
use bdpm::adaptive::optimize::measured::{Budget, MeasuredProblem};
use bdpm::adaptive::optimize::predict::Source;
use bdpm::adaptive::plan::Plan;
use bdpm::adaptive::stopping::Target;
use bdpm::base::error::{Error, Result};
use bdpm::film::counts::Counts;
use bdpm::image_io;
use bdpm::image_io::{Image, Layer, Value};
use bdpm::noise::file::{NoiseFile, PHOTONS_PER_LIGHT_PATH};
use bdpm::noise::region;
use bdpm::render::light_paths_in;
use bdpm::settings::MAX_LIGHT_PATHS;
use bdpm::settings::provenance::Provenance;
use bdpm::timing::Timings;
use serde::Serialize;
use std::ops::RangeInclusive;
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
    /// Read the time of an iteration from this file of `bdpm calibrate` or Criterion folder
    ///
    /// The folder is target/criterion after `cargo bench --bench tau`. The file may also be a JSON
    /// object with the keys fixed, light_path, camera_path, look_up, merge_pair (seconds) and
    /// pixels.
    #[arg(long, value_name = "T.json|FOLDER")]
    timings: Option<PathBuf>,
    /// Minimize this aggregate of the variances of all pixels
    #[arg(long, default_value = "relative", value_parser = word::<Objective>(OBJECTIVE))]
    objective: Objective,
    /// Optimize this part of the image only [default: the whole image]
    ///
    /// Give a region's name in the scene file, or a rectangle in fractions of the image with the
    /// origin at the top left.
    #[arg(long, value_name = "NAME|X0,Y0,X1,Y1", allow_hyphen_values = true)]
    region: Option<String>,
    /// Optimize for this rendering time, such as 60 (seconds) or 1h, of 16 iterations or more
    #[arg(long, value_name = "TIME", value_parser = positive_time,
          conflicts_with = "target_rms")]
    time: Option<Duration>,
    /// Optimize for this RMS, with 32 iterations or more
    ///
    /// Give the root of the objective as luminance, or in percent of the region's mean luminance.
    #[arg(long, value_name = "X|X%", allow_negative_numbers = true)]
    target_rms: Option<Target>,
    /// Choose a number of camera paths for each pixel
    #[arg(long)]
    per_pixel: bool,
    /// Write a plan for `bdpm render --plan` to this file
    #[arg(long, short, value_name = "PLAN.exr")]
    output: Option<PathBuf>,
    /// Plot the RMS against the numbers of paths to this file
    #[arg(long, value_name = "PLOT.svg")]
    plot: Option<PathBuf>,
    /// Limit the light paths to this memory, such as 500MB or 2GiB
    #[arg(long, value_name = "SIZE", value_parser = memory)]
    max_memory: Option<u64>,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// The best counts and their alternatives; luminances in W/(m^2 sr).
#[derive(Serialize)]
pub struct OptimizeReport {
    pub region: Option<String>,
    pub objective: Objective,
    pub budget: Budget,
    /// Maximum of light paths that fit in the memory, if it was given.
    pub most_light_paths: Option<u32>,
    pub rows: Vec<CountsRow>,
    /// Light paths whose cost at the best uniform number of camera paths is within 1 % of the
    /// least.
    pub flat_range: [u32; 2],
    pub times: Times,
    pub output: Option<String>,
    pub plot: Option<String>,
}

pub fn run(args: &Args) -> Result<String> {
    let (from, timings) = args.checked()?;
    let file = args.file.as_deref().map(NoiseFile::read).transpose()?;
    outputs::spare_inputs(&args.outputs())?;
    let mut region_name = None;
    let pixels;
    let source = match (&file, &args.coefficients) {
        (Some(NoiseFile { noise, regions, facts, .. }), _) => {
            let fits = timings.check_fits(facts, noise.width, noise.height);
            fits.map_err(|e| e.at(from))?;
            let region = region::find(args.region.as_deref(), regions)?;
            pixels = region::pixels(&region, noise)?;
            region_name = Some(region.name);
            Source::Measured(noise, &pixels)
        }
        (None, Some(text)) => Source::Given(coefficients(text)?),
        (None, None) => unreachable!("the parser requires one of them"),
    };
    let budget = args.budget(&source)?;
    let light_paths = args.light_paths(file.as_ref())?;
    let measured = MeasuredProblem::new(source, args.objective, timings.model);
    let problem = measured.problem(light_paths.clone(), budget);
    let best = problem.uniform();
    let flat = problem.flat_range(best.camera_paths, NEAR_OPTIMUM);
    let pixels = timings.model.pixels as u32;
    let mut compared =
        ComparedCounts::new(&measured, &problem, &light_paths, pixels, args.per_pixel);
    if let Some(file) = &file {
        compared = compared.in_whole_sets(&settings(file).map_err(|e| e.at(from))?);
    }

    let times = Times::new(from, &timings);
    times.warn();
    let name = |path: &Path| path.to_string_lossy().into_owned();
    let mut attempts = Attempts::default();
    if let (Some(path), Some(file)) = (&args.output, &file) {
        attempts.add(path, || write_plan(path, file, compared.recommended()));
    }
    if let Some(path) = &args.plot {
        attempts.add(path, || plot(path, &problem, &light_paths, budget));
    }
    attempts.finish()?;
    let report = OptimizeReport {
        region: region_name,
        objective: args.objective,
        budget,
        most_light_paths: args.max_memory.map(|_| *light_paths.end()),
        rows: compared.rows(&measured, budget),
        flat_range: [*flat.start(), *flat.end()],
        times,
        output: args.output.as_deref().map(name),
        plot: args.plot.as_deref().map(name),
    };
    Ok(if args.json { json(&report) } else { text(&report) })
}

impl Args {
    fn outputs(&self) -> Vec<Output<'_>> {
        let plan = self.output.as_deref().map(|path| Output::new("--output", path, Some("exr")));
        let plot = self.plot.as_deref().map(|path| Output::new("--plot", path, Some("svg")));
        plan.into_iter().chain(plot).collect()
    }

    /// Finds problems with the arguments before any work is done.
    fn checked(&self) -> Result<(&Path, Timings)> {
        if self.file.is_none() {
            for (given, option) in [
                (self.per_pixel, "--per-pixel"),
                (self.output.is_some(), "--output"),
                (self.max_memory.is_some(), "--max-memory"),
            ] {
                if given {
                    return Err(Error::new(
                        format!(
                            "{option} needs more than coefficients: pixels, scene and settings"
                        ),
                        format!(
                            "give the .exr file that `bdpm analyze` wrote, or leave {option} out"
                        ),
                    ));
                }
            }
        }
        outputs::check(&self.outputs())?;
        let from = self.timings.as_deref().ok_or_else(|| {
            Error::new(
                "the best numbers of paths depend on how long an iteration takes",
                "measure that with `bdpm calibrate SCENE --output times.json` and give --timings \
                 times.json",
            )
        })?;
        Ok((from, Timings::load(from)?))
    }

    fn budget(&self, source: &Source) -> Result<Budget> {
        let time = self.time.map(|time| time.as_secs_f64());
        match (time, self.target_rms) {
            (Some(time), _) => Ok(Budget::Time(time)),
            (None, Some(target)) => Budget::to_target(target, source),
            (None, None) => Ok(Budget::Unbounded),
        }
    }

    /// The numbers of light paths to choose from.
    fn light_paths(&self, file: Option<&NoiseFile>) -> Result<RangeInclusive<u32>> {
        let (Some(bytes), Some(file), Some(path)) = (self.max_memory, file, &self.file) else {
            return Ok(1..=MAX_LIGHT_PATHS);
        };
        let photons = match file.facts.get(PHOTONS_PER_LIGHT_PATH) {
            Some(&Value::Number(photons)) if photons >= 0.0 => photons,
            _ => {
                return Err(Error::new(
                    "the file does not say how many photons a light path leaves",
                    "measure the noise again with bdpm analyze, or leave --max-memory out",
                )
                .at(path));
            }
        };
        let own = settings(file).map_err(|e| e.at(path))?;
        let most = light_paths_in(bytes as f64, photons, &own);
        if most < 1.0 {
            return Err(Error::new(
                format!("the image alone takes more than the {bytes} bytes of --max-memory"),
                "allow more memory, or measure at a lower --resolution",
            ));
        }
        Ok(1..=most.min(f64::from(MAX_LIGHT_PATHS)) as u32)
    }
}

/// Settings of the measured image. Its camera paths do not matter.
fn settings(file: &NoiseFile) -> Result<Settings> {
    let counts = Counts::uniform(file.noise.light_paths, 1);
    Ok(Provenance::from_metadata(&file.facts_with(&counts))?.settings)
}

/// Writes the measured image and the plan for rendering it.
fn write_plan(path: &Path, file: &NoiseFile, counts: &Counts) -> Result<()> {
    let layers = vec![Layer::rgb("", &file.pixels)];
    let (width, height) = (file.noise.width, file.noise.height);
    let mut image = Image { width, height, layers, metadata: file.facts_with(counts) };
    Plan::new(counts.clone()).write_to(&mut image);
    image_io::write_exr(path, &image)
}

/// Reads an amount of memory such as 2GiB.
fn memory(text: &str) -> std::result::Result<u64, &'static str> {
    parse_size::parse_size(text).map_err(|_| "give an amount of memory, such as 500MB or 2GiB")
}
