//! The keys of a scene file (TOML), checked one by one so that each error names its line.

pub(super) mod camera;
pub(super) mod environment;
pub(super) mod light;
pub(super) mod material;
pub(super) mod numbers;
pub(super) mod texture;

use crate::base::error::{Error, Result};
use crate::base::math::Rgb;
use crate::scene::transform::{MAX_COORDINATE, Transform};
use crate::settings::{ADVICE, FixedArray, PartialSettings, as_serde};
use camera::CameraTable;
use environment::EnvironmentTable;
use glam::{DVec3, Vec3};
use light::LightTable;
use material::MaterialTable;
use serde::{Deserialize, Deserializer, de};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use toml::Spanned;

/// A scene file as written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::import) struct SceneFile {
    pub camera: Spanned<CameraTable>,
    #[serde(default)]
    pub mesh: Vec<Spanned<MeshTable>>,
    #[serde(default)]
    pub materials: BTreeMap<String, MaterialTable>,
    #[serde(default)]
    pub light: Vec<Spanned<LightTable>>,
    pub environment: Option<Spanned<EnvironmentTable>>,
    #[serde(default)]
    pub regions: BTreeMap<String, Rectangles>,
    #[serde(default)]
    pub render: PartialSettings,
}

/// `[[mesh]]`
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::import) struct MeshTable {
    pub file: Spanned<String>,
    pub material: Option<Spanned<String>>,
    pub translate: Option<Numbers>,
    pub rotate_deg: Option<Numbers>,
    pub scale: Option<Numbers>,
    pub matrix: Option<FixedArray<FixedArray<f64, 4>, 4>>,
    /// NumPy file of matrices.
    pub places: Option<Spanned<String>>,
    #[serde(default)]
    pub flip: bool,
}

impl MeshTable {
    /// Where to put the mesh.
    pub(in crate::import) fn transform(&self) -> Result<Transform> {
        let parts = [&self.translate, &self.rotate_deg, &self.scale];
        if self.places.is_some() && (self.matrix.is_some() || parts.iter().any(|p| p.is_some())) {
            return Err(Error::new(
                "the mesh has `places` besides another transform",
                "give either the places or the others",
            ));
        }
        let transform = match self.matrix {
            Some(_) if parts.iter().any(|part| part.is_some()) => {
                return Err(Error::new(
                    "the mesh has a `matrix` besides `translate`, `rotate_deg` or `scale`",
                    "give either the matrix or the others",
                ));
            }
            Some(FixedArray(rows)) => Transform::from_rows(rows.map(|FixedArray(row)| row))?,
            None => {
                let triple = |part: &Option<Numbers>, name: &str| match part {
                    None => Ok(DVec3::ZERO),
                    Some(numbers) if !numbers.single => Ok(numbers.values),
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

/// A number, or three of them; finite.
#[derive(Clone, Copy, Debug)]
pub(in crate::import) struct Numbers {
    pub values: DVec3,
    /// Whether it was one number, which then stands three times in `values`.
    pub single: bool,
}

impl<'de> Deserialize<'de> for Numbers {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct Visitor;
        type Read<E> = std::result::Result<Numbers, E>;
        impl<'de> de::Visitor<'de> for Visitor {
            type Value = Numbers;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a number or a list of 3 numbers")
            }
            fn visit_f64<E: de::Error>(self, value: f64) -> Read<E> {
                finite(Numbers { values: DVec3::splat(value), single: true })
            }
            fn visit_i64<E: de::Error>(self, value: i64) -> Read<E> {
                self.visit_f64(value as f64)
            }
            fn visit_u64<E: de::Error>(self, value: u64) -> Read<E> {
                self.visit_f64(value as f64)
            }
            fn visit_seq<A: de::SeqAccess<'de>>(self, mut list: A) -> Read<A::Error> {
                let mut values = [0.0; 3];
                let mut count = 0;
                while let Some(value) = list.next_element::<f64>()? {
                    if count < 3 {
                        values[count] = value;
                    }
                    count += 1;
                }
                if count != 3 {
                    return Err(as_serde(Error::new(
                        format!("the list has {count} numbers"),
                        "give 3 numbers",
                    )));
                }
                finite(Numbers { values: values.into(), single: false })
            }
        }
        fn finite<E: de::Error>(numbers: Numbers) -> Read<E> {
            if numbers.values.as_vec3().is_finite() {
                return Ok(numbers);
            }
            Err(as_serde(Error::new("a number is not finite", "give numbers below 3e38")))
        }
        from.deserialize_any(Visitor)
    }
}

/// A point or direction: three coordinates of at most [`MAX_COORDINATE`].
#[derive(Clone, Copy, Debug)]
pub(in crate::import) struct Point(pub Vec3);

impl<'de> Deserialize<'de> for Point {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        let Numbers { values, single } = Numbers::deserialize(from)?;
        let error = if single {
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

/// Reflected share of light per channel.
#[derive(Clone, Copy, Debug)]
pub(in crate::import) struct Albedo(pub Rgb);

impl<'de> Deserialize<'de> for Albedo {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        let values = Numbers::deserialize(from)?.values;
        if values.min_element() >= 0.0 && values.max_element() <= 1.0 {
            return Ok(Self(values.as_vec3()));
        }
        Err(as_serde(Error::new(
            "the albedo is not between 0 and 1",
            "give the reflected share of light, such as 0.5 or [0.6, 0.1, 0.1]",
        )))
    }
}

/// Radiance or intensity per channel.
#[derive(Clone, Copy, Debug)]
pub(in crate::import) struct Power(pub Rgb);

impl<'de> Deserialize<'de> for Power {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        let values = Numbers::deserialize(from)?.values;
        if values.min_element() >= 0.0 {
            return Ok(Self(values.as_vec3()));
        }
        Err(as_serde(Error::new("light is negative", "give numbers of at least 0")))
    }
}

/// The rectangles of a region.
#[derive(Clone, Debug)]
pub(in crate::import) struct Rectangles(pub Vec<[f64; 4]>);

impl<'de> Deserialize<'de> for Rectangles {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        let rectangles = Vec::<FixedArray<f64, 4>>::deserialize(from)?;
        let rectangles: Vec<_> = rectangles.into_iter().map(|FixedArray(sides)| sides).collect();
        crate::scene::check_rectangles(&rectangles).map_err(as_serde)?;
        Ok(Self(rectangles))
    }
}

/// Reads the text of the scene file at `path`.
///
/// # Errors
/// Names the line that is not TOML, or the key that is unknown, missing or has a wrong value.
pub(in crate::import) fn parse(path: &Path, text: &str) -> Result<SceneFile> {
    toml::from_str(text).map_err(|error| {
        let problem = explain(error.message()).at(path);
        match error.span() {
            Some(span) => problem.at_offset(text, span.start),
            None => problem,
        }
    })
}

/// Says in our words what serde and the TOML parser complain about.
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
        Error::new(
            format!("the key {key} is missing"),
            "add it; docs/scene-format.md tells which keys a table needs",
        )
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
        Error::new(message.clone(), "correct the TOML; docs/scene-format.md has an example")
    }
}
