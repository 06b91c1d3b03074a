//! Every setting, once: what it means, its type, its default and its bounds.

use super::checks::{
    as_serde, check_camera_paths, check_guide, check_light_paths, check_merge_vertex, check_radius,
    check_resolution, check_scale, check_strategy, checked,
};
use super::fixed_array::FixedArray;
use super::{Bias, Direct, Kernel, Length, Roulette, Strategy};
use crate::base::error::Result;
use serde::{Deserialize, Deserializer, Serialize};

/// A value, and how it is asked for.
trait Setting {
    /// What command lines and files hold.
    type Wish;
    /// `scene_size` in scene units: the longest side of the bounding box.
    fn of(wish: Self::Wish, scene_size: f32) -> Self;
    fn wish(&self) -> Self::Wish;
}

/// Values that are asked for as they are.
macro_rules! as_they_are {
    ($($type:ty),+) => {$(
        impl Setting for $type {
            type Wish = Self;
            fn of(wish: Self, _: f32) -> Self {
                wish
            }
            fn wish(&self) -> Self {
                *self
            }
        }
    )+};
}

as_they_are!(u32, u64, f64, Bias, Direct, Kernel, Roulette, Strategy);

impl Setting for f32 {
    type Wish = Length;
    fn of(wish: Length, scene_size: f32) -> Self {
        wish.resolve(scene_size)
    }
    fn wish(&self) -> Length {
        Length::Units(*self)
    }
}

fn anything<T>(_: &T) -> Result<()> {
    Ok(())
}

