//! One technique at given radii on a sample of the pixels: its noise, its nested radii and its times.

use super::census::{Census, Ground, Surfaces};
use super::{Guided, Technique};
use crate::accel::Intersect;
use crate::base::error::Result;
use crate::film::counts::Counts;
use crate::noise::image::NoiseImage;
use crate::noise::{Coefficients, Measure};
use crate::render::RenderConfig;
use crate::render::Renderer;
use crate::render::guiding::Learned;
use crate::scene::lights::guide::Guide;
use crate::scene::{Emitter, Material, Placement, Scene};
use crate::settings::policy::*;
use crate::settings::{Kernel, Settings};
use crate::timing::TimeModel;
use crate::timing::fit::fit;
use crate::timing::sample::{Phase, Sample};
use crate::transport::kernel::ByClass;
use crate::transport::photon::PhotonClass;
use rayon::prelude::*;
use std::f64::consts::PI;
use std::sync::Arc;
use std::time::Instant;

/// Where trials take place.
pub struct Site<'a> {
    /// Of the whole image, for what is learned beside it.
    whole: Renderer,
    ground: Ground<'a>,
    /// What areas cost at some vertices and radii.
    census: Vec<(u32, f64, Census)>,
    /// Some that know areas for different radii, which further trials use.
    known: Vec<Renderer>,
    /// Of so many by so many pixels one is taken.
    stride: u32,
    /// Where light paths of trials start.
    guide: Option<Arc<Guide>>,
    /// Wall-clock time of a path of either kind, seconds.
    per_path: f64,
    /// Of an iteration of a trial.
    light_paths: u32,
    /// That the memory allows.
    most_light_paths: u32,
    /// Of the image.
    pixels: f64,
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
    /// Whether there were photons that merge at every vertex.
    pub has_caustic_photons: bool,
}

impl Trial {
    /// Mean coefficients over weighted pixels. As long as few pixels have found something, what they would find
    /// where light is spread evenly counts as one more: theory.md (93e).
    pub fn relative(&self, weights: &[f64]) -> Coefficients {
        let weighted = self.noise.pixels.iter().zip(weights);
        let sum: Coefficients = weighted.map(|(pixel, &w)| pixel.noise.coefficients * w).sum();
        let mean = (sum * (weights.len() as f64).recip()).clamped();
        let more = (self.even - (mean.a + mean.f)).max(0.0) / (self.found(weights) + 1.0);
        Coefficients { f: mean.f + more, ..mean }
    }

    /// About how many pixels have found something: theory.md (93e).
    pub fn found(&self, weights: &[f64]) -> f64 {
        let (mut sum, mut squares) = (0.0, 0.0);
        for (pixel, &weight) in self.noise.pixels.iter().zip(weights) {
            let Coefficients { a, f, .. } = pixel.noise.coefficients;
            sum += (a + f) * weight;
            squares += ((a + f) * weight).powi(2);
        }
        if squares > 0.0 { sum * sum / squares } else { 0.0 }
    }
}

