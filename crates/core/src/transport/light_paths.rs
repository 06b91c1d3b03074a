//! Light phase: traces light paths breadth-first and stores their photons.

use super::area::Areas;
use super::free_flight::{MediumVertex, Passed, travel, travel_all};
use super::mis::Mis;
use super::mis::photons::LightPartials;
use super::mis::weights::PhotonPartials;
use super::path_queue::PathQueue;
use super::path_state::{History, PathState, PathStates, other_surface};
use super::photon::{Arrival, Extent, Photon, PhotonClass, PhotonPacket, pack_wavelength};
use crate::accel::{Coherence, HitPacket, Intersect, Ray};
use crate::base::math::{Rgb, pack_direction};
use crate::base::pool::Pool;
use crate::base::rng::{Stream, StreamKey};
use crate::scene::bsdf::Lobe;
use crate::scene::diffuse::{DiffuseVertices, TriangleSide};
use crate::scene::lights::guide::Guide;

use crate::scene::{Emitter, HitScratch, PrimarySamples, Scene, Surface};
use crate::settings::{Direct, Settings};
use crate::simd::dispatch::{Simd, vectorized};
use crate::simd::sobol::ScrambledSobol;
use crate::simd::{LANES, Mask, Rngs, any, lanes_of};
use glam::Vec3;
use rayon::prelude::*;
use std::mem;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Light paths per batch. It is fixed, so that results do not depend on the number of threads. As
/// many fill ray packets, and a batch of them stays in the second-level cache.
const BATCH: u32 = 1024;

/// Maximum survival probability: paths end even between perfectly white walls.
pub(super) const MAX_SURVIVAL: f32 = 0.995;

/// The photons of one iteration; buffers are reused by the next.
#[derive(Default)]
pub struct LightPaths {
    batches: Vec<Batch>,
    tracers: Pool<Tracer>,
    /// Density of the starts of paths; without it they start in proportion to the lights' power.
    pub guide: Option<Arc<Guide>>,
    /// Distinguishes the sides of surfaces, for merges by area.
    pub areas: Option<Arc<Areas>>,
    /// Leaves out paths once it is true.
    pub interrupt: Option<Arc<AtomicBool>>,
    /// Keeps only paths that no camera path finds: from lights that no ray can hit, whose first
    /// vertex takes a single direction. Direct light must be connected.
    pub unfindable_only: bool,
}

impl LightPaths {
    /// Traces `light_paths` paths of `iteration`.
    ///
    /// # Panics
    /// If the scene has no lights.
    pub fn trace(
        &mut self,
        scene: &Scene,
        accel: &dyn Intersect,
        settings: &Settings,
        light_paths: u32,
        iteration: u64,
    ) {
        let key = StreamKey::new(settings.seed, Stream::LightPath, iteration);
        let count = light_paths.div_ceil(BATCH);
        self.batches.resize_with(count as usize, Batch::default);
        let Self { batches, tracers, guide, areas, interrupt, unfindable_only } = self;
        let unfindable_only = *unfindable_only;
        let (guide, areas) = (guide.as_deref(), areas.as_deref());
        let sets = StreamKey::new(settings.seed, Stream::LightPathSet, iteration);
        let splitting = settings.splitting as f32;
        let pass = LightPass {
            scene,
            accel,
            settings,
            guide,
            areas,
            key,
            sets,
            splitting,
            unfindable_only,
        };
        let batches = batches.par_iter_mut().zip(0..count);
        batches.for_each_init(
            || tracers.lease(),
            |tracer, (batch, index)| {
                let first = index * BATCH;
                let is_over = interrupt.as_ref().is_some_and(|own| own.load(Ordering::Relaxed));
                let count = if is_over { 0 } else { BATCH.min(light_paths - first) };
                tracer.trace(&pass, first..first + count, batch);
            },
        );
    }

    /// All photons in slices of consecutive paths. The photons of a slice are ordered bounce by
    /// bounce.
    pub fn photons(&self) -> impl Iterator<Item = &[Photon]> + Clone {
        self.batches.iter().map(|batch| batch.photons.as_slice())
    }

    /// All photons in media, in slices of consecutive paths.
    pub fn medium_photons(&self) -> impl Iterator<Item = &[Photon]> + Clone {
        self.batches.iter().map(|batch| batch.medium_photons.as_slice())
    }

