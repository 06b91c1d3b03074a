//! Cut-outs: parts of surfaces that rays pass as if nothing were there, all of them or a share.
//!
//! Where a share passes, chance decides for each ray at each triangle. The chance is a hash of both, so that the
//! same ray finds the same whoever asks and how often; no two rays of an image are the same, for each begins or
//! goes where random numbers say. Camera paths, light paths and connections so meet a surface of opacity `a`
//! with probability `a`, and what they carry needs no weight.
//! theory.md, section 4.

use super::{Mesh, Placement, Scene, Texture};
use crate::accel::packet::used;
use crate::accel::{AccelInfo, Coherence, Hit, HitPacket, Intersect, Ray, RayPacket, next_after};
use crate::simd::Mask;
use glam::Vec2;
use std::collections::HashMap;
use std::sync::Arc;
use xxhash_rust::xxh3::xxh3_64;

/// Surfaces of less opacity are not there, if it is no share.
const THRESHOLD: f32 = 0.5;

/// How much of a surface is there.
#[derive(Clone, Debug)]
pub struct CutOut {
    pub(super) texture: Option<Arc<Texture>>,
    /// What the opacity is multiplied with, if it is the share of the rays that meet the surface.
    pub(super) factor: Option<f32>,
}

impl CutOut {
    /// Share of the rays that meet the surface at `uv`.
    pub(crate) fn opacity(&self, uv: Vec2) -> f32 {
        let own = self.texture.as_ref().map_or(1.0, |texture| texture.opacity(uv));
        match self.factor {
            Some(factor) => factor * own,
            None if own < THRESHOLD => 0.0,
            None => 1.0,
        }
    }
}

/// A number in [0, 1) that is the same for the same ray and triangle, and for others unrelated.
fn chance(ray: &Ray, hit: &Hit) -> f32 {
    let [x, y, z] = ray.origin.to_array().map(f32::to_bits);
    let [dx, dy, dz] = ray.direction.to_array().map(f32::to_bits);
    let words = [x, y, z, dx, dy, dz, hit.mesh, hit.triangle];
    (xxh3_64(bytemuck::cast_slice(&words.map(u32::to_le))) >> 40) as f32 / (1 << 24) as f32
}

/// A backend in which some meshes have holes.
pub struct CutOuts {
    inner: Arc<dyn Intersect>,
    /// By the mesh index of hits.
    holes: Vec<Option<Holes>>,
}

/// The holes of a mesh at one of its places.
struct Holes {
    cut_out: CutOut,
    /// Texture coordinates of each triangle's corners.
    uvs: Arc<[[Vec2; 3]]>,
}

impl CutOuts {
    /// Cuts the holes of the scene's materials out of `inner`, if there are any.
    pub fn wrap(inner: Arc<dyn Intersect>, scene: &Scene) -> Arc<dyn Intersect> {
        let uvs = |mesh: &Mesh| {
            let uv = |index: u32| mesh.uvs.get(index as usize).copied().unwrap_or_default();
            mesh.triangles.iter().map(|corners| corners.map(uv)).collect::<Arc<_>>()
        };
        let mut known: HashMap<u32, Arc<_>> = HashMap::new();
        let mut holes = |placement: &Placement| {
            let cut_out = scene.materials[placement.material as usize].cut_out()?;
            let uvs = known.entry(placement.mesh).or_insert_with(|| uvs(scene.mesh(placement)));
            Some(Holes { cut_out, uvs: uvs.clone() })
        };
        let holes: Vec<_> = scene.placements.iter().map(&mut holes).collect();
        if holes.iter().all(Option::is_none) { inner } else { Arc::new(Self { inner, holes }) }
    }

    /// Whether there is nothing where a ray hit.
    fn is_hole(&self, ray: &Ray, hit: &Hit) -> bool {
        if hit.is_miss() {
            return false;
        }
        self.holes[hit.mesh as usize].as_ref().is_some_and(|holes| {
            let [a, b, c] = holes.uvs[hit.triangle as usize];
            let uv = a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v;
            match holes.cut_out.opacity(uv) {
                // Certain without a hash.
                opacity if opacity <= 0.0 => true,
                opacity if opacity >= 1.0 => false,
                opacity => chance(ray, hit) >= opacity,
            }
        })
    }

    /// The closest hit from `hit` on that is no hole.
    fn solid(&self, ray: &Ray, mut hit: Hit) -> Hit {
        let mut step = f32::EPSILON;
        while self.is_hole(ray, &hit) {
            (hit, step) = next_after(&*self.inner, ray, &hit, step);
        }
        hit
    }
}

impl Intersect for CutOuts {
    fn intersect(
        &self,
        rays: &[RayPacket],
        count: usize,
        hits: &mut [HitPacket],
        coherence: Coherence,
    ) {
        self.inner.intersect(rays, count, hits, coherence);
        for ((rays, hits), lanes) in rays.iter().zip(&mut *hits).zip(used(count, rays.len())) {
            for lane in lanes {
                let (ray, hit) = (rays.get(lane), hits.get(lane));
                if self.is_hole(&ray, &hit) {
                    hits.set(lane, &self.solid(&ray, hit));
                }
            }
        }
    }

    fn occlude(
        &self,
        rays: &[RayPacket],
        count: usize,
        occluded: &mut [Mask],
        coherence: Coherence,
    ) {
        self.inner.occlude(rays, count, occluded, coherence);
        for ((rays, occluded), lanes) in rays.iter().zip(occluded).zip(used(count, rays.len())) {
            for lane in lanes {
                if occluded[lane] {
                    occluded[lane] = self.is_occluded(&rays.get(lane));
                }
            }
        }
    }

    fn closest_hit(&self, ray: &Ray) -> Hit {
        self.solid(ray, self.inner.closest_hit(ray))
    }

    fn is_occluded(&self, ray: &Ray) -> bool {
        !self.closest_hit(ray).is_miss()
    }

    fn describe(&self) -> AccelInfo {
        self.inner.describe()
    }
}