impl<'a> Site<'a> {
    /// For the image of this renderer, and trials of so many seconds or more.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn new(renderer: &'a Renderer, seconds: f64) -> Result<Self> {
        let (scene, accel) = renderer.scene_and_accel();
        let settings = renderer.settings();
        let stride = |paths: f64| {
            let sample = paths / f64::from(TRIAL_CAMERA_PATHS);
            let stride = (settings.pixels() as f64 / sample).sqrt() as u32;
            stride.clamp(1, settings.width.min(settings.height))
        };
        let each = TRIAL_MEASURING * seconds / TRIAL_ITERATIONS as f64;
        let probe = stride(TRIAL_PATHS.start);
        // Half of them are light paths.
        let per_path = seconds_per_path(renderer, probe)?;
        let paths = 0.5 * each / per_path;
        let paths = paths.clamp(TRIAL_PATHS.start, TRIAL_PATHS.end);
        let stride = stride(paths);
        let (area, footprint) = (merging_area(scene), footprint(scene, &**accel, settings));
        let most_light_paths = renderer.most_light_paths();
        let view = scene.camera.view(settings.width, settings.height);
        let resolution = [settings.width, settings.height];
        let seed = settings.seed.wrapping_add(TRIAL_SEED);
        Ok(Self {
            whole: renderer.with_settings(Settings { guide: 0, ..settings.clone() })?,
            ground: Ground { scene, accel: &**accel, view, resolution, seed },
            census: Vec::new(),
            known: vec![renderer.sample(Settings { guide: 0, ..settings.clone() }, stride)?],
            stride,
            guide: renderer.guide().cloned(),
            per_path,
            light_paths: (paths as u32).min(most_light_paths),
            most_light_paths,
            pixels: settings.pixels() as f64,
            area,
            footprint,
        })
    }

    /// Lets trials start light paths where it learns in about so long that they bring more; `None` if there is no time
    /// to learn that, or it does not pay.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn learn_guide(&mut self, seconds: f64) -> Result<Option<Guided>> {
        let start = Instant::now();
        let camera_paths = 2.0 * LEARNING_PIXELS * f64::from(LEARNING_CAMERA_PATHS);
        let iteration = self.per_path * (camera_paths + f64::from(LEARNING_LIGHT_PATHS));
        if f64::from(LEAST_LEARNING) * iteration > LEARNING_PATIENCE * seconds {
            return Ok(None);
        }
        let goes_on = |done: u32, guide: &Guide| {
            let is_hopeless = done >= LEARNING_ROUND && guide.expected() > WORTHWHILE_GUIDE;
            let has_time = done < MOST_LEARNING && start.elapsed().as_secs_f64() < seconds;
            !is_hopeless && (done < LEAST_LEARNING || has_time)
        };
        let Learned { guide, iterations, second_moment } = self.whole.learn_guide(goes_on)?;
        if iterations < LEAST_LEARNING || second_moment > WORTHWHILE_GUIDE {
            return Ok(None);
        }
        self.guide = Some(guide);
        Ok(Some(Guided { iterations, second_moment }))
    }

    /// Tries the strategy, radii and weights of `settings` for so long; one class of photons may be merged at
    /// nested radii.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn trial(
        &mut self,
        settings: &Settings,
        nests: Option<PhotonClass>,
        seconds: f64,
    ) -> Result<Trial> {
        let start = Instant::now();
        let light_paths = self.light_paths;
        let camera_paths = TRIAL_CAMERA_PATHS;
        // Its samples are none of the image's.
        let seed = settings.seed.wrapping_add(TRIAL_SEED);
        let mut own = Settings { light_paths, camera_paths, seed, guide: 0, ..settings.clone() };
        if nests.is_some() && own.caustic_radius == own.radius {
            // Equal radii are one for all photons, and would tell the bias of both classes twice.
            own.caustic_radius *= TOLD_APART;
        }
        let renderer = self.renderer(own.clone())?.guided(self.guide.clone());
        let batches = RenderConfig::with_pixel_batches();
        let mut renderer = renderer.configure(RenderConfig { nested_class: nests, ..batches })?;
        let elapsed = || start.elapsed().as_secs_f64();
        let (mut iterations, mut photons) = (0, 0);
        let measuring = TRIAL_MEASURING * seconds;
        while elapsed() < measuring
            || iterations < TRIAL_ITERATIONS && elapsed() < TRIAL_PATIENCE * measuring
            || iterations < 2
        {
            photons += renderer.iterate(Measure::Pairs).photons;
            iterations += 1;
        }
        let noise = renderer.block().noise_image()?;
        let has_caustic_photons = renderer.found_caustic_photons();
        let mut samples = Vec::new();
        let share = 0.5 * (1.0 - TRIAL_MEASURING) * seconds;
        let (mut light_paths, mut per_light_path) = (light_paths, 0.0);
        for _ in 0..2 {
            renderer.begin_block(Counts::uniform(light_paths, TIMED_CAMERA_PATHS))?;
            let begun = elapsed();
            let mut timed = 0;
            while timed < 1
                || elapsed() < begun + share
                || timed < TRIAL_TIMED && elapsed() < TRIAL_PATIENCE * seconds
            {
                renderer.iterate(Measure::Off);
                timed += 1;
            }
            samples.extend(times(&renderer));
            // As many more as fit in the time, and no less than tell a difference.
            let threads = rayon::current_num_threads() as f64;
            let light = renderer.block().clock.times.light.as_secs_f64() / (timed as f64 * threads);
            per_light_path = light / f64::from(light_paths);
            let fits = share / light;
            let ratio = (fits as u32).clamp(TIMED_RATIOS[0], TIMED_RATIOS[1]);
            light_paths = light_paths.saturating_mul(ratio).min(self.most_light_paths);
        }
        let pixels = f64::from(noise.width * noise.height);
        let model = fit(&samples, pixels)?.model;
        // Two times tell the part that is paid anyway badly: it is no more than half.
        let light_path = model.light_path.max(0.5 * per_light_path);
        Ok(Trial {
            radii: [own.caustic_radius, own.radius].map(f64::from),
            nests,
            noise,
            times: TimeModel { light_path, pixels: self.pixels, ..model },
            even: self.even(&own, photons as f64 / iterations as f64),
            has_caustic_photons,
        })
    }
}

