//! The keys of a scene file (TOML), each checked on its own so that errors name their line.

use super::camera::CameraTable;
use super::environment::EnvironmentTable;
use super::light::LightTable;
use super::material::MaterialTable;
use super::medium::MediumTable;
use super::mesh::MeshTable;
use super::meter::MeterTable;
use super::parse::parse_table;
use super::sky::SkyTable;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::transform::{MAX_COORDINATE, vector_between};
use bdpm_core::scene::{Camera, MAX_METERS, MeterSet};
use bdpm_core::settings::{FixedArray, PartialSettings, as_serde};
use glam::{DVec3, Vec3};
use serde::{Deserialize, Deserializer, de};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use toml::Spanned;

/// A scene file as written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Distance off surfaces at which rays start, scene units.
    pub ray_offset: Option<Spanned<f64>>,
    pub camera: Spanned<CameraTable>,
    #[serde(default)]
    pub mesh: Vec<Spanned<MeshTable>>,
    #[serde(default)]
    pub materials: BTreeMap<String, MaterialTable>,
    #[serde(default)]
    pub media: BTreeMap<String, Spanned<MediumTable>>,
    /// Name of the medium between all objects.
    pub medium: Option<Spanned<String>>,
    #[serde(default)]
    pub light: Vec<Spanned<LightTable>>,
    pub environment: Option<Spanned<EnvironmentTable>>,
    pub sky: Option<Spanned<SkyTable>>,
    #[serde(default)]
    pub regions: BTreeMap<String, Rectangles>,
    #[serde(default)]
    pub meter: Vec<Spanned<MeterTable>>,
    #[serde(default)]
    pub render: PartialSettings,
}

/// A number, or a list of three; finite.
#[derive(Clone, Copy, Debug)]
pub struct Triple {
    pub values: DVec3,
    /// Whether it was one number, which is then repeated three times in `values`.
    pub is_single: bool,
}

impl<'de> Deserialize<'de> for Triple {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct Visitor;
        type Read<E> = std::result::Result<Triple, E>;
        impl<'de> de::Visitor<'de> for Visitor {
            type Value = Triple;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a number or a list of 3 numbers")
            }
            fn visit_f64<E: de::Error>(self, value: f64) -> Read<E> {
                finite(Triple { values: DVec3::splat(value), is_single: true })
            }
            fn visit_i64<E: de::Error>(self, value: i64) -> Read<E> {
                self.visit_f64(value as f64)
            }
            fn visit_u64<E: de::Error>(self, value: u64) -> Read<E> {
                self.visit_f64(value as f64)
            }
            fn visit_seq<A: de::SeqAccess<'de>>(self, mut list: A) -> Read<A::Error> {
                let mut values = Vec::new();
                while let Some(value) = list.next_element::<f64>()? {
                    values.push(value);
                }
                let Ok(values) = <[f64; 3]>::try_from(&values[..]) else {
                    let problem = format!("the list has {} numbers", values.len());
                    return Err(as_serde(Error::new(problem, "give 3 numbers")));
                };
                finite(Triple { values: values.into(), is_single: false })
            }
        }
        fn finite<E: de::Error>(triple: Triple) -> Read<E> {
            if triple.values.as_vec3().is_finite() {
                return Ok(triple);
            }
            Err(as_serde(Error::new("a number is not finite", "give numbers below 3e38")))
        }
        from.deserialize_any(Visitor)
    }
}

/// A direction, or an edge: three coordinates of at most [`MAX_COORDINATE`].
#[derive(Clone, Copy, Debug)]
pub struct Point(pub Vec3);

impl<'de> Deserialize<'de> for Point {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        checked_point(from).map(|values| Self(values.as_vec3()))
    }
}

/// A position in the coordinates of the file, in double precision: three coordinates of at most
/// [`MAX_COORDINATE`].
#[derive(Clone, Copy, Debug)]
pub struct Position(DVec3);

impl Position {
    /// The position in a scene whose origin is at this point of the file.
    pub fn relative_to(self, origin: DVec3) -> Vec3 {
        (self.0 - origin).as_vec3()
    }

