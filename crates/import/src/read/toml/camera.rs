//! `[camera]` of a scene file.

use super::keys::{Point, Position};
use crate::text::list;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::FisheyeProjection;
use bdpm_core::scene::camera::{Camera, Extent, FieldOfView, Optics};
use bdpm_core::settings::FixedArray;
use glam::{DVec3, Vec3};
use serde::Deserialize;

/// `[camera]`
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraTable {
    #[serde(default, rename = "type")]
    kind: CameraKind,
    position: Position,
    target: Option<Position>,
    direction: Option<Point>,
    up: Option<Point>,
    fov_x_deg: Option<f32>,
    fov_y_deg: Option<f32>,
    aperture_radius: Option<f32>,
    focus_distance: Option<f32>,
    sensor_width: Option<f32>,
    disc_distance: Option<f32>,
    disc_radius: Option<f32>,
    exposure: Option<f32>,
    width: Option<f32>,
    height: Option<f32>,
    projection: Option<String>,
    fov_deg: Option<f32>,
    shift: Option<FixedArray<f32, 2>>,
}

/// Kinds of cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum CameraKind {
    #[default]
    Pinhole,
    ThinLens,
    Sensor,
    Orthographic,
    Panorama,
    Fisheye,
}

impl CameraKind {
    fn name(self) -> &'static str {
        match self {
            Self::Pinhole => "pinhole",
            Self::ThinLens => "thin-lens",
            Self::Sensor => "sensor",
            Self::Orthographic => "orthographic",
            Self::Panorama => "panorama",
            Self::Fisheye => "fisheye",
        }
    }
}

impl CameraTable {
    /// The camera of a scene whose origin is at this point.
    pub fn camera(&self, origin: DVec3) -> Result<Camera> {
        let position = self.position.relative_to(origin);
        let direction = match (self.target, self.direction) {
            (Some(target), None) => self.position.vector_to(target, origin),
            (None, Some(direction)) => direction.0,
            _ => {
                let advice = "give the point it looks at as `target`, or a vector as `direction`";
                let problem = "the camera needs exactly one of `target` and `direction`";
                return Err(Error::new(problem, advice));
            }
        };
        let up = self.up.map_or(Vec3::Y, |up| up.0);
        let optics = self.optics(direction.length())?;
        let shift = self.shift.as_ref().map_or([0.0; 2], |FixedArray(shift)| *shift);
        Camera::with_optics(position, direction, up, optics)?.shifted(shift)
    }

    /// `to_target` is the distance of the target, if there is one.
    fn optics(&self, to_target: f32) -> Result<Optics> {
        use CameraKind::{Fisheye, Orthographic, Panorama, Pinhole, Sensor, ThinLens};
        let views: &[CameraKind] = &[Pinhole, ThinLens];
        for (name, is_given, kinds) in [
            ("fov_x_deg", self.fov_x_deg.is_some(), views),
            ("fov_y_deg", self.fov_y_deg.is_some(), views),
            ("aperture_radius", self.aperture_radius.is_some(), &[ThinLens][..]),
            ("focus_distance", self.focus_distance.is_some(), &[ThinLens][..]),
            ("sensor_width", self.sensor_width.is_some(), &[Sensor][..]),
            ("disc_distance", self.disc_distance.is_some(), &[Sensor][..]),
            ("disc_radius", self.disc_radius.is_some(), &[Sensor][..]),
            ("exposure", self.exposure.is_some(), &[Sensor][..]),
            ("width", self.width.is_some(), &[Orthographic][..]),
            ("height", self.height.is_some(), &[Orthographic][..]),
            ("projection", self.projection.is_some(), &[Fisheye][..]),
            ("fov_deg", self.fov_deg.is_some(), &[Fisheye][..]),
        ] {
            if is_given && !kinds.contains(&self.kind) {
                let names: Vec<_> =
                    kinds.iter().map(|kind| format!("\"{}\"", kind.name())).collect();
                return Err(Error::new(
                    format!("a camera of type \"{}\" has no `{name}`", self.kind.name()),
                    format!("leave it out, or give the camera type = {}", names.join(" or ")),
                ));
            }
        }
        Ok(match self.kind {
            Pinhole => Optics::Pinhole(self.field_of_view()?),
            ThinLens => Optics::ThinLens {
                field_of_view: self.field_of_view()?,
                aperture_radius: self.need("aperture_radius", self.aperture_radius)?,
                focus_distance: match (self.focus_distance, self.target) {
                    (Some(distance), _) => distance,
                    (None, Some(_)) => to_target,
                    (None, None) => self.need("focus_distance", None)?,
                },
            },
            Sensor => Optics::Sensor {
                width: self.need("sensor_width", self.sensor_width)?,
                disc_distance: self.need("disc_distance", self.disc_distance)?,
                disc_radius: self.need("disc_radius", self.disc_radius)?,
                exposure: self.exposure.unwrap_or(1.0),
            },
            Orthographic => Optics::Orthographic(match (self.width, self.height) {
                (Some(across), None) => Extent::X(across),
                (None, Some(across)) => Extent::Y(across),
                _ => {
                    let problem =
                        "an orthographic camera needs exactly one of `width` and `height`";
                    return Err(Error::new(problem, "give the size of the image in scene units"));
                }
            }),
            Panorama => Optics::Panorama,
            Fisheye => Optics::Fisheye {
                projection: self.projection()?,
                field_of_view: self.fov_deg.unwrap_or(180.0),
            },
        })
    }

    fn need(&self, name: &str, given: Option<f32>) -> Result<f32> {
        let problem = || format!("a camera of type \"{}\" needs `{name}`", self.kind.name());
        given.ok_or_else(|| Error::new(problem(), format!("add {name} in scene units")))
    }

    fn projection(&self) -> Result<FisheyeProjection> {
        let Some(name) = &self.projection else { return Ok(FisheyeProjection::Equidistant) };
        let found = FisheyeProjection::ALL.into_iter().find(|one| one.name() == name);
        found.ok_or_else(|| {
            let advice = format!("use one of {}", list(FisheyeProjection::ALL.map(|p| p.name())));
            Error::new(format!("there is no fisheye projection `{name}`"), advice)
        })
    }

    fn field_of_view(&self) -> Result<FieldOfView> {
        match (self.fov_x_deg, self.fov_y_deg) {
            (Some(degrees), None) => Ok(FieldOfView::X(degrees)),
            (None, Some(degrees)) => Ok(FieldOfView::Y(degrees)),
            _ => {
                let advice =
                    "give the full opening angle across the width or the height, such as 40";
                let problem = "the camera needs exactly one of `fov_x_deg` and `fov_y_deg`";
                Err(Error::new(problem, advice))
            }
        }
    }
}
