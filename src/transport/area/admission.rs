//! Which photons are merged at a point: what decides for the photon and for the surface alike.

use glam::Vec3;

/// A photon's normal is 127 long; the dot product with the unit normal where it is merged must
/// exceed this, half of it.
pub const LIMIT: f32 = 63.5;

/// A unit normal as photons hold it: each coordinate rounded to 1/127, 127 units long.
#[inline(always)] // part of vector loops
pub fn packed(normal: Vec3) -> Vec3 {
    // Adding 1.5 * 2^23 rounds to the nearest integer and leaves it in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    Vec3::from_array(normal.to_array().map(|c| (c * 127.0 + ROUND) - ROUND))
}

/// Whether a photon of this [`packed`] normal is merged where the surface has the unit normal
/// `normal`: the angle between them is less than 60 degrees.
///
/// Neither the photon's direction nor its place decides: in a fold they would tell other surfaces
/// apart than the area does.
#[inline(always)]
pub fn admits(packed: Vec3, normal: Vec3) -> bool {
    packed.dot(normal) > LIMIT
}
