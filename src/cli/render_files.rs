//! The files of `bdpm render`, and the times at which they are written.

use super::image_file_args::ImageFileArgs;
use super::luminance_files::{luminance_layer, record_efficacy, write_luminance};
use super::outputs::{self, Attempts, Output};
use super::progress::Progress;
use super::render::Args;
use super::{preview, say};
use bdpm::adaptive::plan::Plan;
use bdpm::base::atomic::temporary;
use bdpm::base::error::{Error, Result};
use bdpm::base::file_id::{FileId, folder};
use bdpm::base::math::Rgb;
use bdpm::image_io;
use bdpm::image_io::{DisplayWindow, ExrFormat, Image, Layer, Metadata, NOISY, ToneMapping, Value};
use bdpm::job::{AuditReport, RelativeError, RenderState, Verdict};
use bdpm::output::denoise;
use bdpm::output::denoise::Denoised;
use bdpm::output::enlarge;
use bdpm::output::layers::{LayerName, LayerSelection};
use bdpm::output::light_layers::{LIGHTS, VARIANCE};
use bdpm::output::recorded_camera::record;
use bdpm::output::recorded_error::{RecordedDenoisedError, RecordedError, record_pooled_rms};
use bdpm::output::recorded_gamut::record_gamut;
use bdpm::render::accumulators::SharedStatistics;
use bdpm::render::block::CombinedImage;
use bdpm::settings::Crop;
use bdpm::settings::provenance::Provenance;
use std::ops::Range;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Time between checkpoints by default.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(60);

/// Rendering time before the image is first written.
const FIRST_WRITE: Duration = Duration::from_secs(10);

/// Minimum rendering time over writing time: writing takes at most 2 % of the time.
const WRITE_SHARE: u32 = 50;

/// Time to write a pixel, assumed until a measurement replaces it.
pub const WRITE_PIXEL: Duration = Duration::from_nanos(750);

/// Time to write a pixel of an enlarged picture, which has no layers.
pub const WRITE_ENLARGED_PIXEL: Duration = Duration::from_nanos(220);

/// Time to write a pixel of a checkpoint, assumed until a measurement replaces it.
const CHECKPOINT_PIXEL: Duration = Duration::from_nanos(800);

/// Share of the given time after which the time of writing is estimated.
const ESTIMATE_AFTER: f64 = 0.15;

/// Share of the given time that writing must take by [`WRITE_PIXEL`] to be estimated. A lower share
/// does not matter.
const MIN_ESTIMATED: f64 = 0.005;

/// Errors that an image file states.
#[derive(Default)]
pub struct StatedErrors {
    /// Error of the image without denoising.
    pub image: Option<RelativeError>,
    /// Error of the layer `denoised`.
    pub denoised: Option<RecordedDenoisedError>,
}

/// Attribute of an enlarged picture: the size that was rendered.
pub const ENLARGED: &str = "enlarged from";

/// Files to write.
pub struct Outputs {
    pub exr: PathBuf,
    pub png: PathBuf,
    /// Luminance in false colors.
    pub false_color: Option<PathBuf>,
    pub checkpoint: Option<PathBuf>,
}

impl Outputs {
    /// Checks the files before any work is done.
    pub fn new(args: &Args) -> Result<Self> {
        let (exr, checkpoint) = (args.output(), args.checkpoint.clone());
        let false_color = args.files.false_color(&exr);
        let files = Self { png: preview::beside(&exr), exr, false_color, checkpoint };
        outputs::check(&files.all(args))?;
        Ok(files)
    }

    fn all<'a>(&'a self, args: &'a Args) -> Vec<Output<'a>> {
        let mut all = vec![
            Output::new("--output", &self.exr, Some("exr")),
            Output::new("the preview of --output", &self.png, Some("png")),
        ];
        let false_color = self.false_color.as_deref();
        all.extend(false_color.map(|path| Output::new("the file of --photometric", path, None)));
        let noise = args.noise.as_deref();
        all.extend(noise.map(|path| Output::new("--noise", path, Some("exr"))));
        let report = args.report.as_deref();
        all.extend(report.map(|path| Output::new("--report", path, Some("html"))));
        let checkpoint = self.checkpoint.as_deref();
        all.extend(checkpoint.map(|path| Output::new("--checkpoint", path, None)));
        all
    }

    /// Refuses to replace files that were read, except for the checkpoint that is continued. The
    /// preview gets another name if its file is not a preview, and a note says so.
    pub fn spare_inputs(&mut self, args: &Args) -> Result<()> {
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
        if self.png != beside && !args.session.quiet {
            let (preview, other) = (self.png.display(), beside.display());
            say(&format!("note: the preview is {preview}, since {other} is not a preview"));
        }
        Ok(())
    }
}

