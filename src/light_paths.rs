//! Light phase: traces light paths breadth-first and stores their photons.

use crate::accel::{Coherence, Hit, Intersect, Ray};
use crate::diffuse::{DiffusePoint, DiffuseVertices};
use crate::flight::Flight;
use crate::lanes::{LANES, Rngs, vectorized};
use crate::math::Rgb;
use crate::photon::{Photon, PhotonClass};
use crate::pool::Pool;
use crate::rng::{Rng, Stream, StreamKey};
use crate::scene::{Scene, Surface};
use crate::settings::{Direct, Roulette, Settings};
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;
use std::time::{Duration, Instant};

/// Light paths per batch. Fixed, so that results do not depend on the number of threads; enough
/// to fill ray packets, few enough for a batch to stay in the second-level cache.
const BATCH: u32 = 512;

/// With [`Roulette::Weight`], paths whose weight fell below this share play roulette.
const WEIGHT_FLOOR: f32 = 1.0 / 16.0;

/// Largest survival probability: paths end even between perfectly white walls.
const MAX_SURVIVAL: f32 = 0.995;

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
        self.batches.iter().map(|batch| &batch.photons[..])
    }

    /// Number of photons.
    pub fn len(&self) -> usize {
        self.photons().map(<[_]>::len).sum()
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

/// A path under way.
#[derive(Clone, Copy, Debug, Default)]
struct Walk {
    rng: Rng,
    flux: Rgb,
    /// Reciprocal of the largest channel of the emitted flux.
    inverse_emitted: f32,
    path: u32,
    /// Of its next photon; `None` if that comes straight from a light that is connected.
    class: Option<PhotonClass>,
}

impl Walk {
    /// Probability of going on from a vertex of this weight.
    #[inline]
    fn survival(&self, weight: Rgb, roulette: Roulette) -> f32 {
        let share = match roulette {
            Roulette::Albedo => weight.max_element(),
            Roulette::Weight => {
                (self.flux * weight).max_element() * self.inverse_emitted / WEIGHT_FLOOR
            }
        };
        share.min(MAX_SURVIVAL)
    }
}

/// What consecutive paths leave.
#[derive(Debug, Default)]
struct Batch {
    /// Bounce by bounce.
    photons: Vec<Photon>,
    rays: u64,
    busy: Duration,
}

/// A reusable workspace that traces one batch after another.
#[derive(Debug, Default)]
struct Tracer {
    in_flight: Flight<Walk>,
    /// The rays of the next bounce, in the order in which they are found.
    next: Flight<Walk>,
    hits: Vec<Hit>,
    /// Of the current batch.
    photons: Vec<Photon>,
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
        std::mem::swap(&mut self.photons, &mut batch.photons);
        self.photons.clear();
        self.directions = scene.merges_by_direction();
        batch.rays = 0;
        vectorized(
            #[inline(always)]
            || self.emit(scene, settings, key, paths),
        );
        while self.in_flight.len() > 0 {
            batch.rays += self.in_flight.len() as u64;
            self.hits.resize(self.in_flight.len(), Hit::MISS);
            accel.closest_hits(self.in_flight.rays(), &mut self.hits, Coherence::Incoherent);
            vectorized(
                #[inline(always)]
                || self.bounce(scene, settings.light_roulette),
            );
        }
        std::mem::swap(&mut self.photons, &mut batch.photons);
        batch.busy = start.elapsed();
    }

    #[inline(always)] // vectorized
    fn emit(&mut self, scene: &Scene, settings: &Settings, key: StreamKey, mut paths: Range<u32>) {
        self.in_flight.clear();
        // Photons straight from a light are replaced by connections, or merged at every vertex.
        let class = match settings.direct {
            Direct::Connect => None,
            Direct::PhotonMap => Some(PhotonClass::EveryVertex),
        };
        while !paths.is_empty() {
            let first = paths.start;
            let count = paths.by_ref().take(LANES).count();
            let mut rngs = Rngs::default();
            for lane in 0..count {
                rngs.set(lane, key.rng(u64::from(first) + lane as u64));
            }
            let emissions = scene.lights.emit_all(&mut rngs, count);
            for lane in 0..count {
                let flux = emissions.flux.get(lane);
                if flux == Rgb::ZERO {
                    continue; // from a black part of a picture
                }
                let (ray, walk) = self.in_flight.add();
                *ray = Ray::new(emissions.origin.get(lane), emissions.direction.get(lane));
                walk.rng = rngs.get(lane);
                walk.flux = flux;
                walk.inverse_emitted = flux.max_element().recip();
                walk.path = first + lane as u32;
                walk.class = class;
            }
        }
    }

    /// Stores a photon at each hit of a surface that merges, and scatters the path.
    #[inline(always)] // vectorized
    fn bounce(&mut self, scene: &Scene, roulette: Roulette) {
        let mut vertices = DiffuseVertices::default();
        self.next.clear();
        for i in 0..self.in_flight.len() {
            let (ray, hit) = (&self.in_flight.rays()[i], self.hits[i]);
            if hit.is_miss() {
                continue;
            }
            let plain = scene.plain(ray, &hit);
            let Some(point) = plain.or_else(|| self.elsewhere(scene, i, roulette)) else {
                continue;
            };
            let Walk { rng, flux, path, class, .. } = self.in_flight.walks()[i];
            if let Some(class) = class {
                let from = -self.in_flight.rays()[i].direction;
                self.store(Photon::new(point.position, path, flux, point.normal, class), from);
            }
            vertices.push(i, &point, flux, rng);
            if vertices.is_full() {
                self.scatter_diffuse(&mut vertices, roulette);
            }
        }
        self.scatter_diffuse(&mut vertices, roulette);
        std::mem::swap(&mut self.in_flight, &mut self.next);
    }

    /// What path `i` hit where that is not plain: a diffuse point is told, another done with.
    #[inline(never)] // keeps the loop over plain vertices short
    fn elsewhere(&mut self, scene: &Scene, i: usize, roulette: Roulette) -> Option<DiffusePoint> {
        let surface = scene.surface(&self.in_flight.rays()[i], &self.hits[i]);
        let diffuse = surface.diffuse();
        let walk = self.in_flight.walks()[i];
        if diffuse.is_none()
            && let Some(next) = self.scatter_other(&surface, walk, roulette)
        {
            let (ray, walk) = self.next.add();
            (*ray, *walk) = next;
        }
        diffuse
    }

    /// Stores an arrival; `from` is a unit vector toward where it came from.
    #[inline]
    fn store(&mut self, photon: Photon, from: Vec3) {
        self.photons.push(if self.directions { photon.coming_from(from) } else { photon });
    }

    /// Goes on from diffuse vertices.
    #[inline(always)] // vectorized
    fn scatter_diffuse(&mut self, at: &mut DiffuseVertices, roulette: Roulette) {
        let directions = at.sample();
        let ends = at.rng.next_1d();
        for (lane, walk) in at.lanes() {
            let before = &self.in_flight.walks()[walk];
            let (off_surface, albedo) = (at.off_surface.get(lane), at.albedo.get(lane));
            let survival = before.survival(albedo, roulette);
            let (ray, walk) = self.next.candidate();
            *ray = Ray::new(off_surface, directions.get(lane));
            walk.rng = at.rng.get(lane);
            walk.flux = at.carried.get(lane) * (albedo / survival);
            walk.inverse_emitted = before.inverse_emitted;
            walk.path = before.path;
            walk.class = Some(PhotonClass::LastVertex);
            self.next.keep(ends[lane] < survival);
        }
        at.clear();
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
        let survival = walk.survival(sample.weight, roulette);
        if walk.rng.next_1d() >= survival {
            return None;
        }
        walk.flux *= sample.weight / survival;
        Some((Ray::new(surface.start(sample.wi), sample.wi), walk))
    }
}
