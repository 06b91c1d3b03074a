//! Everything besides the scene that determines an image, validated.

pub mod origin;

use crate::base::error::{Error, Result};
use serde::{Deserialize, Deserializer, Serialize, de};
use std::fmt;
use std::str::FromStr;

/// How light that comes straight from a light source is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Direct {
    /// By a shadow ray from each diffuse vertex of the camera path.
    #[default]
    Connect,
    /// From the photon map, like all other light.
    PhotonMap,
}

/// How paths end where they scatter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Roulette {
    /// Analog: survive with probability albedo, so that the weight stays (nearly) constant.
    #[default]
    Albedo,
    /// Carry the albedo as weight. Camera paths end at their cut anyway; light paths survive with
    /// probability 0.995 until their weight falls below 1/16 of its start, then in proportion to it.
    Weight,
}

/// What determines an image, given its scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Light paths emitted per iteration, `N_F`.
    pub light_paths: u32,
    /// Camera paths per pixel and iteration, `N_B`.
    pub camera_paths: u32,
    /// Merge radius, scene units.
    pub radius: f32,
    /// The camera path is cut at its k-th diffuse vertex.
    pub merge_vertex: u32,
    /// How direct light is found.
    pub direct: Direct,
    /// How light paths end.
    pub light_roulette: Roulette,
    /// Whether camera paths may end before their cut.
    pub camera_roulette: Roulette,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// Largest number of light paths: path ids take 31 bits.
pub const MAX_LIGHT_PATHS: u32 = 1 << 31;

impl Settings {
    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Whether noise coefficients can be measured: that takes two paths of each kind.
    pub fn can_measure(&self) -> bool {
        self.light_paths >= 2 && self.camera_paths >= 2
    }

    /// Merges the command line's wishes, the scene file's and the built-in ones, in this order of
    /// precedence; `scene_size` in scene units turns a relative radius into an absolute one.
    ///
    /// # Errors
    /// As [`Self::validate`].
    pub fn resolve(
        command_line: &RenderDefaults,
        scene_file: &RenderDefaults,
        scene_size: f32,
    ) -> Result<Self> {
        let chosen = command_line.clone().or(scene_file);
        let [width, height] = chosen.resolution.unwrap_or([512, 512]);
        let settings = Self {
            width,
            height,
            light_paths: chosen.light_paths.unwrap_or(100_000),
            camera_paths: chosen.camera_paths.unwrap_or(4),
            radius: chosen.radius.unwrap_or(Length::Share(0.005)).resolve(scene_size),
            merge_vertex: chosen.merge_vertex.unwrap_or(2),
            direct: chosen.direct.unwrap_or_default(),
            light_roulette: chosen.light_roulette.unwrap_or_default(),
            camera_roulette: chosen.camera_roulette.unwrap_or(Roulette::Weight),
            seed: chosen.seed.unwrap_or(1),
        };
        settings.validate()?;
        Ok(settings)
    }

    /// Refuses what cannot be rendered.
    ///
    /// # Errors
    /// Names the setting and its bounds.
    pub fn validate(&self) -> Result<()> {
        check_resolution(&[self.width, self.height])?;
        check_light_paths(&self.light_paths)?;
        check_camera_paths(&self.camera_paths)?;
        check_radius(self.radius)?;
        check_merge_vertex(&self.merge_vertex)
    }
}

/// Settings that somebody wished for; the rest is left to the next layer.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RenderDefaults {
    /// Pixels across and down.
    #[serde(deserialize_with = "resolution")]
    pub resolution: Option<[u32; 2]>,
    /// Light paths per iteration.
    #[serde(deserialize_with = "light_paths")]
    pub light_paths: Option<u32>,
    /// Camera paths per pixel and iteration.
    #[serde(deserialize_with = "camera_paths")]
    pub camera_paths: Option<u32>,
    /// Merge radius.
    pub radius: Option<Length>,
    /// The diffuse vertex at which camera paths are cut.
    #[serde(deserialize_with = "merge_vertex")]
    pub merge_vertex: Option<u32>,
    /// How direct light is found.
    pub direct: Option<Direct>,
    /// How light paths end.
    pub light_roulette: Option<Roulette>,
    /// Whether camera paths may end before their cut.
    pub camera_roulette: Option<Roulette>,
    /// Seed of all random numbers.
    pub seed: Option<u64>,
}