/// Times at which files are written while a job renders.
pub struct FileSchedule {
    next_image: Duration,
    next_checkpoint: Duration,
    /// Time between checkpoints, and until the first one.
    checkpoint_every: Duration,
    /// Rendering time at which the time of writing is estimated; `None` if it is not or was.
    next_estimate: Option<Duration>,
}

impl FileSchedule {
    /// The schedule of an image of this many pixels that ends after `time`, if that is given, and
    /// whose checkpoints are `checkpoint_every` apart [default: a minute].
    pub fn new(pixels: usize, time: Option<Duration>, checkpoint_every: Option<Duration>) -> Self {
        let assumed = WRITE_PIXEL * pixels as u32;
        let next_image = FIRST_WRITE.max(assumed * WRITE_SHARE);
        let next_estimate = time
            .filter(|time| assumed >= time.mul_f64(MIN_ESTIMATED))
            .map(|time| time.mul_f64(ESTIMATE_AFTER));
        let checkpoint_every = checkpoint_every.unwrap_or(CHECKPOINT_EVERY);
        Self { next_image, next_checkpoint: checkpoint_every, checkpoint_every, next_estimate }
    }

    /// Writes the files that are due. A failure is only a warning, since its cause may be gone at
    /// the last write.
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
            self.next_checkpoint = state.elapsed() + self.checkpoint_every;
        }
        if self.next_estimate.is_some_and(|next| state.elapsed() >= next) {
            self.next_estimate = None;
            match writer.estimate(state) {
                Ok(time) => {
                    let pixels = state.provenance.settings.pixels() as u32;
                    let checkpoint = writer
                        .outputs
                        .checkpoint
                        .as_ref()
                        .map(|_| writer.checkpoint_time.unwrap_or(CHECKPOINT_PIXEL * pixels));
                    state.reserve(time + checkpoint.unwrap_or_default());
                }
                Err(error) => warn(Err(error)),
            }
        }
        if state.elapsed() >= self.next_image {
            let before = Instant::now();
            match state.denoised_preview() {
                Ok(denoised) => {
                    let mut attempts = Attempts::default();
                    let image = state.image();
                    let mean = if denoised.is_some() { Vec::new() } else { image.mean() };
                    let preview = denoised.as_ref().map_or(&mean, |denoised| &denoised.image);
                    let shown = (&preview[..], denoised.as_ref());
                    writer.save_image(state, &image, shown, &mut attempts, StatedErrors::default());
                    warn(attempts.failures());
                }
                Err(error) if error.is_interrupt() => {} // The image is written at the end.
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
    /// Names of the only light sources, if they were chosen.
    lights: Vec<String>,
    /// Time of all files.
    pub time: Duration,
    /// Time of the latest checkpoint.
    checkpoint_time: Option<Duration>,
}

impl Writer {
    pub fn new(outputs: Outputs, layers: &[LayerName], files: &ImageFileArgs) -> Self {
        Self {
            outputs,
            layers: LayerSelection::new(layers),
            exr_format: files.exr_format(),
            tone_mapping: files.tone_mapping(),
            lights: Vec::new(),
            time: Duration::ZERO,
            checkpoint_time: None,
        }
    }

    /// States these names of light sources in images.
    #[must_use]
    pub fn with_lights(self, lights: &[String]) -> Self {
        Self { lights: lights.to_vec(), ..self }
    }

    pub fn save_checkpoint(&mut self, state: &RenderState, attempts: &mut Attempts) {
        let Some(path) = &self.outputs.checkpoint else { return };
        let start = Instant::now();
        attempts.add(path, || state.checkpoint().save(path));
        self.checkpoint_time = Some(start.elapsed());
        self.time += start.elapsed();
    }

    /// Writes the image of a job, and its relative errors if they are known. The preview is the
    /// denoised image if there is one, else the image.
    pub fn save_image(
        &mut self,
        state: &RenderState,
        image: &CombinedImage,
        shown: (&[Rgb], Option<&Denoised>),
        attempts: &mut Attempts,
        errors: StatedErrors,
    ) {
        let sums = (image, state.renderer.shared());
        state.threads().install(|| {
            let audit = state.audit_report();
            let mut facts = Metadata::from_iter(audit.iter().flat_map(audit_attributes));
            if let Some(error) = errors.image {
                RecordedError::from(error).record(&mut facts);
            }
            if let Some(error) = errors.denoised {
                error.record(&mut facts);
            }
            if !self.lights.is_empty() {
                facts.insert(LIGHTS.into(), Value::Text(self.lights.join(", ")));
            }
            record(state.camera(), &mut facts);
            record_gamut(state.renderer.scene_and_accel().0, &mut facts);
            match state.full_size {
                None => self.save((&state.provenance, facts), sums, shown, attempts),
                Some(full) => self.save_enlarged((state, facts), (shown.0, full), attempts),
            }
        });
    }

    /// Writes the picture of an image with too few pixels, enlarged to the size that was asked for.
    /// Layers, noise and path counts are those of other pixels, and left out.
    fn save_enlarged(
        &mut self,
        (state, facts): (&RenderState, Metadata),
        (shown, full): (&[Rgb], (u32, u32)),
        attempts: &mut Attempts,
    ) {
        let start = Instant::now();
        let (width, height) = state.provenance.settings.resolution();
        let mut metadata = state.provenance.to_metadata();
        metadata.extend(facts);
        metadata.insert(ENLARGED.into(), Value::Text(format!("{width}x{height}")));
        let picture = enlarge(shown, (width, height), full);
        let image = Image { width: full.0, height: full.1, layers: Vec::new(), metadata };
        let rows = |rows: Range<u32>| {
            let [first, end] = [rows.start, rows.end].map(|row| (row * full.0) as usize);
            vec![Layer::rgb("", &picture[first..end])]
        };
        self.write_files((&image, &rows), &picture, self.exr_format, attempts);
        self.time += start.elapsed();
    }

    /// Writes an image and its preview, with facts that do not follow from its sums. A merged image
    /// has none, not even its camera.
    pub fn save(
        &mut self,
        (provenance, facts): (&Provenance, Metadata),
        sums: (&CombinedImage, &SharedStatistics),
        (preview, denoised): (&[Rgb], Option<&Denoised>),
        attempts: &mut Attempts,
    ) {
        let start = Instant::now();
        let combined = sums.0;
        let (width, height) = combined.resolution();
        let mut metadata = provenance.to_metadata();
        metadata.extend(facts);
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
        if let Some((variance, _)) = combined.pooled_variance() {
            record_pooled_rms(&mut metadata, variance.sqrt());
        }
        if self.outputs.false_color.is_some() {
            record_efficacy(&mut metadata);
        }
        let layers = denoised.into_iter().flat_map(denoise::layers).collect();
        let mut image = Image { width, height, layers, metadata };
        Plan::of_blocks(combined.blocks(), combined.weights()).write_to(&mut image);
        let crop = provenance.settings.crop;
        let window = crop.map(|Crop { origin, full }| DisplayWindow { origin, size: full });
        let format = ExrFormat { window, ..self.exr_format };
        // The picture is what other programs show of the file.
        let picture = denoised.filter(|own| !own.is_raw).map(|_| preview);
        let rows = |rows| self.rows(sums, picture, rows);
        self.write_files((&image, &rows), preview, format, attempts);
        self.time += start.elapsed();
    }

    /// Writes an image whose `rows` are computed, its preview, and its luminance in false colors.
    fn write_files(
        &self,
        (image, rows): (&Image, &(dyn Fn(Range<u32>) -> Vec<Layer> + Sync)),
        preview: &[Rgb],
        format: ExrFormat,
        attempts: &mut Attempts,
    ) {
        let Outputs { exr, png, false_color, .. } = &self.outputs;
        let size = (image.width, image.height);
        // The encoder of the preview has a single thread.
        let (written, shown) = rayon::join(
            || image_io::write_exr_rows(exr, image, rows, format),
            || image_io::write_png_as(png, size, preview, self.tone_mapping),
        );
        attempts.add(exr, || written);
        attempts.add(png, || shown);
        if let Some(path) = false_color {
            attempts.add(path, || write_luminance(path, size, preview));
        }
    }

    /// Some rows of the image and of the layers that are computed from its sums. A denoised
    /// `picture` takes the place of the image, which is then a layer of its own.
    fn rows(
        &self,
        (combined, shared): (&CombinedImage, &SharedStatistics),
        picture: Option<&[Rgb]>,
        rows: Range<u32>,
    ) -> Vec<Layer> {
        let pixels = combined.mean_rows(rows.clone());
        let width = combined.resolution().0 as usize;
        let picture = picture.map(|all| &all[rows.start as usize * width..][..pixels.len()]);
        let mut layers = vec![Layer::rgb("", picture.unwrap_or(&pixels))];
        layers.extend(picture.map(|_| Layer::rgb(NOISY, &pixels)));
        if let Some(rms) = combined.rms_rows(rows.clone()) {
            layers.push(Layer { name: "rms".into(), channels: vec![("Y".into(), rms)] });
        }
        if !self.lights.is_empty()
            && let Some(variance) = combined.variance_of_rows(rows.clone())
        {
            let values = variance.into_iter().map(|own| own as f32).collect();
            layers.push(Layer { name: VARIANCE.into(), channels: vec![("Y".into(), values)] });
        }
        layers.extend(self.layers.layers(shared, combined, rows, &pixels));
        if self.outputs.false_color.is_some() {
            layers.push(luminance_layer(picture.unwrap_or(&pixels)));
        }
        layers
    }

    /// Estimates the time of [`Self::save_image`] by writing a part of the image to a temporary
    /// file beside it.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn estimate(&self, state: &RenderState) -> Result<Duration> {
        let image = state.image();
        let (width, height) = image.resolution();
        let rows = (SAMPLE_LINES * state.threads().current_num_threads() as u32).min(height);
        let first = (height - rows) / 2;
        let sums = (&image, state.renderer.shared());
        let format = self.exr_format.for_pixels(state.provenance.settings.pixels());
        let sample =
            Image { width, height: rows, layers: Vec::new(), metadata: Default::default() };
        let computed =
            |rows: Range<u32>| self.rows(sums, None, first + rows.start..first + rows.end);
        let file = temporary(&folder(&self.outputs.exr));
        let file = file.map_err(|e| Error::io("write", &self.outputs.exr, e))?;
        let path = file.path();
        state.threads().install(|| {
            // The bias correction is computed at the first use.
            let pixels = image.mean_rows(first..first + rows);
            let preview = |rows: u32| {
                let start = Instant::now();
                let pixels = &pixels[..(width * rows) as usize];
                image_io::write_png_as(path, (width, rows), pixels, self.tone_mapping)?;
                Ok(start.elapsed())
            };
            let fixed = preview(1)?;
            let start = Instant::now();
            image_io::write_exr_rows(path, &sample, &computed, format)?;
            let exr = whole_time(start.elapsed(), fixed, (rows, height));
            let channels = |layers: Vec<Layer>| layers.iter().map(|own| own.channels.len()).sum();
            let known: usize = channels(computed(0..1));
            let more = if state.denoising.is_some() { OF_DENOISED } else { 0 };
            let exr = exr.mul_f64((known + more) as f64 / known as f64);
            Ok(exr + whole_time(preview(rows)?, fixed, (rows, height)))
        })
    }
}

