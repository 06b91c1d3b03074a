//! The reported error of denoised images beside their error against long references: the tables of
//! docs/measurements/denoising.md.
//!
//! ```sh
//! cargo run --release --example denoise_table -- scenes/cornell-box scenes/materials
//! cargo run --release --example denoise_table -- scenes/cornell-box --program target/release/bdpm --times 2s,8s,30s
//! ```
//!
//! Results are kept in `--folder`: a run that was stopped continues, and existing results are not
//! computed again. The first table renders at the scene's own counts. The second and third run the
//! program with and without `--denoise`. Their reference is two long renders
//! `{scene}-{size}-reference-{seed}.exr` in the folder. If they are missing, they are rendered at a
//! third of the radii of the first image.

#[path = "../tests/common/denoised.rs"]
mod denoised;

use bdpm::base::error::{Error, Result};
use bdpm::base::math::{Rgb, luminance};
use bdpm::image_io::{Layer, read_exr};
use bdpm::load::load;
use bdpm::noise::Measure;
use bdpm::output::checkpoint::Checkpoint;
use bdpm::output::denoise::{Oidn, importance};
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::PartialSettings;
use bdpm::settings::provenance::Provenance;
use bdpm::{Renderer, Settings};
use clap::Parser;
use denoised::{Found, Reference, compare};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

/// Standard deviations of the normal distribution to either side that hold 90 %.
const NORMAL_90: f64 = 1.6449;

/// Compares the reported error of denoised images with the measured one.
#[derive(Parser)]
struct Args {
    /// Scenes: files, or folders that hold scene.toml
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Pixels across
    #[arg(long, default_value_t = 96)]
    side: u32,
    /// As many pixels down as across, instead of the scene's own aspect
    #[arg(long)]
    square: bool,
    /// Numbers of iterations, at the scene's own numbers of paths
    #[arg(long, value_delimiter = ',', default_value = "8,32,128")]
    iterations: Vec<u64>,
    /// Iterations of the reference, over the most of those
    #[arg(long, default_value_t = 16)]
    reference: u64,
    /// Light paths, instead of the scene's own
    #[arg(long)]
    light_paths: Option<u32>,
    /// Renders for these times by the program, instead
    #[arg(long, value_delimiter = ',')]
    times: Vec<String>,
    /// Renders to these errors by the program, instead, with and without denoising
    #[arg(long, value_delimiter = ',')]
    targets: Vec<String>,
    /// Seconds of each of the two references of those
    #[arg(long, default_value_t = 60.0)]
    reference_time: f64,
    /// Threads of the program (default: as many as processors)
    #[arg(long)]
    threads: Option<u32>,
    /// The program
    #[arg(long, default_value = "target/release/bdpm")]
    program: PathBuf,
    /// Where everything is kept
    #[arg(long, default_value = "out/denoise-table")]
    folder: PathBuf,
}

fn main() -> Result<()> {
    let args = Args::parse();
    fs::create_dir_all(&args.folder).map_err(|e| Error::io("make", &args.folder, e))?;
    if args.times.is_empty() && args.targets.is_empty() {
        println!(
            "| scene | iterations | raw | denoised | mixed | reported/measured | standard errors off | z^2 of blocks |"
        );
        println!("|---|---|---|---|---|---|---|---|");
    } else {
        println!(
            "| scene | size | asked | error without | error with | ratio | reported | deviation | denoising | time without | time with |"
        );
        println!("|---|---|---|---|---|---|---|---|---|---|---|");
    }
    let mut rows = Vec::new();
    for scene in &args.scenes {
        if args.times.is_empty() && args.targets.is_empty() {
            errors(&args, scene)?;
        } else {
            rows.extend(by_program(&args, scene)?);
        }
    }
    // The worst ratio comes first.
    rows.sort_by(|(one, _), (other, _)| other.total_cmp(one));
    rows.iter().for_each(|(_, row)| println!("{row}"));
    Ok(())
}

/// A line of a table, made only where it is not kept.
fn kept(args: &Args, name: &str, make: impl FnOnce() -> Result<String>) -> Result<String> {
    let path = args.folder.join(format!("{name}.md"));
    let line = match fs::read_to_string(&path) {
        Ok(line) => line,
        Err(_) => {
            let line = make()?;
            fs::write(&path, &line).map_err(|e| Error::io("write", &path, e))?;
            line
        }
    };
    Ok(line)
}

