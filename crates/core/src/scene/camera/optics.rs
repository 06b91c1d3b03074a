//! The kinds of cameras, and the bounds of their numbers.

use super::{Extent, FieldOfView, FisheyeProjection};
use crate::base::error::{Error, Result};
use serde::Serialize;

/// The optics of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub enum Optics {
    /// A pinhole at the position. A pixel's value is the mean radiance along its rays.
    Pinhole(FieldOfView),
    /// An ideal lens with its center at the position, perpendicular to the direction. A pixel's
    /// value is the mean radiance over the pixel and the aperture.
    ThinLens {
        /// Field of view of the pinhole in its center.
        field_of_view: FieldOfView,
        /// Radius of the aperture, scene units.
        aperture_radius: f32,
        /// Distance of the plane that is sharp, along the direction, scene units.
        focus_distance: f32,
    },
    /// A sensor with its center at the position, facing the direction, behind real lenses in the
    /// scene. It receives light through a disc in front of it, such as the rear element of the
    /// objective. A pixel's value is its mean radiant exposure, J/m^2; at an exposure of 1 s that
    /// is its irradiance, W/m^2.
    Sensor {
        /// Width, scene units; the height follows from square pixels.
        width: f32,
        /// Distance of the disc's center along the direction, scene units.
        disc_distance: f32,
        /// Radius of the disc, scene units.
        disc_radius: f32,
        /// Exposure time, seconds.
        exposure: f32,
    },
    /// Parallel rays along the direction, from a plane through the position. A pixel's value is the
    /// mean radiance along its rays, as for all following optics.
    Orthographic(Extent),
    /// All directions in longitude and latitude: the direction is in the center, `up` at the upper
    /// edge. Pixels at the same height show the same solid angle.
    Panorama,
    /// A fisheye lens, whose image circle touches the nearer edges of the image. Pixels outside the
    /// circle are black.
    Fisheye {
        /// Projection of the lens.
        projection: FisheyeProjection,
        /// Full opening angle across the image circle, degrees; up to 360.
        field_of_view: f32,
    },
}

impl Optics {
    /// Name of the type of camera in scene files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Pinhole(_) => "pinhole",
            Self::ThinLens { .. } => "thin-lens",
            Self::Sensor { .. } => "sensor",
            Self::Orthographic(_) => "orthographic",
            Self::Panorama => "panorama",
            Self::Fisheye { .. } => "fisheye",
        }
    }

    /// Refuses impossible optics.
    pub(super) fn validate(&self) -> Result<()> {
        if let Self::Pinhole(field_of_view) | Self::ThinLens { field_of_view, .. } = self {
            let (FieldOfView::X(degrees) | FieldOfView::Y(degrees)) = *field_of_view;
            if !(degrees > 0.0 && degrees < 180.0) {
                return Err(Error::new(
                    format!("the camera's field of view is {degrees} degrees"),
                    "give an angle between 0 and 180 degrees",
                ));
            }
        }
        if let Self::Fisheye { field_of_view, .. } = *self
            && !(field_of_view > 0.0 && field_of_view <= 360.0)
        {
            return Err(Error::new(
                format!("the fisheye camera's field of view is {field_of_view} degrees"),
                "give an angle above 0, and at most 360 degrees",
            ));
        }
        let lengths: &[(&str, f32)] = match self {
            Self::Pinhole(_) | Self::Panorama | Self::Fisheye { .. } => &[],
            Self::Orthographic(Extent::X(across)) => &[("width", *across)],
            Self::Orthographic(Extent::Y(across)) => &[("height", *across)],
            Self::ThinLens { aperture_radius, focus_distance, .. } => {
                &[("aperture_radius", *aperture_radius), ("focus_distance", *focus_distance)]
            }
            Self::Sensor { width, disc_distance, disc_radius, exposure } => &[
                ("sensor_width", *width),
                ("disc_distance", *disc_distance),
                ("disc_radius", *disc_radius),
                ("exposure", *exposure),
            ],
        };
        match lengths.iter().find(|(_, value)| !(*value > 0.0 && value.is_finite())) {
            None => Ok(()),
            Some((name, value)) => Err(Error::new(
                format!("the camera's {name} is {value}"),
                format!("give {name} as a positive number"),
            )),
        }
    }
}