    /// The vector from this position to another one, in a scene whose origin is at this point of
    /// the file.
    pub fn vector_to(self, other: Self, origin: DVec3) -> Vec3 {
        vector_between(self.0 - origin, other.0 - origin)
    }
}

impl<'de> Deserialize<'de> for Position {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        checked_point(from).map(Self)
    }
}

/// Three coordinates of at most [`MAX_COORDINATE`].
fn checked_point<'de, D: Deserializer<'de>>(from: D) -> std::result::Result<DVec3, D::Error> {
    let Triple { values, is_single } = Triple::deserialize(from)?;
    let error = if is_single {
        Error::new("a single number stands for a point", "give 3 numbers, such as [0, 1, 0]")
    } else if values.abs().max_element() > f64::from(MAX_COORDINATE) {
        let problem = format!("a coordinate is beyond {MAX_COORDINATE:e}");
        Error::new(problem, "scale the scene down")
    } else {
        return Ok(values);
    };
    Err(as_serde(error))
}

/// The rectangles of a region.
#[derive(Clone, Debug)]
pub struct Rectangles(pub Vec<[f64; 4]>);

impl<'de> Deserialize<'de> for Rectangles {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        let rectangles = Vec::<FixedArray<f64, 4>>::deserialize(from)?;
        let rectangles: Vec<_> = rectangles.into_iter().map(|FixedArray(sides)| sides).collect();
        bdpm_core::scene::check_rectangles(&rectangles).map_err(as_serde)?;
        Ok(Self(rectangles))
    }
}

/// Reads the text of the scene file at `path`.
///
/// # Errors
/// Names the line that is not TOML, or the key that is unknown, missing or has a wrong value.
pub fn parse(path: &Path, text: &str) -> Result<SceneFile> {
    parse_table(path, text)
}

/// The parts of a scene file that [`camera_alone`] reads.
#[derive(Deserialize)]
struct CameraFile {
    camera: Spanned<CameraTable>,
    #[serde(default)]
    render: PartialSettings,
}

/// Reads only the camera of a scene file, for a scene whose origin is at this point, and the
/// resolution of its image.
///
/// # Errors
/// If there is no `[camera]`, or it is not valid.
pub fn camera_alone(path: &Path, text: &str, origin: DVec3) -> Result<(Camera, Option<[u32; 2]>)> {
    let CameraFile { camera, render } = parse_table(path, text)?;
    let start = camera.span().start;
    let camera = camera.get_ref().camera(origin).map_err(|e| e.at(path).at_offset(text, start))?;
    Ok((camera, render.resolution))
}

/// A file that has only `[[meter]]` tables.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MeterFile {
    meter: Vec<Spanned<MeterTable>>,
}

/// Reads a file of `[[meter]]` tables, for a scene whose origin is at this point.
///
/// # Errors
/// Names the line of a table that is not valid.
pub fn meters_alone(path: &Path, text: &str, origin: DVec3) -> Result<Vec<MeterSet>> {
    meter_sets(path, text, &parse_table::<MeterFile>(path, text)?.meter, origin)
}

/// The meters of the tables of a file, for a scene whose origin is at this point.
pub fn meter_sets(
    path: &Path,
    text: &str,
    tables: &[Spanned<MeterTable>],
    origin: DVec3,
) -> Result<Vec<MeterSet>> {
    let mut left = MAX_METERS;
    let set = |(number, table): (usize, &Spanned<MeterTable>)| {
        let place = |error: Error| error.at(path).at_offset(text, table.span().start);
        let own = table.get_ref().set(number, origin).map_err(place)?;
        left = left.checked_sub(own.meters.len() as u64).ok_or_else(|| {
            let problem = format!("the tables up to here have over {MAX_METERS} meters");
            place(Error::new(problem, "give fewer columns and rows"))
        })?;
        Ok(own)
    };
    (1..).zip(tables).map(set).collect()
}

/// Reads settings from the keys of a `[render]` table, one per line of `text`. Errors name `origin`
/// as their file.
///
/// # Errors
/// Names the key that is unknown or has a wrong value.
pub fn render_settings(origin: &Path, text: &str) -> Result<PartialSettings> {
    parse_table(origin, text)
}
