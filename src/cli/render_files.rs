//! The files that `bdpm render` writes, and when.

use super::denoising;
use super::layers::Layers;
use super::outputs::{self, Attempts, Output};
use super::page::{Page, Snapshot};
use super::preview;
use super::progress::Progress;
use super::render::Args;
use super::session::Session;
use bdpm::adaptive::Steer;
use bdpm::adaptive::plan::Plan;
use bdpm::base::error::Result;
use bdpm::base::file_id::FileId;
use bdpm::image_io;
use bdpm::image_io::{Image, Layer, Value};
use bdpm::output::checkpoint::{Checkpoint, Whole};
use bdpm::output::denoise::Denoised;
use bdpm::render::Renderer;
use bdpm::render::accumulators::SharedStatistics;
use bdpm::render::block::CombinedImage;
use bdpm::scene::Region;
use bdpm::settings::provenance::Provenance;
use std::borrow::Cow;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Time between checkpoints.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(60);

/// When the image is first written while rendering goes on.
const FIRST_WRITE: Duration = Duration::from_secs(10);

/// Rendering time per time of writing, at least: writing takes at most 2 % of the time.
const WRITE_SHARE: u32 = 50;

/// Time to write a pixel, assumed until it is known.
const WRITE_PIXEL: Duration = Duration::from_nanos(200);

/// Files to write.
pub struct Outputs {
    pub exr: PathBuf,
    pub png: PathBuf,
    pub checkpoint: Option<PathBuf>,
}

impl Outputs {
    /// Finds problems with the files before any work is done.
    pub fn new(args: &Args) -> Result<Self> {
        let (exr, checkpoint) = (args.output.clone(), args.checkpoint.clone());
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

    /// Refuses to replace what was read, but for the checkpoint that is continued. The preview, which
    /// nobody gave a name, moves out of the way of what is no preview; returns whether it did.
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

/// When files are written while rendering goes on.
pub struct Schedule {
    next_image: Duration,
    next_checkpoint: Duration,
}

impl Schedule {
    pub fn new(pixels: usize) -> Self {
        let next_image = FIRST_WRITE.max(WRITE_PIXEL * pixels as u32 * WRITE_SHARE);
        Self { next_image, next_checkpoint: CHECKPOINT_EVERY }
    }

    /// A failure here may be gone at the end: only the last write must succeed.
    pub fn write_when_due(
        &mut self,
        writer: &mut Writer,
        session: &mut Session,
        save_checkpoint: impl Fn(&mut Writer, &Session, &mut Attempts),
        save_image: impl Fn(&mut Writer, &mut Session, &mut Attempts),
    ) {
        if session.elapsed() >= self.next_checkpoint {
            let mut attempts = Attempts::default();
            save_checkpoint(writer, session, &mut attempts);
            warn_of_failure(&session.progress, attempts.failures());
            self.next_checkpoint = session.elapsed() + CHECKPOINT_EVERY;
        }
        if session.elapsed() >= self.next_image {
            let before = Instant::now();
            let mut attempts = Attempts::default();
            save_image(writer, session, &mut attempts);
            warn_of_failure(&session.progress, attempts.failures());
            let pause = (before.elapsed() * WRITE_SHARE).max(session.elapsed() / 2);
            self.next_image = session.elapsed() + pause;
        }
    }
}

fn warn_of_failure(progress: &Progress, result: Result<()>) {
    if let Err(error) = result {
        progress.note(&format!("warning: {error}"));
    }
}

/// Writes the files and keeps the time that takes.
pub struct Writer<'a> {
    pub origin: &'a Provenance,
    /// The scene's.
    pub regions: &'a [Region],
    pub outputs: Outputs,
    pub page: Option<Page>,
    /// What the image is a part of, if it is.
    pub whole: Option<Whole>,
    pub layers: Layers,
    pub time: Duration,
}

impl Writer<'_> {
    pub fn save_checkpoint(
        &mut self,
        renderer: &Renderer,
        steer: &impl Steer,
        elapsed: Duration,
        attempts: &mut Attempts,
    ) {
        let Some(path) = &self.outputs.checkpoint else { return };
        let start = Instant::now();
        let checkpoint = Checkpoint {
            origin: self.origin.clone(),
            blocks: Cow::Borrowed(renderer.blocks()),
            shared: Cow::Borrowed(renderer.shared()),
            autopilot: steer.state(elapsed.as_secs_f64()),
            plan: steer.plan().cloned(),
            whole: self.whole,
            regions: self.regions.to_vec(),
        };
        attempts.add(path, || checkpoint.save(path));
        self.time += start.elapsed();
    }

    pub fn page_is_due(&self, session: &Session) -> bool {
        self.page.as_ref().is_some_and(|page| page.is_due(session.elapsed()))
    }

    /// The page while rendering goes on.
    pub fn renew_page(&mut self, moment: &Snapshot) {
        let Some(page) = &mut self.page else { return };
        let start = Instant::now();
        warn_of_failure(&moment.session.progress, page.write(moment));
        self.time += start.elapsed();
    }

    /// The image and its preview, which is of the denoised one if there is one.
    pub fn save_image(
        &mut self,
        shared: &SharedStatistics,
        combined: &CombinedImage,
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
        layers.extend(self.layers.of(shared, combined, &pixels));
        layers.extend(denoised.into_iter().flat_map(denoising::layers));
        let preview = denoised.map_or(&pixels, |denoised| &denoised.image);
        let mut metadata = self.origin.to_metadata();
        if let Some(error) = denoised.and_then(|denoised| denoised.error.as_ref()) {
            let error = &error.whole;
            for (name, value) in [
                ("denoised squared error", error.squared),
                ("denoised squared error's standard error", error.standard_error),
                ("denoised parts", error.parts as f64),
            ] {
                metadata.insert(name.into(), Value::Number(value));
            }
        }
        let iterations = Value::Number(combined.iterations() as f64);
        metadata.insert("iterations".into(), iterations);
        let mut image = Image { width, height, layers, metadata };
        Plan::of_blocks(combined.blocks(), combined.weights()).write_to(&mut image);
        let Outputs { exr, png, .. } = &self.outputs;
        attempts.add(exr, || image_io::write_exr(exr, &image));
        attempts.add(png, || image_io::write_png(png, width, height, preview));
        self.time += start.elapsed();
    }
}
