//! Output of `bdpm render` while a job renders, and at its end.

use super::black_image;
use super::outputs::Attempts;
use super::page::{Page, Snapshot};
use super::progress::Progress;
use super::render::Args;
use super::render_files::{FileSchedule, Outputs, StatedErrors, Writer};
use super::render_report::{RenderReport, announce, text};
use super::scene_input::SceneInput;
use super::verbose;
use super::view::View;
use super::{Output, human_time, reported};
use bdpm::base::error::Result;
use bdpm::job::RenderState;
use bdpm::noise::Measure;
use bdpm::noise::file::NoiseFile;
use bdpm::render::block::Block;
use bdpm::scene::Region;
use bdpm::settings::provenance::Provenance;
use bdpm::{Event, RenderResult};
use std::ops::ControlFlow;
use std::path::Path;

/// Shows progress, and writes files when they are due.
pub struct RenderObserver<'a> {
    args: &'a Args,
    input: &'a SceneInput,
    writer: Writer,
    schedule: Option<FileSchedule>,
    page: Option<Page>,
    view: Option<View>,
    progress: Progress,
    /// Number of blocks of iterations whose path counts were reported.
    blocks: usize,
}

impl<'a> RenderObserver<'a> {
    pub fn new(
        args: &'a Args,
        input: &'a SceneInput,
        outputs: Outputs,
        progress: Progress,
    ) -> Self {
        let lights = &args.session.scene.light.lights;
        let writer = Writer::new(outputs, &args.layers, &args.files).with_lights(lights);
        let page = args.report.clone().map(Page::new);
        Self { args, input, writer, schedule: None, page, view: None, progress, blocks: 0 }
    }

    /// Reacts to an event of the job.
    pub fn observe(&mut self, event: Event) -> ControlFlow<()> {
        match event {
            Event::Warning(warning) => self.progress.note(&format!("warning: {warning}")),
            Event::Choosing(free, provenance) => {
                let subject = if free.any() { "techniques and merge radii" } else { "path counts" };
                self.progress.note(&format!("trying {subject} on a sample of the image"));
                self.announce_page(provenance);
            }
            Event::Started(state) => self.start(state),
            Event::Restarted(_) => self.blocks = 0,
            Event::Denoised(error, elapsed) => self.progress.note(&format!(
                "denoised after {}: relative error {:.2} %",
                human_time(elapsed.as_secs_f64()),
                100.0 * error.relative()
            )),
            Event::Iterated(state) => return self.iterated(state),
        }
        ControlFlow::Continue(())
    }

    fn start(&mut self, state: &RenderState) {
        let processes = match state.exchanged.ranks {
            1 => String::new(),
            ranks => format!(", {ranks} processes"),
        };
        if let Some(sharded) = state.sharded {
            let (part, assigned) = (self.args.shard_name(), state.renderer.assigned());
            self.progress
                .note(&format!("part {part}: iterations {assigned} of {}", sharded.iterations));
        }
        announce(&self.progress, state, "rendering", &processes);
        if self.args.verbose {
            let lines = verbose::at_start(self.args, self.input, state);
            lines.iter().for_each(|line| self.progress.note(line));
        }
        if state.selection.is_none() {
            self.announce_page(&state.provenance);
        }
        let name = self.args.output().to_string_lossy().into_owned();
        let target = self.args.view.as_ref();
        self.view = target.map(|target| View::new(target, &name, &self.progress));
        // Of an enlarged picture, no part tells the time of the whole.
        let time = state.stop.time.filter(|_| state.full_size.is_none());
        let pixels = state.provenance.settings.pixels();
        self.schedule = Some(FileSchedule::new(pixels, time, self.args.checkpoint_every));
        self.progress.start();
    }

    /// Writes the page before the first image. A failure is a warning, since the last write reports
    /// it as an error.
    fn announce_page(&mut self, provenance: &Provenance) {
        if let Some(page) = &mut self.page
            && let Err(error) = page.announce(self.input, provenance)
        {
            self.progress.note(&format!("warning: {error}"));
        }
    }

    fn iterated(&mut self, state: &mut RenderState) -> ControlFlow<()> {
        self.progress.update(state);
        if self.progress.is_orphan() {
            return ControlFlow::Break(());
        }
        if let Some(schedule) = &mut self.schedule {
            schedule.write_when_due(&mut self.writer, state, &self.progress);
        }
        self.note_new_counts(state);
        let elapsed = state.elapsed();
        if let Some(page) = &mut self.page
            && page.is_due(elapsed)
        {
            let snapshot =
                Snapshot { input: self.input, state, image: &state.image(), report: None };
            if let Err(error) = page.write(&snapshot) {
                self.progress.note(&format!("warning: {error}"));
            }
        }
        if let Some(view) = &mut self.view
            && view.is_due(elapsed)
        {
            view.show(&state.image(), state.denoised(), elapsed);
        }
        ControlFlow::Continue(())
    }

    /// Reports path counts that were chosen since the last call.
    fn note_new_counts(&mut self, state: &RenderState) {
        let blocks = state.renderer.blocks().len();
        if self.args.verbose && blocks > self.blocks {
            self.blocks = blocks;
            self.progress.note(&verbose::new_counts(state));
        }
    }

    /// Writes all files of a job that has ended, and returns the report.
    pub fn finish(self, mut result: RenderResult) -> Result<Output> {
        let Self { args, input, mut writer, mut page, view, progress, .. } = self;
        progress.finish();
        // Write the image first, and try every file even if another one fails.
        let mut attempts = Attempts::default();
        let image = result.state.image();
        let shown = (&result.image[..], result.state.denoised());
        let denoised = result.denoised.and_then(|denoised| denoised.recorded());
        let errors = StatedErrors { image: result.error, denoised };
        writer.save_image(&result.state, &image, shown, &mut attempts, errors);
        black_image::warn(&result.image, &progress);
        drop(image);
        if let Some(path) = &args.noise {
            match result.state.best_measured() {
                Some(block) => {
                    let RenderState { provenance, regions, .. } = &result.state;
                    attempts.add(path, || save_noise(path, (provenance, regions), block));
                }
                None => progress.note(
                    "warning: too few iterations to estimate the noise, so --noise wrote no file",
                ),
            }
        }
        writer.save_checkpoint(&result.state, &mut attempts);
        if page.is_some() {
            result.state.estimate();
        }
        let report = RenderReport::new(args, input, &result, &writer);
        let (state, image) = (&result.state, result.state.image());
        if let Some(page) = &mut page {
            let snapshot = Snapshot { input, state, image: &image, report: Some(&report) };
            let path = page.path.clone();
            attempts.add(&path, || page.write(&snapshot));
        }
        if let Some(view) = view {
            view.finish(&image, state.denoised(), state.elapsed());
        }
        attempts.finish()?;
        if args.verbose {
            verbose::at_end(&report).iter().for_each(|line| progress.note(line));
        }
        let form = (args.session.scene.json, args.session.quiet);
        let text = reported(form, &report, || text(&report, args.verbose));
        drop(report);
        Ok(Output { text, failure: result.state.failure.take(), ..Output::default() })
    }
}

/// Writes the noise from the measured iterations of a block.
pub fn save_noise(path: &Path, scene: (&Provenance, &[Region]), block: &Block) -> Result<()> {
    let noise = block.noise_image()?;
    NoiseFile::new(scene, &block.film, noise, Measure::Pairs).write(path)
}