impl RenderDefaults {
    /// These wishes where there are any, else those of `other`.
    #[must_use]
    pub fn or(self, other: &Self) -> Self {
        Self {
            resolution: self.resolution.or(other.resolution),
            light_paths: self.light_paths.or(other.light_paths),
            camera_paths: self.camera_paths.or(other.camera_paths),
            radius: self.radius.or(other.radius),
            merge_vertex: self.merge_vertex.or(other.merge_vertex),
            direct: self.direct.or(other.direct),
            light_roulette: self.light_roulette.or(other.light_roulette),
            camera_roulette: self.camera_roulette.or(other.camera_roulette),
            seed: self.seed.or(other.seed),
        }
    }
}

/// A positive length, absolute or relative to the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Length {
    /// Scene units.
    Units(f32),
    /// Share of the scene size (longest side of its bounding box), 0.01 for 1 %.
    Share(f32),
}

impl Length {
    /// In scene units, for a scene of this size in scene units.
    pub fn resolve(self, scene_size: f32) -> f32 {
        match self {
            Self::Units(length) => length,
            Self::Share(share) => share * scene_size,
        }
    }
}

impl FromStr for Length {
    type Err = Error;

    /// Reads a number of scene units such as `4.5`, or a share such as `0.8%`.
    fn from_str(text: &str) -> Result<Self> {
        let text = text.trim();
        let (number, percent) = match text.strip_suffix('%') {
            Some(number) => (number.trim_end(), true),
            None => (text, false),
        };
        let value: f64 = number
            .parse()
            .map_err(|_| Error::new(format!("`{text}` is not a length"), LENGTH_ADVICE))?;
        let value = (if percent { value / 100.0 } else { value }) as f32;
        check_radius(value)?;
        Ok(if percent { Self::Share(value) } else { Self::Units(value) })
    }
}

impl<'de> Deserialize<'de> for Length {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        struct Visitor;
        impl de::Visitor<'_> for Visitor {
            type Value = Length;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(
                    f,
                    "a length: a number of scene units, or a share of the scene size in quotes, such as \"0.8%\""
                )
            }
            fn visit_f64<E: de::Error>(self, value: f64) -> std::result::Result<Length, E> {
                check_radius(value as f32).map_err(as_serde)?;
                Ok(Length::Units(value as f32))
            }
            fn visit_i64<E: de::Error>(self, value: i64) -> std::result::Result<Length, E> {
                self.visit_f64(value as f64)
            }
            fn visit_u64<E: de::Error>(self, value: u64) -> std::result::Result<Length, E> {
                self.visit_f64(value as f64)
            }
            fn visit_str<E: de::Error>(self, value: &str) -> std::result::Result<Length, E> {
                value.parse().map_err(as_serde)
            }
        }
        from.deserialize_any(Visitor)
    }
}

const LENGTH_ADVICE: &str =
    "give a positive radius in scene units, or a share of the scene size such as 0.8%";

/// Separates problem and advice within the one string that a serde error carries.
pub(crate) const ADVICE: &str = "\u{1f}";

/// Hands an error through serde, which keeps nothing but a text; the scene loader splits it again.
pub(crate) fn as_serde<E: de::Error>(error: Error) -> E {
    E::custom(format_args!("{}{ADVICE}{}", error.problem(), error.advice()))
}

fn check_resolution(&[width, height]: &[u32; 2]) -> Result<()> {
    if (1..=65_536).contains(&width) && (1..=65_536).contains(&height) {
        return Ok(());
    }
    Err(Error::new(
        format!("the resolution is {width}x{height} pixels"),
        "give a width and a height between 1 and 65536, such as 512x512",
    ))
}

pub(crate) fn check_light_paths(&count: &u32) -> Result<()> {
    if (1..=MAX_LIGHT_PATHS).contains(&count) {
        return Ok(());
    }
    Err(Error::new(
        format!("{count} light paths per iteration"),
        format!("give between 1 and {MAX_LIGHT_PATHS} light paths"),
    ))
}

pub(crate) fn check_camera_paths(&count: &u32) -> Result<()> {
    if count > 0 {
        return Ok(());
    }
    Err(Error::new("0 camera paths per pixel", "give at least 1 camera path per pixel"))
}

fn check_radius(radius: f32) -> Result<()> {
    if radius > 0.0 && radius.is_finite() {
        return Ok(());
    }
    Err(Error::new(format!("the merge radius is {radius}"), LENGTH_ADVICE))
}

