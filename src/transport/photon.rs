//! Photons: what light paths leave where they arrive.

use crate::base::math::{Bounds, Rgb, pack_direction, unpack_direction};
use crate::simd::dispatch::{Simd, one_by_one};
use crate::simd::{LANES, Vec3s};
use bytemuck::{Pod, Zeroable};
use glam::{Quat, Vec3, Vec3A};
use serde::{Deserialize, Serialize};

/// A light path's arrival at a surface: 36 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
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

/// What is to be known of all photons before they can be sorted.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Box around their positions.
    pub bounds: Bounds,
    /// How many they are.
    pub count: usize,
    /// Whether any is merged at every vertex.
    pub has_caustic_photons: bool,
    /// Whether any tells where it comes from; the packed direction 0 needs no telling.
    pub directions: bool,
}

impl Default for Extent {
    /// Of no photons.
    fn default() -> Self {
        Self { bounds: Bounds::EMPTY, count: 0, has_caustic_photons: false, directions: false }
    }
}

impl Extent {
    /// That of some photons.
    pub fn of(photons: &[Photon]) -> Self {
        let (mut min, mut max) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let (mut has_caustic_photons, mut directions) = (false, 0);
        for photon in photons {
            // In this order a position that is not a number leaves them as they are.
            min = Vec3A::from(photon.position).min(min);
            max = Vec3A::from(photon.position).max(max);
            has_caustic_photons |= photon.class() == PhotonClass::Caustic;
            directions |= photon.from;
        }
        let bounds = Bounds { min: min.into(), max: max.into() };
        Self { bounds, count: photons.len(), has_caustic_photons, directions: directions != 0 }
    }

    /// That of these photons and others.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        let Bounds { min, max } = other.bounds;
        Self {
            bounds: Bounds { min: self.bounds.min.min(min), max: self.bounds.max.max(max) },
            count: self.count + other.count,
            has_caustic_photons: self.has_caustic_photons | other.has_caustic_photons,
            directions: self.directions | other.directions,
        }
    }
}

/// Sixteen photons, but for their directions.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
pub(crate) struct Photons {
    pub position: Vec3s,
    pub path: [u32; LANES],
    pub flux: Vec3s,
    pub side: [u32; LANES],
}

impl Photons {
    /// One by one, with the packed direction `from` which each came.
    #[inline(always)] // part of the loop over vertices
    pub fn one_by_one(&self, simd: Simd, from: &[u32; LANES], mut each: impl FnMut(usize, Photon)) {
        one_by_one(simd, bytemuck::cast_ref(self), |lane, words| {
            let mut photon = [from[lane]; 9];
            photon[..8].copy_from_slice(words.as_flattened());
            each(lane, bytemuck::cast(photon));
        });
    }
}

/// The part of a photon that decides whether it counts, in one word: the surface normal on the side it
/// arrived from, each coordinate in 1/127 and one byte, and its class in the highest byte.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(transparent)]
pub(crate) struct Side(pub u32);

impl Default for Side {
    fn default() -> Self {
        Self::new(Vec3::ZERO, PhotonClass::default() as u32)
    }
}

impl Side {
    #[inline(always)] // as the next: parts of vector loops
    pub fn new(normal: Vec3, class: u32) -> Self {
        // Adding 1.5 * 2^23 rounds to the nearest integer and leaves it in the lowest bits.
        let byte = |c: f32| (c * 127.0 + 12_582_912.0).to_bits() & 0xff;
        let [x, y, z] = normal.to_array().map(byte);
        Self(x | y << 8 | z << 16 | class << 24)
    }

    /// The normal, 127 units long.
    #[inline(always)]
    pub fn normal(self) -> Vec3 {
        Vec3::new(self.coordinate(0), self.coordinate(1), self.coordinate(2))
    }

    /// The normal along one axis, in 1/127.
    #[inline(always)]
    pub fn coordinate(self, axis: u32) -> f32 {
        ((self.0 << (24 - 8 * axis)) as i32 >> 24) as f32
    }

    /// Whether the photon is merged at every vertex.
    #[inline(always)]
    pub fn at_every_vertex(self) -> bool {
        self.0 >> 24 == PhotonClass::Caustic as u32
    }
}

/// At which vertices of a camera path a photon is merged, so that each path counts exactly once.
/// theory.md, section 4: which path is counted where.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
pub enum PhotonClass {
    /// No diffuse bounce since the light, though it may have passed through vertices (a caustic):
    /// merged at every vertex `1..=k`.
    Caustic,
    /// At least one diffuse bounce: merged at vertex `k` only.
    #[default]
    Diffuse,
}

impl Photon {
    /// `normal` is the unit normal on the side of arrival.
    pub fn new(position: Vec3, path: u32, flux: Rgb, normal: Vec3, class: PhotonClass) -> Self {
        Self { position, path, flux, side: Side::new(normal, class as u32), from: 0 }
    }

    /// The same with the unit vector toward where it came from, for BSDFs that depend on it.
    #[must_use]
    pub fn coming_from(self, from: Vec3) -> Self {
        Self { from: pack_direction(from), ..self }
    }

    /// Unit vector toward where it came from, turned along with the surface to a place of the unit
    /// normal `normal`: what is merged there is the radiance that the surface has here.
    /// theory.md (46), R.
    pub fn from_as_at(&self, normal: Vec3) -> Vec3 {
        let own = self.side.normal().normalize();
        Quat::from_rotation_arc(own, normal) * unpack_direction(self.from)
    }

    /// Dot product of `normal` with the normal on the side that it arrived on, 127 units long.
    #[inline]
    pub fn cosine(&self, normal: Vec3) -> f32 {
        self.side.normal().dot(normal)
    }

    /// Where it is merged.
    #[inline]
    pub fn class(&self) -> PhotonClass {
        if self.side.at_every_vertex() { PhotonClass::Caustic } else { PhotonClass::Diffuse }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::dispatch::vectorized;

    #[test]
    fn sixteen_photons_are_each_of_them() {
        let (mut photons, mut from, mut expected) = (Photons::zeroed(), [0; LANES], Vec::new());
        for (lane, from) in from.iter_mut().enumerate() {
            let number = lane as f32;
            let normal = Vec3::new(number - 8.0, 3.0, -number).normalize();
            let class = if lane % 3 == 0 { PhotonClass::Caustic } else { PhotonClass::Diffuse };
            let (position, flux) = (Vec3::splat(number) + Vec3::X, Rgb::new(1.0, number, 0.5));
            photons.position.set(lane, position);
            photons.path[lane] = 100 + lane as u32;
            photons.flux.set(lane, flux);
            photons.side[lane] = Side::new(normal, class as u32).0;
            *from = pack_direction(normal);
            let photon = Photon::new(position, 100 + lane as u32, flux, normal, class);
            expected.push(photon.coming_from(normal));
            assert_eq!(photon.class(), class);
            assert!(photon.side.normal().distance(127.0 * normal) < 0.87); // half a unit each way
        }
        for simd in [Simd::default(), vectorized(|simd| simd)] {
            let mut found = Vec::new();
            photons.one_by_one(simd, &from, |lane, photon| {
                assert_eq!(lane, found.len());
                found.push(photon);
            });
            assert_eq!(found, expected);
        }
    }
}
