//! The keys of a scene file (TOML), each checked on its own so that errors name their line.

pub(super) mod camera;
pub(super) mod environment;
pub(super) mod light;
pub(super) mod luminaire;
pub(super) mod material;
pub(super) mod medium;
pub(super) mod meter;
pub(super) mod numbers;
mod refractive_index;
pub(super) mod sky;
pub(super) mod texture;

use super::load::extension;
use super::text::RELATIVE_NAME;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::transform::{MAX_COORDINATE, Transform};
use bdpm_core::scene::{Camera, MAX_METERS, MeterSet};
use bdpm_core::settings::{ADVICE, FixedArray, PartialSettings, as_serde};
use camera::CameraTable;
use environment::EnvironmentTable;
use glam::{DVec3, Vec3};
use light::LightTable;
use material::MaterialTable;
use medium::MediumTable;
use meter::MeterTable;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, de};
use sky::SkyTable;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use toml::Spanned;

/// A scene file as written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SceneFile {
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

/// `[[mesh]]`
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MeshTable {
    pub file: Spanned<String>,
    pub material: Option<Spanned<String>>,
    pub translate: Option<Triple>,
    pub rotate_deg: Option<Triple>,
    pub scale: Option<Triple>,
    pub matrix: Option<FixedArray<FixedArray<f64, 4>, 4>>,
    /// NumPy file of transforms.
    pub places: Option<Spanned<String>>,
    #[serde(default)]
    pub flip: bool,
}

/// Formats of mesh files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MeshFileKind {
    Obj,
    Ply,
}

impl MeshTable {
    /// The format of the file, which must exist in the folder of the scene file and have materials.
    pub(crate) fn kind(&self, folder: &Path) -> Result<MeshFileKind> {
        let name = self.file.get_ref();
        let path = folder.join(name);
        let kind = match &extension(&path)[..] {
            "obj" => MeshFileKind::Obj,
            "ply" if self.material.is_some() => MeshFileKind::Ply,
            "ply" => {
                let problem =
                    format!("the mesh `{name}` has no material: PLY files contain no materials");
                return Err(Error::new(problem, "add a line such as `material = \"chalk\"`"));
            }
            _ => {
                let problem = format!("`{name}` is neither an OBJ nor a PLY file");
                return Err(Error::new(problem, "give a file ending in .obj or .ply"));
            }
        };
        std::fs::metadata(&path).map_err(|error| {
            let problem = format!("cannot read the mesh file `{name}`: {error}");
            Error::new(problem, RELATIVE_NAME)
        })?;
        Ok(kind)
    }

    /// The transform from the coordinates of the mesh to those of the scene.
    pub(crate) fn transform(&self) -> Result<Transform> {
        let has_parts =
            [&self.translate, &self.rotate_deg, &self.scale].iter().any(|part| part.is_some());
        if self.places.is_some() && (self.matrix.is_some() || has_parts) {
            let problem = "the mesh has `places` besides another transform";
            return Err(Error::new(problem, "give either the places or the others"));
        }
        let transform = match self.matrix {
            Some(_) if has_parts => {
                let problem =
                    "the mesh has a `matrix` besides `translate`, `rotate_deg` or `scale`";
                return Err(Error::new(problem, "give either the matrix or the others"));
            }
            Some(FixedArray(rows)) => Transform::from_rows(rows.map(|FixedArray(row)| row))?,
            None => {
                let triple = |part: &Option<Triple>, name: &str| match part {
                    None => Ok(DVec3::ZERO),
                    Some(numbers) if !numbers.is_single => Ok(numbers.values),
                    Some(_) => Err(Error::new(
                        format!("`{name}` is a single number"),
                        format!("give three, such as `{name} = [0, 90, 0]`"),
                    )),
                };
                let scale = self.scale.as_ref().map_or(DVec3::ONE, |scale| scale.values);
                let translate = triple(&self.translate, "translate")?;
                Transform::from_parts(translate, triple(&self.rotate_deg, "rotate_deg")?, scale)?
            }
        };
        Ok(transform.flipped(self.flip))
    }
}

/// A number, or a list of three; finite.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Triple {
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

/// A point or direction: three coordinates of at most [`MAX_COORDINATE`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point(pub Vec3);

