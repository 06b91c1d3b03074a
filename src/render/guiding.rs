//! Learns where light paths should start: some iterations outside of the image, on a sample of its pixels, tell what
//! light paths from each place bring. theory.md, section 10a.

use super::Renderer;
use super::tile_paths::TilePaths;
use super::worker::{Job, PhaseClock, trace};
use crate::base::error::Result;
use crate::base::rng::{Stream, StreamKey};
use crate::film::counts::Counts;
use crate::film::radiance::{Tile, box_filter, luminance, luminance_weights};
use crate::noise::Measure;
use crate::noise::pair_table::PairTable;
use crate::scene::lights::guide::{Guide, GuideSample};
use crate::settings::policy::*;
use crate::settings::{Kernel, Settings};
use crate::transport::camera_paths::CameraPaths;
use crate::transport::merge::MergeOutput;
use rayon::prelude::*;
use std::sync::Arc;

/// What a light path brought to a pixel.
#[derive(Clone, Copy, Debug)]
struct Score {
    light_path: u32,
    /// Weighted square.
    square: f64,
}

/// A guide, and how it was come by.
#[derive(Clone, Debug)]
pub struct Learned {
    /// Where light paths start.
    pub guide: Arc<Guide>,
    /// Iterations that it took.
    pub iterations: u32,
    /// Second moment of what light paths bring, over that of paths that start in proportion to the lights' power: by
    /// the last ones that started as the guide before this one said, which had not seen them.
    pub second_moment: f64,
}

impl Renderer {
    /// Learns a guide for light paths on a sample of the image, as long as `goes_on` with the number of iterations so
    /// far and the guide that they taught. What is learned in as many iterations is the same on any number of threads,
    /// and whatever the counts and the seed of the settings.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn learn_guide(&self, mut goes_on: impl FnMut(u32, &Guide) -> bool) -> Result<Learned> {
        let mut renderer = self.learner()?;
        let mut guide = Arc::new(Guide::even());
        let (mut brought, mut iterations, mut second_moment) = (Vec::new(), 0, 1.0);
        let mut begin = 0;
        while goes_on(iterations, &guide) {
            renderer.light_paths.guide = Some(Arc::clone(&guide));
            brought.extend(renderer.score(&guide));
            second_moment = of_own(&brought[begin..]);
            iterations += 1;
            let rounds = iterations / LEARNING_ROUND;
            if iterations.is_multiple_of(LEARNING_ROUND) && rounds.is_power_of_two() {
                guide = Arc::new(Guide::learn(&brought));
                begin = brought.len();
            }
        }
        if begin < brought.len() {
            guide = Arc::new(Guide::learn(&brought));
        }
        Ok(Learned { guide, iterations, second_moment })
    }

    /// Renders a sample of the image, with photons that are found from far: what paths from a place bring is learned
    /// from more of them.
    fn learner(&self) -> Result<Self> {
        let settings = self.settings();
        let pixels = settings.pixels() as f64 / LEARNING_PIXELS;
        let stride = (pixels.sqrt() as u32).clamp(1, settings.width.min(settings.height));
        let own = Settings {
            light_paths: LEARNING_LIGHT_PATHS,
            camera_paths: LEARNING_CAMERA_PATHS,
            // The same for all seeds: renders of several seeds have one law.
            seed: LEARNING_SEED,
            guide: 0,
            mis_scales: Some(settings.mis_scales()),
            radius: LEARNING_RADIUS * settings.radius,
            caustic_radius: LEARNING_RADIUS * settings.caustic_radius,
            // Needs no areas that nothing else does.
            kernel: Kernel::Disc,
            ..settings.clone()
        };
        let mut renderer = self.sample(own, stride)?;
        // What pixels weigh is known from an image.
        for _ in 0..LEARNING_FIRST {
            renderer.iterate(Measure::Off);
        }
        Ok(renderer)
    }

    /// Renders an iteration, and tells what its light paths brought.
    fn score(&mut self, guide: &Guide) -> Vec<GuideSample> {
        let iteration = self.next();
        self.iterate(Measure::Off);
        let settings = &self.settings;
        let image: Vec<_> = self.film().mean().iter().map(|l| [luminance(l.as_dvec3())]).collect();
        let pooled = box_filter(&image, settings.width, settings.height);
        let luminance: Vec<f64> = pooled.into_iter().map(|[l]| l).collect();
        let weights = luminance_weights(&luminance);
        let counts = Counts::uniform(settings.light_paths, settings.camera_paths);
        let (pass, merge) = self.passes(iteration);
        let job = Job::new(pass, merge, &counts, Measure::Pairs, 0);
        let tiles: Vec<Tile> = self.film().tiles().collect();
        let tiles: Vec<_> = tiles.par_chunks(job.tiles_together().max(1)).collect();
        let scores = tiles.into_par_iter().flat_map_iter(|tiles| scores(&job, tiles, &weights));
        let mut scores: Vec<Score> = scores.collect();
        // Those of one light path in the order of the pixels, whatever thread found them.
        scores.sort_by_key(|score| score.light_path);
        let key = StreamKey::new(settings.seed, Stream::LightPath, iteration);
        let of_path = |scores: &[Score]| GuideSample {
            start: guide.start(&mut key.rng(scores[0].light_path.into())),
            square: scores.iter().map(|score| score.square).sum(),
        };
        scores.chunk_by(|a, b| a.light_path == b.light_path).map(of_path).collect()
    }
}

/// The second moment of what light paths bring as they start, over that of those that start evenly.
fn of_own(brought: &[GuideSample]) -> f64 {
    let own: f64 = brought.iter().map(|brought| brought.square).sum();
    let even: f64 = brought.iter().map(|brought| brought.square * brought.start.density).sum();
    if even > 0.0 { own / even } else { 1.0 }
}

/// What light paths bring to the pixels of some tiles.
fn scores(job: &Job, tiles: &[Tile], weights: &[f64]) -> Vec<Score> {
    let (mut paths, mut gathered) = <(CameraPaths, MergeOutput)>::default();
    let mut table = PairTable::<f64>::default();
    let mut scores = Vec::new();
    let width = job.pass.settings.width;
    let ids = TilePaths::new(tiles, &job.counts.camera_paths, LEARNING_CAMERA_PATHS, width);
    let mut at = ids.clone();
    trace(job, ids, &mut paths, &mut PhaseClock::default(), |paths| {
        job.merge.gather_pairs(paths, &mut gathered, |gathered, complete| {
            for path in complete {
                for pair in gathered.pairs.of_path(path).flat_map(|(pairs, _)| pairs) {
                    *table.entry(pair.light_path) += f64::from(pair.value);
                }
                if at.path + 1 == at.traced {
                    let weight = weights[at.image_index()] / f64::from(at.traced).powi(2);
                    let score = |(light_path, value): (u32, &f64)| Score {
                        light_path,
                        square: weight * value * value,
                    };
                    scores.extend(table.entries().map(score));
                    table.clear();
                }
                at.advance();
            }
        });
    });
    scores
}