    /// MIS partials of all photons in the same slices, which are empty without MIS.
    pub fn mis_partials(&self) -> impl Iterator<Item = &[PhotonPartials]> + Clone {
        self.batches.iter().map(|batch| batch.mis_partials.as_slice())
    }

    /// Bounds and number of all photons.
    pub fn extent(&self) -> Extent {
        self.batches.iter().map(|batch| batch.extent).fold(Extent::default(), Extent::and)
    }

    /// Number of photons.
    pub fn len(&self) -> usize {
        self.extent().count
    }

    /// Tests whether no path left a photon.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Time that all threads together spent on tracing.
    pub fn busy_time(&self) -> Duration {
        self.batches.iter().map(|batch| batch.busy).sum()
    }

    /// Number of rays traced.
    pub fn rays(&self) -> u64 {
        self.batches.iter().map(|batch| batch.rays).sum()
    }
}

/// Settings that all light paths of an iteration share.
struct LightPass<'a> {
    scene: &'a Scene,
    accel: &'a dyn Intersect,
    settings: &'a Settings,
    guide: Option<&'a Guide>,
    areas: Option<&'a Areas>,
    /// Random streams of the light paths. The upper half of an index numbers their continuations
    /// where they split.
    key: StreamKey,
    /// Random streams of their sets.
    sets: StreamKey,
    /// Factor on the number of continuations at the first diffuse vertex.
    splitting: f32,
    /// See [`LightPaths::unfindable_only`].
    unfindable_only: bool,
}

impl LightPass<'_> {
    /// Numbers that start the sixteen light paths from `first`, a multiple of sixteen.
    #[inline(always)] // part of the loop over light paths
    fn starts(&self, first: u32, rngs: &mut Rngs) -> PrimarySamples {
        let size = self.settings.sobol_set;
        if size == 1 {
            return PrimarySamples::independent(rngs);
        }
        let set = ScrambledSobol::new(self.sets.rng(u64::from(first / size)));
        PrimarySamples::of_points(&set.points(first % size), rngs)
    }

    /// The independent sample that a light path belongs to: its set of Sobol points.
    #[inline(always)]
    fn sample_of(&self, path: u32) -> u32 {
        path >> self.settings.sobol_set.trailing_zeros()
    }
}

/// Photons of consecutive paths.
#[derive(Debug, Default)]
struct Batch {
    /// Ordered bounce by bounce.
    photons: PhotonList,
    /// Photons where media scattered the paths.
    medium_photons: PhotonList,
    /// MIS partials of the photons; empty without MIS.
    mis_partials: Vec<PhotonPartials>,
    extent: Extent,
    rays: u64,
    busy: Duration,
}

/// Photons by which a full [`PhotonList`] grows.
const STEP: usize = 256;

/// A list to which photons are added sixteen at a time.
#[derive(Debug, Default)]
struct PhotonList {
    /// The first `count` are valid.
    buffer: Vec<Photon>,
    count: usize,
}

impl PhotonList {
    fn clear(&mut self) {
        self.count = 0;
    }

    fn as_slice(&self) -> &[Photon] {
        &self.buffer[..self.count]
    }

    /// Space for the photons of sixteen paths; [`Self::commit`] adds those that were written.
    #[inline(always)]
    fn space(&mut self) -> &mut [Photon; LANES] {
        let end = self.count + LANES;
        if self.buffer.len() < end {
            self.buffer.resize(end.next_multiple_of(STEP), Photon::default());
        }
        self.buffer[self.count..].first_chunk_mut().expect("there is room")
    }

    /// Adds the first `count` photons that were written to [`Self::space`].
    #[inline(always)]
    fn commit(&mut self, count: usize) {
        self.count += count;
    }

    fn push(&mut self, photon: Photon) {
        self.space()[0] = photon;
        self.commit(1);
    }
}

/// A reusable workspace that traces one batch after another.
#[derive(Debug, Default)]
struct Tracer {
    segments: PathQueue<PathStates, 16>,
    /// The segments of the next bounce, in the order in which they are found.
    next: PathQueue<PathStates, 16>,
    hits: Vec<HitPacket>,
    /// Photons of the current batch.
    photons: PhotonList,
    medium_photons: PhotonList,
    partials: LightPartials,
    /// Photons keep their directions.
    stores_directions: bool,
    /// Photons keep their wavelengths.
    stores_wavelengths: bool,
    /// Photons straight from a light source are stored, not replaced by connections.
    stores_direct: bool,
}

