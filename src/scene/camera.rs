//! Cameras: rays through uniform points of a pixel (box filter).

use crate::accel::Ray;
use crate::error::{Error, Result};
use glam::Vec3;

/// A pinhole camera. The mean radiance along a pixel's rays is the pixel's value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    position: Vec3,
    forward: Vec3,
    right: Vec3,
    up: Vec3,
    field_of_view: FieldOfView,
}

/// Full opening angle across the image, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FieldOfView {
    /// Across the image's width.
    X(f32),
    /// Across the image's height.
    Y(f32),
}

impl Camera {
    /// A camera at `position` that looks along `direction` (any length) with `up` toward the
    /// image's top. The frame is right-handed: looking along +z with +y up, +x is on the left.
    ///
    /// # Errors
    /// If a vector is not finite, `direction` and `up` are parallel or zero, or the angle is not
    /// between 0 and 180 degrees.
    pub fn look(
        position: Vec3,
        direction: Vec3,
        up: Vec3,
        field_of_view: FieldOfView,
    ) -> Result<Self> {
        let (FieldOfView::X(degrees) | FieldOfView::Y(degrees)) = field_of_view;
        if !(position.is_finite() && direction.is_finite() && up.is_finite()) {
            return Err(Error::new(
                "the camera has a coordinate that is not finite",
                "give finite numbers for its position, direction and up vector",
            ));
        }
        if !(degrees > 0.0 && degrees < 180.0) {
            return Err(Error::new(
                format!("the camera's field of view is {degrees} degrees"),
                "give an angle between 0 and 180 degrees",
            ));
        }
        let forward = direction.normalize_or_zero();
        let right = forward.cross(up.normalize_or_zero()).normalize_or_zero();
        if right == Vec3::ZERO {
            return Err(Error::new(
                "the camera's direction and up vector are parallel or zero",
                "give a target other than the position and an up vector off the line of sight",
            ));
        }
        let up = right.cross(forward);
        Ok(Self { position, forward, right, up, field_of_view })
    }

    /// The pinhole.
    pub fn position(&self) -> Vec3 {
        self.position
    }

    /// Unit vector through the image's center.
    pub fn direction(&self) -> Vec3 {
        self.forward
    }

    /// Unit vector toward the image's top, perpendicular to [`Self::direction`].
    pub fn up(&self) -> Vec3 {
        self.up
    }

    /// The opening angle it was made with.
    pub fn field_of_view(&self) -> FieldOfView {
        self.field_of_view
    }

    /// The camera with square pixels on an image of `width` times `height` pixels.
    pub fn view(&self, width: u32, height: u32) -> View {
        let (w, h) = (width as f32, height as f32);
        let pixel = match self.field_of_view {
            FieldOfView::X(degrees) => 2.0 * (0.5 * degrees).to_radians().tan() / w,
            FieldOfView::Y(degrees) => 2.0 * (0.5 * degrees).to_radians().tan() / h,
        };
        let dx = self.right * pixel;
        let dy = -self.up * pixel;
        View { position: self.position, corner: self.forward - 0.5 * (w * dx + h * dy), dx, dy }
    }
}

/// A camera bound to a resolution.
#[derive(Clone, Copy, Debug)]
pub struct View {
    position: Vec3,
    /// From the pinhole to the top left corner of the image plane at distance 1.
    corner: Vec3,
    /// One pixel to the right.
    dx: Vec3,
    /// One pixel down.
    dy: Vec3,
}

impl View {
    /// The ray of unit direction through `(x, y)`, in pixels from the image's top left corner.
    #[inline]
    pub fn ray(&self, x: f32, y: f32) -> Ray {
        Ray::new(self.position, (self.corner + x * self.dx + y * self.dy).normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_point_lands_where_the_pinhole_says() {
        // The paper's camera: +x on the left; tan(39.3077 deg / 2) = 0.025 / 0.07.
        let fov = FieldOfView::X(39.3077);
        let camera = Camera::look(Vec3::new(278.0, 273.0, -800.0), Vec3::Z, Vec3::Y, fov).unwrap();
        let view = camera.view(100, 50);
        let center = view.ray(50.0, 25.0);
        assert!((center.direction - Vec3::Z).length() < 1e-6);
        let left = view.ray(0.0, 25.0).direction;
        assert!((left.x / left.z - 0.025 / 0.07).abs() < 1e-5, "{left}");
        let top = view.ray(50.0, 0.0).direction;
        assert!((top.y / top.z - 0.5 * 0.025 / 0.07).abs() < 1e-5, "{top}");
    }

    #[test]
    fn the_vertical_angle_spans_the_height() {
        let camera = Camera::look(Vec3::ZERO, -Vec3::Z, Vec3::Y, FieldOfView::Y(90.0)).unwrap();
        let top = camera.view(30, 20).ray(15.0, 0.0).direction;
        assert!((top.y / -top.z - 1.0).abs() < 1e-5, "{top}");
        let right = camera.view(30, 20).ray(30.0, 10.0).direction;
        assert!((right.x / -right.z - 1.5).abs() < 1e-5, "{right}");
    }

    #[test]
    fn impossible_cameras_are_refused() {
        let look = |d, up, degrees| Camera::look(Vec3::ZERO, d, up, FieldOfView::X(degrees));
        assert!(look(Vec3::Y, Vec3::Y, 40.0).is_err());
        assert!(look(Vec3::ZERO, Vec3::Y, 40.0).is_err());
        assert!(look(Vec3::new(f32::NAN, 0.0, 1.0), Vec3::Y, 40.0).is_err());
        for degrees in [0.0, -1.0, 180.0, f32::NAN] {
            assert!(look(Vec3::Z, Vec3::Y, degrees).is_err(), "{degrees}");
        }
    }
}
