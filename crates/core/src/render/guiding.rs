//! Learns a guide for the start of light paths: iterations that are not part of the image measure,
//! on a sample of its pixels, the contribution of light paths by their start. theory.md, section
//! 10a.

use super::Renderer;
use super::worker::{Job, WorkerCounts, trace};
use crate::base::error::Result;
use crate::base::rng::{Stream, StreamKey};
use crate::film::counts::Counts;
use crate::film::radiance::{box_filter, luminance, luminance_weights};
use crate::film::tiled_buffer::Tile;
use crate::noise::Measure;
use crate::noise::pair_table::PairTable;
use crate::scene::lights::guide::{Guide, GuideSample};
use crate::scene::lights::primary_sample;
use crate::settings::{Kernel, Settings};
use crate::transport::camera_paths::CameraPaths;
use crate::transport::merge::MergeOutput;
use rayon::prelude::*;
use std::sync::Arc;

/// Light paths of a learning iteration: enough that each round improves the guide of the round
/// before.
pub const LEARNING_LIGHT_PATHS: u32 = 8192;

/// Approximate number of pixels of a learning iteration.
pub const LEARNING_PIXELS: f64 = 4096.0;

/// Camera paths per pixel of a learning iteration.
pub const LEARNING_CAMERA_PATHS: u32 = 2;

/// Iterations of the first round. Each further round has as many iterations as all rounds before
/// it, and its light paths start from the guide that they learned.
pub const LEARNING_ROUND: u32 = 4;

/// Merge radii while learning, relative to those of the settings. More photons reach each pixel,
/// and their mean contribution depends little on the radius.
const LEARNING_RADIUS: f32 = 4.0;

/// Iterations before the first round, which estimate the luminance of the pixels for their weights.
const LEARNING_FIRST: u32 = 2;

/// Seed of the learning iterations.
const LEARNING_SEED: u64 = 0x1ea2_4176_0f11_6475;

/// Contribution of a light path to a pixel.
#[derive(Clone, Copy, Debug)]
struct Score {
    light_path: u32,
    /// Square of the contribution, times the weight of the pixel.
    square: f64,
}

/// A learned guide.
#[derive(Clone, Debug)]
pub struct Learned {
    /// The guide.
    pub guide: Arc<Guide>,
    /// Number of learning iterations.
    pub iterations: u32,
    /// Second moment of the contributions of guided light paths, relative to paths that start
    /// without what was learned. It is estimated from the last round, whose paths
    /// started from the guide of the rounds before.
    pub second_moment: f64,
}

impl Renderer {
    /// Learns the guide in as many iterations as the settings ask for, if there are photons.
    pub(super) fn with_learned_guide(self) -> Result<Self> {
        let all = if self.settings.has_photons() { self.settings.guide } else { 0 };
        let learned = (all > 0).then(|| self.learn_guide(|done, _| done < all)).transpose()?;
        Ok(self.guided(learned.map(|learned| learned.guide)))
    }

    /// Learns a guide on a sample of the image while `should_continue` returns true for the number
    /// of iterations so far and the current guide. The guide of a number of iterations does not
    /// depend on the number of threads, the path counts or the seed of the settings.
    ///
    /// # Errors
    /// Those of [`Renderer::new`].
    pub fn learn_guide(
        &self,
        mut should_continue: impl FnMut(u32, &Guide) -> bool,
    ) -> Result<Learned> {
        let mut renderer = self.learning_renderer()?;
        let base = self.aim.clone().unwrap_or_else(|| Arc::new(Guide::even()));
        let mut guide = Arc::clone(&base);
        let (mut samples, mut iterations, mut second_moment) = (Vec::new(), 0, 1.0);
        // First sample of the current round
        let mut round = 0;
        while should_continue(iterations, &guide) {
            renderer.set_guide(Some(Arc::clone(&guide)));
            samples.extend(renderer.guide_samples(&guide));
            renderer.check_interrupt()?;
            second_moment = relative_second_moment(&samples[round..], &base);
            iterations += 1;
            let rounds = iterations / LEARNING_ROUND;
            if iterations.is_multiple_of(LEARNING_ROUND) && rounds.is_power_of_two() {
                guide = Arc::new(Guide::learn(&samples, &base));
                round = samples.len();
            }
        }
        if round < samples.len() {
            guide = Arc::new(Guide::learn(&samples, &base));
        }
        Ok(Learned { guide, iterations, second_moment })
    }

