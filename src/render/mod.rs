//! The iteration loop: light phase, photon map, camera and merge phases for some tiles at a time.

pub mod bias;
pub mod block;
mod tile_paths;
mod tiles;
mod worker;

use crate::accel::Intersect;
use crate::base::error::{Error, Result};
use crate::base::memory::{GIB, available_memory};
use crate::base::pool::Pool;
use crate::base::rng::{Stream, StreamKey};
use crate::bsdf::Bsdf;
use crate::image::PhaseTimes;
use crate::image::counts::Counts;
use crate::image::film::{Film, PixelSums, Tile};
use crate::noise::Measure;
use crate::noise::film::{BatchGrain, NoiseFilm, NoiseTile};
use crate::scene::{Scene, View};
use crate::settings::policy::MOST_BLOCKS;
use crate::settings::{MAX_LIGHT_PATHS, Settings};
use crate::transport::camera_paths::CameraPass;
use crate::transport::light_paths::LightPaths;
use crate::transport::merge::Merge;
use crate::transport::photon::Photon;
use crate::transport::photon_map::PhotonMap;
use block::Block;
use rayon::prelude::*;
use std::time::Instant;
use tiles::{Shares, TileSums};
use worker::{Job, Worker};

/// Renders one scene, iteration after iteration.
pub struct Renderer<'a> {
    scene: &'a Scene,
    accel: &'a dyn Intersect,
    settings: Settings,
    view: View,
    /// At least one; the last is under way.
    blocks: Vec<Block>,
    grain: BatchGrain,
    light_paths: LightPaths,
    photon_map: PhotonMap,
    workers: Pool<Worker>,
}

/// What one iteration did.
#[derive(Clone, Debug, Default)]
pub struct IterationReport {
    /// Time of each phase.
    pub times: PhaseTimes,
    /// Rays traced in the light and camera phases.
    pub rays: u64,
    /// Photons in the map.
    pub photons: usize,
    /// Pixels whose value was not finite and was left out: column and row, in image order.
    pub non_finite: Vec<(u32, u32)>,
}

impl<'a> Renderer<'a> {
    /// Prepares to render from the first iteration.
    ///
    /// # Errors
    /// If the settings are invalid, the scene has no light, or the memory does not suffice.
    pub fn new(scene: &'a Scene, accel: &'a dyn Intersect, settings: Settings) -> Result<Self> {
        settings.validate()?;
        check_memory(scene, &settings, settings.light_paths)?;
        if scene.lights.is_empty() {
            return Err(Error::new(
                "the scene has no light",
                "add a [[light]], or give a material some emission",
            ));
        }
        let view = scene.camera.view(settings.width, settings.height);
        let counts = Counts::uniform(settings.light_paths, settings.camera_paths);
        Ok(Self {
            scene,
            accel,
            view,
            blocks: vec![Block::new(&settings, counts)],
            settings,
            grain: BatchGrain::Tile,
            light_paths: LightPaths::default(),
            photon_map: PhotonMap::default(),
            workers: Pool::default(),
        })
    }

    /// Goes on after the iterations that `blocks` hold.
    ///
    /// # Errors
    /// If there is none, or one does not fit the settings.
    pub fn resume(&mut self, blocks: Vec<Block>) -> Result<()> {
        let Settings { width, height, .. } = self.settings;
        if blocks.is_empty() || !blocks.iter().all(|block| block.is_consistent(&self.settings)) {
            return Err(Error::new(
                format!("the image to go on with is not one of {width}x{height} pixels"),
                "render at the --resolution that it was begun with",
            ));
        }
        self.blocks = blocks;
        Ok(())
    }

    /// Takes other counts from now on, in a new block; a block without iterations is replaced.
    ///
    /// # Errors
    /// If the counts are out of bounds or do not fit in the memory.
    ///
    /// # Panics
    /// If there are counts for another number of pixels.
    pub fn begin_block(&mut self, counts: Counts) -> Result<()> {
        counts.validate(&self.settings)?;
        check_memory(self.scene, &self.settings, counts.light_paths)?;
        self.blocks.pop_if(|block| block.film.iterations == 0);
        self.blocks.push(Block::new(&self.settings, counts));
        Ok(())
    }

    /// The most light paths that take no more than half of the memory that is left.
    pub fn most_light_paths(&self) -> u32 {
        let Some(available) = available_memory() else { return MAX_LIGHT_PATHS };
        let for_light = 0.5 * (available - film_bytes(&self.settings, MOST_BLOCKS)).max(0.0);
        let most = for_light / bytes_per_light_path(self.scene);
        most.clamp(2.0, f64::from(MAX_LIGHT_PATHS)) as u32
    }

    /// Keeps the batches of measured noise at `grain` from now on; [`BatchGrain::Tile`] at first.
    ///
    /// # Panics
    /// If something was measured before.
    #[must_use]
    pub fn with_batches(mut self, grain: BatchGrain) -> Self {
        assert!(self.noise().is_none(), "batches change only before the first measurement");
        self.grain = grain;
        self
    }

    /// All blocks; the last is under way.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The block under way.
    pub fn block(&self) -> &Block {
        self.blocks.last().expect("there is always one")
    }

    /// What was measured in the block under way.
    pub fn noise(&self) -> Option<&NoiseFilm> {
        self.block().noise.as_ref()
    }

    /// The image of the block under way.
    pub fn film(&self) -> &Film {
        &self.block().film
    }

    /// Iterations of all blocks.
    pub fn iterations(&self) -> u64 {
        self.blocks.iter().map(|block| block.film.iterations).sum()
    }

