//! Photons at meters: light of points, spots and parallel light that arrives by mirrors, and
//! through glass that is no pane. Neither connections nor camera paths contribute it. Its photons
//! are merged on a disc around each meter. theory.md (5c)

mod discs;
mod guide;
#[cfg(test)]
mod tests;

use bdpm_core::accel::{Hit, Intersect, Ray};
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::base::rng::{Rng, Stream, StreamKey};
use bdpm_core::scene::bsdf::{BsdfSample, Lobe, LobeSet, Transport};
use bdpm_core::scene::{Emission, Lights, Meter, Scene, Surface};
use bdpm_core::transport::free_flight::MediumVertex;
use bdpm_core::transport::path_state::{History, PathState};
use bdpm_core::transport::roulette::survives_passing;
use bdpm_core::transport::step::{PathVertex, Role, Segment, Walker, step_at_pane, walk};
pub use discs::{MeterDiscs, RADII, RATIO};
use guide::{GuideGrid, GuidedStart, StartGuide};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Light paths of a batch, which one thread traces.
const BATCH: u32 = 1024;

/// Maximum number of batches of an iteration, and their number while the guide is learned.
const BATCHES: u32 = 64;

/// Minimum number of batches of an iteration.
const LEAST_BATCHES: u32 = 4;

/// Light paths of an iteration while the guide is learned.
const PATHS: u32 = BATCH * BATCHES;

/// Cells of the guide along each number, and factors of the radius of the largest discs, in the
/// stages of learning.
const STAGES: [(usize, f32); 2] = [(32, 4.0), (128, 1.5)];

/// Paths that arrive in the stages of learning, and iterations after which a stage ends without
/// them.
const ENOUGH_ARRIVED: u32 = 400;
const MOST_ITERATIONS: u64 = 8;

/// Minimum number of iterations of a stage.
const LEAST_ITERATIONS: u64 = 4;

/// Number of iterations of the first stage, if there is time: the more paths no guide aimed, the
/// less light they miss.
const UNGUIDED_ITERATIONS: u64 = 16;

/// Luminance of the irradiance of a meter by the photons of an iteration on the nested discs,
/// W/m^2.
pub type DiscIrradiances = [f64; RADII];

/// Traces photons to the meters of a scene.
pub struct MeterPhotons<'a> {
    scene: &'a Scene,
    accel: &'a dyn Intersect,
    lights: Lights,
    discs: MeterDiscs,
    count: usize,
    seed: u64,
    guide: Option<StartGuide>,
    iterations: u64,
    /// Batches of each of the following iterations.
    batches: u32,
    /// Time of a batch of the latest stage of learning.
    batch_time: Duration,
    /// Paths that arrived in the largest discs, in all iterations.
    arrived: u64,
    /// Luminance of the flux of a path in the first stage of learning over the area of its discs,
    /// W/m^2.
    of_one_path: f64,
}

/// What a batch of paths brings to the discs.
#[derive(Default)]
struct BatchSums {
    /// Meter, number of nested discs, luminance of the flux, W.
    crossings: Vec<(u32, u8, f64)>,
    /// Cells of the starts of paths that arrived.
    cells: Vec<usize>,
}

impl<'a> MeterPhotons<'a> {
    /// Photons for the meters, merged on discs of this radius and smaller ones, scene units. Learns
    /// from where light arrives for about at most the time `learning`. `None` if no light is
    /// without a surface, or no surface passes light on.
    pub fn new(
        scene: &'a Scene,
        accel: &'a dyn Intersect,
        meters: &[Meter],
        radius: f32,
        seed: u64,
        learning: Option<Duration>,
    ) -> Option<Self> {
        let emitters = scene.lights().emitters().iter();
        let lights = Lights::new(emitters.filter(|own| own.is_delta()).cloned().collect());
        let passes = |material: u32| {
            let material = &scene.materials()[material as usize];
            material.bsdf.passes_through() && !material.is_index_matched_boundary()
        };
        let is_needed = scene.placements().iter().any(|placement| passes(placement.material));
        if lights.is_empty() || !is_needed {
            return None;
        }
        let discs = MeterDiscs::new(meters, radius);
        let mut photons = Self {
            scene,
            accel,
            lights,
            discs,
            count: meters.len(),
            seed,
            guide: None,
            iterations: 0,
            batches: BATCHES,
            batch_time: Duration::ZERO,
            arrived: 0,
            of_one_path: f64::INFINITY,
        };
        photons.learn(meters, radius, learning);
        Some(photons)
    }

