//! Photons side by side, and which of them a look-up counts.

use super::LookUp;
use crate::base::math::Rgb;
use crate::transport::photon::{Photon, Side};
use glam::{BVec4A, Vec3, Vec4};

/// Photons of a quad.
pub const QUAD: usize = 4;

/// Four photons: what decides whether they count, and what they carry, a cache line each.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub struct Quad {
    position: [[f32; QUAD]; 3],
    side: [Side; QUAD],
    flux: [[f32; QUAD]; 3],
    path: [u32; QUAD],
}

/// What a look-up compares photons with, in all lanes.
#[derive(Clone, Copy, Debug)]
pub struct Counting {
    position: [Vec4; 3],
    radius2: Vec4,
    normal: [Vec4; 3],
    last: bool,
}

/// Which lanes of a quad are at this place or after it, counted from its first.
#[inline(always)]
pub fn lanes_from(place: usize) -> BVec4A {
    Vec4::new(0.0, 1.0, 2.0, 3.0).cmpge(Vec4::splat(place as i32 as f32))
}

/// Flux found by a look-up, in each lane by itself: the order of additions is that of the places.
#[derive(Clone, Copy, Debug, Default)]
pub struct Flux([Vec4; 3]);

impl Counting {
    /// Photons that this look-up counts within the square root of `radius2`.
    #[inline(always)] // as those below: parts of the loop over ranges
    pub fn new(look_up: &LookUp, radius2: f32) -> Self {
        Self {
            position: look_up.position.to_array().map(Vec4::splat),
            radius2: Vec4::splat(radius2),
            normal: look_up.normal.to_array().map(Vec4::splat),
            last: look_up.last,
        }
    }
}

impl Flux {
    /// Of all lanes together.
    #[inline(always)]
    pub fn total(&self) -> Rgb {
        Rgb::from_array(self.0.map(Vec4::element_sum))
    }
}

impl Quad {
    /// Replaces one photon.
    #[inline]
    pub fn set(&mut self, lane: usize, photon: &Photon) {
        let Self { position, side, flux, path } = self;
        for (lanes, coordinate) in position.iter_mut().zip(photon.position.to_array()) {
            lanes[lane] = coordinate;
        }
        side[lane] = photon.side;
        for (lanes, channel) in flux.iter_mut().zip(photon.flux.to_array()) {
            lanes[lane] = channel;
        }
        path[lane] = photon.path;
    }

    /// One photon, as far as it is here.
    #[inline]
    pub fn get(&self, lane: usize) -> Photon {
        Photon {
            position: Vec3::from_array(self.position.map(|lanes| lanes[lane])),
            path: self.path[lane],
            flux: Rgb::from_array(self.flux.map(|lanes| lanes[lane])),
            side: self.side[lane],
            from: 0,
        }
    }

    /// The lanes within a distance of a point, a bit for each.
    #[inline(always)]
    pub fn within(&self, point: Vec3, radius2: f32) -> u64 {
        let near = self.near(&point.to_array().map(Vec4::splat), Vec4::splat(radius2));
        near.bitmask().into()
    }

    /// Which of some lanes count.
    #[inline(always)]
    pub fn counting(&self, counting: &Counting, lanes: BVec4A) -> BVec4A {
        let normal = |axis| Vec4::from_array(self.side.map(|side| side.coordinate(axis)));
        // In the order of `Vec3::dot`.
        let [x, y, z] = counting.normal;
        let faces = normal(0) * x + normal(1) * y + normal(2) * z;
        let near = self.near(&counting.position, counting.radius2);
        // theory.md (45)
        let mut counts = near & faces.cmpgt(Vec4::ZERO) & lanes;
        if !counting.last {
            let late = self.side.map(|side| if side.at_every_vertex() { 0.0 } else { 1.0 });
            counts &= Vec4::from_array(late).cmpeq(Vec4::ZERO);
        }
        counts
    }

    /// Adds the flux of some lanes.
    #[inline(always)]
    pub fn add_to(&self, sum: &mut Flux, lanes: BVec4A) {
        for (sum, flux) in sum.0.iter_mut().zip(self.flux) {
            *sum += Vec4::select(lanes, Vec4::from_array(flux), Vec4::ZERO);
        }
    }

    /// The lanes in the inner half of the area that photons count in.
    #[inline(always)]
    pub fn inner(&self, counting: &Counting) -> BVec4A {
        self.near(&counting.position, 0.5 * counting.radius2)
    }

    /// The light path of each lane, and its flux times `weight`.
    #[inline(always)]
    pub fn pairs(&self, weight: Rgb) -> ([u32; QUAD], Vec4) {
        let [r, g, b] = self.flux.map(Vec4::from_array);
        (self.path, r * weight.x + g * weight.y + b * weight.z)
    }

    #[inline(always)]
    fn near(&self, center: &[Vec4; 3], radius2: Vec4) -> BVec4A {
        let [x, y, z] = self.position.map(Vec4::from_array);
        let (dx, dy, dz) = (x - center[0], y - center[1], z - center[2]);
        // In the order of `Vec3::distance_squared`.
        (dx * dx + dy * dy + dz * dz).cmple(radius2)
    }
}
