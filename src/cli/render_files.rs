//! The files that `bdpm render` writes, and when.

use super::progress::Progress;
use super::render::Args;
use super::session::Session;
use bdpm::base::atomic::check_writable;
use bdpm::base::error::{Error, Result};
use bdpm::files::checkpoint::Checkpoint;
use bdpm::pictures;
use bdpm::pictures::{Image, Layer, Value};
use bdpm::render::Renderer;
use bdpm::render::block::Combined;
use bdpm::settings::origin::Origin;
use bdpm::steer::Steer;
use bdpm::steer::plan::Plan;
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
        let exr = args.output.clone();
        let png = exr.with_extension("png");
        check_writable(&exr, Some("exr"))?;
        check_writable(&png, Some("png"))?;
        if let Some(noise) = &args.noise {
            check_writable(noise, Some("exr"))?;
            if *noise == exr {
                return Err(Error::new(
                    "the coefficients and the image have the same name",
                    "give --noise another one",
                )
                .at(noise));
            }
        }
        if let Some(checkpoint) = &args.checkpoint {
            check_writable(checkpoint, None)?;
            if *checkpoint == exr || *checkpoint == png {
                return Err(Error::new(
                    "the checkpoint and the image have the same name",
                    "give --checkpoint another one",
                )
                .at(checkpoint));
            }
        }
        Ok(Self { exr, png, checkpoint: args.checkpoint.clone() })
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
        session: &Session,
        save_checkpoint: impl Fn(&mut Writer) -> Result<()>,
        save_image: impl Fn(&mut Writer) -> Result<()>,
    ) {
        if session.elapsed() >= self.next_checkpoint {
            warn_of_failure(&session.progress, save_checkpoint(writer));
            self.next_checkpoint = session.elapsed() + CHECKPOINT_EVERY;
        }
        if session.elapsed() >= self.next_image {
            let before = Instant::now();
            warn_of_failure(&session.progress, save_image(writer));
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
    pub origin: &'a Origin,
    pub outputs: Outputs,
    pub time: Duration,
}

impl Writer<'_> {
    pub fn save_checkpoint(
        &mut self,
        renderer: &Renderer,
        steer: &impl Steer,
        elapsed: Duration,
    ) -> Result<()> {
        let Some(path) = &self.outputs.checkpoint else { return Ok(()) };
        let start = Instant::now();
        let checkpoint = Checkpoint {
            origin: self.origin.clone(),
            blocks: Cow::Borrowed(renderer.blocks()),
            autopilot: steer.state(elapsed.as_secs_f64()),
        };
        let saved = checkpoint.save(path);
        self.time += start.elapsed();
        saved
    }

    pub fn save_image(&mut self, combined: &Combined) -> Result<()> {
        let start = Instant::now();
        let (width, height) = combined.resolution();
        let pixels = combined.mean();
        let mut layers = vec![Layer::rgb("", &pixels)];
        if let Some(rms) = combined.rms() {
            layers.push(Layer { name: "rms".into(), channels: vec![("Y".into(), rms)] });
        }
        let mut metadata = self.origin.to_metadata();
        let iterations = Value::Number(combined.iterations() as f64);
        metadata.insert("iterations".into(), iterations);
        let mut image = Image { width, height, layers, metadata };
        Plan::of_blocks(combined.blocks(), combined.weights()).write_to(&mut image);
        let saved = pictures::write_exr(&self.outputs.exr, &image).and_then(|()| {
            pictures::write_png(&self.outputs.png, width, height, &pixels).map(|_exposure| ())
        });
        self.time += start.elapsed();
        saved
    }
}