/// Time of a file of `height` lines, from the time of one of `rows` lines. A time `fixed` for
/// opening and closing the file does not depend on the number of lines.
fn whole_time(part: Duration, fixed: Duration, (rows, height): (u32, u32)) -> Duration {
    part.saturating_sub(fixed).mul_f64(f64::from(height) / f64::from(rows)) + fixed.min(part)
}

/// Channels that a denoised picture adds to a file: the raw image, and the layer `denoised`.
const OF_DENOISED: usize = 6;

/// Lines per thread of the sample that [`Writer::estimate`] writes: two blocks of a ZIP file.
const SAMPLE_LINES: u32 = 32;

/// Attributes of an image file about the audit of the image.
fn audit_attributes(audit: &AuditReport) -> [(String, Value); 5] {
    let verdict = match audit.verdict {
        Verdict::Agrees => "agrees",
        Verdict::Differs => "differs",
        Verdict::Unclear => "unclear",
    };
    [
        ("audit".into(), Value::Text(verdict.into())),
        ("audit squared difference".into(), Value::Number(audit.square)),
        ("audit squared difference's standard error".into(), Value::Number(audit.square_error)),
        ("audit agreement".into(), Value::Number(audit.agreement)),
        ("audit share left out".into(), Value::Number(audit.not_audited)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_of_a_file_grows_with_its_lines_but_for_opening_and_closing() {
        let ms = Duration::from_millis;
        assert_eq!(whole_time(ms(30), ms(10), (64, 2176)), ms(10 + 34 * 20));
        // The part may by chance take less than the smallest file.
        assert_eq!(whole_time(ms(8), ms(10), (64, 2176)), ms(8));
    }

    #[test]
    fn time_of_writing_is_estimated_once_if_it_matters() {
        let time = Some(Duration::from_secs(100));
        // .6 s of 100 s by the assumed time, and a tenth of that.
        let next = |pixels, time| FileSchedule::new(pixels, time, None).next_estimate;
        assert_eq!(next(1_000_000, time), Some(Duration::from_secs(15)));
        assert_eq!(next(100_000, time), None);
        assert_eq!(next(1_000_000, None), None);
    }
}
