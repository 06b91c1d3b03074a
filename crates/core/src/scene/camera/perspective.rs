//! Pinholes and thin lenses.

use crate::accel::Ray;
use crate::base::math::uniform_disc;
use glam::Vec3;
use serde::Serialize;

/// Full opening angle across the image, degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub enum FieldOfView {
    /// Across the image's width.
    X(f32),
    /// Across the image's height.
    Y(f32),
}

impl FieldOfView {
    /// Side of a pixel at distance 1.
    pub(super) fn pixel(self, width: f32, height: f32) -> f32 {
        let across = |degrees: f32| 2.0 * (0.5 * degrees).to_radians().tan();
        match self {
            Self::X(degrees) => across(degrees) / width,
            Self::Y(degrees) => across(degrees) / height,
        }
    }
}

/// The ray through the point `to_pixel` of the plane in focus, seen from the lens's center at
/// `position`, and the point of the lens that `sample` selects. The lens has the radii `right` and
/// `up`. theory.md (5).
pub(super) fn lens_ray(
    position: Vec3,
    to_pixel: Vec3,
    [right, up]: [Vec3; 2],
    sample: [f32; 2],
) -> Ray {
    let [u, v] = uniform_disc(sample);
    let through = u * right + v * up;
    Ray::new(position + through, (to_pixel - through).normalize())
}

#[cfg(test)]
mod tests {
    use super::super::tests::direction;
    use super::*;
    use crate::scene::camera::{Camera, Optics};

    #[test]
    fn pinhole_projects_a_known_point_to_its_pixel() {
        // The paper's camera: +x on the left; tan(39.3077 deg / 2) = 0.025 / 0.07.
        let fov = FieldOfView::X(39.3077);
        let camera = Camera::look(Vec3::new(278.0, 273.0, -800.0), Vec3::Z, Vec3::Y, fov).unwrap();
        let view = camera.view(100, 50);
        assert!((direction(&view, 50.0, 25.0) - Vec3::Z).length() < 1e-6);
        let left = direction(&view, 0.0, 25.0);
        assert!((left.x / left.z - 0.025 / 0.07).abs() < 1e-5, "{left}");
        let top = direction(&view, 50.0, 0.0);
        assert!((top.y / top.z - 0.5 * 0.025 / 0.07).abs() < 1e-5, "{top}");
    }

    #[test]
    fn vertical_field_of_view_spans_the_height() {
        let camera = Camera::look(Vec3::ZERO, -Vec3::Z, Vec3::Y, FieldOfView::Y(90.0)).unwrap();
        let top = direction(&camera.view(30, 20), 15.0, 0.0);
        assert!((top.y / -top.z - 1.0).abs() < 1e-5, "{top}");
        let right = direction(&camera.view(30, 20), 30.0, 10.0);
        assert!((right.x / -right.z - 1.5).abs() < 1e-5, "{right}");
    }

    /// Points all over the unit square, the lens's edge among them.
    fn lens_points() -> impl Iterator<Item = [f32; 2]> {
        let steps = || (0..16).map(|i| i as f32 / 15.0 * 0.999_999);
        steps().flat_map(move |u| steps().map(move |v| [u, v]))
    }

    /// The point where a ray crosses the plane at `z`.
    fn at(ray: &Ray, z: f32) -> Vec3 {
        ray.origin + (z - ray.origin.z) / ray.direction.z * ray.direction
    }

    #[test]
    fn thin_lens_is_sharp_at_its_focus_and_blurs_by_the_circle_of_confusion() {
        let (aperture_radius, focus_distance) = (0.25, 4.0);
        let field_of_view = FieldOfView::X(40.0);
        let thin = Optics::ThinLens { field_of_view, aperture_radius, focus_distance };
        let camera = Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, thin).unwrap();
        let pinhole = Camera::look(Vec3::ZERO, Vec3::Z, Vec3::Y, field_of_view).unwrap();
        let (view, pinhole) = (camera.view(40, 30), pinhole.view(40, 30));
        assert!(!view.is_pinhole() && pinhole.is_pinhole());
        for (x, y) in [(20.0, 15.0), (0.0, 0.0), (33.0, 8.0)] {
            let (center, _) = pinhole.ray(x, y, [0.0; 2]);
            for (z, radius) in [(4.0, 0.0), (8.0, 0.25), (2.0, 0.125), (12.0, 0.5)] {
                // By similar triangles: aperture radius times |z - focus| / focus.
                let mut widest: f32 = 0.0;
                for lens in lens_points() {
                    let (ray, weight) = view.ray(x, y, lens);
                    assert_eq!(weight, 1.0);
                    assert!((ray.direction.length() - 1.0).abs() < 1e-6);
                    widest = widest.max((at(&ray, z) - at(&center, z)).length());
                }
                assert!((widest - radius).abs() < 1e-4, "{x} {y} {z}: {widest}");
            }
        }
    }
}
