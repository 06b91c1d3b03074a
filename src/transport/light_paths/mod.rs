//! Light phase: traces light paths breadth-first and stores their photons.

mod walks;

use super::flight::Flight;
use super::photon::{Extent, Photon, PhotonClass, Photons, Side};
use crate::accel::{Coherence, Hit, HitPacket, Intersect, Ray};
use crate::base::math::{Rgb, pack_direction};
use crate::base::pool::Pool;
use crate::base::rng::{Stream, StreamKey};
use crate::lanes::simd::{Simd, vectorized};
use crate::lanes::{LANES, Mask, any, lanes_of};
use crate::scene::diffuse::DiffuseVertices;
use crate::scene::{Emissions, Scene, Seen, Surface};
use crate::settings::{Direct, Roulette, Settings};
use glam::Vec3;
use rayon::prelude::*;
use std::mem;
use std::ops::Range;
use std::time::{Duration, Instant};
use walks::{Walk, Walks, encoded, survival};

/// Light paths per batch. Fixed, so that results do not depend on the number of threads; enough
/// to fill ray packets, few enough for a batch to stay in the second-level cache.
const BATCH: u32 = 1024;

/// The photons of one iteration; buffers are reused by the next.
#[derive(Debug, Default)]
pub struct LightPaths {
    batches: Vec<Batch>,
    tracers: Pool<Tracer>,
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
        let Self { batches, tracers } = self;
        let batches = batches.par_iter_mut().zip(0..count);
        batches.for_each_init(
            || tracers.lease(),
            |tracer, (batch, index)| {
                let first = index * BATCH;
                let last = light_paths.min(first + BATCH);
                tracer.trace(batch, scene, accel, settings, key, first..last);
            },
        );
    }

    /// All photons: slices of consecutive paths, each bounce by bounce.
    pub fn photons(&self) -> impl Iterator<Item = &[Photon]> + Clone {
        self.batches.iter().map(|batch| batch.photons.as_slice())
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
    /// Whether photons keep theirs.
    directions: bool,
}

