//! Photons: what light paths leave where they arrive.

use crate::math::{Rgb, pack_direction, unpack_direction};
use glam::{Quat, Vec3};

/// A light path's arrival at a surface: 36 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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

/// The part of a photon that decides whether it counts, in one word: the surface normal on the side it
/// arrived from, each coordinate in 1/127 and one byte, and its class in the highest byte.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Side(pub u32);

impl Default for Side {
    fn default() -> Self {
        Self::new(Vec3::ZERO, PhotonClass::default())
    }
}

impl Side {
    fn new(normal: Vec3, class: PhotonClass) -> Self {
        // To the nearest, without a call of `round`.
        let byte = |c: f32| ((c * 127.0 + 128.5) as i32 - 128) as u8;
        let [x, y, z] = normal.to_array().map(byte);
        Self(u32::from_le_bytes([x, y, z, class as u8]))
    }

    /// The normal, 127 units long.
    #[inline(always)] // as the next: parts of vector loops
    pub fn normal(self) -> Vec3 {
        let coordinate = |shift: u32| ((self.0 << shift) as i32 >> 24) as f32;
        Vec3::new(coordinate(24), coordinate(16), coordinate(8))
    }

    /// Whether the photon is merged at every vertex.
    #[inline(always)]
    pub fn at_every_vertex(self) -> bool {
        self.0 >> 24 == PhotonClass::EveryVertex as u32
    }
}

/// At which vertices of a camera path a photon is merged, so that each path counts exactly once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum PhotonClass {
    /// No diffuse bounce since the light, though it may have passed through vertices (a caustic):
    /// merged at every vertex `1..=k`.
    EveryVertex,
    /// At least one diffuse bounce: merged at vertex `k` only.
    #[default]
    LastVertex,
}

impl Photon {
    /// `normal` is the unit normal on the side of arrival.
    pub fn new(position: Vec3, path: u32, flux: Rgb, normal: Vec3, class: PhotonClass) -> Self {
        Self { position, path, flux, side: Side::new(normal, class), from: 0 }
    }

    /// The same with the unit vector toward where it came from, for BSDFs that depend on it.
    #[must_use]
    pub fn coming_from(self, from: Vec3) -> Self {
        Self { from: pack_direction(from), ..self }
    }

    /// Unit vector toward where it came from, turned along with the surface to a place of the unit
    /// normal `normal`: what is merged there is the radiance that the surface has here.
    pub fn from_as_at(&self, normal: Vec3) -> Vec3 {
        let own = self.side.normal().normalize();
        Quat::from_rotation_arc(own, normal) * unpack_direction(self.from)
    }

    /// Whether it arrived on the side of a surface that `normal` points to: a positive dot product
    /// of the two normals.
    #[inline]
    pub fn faces(&self, normal: Vec3) -> bool {
        self.side.normal().dot(normal) > 0.0
    }

    /// Where it is merged.
    #[inline]
    pub fn class(&self) -> PhotonClass {
        if self.side.at_every_vertex() { PhotonClass::EveryVertex } else { PhotonClass::LastVertex }
    }
}
