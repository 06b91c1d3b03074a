//! Cameras of other formats.

use bdpm_core::base::error::Result;
use bdpm_core::scene::{Camera, Optics};
use glam::{DAffine3, DMat3, DVec3};

/// Swaps left and right. Our images are not mirrored, so a scene is mirrored instead if its camera
/// mirrors.
pub const MIRROR: DMat3 = DMat3::from_cols(DVec3::NEG_X, DVec3::Y, DVec3::Z);

/// The camera that `map` moves to the scene. In its own space it looks along `forward` with +y up.
/// Its image is shifted to the right and up, in widths and heights.
///
/// # Errors
/// If the directions or the optics are not valid. The error names no place.
pub fn camera(map: DAffine3, forward: DVec3, optics: Optics, shift: [f32; 2]) -> Result<Camera> {
    let along = |axis: DVec3| map.transform_vector3(axis).normalize_or_zero().as_vec3();
    let position = map.translation.as_vec3();
    Camera::with_optics(position, along(forward), along(DVec3::Y), optics)?.shifted(shift)
}
