//! The reported error of denoised images beside their error against long references: the tables of
//! docs/measurements/denoising.md.
//!
//! ```sh
//! cargo run --release --example denoise_table -- scenes/cornell-box scenes/materials
//! cargo run --release --example denoise_table -- scenes/cornell-box --program target/release/bdpm --times 2s,8s,30s
//! ```
//!
//! What is done is kept in `--folder`: a run that was stopped goes on where it was, and what is there is not made
//! again. The first table renders at the scene's own counts. The second and third run the program; their reference
//! is two long renders at a third of the radii that it chose for the first image.

#[path = "../tests/common/denoised.rs"]
mod denoised;

use bdpm::base::error::{Error, Result};
use bdpm::base::math::{Rgb, luminance};
use bdpm::image_io::{Layer, read_exr};
use bdpm::import::load;
use bdpm::noise::Measure;
use bdpm::output::checkpoint::Checkpoint;
use bdpm::output::denoise::{Oidn, importance};
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::PartialSettings;
use bdpm::settings::provenance::Provenance;
use bdpm::{Renderer, Settings};
use clap::Parser;
use denoised::{Found, Reference, compare};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Instant;

/// Compares the reported error of denoised images with the measured one.
#[derive(Parser)]
struct Args {
    /// Scenes: files, or folders that hold scene.toml
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Pixels across
    #[arg(long, default_value_t = 96)]
    side: u32,
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
            "| scene | iterations | raw | denoised | mixed | reported/measured (7/8) | standard errors off | z^2 of blocks |"
        );
        println!("|---|---|---|---|---|---|---|---|");
    } else {
        println!(
            "| scene | asked | time | raw, measured | reported | denoised, measured | reported |"
        );
        println!("|---|---|---|---|---|---|---|");
    }
    for scene in &args.scenes {
        if args.times.is_empty() && args.targets.is_empty() {
            errors(&args, scene)?;
        } else {
            by_program(&args, scene)?;
        }
    }
    Ok(())
}

/// A line of a table, made only where it is not kept.
fn kept(args: &Args, name: &str, make: impl FnOnce() -> Result<String>) -> Result<()> {
    let path = args.folder.join(format!("{name}.md"));
    let line = match fs::read_to_string(&path) {
        Ok(line) => line,
        Err(_) => {
            let line = make()?;
            fs::write(&path, &line).map_err(|e| Error::io("write", &path, e))?;
            line
        }
    };
    println!("{line}");
    Ok(())
}

fn prepare(args: &Args, path: &Path) -> Result<(Arc<bdpm::Scene>, Settings)> {
    let loaded = load(path)?;
    let [width, height] = loaded.defaults.resolution.unwrap_or([1, 1]);
    let resolution = Some([args.side, (args.side * height / width).max(1)]);
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
        kept(args, &format!("{}-{}-{iterations}", scene.name, args.side), || {
            let reference = reference(args, &scene, &settings, most * args.reference)?;
            let accel = build(Backend::default(), &scene)?;
            let mut oidn = Oidn::new(rayon::current_num_threads())?;
            let found = compare(&scene, &accel, &settings, iterations, (&reference, &mut oidn));
            let Found { raw, unmixed, mixed, measured, reported, error, z2, blocks, share } = found;
            Ok(format!(
                "| {} | {iterations} | {raw:.2e} | {unmixed:.2e} | {mixed:.2e} ({:.0} % raw) | {:.2} +- {:.2} | {:+.1} | {z2:.2} ({blocks}) |",
                scene.name,
                100.0 * share,
                reported / measured,
                error / measured,
                (reported - measured) / error
            ))
        })?;
    }
    Ok(())
}