    /// Learns from where paths arrive, by the discs of larger radii.
    fn learn(&mut self, meters: &[Meter], radius: f32, time: Option<Duration>) {
        let start = Instant::now();
        let lights = self.lights.emitters().len();
        for (stage, (side, factor)) in (0..).zip(STAGES) {
            let grid = GuideGrid::new(lights, side);
            let discs = MeterDiscs::new(meters, factor * radius);
            let (mut counts, mut total) = (vec![0u32; grid.len()], 0);
            let mut paths = 0.0;
            let begin = Instant::now();
            let [least, most] = match stage {
                0 => [UNGUIDED_ITERATIONS; 2],
                _ => [LEAST_ITERATIONS, MOST_ITERATIONS],
            };
            for iteration in 0..most {
                paths += f64::from(PATHS);
                let number = stage * UNGUIDED_ITERATIONS + iteration;
                let key = StreamKey::new(self.seed, Stream::MeterPilot, number);
                for batch in self.trace_batches(BATCHES, key, grid, &discs) {
                    total += batch.cells.len() as u32;
                    batch.cells.into_iter().for_each(|cell| counts[cell] += 1);
                }
                let is_decided = total == 0 || total >= ENOUGH_ARRIVED;
                // Each stage has an equal share of the time.
                let share = f64::from(stage as u32 + 1) / STAGES.len() as f64;
                let is_late = time.is_some_and(|time| start.elapsed() >= time.mul_f64(share));
                if is_late || is_decided && iteration + 1 >= least {
                    break;
                }
            }
            self.batch_time = begin.elapsed().div_f64(paths / f64::from(BATCH));
            if self.guide.is_none() {
                let flux = f64::from(self.lights.total_power()) / paths;
                self.of_one_path = self.of_one_path.min(flux / discs.area(0));
            }
            self.guide = StartGuide::new(grid, &self.lights, &counts).or(self.guide.take());
            if self.guide.is_none() {
                return;
            }
        }
    }

    /// Traces the paths of another iteration, and returns the irradiance of each meter. The result
    /// does not depend on the number of threads.
    pub fn iterate(&mut self) -> Vec<DiscIrradiances> {
        let key = StreamKey::new(self.seed, Stream::MeterPhotons, self.iterations);
        let grid = GuideGrid::new(self.lights.emitters().len(), 1);
        let mut sums = vec![[0.0; RADII]; self.count];
        for batch in self.trace_batches(self.batches, key, grid, &self.discs) {
            self.arrived += batch.cells.len() as u64;
            for (meter, levels, flux) in batch.crossings {
                sums[meter as usize][..levels.into()].iter_mut().for_each(|sum| *sum += flux);
            }
        }
        for sums in &mut sums {
            for (level, sum) in sums.iter_mut().enumerate() {
                *sum /= f64::from(self.paths()) * self.discs.area(level);
            }
        }
        self.iterations += 1;
        sums
    }

    /// Returns true if paths arrived near any meter while the guide was learned.
    pub fn arrives(&self) -> bool {
        self.guide.is_some()
    }

    /// Number of iterations.
    pub fn iterations(&self) -> u64 {
        self.iterations
    }

    /// Paths that arrived at any meter.
    pub fn arrived(&self) -> u64 {
        self.arrived
    }

    /// Luminance of the irradiance of a meter by a single path that no guide makes likely, W/m^2:
    /// on the large discs of the first stage of learning, from which the guide learned where light
    /// arrives.
    pub fn of_one_path(&self) -> f64 {
        self.of_one_path
    }

    /// Chooses the number of light paths such that so many iterations take about this time. All
    /// iterations must have one number of paths.
    pub fn fit(&mut self, iterations: u64, time: Duration) {
        assert_eq!(self.iterations, 0, "iterations of one size");
        let batch_time = self.batch_time.as_secs_f64().max(1e-9);
        let batches = time.as_secs_f64() / (iterations as f64 * batch_time);
        self.batches = (batches as u32).clamp(LEAST_BATCHES, BATCHES);
    }

    /// Light paths of an iteration.
    pub fn paths(&self) -> u32 {
        self.batches * BATCH
    }

