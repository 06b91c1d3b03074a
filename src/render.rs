//! The iteration loop: light phase, photon map, camera and merge phases tile by tile.

use crate::accel::Intersect;
use crate::camera_paths::CameraPass;
use crate::error::{Error, Result};
use crate::film::{Film, PixelSums};
use crate::light_paths::{LightPaths, Photon};
use crate::merge::Merge;
use crate::noise::Measure;
use crate::noise::film::{BatchGrain, NoiseFilm, NoiseTile};
use crate::photon_map::PhotonMap;
use crate::pool::Pool;
use crate::rng::{Stream, StreamKey};
use crate::scene::{Scene, View};
use crate::settings::Settings;
use crate::worker::Worker;
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Iterations that are measured at the beginning of a render.
const PILOT: u64 = 8;
/// Of the others, one in so many is measured: their extra cost is at most a tenth each.
const MEASURE_EVERY: u64 = 8;

/// Renders one scene, iteration after iteration.
pub struct Renderer<'a> {
    scene: &'a Scene,
    accel: &'a dyn Intersect,
    settings: Settings,
    view: View,
    film: Film,
    noise: Option<NoiseFilm>,
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

/// Busy time of the phases, summed over threads, and wall-clock time of the whole iteration.
#[derive(Clone, Copy, Debug, Default)]
pub struct PhaseTimes {
    /// Tracing light paths and building the photon map.
    pub light: Duration,
    /// Tracing camera paths with their direct light.
    pub camera: Duration,
    /// Look-ups, merging and statistics.
    pub merge: Duration,
    /// Wall-clock time from beginning to end.
    pub wall: Duration,
}

impl std::ops::AddAssign for PhaseTimes {
    fn add_assign(&mut self, other: Self) {
        self.light += other.light;
        self.camera += other.camera;
        self.merge += other.merge;
        self.wall += other.wall;
    }
}

impl<'a> Renderer<'a> {
    /// Prepares to render from the first iteration.
    ///
    /// # Errors
    /// If the settings are invalid, the scene has no light, or the memory does not suffice.
    pub fn new(scene: &'a Scene, accel: &'a dyn Intersect, settings: Settings) -> Result<Self> {
        settings.validate()?;
        check_memory(scene, &settings)?;
        if scene.lights.emitters().is_empty() {
            return Err(Error::new(
                "the scene has no light",
                "add a [[light]], or give a material some emission",
            ));
        }
        let view = scene.camera.view(settings.width, settings.height);
        let film = Film::new(settings.width, settings.height);
        Ok(Self {
            scene,
            accel,
            settings,
            view,
            film,
            noise: None,
            grain: BatchGrain::Tile,
            light_paths: LightPaths::default(),
            photon_map: PhotonMap::default(),
            workers: Pool::default(),
        })
    }

    /// Goes on after the iterations that `film` holds, of which `noise` was measured.
    ///
    /// # Errors
    /// If they do not fit the settings' resolution.
    pub fn resume(&mut self, film: Film, noise: Option<NoiseFilm>) -> Result<()> {
        let noise_fits = noise.as_ref().is_none_or(|noise| noise.fits(film.tiles()));
        if film.resolution() != self.film.resolution() || !film.is_consistent() || !noise_fits {
            let (width, height) = film.resolution();
            return Err(Error::new(
                format!("the image to go on with has {width}x{height} pixels"),
                format!("render at --resolution {width}x{height}"),
            ));
        }
        self.film = film;
        self.noise = noise;
        Ok(())
    }

    /// Whether a render with fixed counts measures its next iteration: the pilot and a fixed share
    /// of the others, where the counts allow it.
    pub fn scheduled(&self) -> Measure {
        let next = self.film.iterations;
        let measures = next < PILOT || next.is_multiple_of(MEASURE_EVERY);
        if measures && self.settings.can_measure() { Measure::Pairs } else { Measure::Off }
    }

