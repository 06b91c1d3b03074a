//! A camera and a light for scenes that come without.

use crate::base::error::Result;
use crate::base::math::{Bounds, Rgb};
use crate::scene::{Camera, Emitter, FieldOfView};
use glam::Vec3;
use std::f32::consts::PI;

/// Opening angle across the image's height, degrees.
pub(super) const DEGREES: f32 = 40.0;

/// Radius of a sphere around the center that holds the box.
fn radius(bounds: &Bounds) -> f32 {
    (0.5 * (bounds.max - bounds.min).length()).max(f32::MIN_POSITIVE)
}

/// A camera that sees all of `bounds`: from the front (+z) and above, just far enough for the bounding
/// sphere.
///
/// # Errors
/// If the box is too large for a camera.
pub(super) fn camera(bounds: &Bounds) -> Result<Camera> {
    // Far from the origin the distance may vanish in rounding, and the camera's own check does not
    // see it.
    let toward = Vec3::new(0.25, 0.4, 1.0).normalize();
    let distance = radius(bounds) / (0.5 * DEGREES).to_radians().sin();
    let position = bounds.center() + distance * toward;
    Camera::look(position, -toward, Vec3::Y, FieldOfView::Y(DEGREES))
}

/// A point light above the camera at `eye`, with its intensity, W/sr, of all channels.
pub(super) fn light(bounds: &Bounds, eye: Vec3) -> (Emitter, f32) {
    let position = eye + Vec3::Y * radius(bounds);
    // Irradiance pi at the center: a white surface that faces the light has radiance 1 there.
    let intensity = PI * (position - bounds.center()).length_squared();
    (Emitter::Point { position, intensity: Rgb::splat(intensity) }, intensity)
}