fn prepare(args: &Args, path: &Path) -> Result<(Arc<bdpm::Scene>, Settings)> {
    let loaded = load(path)?;
    let [width, height] = loaded.defaults.resolution.unwrap_or([1, 1]);
    let height = if args.square { args.side } else { (args.side * height / width).max(1) };
    let resolution = Some([args.side, height]);
    let wishes =
        PartialSettings { resolution, light_paths: args.light_paths, ..PartialSettings::default() };
    let settings = Settings::resolve(&wishes, &loaded.defaults, loaded.scene.size())?;
    Ok((loaded.scene, settings))
}

/// Renders the reference, or goes on with it, and keeps it.
fn reference(
    args: &Args,
    scene: &Arc<bdpm::Scene>,
    settings: &Settings,
    n: u64,
) -> Result<Reference> {
    let accel = build(Backend::default(), scene)?;
    let settings = Settings { seed: settings.seed + 1_000_003, ..settings.clone() };
    let origin = Provenance {
        version: env!("CARGO_PKG_VERSION").into(),
        scene: scene.name.clone(),
        fingerprint: scene.fingerprint(),
        backend: Backend::default().name().into(),
        settings: settings.clone(),
    };
    let path = args.folder.join(format!("{}-{}.ckpt", scene.name, args.side));
    let mut renderer = Renderer::new(scene, &accel, settings)?;
    if let Ok(mut checkpoint) = Checkpoint::load(&path) {
        renderer.resume(checkpoint.take_partial())?;
    }
    while renderer.iterations() < n {
        renderer.iterate(Measure::Off);
        if renderer.iterations() % 64 == 0 || renderer.iterations() == n {
            Checkpoint::new(origin.clone(), renderer.blocks()).save(&path)?;
        }
    }
    Ok(Reference::of(renderer.film()))
}

/// Prints the reported and the measured error at several numbers of iterations.
fn errors(args: &Args, path: &Path) -> Result<()> {
    let (scene, settings) = prepare(args, path)?;
    let most = args.iterations.iter().copied().max().unwrap_or(1);
    for &iterations in &args.iterations {
        let row = kept(args, &format!("{}-{}-{iterations}", scene.name, args.side), || {
            let reference = reference(args, &scene, &settings, most * args.reference)?;
            let accel = build(Backend::default(), &scene)?;
            let mut oidn = Oidn::new(rayon::current_num_threads())?;
            let found = compare(&scene, &accel, &settings, iterations, (&reference, &mut oidn));
            let Found { raw, unmixed, mixed, reported, error, z2, blocks, share } = found;
            Ok(format!(
                "| {} | {iterations} | {raw:.2e} | {unmixed:.2e} | {mixed:.2e} ({:.0} % raw) | {:.2} +- {:.2} | {:+.1} | {z2:.2} ({blocks}) |",
                scene.name,
                100.0 * share,
                reported / mixed,
                error / mixed,
                (reported - mixed) / error
            ))
        })?;
        println!("{row}");
    }
    Ok(())
}

/// A render by the program: its report, which is kept beside the image.
fn run(args: &Args, path: &Path, exr: &Path, options: &[&str]) -> Result<Value> {
    let kept = exr.with_extension("json");
    if !(exr.exists() && kept.exists()) {
        let mut command = Command::new(&args.program);
        command.arg("render").arg(path).arg("--output").arg(exr).args(["--quiet", "--json"]);
        if let Some(threads) = args.threads {
            command.args(["--threads", &threads.to_string()]);
        }
        let output = command.args(options).output();
        let output = output.map_err(|e| Error::io("run", &args.program, e))?;
        if !output.status.success() {
            let printed = String::from_utf8_lossy(&output.stderr);
            return Err(Error::new(printed, "read the message of the program").at(exr));
        }
        fs::write(&kept, &output.stdout).map_err(|e| Error::io("write", &kept, e))?;
    }
    let text = fs::read(&kept).map_err(|e| Error::io("read", &kept, e))?;
    serde_json::from_slice(&text)
        .map_err(|e| Error::new(e.to_string(), "remove the file and render again").at(&kept))
}

fn colors(exr: &Path, layer: &str) -> Result<Option<Vec<Rgb>>> {
    Ok(read_exr(exr)?.layer(layer).and_then(Layer::to_rgb))
}

/// Two long renders, and weights of squared errors by the luminance of their mean.
struct LongRenders {
    luminances: [Vec<f64>; 2],
    weights: Vec<f64>,
}