/// Makes [`Settings`] and [`PartialSettings`] of rows `name: type as type of wish = default, check`, with
/// the meaning, which is the command line's help, and attributes of the wish for serde and clap before them.
macro_rules! settings {
    ($(
        $(#[doc = $doc:literal])+
        $(#[serde($($serde:tt)+)])?
        $(#[arg($($arg:tt)+)])?
        $name:ident: $type:ty as $wish:ty = $default:expr, $check:expr;
    )+) => {
        /// What determines an image, given its scene.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct Settings {
            /// Pixels across.
            pub width: u32,
            /// Pixels down.
            pub height: u32,
            $($(#[doc = $doc])+ pub $name: $type,)+
        }

        /// Settings that somebody asks for, on the command line or in a scene file; the rest is left to
        /// the next layer.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        #[cfg_attr(feature = "cli", derive(clap::Args))]
        pub struct PartialSettings {
            /// Image size in pixels
            #[serde(deserialize_with = "read::resolution", skip_serializing_if = "Option::is_none")]
            #[cfg_attr(
                feature = "cli",
                arg(long, value_name = "WxH", value_parser = super::checks::parse_resolution)
            )]
            pub resolution: Option<[u32; 2]>,
            $(
                $(#[doc = $doc])+
                $(#[serde($($serde)+)])?
                #[serde(skip_serializing_if = "Option::is_none")]
                #[cfg_attr(feature = "cli", arg(long, $($($arg)+)?))]
                pub $name: Option<$wish>,
            )+
        }

        impl Settings {
    /// The radius within which photons of either class are looked up, scene units.
    pub fn reach(&self) -> f32 {
        self.radius.max(self.caustic_radius)
    }

            /// Names of all.
            pub const NAMES: &[&str] = &["width", "height", $(stringify!($name)),+];

            /// Merges the command line's wishes, the scene file's and the built-in ones, in this order
            /// of precedence; `scene_size` in scene units turns relative lengths into absolute ones.
            ///
            /// # Errors
            /// As [`Self::validate`].
            pub fn resolve(
                command_line: &PartialSettings,
                scene_file: &PartialSettings,
                scene_size: f32,
            ) -> Result<Self> {
                let wishes = command_line.clone().or(scene_file);
                let [width, height] = wishes.resolution.unwrap_or([512, 512]);
                // One after the other: defaults may depend on what comes before them.
                $(let $name = <$type>::of(wishes.$name.unwrap_or($default), scene_size);)+
                let settings = Self { width, height, $($name,)+ };
                settings.validate()?;
                Ok(settings)
            }

            /// Refuses what cannot be rendered.
            ///
            /// # Errors
            /// Names the setting and its bounds.
            pub fn validate(&self) -> Result<()> {
                check_resolution(&[self.width, self.height])?;
                $($check(&self.$name)?;)+
                check_strategy(self.strategy, self.merge_vertex)
            }
        }

        impl PartialSettings {
            /// These wishes where there are any, else those of `other`.
            #[must_use]
            pub fn or(self, other: &Self) -> Self {
                Self {
                    resolution: self.resolution.or(other.resolution),
                    $($name: self.$name.or(other.$name),)+
                }
            }
        }

        impl From<&Settings> for PartialSettings {
            /// Leaves nothing open.
            fn from(settings: &Settings) -> Self {
                Self {
                    resolution: Some([settings.width, settings.height]),
                    $($name: Some(settings.$name.wish()),)+
                }
            }
        }
    };
}

settings! {
    /// Light paths per iteration
    #[serde(deserialize_with = "read::light_paths")]
    #[arg(value_name = "NF")]
    light_paths: u32 as u32 = 100_000, check_light_paths;

    /// Camera paths per pixel and iteration
    #[serde(deserialize_with = "read::camera_paths")]
    #[arg(value_name = "NB")]
    camera_paths: u32 as u32 = 4, check_camera_paths;

    /// Merge radius: scene units, or a share of the scene size such as 0.8%
    #[arg(value_name = "R", allow_negative_numbers = true)]
    radius: f32 as Length = Length::Share(0.005), check_radius;

    /// The same for photons without a diffuse bounce, such as caustics [default: a quarter of --radius]
    #[arg(value_name = "R", allow_negative_numbers = true)]
    caustic_radius: f32 as Length = Length::Units(0.25 * radius), check_radius;

    /// What becomes of the merge bias
    bias: Bias as Bias = Bias::Keep, anything;

    /// What merged photons are divided by
    kernel: Kernel as Kernel = Kernel::Area, anything;

    /// The diffuse vertex at which camera paths are cut and merged
    #[serde(deserialize_with = "read::merge_vertex")]
    #[arg(value_name = "K")]
    merge_vertex: u32 as u32 = 2, check_merge_vertex;

    /// Whether each path is found in one way, or in all ways that --merge-vertex 1 and 2 know
    strategy: Strategy as Strategy = Strategy::Single, anything;

    /// Light paths that the weights of --strategy mis are made for [default: --light-paths]
    #[serde(deserialize_with = "read::mis_light_paths")]
    #[arg(value_name = "NF")]
    mis_light_paths: u32 as u32 = light_paths, check_light_paths;

    /// Scale of these weights' merges at the first vertex [default: 2/(1 + --camera-paths)]
    #[serde(deserialize_with = "read::mis_c1")]
    #[arg(value_name = "C", allow_negative_numbers = true)]
    mis_c1: f64 as f64 = shared_by(camera_paths), check_scale;

    /// The same at the second
    #[serde(deserialize_with = "read::mis_c2")]
    #[arg(value_name = "C", allow_negative_numbers = true)]
    mis_c2: f64 as f64 = shared_by(camera_paths), check_scale;

    /// Iterations beside the image that teach light paths to start where they bring more to it; with 0 they start in proportion to power
    #[serde(deserialize_with = "read::guide")]
    #[arg(value_name = "N")]
    guide: u32 as u32 = 0, check_guide;

    /// How light that comes straight from a light source is found
    direct: Direct as Direct = Direct::Connect, anything;

    /// How light paths end
    light_roulette: Roulette as Roulette = Roulette::Albedo, anything;

    /// How camera paths may end before their cut
    camera_roulette: Roulette as Roulette = Roulette::Weight, anything;

    /// Seed of all random numbers
    #[arg(value_name = "S")]
    seed: u64 as u64 = 1, anything;
}

/// How files are read where a value may be out of bounds: the error then names its line.
mod read {
    use super::*;

    pub fn resolution<'de, D: Deserializer<'de>>(
        from: D,
    ) -> std::result::Result<Option<[u32; 2]>, D::Error> {
        let FixedArray(pixels) = FixedArray::deserialize(from)?;
        check_resolution(&pixels).map_err(as_serde)?;
        Ok(Some(pixels))
    }

    macro_rules! checked {
        ($($name:ident: $wish:ty, $check:ident;)+) => {$(
            pub fn $name<'de, D: Deserializer<'de>>(from: D) -> std::result::Result<Option<$wish>, D::Error> {
                checked(from, $check)
            }
        )+};
    }

    checked! {
        light_paths: u32, check_light_paths;
        camera_paths: u32, check_camera_paths;
        merge_vertex: u32, check_merge_vertex;
        mis_light_paths: u32, check_light_paths;
        guide: u32, check_guide;
        mis_c1: f64, check_scale;
        mis_c2: f64, check_scale;
    }
}

/// What merges count in weights if so many camera paths share the photons: `1/(1 + phi (N_B - 1))`, where
/// `phi` is the share of a merge's variance that belongs to the photons alone. Without a measurement half
/// of it does; the optimum is flat.
/// theory.md (47h).
pub(crate) fn shared_by(camera_paths: u32) -> f64 {
    2.0 / (1.0 + f64::from(camera_paths))
}

impl Settings {
    /// Width and height, pixels.
    pub fn resolution(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Whether noise coefficients can be measured: that takes two paths of each kind.
    pub fn can_measure(&self) -> bool {
        self.light_paths >= 2 && self.camera_paths >= 2
    }

    /// All settings by name.
    pub fn to_map(&self) -> serde_json::Map<String, serde_json::Value> {
        // Through text, which keeps an f32 such as 0.1 as short as it was written.
        let text = serde_json::to_string(self).expect("plain numbers and names");
        serde_json::from_str(&text).expect("what was just written")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_wins_over_the_file_over_the_built_in() {
        let file = PartialSettings {
            resolution: Some([64, 32]),
            radius: Some(Length::Units(2.0)),
            direct: Some(Direct::PhotonMap),
            ..Default::default()
        };
        let line = PartialSettings {
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
            caustic_radius: 0.125,
            bias: Bias::Keep,
            kernel: Kernel::Area,
            merge_vertex: 2,
            strategy: Strategy::Single,
            mis_light_paths: 100_000,
            mis_c1: 0.4,
            mis_c2: 0.4,
            direct: Direct::PhotonMap,
            light_roulette: Roulette::Albedo,
            camera_roulette: Roulette::Weight,
            guide: 0,
            seed: 9,
        };
        assert_eq!(settings, expected);
        let built_in =
            Settings::resolve(&PartialSettings::default(), &PartialSettings::default(), 100.0)
                .unwrap();
        assert_eq!(
            (built_in.width, built_in.height, built_in.radius, built_in.seed, built_in.direct),
            (512, 512, 0.5, 1, Direct::Connect)
        );
    }

    #[test]
    fn every_layer_passes_on_every_setting() {
        let all = PartialSettings {
            resolution: Some([7, 8]),
            light_paths: Some(9),
            camera_paths: Some(10),
            radius: Some(Length::Units(11.0)),
            caustic_radius: Some(Length::Share(0.25)),
            bias: Some(Bias::Reduce),
            kernel: Some(Kernel::Disc),
            merge_vertex: Some(12),
            strategy: Some(Strategy::Mis),
            mis_light_paths: Some(14),
            mis_c1: Some(0.5),
            mis_c2: Some(0.25),
            direct: Some(Direct::PhotonMap),
            light_roulette: Some(Roulette::Weight),
            camera_roulette: Some(Roulette::Weight),
            guide: Some(15),
            seed: Some(13),
        };
        assert_eq!(PartialSettings::default().or(&all), all);
        assert_eq!(all.clone().or(&PartialSettings::default()), all);
    }

    #[test]
    fn what_cannot_be_rendered_is_refused() {
        let refuse = |wish: PartialSettings, part: &str| {
            let error = Settings::resolve(&wish, &PartialSettings::default(), 1.0).unwrap_err();
            assert!(error.to_string().contains(part), "{error}");
        };
        let none = PartialSettings::default;
        refuse(PartialSettings { resolution: Some([0, 5]), ..none() }, "the resolution is 0x5");
        refuse(PartialSettings { resolution: Some([5, 65_537]), ..none() }, "between 1 and 65536");
        refuse(PartialSettings { light_paths: Some(0), ..none() }, "0 light paths");
        refuse(PartialSettings { camera_paths: Some(0), ..none() }, "0 camera paths");
        refuse(PartialSettings { merge_vertex: Some(256), ..none() }, "merge vertex 256");
        refuse(PartialSettings { mis_light_paths: Some(0), ..none() }, "0 light paths");
        refuse(PartialSettings { mis_c1: Some(-0.5), ..none() }, "scale of merges is -0.5");
        refuse(PartialSettings { mis_c2: Some(f64::NAN), ..none() }, "scale of merges is NaN");
        let (strategy, merge_vertex) = (Some(Strategy::Mis), Some(1));
        refuse(PartialSettings { strategy, merge_vertex, ..none() }, "merges at vertices 1 and 2");
        refuse(
            PartialSettings { radius: Some(Length::Units(f32::NAN)), ..none() },
            "radius is NaN",
        );
    }
}