    /// Keeps the batches of measured noise at `grain` from now on; [`BatchGrain::Tile`] at first.
    ///
    /// # Panics
    /// If something was measured before.
    #[must_use]
    pub fn with_batches(mut self, grain: BatchGrain) -> Self {
        assert!(self.noise.is_none(), "batches change only before the first measurement");
        self.grain = grain;
        self
    }

    /// What was measured so far.
    pub fn noise(&self) -> Option<&NoiseFilm> {
        self.noise.as_ref()
    }

    /// The image so far.
    pub fn film(&self) -> &Film {
        &self.film
    }

    /// The settings it was made with.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Renders one iteration on the threads of the current rayon pool.
    ///
    /// # Panics
    /// If it is to measure with fewer than two light paths or camera paths.
    pub fn iterate(&mut self, measure: Measure) -> IterationReport {
        let start = Instant::now();
        let Self { scene, accel, settings, film, .. } = self;
        assert!(
            measure == Measure::Off || settings.can_measure(),
            "measuring takes pairs of paths"
        );
        let iteration = film.iterations;

        self.light_paths.trace(scene, *accel, settings, iteration);
        let build = Instant::now();
        self.photon_map.build(&self.light_paths, settings.radius);
        let build_time = build.elapsed();

        let pass = CameraPass {
            scene,
            view: self.view,
            accel: *accel,
            settings,
            key: StreamKey::new(settings.seed, Stream::CameraPath, iteration),
            gather_early: self.photon_map.any_at_every_vertex(),
        };
        let merge = Merge::new(&self.photon_map, settings.merge_vertex);
        // A measuring iteration gives each tile its part of the noise sums as well.
        let noise_tiles: Vec<Option<NoiseTile>> = match (&mut self.noise, measure) {
            (_, Measure::Off) => film.tiles().map(|_| None).collect(),
            (noise, _) => {
                let noise = noise.get_or_insert_with(|| NoiseFilm::new(film.tiles(), self.grain));
                noise.tiles_mut(film.tiles()).into_iter().map(Some).collect()
            }
        };
        let tiles = film.tiles_mut().into_par_iter().zip(noise_tiles);
        // Tiles differ in cost: hand them out one by one.
        tiles.with_max_len(1).for_each_init(
            || self.workers.lease(),
            |worker, (tile, noise)| worker.render(&pass, &merge, measure, tile, noise),
        );
        if let (Some(noise), true) = (&mut self.noise, measure != Measure::Off) {
            noise.iterations += 1;
        }
        film.iterations += 1;

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
        report
    }
}

/// Refuses counts that cannot fit, before anything is allocated.
fn check_memory(scene: &Scene, settings: &Settings) -> Result<()> {
    // A light path leaves on average at most 1/(1 - albedo) photons, held twice while sorting
    // besides their buckets. Films are held thrice: sums, image and what is being written; sums of
    // the noise once.
    let albedo = scene.materials.iter().map(|m| m.bsdf.albedo().max_element()).fold(0.0, f32::max);
    let photons_per_path = (1.0 - f64::from(albedo)).recip().min(20.0);
    let per_photon = (3 * size_of::<Photon>() + 16) as f64;
    let light = f64::from(settings.light_paths) * photons_per_path * per_photon;
    let per_pixel = 3 * size_of::<PixelSums>() + NoiseFilm::bytes_per_pixel(BatchGrain::Tile);
    let film = settings.pixels() as f64 * per_pixel as f64;
    let needed = light + film;
    match available_memory() {
        Some(available) if needed > available => Err(Error::new(
            format!(
                "about {:.1} GiB of memory are needed, {:.1} GiB for {} light paths and {:.1} GiB \
                 for {}x{} pixels, but {:.1} GiB are available",
                needed / GIB,
                light / GIB,
                settings.light_paths,
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

pub(crate) const GIB: f64 = (1u64 << 30) as f64;

/// Memory that can still be had, bytes, where the system tells (Linux).
pub(crate) fn available_memory() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024.0)
}
