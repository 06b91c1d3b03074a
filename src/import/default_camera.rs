//! A camera for scenes that come without, and a light where it would see nothing.

use crate::accel::{Intersect, Ray};
use crate::base::error::Result;
use crate::base::math::{Bounds, Rgb};
use crate::scene::{Camera, Emitter, FieldOfView, Scene};
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

/// A point light for a camera between walls: above it, half way to what is there. With its position, and its
/// intensity of all channels, W/sr: a white surface at the distance whose square is `distance2` and that faces
/// it has radiance 1.
pub(super) fn lamp(scene: &Scene, accel: &dyn Intersect, distance2: f32) -> (Emitter, Vec3, f32) {
    let camera = &scene.camera;
    let hit = accel.closest_hit(&Ray::new(camera.position(), camera.up()));
    let position = camera.position() + 0.5 * hit.t.min(scene.size()) * camera.up();
    let intensity = PI * distance2.clamp(f32::MIN_POSITIVE, f32::MAX / 8.0);
    (Emitter::Point { position, intensity: Rgb::splat(intensity) }, position, intensity)
}