    fn trace_batches(
        &self,
        count: u32,
        key: StreamKey,
        grid: GuideGrid,
        discs: &MeterDiscs,
    ) -> Vec<BatchSums> {
        let one = |batch: u32| {
            let paths = u64::from(batch * BATCH)..u64::from((batch + 1) * BATCH);
            self.trace(paths.map(|path| key.rng(path)), grid, discs)
        };
        (0..count).into_par_iter().map(one).collect()
    }

    /// Traces paths to their ends.
    fn trace(
        &self,
        rngs: impl Iterator<Item = Rng>,
        grid: GuideGrid,
        discs: &MeterDiscs,
    ) -> BatchSums {
        let mut starts = Vec::new();
        let paths: Vec<Segment> = (0..)
            .zip(rngs)
            .map(|(path, rng)| {
                let (ray, state, cell) = self.start(rng, grid);
                starts.push(cell);
                (ray, PathState { path, ..state })
            })
            .collect();
        let sums = BatchSums::default();
        let mut batch = Batch { photons: self, discs, starts, sums };
        walk(&mut batch, (self.scene, self.accel), paths.into_iter());
        batch.sums
    }

    fn start(&self, mut rng: Rng, grid: GuideGrid) -> (Ray, PathState, usize) {
        let start: GuidedStart = match &self.guide {
            Some(guide) => guide.start(grid, &self.lights, &mut rng),
            None => grid.start(&self.lights, &mut rng),
        };
        let Emission { origin, direction, flux } =
            self.lights.emit_chosen(start.light, start.prob, start.at);
        let media = self.scene.media();
        let around = media.map(|media| media.at(self.scene, self.accel, origin));
        let history = History::default().within(around.unwrap_or_default());
        let weight = flux / start.density as f32;
        let inverse_start = weight.max_element().max(f32::MIN_POSITIVE).recip();
        let state = PathState { rng, weight, inverse_start, path: 0, history };
        (Ray::new(origin, direction), state, start.cell)
    }
}

/// A batch of paths.
struct Batch<'a> {
    photons: &'a MeterPhotons<'a>,
    discs: &'a MeterDiscs,
    /// Cell of the start of each path.
    starts: Vec<usize>,
    sums: BatchSums,
}

impl Role for Batch<'_> {
    const TRANSPORT: Transport = Transport::Flux;

    fn at_surface(&mut self, vertex: &PathVertex, rng: &mut Rng) -> Option<BsdfSample> {
        let PathVertex { surface, at, state } = *vertex;
        let sample = surface.bsdf.sample(at, Transport::Flux, LobeSet::PassThrough, rng)?;
        // Meters are connected with the vertices next to the lights if their lobes have a finite
        // density.
        let is_connected = state.history.is_start() && sample.lobe == Lobe::Rough;
        let goes_on = !is_connected && sample.lobe.passes_through();
        (goes_on && surface.agrees(at, sample.wi)).then_some(sample)
    }

    fn arrive_in_medium(&mut self, _vertex: &MediumVertex, _state: &mut PathState) -> bool {
        false
    }

    fn survives(&self, weight: Rgb, _lobe: Option<Lobe>, state: &mut PathState) -> bool {
        state.weight *= weight;
        // Glass may trap light by total reflection.
        survives_passing(state)
    }
}

impl Walker for Batch<'_> {
    /// Adds the crossings of discs by a segment.
    fn segment(&mut self, ray: &Ray, hit: &Hit, state: &PathState) {
        if state.history.is_straight() {
            return;
        }
        let Self { photons: MeterPhotons { scene, .. }, discs, starts, sums } = self;
        let mut has_arrived = false;
        let medium = scene.media().and_then(|media| media.medium(state.history.media()));
        discs.cross(ray.origin, ray.direction, hit.t, |meter, levels, distance| {
            has_arrived = true;
            let way = medium.map_or(Rgb::ONE, |medium| medium.transmittance(distance));
            let flux = f64::from(luminance(state.weight * way));
            sums.crossings.push((meter, levels as u8, flux));
        });
        sums.cells.extend(has_arrived.then_some(starts[state.path as usize]));
    }

    fn pass_straight(&self, surface: &Surface, state: &PathState) -> Option<Option<Segment>> {
        let MeterPhotons { scene, accel, .. } = *self.photons;
        if !state.history.is_straight() {
            return None;
        }
        let pane = scene.pane_at(accel, surface, state.history.media())?;
        let gone_on = step_at_pane(&pane, surface, *state);
        Some(
            gone_on
                .map(|(ray, own)| (ray, PathState { history: own.history.through_slab(), ..own })),
        )
    }
}
