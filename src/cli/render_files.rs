//! The files of `bdpm render`, and the times at which they are written.

use super::image_file_args::ImageFileArgs;
use super::outputs::{self, Attempts, Output};
use super::preview;
use super::progress::Progress;
use super::render::Args;
use bdpm::adaptive::plan::Plan;
use bdpm::base::error::Result;
use bdpm::base::file_id::FileId;
use bdpm::image_io;
use bdpm::image_io::{DisplayWindow, ExrFormat, Image, Layer, ToneMapping, Value};
use bdpm::job::RenderState;
use bdpm::output::denoise;
use bdpm::output::denoise::Denoised;
use bdpm::output::layers::{LayerName, LayerSelection};
use bdpm::render::accumulators::SharedStatistics;
use bdpm::render::block::CombinedImage;
use bdpm::settings::Crop;
use bdpm::settings::provenance::Provenance;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Time between checkpoints.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(60);

/// Rendering time before the image is first written.
const FIRST_WRITE: Duration = Duration::from_secs(10);

/// Minimum rendering time over writing time: writing takes at most 2 % of the time.
const WRITE_SHARE: u32 = 50;

/// Time to write a pixel, assumed until a measurement replaces it.
const WRITE_PIXEL: Duration = Duration::from_nanos(200);

/// Files to write.
pub struct Outputs {
    pub exr: PathBuf,
    pub png: PathBuf,
    pub checkpoint: Option<PathBuf>,
}

impl Outputs {
    /// Checks the files before any work is done.
    pub fn new(args: &Args) -> Result<Self> {
        let (exr, checkpoint) = (args.output(), args.checkpoint.clone());
        let files = Self { png: preview::beside(&exr), exr, checkpoint };
        outputs::check(&files.all(args))?;
        Ok(files)
    }

    fn all<'a>(&'a self, args: &'a Args) -> Vec<Output<'a>> {
        let mut all = vec![
            Output::new("--output", &self.exr, Some("exr")),
            Output::new("the preview of --output", &self.png, Some("png")),
        ];
        let noise = args.noise.as_deref();
        all.extend(noise.map(|path| Output::new("--noise", path, Some("exr"))));
        let report = args.report.as_deref();
        all.extend(report.map(|path| Output::new("--report", path, Some("html"))));
        let checkpoint = self.checkpoint.as_deref();
        all.extend(checkpoint.map(|path| Output::new("--checkpoint", path, None)));
        all
    }

    /// Refuses to replace files that were read, except for the checkpoint that is continued. The preview gets another
    /// name if its file is not a preview; returns true in this case.
    pub fn spare_inputs(&mut self, args: &Args) -> Result<bool> {
        let beside = self.png.clone();
        self.png = preview::aside(&beside)?;
        let mut all = self.all(args);
        if *self.png != beside {
            outputs::check(&all)?;
        }
        let resumed = args.resume.as_deref().and_then(FileId::of);
        all.retain(|output| {
            output.what != "--checkpoint" || resumed.is_none() || FileId::of(output.path) != resumed
        });
        outputs::spare_inputs(&all)?;
        Ok(self.png != beside)
    }
}

/// Times at which files are written while a job renders.
pub struct FileSchedule {
    next_image: Duration,
    next_checkpoint: Duration,
}

impl FileSchedule {
    pub fn new(pixels: usize) -> Self {
        let next_image = FIRST_WRITE.max(WRITE_PIXEL * pixels as u32 * WRITE_SHARE);
        Self { next_image, next_checkpoint: CHECKPOINT_EVERY }
    }

