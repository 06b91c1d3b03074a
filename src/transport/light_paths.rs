//! Light phase: traces light paths breadth-first and stores their photons.

use super::mis::Mis;
use super::mis::photons::PhotonParts;
use super::path_queue::Flight;
use super::path_state::{Depth, WEIGHT_FLOOR, Walk, Walks, at_other_surface};
use super::photon::{Extent, Photon, PhotonClass, Photons, Side};
use crate::accel::{Coherence, HitPacket, Intersect, Ray};
use crate::base::math::{Rgb, pack_direction};
use crate::base::pool::Pool;
use crate::base::rng::{Stream, StreamKey};
use crate::scene::diffuse::DiffuseVertices;
use crate::scene::lights::guide::Guide;
use crate::scene::{HitScratch, Lights, Scene, Surface};
use crate::settings::{Direct, Roulette, Settings};
use crate::simd::dispatch::{Simd, vectorized};
use crate::simd::{LANES, Mask, any, lanes_of};
use glam::Vec3;
use rayon::prelude::*;
use std::mem;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Light paths per batch. Fixed, so that results do not depend on the number of threads; enough
/// to fill ray packets, few enough for a batch to stay in the second-level cache.
const BATCH: u32 = 1024;

/// Largest survival probability: paths end even between perfectly white walls.
pub(super) const MAX_SURVIVAL: f32 = 0.995;

/// The photons of one iteration; buffers are reused by the next.
#[derive(Debug, Default)]
pub struct LightPaths {
    batches: Vec<Batch>,
    tracers: Pool<Tracer>,
    /// Where they start; in proportion to the lights' power if there is none.
    pub guide: Option<Arc<Guide>>,
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
        let Self { batches, tracers, guide } = self;
        let guide = guide.as_deref();
        let batches = batches.par_iter_mut().zip(0..count);
        batches.for_each_init(
            || tracers.lease(),
            |tracer, (batch, index)| {
                let first = index * BATCH;
                let last = light_paths.min(first + BATCH);
                tracer.trace(batch, (scene, accel), settings, guide, key, first..last);
            },
        );
    }

    /// All photons: slices of consecutive paths, each bounce by bounce.
    pub fn photons(&self) -> impl Iterator<Item = &[Photon]> + Clone {
        self.batches.iter().map(|batch| batch.photons.as_slice())
    }

    /// What all photons carry of their paths' weights, in the same slices; empty ones without weights.
    pub fn parts(&self) -> impl Iterator<Item = &[f32]> + Clone {
        self.batches.iter().map(|batch| batch.parts.as_slice())
    }

    /// What is to be known of all photons before they can be sorted.
    pub fn extent(&self) -> Extent {
        self.batches.iter().map(|batch| batch.extent).fold(Extent::default(), Extent::and)
    }

    /// Number of photons.
    pub fn len(&self) -> usize {
        self.extent().count
    }

    /// Whether no path left a photon.
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

/// What consecutive paths leave.
#[derive(Debug, Default)]
struct Batch {
    /// Bounce by bounce.
    photons: PhotonList,
    /// What they carry of their paths' weights, if paths are weighted.
    parts: Vec<f32>,
    extent: Extent,
    rays: u64,
    busy: Duration,
}

/// So many photons more a [`PhotonList`] has when it is full.
const STEP: usize = 256;

/// Photons that come many at a time.
#[derive(Debug, Default)]
struct PhotonList {
    /// Behind the photons, anything.
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

    /// Room for as many as sixteen paths leave, to be [taken](Self::take).
    #[inline(always)]
    fn space(&mut self) -> &mut [Photon; LANES] {
        let end = self.count + LANES;
        if self.buffer.len() < end {
            self.buffer.resize(end.next_multiple_of(STEP), Photon::default());
        }
        self.buffer[self.count..].first_chunk_mut().expect("there is room")
    }

    /// Adds the first of those that were written to [`Self::space`].
    #[inline(always)]
    fn take(&mut self, count: usize) {
        self.count += count;
    }

    fn push(&mut self, photon: Photon) {
        self.space()[0] = photon;
        self.take(1);
    }
}

/// A reusable workspace that traces one batch after another.
#[derive(Debug, Default)]
struct Tracer {
    in_flight: Flight<Walks, 16>,
    /// The rays of the next bounce, in the order in which they are found.
    next: Flight<Walks, 16>,
    hits: Vec<HitPacket>,
    /// Of the current batch.
    photons: PhotonList,
    parts: PhotonParts,
    /// Whether photons keep theirs.
    directions: bool,
    /// Whether photons straight from a light are stored, not replaced by connections.
    stores_direct: bool,
}

