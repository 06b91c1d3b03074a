//! Light paths under way.

use crate::accel::Ray;
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use crate::lanes::{LANES, Rngs, Vec3s};
use crate::settings::Roulette;
use crate::transport::flight::Columns;
use crate::transport::photon::PhotonClass;
use bytemuck::{Pod, Zeroable};

/// With [`Roulette::Weight`], paths whose weight fell below this share play roulette.
const WEIGHT_FLOOR: f32 = 1.0 / 16.0;

/// Largest survival probability: paths end even between perfectly white walls.
const MAX_SURVIVAL: f32 = 0.995;

/// Sixteen paths under way.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Walks {
    /// Of the next rays.
    pub origin: Vec3s,
    /// Unit vectors.
    pub direction: Vec3s,
    pub rng: Rngs,
    pub flux: Vec3s,
    /// Reciprocals of the largest channel of the emitted flux.
    pub inverse_emitted: [f32; LANES],
    pub path: [u32; LANES],
    /// See [`Walk::class`]: its number and 1, or 0.
    pub class: [u32; LANES],
}

impl Columns<16> for Walks {
    const T_FAR: f32 = f32::INFINITY;
}

/// One of [`Walks`], without its ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    pub rng: Rng,
    pub flux: Rgb,
    pub inverse_emitted: f32,
    pub path: u32,
    /// Of its next photon; `None` if that comes straight from a light that is connected.
    pub class: Option<PhotonClass>,
}

/// A class as one word.
pub(super) const fn encoded(class: Option<PhotonClass>) -> u32 {
    match class {
        None => 0,
        Some(class) => class as u32 + 1,
    }
}

#[inline(always)]
pub(super) fn decoded(word: u32) -> Option<PhotonClass> {
    const EVERY_VERTEX: u32 = encoded(Some(PhotonClass::EveryVertex));
    match word {
        0 => None,
        EVERY_VERTEX => Some(PhotonClass::EveryVertex),
        _ => Some(PhotonClass::LastVertex),
    }
}

impl Walks {
    pub fn get(&self, lane: usize) -> (Ray, Walk) {
        let ray = Ray::new(self.origin.get(lane), self.direction.get(lane));
        let walk = Walk {
            rng: self.rng.get(lane),
            flux: self.flux.get(lane),
            inverse_emitted: self.inverse_emitted[lane],
            path: self.path[lane],
            class: decoded(self.class[lane]),
        };
        (ray, walk)
    }

    pub fn set(&mut self, lane: usize, ray: &Ray, walk: &Walk) {
        self.origin.set(lane, ray.origin);
        self.direction.set(lane, ray.direction);
        self.rng.set(lane, walk.rng);
        self.flux.set(lane, walk.flux);
        self.inverse_emitted[lane] = walk.inverse_emitted;
        self.path[lane] = walk.path;
        self.class[lane] = encoded(walk.class);
    }
}

/// Probability of going on with `flux` from a vertex of this weight.
#[inline(always)] // part of a vector loop
pub(super) fn survival(flux: Rgb, weight: Rgb, inverse_emitted: f32, roulette: Roulette) -> f32 {
    let share = match roulette {
        Roulette::Albedo => weight.max_element(),
        Roulette::Weight => (flux * weight).max_element() * inverse_emitted / WEIGHT_FLOOR,
    };
    share.min(MAX_SURVIVAL)
}
