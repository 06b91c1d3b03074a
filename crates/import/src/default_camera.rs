//! The default camera of scenes without one, and a lamp for a camera that sees nothing.

use bdpm_core::accel::{Intersect, Ray};
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Bounds;
use bdpm_core::scene::{Camera, FieldOfView, Scene};
use glam::Vec3;
use std::f32::consts::PI;

/// Opening angle across the image's height, degrees.
pub(super) const DEGREES: f32 = 40.0;

/// A camera that sees all of `bounds` from the front (+z) and above, just far enough for the
/// bounding sphere.
///
/// # Errors
/// If the box is too large for a camera.
pub(super) fn camera(bounds: &Bounds) -> Result<Camera> {
    // Far from the origin the distance may vanish in rounding, which the check of the camera does
    // not detect.
    let toward = Vec3::new(0.25, 0.4, 1.0).normalize();
    let radius = (0.5 * (bounds.max - bounds.min).length()).max(f32::MIN_POSITIVE);
    let distance = radius / (0.5 * DEGREES).to_radians().sin();
    let position = bounds.center() + distance * toward;
    Camera::look(position, -toward, Vec3::Y, FieldOfView::Y(DEGREES))
}

/// A point light.
pub(super) struct Lamp {
    pub position: Vec3,
    /// Intensity of all channels, W/sr.
    pub intensity: f32,
}

/// A lamp for a camera between walls, half way to the surface above it. A white surface that faces
/// the lamp at the distance whose square is `distance2` has radiance 1.
pub(super) fn lamp(scene: &Scene, accel: &dyn Intersect, distance2: f32) -> Lamp {
    let camera = &scene.camera;
    let hit = accel.closest_hit(&Ray::new(camera.position(), camera.up()));
    let position = camera.position() + 0.5 * hit.t.min(scene.size()) * camera.up();
    Lamp { position, intensity: PI * distance2.clamp(f32::MIN_POSITIVE, f32::MAX / 8.0) }
}
