//! Changes of a scene's camera that the user requests.

use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::transform::vector_between;
use bdpm_core::scene::{Camera, FieldOfView, Optics};
use bdpm_import::camera_of;
use glam::{DVec3, Vec3};
use std::path::Path;
use std::str::FromStr;

/// Changes of the camera, made in the order of the fields.
#[derive(Clone, Copy, Debug, Default)]
pub struct CameraChange<'a> {
    /// Scene whose camera replaces the scene's own. Of a scene file in TOML, only `[camera]` and
    /// `[render]` are read.
    pub from: Option<&'a Path>,
    /// Position and target.
    pub look_at: Option<LookAt>,
    /// Full opening angle, degrees, across the side of the image to which the camera's own angle
    /// refers.
    pub fov: Option<f32>,
}

/// A position and the point to look at, in the coordinates of the scene's file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LookAt {
    position: DVec3,
    target: DVec3,
    /// If not given, the axis nearest to the camera's own up vector.
    up: Option<Vec3>,
}

impl LookAt {
    /// A camera at `position` that looks at `target`, with this up vector or the axis nearest to
    /// its own.
    pub fn new(position: DVec3, target: DVec3, up: Option<Vec3>) -> Self {
        Self { position, target, up }
    }
}

impl FromStr for LookAt {
    type Err = Error;

    /// Parses six or nine numbers separated by commas: position, target and up vector.
    fn from_str(text: &str) -> Result<Self> {
        let numbers: Option<Vec<f64>> = text
            .split(',')
            .map(|word| {
                word.trim().parse().ok().filter(|number: &f64| (*number as f32).is_finite())
            })
            .collect();
        let numbers = numbers.unwrap_or_default();
        let vector = |first: usize| numbers.get(first..first + 3).map(DVec3::from_slice);
        match (vector(0), vector(3), vector(6), numbers.len()) {
            (Some(position), Some(target), up, 6 | 9) => {
                Ok(Self { position, target, up: up.map(|up| up.as_vec3()) })
            }
            _ => Err(Error::new(
                format!("`{text}` is neither six nor nine numbers"),
                "give position and target, such as 0,1,5,0,1,0, and optionally an up vector",
            )),
        }
    }
}

impl CameraChange<'_> {
    /// Returns true if the position of the scene's own camera has no effect.
    pub(super) fn replaces_position(&self) -> bool {
        self.from.is_some() || self.look_at.is_some()
    }

    /// The changed camera of a scene whose origin is at this point of its file, and the resolution
    /// of the scene that the camera is from.
    ///
    /// # Errors
    /// If that scene cannot be read, or the camera cannot be changed in this way.
    pub(super) fn apply(
        &self,
        camera: Camera,
        origin: DVec3,
    ) -> Result<(Camera, Option<[u32; 2]>)> {
        let (mut camera, resolution) = match self.from {
            Some(path) => camera_of(path, origin)?,
            None => (camera, None),
        };
        if let Some(look_at) = self.look_at {
            camera = look_at.apply(&camera, origin)?;
        }
        if let Some(degrees) = self.fov {
            let [direction, up] = camera.aim();
            let optics = with_field_of_view(camera.optics(), degrees)?;
            camera = Camera::with_optics(camera.position(), direction, up, optics)?
                .shifted(camera.shift())?;
        }
        Ok((camera, resolution))
    }
}

impl LookAt {
    fn apply(&self, camera: &Camera, origin: DVec3) -> Result<Camera> {
        let [position, target] = [self.position, self.target].map(|point| point - origin);
        let direction = vector_between(position, target);
        let up = self.up.unwrap_or_else(|| upright_axis(camera, direction));
        let mut optics = camera.optics();
        if let Optics::ThinLens { focus_distance, .. } = &mut optics {
            *focus_distance = direction.length();
        }
        Camera::with_optics(position.as_vec3(), direction, up, optics)?.shifted(camera.shift())
    }
}

/// The axis nearest to the camera's own up vector. If `direction` is along that axis, the axis
/// nearest to the camera's own direction, so that a view straight down has it above.
fn upright_axis(camera: &Camera, direction: Vec3) -> Vec3 {
    let axis = nearest_axis(camera.up());
    let is_along = direction.cross(axis).length() <= 1e-3 * direction.length();
    if is_along { nearest_axis(camera.direction().reject_from(axis)) } else { axis }
}

/// The unit vector along an axis, in either direction, nearest to `vector`.
fn nearest_axis(vector: Vec3) -> Vec3 {
    let axis = Vec3::AXES[vector.abs().max_position()];
    axis.copysign(vector) * axis
}

fn with_field_of_view(optics: Optics, degrees: f32) -> Result<Optics> {
    let changed = |field_of_view| match field_of_view {
        FieldOfView::X(_) => FieldOfView::X(degrees),
        FieldOfView::Y(_) => FieldOfView::Y(degrees),
    };
    Ok(match optics {
        Optics::Pinhole(own) => Optics::Pinhole(changed(own)),
        Optics::ThinLens { field_of_view, aperture_radius, focus_distance } => Optics::ThinLens {
            field_of_view: changed(field_of_view),
            aperture_radius,
            focus_distance,
        },
        Optics::Fisheye { projection, .. } => {
            Optics::Fisheye { projection, field_of_view: degrees }
        }
        Optics::Sensor { .. } | Optics::Orthographic(_) | Optics::Panorama => {
            let problem =
                "the camera has no field of view: it is a sensor, orthographic or a panorama";
            return Err(Error::new(problem, "give no field of view, or use another camera"));
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn look_at_parses_positions_and_keeps_the_nearest_upright_axis() {
        let look: LookAt = "0, 1,5, 0,1,0".parse().unwrap();
        let tilted = Vec3::new(0.1, 0.8, 0.5);
        let own = Camera::look(Vec3::ZERO, Vec3::X, tilted, FieldOfView::Y(30.0)).unwrap();
        let camera = look.apply(&own, DVec3::ZERO).unwrap();
        assert_eq!((camera.position(), camera.direction()), (Vec3::new(0.0, 1.0, 5.0), -Vec3::Z));
        assert_eq!((camera.up(), camera.optics()), (Vec3::Y, own.optics()));
        let with_up: LookAt = "0,1,5,0,1,0,1,0,0".parse().unwrap();
        assert_eq!(with_up.apply(&own, DVec3::ZERO).unwrap().up(), Vec3::X);
        for bad in ["", "1,2,3", "1,2,3,4,5,6,7", "1,2,3,4,5,x", "1,2,3,4,5,nan"] {
            assert!(bad.parse::<LookAt>().is_err(), "{bad}");
        }
        assert_eq!(nearest_axis(Vec3::new(0.1, -0.9, 0.3)), -Vec3::Y);
        let down: LookAt = "0,9,0,0,0,0".parse().unwrap();
        assert_eq!(down.apply(&own, DVec3::ZERO).unwrap().up(), Vec3::X);
    }
}
