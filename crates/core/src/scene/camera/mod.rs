//! Cameras: rays through uniform points of a pixel (box filter) and of the aperture.
//!
//! [`Optics`] lists the kinds of cameras. Each projection has a file of its own.

mod fisheye;
mod optics;
mod orthographic;
mod panorama;
mod perspective;
mod sensor;
mod view;

pub use fisheye::FisheyeProjection;
pub use optics::Optics;
pub use orthographic::Extent;
pub use perspective::FieldOfView;
pub use view::View;

use super::transform::normalized;
use crate::base::error::{Error, Result};
use crate::settings::Settings;
use glam::Vec3;
use sensor::Disc;
use serde::Serialize;
use view::{Imaging, PixelPlane};

/// A camera: its position, orientation and optics.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Camera {
    position: Vec3,
    forward: Vec3,
    #[serde(skip)]
    right: Vec3,
    up: Vec3,
    optics: Optics,
    /// Shift of the image to the right and up, in its widths and heights.
    shift: [f32; 2],
    /// Direction and up vector as given: a copy of the camera from them has the same frame bit by
    /// bit.
    #[serde(skip)]
    aim: [Vec3; 2],
}

impl Camera {
    /// A pinhole camera at `position` that looks along `direction` (any length) with `up` toward
    /// the image's top. The frame is right-handed: looking along +z with +y up, +x is on the left.
    ///
    /// # Errors
    /// As [`Self::with_optics`].
    pub fn look(
        position: Vec3,
        direction: Vec3,
        up: Vec3,
        field_of_view: FieldOfView,
    ) -> Result<Self> {
        Self::with_optics(position, direction, up, Optics::Pinhole(field_of_view))
    }

    /// A camera with any optics.
    ///
    /// # Errors
    /// If a vector is not finite, `direction` and `up` are parallel or zero, an angle is not
    /// between 0 and 180 degrees, or a length is not positive.
    pub fn with_optics(position: Vec3, direction: Vec3, up: Vec3, optics: Optics) -> Result<Self> {
        if !(position.is_finite() && direction.is_finite() && up.is_finite()) {
            return Err(Error::new(
                "the camera has a coordinate that is not finite",
                "give finite numbers for its position, direction and up vector",
            ));
        }
        optics.validate()?;
        let aim = [direction, up];
        let forward = unit(direction);
        let right = forward.cross(unit(up)).normalize_or_zero();
        if right == Vec3::ZERO {
            return Err(Error::new(
                "the camera's direction and up vector are parallel or zero",
                "give a target other than the position and an up vector off the line of sight",
            ));
        }
        let up = right.cross(forward);
        Ok(Self { position, forward, right, up, optics, shift: [0.0; 2], aim })
    }

    /// The camera with its image shifted to the right and up in its plane, in widths and heights of
    /// the image, as shift lenses do. A shift also renders a part of an image alone.
    ///
    /// # Errors
    /// If a number is not finite, the camera is a sensor, whose lenses are in the scene, or it is a
    /// panorama.
    pub fn shifted(self, shift: [f32; 2]) -> Result<Self> {
        if !shift.iter().all(|share| share.is_finite()) {
            let problem = format!("the camera's shift is {shift:?}");
            return Err(Error::new(problem, "give two finite numbers"));
        }
        if matches!(self.optics, Optics::Sensor { .. }) && shift != [0.0; 2] {
            let advice = "move its position instead";
            return Err(Error::new("a camera of type \"sensor\" has no `shift`", advice));
        }
        if self.optics == Optics::Panorama && shift != [0.0; 2] {
            let advice = "turn its direction instead";
            return Err(Error::new("a camera of type \"panorama\" has no `shift`", advice));
        }
        Ok(Self { shift, ..self })
    }

    /// The pinhole, or the center of the lens or the sensor.
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

    /// Direction and up vector as given.
    pub fn aim(&self) -> [Vec3; 2] {
        self.aim
    }

    /// Shift of the image to the right and up, in its widths and heights.
    pub fn shift(&self) -> [f32; 2] {
        self.shift
    }

    /// The camera's optics.
    pub fn optics(&self) -> Optics {
        self.optics
    }

