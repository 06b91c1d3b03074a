//! The camera of files without one: it sees everything.

use bdpm_core::base::error::Result;
use bdpm_core::base::math::Bounds;
use bdpm_core::scene::{Camera, FieldOfView};
use glam::Vec3;

/// Opening angle of a camera that sees all across the image's height, degrees.
pub const WHOLE_VIEW_DEGREES: f32 = 40.0;

/// A camera that sees all of `bounds` from the front (+z, or -y if +z is up) and above, just far
/// enough for the bounding sphere.
///
/// # Errors
/// If the box is too large for a camera.
pub(super) fn camera(bounds: &Bounds, is_z_up: bool) -> Result<Camera> {
    // Far from the origin the distance may vanish in rounding, which the check of the camera does
    // not detect.
    let toward = Vec3::new(0.25, 0.4, 1.0).normalize();
    let (toward, up) = match is_z_up {
        true => (Vec3::new(toward.x, -toward.z, toward.y), Vec3::Z),
        false => (toward, Vec3::Y),
    };
    let radius = (0.5 * (bounds.max - bounds.min).length()).max(f32::MIN_POSITIVE);
    let distance = radius / (0.5 * WHOLE_VIEW_DEGREES).to_radians().sin();
    let position = bounds.center() + distance * toward;
    Camera::look(position, -toward, up, FieldOfView::Y(WHOLE_VIEW_DEGREES))
}
