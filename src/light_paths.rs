//! Light phase: traces light paths breadth-first and stores their photons.

use crate::accel::{Coherence, Hit, Intersect, Ray};
use crate::diffuse::{DiffusePoint, DiffuseVertices};
use crate::flight::Flight;
use crate::lanes::vectorized;
use crate::math::{Rgb, pack_direction, unpack_direction};
use crate::rng::{Rng, Stream, StreamKey};
use crate::scene::{Scene, Surface};
use crate::settings::{Direct, Roulette, Settings};
use glam::{Quat, Vec3};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Light paths per batch. Fixed, so that results do not depend on the number of threads; enough
/// to fill ray packets, few enough for a batch to stay in the second-level cache.
const BATCH: u32 = 1024;

/// With [`Roulette::Weight`], paths whose weight fell below this share play roulette.
const WEIGHT_FLOOR: f32 = 1.0 / 16.0;

/// Largest survival probability: paths end even between perfectly white walls.
const MAX_SURVIVAL: f32 = 0.995;

/// A light path's arrival at a surface: 36 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Photon {
    /// Where it arrived, scene units.
    pub position: Vec3,
    /// Id of its light path, `0..N_F`.
    pub path: u32,
    /// Flux it carries, W: its share of the light is `flux / N_F`.
    pub flux: Rgb,
    /// Which side of the surface it arrived from, and where it is merged.
    pub(crate) side: Side,
    /// Packed unit vector toward where it came from, if it was told.
    pub(crate) from: u32,
}

/// The part of a photon that decides whether it counts: moved as one word.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(4))]
pub(crate) struct Side {
    /// Surface normal on the side it arrived from, each coordinate in 1/127.
    normal: [i8; 3],
    class: PhotonClass,
}

/// At which vertices of a camera path a photon is merged, so that each path counts exactly once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum PhotonClass {
    /// No diffuse bounce since the light, though it may have passed through vertices (a caustic):
    /// merged at every vertex `1..=k`.
    EveryVertex,
    /// At least one diffuse bounce: merged at vertex `k` only.
    #[default]
    LastVertex,
}

impl Photon {
    /// `normal` is the unit normal on the side of arrival.
    pub fn new(position: Vec3, path: u32, flux: Rgb, normal: Vec3, class: PhotonClass) -> Self {
        // To the nearest, without a call of `round`.
        let normal = normal.to_array().map(|c| ((c * 127.0 + 128.5) as i32 - 128) as i8);
        Self { position, path, flux, side: Side { normal, class }, from: 0 }
    }

    /// The same with the unit vector toward where it came from, for BSDFs that depend on it.
    #[must_use]
    pub fn coming_from(self, from: Vec3) -> Self {
        Self { from: pack_direction(from), ..self }
    }

    /// Unit vector toward where it came from, turned along with the surface to a place of the unit
    /// normal `normal`: what is merged there is the radiance that the surface has here.
    pub fn from_as_at(&self, normal: Vec3) -> Vec3 {
        let own = Vec3::from_array(self.side.normal.map(f32::from)).normalize();
        Quat::from_rotation_arc(own, normal) * unpack_direction(self.from)
    }

    /// Whether it arrived on the side of a surface that `normal` points to: a positive dot product
    /// of the two normals.
    #[inline]
    pub fn faces(&self, normal: Vec3) -> bool {
        let [x, y, z] = self.side.normal.map(f32::from);
        Vec3::new(x, y, z).dot(normal) > 0.0
    }

    /// Where it is merged.
    #[inline]
    pub fn class(&self) -> PhotonClass {
        self.side.class
    }
}

/// The photons of one iteration; buffers are reused by the next.
#[derive(Debug, Default)]
pub struct LightPaths {
    batches: Vec<Batch>,
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
        self.batches.par_iter_mut().zip(0..count).for_each(|(batch, index)| {
            let first = index * BATCH;
            let last = light_paths.min(first + BATCH);
            batch.trace(scene, accel, settings, key, first..last);
        });
    }

    /// All photons: slices of consecutive paths, each bounce by bounce and there in path order.
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

/// Consecutive paths that are traced together.
#[derive(Debug, Default)]
struct Batch {
    /// The result, bounce by bounce.
    photons: Vec<Photon>,
    /// Whether photons keep theirs.
    directions: bool,
    in_flight: Flight<Walk>,
    /// The rays of the next bounce, in the order in which they are found.
    next: Flight<Walk>,
    hits: Vec<Hit>,
    rays: u64,
    busy: Duration,
}

impl Batch {
    fn trace(
        &mut self,
        scene: &Scene,
        accel: &dyn Intersect,
        settings: &Settings,
        key: StreamKey,
        paths: std::ops::Range<u32>,
    ) {
        let start = Instant::now();
        self.directions = scene.merges_by_direction();
        vectorized(|| self.emit(scene, settings, key, paths));
        while self.in_flight.len() > 0 {
            self.rays += self.in_flight.len() as u64;
            self.hits.resize(self.in_flight.len(), Hit::MISS);
            accel.closest_hits(self.in_flight.rays(), &mut self.hits, Coherence::Incoherent);
            vectorized(|| self.bounce(scene, settings.light_roulette));
        }
        self.busy = start.elapsed();
    }

    #[inline(always)] // vectorized
    fn emit(
        &mut self,
        scene: &Scene,
        settings: &Settings,
        key: StreamKey,
        paths: std::ops::Range<u32>,
    ) {
        self.rays = 0;
        self.photons.clear();
        self.in_flight.clear();
        // Photons straight from a light are replaced by connections, or merged at every vertex.
        let class = match settings.direct {
            Direct::Connect => None,
            Direct::PhotonMap => Some(PhotonClass::EveryVertex),
        };
        for path in paths {
            let mut rng = key.rng(u64::from(path));
            let emission = scene.lights.emit(&mut rng);
            let flux = emission.flux;
            if flux == Rgb::ZERO {
                continue; // from a black part of a picture
            }
            let (ray, walk) = self.in_flight.add();
            *ray = Ray::new(emission.origin, emission.direction);
            walk.rng = rng;
            walk.flux = flux;
            walk.inverse_emitted = flux.max_element().recip();
            walk.path = path;
            walk.class = class;
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
            if ends[lane] < survival {
                let (ray, walk) = self.next.add();
                *ray = Ray::new(off_surface, directions.get(lane));
                walk.rng = at.rng.get(lane);
                walk.flux = at.carried.get(lane) * (albedo / survival);
                walk.inverse_emitted = before.inverse_emitted;
                walk.path = before.path;
                walk.class = Some(PhotonClass::LastVertex);
            }
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
