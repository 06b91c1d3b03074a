//! Russian roulette: of light paths, and of all paths where they pass through a vertex.

use super::path_state::PathState;
use crate::base::math::Rgb;

/// Maximum survival probability: paths end even between perfectly white walls.
pub(super) const MAX_SURVIVAL: f32 = 0.995;

/// Share of the initial weight below which paths that pass through a vertex may end: theory.md
/// (44).
pub(super) const WEIGHT_FLOOR: f32 = 1.0 / 16.0;

/// Number of vertices passed through from which on a path ends with the probability
/// [`LONG_CHAIN_END`] at each of them: mirrors may trap light.
pub(super) const LONG_CHAIN: u32 = 16;
pub(super) const LONG_CHAIN_END: f32 = 0.1;

/// Survival probability at a vertex that multiplies the flux by `weight`: theory.md (39).
#[inline(always)] // part of vector loops
pub(super) fn survival(weight: Rgb) -> f32 {
    weight.max_element().min(MAX_SURVIVAL)
}

/// Plays roulette at a vertex that multiplies the flux by `weight`. Returns false if the path ends.
#[inline]
pub fn survives(weight: Rgb, state: &mut PathState) -> bool {
    let survival = survival(weight);
    // theory.md (38)
    state.weight *= weight / survival;
    state.rng.next_1d() < survival
}

/// Plays roulette where a path passed through a vertex, and returns whether it survives.
pub fn survives_passing(state: &mut PathState) -> bool {
    // Channels of a path with a wavelength may be negative.
    let share = state.weight.abs().max_element() * state.inverse_start;
    // theory.md (44)
    let mut survival = (share / WEIGHT_FLOOR).min(1.0);
    if state.history.passed() >= LONG_CHAIN {
        survival = survival.min(1.0 - LONG_CHAIN_END);
    }
    if survival < 1.0 {
        if state.rng.next_1d() >= survival {
            return false;
        }
        state.weight /= survival;
    }
    true
}