impl Tracer {
    fn trace(
        &mut self,
        batch: &mut Batch,
        (scene, accel): (&Scene, &dyn Intersect),
        settings: &Settings,
        guide: Option<&Guide>,
        key: StreamKey,
        paths: Range<u32>,
    ) {
        let start = Instant::now();
        mem::swap(&mut self.photons, &mut batch.photons);
        mem::swap(&mut self.parts.photons, &mut batch.parts);
        self.photons.clear();
        self.parts.start(Mis::new(settings), paths.clone());
        self.directions = scene.merges_by_direction();
        self.stores_direct = settings.direct == Direct::PhotonMap;
        batch.rays = 0;
        vectorized(
            #[inline(always)]
            |simd| self.emit(simd, scene.lights(), guide, key, paths),
        );
        while self.in_flight.len() > 0 {
            batch.rays += self.in_flight.len() as u64;
            let count = self.in_flight.len();
            let rays = vectorized(
                #[inline(always)]
                |_| self.in_flight.rays(),
            );
            self.hits.resize(rays.len(), HitPacket::default());
            accel.intersect(rays, count, &mut self.hits, Coherence::Incoherent);
            vectorized(
                #[inline(always)]
                |simd| self.bounce(simd, scene, settings.light_roulette),
            );
        }
        mem::swap(&mut self.photons, &mut batch.photons);
        mem::swap(&mut self.parts.photons, &mut batch.parts);
        batch.extent = Extent::of(batch.photons.as_slice());
        batch.busy = start.elapsed();
    }

    #[inline(always)] // vectorized
    fn emit(
        &mut self,
        simd: Simd,
        lights: &Lights,
        guide: Option<&Guide>,
        key: StreamKey,
        mut paths: Range<u32>,
    ) {
        self.in_flight.clear();
        let mut walks = Walks::default();
        while !paths.is_empty() {
            let first = paths.start;
            let count = paths.by_ref().take(LANES).count();
            for lane in 0..count {
                walks.rng.set(lane, key.rng(u64::from(first) + lane as u64));
            }
            let emissions = lights.emit_all(guide, &mut walks.rng, count);
            if self.parts.are_wanted() {
                self.parts.emit(first, &emissions.emitter[..count]);
            }
            (walks.origin, walks.direction) = (emissions.origin, emissions.direction);
            walks.weight = emissions.flux;
            let mut emitted = Mask::default();
            for (lane, emitted) in emitted.iter_mut().enumerate() {
                let flux = walks.weight.get(lane);
                walks.path[lane] = first.wrapping_add(lane as u32);
                walks.inverse_start[lane] = flux.max_element().recip();
                // Black parts of pictures emit nothing.
                *emitted = (lane < count) & (flux != Rgb::ZERO);
            }
            self.in_flight.append(simd, &emitted, &walks);
        }
    }

    /// Stores a photon at each hit of a surface that merges, and scatters the path.
    #[inline(always)] // vectorized
    fn bounce(&mut self, simd: Simd, scene: &Scene, roulette: Roulette) {
        self.next.clear();
        let (in_flight, hits) = (mem::take(&mut self.in_flight), mem::take(&mut self.hits));
        let (mut walks, mut seen, mut at) = <(Walks, HitScratch, DiffuseVertices)>::default();
        for (packet, hits) in hits.iter().enumerate() {
            let count = in_flight.load(packet, &mut walks);
            let rest = scene.lambertian(simd, &walks.direction, hits, count, &mut seen, &mut at);
            for lane in lanes_of(rest.others) {
                let (ray, walk) = walks.get(lane);
                let (lights, from) = (scene.lights(), ray.origin);
                let scatter =
                    |surface: &Surface| self.scatter_other(lights, surface, (from, walk), roulette);
                if let Some((ray, walk)) =
                    at_other_surface(scene, &ray, &hits.get(lane), (&mut at, lane), scatter)
                {
                    self.next.push_walk(&ray, &walk);
                }
            }
            self.store_diffuse(simd, &at, &walks);
            let reached = self.parts.are_wanted().then_some(walks);
            let goes_on = self.scatter_diffuse(simd, &at, &mut walks, roulette);
            if let Some(reached) = reached {
                self.parts.scatter_diffuse(scene.lights(), &at, &reached, &goes_on);
            }
        }
        self.hits = hits;
        self.in_flight = mem::replace(&mut self.next, in_flight);
    }

