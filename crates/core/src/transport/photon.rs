//! Photons: the records of light paths at the surfaces where they arrive.

use crate::base::math::{Bounds, Rgb, pack_direction, unpack_direction};
use crate::base::spectrum::Wavelength;
use crate::simd::dispatch::{Simd, for_each_row};
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
    /// Flux, W, of its light path alone: divided by `N_F` it is the photon's part of the light.
    pub flux: Rgb,
    /// Normal on the side of arrival, and the class.
    pub(crate) arrival: Arrival,
    /// Packed unit vector against the direction of flight, 0 in scenes where no BSDF needs it. In
    /// dispersive scenes its lowest bits are the wavelength: see [`pack_wavelength`].
    pub(crate) from: u32,
}

/// Bounds and number of a set of photons, as the sorting of a photon map needs them.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Box around their positions.
    pub bounds: Bounds,
    /// Number of photons.
    pub count: usize,
    /// At least one photon is [`PhotonClass::Caustic`].
    pub has_caustic_photons: bool,
    /// At least one packed direction is not 0.
    pub has_directions: bool,
}

impl Default for Extent {
    /// The extent of no photons.
    fn default() -> Self {
        Self { bounds: Bounds::EMPTY, count: 0, has_caustic_photons: false, has_directions: false }
    }
}

impl Extent {
    /// The extent of these photons.
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
        let has_directions = directions != 0;
        Self { bounds, count: photons.len(), has_caustic_photons, has_directions }
    }

    /// The extent of both sets of photons.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        let Bounds { min, max } = other.bounds;
        Self {
            bounds: Bounds { min: self.bounds.min.min(min), max: self.bounds.max.max(max) },
            count: self.count + other.count,
            has_caustic_photons: self.has_caustic_photons | other.has_caustic_photons,
            has_directions: self.has_directions | other.has_directions,
        }
    }
}

/// Lowest bits of each coordinate of a packed direction, which hold half of the index of a
/// wavelength.
const WAVELENGTH_BITS: u32 = 5;

/// Replaces the lowest five bits of each coordinate of a packed direction by the index of a
/// wavelength, 0 for none. This turns the direction by at most 4e-3 radians: the lobes of surfaces
/// that merge are many times as wide.
#[inline(always)] // part of a vector loop
pub(crate) fn pack_wavelength(from: u32, index: u32) -> u32 {
    const LOW: u32 = (1 << WAVELENGTH_BITS) - 1;
    from & !(LOW | LOW << 16) | index & LOW | index >> WAVELENGTH_BITS << 16
}

/// Sixteen photons without their directions.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
pub(crate) struct PhotonPacket {
    pub position: Vec3s,
    pub path: [u32; LANES],
    pub flux: Vec3s,
    pub arrival: [u32; LANES],
}

impl PhotonPacket {
    /// Calls `each` with every lane and its photon, whose packed direction is in `from`.
    #[inline(always)] // part of the loop over vertices
    pub fn one_by_one(&self, simd: Simd, from: &[u32; LANES], mut each: impl FnMut(usize, Photon)) {
        for_each_row(simd, bytemuck::cast_ref(self), |lane, words| {
            let mut photon = [from[lane]; 9];
            photon[..8].copy_from_slice(words.as_flattened());
            each(lane, bytemuck::cast(photon));
        });
    }
}

/// Normal, class and side of a photon in one word, as admission tests need them. Three bytes are
/// the surface normal on the side of arrival, each coordinate in 1/127. The lowest bit of the
/// highest byte is the class. Its other bits are the tag (`Components::tag`) of the side, or 0
/// without areas.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(transparent)]
pub(crate) struct Arrival(pub u32);

impl Default for Arrival {
    fn default() -> Self {
        Self::new(Vec3::ZERO, PhotonClass::default() as u32)
    }
}

impl Arrival {
    #[inline(always)] // part of vector loops, as the methods below
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

    /// Sets the tag of the side.
    #[inline(always)]
    #[must_use]
    pub fn on_side(self, tag: u8) -> Self {
        Self(self.0 | u32::from(tag) << 25)
    }

    /// Tests whether the class is [`PhotonClass::Caustic`].
    #[inline(always)]
    pub fn is_caustic(self) -> bool {
        let (selected, value) = Self::class_bits(PhotonClass::Caustic);
        self.0 >> 24 & selected == value
    }

    /// The bit of the class in the highest byte, and its value for photons of this class.
    #[inline(always)]
    pub fn class_bits(class: PhotonClass) -> (u32, u32) {
        (1, class as u32)
    }

    /// The bits of the side in the highest byte, and their value for photons on this side.
    #[inline(always)]
    pub fn side_bits(side: PhotonSide) -> (u32, u32) {
        (0xfe, u32::from(side.0))
    }

    /// Tests whether the photon is on this side.
    #[inline(always)]
    pub fn is_on(self, side: PhotonSide) -> bool {
        let (selected, value) = Self::side_bits(side);
        self.0 >> 24 & selected == value
    }
}

