//! Parallel projection.

use serde::Serialize;

/// Size of the visible part of a scene across the image, scene units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub enum Extent {
    /// Across the image's width.
    X(f32),
    /// Across the image's height.
    Y(f32),
}

impl Extent {
    /// Side of a pixel, scene units.
    pub(super) fn pixel(self, width: f32, height: f32) -> f32 {
        match self {
            Self::X(across) => across / width,
            Self::Y(across) => across / height,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::camera::{Camera, Optics};
    use glam::Vec3;

    #[test]
    fn orthographic_rays_are_parallel_and_span_the_extent() {
        let optics = Optics::Orthographic(Extent::X(6.0));
        let camera = Camera::with_optics(Vec3::ONE, -Vec3::Z, Vec3::Y, optics).unwrap();
        let view = camera.view(30, 20);
        for (x, y, from) in [(0.0, 0.0, [-2.0, 3.0, 1.0]), (30.0, 20.0, [4.0, -1.0, 1.0])] {
            let (ray, weight) = view.ray(x, y, [0.3; 2]);
            assert!((ray.origin - Vec3::from(from)).length() < 1e-5, "{ray:?}");
            assert_eq!((ray.direction, weight), (-Vec3::Z, 1.0));
        }
        let tall = Optics::Orthographic(Extent::Y(6.0));
        let tall = Camera::with_optics(Vec3::ONE, -Vec3::Z, Vec3::Y, tall).unwrap();
        let (ray, _) = tall.view(30, 20).ray(0.0, 0.0, [0.5; 2]);
        assert!((ray.origin - Vec3::new(-3.5, 4.0, 1.0)).length() < 1e-5, "{ray:?}");
        // The adjacent image, half its width away.
        let (ray, _) = camera.shifted([0.5, 0.0]).unwrap().view(30, 20).ray(0.0, 0.0, [0.5; 2]);
        assert!((ray.origin - Vec3::new(1.0, 3.0, 1.0)).length() < 1e-5, "{ray:?}");
    }
}