    /// Stores arrivals at diffuse vertices.
    #[inline(always)] // vectorized
    fn store_diffuse(&mut self, simd: Simd, at: &DiffuseVertices, walks: &Walks) {
        let (mut stored, mut side, mut from) = (Mask::default(), [0; LANES], [0; LANES]);
        for lane in 0..LANES {
            let depth = walks.depth[lane];
            stored[lane] = at.active[lane] & (self.stores_direct | !depth.is_start());
            side[lane] = Side::new(at.normal.get(lane), class_of(depth) as u32).0;
        }
        if !any(&stored) {
            return;
        }
        if self.parts.are_wanted() {
            self.parts.store_diffuse(&stored, walks);
        }
        if self.directions {
            for (lane, from) in from.iter_mut().enumerate() {
                *from = pack_direction(-walks.direction.get(lane));
            }
        }
        let photons = Photons { position: at.position, path: walks.path, flux: walks.weight, side };
        // All are written, but only those that are stored are kept: which these are nobody foresees.
        let (space, mut count) = (self.photons.space(), 0);
        photons.one_by_one(simd, &from, |lane, photon| {
            space[count % LANES] = photon;
            count += usize::from(stored[lane]);
        });
        self.photons.take(count);
    }

    /// Stores an arrival; `from` is a unit vector toward where it came from.
    #[inline]
    fn store(&mut self, photon: Photon, from: Vec3) {
        self.photons.push(if self.directions { photon.coming_from(from) } else { photon });
    }

    /// Goes on from diffuse vertices; which paths do.
    #[inline(always)] // vectorized
    fn scatter_diffuse(
        &mut self,
        simd: Simd,
        at: &DiffuseVertices,
        walks: &mut Walks,
        roulette: Roulette,
    ) -> Mask {
        walks.origin = at.off_surface;
        walks.direction = at.sample(&mut walks.rng);
        let ends = walks.rng.next_1d();
        let mut goes_on = Mask::default();
        for lane in 0..LANES {
            let (flux, albedo) = (walks.weight.get(lane), at.albedo.get(lane));
            let survival = survival(flux, albedo, walks.inverse_start[lane], roulette);
            goes_on[lane] = at.active[lane] & (ends[lane] < survival);
            // theory.md (38)
            walks.weight.set(lane, flux * (albedo / survival));
            walks.depth[lane] = walks.depth[lane].scattered();
        }
        self.next.append(simd, &goes_on, walks);
        goes_on
    }

    /// At a surface that is not diffuse alone; the next ray unless the path ends.
    fn scatter_other(
        &mut self,
        lights: &Lights,
        surface: &Surface,
        (from, mut walk): (Vec3, Walk),
        roulette: Roulette,
    ) -> Option<(Ray, Walk)> {
        let Surface { position, normal, wo, .. } = *surface;
        if surface.bsdf.merges() && (self.stores_direct || !walk.depth.is_start()) {
            let class = class_of(walk.depth);
            self.parts.store(&walk);
            self.store(Photon::new(position, walk.path, walk.weight, normal, class), wo);
        }
        let sample = surface.scatter_flux(&mut walk.rng)?;
        self.parts.scatter(lights, surface, (from, &walk), &sample);
        walk.depth = if sample.lobe.passes_through() {
            walk.depth.passed_on()
        } else {
            walk.depth.scattered()
        };
        let survival = survival(walk.weight, sample.weight, walk.inverse_start, roulette);
        if walk.rng.next_1d() >= survival {
            return None;
        }
        // theory.md (38)
        walk.weight *= sample.weight / survival;
        Some((Ray::new(surface.start(sample.wi), sample.wi), walk))
    }
}

/// At which vertices the next photon of a path is merged.
#[inline(always)] // as the next: parts of vector loops
// theory.md, section 4
fn class_of(depth: Depth) -> PhotonClass {
    if depth.diffuse() == 0 { PhotonClass::Caustic } else { PhotonClass::Diffuse }
}

/// Probability of going on with `flux` from a vertex of this weight.
#[inline(always)]
fn survival(flux: Rgb, weight: Rgb, inverse_start: f32, roulette: Roulette) -> f32 {
    let share = match roulette {
        // theory.md (39)
        Roulette::Albedo => weight.max_element(),
        // theory.md (40)
        Roulette::Weight => (flux * weight).max_element() * inverse_start / WEIGHT_FLOOR,
    };
    share.min(MAX_SURVIVAL)
}
