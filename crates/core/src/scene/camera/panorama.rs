//! All directions in longitude and latitude.

use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Unit direction of the point `at` of a panorama in longitude and latitude, in its widths to the
/// right and in its heights up from its center. In the result, +x is right, +y up and +z toward the
/// center.
pub(super) fn panorama_direction(at: Vec2) -> Vec3 {
    let (sin, cos) = (TAU * at.x).sin_cos();
    let (up, across) = (PI * at.y).clamp(-FRAC_PI_2, FRAC_PI_2).sin_cos();
    Vec3::new(across * sin, up, across * cos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panorama_covers_all_longitudes_and_latitudes() {
        for (at, expected) in [
            (Vec2::ZERO, Vec3::Z),
            (Vec2::new(0.25, 0.0), Vec3::X),
            (Vec2::new(-0.25, 0.0), -Vec3::X),
            (Vec2::new(0.5, 0.0), -Vec3::Z),
            (Vec2::new(0.1, 0.5), Vec3::Y),
            (Vec2::new(0.7, -0.5), -Vec3::Y),
        ] {
            let direction = panorama_direction(at);
            assert!((direction - expected).length() < 1e-6, "{at}: {direction}");
        }
    }
}