    /// Renders a sample of the image with large merge radii, so that each pixel receives more
    /// photons.
    fn learning_renderer(&self) -> Result<Self> {
        let settings = self.settings();
        let pixels = settings.pixels() as f64 / LEARNING_PIXELS;
        let stride = (pixels.sqrt() as u32).clamp(1, settings.width.min(settings.height));
        let own = Settings {
            light_paths: LEARNING_LIGHT_PATHS,
            camera_paths: LEARNING_CAMERA_PATHS,
            // Renders with different seeds share the guide, so that they have the same distribution
            seed: LEARNING_SEED,
            guide: 0,
            // Each light path is scored by itself
            sobol_set: 1,
            splitting: 1,
            mis_scales: Some(settings.mis_scales()),
            radius: LEARNING_RADIUS * settings.radius,
            caustic_radius: LEARNING_RADIUS * settings.caustic_radius,
            // Avoids areas for these radii, which the image does not need
            kernel: Kernel::Disc,
            ..settings.clone()
        };
        let mut renderer = self.sample(own, stride)?;
        // The weights of the pixels need an estimate of the image
        for _ in 0..LEARNING_FIRST {
            renderer.iterate(Measure::Off);
            renderer.check_interrupt()?;
        }
        Ok(renderer)
    }

    /// Renders an iteration and returns the contributions of its light paths.
    fn guide_samples(&mut self, guide: &Guide) -> Vec<GuideSample> {
        let iteration = self.next_iteration();
        self.iterate(Measure::Off);
        let settings = &self.settings;
        let image: Vec<_> = self.film().mean().iter().map(|l| [luminance(l.as_dvec3())]).collect();
        let pooled = box_filter(&image, settings.width, settings.height);
        let luminance: Vec<f64> = pooled.into_iter().map(|[l]| l).collect();
        let weights = luminance_weights(&luminance);
        let counts = Counts::uniform(settings.light_paths, settings.camera_paths);
        let (pass, merge) = self.passes(iteration);
        let job = Job::new(pass, merge, &counts, Measure::Pairs);
        let tiles: Vec<Tile> = self.film().sums.tiles().collect();
        let tiles: Vec<_> = tiles.par_chunks(job.tiles_per_batch().max(1)).collect();
        let scores = tiles.into_par_iter().flat_map_iter(|tiles| scores(&job, tiles, &weights));
        let mut scores: Vec<Score> = scores.collect();
        // A stable sort: the scores of a light path stay in the order of the pixels
        scores.sort_by_key(|score| score.light_path);
        let key = StreamKey::new(settings.seed, Stream::LightPath, iteration);
        let sample = |scores: &[Score]| GuideSample {
            start: guide.start(primary_sample(&mut key.rng(scores[0].light_path.into()))),
            square: scores.iter().map(|score| score.square).sum(),
        };
        scores.chunk_by(|a, b| a.light_path == b.light_path).map(sample).collect()
    }
}

/// Second moment of the contributions of guided light paths, relative to paths that start with the
/// density `base`.
fn relative_second_moment(samples: &[GuideSample], base: &Guide) -> f64 {
    let guided: f64 = samples.iter().map(|sample| sample.square).sum();
    let weighted = |sample: &GuideSample| {
        sample.square * sample.start.density / base.density(&sample.start.place)
    };
    let before: f64 = samples.iter().map(weighted).sum();
    if before > 0.0 { guided / before } else { 1.0 }
}

/// Contributions of the light paths to the pixels of some tiles.
fn scores(job: &Job, tiles: &[Tile], weights: &[f64]) -> Vec<Score> {
    let (mut paths, mut gathered) = <(CameraPaths, MergeOutput)>::default();
    let mut table = PairTable::<f64>::default();
    let mut scores = Vec::new();
    let ids = job.paths(tiles);
    let mut current = ids.clone();
    trace(job, ids, &mut paths, &mut WorkerCounts::default(), |paths| {
        job.merge.gather_pairs(paths, &mut gathered, |gathered, complete| {
            for path in complete {
                for pair in gathered.pairs.of_path(path).flat_map(|(pairs, _)| pairs) {
                    *table.entry(pair.light_path) += f64::from(pair.value);
                }
                if current.path + 1 == current.traced {
                    let weight = weights[current.image_index()] / f64::from(current.traced).powi(2);
                    let score = |(light_path, value): (u32, &f64)| Score {
                        light_path,
                        square: weight * value * value,
                    };
                    scores.extend(table.entries().map(score));
                    table.clear();
                }
                current.advance();
            }
        });
    });
    scores
}
