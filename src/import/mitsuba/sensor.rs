//! Cameras and the size of their film.

use super::object::Object;
use super::remarks::Remarks;
use crate::base::error::{Error, Result};
use crate::import::text::list;
use crate::scene::{Camera, FieldOfView, Optics};
use glam::{DAffine3, DVec3};

/// A camera and the size of its image.
#[derive(Debug)]
pub(super) struct Sensor {
    pub name: String,
    /// Looking along +z, with +y up and +x to the left.
    to_world: DAffine3,
    optics: Optics,
    pub resolution: [u32; 2],
}

/// The sensor of this id, else the first.
pub(super) fn choose<'a>(
    all: &[Object<'a>],
    wanted: Option<&str>,
    remarks: &mut Remarks,
) -> Result<Option<Object<'a>>> {
    let Some(wanted) = wanted else {
        if all.len() > 1 {
            remarks.chosen("took the first of several cameras:", &all[0].label());
        }
        return Ok(all.first().copied());
    };
    let found = all.iter().find(|sensor| sensor.element().attribute("id") == Some(wanted));
    found.copied().map(Some).ok_or_else(|| {
        let ids: Vec<&str> = all.iter().filter_map(|s| s.element().attribute("id")).collect();
        let advice = match ids.len() {
            0 => "leave --camera out: no sensor has an id".to_owned(),
            _ => format!("choose one of {}", list(ids)),
        };
        Error::new(format!("there is no camera `{wanted}`"), advice)
    })
}

impl Sensor {
    /// Reads a perspective camera, with or without a lens.
    pub fn read(sensor: &Object, remarks: &mut Remarks) -> Result<Self> {
        let has_lens = match sensor.kind() {
            "perspective" => false,
            "thinlens" => true,
            other => {
                let problem = format!("sensors of type `{other}` are not supported");
                return Err(sensor.error(problem, "use perspective or thinlens"));
            }
        };
        let name = sensor.label();
        let resolution = film(sensor, remarks)?;
        let field_of_view = field_of_view(sensor, resolution)?;
        for offset in ["principal_point_offset_x", "principal_point_offset_y"] {
            if sensor.float(offset)?.is_some_and(|offset| offset != 0.0) {
                remarks.skipped("left out the offset of the principal point of", &name);
            }
        }
        for plane in ["near_clip", "far_clip"] {
            let _ = sensor.float(plane)?; // everything in front of the camera is seen
        }
        let optics = if has_lens {
            let length = |key: &str| {
                let value = sensor.float(key)?.filter(|value| *value > 0.0);
                let value = value.map(|value| value as f32);
                value.ok_or_else(|| {
                    sensor.error(format!("`{key}` is missing or not positive"), "give it")
                })
            };
            let (aperture_radius, focus_distance) =
                (length("aperture_radius")?, length("focus_distance")?);
            Optics::ThinLens { field_of_view, aperture_radius, focus_distance }
        } else {
            Optics::Pinhole(field_of_view)
        };
        Ok(Self { name, to_world: sensor.map("to_world")?, optics, resolution })
    }

    /// Whether its image is mirrored.
    pub fn is_mirrored(&self) -> bool {
        self.to_world.matrix3.determinant() < 0.0
    }

    /// The camera in a scene that is moved so.
    pub fn camera(&self, world: DAffine3, sensor: &Object) -> Result<Camera> {
        let map = world * self.to_world;
        let along = |axis: DVec3| map.transform_vector3(axis).normalize_or_zero().as_vec3();
        let position = map.translation.as_vec3();
        let camera = Camera::with_optics(position, along(DVec3::Z), along(DVec3::Y), self.optics);
        camera.map_err(|error| sensor.error(error.problem(), error.advice()))
    }
}

/// Pixels across and down.
fn film(sensor: &Object, remarks: &mut Remarks) -> Result<[u32; 2]> {
    let Some(film) = sensor.all("film")?.into_iter().next() else { return Ok([768, 576]) };
    let size = |name: &str, unsaid: f64| {
        let value = film.float_in(name, unsaid, [1.0, 65_536.0])?;
        if value.fract() == 0.0 {
            return Ok(value as u32);
        }
        Err(film.error(format!("`{name}` is no whole number"), "give one"))
    };
    let resolution = [size("width", 768.0)?, size("height", 576.0)?];
    let crop = ["crop_width", "crop_height", "crop_offset_x", "crop_offset_y"];
    for name in crop {
        if film.get(name)?.is_some() {
            remarks.skipped("rendered all of a film that is cropped:", &sensor.label());
        }
    }
    if let Some(filter) = film.all("rfilter")?.first()
        && filter.kind() != "box"
    {
        let phrase = format!(
            "took the box filter for `{}`: pixels are means over their squares, of",
            filter.kind()
        );
        remarks.chosen(phrase, &sensor.label());
    }
    Ok(resolution)
}

/// Across the width, or the height.
fn field_of_view(sensor: &Object, [width, height]: [u32; 2]) -> Result<FieldOfView> {
    let (width, height) = (f64::from(width), f64::from(height));
    let (degrees, axis) = match sensor.float("fov")? {
        Some(degrees) => (degrees, sensor.string("fov_axis")?.unwrap_or("x")),
        None => {
            // Of film of 36 mm times 24 mm.
            let text = sensor.string("focal_length")?.unwrap_or("50mm");
            let length = sensor.parse(text.trim().trim_end_matches("mm"))?;
            let half = 0.5 * f64::hypot(36.0, 24.0) / length;
            (2.0 * half.atan().to_degrees(), "diagonal")
        }
    };
    if !(degrees > 0.0 && degrees < 180.0) {
        let problem = format!("the field of view is {degrees} degrees");
        return Err(sensor.error(problem, "give an angle between 0 and 180 degrees"));
    }
    let is_wide = width >= height;
    Ok(match axis {
        "x" => FieldOfView::X(degrees as f32),
        "y" => FieldOfView::Y(degrees as f32),
        "smaller" if is_wide => FieldOfView::Y(degrees as f32),
        "larger" if !is_wide => FieldOfView::Y(degrees as f32),
        "smaller" | "larger" => FieldOfView::X(degrees as f32),
        "diagonal" => {
            let half = (0.5 * degrees).to_radians().tan() * width / f64::hypot(width, height);
            FieldOfView::X(2.0 * half.atan().to_degrees() as f32)
        }
        other => {
            let problem = format!("`fov_axis` is `{other}`");
            return Err(sensor.error(problem, "use x, y, diagonal, smaller or larger"));
        }
    })
}