impl Tracer {
    fn trace(
        &mut self,
        batch: &mut Batch,
        scene: &Scene,
        accel: &dyn Intersect,
        settings: &Settings,
        key: StreamKey,
        paths: Range<u32>,
    ) {
        let start = Instant::now();
        mem::swap(&mut self.photons, &mut batch.photons);
        self.photons.clear();
        self.directions = scene.merges_by_direction();
        batch.rays = 0;
        vectorized(
            #[inline(always)]
            |simd| self.emit(simd, scene, settings, key, paths),
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
        batch.extent = Extent::of(batch.photons.as_slice());
        batch.busy = start.elapsed();
    }

    #[inline(always)] // vectorized
    fn emit(
        &mut self,
        simd: Simd,
        scene: &Scene,
        settings: &Settings,
        key: StreamKey,
        mut paths: Range<u32>,
    ) {
        self.in_flight.clear();
        // Photons straight from a light are replaced by connections, or merged at every vertex.
        let class = match settings.direct {
            Direct::Connect => None,
            Direct::PhotonMap => Some(PhotonClass::EveryVertex),
        };
        let mut walks = Walks { class: [encoded(class); LANES], ..Walks::default() };
        while !paths.is_empty() {
            let first = paths.start;
            let count = paths.by_ref().take(LANES).count();
            for lane in 0..count {
                walks.rng.set(lane, key.rng(u64::from(first) + lane as u64));
            }
            let emissions = scene.lights.emit_all(&mut walks.rng, count);
            Emissions { origin: walks.origin, direction: walks.direction, flux: walks.flux } =
                emissions;
            let mut emitted = Mask::default();
            for (lane, emitted) in emitted.iter_mut().enumerate() {
                let flux = walks.flux.get(lane);
                walks.path[lane] = first.wrapping_add(lane as u32);
                walks.inverse_emitted[lane] = flux.max_element().recip();
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
        let (mut walks, mut seen, mut at) = <(Walks, Seen, DiffuseVertices)>::default();
        for (packet, hits) in hits.iter().enumerate() {
            let count = in_flight.load(packet, &mut walks);
            let elsewhere = scene.plain(simd, &walks.direction, hits, count, &mut seen, &mut at);
            for lane in lanes_of(elsewhere.others) {
                let hit = hits.get(lane);
                self.elsewhere(scene, roulette, walks.get(lane), &hit, (&mut at, lane));
            }
            self.store_diffuse(simd, &at, &walks);
            self.scatter_diffuse(simd, &at, &mut walks, roulette);
        }
        self.hits = hits;
        self.in_flight = mem::replace(&mut self.next, in_flight);
    }

    /// Where a path hit what is not plain: a diffuse vertex is set, what else there may be is done with.
    #[inline(never)] // keeps the loop over plain vertices short
    fn elsewhere(
        &mut self,
        scene: &Scene,
        roulette: Roulette,
        (ray, walk): (Ray, Walk),
        hit: &Hit,
        (at, lane): (&mut DiffuseVertices, usize),
    ) {
        let surface = scene.surface(&ray, hit);
        if let Some(point) = surface.diffuse() {
            at.set(lane, &point);
        } else if let Some((ray, walk)) = self.scatter_other(&surface, walk, roulette) {
            let mut next = Walks::default();
            next.set(0, &ray, &walk);
            self.next.push(&next);
        }
    }

    /// Stores arrivals at diffuse vertices.
    #[inline(always)] // vectorized
    fn store_diffuse(&mut self, simd: Simd, at: &DiffuseVertices, walks: &Walks) {
        const NONE: u32 = encoded(None);
        let (mut stored, mut side, mut from) = (Mask::default(), [0; LANES], [0; LANES]);
        for lane in 0..LANES {
            stored[lane] = at.active[lane] & (walks.class[lane] != NONE);
            side[lane] = Side::new(at.normal.get(lane), walks.class[lane].wrapping_sub(1)).0;
        }
        if !any(&stored) {
            return;
        }
        if self.directions {
            for (lane, from) in from.iter_mut().enumerate() {
                *from = pack_direction(-walks.direction.get(lane));
            }
        }
        let photons = Photons { position: at.position, path: walks.path, flux: walks.flux, side };
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

    /// Goes on from diffuse vertices.
    #[inline(always)] // vectorized
    fn scatter_diffuse(
        &mut self,
        simd: Simd,
        at: &DiffuseVertices,
        walks: &mut Walks,
        roulette: Roulette,
    ) {
        const LAST_VERTEX: u32 = encoded(Some(PhotonClass::LastVertex));
        walks.origin = at.off_surface;
        walks.direction = at.sample(&mut walks.rng);
        let ends = walks.rng.next_1d();
        walks.class = [LAST_VERTEX; LANES];
        let mut goes_on = Mask::default();
        for lane in 0..LANES {
            let (flux, albedo) = (walks.flux.get(lane), at.albedo.get(lane));
            let survival = survival(flux, albedo, walks.inverse_emitted[lane], roulette);
            goes_on[lane] = at.active[lane] & (ends[lane] < survival);
            walks.flux.set(lane, flux * (albedo / survival));
        }
        self.next.append(simd, &goes_on, walks);
    }

    /// At a surface that is not diffuse alone; the next ray unless the path ends.
    fn scatter_other(
        &mut self,
        surface: &Surface,
        mut walk: Walk,
        roulette: Roulette,
    ) -> Option<(Ray, Walk)> {
        let Surface { position, normal, wo, .. } = *surface;
        if surface.bsdf.merges()
            && let Some(class) = walk.class
        {
            self.store(Photon::new(position, walk.path, walk.flux, normal, class), wo);
        }
        let sample = surface.scatter_flux(&mut walk.rng)?;
        walk.class = Some(match walk.class {
            _ if !sample.lobe.passes_through() => PhotonClass::LastVertex,
            Some(class) => class,
            None => PhotonClass::EveryVertex,
        });
        let survival = survival(walk.flux, sample.weight, walk.inverse_emitted, roulette);
        if walk.rng.next_1d() >= survival {
            return None;
        }
        walk.flux *= sample.weight / survival;
        Some((Ray::new(surface.start(sample.wi), sample.wi), walk))
    }
}
