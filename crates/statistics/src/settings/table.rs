//! Every setting once: its meaning, type, default and bounds.

use super::checks::{
    as_serde, check_camera_paths, check_guide, check_light_paths, check_light_visibility,
    check_medium_scale, check_medium_share, check_merge_vertex, check_radius, check_resolution,
    check_sobol_set, check_splitting, check_wavelength_width, checked,
};
use super::combinations::{self, Request};
use super::fixed_array::FixedArray;
use super::{Bias, Crop, Direct, Kernel, Length, MediumQuery, MisScales, Strategy};
use super::{DEFAULT_WAVELENGTH_WIDTH, crop};
use bdpm_base::error::Result;
use serde::{Deserialize, Deserializer, Serialize};

/// The value of a setting, resolved from the input of a file or a command line.
trait Setting {
    /// Type of the value in files and on command lines.
    type Input;
    /// Resolves an input; `scene_size` is the longest side of the bounding box, scene units.
    fn resolve(input: Self::Input, scene_size: f32) -> Self;
    /// The input that resolves to this value in any scene.
    fn input(&self) -> Self::Input;
}

/// Values that are their own inputs.
macro_rules! plain {
    ($($type:ty),+) => {$(
        impl Setting for $type {
            type Input = Self;
            fn resolve(input: Self, _: f32) -> Self {
                input
            }
            fn input(&self) -> Self {
                *self
            }
        }
    )+};
}

plain!(u32, u64, f64, Bias, Direct, Kernel, MediumQuery, Strategy);

impl Setting for f32 {
    type Input = Length;
    fn resolve(input: Length, scene_size: f32) -> Self {
        input.resolve(scene_size)
    }
    fn input(&self) -> Length {
        Length::Units(*self)
    }
}

/// Accepts any value.
fn any<T>(_: &T) -> Result<()> {
    Ok(())
}

