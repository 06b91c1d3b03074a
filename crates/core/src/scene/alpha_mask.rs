//! Alpha masks: parts of surfaces that some or all rays pass as if they did not exist. Connections
//! also pass boundaries of media that do not refract.
//!
//! If a share of the rays passes, a random number decides for each ray and triangle. It is a hash
//! of both: repeated queries of one ray agree. No two rays of an image are equal, because their
//! origins or directions are random. Camera paths, light paths and connections therefore meet a
//! surface of opacity `a` with probability `a`, and need no weight. theory.md, section 4.

use super::{Mesh, Placement, Scene, Texture};
use crate::accel::packet::used;
use crate::accel::{AccelInfo, Coherence, Hit, HitPacket, Intersect, Ray, RayPacket, next_after};
use crate::simd::{LANES, Mask};
use glam::Vec2;
use std::collections::HashMap;
use std::sync::Arc;
use xxhash_rust::xxh3::xxh3_64;

/// Opacity below which a binary mask lets all rays pass.
const THRESHOLD: f32 = 0.5;

/// The opacity of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct AlphaMask {
    pub(super) texture: Option<Arc<Texture>>,
    /// Factor of the opacity if it is the share of rays that meet the surface; `None` for a binary
    /// mask.
    pub(super) factor: Option<f32>,
}

impl AlphaMask {
    /// Share of the rays that meet the surface at `uv`, in [0, 1].
    pub(crate) fn opacity(&self, uv: Vec2) -> f32 {
        let own = self.texture.as_ref().map_or(1.0, |texture| texture.opacity(uv));
        match self.factor {
            Some(factor) => factor * own,
            None if own < THRESHOLD => 0.0,
            None => 1.0,
        }
    }
}

/// Packets of shadow rays that are traced together.
const PACKETS: usize = 16;

/// A number in [0, 1) from a hash of the ray and the triangle.
fn random_number(ray: &Ray, hit: &Hit) -> f32 {
    let [x, y, z] = ray.origin.to_array().map(f32::to_bits);
    let [dx, dy, dz] = ray.direction.to_array().map(f32::to_bits);
    let words = [x, y, z, dx, dy, dz, hit.mesh, hit.triangle];
    (xxh3_64(bytemuck::cast_slice(&words.map(u32::to_le))) >> 40) as f32 / (1 << 24) as f32
}

/// A backend whose hits respect the alpha masks of the scene.
pub struct AlphaMasks {
    inner: Arc<dyn Intersect>,
    /// Masks by the mesh index of hits.
    masks: Vec<Option<MeshMask>>,
    /// By the mesh index of hits, whether connections pass: boundaries of media that do not
    /// refract.
    is_index_matched: Vec<bool>,
    /// By the mesh index of hits, whether any connection passes.
    may_pass: Vec<bool>,
}

/// The mask of an instance.
struct MeshMask {
    alpha_mask: AlphaMask,
    /// Texture coordinates of each triangle's corners.
    uvs: Arc<[[Vec2; 3]]>,
}

impl AlphaMasks {
    /// Applies the alpha masks of the scene's materials to `inner`, and lets connections pass
    /// index-matched boundaries of media, if there are any of either.
    pub fn wrap(inner: Arc<dyn Intersect>, scene: &Scene) -> Arc<dyn Intersect> {
        let uvs = |mesh: &Mesh| {
            let uv = |index: u32| mesh.uvs.get(index as usize).copied().unwrap_or_default();
            mesh.triangles.iter().map(|corners| corners.map(uv)).collect::<Arc<_>>()
        };
        let mut known: HashMap<u32, Arc<_>> = HashMap::new();
        let mut masks = |placement: &Placement| {
            let alpha_mask = scene.materials[placement.material as usize].alpha_mask()?;
            let uvs = known.entry(placement.mesh).or_insert_with(|| uvs(scene.mesh(placement)));
            Some(MeshMask { alpha_mask, uvs: uvs.clone() })
        };
        let masks: Vec<_> = scene.placements.iter().map(&mut masks).collect();
        let matched =
            |placement| scene.media().is_some_and(|media| media.is_index_matched(placement));
        let is_index_matched: Vec<_> = (0..masks.len() as u32).map(matched).collect();
        if masks.iter().all(Option::is_none) && !is_index_matched.contains(&true) {
            return inner;
        }
        let may_pass = masks.iter().zip(&is_index_matched);
        let may_pass = may_pass.map(|(mask, is_matched)| mask.is_some() || *is_matched).collect();
        Arc::new(Self { inner, masks, is_index_matched, may_pass })
    }