    /// The camera with square pixels on an image of `width` times `height` pixels.
    pub fn view(&self, width: u32, height: u32) -> View {
        let (w, h) = (width as f32, height as f32);
        let axes = [self.right, self.up];
        let PixelPlane { distance, pixel: [across, down], imaging } = match self.optics {
            Optics::Pinhole(field_of_view) => {
                let pixel = field_of_view.pixel(w, h);
                PixelPlane { distance: 1.0, pixel: [pixel; 2], imaging: Imaging::Pinhole }
            }
            Optics::ThinLens { field_of_view, aperture_radius, focus_distance } => {
                let pixel = focus_distance * field_of_view.pixel(w, h);
                let imaging = Imaging::Lens(axes.map(|axis| aperture_radius * axis));
                PixelPlane { distance: focus_distance, pixel: [pixel; 2], imaging }
            }
            Optics::Sensor { width, disc_distance, disc_radius, exposure } => {
                let disc = Disc::new(self.forward, disc_distance, axes, disc_radius, exposure);
                // A sensor is behind its lenses, which turn the image upside down.
                PixelPlane { distance: 0.0, pixel: [-width / w; 2], imaging: Imaging::Disc(disc) }
            }
            Optics::Orthographic(extent) => PixelPlane {
                distance: 0.0,
                pixel: [extent.pixel(w, h); 2],
                imaging: Imaging::Parallel(self.forward),
            },
            Optics::Panorama => PixelPlane {
                distance: 0.0,
                pixel: [w.recip(), h.recip()],
                imaging: Imaging::Panorama(axes),
            },
            Optics::Fisheye { projection, field_of_view } => {
                let edge = (0.5 * field_of_view).to_radians();
                let imaging = Imaging::Fisheye(axes, projection, edge);
                PixelPlane { distance: 0.0, pixel: [2.0 / w.min(h); 2], imaging }
            }
        };
        let (dx, dy) = (self.right * across, -self.up * down);
        let [right, up] = self.shift;
        let corner = distance * self.forward + w * (right - 0.5) * dx - h * (up + 0.5) * dy;
        View { position: self.position, corner, dx, dy, stride: 1.0, imaging }
    }

    /// The camera with the pixels of an image of these settings, which may be a window of the full
    /// image.
    pub fn view_of(&self, settings: &Settings) -> View {
        let [width, height] = settings.full_resolution();
        let view = self.view(width, height);
        match settings.crop {
            None => view,
            Some(crop) => {
                let [x, y] = crop.origin.map(|pixels| pixels as f32);
                View { corner: view.corner + x * view.dx + y * view.dy, ..view }
            }
        }
    }
}

/// The unit vector along a vector of any length; zero stays zero.
fn unit(vector: Vec3) -> Vec3 {
    let own = vector.normalize_or_zero();
    // Squares of very long and very short vectors are out of range.
    if own == Vec3::ZERO { normalized(vector) } else { own }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Direction toward a point of the image of a pinhole camera.
    pub(super) fn direction(view: &View, x: f32, y: f32) -> Vec3 {
        view.ray(x, y, [0.5; 2]).0.direction
    }

    #[test]
    fn shifted_camera_shows_the_adjacent_image() {
        let camera = Camera::look(Vec3::ZERO, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
        let (view, shifted) =
            (camera.view(40, 20), camera.shifted([0.25, -0.5]).unwrap().view(40, 20));
        for (x, y) in [(0.0, 0.0), (20.0, 10.0), (33.0, 4.0)] {
            let off = direction(&shifted, x, y) - direction(&view, x + 10.0, y + 10.0);
            assert!(off.length() < 1e-6, "{off}");
        }
        assert!(camera.shifted([f32::NAN, 0.0]).is_err());
        let (width, disc_distance, disc_radius, exposure) = (1.0, 1.0, 1.0, 1.0);
        let optics = Optics::Sensor { width, disc_distance, disc_radius, exposure };
        let sensor = Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, optics).unwrap();
        assert!(sensor.shifted([0.1, 0.0]).is_err() && sensor.shifted([0.0; 2]).is_ok());
    }

    #[test]
    fn impossible_cameras_are_refused() {
        let look = |d, up, degrees| Camera::look(Vec3::ZERO, d, up, FieldOfView::X(degrees));
        assert!(look(Vec3::Y, Vec3::Y, 40.0).is_err());
        assert!(look(Vec3::ZERO, Vec3::Y, 40.0).is_err());
        for length in [1e-30, 1e30] {
            assert_eq!(
                look(length * Vec3::Z, length * Vec3::Y, 40.0).unwrap().direction(),
                Vec3::Z
            );
            assert!(look(length * Vec3::Y, Vec3::Y, 40.0).is_err());
        }
        assert!(look(Vec3::new(f32::NAN, 0.0, 1.0), Vec3::Y, 40.0).is_err());
        for degrees in [0.0, -1.0, 180.0, f32::NAN] {
            assert!(look(Vec3::Z, Vec3::Y, degrees).is_err(), "{degrees}");
        }
        let field_of_view = FieldOfView::Y(40.0);
        let lens = |aperture_radius, focus_distance| {
            let optics = Optics::ThinLens { field_of_view, aperture_radius, focus_distance };
            Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, optics)
        };
        lens(0.1, 1.0).unwrap();
        for (radius, distance) in [(0.0, 1.0), (-0.1, 1.0), (0.1, 0.0), (f32::INFINITY, 1.0)] {
            let shown = lens(radius, distance).unwrap_err().to_string();
            assert!(shown.contains("as a positive number"), "{shown}");
        }
        let any = |optics| Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, optics);
        assert!(any(Optics::Orthographic(Extent::X(0.0))).is_err());
        assert!(any(Optics::Orthographic(Extent::Y(f32::NAN))).is_err());
        assert!(any(Optics::Panorama).unwrap().shifted([0.1, 0.0]).is_err());
        for field_of_view in [0.0, 361.0, f32::NAN] {
            let projection = FisheyeProjection::Equisolid;
            assert!(any(Optics::Fisheye { projection, field_of_view }).is_err(), "{field_of_view}");
        }
    }
}
