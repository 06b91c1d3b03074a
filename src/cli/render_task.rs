//! A render from the first iteration to the last file.

use super::analyze::noise_file;
use super::black_image;
use super::denoising::Denoising;
use super::json;
use super::layers::Layers;
use super::loaded_scene::LoadedScene;
use super::mpi_leader::MpiLeader;
use super::outputs::Attempts;
use super::page::{Page, Snapshot};
use super::render::Args;
use super::render_files::{Outputs, Schedule, Writer};
use super::render_report::{Report, Shares, block_reports, describe_counts, text};
use super::session::Session;
use super::view::View;
use bdpm::adaptive::Steer;
use bdpm::adaptive::optimize::Objective;
use bdpm::adaptive::stopping::{Goal, StoppedBy, importance};
use bdpm::adaptive::technique::Selection;
use bdpm::base::error::Result;
use bdpm::noise::Measure;
use bdpm::output::checkpoint::Whole;
use bdpm::render::Renderer;
use bdpm::render::bias::MergeBias;
use bdpm::render::block::{Block, CombinedImage};
use bdpm::scene::Region;
use bdpm::settings::provenance::Provenance;
use std::path::Path;
use std::time::{Duration, Instant};

/// A render that is ready to begin.
pub struct Task<'a> {
    pub args: &'a Args,
    pub prepared: &'a LoadedScene,
    pub goal: Goal,
    pub outputs: Outputs,
    pub page: Option<Page>,
    /// The other processes, if there are any.
    pub crew: Option<MpiLeader<'a>>,
    /// What this is a part of, if it is.
    pub whole: Option<Whole>,
    /// Whether counts are chosen on the way.
    pub automatic: bool,
    /// The technique, where that was chosen.
    pub chosen: Option<Selection>,
    pub denoising: Option<Denoising>,
    /// When rendering began: with the choice of the technique.
    pub start: Instant,
}

