//! Russian roulette of light paths, and how they leave a vertex that is handled alone.

use super::path_state::PathState;
use crate::accel::Ray;
use crate::base::math::Rgb;
use crate::scene::bsdf::BsdfSample;
use crate::scene::{Scene, Surface};

/// Maximum survival probability: paths end even between perfectly white walls.
pub(super) const MAX_SURVIVAL: f32 = 0.995;

/// Survival probability at a vertex that multiplies the flux by `weight`: theory.md (39).
#[inline(always)] // part of vector loops
pub(super) fn survival(weight: Rgb) -> f32 {
    weight.max_element().min(MAX_SURVIVAL)
}

/// Plays roulette at a vertex that multiplies the flux by `weight`. Returns false if the path ends.
#[inline]
pub(super) fn survives(weight: Rgb, state: &mut PathState) -> bool {
    let survival = survival(weight);
    // theory.md (38)
    state.weight *= weight / survival;
    state.rng.next_1d() < survival
}

/// Continues a path that a surface scatters by a sample, unless it ends.
#[inline]
pub(super) fn leave(
    scene: &Scene,
    surface: &Surface,
    sample: &BsdfSample,
    mut state: PathState,
) -> Option<(Ray, PathState)> {
    if !survives(sample.weight, &mut state) {
        return None;
    }
    state.history = state.history.leaving(scene, surface, sample.wi);
    Some((Ray::new(surface.start(sample.wi), sample.wi), state))
}
