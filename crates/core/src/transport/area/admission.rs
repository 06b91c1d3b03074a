//! Which photons are merged at a point. One test decides for photons and for surfaces.

use glam::Vec3;

/// A photon's normal is 127 long; the dot product with the unit normal where it is merged must
/// exceed this, half of it.
pub const LIMIT: f32 = 63.5;

/// Maximum distance between a gather point and the plane of a photon's surface, over the radius.
///
/// A surface in reach that is farther away is another layer, with light of its own: the ceiling
/// above a lamp, or the next shelf. A sphere loses nothing if its radius is twice the merge radius
/// or more.
pub const THICKNESS: f32 = 0.25;

/// Factor on the squared distance from that plane, with a normal 127 units long. The product must
/// not exceed the squared radius.
pub const FLATTENING: f32 = 1.0 / (127.0 * 127.0 * THICKNESS * THICKNESS);

/// Whether photons on the side of the first tag (`Components::tag`) are on the other side of the
/// surface of the second one: inside of a thin box, say, whose outside is seen. Their normals do
/// not tell, since the sides of a box face each other.
#[inline]
pub fn is_other_side(photon: u8, point: u8) -> bool {
    photon ^ point == 1
}

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
/// The photon's direction does not decide, and of its place only the distance from its own plane
/// ([`THICKNESS`]), which is constant over a triangle. Any other test would accept photons in a
/// fold whose surface the area does not count.
#[inline(always)]
pub fn admits(packed: Vec3, normal: Vec3) -> bool {
    packed.dot(normal) > LIMIT
}
