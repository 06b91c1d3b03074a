//! One technique at given radii on a sample of the pixels: its noise, its nested radii and its times.

use crate::accel::Intersect;
use crate::base::error::Result;
use crate::image::counts::Counts;
use crate::noise::Measure;
use crate::noise::film::BatchGrain;
use crate::noise::image::NoiseImage;
use crate::render::Renderer;
use crate::scene::{Placement, Scene};
use crate::settings::Settings;
use crate::settings::policy::*;
use crate::timing::TimeModel;
use crate::timing::fit::fit;
use crate::timing::sample::{Phase, Sample};
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;
use rayon::prelude::*;
use std::f64::consts::PI;
use std::time::Instant;

/// Where trials take place.
pub struct Site<'a> {
    scene: &'a Scene,
    accel: &'a dyn Intersect,
    /// Those of the image.
    pub settings: &'a Settings,
    /// Of so many by so many pixels one is taken.
    stride: u32,
    /// Of an iteration of a trial.
    light_paths: u32,
    /// That the memory allows.
    most_light_paths: u32,
    /// Area of the surfaces on which photons are merged, scene units squared.
    area: f64,
    /// Radius of a disc of the area that a pixel sees, typically, scene units.
    pub footprint: f64,
}

/// What a trial found.
pub struct Trial {
    /// Merge radii, scene units.
    pub radii: ByClass<f64>,
    /// The class of photons whose bias it tells, if any.
    pub nests: Option<PhotonClass>,
    /// Of the sample of the pixels.
    pub noise: NoiseImage,
    /// For the whole image.
    pub times: TimeModel,
    /// Second moment of what a light path brings to a camera path, relative, if photons were spread evenly over all
    /// surfaces.
    pub even: f64,
    /// Time of the first iteration, which works out the areas of surfaces, seconds.
    pub first: f64,
    /// Whether there were photons that merge at every vertex.
    pub any_at_every_vertex: bool,
}

impl<'a> Site<'a> {
    /// For the image of these settings, and trials of so many seconds or more.
    pub fn new(
        scene: &'a Scene,
        accel: &'a dyn Intersect,
        settings: &'a Settings,
        seconds: f64,
    ) -> Self {
        let threads = rayon::current_num_threads() as f64;
        let each = TRIAL_MEASURING * seconds / TRIAL_ITERATIONS as f64;
        let paths = (0.5 * each * threads / TRIAL_PATH).clamp(TRIAL_PATHS.start, TRIAL_PATHS.end);
        let sample = paths / f64::from(TRIAL_CAMERA_PATHS);
        let stride = (settings.pixels() as f64 / sample).sqrt() as u32;
        let stride = stride.clamp(1, settings.width.min(settings.height));
        let (area, footprint) = (merging_area(scene), footprint(scene, accel, settings));
        let most_light_paths = Renderer::most_light_paths_for(scene, settings);
        let light_paths = (paths as u32).min(most_light_paths);
        Self { scene, accel, settings, stride, light_paths, most_light_paths, area, footprint }
    }

