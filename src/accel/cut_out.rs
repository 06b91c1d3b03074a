//! Cut-outs: parts of triangles that all rays pass as if nothing were there.

use super::{AccelInfo, Coherence, Hit, Intersect, Ray};
use crate::scene::{Mesh, Placement, Scene, Texture};
use glam::Vec2;
use std::collections::HashMap;
use std::sync::Arc;

/// Surfaces of less opacity are not there.
const THRESHOLD: f32 = 0.5;

/// A backend in which some meshes have holes.
pub struct CutOuts {
    inner: Box<dyn Intersect>,
    /// By the mesh index of hits.
    masks: Vec<Option<Mask>>,
}

/// The holes of a mesh at one of its places.
struct Mask {
    opacity: Arc<Texture>,
    /// Texture coordinates of each triangle's corners.
    uvs: Arc<[[Vec2; 3]]>,
}

impl CutOuts {
    /// Cuts the holes of the scene's materials out of `inner`, if there are any.
    pub fn wrap(inner: Box<dyn Intersect>, scene: &Scene) -> Box<dyn Intersect> {
        let uvs = |mesh: &Mesh| {
            let uv = |index: u32| mesh.uvs.get(index as usize).copied().unwrap_or_default();
            mesh.triangles.iter().map(|corners| corners.map(uv)).collect::<Arc<_>>()
        };
        let mut known: HashMap<u32, Arc<_>> = HashMap::new();
        let mut mask = |placement: &Placement| {
            let opacity = scene.materials[placement.material as usize].cut_out()?.clone();
            let uvs = known.entry(placement.mesh).or_insert_with(|| uvs(scene.mesh(placement)));
            Some(Mask { opacity, uvs: uvs.clone() })
        };
        let masks: Vec<_> = scene.placements.iter().map(&mut mask).collect();
        if masks.iter().all(Option::is_none) { inner } else { Box::new(Self { inner, masks }) }
    }

    /// Whether there is nothing where a ray hit.
    fn is_hole(&self, hit: &Hit) -> bool {
        if hit.is_miss() {
            return false;
        }
        self.masks[hit.mesh as usize].as_ref().is_some_and(|mask| {
            let [a, b, c] = mask.uvs[hit.triangle as usize];
            let uv = a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v;
            mask.opacity.opacity(uv) < THRESHOLD
        })
    }

    /// The closest hit from `hit` on that is no hole.
    fn solid(&self, ray: &Ray, mut hit: Hit) -> Hit {
        let mut step = f32::EPSILON;
        while self.is_hole(&hit) {
            let t_near = (hit.t * (1.0 + step)).max(f32::MIN_POSITIVE);
            let next = self.inner.closest_hit(&Ray { t_near, ..*ray });
            // Rounding may find the same place again.
            let again = (next.mesh, next.triangle) == (hit.mesh, hit.triangle);
            step = if again { 2.0 * step } else { f32::EPSILON };
            hit = next;
        }
        hit
    }
}

impl Intersect for CutOuts {
    fn closest_hits(&self, rays: &[Ray], hits: &mut [Hit], coherence: Coherence) {
        self.inner.closest_hits(rays, hits, coherence);
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.solid(ray, *hit);
        }
    }

    fn occlusions(&self, rays: &[Ray], occluded: &mut [bool], coherence: Coherence) {
        self.inner.occlusions(rays, occluded, coherence);
        for (ray, occluded) in rays.iter().zip(occluded) {
            *occluded = *occluded && !self.closest_hit(ray).is_miss();
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