    /// Returns true if the ray passes the surface that it hit.
    fn is_passed(&self, ray: &Ray, hit: &Hit) -> bool {
        if hit.is_miss() {
            return false;
        }
        self.masks[hit.mesh as usize].as_ref().is_some_and(|masks| {
            let [a, b, c] = masks.uvs[hit.triangle as usize];
            let uv = a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v;
            match masks.alpha_mask.opacity(uv) {
                // These need no hash.
                opacity if opacity <= 0.0 => true,
                opacity if opacity >= 1.0 => false,
                opacity => random_number(ray, hit) >= opacity,
            }
        })
    }

    /// The first hit, from `hit` on, that the ray does not pass.
    fn first_met(&self, ray: &Ray, hit: Hit) -> Hit {
        self.first_not(ray, hit, |hit| self.is_passed(ray, hit))
    }

    /// Tests whether a connection meets a surface, from `hit` on, that it does not pass.
    fn is_met(&self, ray: &Ray, hit: Hit) -> bool {
        let is_passed = |hit: &Hit| {
            let is_matched = self.is_index_matched.get(hit.mesh as usize) == Some(&true);
            is_matched || self.is_passed(ray, hit)
        };
        !self.first_not(ray, hit, is_passed).is_miss()
    }

    /// The first hit, from `hit` on, without this property.
    fn first_not(&self, ray: &Ray, mut hit: Hit, is_passed: impl Fn(&Hit) -> bool) -> Hit {
        let mut step = f32::EPSILON;
        while is_passed(&hit) {
            (hit, step) = next_after(&*self.inner, ray, &hit, step);
        }
        hit
    }
}

impl Intersect for AlphaMasks {
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
                if self.is_passed(&ray, &hit) {
                    hits.set(lane, &self.first_met(&ray, hit));
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
        assert_eq!(rays.len(), occluded.len(), "one packet of answers per packet of rays");
        assert_eq!(rays.len(), count.div_ceil(LANES), "as many packets as the rays take");
        // Which surface is hit must be known: one query of closest hits is faster than one of any
        // hits, and another one of closest hits for the rays that are occluded by anything.
        let mut hits = [HitPacket::default(); PACKETS];
        let chunks = rays.chunks(PACKETS).zip(occluded.chunks_mut(PACKETS)).enumerate();
        for (chunk, (rays, occluded)) in chunks {
            let count = (count - chunk * PACKETS * LANES).min(rays.len() * LANES);
            let hits = &mut hits[..rays.len()];
            self.inner.intersect(rays, count, hits, coherence);
            let packets = rays.iter().zip(hits).zip(occluded).zip(used(count, rays.len()));
            for (((rays, hits), occluded), lanes) in packets {
                for lane in lanes {
                    let hit = hits.get(lane);
                    occluded[lane] = !hit.is_miss()
                        && (!self.may_pass[hit.mesh as usize] || self.is_met(&rays.get(lane), hit));
                }
            }
        }
    }

    fn closest_hit(&self, ray: &Ray) -> Hit {
        self.first_met(ray, self.inner.closest_hit(ray))
    }

    fn is_occluded(&self, ray: &Ray) -> bool {
        self.is_met(ray, self.inner.closest_hit(ray))
    }

    fn describe(&self) -> AccelInfo {
        self.inner.describe()
    }
}