impl Task<'_> {
    /// Renders to the goal, writes the files and tells of it.
    pub fn render(self, mut renderer: Renderer, mut steer: impl Steer) -> Result<String> {
        let Self { args, prepared, goal, outputs, whole, automatic, chosen, .. } = self;
        let Self { mut page, mut crew, denoising, start, .. } = self;
        page.as_mut().map_or(Ok(()), |page| page.announce(prepared))?;
        let layers = Layers::new(&args.layers);
        let origin = &prepared.origin;
        let time = Duration::ZERO;
        let regions = &prepared.scene.regions;
        let mut writer = Writer { origin, regions, outputs, page, whole, layers, time };
        let earlier = steer.state(0.0).map_or(0.0, |state| state.elapsed());
        let announced = if automatic {
            "numbers of paths chosen automatically".to_owned()
        } else {
            describe_counts(renderer.block())
        };
        let announced = match renderer.config().ranks {
            1 => announced,
            ranks => format!("{announced}, {ranks} processes"),
        };
        let (quiet, manner) = (args.session.quiet, args.session.manner());
        let session = Session::new(prepared, (goal, 1), manner, ("rendering", &announced))?;
        let mut session = session.begun_at(start);
        let name = |path: &Path| path.to_string_lossy().into_owned();
        let place = args.view.as_ref();
        let mut view = place.map(|place| View::new(place, &name(&args.output), &session.progress));
        session.denoising = denoising;
        let mut schedule = Schedule::new(prepared.origin.settings.pixels());
        let stopped_by = session.iterate(
            &mut renderer,
            &mut steer,
            crew.as_mut(),
            |session, renderer, steer| {
                let image = || combined(renderer, steer, goal.objective);
                if session.denoises_enough(renderer, image)? {
                    return Ok(Some(StoppedBy::Target));
                }
                let save = |writer: &mut Writer, session: &Session, attempts: &mut Attempts| {
                    writer.save_checkpoint(renderer, steer, session.elapsed(), attempts);
                };
                schedule.write_when_due(&mut writer, session, save, |writer, session, attempts| {
                    let image = image();
                    match session.preview(renderer, &image) {
                        Ok(denoised) => {
                            let shared = renderer.shared();
                            writer.save_image(shared, &image, denoised.as_ref(), attempts);
                        }
                        Err(error) => session.progress.note(&format!("warning: {error}")),
                    }
                });
                if writer.page_is_due(session) {
                    let image = combined(renderer, steer, goal.objective);
                    let (promise, chosen) = (steer.promise(), chosen.as_ref());
                    let denoised = session.denoised();
                    let report = None;
                    let moment = Snapshot {
                        session,
                        image: &image,
                        denoised,
                        earlier,
                        promise,
                        chosen,
                        report,
                    };
                    writer.renew_page(&moment);
                }
                let elapsed = session.elapsed();
                if let Some(view) = &mut view
                    && view.is_due(elapsed)
                {
                    view.show(
                        &combined(renderer, steer, goal.objective),
                        session.denoised(),
                        elapsed,
                    );
                }
                Ok(None)
            },
        )?;
        if let Some(crew) = crew {
            crew.shut_down()?;
        }
        let half_way = session.half_way();
        // What was asked for first, and all of it whatever fails.
        let image = combined(&renderer, &steer, goal.objective);
        session.progress.finish();
        let mut attempts = Attempts::default();
        let denoised = session.denoise(&renderer, &image);
        let latest = session.denoising.as_ref().and_then(|denoising| denoising.latest.as_ref());
        writer.save_image(renderer.shared(), &image, latest, &mut attempts);
        if denoised.is_err() {
            attempts.add(&writer.outputs.exr, || denoised);
        }
        black_image::warn(&image, &session.progress);
        if let Some(path) = &args.noise {
            match best_measured(renderer.blocks()) {
                Some(block) => {
                    attempts.add(path, || save_noise(path, (origin, regions), block));
                }
                None => session
                    .progress
                    .note("warning: too few iterations to tell the noise; --noise wrote nothing"),
            }
        }
        writer.save_checkpoint(&renderer, &steer, session.elapsed(), &mut attempts);

        let (variance, luminance) = (image.pooled_variance(), image.mean_luminance());
        let rms = variance.map(|(variance, _)| variance.sqrt());
        let error = variance.map(|(variance, error)| 0.5 * error / variance.sqrt());
        let report = Report {
            run: session.report((image.iterations(), luminance), stopped_by, writer.time),
            automatic,
            blocks: block_reports(&image, renderer.blocks()),
            rms,
            rms_error: error.filter(|error| error.is_finite()),
            relative_rms: rms.map(|rms| rms / luminance).filter(|share| share.is_finite()),
            promise: steer.promise().copied(),
            error: automatic.then(|| Shares::new(&renderer, &image, &goal)).flatten(),
            denoised: session.denoising.as_ref().map(|denoising| denoising.report(&goal)),
            technique: chosen,
            half_way,
            // What stands out is off already where it is taken off.
            merge_bias: match image.bias_correction() {
                None => MergeBias::new(renderer.blocks(), &image),
                Some(_) => None,
            },
            exr: name(&writer.outputs.exr),
            png: name(&writer.outputs.png),
            noise: args.noise.as_deref().map(name),
            report: args.report.as_deref().map(name),
            checkpoint: writer.outputs.checkpoint.as_deref().map(name),
        };
        if let Some(page) = &mut writer.page {
            session.look_again(&renderer, &steer);
            let (chosen, promise) = (report.technique.as_ref(), report.promise.as_ref());
            let (session, image, denoised, report) =
                (&session, &image, session.denoised(), Some(&report));
            let moment = Snapshot { session, image, denoised, earlier, promise, chosen, report };
            let path = page.path.clone();
            attempts.add(&path, || page.write(&moment));
        }
        if let Some(view) = view {
            view.finish(&image, session.denoised(), session.elapsed());
        }
        attempts.finish()?;
        Ok(match (args.session.scene.json, quiet) {
            (true, _) => json(&report),
            (false, true) => String::new(),
            (false, false) => text(&report),
        })
    }
}

/// The image of all blocks.
fn combined<'a>(
    renderer: &'a Renderer,
    steer: &impl Steer,
    objective: Objective,
) -> CombinedImage<'a> {
    let importance = importance(renderer.blocks(), objective);
    CombinedImage::new(renderer.blocks(), steer.weights(renderer.blocks(), &importance))
}

/// The block with the most measuring iterations, if they tell its noise.
pub fn best_measured(blocks: &[Block]) -> Option<&Block> {
    let measured =
        |block: &Block| block.statistics.noise.as_ref().map_or(0, |noise| noise.iterations);
    let best = blocks.iter().max_by_key(|block| measured(block));
    best.filter(|block| measured(block) >= 2)
}

/// Writes what its measuring iterations found.
pub fn save_noise(path: &Path, of: (&Provenance, &[Region]), block: &Block) -> Result<()> {
    let noise = block.noise_image()?;
    noise_file(of, &block.film, noise, Measure::Pairs).write(path)
}