    /// The settings; counts are those of the first block.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Renders one iteration on the threads of the current rayon pool. One that measures takes at
    /// least two camera paths in each pixel; those that the counts do not ask for stay out of the
    /// image, which is the same whether it is measured or not.
    ///
    /// # Panics
    /// If it is to measure with fewer than two light paths.
    pub fn iterate(&mut self, measure: Measure) -> IterationReport {
        let start = Instant::now();
        let iteration = self.iterations();
        let Self { scene, accel, settings, blocks, grain, .. } = self;
        let Block { counts, film, noise, clock } = blocks.last_mut().expect("there is one");
        assert!(measure == Measure::Off || counts.light_paths >= 2, "measuring takes pairs");

        self.light_paths.trace(scene, *accel, settings, counts.light_paths, iteration);
        let build = Instant::now();
        self.photon_map.build(&self.light_paths, settings.radius);
        // No thread has anything else to do meanwhile.
        let build_time = build.elapsed() * rayon::current_num_threads() as u32;

        let pass = CameraPass {
            scene,
            view: self.view,
            accel: *accel,
            settings,
            key: StreamKey::new(settings.seed, Stream::CameraPath, iteration),
            gather_early: self.photon_map.any_at_every_vertex(),
        };
        let merge = Merge::new(&self.photon_map, settings.merge_vertex);
        let together = merge.together(measure != Measure::Off);
        let job = Job { pass, merge, counts, measure, together, before: film.iterations };
        // A measuring iteration gives each tile its part of the noise sums as well.
        let noise_tiles: Vec<Option<NoiseTile>> = if measure == Measure::Off {
            film.tiles().map(|_| None).collect()
        } else {
            let noise = noise.get_or_insert_with(|| NoiseFilm::new(film.tiles(), *grain));
            noise.tiles_mut(film.tiles()).into_iter().map(Some).collect()
        };
        let with_noise = film.tiles_mut().into_iter().zip(noise_tiles);
        let tile = |((tile, sums), noise)| TileSums { tile, sums, noise, deviation: 0.0 };
        let mut tiles: Vec<TileSums> = with_noise.map(tile).collect();
        // Results do not depend on which tiles one thread takes together.
        let per_tile = counts.camera_paths.mean().max(f64::from(job.least())) * Tile::PIXELS;
        let most = (together as f64 / per_tile) as usize;
        Shares::new(&mut tiles, most)
            .par_bridge()
            .for_each_init(|| self.workers.lease(), |worker, tiles| worker.render(&job, tiles));
        // Summed in the order of the tiles, whoever rendered them.
        let deviations = tiles.iter().map(|tile| tile.deviation).sum();
        film.deviations.add(deviations, film.iterations);
        film.iterations += 1;
        if let (Some(noise), true) = (noise, measure != Measure::Off) {
            noise.iterations += 1;
        }

        let mut report = IterationReport {
            rays: self.light_paths.rays(),
            photons: self.photon_map.len(),
            ..IterationReport::default()
        };
        report.times.light = self.light_paths.busy_time() + build_time;
        for worker in self.workers.free_mut() {
            let counts = worker.take_counts();
            report.times.camera += counts.camera;
            report.times.merge += counts.merge;
            report.rays += counts.rays;
            report.non_finite.extend(counts.non_finite);
        }
        report.non_finite.sort_unstable_by_key(|&(x, y)| (y, x));
        report.times.wall = start.elapsed();
        if measure == Measure::Off {
            clock.iterations += 1;
            clock.times += report.times;
        }
        report
    }
}

/// Bytes that a light path takes on average: it leaves at most 1/(1 - albedo) photons. Surfaces that
/// only pass it on leave none.
fn bytes_per_light_path(scene: &Scene) -> f64 {
    let storing = scene.materials.iter().map(|m| m.bsdf).filter(Bsdf::merges);
    let albedo = storing.map(|bsdf| bsdf.albedo().max_element()).fold(0.0, f32::max);
    let photons_per_path = (1.0 - f64::from(albedo)).recip().min(20.0);
    photons_per_path * BYTES_PER_PHOTON
}

/// As traced, while sorting with its bucket in two orders, and in the map with up to eight buckets.
const BYTES_PER_PHOTON: f64 = (3 * size_of::<Photon>() + 2 * 4 + 8 * 4) as f64;

/// The light paths, each of so many photons on average, that fit in so many bytes of memory beside
/// the image; below 1 where not even one fits.
pub fn light_paths_in(memory: f64, photons_per_path: f64, settings: &Settings) -> f64 {
    (memory - film_bytes(settings, 1)) / (photons_per_path * BYTES_PER_PHOTON)
}

/// Bytes of the image under way: sums of the image and the noise and counts of each block, the image
/// and what is being written.
fn film_bytes(settings: &Settings, blocks: usize) -> f64 {
    let written = 2 * size_of::<PixelSums>();
    let block = size_of::<PixelSums>() + NoiseFilm::bytes_per_pixel(BatchGrain::Tile);
    let per_pixel = written + blocks * (block + size_of::<u32>());
    settings.pixels() as f64 * per_pixel as f64
}

/// Refuses counts that cannot fit, before anything is allocated.
fn check_memory(scene: &Scene, settings: &Settings, light_paths: u32) -> Result<()> {
    let light = f64::from(light_paths) * bytes_per_light_path(scene);
    // Those of earlier blocks are no longer available.
    let film = film_bytes(settings, 1);
    let needed = light + film;
    match available_memory() {
        Some(available) if needed > available => Err(Error::new(
            format!(
                "about {:.1} GiB of memory are needed, {:.1} GiB for {light_paths} light paths and \
                 {:.1} GiB for {}x{} pixels, but {:.1} GiB are available",
                needed / GIB,
                light / GIB,
                film / GIB,
                settings.width,
                settings.height,
                available / GIB,
            ),
            "lower --light-paths or --resolution; more iterations make up for fewer light paths",
        )),
        _ => Ok(()),
    }
}