impl LongRenders {
    /// Reads the renders, or makes them at a third of the radii of `chosen`. Their merge bias is
    /// then a ninth.
    fn of(args: &Args, path: &Path, (name, size): (&str, &str), chosen: &Value) -> Result<Self> {
        let mut images = Vec::new();
        for seed in ["1000003", "1000004"] {
            let exr = args.folder.join(format!("{name}-{size}-reference-{seed}.exr"));
            if !exr.exists() {
                let third =
                    |radius: &str| (chosen[radius].as_f64().unwrap_or(0.0) / 3.0).to_string();
                let [radius, caustic] = ["radius", "caustic_radius"].map(third);
                let time = format!("{}s", args.reference_time);
                let options = ["--resolution", size, "--time", &time, "--seed", seed];
                let radii = ["--radius", &radius, "--caustic-radius", &caustic, "--layers", "none"];
                run(args, path, &exr, &[&options[..], &radii].concat())?;
            }
            images.extend(colors(&exr, "")?);
        }
        let [one, other] = &images[..] else {
            return Err(Error::new("a reference has no colors", "remove it and make it again"));
        };
        let mean: Vec<Rgb> = one.iter().zip(other).map(|(a, b)| 0.5 * (*a + *b)).collect();
        let luminances = [one, other]
            .map(|image| image.iter().map(|value| f64::from(luminance(*value))).collect());
        Ok(Self { luminances, weights: importance(&mean) })
    }

    /// Relative squared error of an image: the mean product of its differences to both renders,
    /// whose noise is independent and cancels.
    fn squared_error(&self, image: &[Rgb]) -> f64 {
        let [one, other] = &self.luminances;
        let references = one.iter().zip(other).zip(&self.weights);
        let term = |(value, ((a, b), weight)): (&Rgb, ((&f64, &f64), &f64))| {
            let value = f64::from(luminance(*value));
            weight * (value - a) * (value - b)
        };
        image.iter().zip(references).map(term).sum::<f64>() / image.len() as f64
    }
}

/// Rows with the delivered error with `--denoise` over that without, and this ratio.
fn by_program(args: &Args, path: &Path) -> Result<Vec<(f64, String)>> {
    let (scene, settings) = prepare(args, path)?;
    let size = format!("{}x{}", settings.width, settings.height);
    let asked = args.times.iter().map(|time| ("--time", time));
    let asked = asked.chain(args.targets.iter().map(|error| ("--target-error", error)));
    let mut rows = Vec::new();
    for (option, value) in asked {
        let name = format!("{}-{size}{option}-{value}", scene.name);
        let row = kept(args, &name, || {
            let mut measured = Vec::new();
            for (kind, denoise) in [("raw", &[][..]), ("denoised", &["--denoise"])] {
                let exr = args.folder.join(format!("{name}-{kind}.exr"));
                let options = [&["--resolution", &size, option, value][..], denoise].concat();
                let report = run(args, path, &exr, &options)?;
                let names = (&scene.name[..], &size[..]);
                let references = LongRenders::of(args, path, names, &report["settings"])?;
                let delivered = match colors(&exr, "denoised")? {
                    Some(image) => Some(image),
                    None => colors(&exr, "")?,
                };
                let squared = references.squared_error(&delivered.unwrap_or_default());
                let seconds = report["seconds"]["total"].as_f64().unwrap_or(0.0);
                measured.push((squared.max(0.0).sqrt(), report, seconds));
            }
            let [(raw, _, raw_seconds), (error, report, seconds)] = &measured[..] else {
                unreachable!("two renders")
            };
            let of_denoised = &report["denoised"];
            let reported = of_denoised["total_error"].as_f64();
            let is_raw = of_denoised.is_null() || of_denoised["is_raw"] == true;
            let reported = match is_raw {
                true => reported.or(report["error"]["total"].as_f64()),
                false => reported,
            };
            let interval = match (&of_denoised["interval"], is_raw) {
                (Value::Null, true) => &report["error"]["interval"],
                (interval, _) => interval,
            };
            let ends = interval["low"].as_f64().zip(interval["high"].as_f64());
            // The logarithm of the error is normal: theory.md (93h).
            let deviation = ends.zip(reported).map_or(String::new(), |((low, high), reported)| {
                let deviation = (high / low).ln() / (2.0 * NORMAL_90);
                format!("{:+.1}", (reported / error).ln() / deviation)
            });
            let percent = |error: f64| format!("{:.2} %", 100.0 * error);
            Ok(format!(
                "| {} | {size} | {value} | {} | {} | {:.2} | {} | {deviation} | {:.2} s{} | {raw_seconds:.1} s | {seconds:.1} s |",
                scene.name,
                percent(*raw),
                percent(*error),
                error / raw,
                reported.map_or("unknown".into(), percent),
                of_denoised["seconds"].as_f64().unwrap_or(0.0),
                if is_raw { ", raw" } else { "" },
            ))
        })?;
        let ratio = row.split('|').nth(6).and_then(|ratio| ratio.trim().parse().ok());
        rows.push((ratio.unwrap_or(f64::NAN), row));
    }
    Ok(rows)
}