impl Tracer {
    fn trace(&mut self, pass: &LightPass, paths: Range<u32>, batch: &mut Batch) {
        let start = Instant::now();
        mem::swap(&mut self.photons, &mut batch.photons);
        mem::swap(&mut self.medium_photons, &mut batch.medium_photons);
        mem::swap(&mut self.partials.photons, &mut batch.mis_partials);
        self.photons.clear();
        self.medium_photons.clear();
        self.partials.start(Mis::new(pass.settings), paths.clone());
        self.stores_directions = pass.scene.merges_by_direction();
        self.stores_wavelengths = pass.scene.is_dispersive();
        self.stores_direct = pass.settings.direct == Direct::PhotonMap;
        batch.rays = 0;
        vectorized(
            #[inline(always)]
            |simd| self.emit(simd, pass, paths),
        );
        while self.segments.len() > 0 {
            batch.rays += self.segments.len() as u64;
            let count = self.segments.len();
            let rays = vectorized(
                #[inline(always)]
                |_| self.segments.rays(),
            );
            self.hits.resize(rays.len(), HitPacket::default());
            pass.accel.intersect(rays, count, &mut self.hits, Coherence::Incoherent);
            vectorized(
                #[inline(always)]
                |simd| self.bounce(simd, pass),
            );
        }
        mem::swap(&mut self.photons, &mut batch.photons);
        mem::swap(&mut self.medium_photons, &mut batch.medium_photons);
        mem::swap(&mut self.partials.photons, &mut batch.mis_partials);
        batch.extent = Extent::of(batch.photons.as_slice());
        batch.busy = start.elapsed();
    }

    #[inline(always)] // vectorized
    fn emit(&mut self, simd: Simd, pass: &LightPass, mut paths: Range<u32>) {
        self.segments.clear();
        let mut states = PathStates::default();
        while !paths.is_empty() {
            let first = paths.start;
            let count = paths.by_ref().take(LANES).count();
            for lane in 0..count {
                states.rng.set(lane, pass.key.rng(u64::from(first) + lane as u64));
            }
            let starts = pass.starts(first, &mut states.rng);
            let emissions = pass.scene.lights().emit_all(pass.guide, &starts, count);
            if self.partials.is_active() {
                self.partials.emit(pass.scene.lights(), first, &emissions, count);
            }
            (states.origin, states.direction) = (emissions.origin, emissions.direction);
            states.weight = emissions.flux;
            let mut emitted = Mask::default();
            for (lane, emitted) in emitted.iter_mut().enumerate() {
                states.path[lane] = first.wrapping_add(lane as u32);
                // Black parts of pictures emit nothing.
                *emitted = (lane < count) & (states.weight.get(lane) != Rgb::ZERO);
            }
            if pass.unfindable_only {
                let emitters = pass.scene.lights().emitters();
                for (lane, emitted) in emitted.iter_mut().enumerate() {
                    let emitter = emitters.get(emissions.emitter[lane] as usize);
                    *emitted &= emitter.is_some_and(Emitter::is_delta);
                }
            }
            if pass.scene.media().is_some() {
                for lane in 0..count {
                    let origin = emissions.origin.get(lane);
                    let emitter = emissions.emitter[lane];
                    let around = pass.scene.media_at_emitter(pass.accel, emitter, origin);
                    states.history[lane] = History::default().within(around);
                }
            }
            self.segments.append(simd, &emitted, &states);
        }
    }