/// Defines [`Settings`] and [`PartialSettings`] by rows
/// `name: type as input type = default, check`, preceded by the meaning and the attributes of the
/// input for serde.
macro_rules! settings {
    ($(
        $(#[doc = $doc:literal])+
        $(#[serde($($serde:tt)+)])?
        $name:ident: $type:ty as $input:ty = $default:expr, $check:expr;
    )+) => {
        /// All settings that determine an image, given its scene.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct Settings {
            /// Pixels across.
            pub width: u32,
            /// Pixels down.
            pub height: u32,
            /// Position in the full image, if only a window of it is rendered.
            #[serde(with = "crop")]
            pub crop: Option<Crop>,
            $($(#[doc = $doc])+ pub $name: $type,)+
            /// Constants of MIS weights, if not [`MisScales::new`] of the counts. Files do not have
            /// them: only renders that serve another image, such as trials of it, set them.
            #[serde(skip)]
            pub mis_scales: Option<MisScales>,
        }

        /// Settings that a command line or a scene file gives. The next layer provides those that
        /// are `None`.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct PartialSettings {
            /// Image size in pixels: width and height.
            #[serde(deserialize_with = "read::resolution", skip_serializing_if = "Option::is_none")]
            pub resolution: Option<[u32; 2]>,
            /// Left column, top row, width and height of the window to render, pixels. Files do not
            /// have it.
            #[serde(skip)]
            pub crop: Option<[u32; 4]>,
            $(
                $(#[doc = $doc])+
                $(#[serde($($serde)+)])?
                #[serde(skip_serializing_if = "Option::is_none")]
                pub $name: Option<$input>,
            )+
        }

        impl Settings {
            /// Names of all settings.
            pub const NAMES: &[&str] = &["width", "height", "crop", $(stringify!($name)),+];

            /// Merges the settings of the command line, the scene file and the defaults, in this
            /// order of precedence. `scene_size`, in scene units, turns relative lengths into
            /// absolute ones.
            ///
            /// # Errors
            /// As [`Self::validate`].
            pub fn resolve(
                command_line: &PartialSettings,
                scene_file: &PartialSettings,
                scene_size: f32,
            ) -> Result<Self> {
                let inputs = command_line.clone().or(scene_file);
                let full = inputs.resolution.unwrap_or([512, 512]);
                check_resolution(&full)?;
                let (crop, [width, height]) = Crop::resolve(inputs.crop, full)?;
                // In the order of the rows: a default may depend on the rows before.
                $(let $name = <$type>::resolve(inputs.$name.unwrap_or($default), scene_size);)+
                let settings = Self { width, height, crop, $($name,)+ mis_scales: None };
                settings.validate()?;
                Ok(settings)
            }

            /// Refuses settings that cannot be rendered.
            ///
            /// # Errors
            /// Names the setting and its bounds.
            pub fn validate(&self) -> Result<()> {
                check_resolution(&[self.width, self.height])?;
                if let Some(crop) = &self.crop {
                    check_resolution(&crop.full)?;
                    crop.check([self.width, self.height])?;
                }
                $($check(&self.$name)?;)+
                combinations::check(&Request::of(self))
            }
        }

        impl PartialSettings {
            /// Fills the settings that are `None` from `other`.
            #[must_use]
            pub fn or(self, other: &Self) -> Self {
                Self {
                    resolution: self.resolution.or(other.resolution),
                    crop: self.crop.or(other.crop),
                    $($name: self.$name.or(other.$name),)+
                }
            }
        }

        impl From<&Settings> for PartialSettings {
            /// Gives every setting.
            fn from(settings: &Settings) -> Self {
                Self {
                    resolution: Some(settings.full_resolution()),
                    crop: settings.crop.map(|crop| {
                        let [x, y] = crop.origin;
                        [x, y, settings.width, settings.height]
                    }),
                    $($name: Some(settings.$name.input()),)+
                }
            }
        }
    };
}

settings! {
    /// Light paths per iteration, `N_F`.
    #[serde(deserialize_with = "read::light_paths")]
    light_paths: u32 as u32 = 100_000, check_light_paths;

    /// Camera paths per pixel and iteration, `N_B`.
    #[serde(deserialize_with = "read::camera_paths")]
    camera_paths: u32 as u32 = 4, check_camera_paths;

    /// Merge radius.
    radius: f32 as Length = Length::Share(0.005), check_radius;

    /// Merge radius of photons without a diffuse bounce, such as caustics.
    caustic_radius: f32 as Length = Length::Units(0.25 * radius), check_radius;

    /// Radii of merges in media over those at surfaces.
    #[serde(deserialize_with = "read::medium_scale")]
    medium_scale: f64 as f64 = 2.0, check_medium_scale;

    /// Share of the merges in media that are done, each with as much more weight.
    #[serde(deserialize_with = "read::medium_share")]
    medium_share: f64 as f64 = 1.0, check_medium_share;

    /// Where photons in media are merged: around points of camera paths, or along their segments.
    medium_query: MediumQuery as MediumQuery = MediumQuery::default(), any;

    /// Share of the spectrum within which photons merge with camera paths, where both have a
    /// wavelength.
    #[serde(deserialize_with = "read::wavelength_width")]
    wavelength_width: f64 as f64 = DEFAULT_WAVELENGTH_WIDTH, check_wavelength_width;

    /// Treatment of the merge bias.
    bias: Bias as Bias = Bias::default(), any;

    /// Area that merged flux is divided by.
    kernel: Kernel as Kernel = Kernel::default(), any;

    /// Number of the diffuse vertex at which camera paths are cut and merged.
    #[serde(deserialize_with = "read::merge_vertex")]
    merge_vertex: u32 as u32 = 2, check_merge_vertex;

    /// Techniques that sample a path.
    strategy: Strategy as Strategy = Strategy::default(), any;

    /// Iterations beside the image in which the starts of light paths are learned. With 0 light
    /// paths start in proportion to the lights' power.
    #[serde(deserialize_with = "read::guide")]
    guide: u32 as u32 = 0, check_guide;

    /// Light paths that start from one set of scrambled Sobol points, a power of two. With 1 light
    /// paths are independent.
    #[serde(deserialize_with = "read::sobol_set")]
    sobol_set: u32 as u32 = 1, check_sobol_set;

    /// Factor on the expected number of continuations of a light path at its first diffuse vertex.
    /// With 1 Russian roulette leaves at most one, as at all later vertices.
    #[serde(deserialize_with = "read::splitting")]
    splitting: u32 as u32 = 1, check_splitting;

    /// Shadow rays beside the image that learn which lights are visible from where. With 0 vertices
    /// choose among lights as if nothing were in between.
    #[serde(deserialize_with = "read::light_visibility")]
    light_visibility: u32 as u32 = 0, check_light_visibility;

    /// Technique for light straight from a light source.
    direct: Direct as Direct = Direct::default(), any;

    /// Seed of all random numbers.
    seed: u64 as u64 = 1, any;
}

/// Minimum number of sets of light paths in an iteration whose counts are chosen: each measured
/// iteration estimates the variance between its sets.
pub const MIN_SETS: u32 = 8;

/// Deserializers that check bounds, so that an error names its line.
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
        ($($name:ident: $input:ty, $check:ident;)+) => {$(
            pub fn $name<'de, D: Deserializer<'de>>(
                from: D,
            ) -> std::result::Result<Option<$input>, D::Error> {
                checked(from, $check)
            }
        )+};
    }

    checked! {
        light_paths: u32, check_light_paths;
        camera_paths: u32, check_camera_paths;
        medium_scale: f64, check_medium_scale;
        medium_share: f64, check_medium_share;
        wavelength_width: f64, check_wavelength_width;
        merge_vertex: u32, check_merge_vertex;
        guide: u32, check_guide;
        sobol_set: u32, check_sobol_set;
        splitting: u32, check_splitting;
        light_visibility: u32, check_light_visibility;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn command_line_overrides_scene_file_and_defaults() {
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
            crop: None,
            light_paths: 100_000,
            camera_paths: 4,
            radius: 0.5,
            caustic_radius: 0.125,
            medium_scale: 2.0,
            medium_share: 1.0,
            medium_query: MediumQuery::Beams,
            wavelength_width: 0.06,
            bias: Bias::Keep,
            kernel: Kernel::Area,
            merge_vertex: 2,
            strategy: Strategy::Single,
            direct: Direct::PhotonMap,
            guide: 0,
            sobol_set: 1,
            splitting: 1,
            light_visibility: 0,
            seed: 9,
            mis_scales: None,
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
    fn every_setting_passes_through_every_layer() {
        let all = PartialSettings {
            resolution: Some([7, 8]),
            crop: Some([1, 2, 3, 4]),
            light_paths: Some(9),
            camera_paths: Some(10),
            radius: Some(Length::Units(11.0)),
            caustic_radius: Some(Length::Share(0.25)),
            medium_scale: Some(3.0),
            medium_share: Some(0.5),
            medium_query: Some(MediumQuery::Points),
            wavelength_width: Some(0.5),
            bias: Some(Bias::Reduce),
            kernel: Some(Kernel::Disc),
            merge_vertex: Some(12),
            strategy: Some(Strategy::Mis),
            direct: Some(Direct::PhotonMap),
            guide: Some(15),
            sobol_set: Some(256),
            splitting: Some(4),
            light_visibility: Some(16),
            seed: Some(13),
        };
        assert_eq!(PartialSettings::default().or(&all), all);
        assert_eq!(all.clone().or(&PartialSettings::default()), all);
    }

    #[test]
    fn settings_out_of_bounds_are_refused() {
        let refuse = |input: PartialSettings, part: &str| {
            let error = Settings::resolve(&input, &PartialSettings::default(), 1.0).unwrap_err();
            assert!(error.to_string().contains(part), "{error}");
        };
        let none = PartialSettings::default;
        refuse(PartialSettings { resolution: Some([0, 5]), ..none() }, "the resolution is 0x5");
        refuse(PartialSettings { resolution: Some([5, 65_537]), ..none() }, "between 1 and 65536");
        refuse(PartialSettings { crop: Some([500, 0, 20, 20]), ..none() }, "the crop 500,0,20,20");
        refuse(PartialSettings { light_paths: Some(0), ..none() }, "0 light paths");
        refuse(PartialSettings { camera_paths: Some(0), ..none() }, "0 camera paths");
        refuse(PartialSettings { merge_vertex: Some(256), ..none() }, "merge vertex 256");
        refuse(PartialSettings { sobol_set: Some(100), ..none() }, "sets of 100 light paths");
        refuse(
            PartialSettings { sobol_set: Some(1 << 19), ..none() },
            "sets of 524288 light paths",
        );
        refuse(PartialSettings { splitting: Some(0), ..none() }, "splitting by 0");
        let (light_paths, sobol_set) = (Some(100_000), Some(4096));
        let uneven = PartialSettings { light_paths, sobol_set, ..none() };
        refuse(uneven, "98304 or 102400");
        let (strategy, merge_vertex) = (Some(Strategy::Mis), Some(1));
        refuse(PartialSettings { strategy, merge_vertex, ..none() }, "merge at vertices 1 and 2");
        refuse(
            PartialSettings { radius: Some(Length::Units(f32::NAN)), ..none() },
            "radius is NaN",
        );
    }
}
