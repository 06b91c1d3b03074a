//! Which photons are merged at a point: what decides for the photon and for the surface alike.

use glam::Vec3;

/// A photon's normal is 127 long; the dot product with the unit normal where it is merged must
/// exceed this, half of it.
pub const LIMIT: f32 = 63.5;

/// How far from the plane of a photon's surface the point where it is merged may be, over the radius. What is in reach
/// beside that is another layer: the ceiling above a lamp, the shelf below a shelf, which have light of their own. A
/// sphere of twice the radius or more loses nothing.
pub const THICKNESS: f32 = 0.25;

/// Of the squared distance from that plane, 127 times as long: with this factor it is to be within the squared radius.
pub const FLATTENING: f32 = 1.0 / (127.0 * 127.0 * THICKNESS * THICKNESS);

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
/// The photon's direction does not decide, and of its place only the distance from its own plane ([`THICKNESS`]),
/// which is the same all over a triangle: else photons in a fold would be told apart otherwise than the area is.
#[inline(always)]
pub fn admits(packed: Vec3, normal: Vec3) -> bool {
    packed.dot(normal) > LIMIT
}
