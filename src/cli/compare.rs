//! `bdpm compare A B` and `bdpm compare IMAGE --scene SCENE`.

use super::interrupts::catch_interrupts;
use super::progress::{Progress, ProgressFormat};
use super::render::share;
use super::{CameraArgs, LightArgs, positive_time, print_plain_notes, say};
use bdpm::base::error::{Error, Result};
use bdpm::base::math::Rgb;
use bdpm::film::compare::{Comparison, compare};
use bdpm::image_io::read_exr;
use bdpm::job::thread_pool;
use bdpm::judge::{DEFAULT_TIME, JudgeJob, JudgeVerdict, Judgment, LEAST_PRECISION};
use bdpm::load::{LoadOptions, load_with};
use bdpm::settings::PartialSettings;
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

#[derive(clap::Args)]
pub struct Args {
    /// Compare this EXR image
    a: PathBuf,
    /// Use this EXR image as the reference, or with --scene as another seed of A
    #[arg(required_unless_present = "scene")]
    b: Option<PathBuf>,
    /// Judge whether the image of this scene is right, by an estimate of its own
    #[arg(long, value_name = "SCENE")]
    scene: Option<PathBuf>,
    /// Judge for about this time at most, such as 30 (seconds) or 5m [default: 60s]
    #[arg(long, value_name = "TIME", value_parser = positive_time, requires = "scene")]
    time: Option<Duration>,
    /// Call it right only if differences of this size are excluded [default: 5%]
    #[arg(long, value_name = "X%", value_parser = precision, requires = "scene")]
    precision: Option<f64>,
    /// Judge with this camera of a glTF or Mitsuba file [default: the first]
    #[arg(long, value_name = "NAME", requires = "scene")]
    camera: Option<String>,
    #[command(flatten)]
    camera_change: CameraArgs,
    #[command(flatten)]
    light: LightArgs,
    /// Seed the estimate with S [default: 1]
    #[arg(long, value_name = "S", requires = "scene")]
    seed: Option<u64>,
    /// Use this many threads for the estimate [default: all processors]
    #[arg(long, value_name = "T", requires = "scene")]
    #[arg(value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// A precision that a judge can reach.
fn precision(text: &str) -> Result<f64> {
    let precision = share(text)?;
    if precision < LEAST_PRECISION {
        let problem = format!("`{text}` is too small a precision");
        return Err(Error::new(problem, format!("give at least {} %", 100.0 * LEAST_PRECISION)));
    }
    Ok(precision)
}

#[derive(Serialize)]
struct CompareReport {
    a: String,
    b: String,
    #[serde(flatten)]
    comparison: Comparison,
}

#[derive(Serialize)]
struct JudgeReport {
    images: Vec<String>,
    scene: String,
    #[serde(flatten)]
    judgment: Judgment,
}

pub fn run(args: &Args) -> Result<String> {
    if let Some(scene) = &args.scene {
        return judge(args, scene);
    }
    if args.camera_change.is_given() || args.light.is_given() {
        let problem = "two images are compared, which options of a scene do not change";
        return Err(Error::new(problem, "give --scene, or leave them out"));
    }
    let b = args.b.as_ref().expect("required without --scene");
    let (a, a_size) = read(&args.a)?;
    let (reference, b_size) = read(b)?;
    let comparison = compare((&a, a_size), (&reference, b_size))?;
    if args.json {
        return Ok(super::json(&CompareReport { a: name(&args.a), b: name(b), comparison }));
    }
    Ok(text(&comparison))
}

fn name(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

fn judge(args: &Args, scene: &Path) -> Result<String> {
    let files: Vec<&PathBuf> = [Some(&args.a), args.b.as_ref()].into_iter().flatten().collect();
    let images = files.iter().map(|file| read(file)).collect::<Result<Vec<_>>>()?;
    let size = images[0].1;
    if images.iter().any(|(_, own)| *own != size) {
        let advice = "give two images of the same resolution";
        return Err(Error::new("the images differ in size", advice).at(files[1]));
    }
    let images: Vec<Vec<Rgb>> = images.into_iter().map(|(image, _)| image).collect();
    let threads = Arc::new(thread_pool(args.threads.unwrap_or(0).into())?);
    let options = args.light.options(args.camera.as_deref(), false);
    let options = LoadOptions { camera_change: args.camera_change.change(), ..options };
    let loaded = threads.install(|| load_with(scene, &options))?;
    if !args.json {
        say(&format!("read {}", loaded.summary));
        print_plain_notes(&loaded.warnings);
    }
    let format = if args.json { ProgressFormat::Nothing } else { ProgressFormat::Text };
    let interrupt = catch_interrupts(Progress::new(format))?;
    let settings = PartialSettings { seed: args.seed, ..PartialSettings::default() };
    let job = JudgeJob::new(&loaded, &images, size)?
        .settings(settings)
        .threads(threads)
        .time(args.time.unwrap_or(DEFAULT_TIME))
        .interrupted_by(interrupt);
    let job = match args.precision {
        Some(precision) => job.precision(precision),
        None => job,
    };
    let judgment = job.run(|_| {})?;
    if args.json {
        let images = files.iter().map(|file| name(file)).collect();
        return Ok(super::json(&JudgeReport { images, scene: name(scene), judgment }));
    }
    let mut text = judgment.describe();
    let notes = loaded.warnings.len();
    if judgment.verdict != JudgeVerdict::Right && notes > 0 {
        writeln!(
            text,
            "{:<19} {notes} above: parts that are read otherwise differ in the images, too",
            "notes"
        )
        .expect("strings take everything");
    }
    Ok(text)
}

fn read(path: &Path) -> Result<(Vec<Rgb>, (u32, u32))> {
    let image = read_exr(path)?;
    let rgb = image.layer("").and_then(|layer| layer.to_rgb()).ok_or_else(|| {
        Error::new("the image has no channels R, G and B", "give an RGB image").at(path)
    })?;
    Ok((rgb, (image.width, image.height)))
}

fn text(c: &Comparison) -> String {
    let or_black = |value: Option<f64>| {
        value.map_or("undefined, the reference is black".into(), |value| format!("{value:.6}"))
    };
    let [x, y] = c.max_pixel;
    let mut text = String::new();
    let mut row = |name: &str, value: String| {
        writeln!(text, "{name:<19} {value}").expect("strings take everything");
    };
    row("size", format!("{}x{} pixels", c.width, c.height));
    row("mean ratio", or_black(c.mean_ratio));
    row("RMSE", format!("{:.6e}", c.rmse));
    row("relative MSE", or_black(c.relative_mse));
    row(
        "maximum difference",
        match c.max_difference {
            0.0 => "0, the images are equal".into(),
            max => format!("{max:.6e} at pixel ({x}, {y})"),
        },
    );
    if c.non_finite_a + c.non_finite_b > 0 {
        row("non-finite pixels", format!("{} and {}, left out", c.non_finite_a, c.non_finite_b));
    }
    text
}