    /// Stores a photon at each hit of a surface that merges, and scatters the path.
    #[inline(always)] // vectorized
    fn bounce(&mut self, simd: Simd, pass: &LightPass) {
        let scene = pass.scene;
        self.next.clear();
        let (segments, mut all_hits) = (mem::take(&mut self.segments), mem::take(&mut self.hits));
        let (mut states, mut seen, mut at) = <(PathStates, HitScratch, DiffuseVertices)>::default();
        for (packet, hits) in all_hits.iter_mut().enumerate() {
            let count = segments.load(packet, &mut states);
            if let Some(media) = scene.media() {
                travel_all(&mut states, hits, count, |ray, hit, state| {
                    let passed = travel(scene, media, ray, hit, state);
                    passed.map(|passed| self.pass(pass, *state, passed)).is_none()
                });
            }
            let rest = scene.lambertian(simd, &states.direction, hits, count, &mut seen, &mut at);
            if rest.others != 0 {
                scene.read_ahead(hits, rest.others);
            }
            for lane in lanes_of(rest.others) {
                let (ray, mut state) = states.get(lane);
                let hit = hits.get(lane);
                if let Some(surface) = other_surface(scene, &ray, &hit, &mut at, lane, &mut state)
                    && let Some((ray, state)) =
                        self.scatter_other(pass, &surface, ray.origin, state)
                {
                    self.next.push_state(&ray, &state);
                }
            }
            self.store_diffuse(simd, pass, &at, &states);
            let arrived = self.partials.is_active().then_some(states);
            let goes_on = self.scatter_diffuse(simd, pass, &at, &mut states);
            if let Some(arrived) = arrived {
                self.partials.scatter_diffuse(scene.lights(), &at, &arrived, &goes_on);
            }
        }
        self.hits = all_hits;
        self.segments = mem::replace(&mut self.next, segments);
    }

    /// Continues a path that met no surface that scatters. Where a medium scatters it, stores a
    /// photon.
    #[inline(never)] // media are rare
    fn pass(&mut self, pass: &LightPass, mut state: PathState, passed: Passed) {
        let MediumVertex { medium, position, direction, weight, .. } = match passed {
            Passed::Boundary(ray) => return self.next.push_state(&ray, &state),
            Passed::Scattered(vertex) => vertex,
        };
        if pass.unfindable_only && state.history.is_start() {
            return;
        }
        if self.stores_direct || !state.history.is_start() {
            let (path, class) = (pass.sample_of(state.path), class_of(state.history));
            // theory.md (37g)
            let photon = Photon::new(position, path, state.weight * weight, Vec3::ZERO, class);
            let mut photon = photon.coming_from(-direction);
            if self.stores_wavelengths {
                photon.from = pack_wavelength(photon.from, state.history.wavelength_index());
            }
            self.medium_photons.push(photon);
        }
        let weight = weight * medium.scattering;
        let survival = survival(weight);
        if state.rng.next_1d() < survival {
            state.weight *= weight / survival;
            state.history = state.history.scattered();
            let next = medium.scatter(direction, &mut state.rng);
            self.next.push_state(&Ray::new(position, next), &state);
        }
    }

    /// Stores arrivals at diffuse vertices.
    #[inline(always)] // vectorized
    fn store_diffuse(
        &mut self,
        simd: Simd,
        pass: &LightPass,
        at: &DiffuseVertices,
        states: &PathStates,
    ) {
        let (mut stored, mut arrival, mut from) = (Mask::default(), [0; LANES], [0; LANES]);
        for lane in 0..LANES {
            let history = states.history[lane];
            stored[lane] = at.active[lane] & (self.stores_direct | !history.is_start());
            arrival[lane] = Arrival::new(at.normal.get(lane), class_of(history) as u32).0;
        }
        if !any(&stored) {
            return;
        }
        if self.partials.is_active() {
            self.partials.store_diffuse(&stored, states);
        }
        if self.stores_directions {
            for (lane, from) in from.iter_mut().enumerate() {
                *from = pack_direction(-states.direction.get(lane));
            }
        }
        if self.stores_wavelengths {
            for (lane, from) in from.iter_mut().enumerate() {
                *from = pack_wavelength(*from, states.history[lane].wavelength_index());
            }
        }
        if let Some(areas) = pass.areas {
            for lane in (0..LANES).filter(|&lane| stored[lane]) {
                let tag = areas.side_tag(at.mesh[lane], at.side[lane]);
                arrival[lane] = Arrival(arrival[lane]).on_side(tag).0;
            }
        }
        let path = states.path.map(|path| pass.sample_of(path));
        let (position, flux) = (at.position, states.weight);
        let photons = PhotonPacket { position, path, flux, arrival };
        // Writes all sixteen and keeps those that are stored: a branch for each could not be
        // predicted.
        let (space, mut count) = (self.photons.space(), 0);
        photons.one_by_one(simd, &from, |lane, photon| {
            space[count % LANES] = photon;
            count += usize::from(stored[lane]);
        });
        self.photons.commit(count);
    }