impl<'de> Deserialize<'de> for Point {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        let Triple { values, is_single } = Triple::deserialize(from)?;
        let error = if is_single {
            Error::new("a single number stands for a point", "give 3 numbers, such as [0, 1, 0]")
        } else if values.abs().max_element() > f64::from(MAX_COORDINATE) {
            let problem = format!("a coordinate is beyond {MAX_COORDINATE:e}");
            Error::new(problem, "scale the scene down")
        } else {
            return Ok(Self(values.as_vec3()));
        };
        Err(as_serde(error))
    }
}

/// The rectangles of a region.
#[derive(Clone, Debug)]
pub(crate) struct Rectangles(pub Vec<[f64; 4]>);

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
pub(crate) fn parse(path: &Path, text: &str) -> Result<SceneFile> {
    parse_table(path, text)
}

/// The parts of a scene file that [`camera_alone`] reads.
#[derive(Deserialize)]
struct CameraFile {
    camera: Spanned<CameraTable>,
    #[serde(default)]
    render: PartialSettings,
}

/// Reads only the camera of a scene file, and the resolution of its image.
///
/// # Errors
/// If there is no `[camera]`, or it is not valid.
pub(crate) fn camera_alone(path: &Path, text: &str) -> Result<(Camera, Option<[u32; 2]>)> {
    let CameraFile { camera, render } = parse_table(path, text)?;
    let start = camera.span().start;
    let camera = camera.get_ref().camera().map_err(|e| e.at(path).at_offset(text, start))?;
    Ok((camera, render.resolution))
}

/// A file that has only `[[meter]]` tables.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MeterFile {
    meter: Vec<Spanned<MeterTable>>,
}

/// Reads a file of `[[meter]]` tables.
///
/// # Errors
/// Names the line of a table that is not valid.
pub(crate) fn meters_alone(path: &Path, text: &str) -> Result<Vec<MeterSet>> {
    meter_sets(path, text, &parse_table::<MeterFile>(path, text)?.meter)
}

/// The meters of the tables of a file.
pub(crate) fn meter_sets(
    path: &Path,
    text: &str,
    tables: &[Spanned<MeterTable>],
) -> Result<Vec<MeterSet>> {
    let mut left = MAX_METERS;
    let set = |(number, table): (usize, &Spanned<MeterTable>)| {
        let place = |error: Error| error.at(path).at_offset(text, table.span().start);
        let own = table.get_ref().set(number).map_err(place)?;
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

fn parse_table<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T> {
    toml::from_str(text).map_err(|error| {
        let problem = explain(error.message()).at(path);
        match error.span() {
            Some(span) => problem.at_offset(text, span.start),
            None => problem,
        }
    })
}

/// Rewords the errors of serde and of the TOML parser.
fn explain(message: &str) -> Error {
    if let Some((problem, advice)) = message.split_once(ADVICE) {
        return Error::new(problem, advice);
    }
    let message = message.replace('\n', ", ");
    let (what, expected) = match message.split_once(", expected ") {
        Some((what, expected)) => (what, Some(expected)),
        None => (message.as_str(), None),
    };
    let choices = |expected: Option<&str>| match expected {
        Some(one) => format!("use {one}"),
        None => "remove it".to_owned(),
    };
    if let Some(key) = what.strip_prefix("unknown field ") {
        Error::new(format!("unknown key {key}"), choices(expected))
    } else if let Some(value) = what.strip_prefix("unknown variant ") {
        Error::new(format!("unknown value {value}"), choices(expected))
    } else if let Some(key) = what.strip_prefix("missing field ") {
        let advice = "add it; docs/reference/scene-format.md lists the keys that a table needs";
        Error::new(format!("the key {key} is missing"), advice)
    } else if let (Some(found), Some(expected)) = (what.strip_prefix("invalid type: "), expected) {
        let expected = match expected {
            "u32" | "u64" => "a whole number without a decimal point",
            "f32" | "f64" => "a number",
            other => other,
        };
        Error::new(format!("wrong type: {found}"), format!("give {expected}"))
    } else if let (Some(found), Some(expected)) = (what.strip_prefix("invalid value: "), expected) {
        Error::new(format!("wrong value: {found}"), format!("give {expected}"))
    } else {
        Error::new(
            message.clone(),
            "correct the TOML; docs/reference/scene-format.md has an example",
        )
    }
}
