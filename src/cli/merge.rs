//! `bdpm merge PART...`.

use super::image_file_args::ImageFileArgs;
use super::outputs::{self, Attempts, Output};
use super::preview;
use super::render_files::{Outputs, Writer};
use super::render_observer::save_noise;
use super::render_report::rms_text;
use super::reported;
use super::say;
use bdpm::adaptive::optimize::Objective;
use bdpm::adaptive::stopping::importance;
use bdpm::base::error::{Error, Result};
use bdpm::image_io::Metadata;
use bdpm::output::checkpoint::Checkpoint;
use bdpm::output::merge::{Merged, merge};
use bdpm::render::block;
use bdpm::render::block::CombinedImage;
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Merge these checkpoints of `render --part` or `merge`, in any order
    #[arg(value_name = "PART", required = true)]
    parts: Vec<PathBuf>,
    /// Write the image to this file, and a PNG preview beside it
    #[arg(long, short, value_name = "OUT.exr")]
    output: PathBuf,
    #[command(flatten)]
    files: ImageFileArgs,
    /// Write the noise coefficients to this file, if the parts had --noise
    #[arg(long, value_name = "NOISE.exr")]
    noise: Option<PathBuf>,
    /// Write a checkpoint of the merged image, for `render --resume`
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// Show only errors
    #[arg(long, short)]
    quiet: bool,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// The result.
#[derive(Serialize)]
struct MergeReport {
    version: String,
    scene: String,
    /// Files that were merged.
    files: usize,
    iterations: u64,
    /// Iterations and parts that the image lacks, in words.
    missing: Vec<String>,
    /// W/(m^2 sr).
    mean_luminance: f64,
    /// Pooled RMS of the image and its standard error, W/(m^2 sr); RMS over the mean luminance.
    rms: Option<f64>,
    rms_error: Option<f64>,
    relative_rms: Option<f64>,
    exr: String,
    png: String,
    noise: Option<String>,
    checkpoint: Option<String>,
}

pub fn run(args: &Args) -> Result<String> {
    let beside = preview::beside(&args.output);
    outputs::check(&args.all_files(&beside))?;
    let Merged { checkpoint, missing, unreadable, files } = merge(&args.parts)?;
    let png = preview::aside(&beside)?;
    let all = args.all_files(&png);
    outputs::check(&all)?;
    outputs::spare_inputs(&all)?;
    let warn = |line: &str| {
        if !args.quiet {
            say(line);
        }
    };
    if png != beside {
        warn(&format!(
            "note: the preview is {}, since {} is not a preview",
            png.display(),
            beside.display()
        ));
    }
    for missing in &missing {
        warn(&format!("warning: {missing} is missing"));
    }
    let mut attempts = Attempts::default();
    let outputs = Outputs {
        exr: args.output.clone(),
        png,
        false_color: args.files.false_color(&args.output),
        checkpoint: args.checkpoint.clone(),
    };
    let image = combined(&checkpoint);
    if image.iterations() == 0 {
        return Err(Error::new("the parts hold no iteration", "render them first"));
    }
    let mut writer = Writer::new(outputs, &[], &args.files);
    let sums = (&image, &*checkpoint.shared);
    let origin = (&checkpoint.provenance, Metadata::new());
    writer.save(origin, sums, (&image.mean(), None), &mut attempts);
    if let Some(path) = &args.noise {
        attempts.add(path, || {
            let block = bdpm::job::best_measured(&checkpoint.blocks).ok_or_else(|| {
                let problem = "too few iterations were measured to estimate the noise";
                Error::new(problem, "render more iterations, or merge without --noise").at(path)
            })?;
            save_noise(path, (&checkpoint.provenance, &checkpoint.regions), block)
        });
    }
    if let Some(path) = &args.checkpoint {
        attempts.add(path, || checkpoint.save(path));
    }
    let report = MergeReport::new(args, &checkpoint, &image, files, missing, &writer.outputs.png);
    for error in unreadable {
        attempts.add(&args.output, || Err::<(), _>(error));
    }
    attempts.finish()?;
    Ok(reported((args.json, args.quiet), &report, || report.text()))
}

/// The image of all blocks, with the weights that a single run would use.
fn combined<'a>(checkpoint: &'a Checkpoint) -> CombinedImage<'a> {
    let blocks = &checkpoint.blocks[..];
    let weights = match &checkpoint.plan {
        Some(plan) => plan.weights(blocks),
        None => block::weights(blocks, &importance(blocks, Objective::Relative)),
    };
    CombinedImage::new(blocks, weights)
}

impl Args {
    fn all_files<'a>(&'a self, png: &'a Path) -> Vec<Output<'a>> {
        let mut all = vec![
            Output::new("--output", &self.output, Some("exr")),
            Output::new("the preview of --output", png, Some("png")),
        ];
        let noise = self.noise.as_deref();
        all.extend(noise.map(|path| Output::new("--noise", path, Some("exr"))));
        let checkpoint = self.checkpoint.as_deref();
        all.extend(checkpoint.map(|path| Output::new("--checkpoint", path, None)));
        all
    }
}

impl MergeReport {
    fn new(
        args: &Args,
        checkpoint: &Checkpoint,
        image: &CombinedImage,
        files: usize,
        missing: Vec<String>,
        png: &Path,
    ) -> Self {
        let name = |path: &Path| path.to_string_lossy().into_owned();
        let variance = image.pooled_variance();
        let rms = variance.map(|(variance, _)| variance.sqrt());
        let error = variance.map(|(variance, error)| 0.5 * error / variance.sqrt());
        let mean_luminance = image.mean_luminance();
        Self {
            version: checkpoint.provenance.version.clone(),
            scene: checkpoint.provenance.scene.clone(),
            files,
            iterations: image.iterations(),
            missing,
            mean_luminance,
            rms,
            rms_error: error.filter(|error| error.is_finite()),
            relative_rms: rms.map(|rms| rms / mean_luminance).filter(|share| share.is_finite()),
            exr: name(&args.output),
            png: name(png),
            noise: args.noise.as_deref().map(name),
            checkpoint: args.checkpoint.as_deref().map(name),
        }
    }

    fn text(&self) -> String {
        let rms = match (self.rms, self.relative_rms) {
            (Some(rms), Some(share)) => format!(", {}", rms_text(rms, share)),
            _ => String::new(),
        };
        format!(
            "{} and {}: {} iterations from {} files, mean luminance {:.4}{rms}\n",
            self.exr, self.png, self.iterations, self.files, self.mean_luminance
        )
    }
}
