//! Several ways to find the same path, weighted by the balance heuristic: theory.md, section 12a.
//!
//! The weights add up to 1 for every path because all ways to find it compute the same numbers for it, whatever
//! these are. How well they are chosen decides about the noise alone.

pub mod densities;
pub mod photons;
pub mod points;
pub mod weights;

use crate::settings::{Direct, Roulette, Settings, Strategy};
use densities::Survival;
use weights::Balance;

/// What all weights of an iteration have in common.
#[derive(Clone, Copy, Debug)]
pub struct Mis {
    /// The weights.
    pub balance: Balance,
    /// How camera paths go on from merging lobes.
    pub camera: Survival,
    /// How light paths do.
    pub light: Survival,
    /// Whether light straight from a light is connected, not merged.
    pub connects: bool,
}

impl Mis {
    /// As the settings ask for; `None` if they do not.
    pub fn new(settings: &Settings) -> Option<Self> {
        (settings.strategy == Strategy::Mis).then(|| Self {
            balance: Balance::new(settings),
            camera: Survival { by_albedo: settings.camera_roulette == Roulette::Albedo, most: 1.0 },
            light: Survival {
                by_albedo: settings.light_roulette == Roulette::Albedo,
                most: super::light_paths::MAX_SURVIVAL,
            },
            connects: settings.direct == Direct::Connect,
        })
    }
}