/// A side of a surface: the highest byte of the `Arrival` of its photons, without their class.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PhotonSide(u8);

impl PhotonSide {
    /// The side on which no photon is.
    pub const NONE: Self = Self(1);

    /// The other side of the surface whose side has this tag.
    #[inline(always)]
    pub fn other(tag: u8) -> Self {
        Self((tag ^ 1) << 1)
    }

    /// The other side of the same surface.
    #[inline(always)]
    #[must_use]
    pub fn opposite(self) -> Self {
        Self(self.0 ^ 2)
    }
}

impl Default for PhotonSide {
    fn default() -> Self {
        Self::NONE
    }
}

/// Class of a photon by its history. It decides at which vertices of a camera path the photon is
/// merged, so that each path counts exactly once: theory.md, section 4.
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

impl PhotonClass {
    /// Both, in the order of their numbers.
    pub const ALL: [Self; 2] = [Self::Caustic, Self::Diffuse];
}

impl Photon {
    /// A photon without a direction; `normal` is the unit normal on the side of arrival.
    pub fn new(position: Vec3, path: u32, flux: Rgb, normal: Vec3, class: PhotonClass) -> Self {
        Self { position, path, flux, arrival: Arrival::new(normal, class as u32), from: 0 }
    }

    /// Sets the tag (`Components::tag`) of the side that it arrived on.
    #[must_use]
    pub(crate) fn on_side(self, tag: u8) -> Self {
        Self { arrival: self.arrival.on_side(tag), ..self }
    }

    /// Sets the unit vector against the direction of flight, for BSDFs that depend on it.
    #[must_use]
    pub fn coming_from(self, from: Vec3) -> Self {
        Self { from: pack_direction(from), ..self }
    }

    /// Unit vector against the direction of flight, rotated with the surface to a place of the unit
    /// normal `normal`: the merge estimates the radiance of the photon's surface there. theory.md
    /// (46), R.
    pub fn from_as_at(&self, normal: Vec3) -> Vec3 {
        let own = self.arrival.normal().normalize();
        Quat::from_rotation_arc(own, normal) * unpack_direction(self.from)
    }

    /// Unit vector against the direction of flight.
    pub fn direction(&self) -> Vec3 {
        unpack_direction(self.from)
    }

    /// Wavelength in dispersive scenes, `None` for all wavelengths; meaningless in other scenes.
    #[inline]
    pub(crate) fn wavelength(&self) -> Option<Wavelength> {
        const LOW: u32 = (1 << WAVELENGTH_BITS) - 1;
        Wavelength::from_index(self.from & LOW | (self.from >> 16 & LOW) << WAVELENGTH_BITS)
    }

    /// Dot product of `normal` with the normal on the side that it arrived on, 127 units long.
    #[inline]
    pub fn cosine(&self, normal: Vec3) -> f32 {
        self.arrival.normal().dot(normal)
    }

    /// Class, which decides where the photon is merged.
    #[inline]
    pub fn class(&self) -> PhotonClass {
        if self.arrival.is_caustic() { PhotonClass::Caustic } else { PhotonClass::Diffuse }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::dispatch::vectorized;

    #[test]
    fn photon_packet_splits_into_its_photons() {
        let (mut photons, mut from, mut expected) =
            (PhotonPacket::zeroed(), [0; LANES], Vec::new());
        for (lane, from) in from.iter_mut().enumerate() {
            let number = lane as f32;
            let normal = Vec3::new(number - 8.0, 3.0, -number).normalize();
            let class = if lane % 3 == 0 { PhotonClass::Caustic } else { PhotonClass::Diffuse };
            let (position, flux) = (Vec3::splat(number) + Vec3::X, Rgb::new(1.0, number, 0.5));
            photons.position.set(lane, position);
            photons.path[lane] = 100 + lane as u32;
            photons.flux.set(lane, flux);
            photons.arrival[lane] = Arrival::new(normal, class as u32).0;
            *from = pack_direction(normal);
            let photon = Photon::new(position, 100 + lane as u32, flux, normal, class);
            expected.push(photon.coming_from(normal));
            assert_eq!(photon.class(), class);
            assert!(photon.arrival.normal().distance(127.0 * normal) < 0.87); // half a unit each way
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

    #[test]
    fn wavelengths_fit_beside_directions() {
        for index in 0..1024 {
            let w = Vec3::new(index as f32 - 500.0, 300.0, (index % 7) as f32 * 50.0 - 120.0)
                .normalize();
            let mut photon =
                Photon::new(Vec3::ZERO, 0, Rgb::ONE, Vec3::Z, PhotonClass::Caustic).coming_from(w);
            photon.from = pack_wavelength(photon.from, index);
            assert_eq!(photon.wavelength().map_or(0, Wavelength::index), index);
            // 31 of 32,767 units along each axis, by at most sqrt(3) sqrt(6) on the sphere
            assert!(unpack_direction(photon.from).distance(w) < 4.1e-3, "{index}");
        }
    }
}
