//! Cameras and the size of their film.

use super::object::Object;
use super::texture::Paints;
use crate::sensor;
use crate::text::list;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::{Camera, Extent, FieldOfView, Optics};
use glam::{DAffine3, DVec3};

/// A camera and the size of its image.
#[derive(Debug)]
pub(super) struct Sensor {
    pub name: String,
    /// Looking along +z, with +y up and +x to the left.
    to_world: DAffine3,
    optics: Optics,
    /// Shift of the image to the right and up, in widths and heights of it.
    shift: [f32; 2],
    pub resolution: [u32; 2],
}

/// Size of a film and of its rendered part, pixels.
struct FilmCrop {
    size: [u32; 2],
    /// Left and upper edges of the part.
    offset: [u32; 2],
    part: [u32; 2],
}

/// The sensor of this id; without an id the first one.
pub(super) fn choose<'a>(
    all: &[Object<'a>],
    wanted: Option<&str>,
    paints: &mut Paints,
) -> Result<Option<Object<'a>>> {
    let Some(wanted) = wanted else {
        if all.len() > 1 {
            paints.chosen("used the first of several cameras:", &all[0]);
        }
        return Ok(all.first().copied());
    };
    let found = all.iter().find(|sensor| sensor.element().attribute("id") == Some(wanted));
    found.copied().map(Some).ok_or_else(|| {
        let ids: Vec<&str> = all.iter().filter_map(|s| s.element().attribute("id")).collect();
        let advice = match ids.len() {
            0 => "name no camera: no sensor has an id".to_owned(),
            _ => format!("use one of {}", list(ids)),
        };
        Error::new(format!("there is no camera `{wanted}`"), advice)
    })
}

impl Sensor {
    /// Reads a perspective camera, with or without a lens, or an orthographic one; `None` for other
    /// types.
    pub fn read(sensor: &Object, paints: &mut Paints) -> Result<Option<Self>> {
        let has_lens = match sensor.kind() {
            "perspective" | "orthographic" => false,
            "thinlens" => true,
            other => {
                let phrase = format!("used a view of the whole scene for the `{other}`");
                paints.skipped(phrase, sensor);
                return Ok(None);
            }
        };
        let name = sensor.label();
        let film = film(sensor, paints)?;
        let to_world = sensor.map("to_world")?;
        if sensor.kind() == "orthographic" {
            for plane in ["near_clip", "far_clip"] {
                let _ = sensor.float(plane)?;
            }
            // The width of the film is 2 units of the sensor's space.
            let share = f64::from(film.part[0]) / f64::from(film.size[0]);
            let across = 2.0 * to_world.matrix3.x_axis.length() * share;
            let optics = Optics::Orthographic(Extent::X(across as f32));
            let shift = [film.shift(0, 0.0), -film.shift(1, 0.0)];
            return Ok(Some(Self { name, to_world, optics, shift, resolution: film.part }));
        }
        let field_of_view = film.part_of(field_of_view(sensor, film.size)?);
        // To the right and down, in widths and heights of the film.
        let right = sensor.float("principal_point_offset_x")?.unwrap_or(0.0);
        let down = sensor.float("principal_point_offset_y")?.unwrap_or(0.0);
        let shift = [film.shift(0, right), -film.shift(1, down)];
        for plane in ["near_clip", "far_clip"] {
            let _ = sensor.float(plane)?; // everything in front of the camera is visible
        }
        let optics = if has_lens {
            let length = |key: &str| {
                let value = sensor.float(key)?.filter(|value| *value > 0.0);
                let value = value.map(|value| value as f32);
                value.ok_or_else(|| {
                    let problem = format!("`{key}` is missing or not positive");
                    sensor.error(problem, "give a positive length")
                })
            };
            let (aperture_radius, focus_distance) =
                (length("aperture_radius")?, length("focus_distance")?);
            Optics::ThinLens { field_of_view, aperture_radius, focus_distance }
        } else {
            Optics::Pinhole(field_of_view)
        };
        Ok(Some(Self { name, to_world, optics, shift, resolution: film.part }))
    }

    /// Whether its image is mirrored.
    pub fn is_mirrored(&self) -> bool {
        self.to_world.matrix3.determinant() < 0.0
    }

    /// The camera in a scene that `world` transforms.
    pub fn camera(&self, world: DAffine3, object: &Object) -> Result<Camera> {
        let map = world * self.to_world;
        let camera = sensor::camera(map, DVec3::Z, self.optics, self.shift);
        camera.map_err(|error| object.placed(&error))
    }
}

impl FilmCrop {
    /// The field of view of the part, from that of the film.
    fn part_of(&self, field_of_view: FieldOfView) -> FieldOfView {
        let angle = |degrees: f32, axis: usize| {
            if self.part[axis] == self.size[axis] {
                return degrees;
            }
            let share = f64::from(self.part[axis]) / f64::from(self.size[axis]);
            let half = (0.5 * f64::from(degrees)).to_radians().tan() * share;
            (2.0 * half.atan().to_degrees()) as f32
        };
        match field_of_view {
            FieldOfView::X(degrees) => FieldOfView::X(angle(degrees, 0)),
            FieldOfView::Y(degrees) => FieldOfView::Y(angle(degrees, 1)),
        }
    }

    /// Offset of the center of the part from that of the film, in sizes of the part. `moved` shifts
    /// the film, in sizes of the film.
    fn shift(&self, axis: usize, moved: f64) -> f32 {
        let [size, offset, part] = [self.size, self.offset, self.part].map(|n| f64::from(n[axis]));
        ((offset + 0.5 * part - 0.5 * size + moved * size) / part) as f32
    }
}

fn film(sensor: &Object, paints: &mut Paints) -> Result<FilmCrop> {
    let Some(film) = sensor.all("film")?.into_iter().next() else {
        return Ok(FilmCrop { size: [768, 576], offset: [0; 2], part: [768, 576] });
    };
    let whole = |name: &str, default: u32, least: u32| {
        let value = film.float_in(name, default.into(), [least.into(), 65_536.0])?;
        if value.fract() == 0.0 {
            return Ok(value as u32);
        }
        Err(film.error(format!("`{name}` is not a whole number"), "give one"))
    };
    let size = [whole("width", 768, 1)?, whole("height", 576, 1)?];
    let part = [whole("crop_width", size[0], 1)?, whole("crop_height", size[1], 1)?];
    let offset = [whole("crop_offset_x", 0, 0)?, whole("crop_offset_y", 0, 0)?];
    if (0..2).any(|axis| offset[axis] + part[axis] > size[axis]) {
        let problem = format!(
            "the crop of {} x {} pixels at ({}, {}) is not within the film of {} x {}",
            part[0], part[1], offset[0], offset[1], size[0], size[1]
        );
        return Err(film.error(problem, "give a smaller crop, or none"));
    }
    if let Some(filter) = film.all("rfilter")?.first()
        && filter.kind() != "box"
    {
        let phrase = format!("used the box filter instead of `{}` for", filter.kind());
        paints.chosen(phrase, sensor);
    }
    Ok(FilmCrop { size, offset, part })
}

/// The field of view across the width or the height.
fn field_of_view(sensor: &Object, [width, height]: [u32; 2]) -> Result<FieldOfView> {
    let (width, height) = (f64::from(width), f64::from(height));
    let (degrees, axis) = match sensor.float("fov")? {
        Some(degrees) => (degrees, sensor.string("fov_axis")?.unwrap_or("x")),
        None => {
            // Film of 36 mm times 24 mm.
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