fn check_merge_vertex(&vertex: &u32) -> Result<()> {
    if (1..=255).contains(&vertex) {
        return Ok(());
    }
    Err(Error::new(
        format!("merge vertex {vertex}"),
        "give the number of the diffuse vertex at which camera paths are cut, 1 to 255",
    ))
}

/// Makes functions that read a value and check it at once, so that an error names its line.
macro_rules! checked {
    ($($name:ident: $type:ty, $check:ident;)*) => {$(
        fn $name<'de, D: Deserializer<'de>>(
            from: D,
        ) -> std::result::Result<Option<$type>, D::Error> {
            let value = <$type>::deserialize(from)?;
            $check(&value).map_err(as_serde)?;
            Ok(Some(value))
        }
    )*};
}

checked! {
    resolution: [u32; 2], check_resolution;
    light_paths: u32, check_light_paths;
    camera_paths: u32, check_camera_paths;
    merge_vertex: u32, check_merge_vertex;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_units_or_shares() {
        assert_eq!("4.5".parse::<Length>().unwrap(), Length::Units(4.5));
        assert_eq!(" 1e-3 ".parse::<Length>().unwrap(), Length::Units(1e-3));
        assert_eq!("0.8%".parse::<Length>().unwrap(), Length::Share(0.008));
        assert_eq!("50 %".parse::<Length>().unwrap(), Length::Share(0.5));
        assert_eq!(Length::Share(0.008).resolve(500.0), 4.0);
        assert_eq!(Length::Units(3.0).resolve(500.0), 3.0);
        for bad in ["", "%", "x", "0", "-1", "0%", "nan", "inf", "1e39", "1e-50", "5%%", "3 m"] {
            let error = bad.parse::<Length>().unwrap_err().to_string();
            assert!(error.contains("help: give a positive radius"), "{bad}: {error}");
        }
    }

    #[test]
    fn the_command_line_wins_over_the_file_over_the_built_in() {
        let file = RenderDefaults {
            resolution: Some([64, 32]),
            radius: Some(Length::Units(2.0)),
            direct: Some(Direct::PhotonMap),
            ..Default::default()
        };
        let line = RenderDefaults {
            radius: Some(Length::Share(0.01)),
            seed: Some(9),
            ..Default::default()
        };
        let settings = Settings::resolve(&line, &file, 50.0).unwrap();
        let expected = Settings {
            width: 64,
            height: 32,
            light_paths: 100_000,
            camera_paths: 4,
            radius: 0.5,
            merge_vertex: 2,
            direct: Direct::PhotonMap,
            light_roulette: Roulette::Albedo,
            camera_roulette: Roulette::Weight,
            seed: 9,
        };
        assert_eq!(settings, expected);
        let built_in =
            Settings::resolve(&RenderDefaults::default(), &RenderDefaults::default(), 100.0)
                .unwrap();
        assert_eq!(
            (built_in.width, built_in.height, built_in.radius, built_in.seed, built_in.direct),
            (512, 512, 0.5, 1, Direct::Connect)
        );
    }

    #[test]
    fn every_layer_passes_on_every_setting() {
        let all = RenderDefaults {
            resolution: Some([7, 8]),
            light_paths: Some(9),
            camera_paths: Some(10),
            radius: Some(Length::Units(11.0)),
            merge_vertex: Some(12),
            direct: Some(Direct::PhotonMap),
            light_roulette: Some(Roulette::Weight),
            camera_roulette: Some(Roulette::Weight),
            seed: Some(13),
        };
        assert_eq!(RenderDefaults::default().or(&all), all);
        assert_eq!(all.clone().or(&RenderDefaults::default()), all);
    }

    #[test]
    fn what_cannot_be_rendered_is_refused() {
        let refuse = |wish: RenderDefaults, part: &str| {
            let error = Settings::resolve(&wish, &RenderDefaults::default(), 1.0).unwrap_err();
            assert!(error.to_string().contains(part), "{error}");
        };
        let none = RenderDefaults::default;
        refuse(RenderDefaults { resolution: Some([0, 5]), ..none() }, "the resolution is 0x5");
        refuse(RenderDefaults { resolution: Some([5, 65_537]), ..none() }, "between 1 and 65536");
        refuse(RenderDefaults { light_paths: Some(0), ..none() }, "0 light paths");
        refuse(RenderDefaults { camera_paths: Some(0), ..none() }, "0 camera paths");
        refuse(RenderDefaults { merge_vertex: Some(256), ..none() }, "merge vertex 256");
        refuse(RenderDefaults { radius: Some(Length::Units(f32::NAN)), ..none() }, "radius is NaN");
    }
}
