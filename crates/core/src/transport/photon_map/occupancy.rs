//! A bit mask of the space near photons, for maps in which most queries find none.

use super::SLACK;
use crate::base::math::Bounds;
use crate::simd::{LANES, Mask, Vec3s};
use crate::transport::photon::Photon;
use std::array::from_fn;

/// A bit for each cube of space, by its hash: set if a query from inside may find a photon.
///
/// With few photons all bits are in the nearest cache, and one read ends most queries. A query that
/// would find a photon always passes; a query that finds none may pass.
#[derive(Debug, Default)]
pub struct Occupancy {
    bits: Vec<u8>,
    /// Number of bits less one: a power of two less one.
    mask: u32,
    inverse_cube: f32,
}

/// Edge of a cube over the diameter of a query. It leaves room for rounding, so that a photon
/// reaches into at most two cubes along each axis.
const CUBE_MARGIN: f32 = 1.05;
/// Maximum number of cubes between the origin and a photon along an axis: coordinates are exact to
/// 1 % of a cube.
const MAX_CUBES: f32 = 131_072.0;
/// Bits per photon, which sets up to eight of them: queries far from all photons rarely pass.
const BITS_PER_PHOTON: usize = 128;
/// Maximum number of bits, 64 KiB: reading a larger table takes longer than it saves.
const MAX_BITS: usize = 1 << 19;
/// Maximum number of photons, with half the bits for each.
const MAX_PHOTONS: usize = 2 * MAX_BITS / BITS_PER_PHOTON;

impl Occupancy {
    /// Tests whether the mask saves time for a number of photons within `bounds`.
    pub fn pays(bounds: Bounds, radius: f32, photons: usize) -> bool {
        let inverse_cube = inverse_cube(radius);
        let farthest = bounds.min.abs().max(bounds.max.abs()).max_element();
        let [x, y, z] = ((bounds.max - bounds.min) * inverse_cube).to_array();
        // Photons on the walls of a room reach into four cubes each. If they reach into most of the
        // cubes along the walls, few queries would end here.
        let walls = 2.0 * (x * y + y * z + z * x);
        farthest * inverse_cube <= MAX_CUBES
            && photons <= MAX_PHOTONS
            && 4.0 * photons as f32 <= walls
    }

    /// Sets the bits of the cubes around these photons, in a table for `count` of them.
    pub fn mark(&mut self, slices: &[&[Photon]], count: usize, radius: f32) {
        let bits = (count * BITS_PER_PHOTON).next_power_of_two().clamp(8, MAX_BITS);
        self.bits.clear();
        self.bits.resize(bits / 8 + 1, 0);
        self.mask = bits as u32 - 1;
        self.inverse_cube = inverse_cube(radius);
        let reach = radius * SLACK;
        for photon in slices.iter().copied().flatten() {
            let cubes = |c: f32| [self.cube(c - reach), self.cube(c + reach)];
            let [[x, next_x], y, z] = photon.position.to_array().map(cubes);
            // Neighboring cubes along x have neighboring bits.
            let along_x = 1 | 1 << (next_x.wrapping_sub(x) & 1);
            for z in z {
                for y in y {
                    let bit = hash([x, y, z]) & self.mask;
                    let bytes = self.bits[bit as usize / 8..].first_chunk_mut().expect("one more");
                    *bytes = (u16::from_le_bytes(*bytes) | along_x << (bit % 8)).to_le_bytes();
                }
            }
        }
        // The first bit follows the last one.
        self.bits[0] |= self.bits[bits / 8];
    }

    /// The lanes whose queries may find photons.
    #[inline(always)] // vectorized
    pub fn may_find(&self, positions: &Vec3s) -> Mask {
        let Vec3s { x, y, z } = positions;
        let [x, y, z] = [x, y, z].map(|positions| positions.map(|position| self.cube(position)));
        let bits: [u32; LANES] = from_fn(|lane| hash([x[lane], y[lane], z[lane]]) & self.mask);
        bits.map(|bit| self.bits[bit as usize / 8] >> (bit % 8) & 1 == 1)
    }

    /// Number of the cube at this coordinate along an axis. It never decreases with the coordinate.
    #[inline(always)]
    fn cube(&self, coordinate: f32) -> u32 {
        // Adding 1.5 * 2^23 leaves the nearest whole number in the lowest bits.
        (coordinate * self.inverse_cube + 12_582_912.0).to_bits()
    }
}

fn inverse_cube(radius: f32) -> f32 {
    (2.0 * radius * SLACK * CUBE_MARGIN).recip()
}

/// Neighbors along y and z get bits far apart. Odd factors use all bits equally.
#[inline(always)]
fn hash([x, y, z]: [u32; 3]) -> u32 {
    x.wrapping_add(y.wrapping_mul(0x9E37_79B1)).wrapping_add(z.wrapping_mul(0x85EB_CA77))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::photon::PhotonClass;
    use glam::Vec3;

    #[test]
    fn cubes_at_both_ends_of_the_table_are_neighbors() {
        let radius = 0.5;
        let mut occupancy = Occupancy::default();
        let mut at_the_end = 0;
        for cube in 0..1000 {
            // Just below the border of two cubes along x, in the middle of one along y and z.
            let edge = 2.0 * radius * SLACK * CUBE_MARGIN;
            let position = Vec3::new((cube as f32 + 0.499) * edge, 0.0, 0.0);
            let photon = Photon::new(position, 0, Vec3::ONE, Vec3::Z, PhotonClass::Diffuse);
            occupancy.mark(&[&[photon]], 1, radius);
            let last = hash(position.to_array().map(|c| occupancy.cube(c))) & occupancy.mask
                == occupancy.mask;
            at_the_end += u32::from(last);
            let next = position + Vec3::X * radius;
            assert_ne!(occupancy.cube(position.x), occupancy.cube(next.x));
            assert_eq!(occupancy.may_find(&Vec3s::splat(next)), [true; LANES], "{cube}");
        }
        assert!(at_the_end > 3, "{at_the_end}");
    }
}