    /// Writes the files that are due. A failure is only a warning, since its cause may be gone at the last write.
    pub fn write_when_due(
        &mut self,
        writer: &mut Writer,
        state: &mut RenderState,
        progress: &Progress,
    ) {
        let warn = |result: Result<()>| {
            if let Err(error) = result {
                progress.note(&format!("warning: {error}"));
            }
        };
        if state.elapsed() >= self.next_checkpoint {
            let mut attempts = Attempts::default();
            writer.save_checkpoint(state, &mut attempts);
            warn(attempts.failures());
            self.next_checkpoint = state.elapsed() + CHECKPOINT_EVERY;
        }
        if state.elapsed() >= self.next_image {
            let before = Instant::now();
            match state.denoised_preview() {
                Ok(denoised) => {
                    let mut attempts = Attempts::default();
                    writer.save_image(state, &state.image(), denoised.as_ref(), &mut attempts);
                    warn(attempts.failures());
                }
                Err(error) => warn(Err(error)),
            }
            let pause = (before.elapsed() * WRITE_SHARE).max(state.elapsed() / 2);
            self.next_image = state.elapsed() + pause;
        }
    }
}

/// Writes the files of a render, and sums up the time of writing.
pub struct Writer {
    pub outputs: Outputs,
    layers: LayerSelection,
    exr_format: ExrFormat,
    tone_mapping: ToneMapping,
    pub time: Duration,
}

impl Writer {
    pub fn new(outputs: Outputs, layers: &[LayerName], files: &ImageFileArgs) -> Self {
        Self {
            outputs,
            layers: LayerSelection::new(layers),
            exr_format: files.exr_format(),
            tone_mapping: files.tone_mapping(),
            time: Duration::ZERO,
        }
    }

    pub fn save_checkpoint(&mut self, state: &RenderState, attempts: &mut Attempts) {
        let Some(path) = &self.outputs.checkpoint else { return };
        let start = Instant::now();
        attempts.add(path, || state.checkpoint().save(path));
        self.time += start.elapsed();
    }

    /// Writes the image of a job.
    pub fn save_image(
        &mut self,
        state: &RenderState,
        image: &CombinedImage,
        denoised: Option<&Denoised>,
        attempts: &mut Attempts,
    ) {
        self.save(&state.provenance, (image, state.renderer.shared()), denoised, attempts);
    }

    /// Writes an image and its preview, which shows the denoised image if there is one.
    pub fn save(
        &mut self,
        provenance: &Provenance,
        (combined, shared): (&CombinedImage, &SharedStatistics),
        denoised: Option<&Denoised>,
        attempts: &mut Attempts,
    ) {
        let start = Instant::now();
        let (width, height) = combined.resolution();
        let pixels = combined.mean();
        let mut layers = vec![Layer::rgb("", &pixels)];
        if let Some(rms) = combined.rms() {
            layers.push(Layer { name: "rms".into(), channels: vec![("Y".into(), rms)] });
        }
        layers.extend(self.layers.layers(shared, combined, &pixels));
        layers.extend(denoised.into_iter().flat_map(denoise::layers));
        let preview = denoised.map_or(&pixels, |denoised| &denoised.image);
        let mut metadata = provenance.to_metadata();
        if let Some(error) = denoised.and_then(|denoised| denoised.error.as_ref()) {
            let error = &error.whole;
            for (name, value) in [
                ("denoised squared error", error.squared),
                ("denoised squared error's standard error", error.standard_error),
                ("denoised parts", error.folds as f64),
            ] {
                metadata.insert(name.into(), Value::Number(value));
            }
        }
        let iterations = Value::Number(combined.iterations() as f64);
        metadata.insert("iterations".into(), iterations);
        let mut image = Image { width, height, layers, metadata };
        Plan::of_blocks(combined.blocks(), combined.weights()).write_to(&mut image);
        let crop = provenance.settings.crop;
        let window = crop.map(|Crop { origin, full }| DisplayWindow { origin, size: full });
        let format = ExrFormat { window, ..self.exr_format };
        let Outputs { exr, png, .. } = &self.outputs;
        attempts.add(exr, || image_io::write_exr_as(exr, &image, format));
        let size = (width, height);
        attempts.add(png, || image_io::write_png_as(png, size, preview, self.tone_mapping));
        self.time += start.elapsed();
    }
}
