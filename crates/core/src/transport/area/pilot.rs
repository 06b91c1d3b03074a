//! Traces light paths to find the sides of surfaces that light reaches.

use super::{Marks, Sides, Surfaces};
use crate::accel::{Intersect, Ray};
use crate::base::rng::{Rng, Stream, StreamKey};
use crate::scene::Scene;
use crate::scene::bsdf::Transport;
use rayon::prelude::*;

/// Light paths: each component of a surface that matters to the image is found by some of them.
const PATHS: u32 = 1 << 15;

/// Maximum number of vertices of a light path.
const MOST_VERTICES: u32 = 64;

/// Largest survival probability.
const MAX_SURVIVAL: f32 = 0.95;

/// Traces the light paths. They do not depend on the settings, so that all renders of a scene
/// agree.
pub(super) fn reached(scene: &Scene, accel: &dyn Intersect, surfaces: &dyn Surfaces) -> Sides {
    let marks = Marks::new(surfaces);
    if !scene.lights().is_empty() {
        let key = StreamKey::new(0, Stream::Pilot, 0);
        (0..PATHS).into_par_iter().with_min_len(256).for_each(|path| {
            trace(scene, accel, &marks, &mut key.rng(path.into()));
        });
    }
    marks.freeze()
}

fn trace(scene: &Scene, accel: &dyn Intersect, marks: &Marks, rng: &mut Rng) {
    let emission = scene.lights().emit(rng);
    let (mut ray, mut wavelength) = (Ray::new(emission.origin, emission.direction), None);
    for _ in 0..MOST_VERTICES {
        let hit = accel.closest_hit(&ray);
        if hit.is_miss() {
            return;
        }
        let mut surface = scene.surface(&ray, &hit);
        let _ = surface.disperse(&mut wavelength, rng);
        // Light that ends at a black back does not mark it: the back bounds something solid.
        let at = surface.vertex(Transport::Flux);
        let Some(sample) = surface.scatter_flux(&at, rng) else { return };
        marks.add(hit.mesh, hit.triangle, surface.front);
        if rng.next_1d() >= sample.weight.max_element().min(MAX_SURVIVAL) {
            return;
        }
        ray = Ray::new(surface.start(sample.wi), sample.wi);
    }
}