    /// Tries the strategy, radii and weights of `settings` for so long; one class of photons may be merged at
    /// nested radii.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn trial(
        &self,
        settings: &Settings,
        nests: Option<PhotonClass>,
        seconds: f64,
    ) -> Result<Trial> {
        let start = Instant::now();
        let light_paths = self.light_paths;
        let camera_paths = TRIAL_CAMERA_PATHS;
        // Its samples are none of the image's.
        let seed = settings.seed.wrapping_add(TRIAL_SEED);
        let own = Settings { light_paths, camera_paths, seed, ..settings.clone() };
        let renderer = Renderer::of_sample(self.scene, self.accel, own.clone(), self.stride)?;
        let renderer = renderer.with_batches(BatchGrain::Pixel);
        let mut renderer = match nests {
            Some(class) if own.radius != own.caustic_radius => renderer.nesting(class),
            _ => renderer,
        };
        let elapsed = || start.elapsed().as_secs_f64();
        let (mut iterations, mut first, mut photons) = (0, 0.0, 0);
        let measuring = TRIAL_MEASURING * seconds;
        while elapsed() < measuring
            || iterations < TRIAL_ITERATIONS && elapsed() < TRIAL_PATIENCE * measuring
            || iterations < 2
        {
            photons += renderer.iterate(Measure::Pairs).photons;
            iterations += 1;
            first = if iterations == 1 { elapsed() } else { first };
        }
        let noise = renderer.noise_image()?;
        let any_at_every_vertex = renderer.finds_any_at_every_vertex();
        let mut samples = Vec::new();
        let many = light_paths.saturating_mul(TIMED_RATIO).min(self.most_light_paths);
        for light_paths in [light_paths, many] {
            renderer.begin_block(Counts::uniform(light_paths, TIMED_CAMERA_PATHS))?;
            let begun = elapsed();
            let mut timed = 0;
            let share = 0.5 * (1.0 - TRIAL_MEASURING) * seconds;
            while timed < 1
                || elapsed() < begun + share
                || timed < TRIAL_TIMED && elapsed() < TRIAL_PATIENCE * seconds
            {
                renderer.iterate(Measure::Off);
                timed += 1;
            }
            samples.extend(times(&renderer));
        }
        let pixels = f64::from(noise.width * noise.height);
        let model = fit(&samples, pixels)?.model;
        Ok(Trial {
            radii: [own.caustic_radius, own.radius].map(f64::from),
            nests,
            noise,
            times: TimeModel { pixels: self.settings.pixels() as f64, ..model },
            even: self.even(&own, photons as f64 / iterations as f64),
            first,
            any_at_every_vertex,
        })
    }
}

impl Site<'_> {
    /// A photon is one of so many that share the area, and is found on a disc of it.
    /// theory.md (93e).
    fn even(&self, settings: &Settings, photons: f64) -> f64 {
        let reach = f64::from(settings.radius.max(settings.caustic_radius));
        let per_light_path = photons.max(1.0) / f64::from(settings.light_paths);
        (self.area / (PI * reach * reach * per_light_path)).max(1.0)
    }
}

/// Area of all surfaces on which photons are merged, scene units squared.
fn merging_area(scene: &Scene) -> f64 {
    let places = scene.placements().par_iter().enumerate();
    let area = |(place, placement): (usize, &Placement)| {
        if !scene.materials()[placement.material as usize].bsdf.merges() {
            return 0.0;
        }
        let triangles = 0..scene.mesh(placement).triangles.len() as u32;
        let area = |triangle| f64::from(scene.placed_triangle(place as u32, triangle).area());
        triangles.map(area).sum()
    };
    // Summed in the order of the places, on any number of threads.
    places.map(area).collect::<Vec<f64>>().iter().sum()
}

/// Times of the block under way.
fn times(renderer: &Renderer) -> impl Iterator<Item = Sample> {
    let block = renderer.block();
    let (clock, threads) = (block.clock, rayon::current_num_threads());
    let light_paths = f64::from(block.counts.light_paths);
    let camera_paths = block.counts.camera_paths.mean();
    Phase::ALL.into_iter().map(move |phase| {
        let seconds = phase.time(&clock.times, threads).as_secs_f64() / clock.iterations as f64;
        Sample { phase, light_paths, camera_paths, seconds, error: None }
    })
}

/// The median over the image of the radius of a disc as large as what a pixel sees head-on; of a pinhole's
/// image 1, where nothing is seen.
fn footprint(scene: &Scene, accel: &dyn Intersect, settings: &Settings) -> f64 {
    let view = scene.camera.view(settings.width, settings.height);
    let [w, h] = [settings.width, settings.height].map(|pixels| pixels as f32);
    // Of a pixel: a single one may see everything.
    const PART: f32 = 0.1;
    let mut sides = Vec::new();
    for row in 0..FOOTPRINTS {
        for column in 0..FOOTPRINTS {
            let [x, y] = [(column, w), (row, h)]
                .map(|(i, pixels)| (i as f32 + 0.5) / FOOTPRINTS as f32 * pixels);
            let (ray, _) = view.ray(x, y, [0.5; 2]);
            let (next, _) = view.ray(x + PART, y, [0.5; 2]);
            let hit = accel.closest_hit(&ray);
            if !hit.is_miss() {
                let across = next.direction.cross(ray.direction).length() / PART;
                sides.push(f64::from(hit.t * across));
            }
        }
    }
    sides.sort_by(f64::total_cmp);
    let side = sides.get(sides.len() / 2).copied().unwrap_or(1.0);
    side / PI.sqrt()
}