impl<'a> Site<'a> {
    /// What areas cost a technique before they are known, within two reaches, scene units; `seconds` for each
    /// vertex and reach.
    pub fn surfaces(&mut self, technique: &Technique, reaches: [f64; 2], seconds: f64) -> Surfaces {
        let Some(areas) = self.known[0].areas() else { return Surfaces::default() };
        if technique.kernel == Kernel::Disc {
            return Surfaces::default();
        }
        let mut at = |vertex: u32, reach: f64| {
            let is_known = |known: &&(u32, f64, Census)| (known.0, known.1) == (vertex, reach);
            let known = self.census.iter().find(is_known).map(|known| known.2);
            let take = || self.ground.census(&areas.at(reach as f32), vertex, seconds);
            let census = known.unwrap_or_else(take);
            self.census.push((vertex, reach, census));
            (reach, census)
        };
        let census = technique.vertices().into_iter().map(|vertex| {
            let [near, far] = reaches;
            let low = at(vertex, near);
            // What would take too long to try is taken to be as bad as it can be.
            let worst = low.1.times((far / near).powf(CENSUS_POWER));
            let high = if worst.least_time() > seconds { (far, worst) } else { at(vertex, far) };
            [low, high]
        });
        let census = census.collect();
        let threads = rayon::current_num_threads();
        Surfaces { census, pixels_per_thread: self.pixels / threads as f64 }
    }

    /// Share of the image's pixels that trials take.
    pub fn sampled(&self) -> f64 {
        f64::from(self.stride * self.stride).recip()
    }

    /// Whether any surface is there for a share of the rays only.
    pub fn is_translucent(&self) -> bool {
        self.ground.scene.materials().iter().any(Material::is_translucent)
    }

    /// Whether lamps that rays can hit are seen in rough surfaces which paths pass through: all strategies but `mis` find
    /// them there by chance alone.
    pub fn mirrors_lamps_roughly(&self) -> bool {
        let (scene, lights) = (self.ground.scene, self.ground.scene.lights());
        let are_hit =
            lights.shine_from_beyond() || !lights.emitters().iter().all(Emitter::is_delta);
        are_hit && scene.materials().iter().any(|material| material.bsdf.has_rough())
    }

    /// One that shares areas with another of the same reach: most of what trials see is the same.
    fn renderer(&mut self, settings: Settings) -> Result<Renderer> {
        let is_same = |known: &&Renderer| {
            let known = known.settings();
            (known.kernel, known.reach()) == (settings.kernel, settings.reach())
        };
        if let Some(known) = self.known.iter().find(is_same) {
            return known.sample(settings, self.stride);
        }
        let new = self.known[0].sample(settings.clone(), self.stride)?;
        self.known.push(new);
        self.renderer(settings)
    }

    /// A photon is one of so many that share the area, and is found on a disc of it.
    /// theory.md (93e).
    fn even(&self, settings: &Settings, photons: f64) -> f64 {
        let reach = f64::from(settings.radius.max(settings.caustic_radius));
        let per_light_path = photons.max(1.0) / f64::from(settings.light_paths);
        (self.area / (PI * reach * reach * per_light_path)).max(1.0)
    }
}

/// Wall-clock time of a path of either kind in trials that take one of so many by so many pixels.
fn seconds_per_path(renderer: &Renderer, stride: u32) -> Result<f64> {
    let light_paths = (TRIAL_PATHS.start as u32).min(renderer.most_light_paths());
    let camera_paths = TRIAL_CAMERA_PATHS;
    let own = Settings { light_paths, camera_paths, guide: 0, ..renderer.settings().clone() };
    let mut probe = renderer.sample(own, stride)?;
    let paths = probe.settings().pixels() as f64 * f64::from(camera_paths) + f64::from(light_paths);
    // The first one meets cold memory.
    probe.iterate(Measure::Pairs);
    let start = Instant::now();
    probe.iterate(Measure::Pairs);
    Ok(start.elapsed().as_secs_f64() / paths)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::load;
    use crate::scene::backend::{Backend, build};
    use crate::settings::Direct;

    #[test]
    fn equal_radii_tell_the_bias_of_each_class_alone() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box-classic");
        let loaded = load(folder).unwrap();
        let own = Settings::resolve(&Default::default(), &loaded.defaults, loaded.scene.size());
        let own = own.unwrap();
        // Light straight from the lamp is then merged, too.
        let (direct, radius) = (Direct::PhotonMap, 8.0 * own.radius);
        let (width, height, light_paths) = (16, 16, 4000);
        let own =
            Settings { direct, radius, caustic_radius: radius, width, height, light_paths, ..own };
        let accel = build(Backend::Bvh, &loaded.scene).unwrap();
        let renderer = Renderer::new(&loaded.scene, &accel, own.clone()).unwrap();
        let mut site = Site::new(&renderer, 0.0).unwrap();
        // In no time: two iterations, the same ones each time.
        let mut nested = |class| -> Vec<f64> {
            let trial = site.trial(&own, Some(class), 0.0).unwrap();
            trial.noise.pixels.iter().map(|pixel| pixel.noise.nested[1]).collect()
        };
        let [every, last] = [PhotonClass::Caustic, PhotonClass::Diffuse].map(&mut nested);
        let square = |values: &[f64]| values.iter().map(|d| d * d).sum::<f64>();
        let between: Vec<f64> = every.iter().zip(&last).map(|(a, b)| a - b).collect();
        assert!(square(&every) > 0.0 && square(&last) > 0.0);
        assert!(square(&between) > 0.1 * square(&every), "both tell the same");
    }
}