/// A render by the program: its report, and the seconds that it took with all that it prepares.
fn run(args: &Args, path: &Path, exr: &Path, options: &[&str]) -> Result<(serde_json::Value, f64)> {
    let start = Instant::now();
    let mut command = Command::new(&args.program);
    command.arg("render").arg(path).arg("--output").arg(exr).args(["--quiet", "--json"]);
    if let Some(threads) = args.threads {
        command.args(["--threads", &threads.to_string()]);
    }
    let output = command.args(options).output();
    let output = output.map_err(|e| Error::io("run", &args.program, e))?;
    let seconds = start.elapsed().as_secs_f64();
    let report = serde_json::from_slice(&output.stdout).map_err(|e| {
        let said = String::from_utf8_lossy(&output.stderr);
        Error::new(format!("{e}: {said}"), "see what the program says").at(exr)
    })?;
    Ok((report, seconds))
}

fn colors(exr: &Path, layer: &str) -> Result<Option<Vec<Rgb>>> {
    Ok(read_exr(exr)?.layer(layer).and_then(Layer::to_rgb))
}

/// The mean of two long renders at a third of the radii of `chosen`, whose merge bias is a ninth; with weights of the
/// squared errors by its luminance.
fn long_renders(
    args: &Args,
    path: &Path,
    (name, size): (&str, &str),
    chosen: &serde_json::Value,
) -> Result<(Reference, Vec<f64>)> {
    let mut images = Vec::new();
    for seed in ["1000003", "1000004"] {
        let exr = args.folder.join(format!("{name}-{size}-reference-{seed}.exr"));
        if !exr.exists() {
            let third = |radius: &str| (chosen[radius].as_f64().unwrap_or(0.0) / 3.0).to_string();
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
    let luminance_of = |value: &Rgb| f64::from(luminance(*value));
    // Variance of the mean of two renders, by their difference.
    let variance = one.iter().zip(other);
    let variance = variance.map(|(a, b)| 0.25 * (luminance_of(a) - luminance_of(b)).powi(2));
    let reference = Reference {
        luminance: mean.iter().map(luminance_of).collect(),
        variance: variance.collect(),
    };
    Ok((reference, importance(&mean)))
}

/// Errors of what the program rendered, raw and denoised.
fn by_program(args: &Args, path: &Path) -> Result<()> {
    let (scene, settings) = prepare(args, path)?;
    let size = format!("{}x{}", settings.width, settings.height);
    let asked = args.times.iter().map(|time| ("--time", time));
    let asked = asked.chain(args.targets.iter().map(|error| ("--target-error", error)));
    for (option, value) in asked {
        for denoise in [&["--denoise"][..], &[]] {
            if denoise.is_empty() && option == "--time" {
                continue; // The raw image is in the same file.
            }
            let kind = if denoise.is_empty() { "raw" } else { "denoised" };
            let name = format!("{}-{size}{option}-{value}-{kind}", scene.name);
            kept(args, &name, || {
                let exr = args.folder.join(format!("{name}.exr"));
                let options = [&["--resolution", &size, option, value][..], denoise].concat();
                let (report, seconds) = run(args, path, &exr, &options)?;
                let names = (&scene.name[..], &size[..]);
                let (reference, weights) = long_renders(args, path, names, &report["settings"])?;
                let measured = |layer: &str| -> Result<Option<f64>> {
                    let error = |pixels: Vec<Rgb>| {
                        let lit = pixels.iter().map(|value| f64::from(luminance(*value)));
                        reference.error(lit, &weights).max(0.0).sqrt()
                    };
                    Ok(colors(&exr, layer)?.map(error))
                };
                let show = |error: Option<f64>| {
                    error.map_or(String::new(), |e| format!("{:.2} %", 100.0 * e))
                };
                Ok(format!(
                    "| {} | {value} | {seconds:.1} s | {} | {} | {} | {} |",
                    scene.name,
                    show(measured("")?),
                    show(report["error"]["total"].as_f64()),
                    show(measured("denoised")?),
                    show(report["denoised"]["total_error"].as_f64())
                ))
            })?;
        }
    }
    Ok(())
}
