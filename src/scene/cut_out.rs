//! Cut-outs: parts of triangles that all rays pass as if nothing were there.

use super::{Mesh, Placement, Scene, Texture};
use crate::accel::packet::used;
use crate::accel::{AccelInfo, Coherence, Hit, HitPacket, Intersect, Ray, RayPacket};
use crate::lanes::Mask;
use glam::Vec2;
use std::collections::HashMap;
use std::sync::Arc;

/// Surfaces of less opacity are not there.
const THRESHOLD: f32 = 0.5;

/// A backend in which some meshes have holes.
pub struct CutOuts {
    inner: Box<dyn Intersect>,
    /// By the mesh index of hits.
    holes: Vec<Option<Holes>>,
}

/// The holes of a mesh at one of its places.
struct Holes {
    opacity: Arc<Texture>,
    /// Texture coordinates of each triangle's corners.
    uvs: Arc<[[Vec2; 3]]>,
}

impl Scene {
    /// Whether there is nothing at `uv` of a surface that is cut out by `opacity`.
    pub(crate) fn is_hole(opacity: &Texture, uv: Vec2) -> bool {
        opacity.opacity(uv) < THRESHOLD
    }
}

impl CutOuts {
    /// Cuts the holes of the scene's materials out of `inner`, if there are any.
    pub fn wrap(inner: Box<dyn Intersect>, scene: &Scene) -> Box<dyn Intersect> {
        let uvs = |mesh: &Mesh| {
            let uv = |index: u32| mesh.uvs.get(index as usize).copied().unwrap_or_default();
            mesh.triangles.iter().map(|corners| corners.map(uv)).collect::<Arc<_>>()
        };
        let mut known: HashMap<u32, Arc<_>> = HashMap::new();
        let mut holes = |placement: &Placement| {
            let opacity = scene.materials[placement.material as usize].cut_out()?.clone();
            let uvs = known.entry(placement.mesh).or_insert_with(|| uvs(scene.mesh(placement)));
            Some(Holes { opacity, uvs: uvs.clone() })
        };
        let holes: Vec<_> = scene.placements.iter().map(&mut holes).collect();
        if holes.iter().all(Option::is_none) { inner } else { Box::new(Self { inner, holes }) }
    }

    /// Whether there is nothing where a ray hit.
    fn is_hole(&self, hit: &Hit) -> bool {
        if hit.is_miss() {
            return false;
        }
        self.holes[hit.mesh as usize].as_ref().is_some_and(|holes| {
            let [a, b, c] = holes.uvs[hit.triangle as usize];
            let uv = a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v;
            Scene::is_hole(&holes.opacity, uv)
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
                if self.is_hole(&hits.get(lane)) {
                    hits.set(lane, &self.solid(&rays.get(lane), hits.get(lane)));
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