    /// Scatters at diffuse vertices, and returns the lanes whose paths survive. Without splitting
    /// each has at most one continuation.
    #[inline(always)] // vectorized
    fn scatter_diffuse(
        &mut self,
        simd: Simd,
        pass: &LightPass,
        at: &DiffuseVertices,
        states: &mut PathStates,
    ) -> Mask {
        states.origin = at.off_surface;
        states.direction = at.sample(&mut states.rng);
        let ends = states.rng.next_1d();
        let (mut goes_on, mut expected) = (Mask::default(), [0.0; LANES]);
        for lane in 0..LANES {
            let (flux, albedo) = (states.weight.get(lane), at.albedo.get(lane));
            let is_first = states.history[lane].diffuse() == 0;
            expected[lane] = survival(albedo) * if is_first { pass.splitting } else { 1.0 };
            goes_on[lane] = at.active[lane] & (ends[lane] < expected[lane]);
            goes_on[lane] &= !(pass.unfindable_only & states.history[lane].is_start());
            // theory.md (38)
            states.weight.set(lane, flux * (albedo / expected[lane]));
            states.history[lane] = states.history[lane].scattered();
        }
        self.next.append(simd, &goes_on, states);
        if pass.splitting > 1.0 {
            self.split(simd, pass, at, states, (&ends, &expected));
        }
        goes_on
    }

    /// Adds the continuations after the first. Their number is the expected one, rounded up or down
    /// at random. theory.md (39a)
    #[inline(always)] // vectorized
    fn split(
        &mut self,
        simd: Simd,
        pass: &LightPass,
        at: &DiffuseVertices,
        first: &PathStates,
        (ends, expected): (&[f32; LANES], &[f32; LANES]),
    ) {
        let mut states = *first;
        for number in 1u32.. {
            let mut goes_on = Mask::default();
            for (lane, goes_on) in goes_on.iter_mut().enumerate() {
                *goes_on = at.active[lane] & (number as f32 + ends[lane] < expected[lane]);
            }
            if !any(&goes_on) {
                return;
            }
            for lane in 0..LANES {
                let stream = u64::from(number) << 32 | u64::from(states.path[lane]);
                states.rng.set(lane, pass.key.rng(stream));
            }
            states.direction = at.sample(&mut states.rng);
            self.next.append(simd, &goes_on, &states);
        }
    }

    /// Stores and scatters at a surface that is not only diffuse. Returns the next ray unless the
    /// path ends.
    fn scatter_other(
        &mut self,
        pass: &LightPass,
        surface: &Surface,
        origin: Vec3,
        mut state: PathState,
    ) -> Option<(Ray, PathState)> {
        let lights = pass.scene.lights();
        let Surface { position, normal, wo, .. } = *surface;
        if surface.bsdf.merges() && (self.stores_direct || !state.history.is_start()) {
            self.partials.store(&state);
            let class = class_of(state.history);
            let TriangleSide { mesh, side } = surface.facet;
            let tag = pass.areas.map_or(0, |areas| areas.side_tag(mesh, side));
            let path = pass.sample_of(state.path);
            let photon = Photon::new(position, path, state.weight, normal, class).on_side(tag);
            let mut photon = if self.stores_directions { photon.coming_from(wo) } else { photon };
            if self.stores_wavelengths {
                photon.from = pack_wavelength(photon.from, state.history.wavelength_index());
            }
            self.photons.push(photon);
        }
        let sample = surface.scatter_flux(&mut state.rng)?;
        if pass.unfindable_only && state.history.is_start() && sample.lobe != Lobe::Delta {
            return None;
        }
        self.partials.scatter(lights, surface, origin, &state, &sample);
        state.history = if sample.lobe.passes_through() {
            state.history.passed_through()
        } else {
            state.history.scattered()
        };
        let survival = survival(sample.weight);
        if state.rng.next_1d() >= survival {
            return None;
        }
        // theory.md (38)
        state.weight *= sample.weight / survival;
        state.history = state.history.leaving(pass.scene, surface, sample.wi);
        Some((Ray::new(surface.start(sample.wi), sample.wi), state))
    }
}

/// Class of the next photon of a path: theory.md, section 4.
#[inline(always)] // part of vector loops, as the function below
pub(super) fn class_of(history: History) -> PhotonClass {
    if history.diffuse() == 0 { PhotonClass::Caustic } else { PhotonClass::Diffuse }
}

/// Survival probability at a vertex that multiplies the flux by `weight`: theory.md (39).
#[inline(always)]
pub(super) fn survival(weight: Rgb) -> f32 {
    weight.max_element().min(MAX_SURVIVAL)
}
