//! Command line options for the settings of an image, and words for the library's enumerations.

use bdpm::adaptive::technique::FreeParameters;
use bdpm::scene::backend::Backend;
use bdpm::settings::combinations::{COMBINATIONS, Outcome};
use bdpm::settings::{Bias, Direct, Kernel, Length, MediumQuery, PartialSettings, Strategy};
use clap::Arg;
use clap::builder::{PossibleValue, PossibleValuesParser, StyledStr, TypedValueParser};
use serde::de::DeserializeOwned;
use serde::de::value::{Error, StrDeserializer};

/// Defines [`SettingsArgs`] by rows `name: type` with the help text and the attributes for clap,
/// and turns it into [`PartialSettings`], which must have a field for each row.
macro_rules! options {
    ($($(#[$meta:meta])+ $name:ident: $type:ty,)+) => {
        /// Settings of an image. A setting without an option is that of the scene file, or the
        /// default.
        #[derive(Clone, clap::Args)]
        pub struct SettingsArgs {
            $($(#[$meta])+ pub $name: Option<$type>,)+
        }

        impl From<&SettingsArgs> for PartialSettings {
            fn from(args: &SettingsArgs) -> Self {
                Self { crop: None, $($name: args.$name,)+ }
            }
        }
    };
}

options! {
    /// Render this many pixels [default: scene file, else 512x512]
    #[arg(long, value_name = "WxH", value_parser = parse_resolution)]
    resolution: [u32; 2],
    /// Trace NF light paths per iteration [default: scene file, else 100000]
    #[arg(long, value_name = "NF")]
    light_paths: u32,
    /// Trace NB camera paths per pixel and iteration [default: scene file, else 4]
    #[arg(long, value_name = "NB")]
    camera_paths: u32,
    /// Merge photons within R scene units, or % of the scene size [default: 0.5%]
    #[arg(long, value_name = "R", allow_negative_numbers = true)]
    radius: Length,
    /// Merge caustic photons within R [default: a quarter of --radius]
    #[arg(long, value_name = "R", allow_negative_numbers = true)]
    caustic_radius: Length,
    /// Merge photons in media within F times the radii at surfaces [default: 2]
    #[arg(long, value_name = "F")]
    medium_scale: f64,
    /// Do a share F of the merges in media, each with 1/F of its weight [default: 1]
    #[arg(long, value_name = "F")]
    medium_share: f64,
    /// Merge photons in media around points, or along segments of camera paths [default: beams]
    #[arg(long, value_parser = word::<MediumQuery>(MEDIUM_QUERY))]
    medium_query: MediumQuery,
    /// Merge wavelengths within a share F of the spectrum [default: 0.06]
    #[arg(long, value_name = "F")]
    wavelength_width: f64,
    /// Keep or reduce the merge bias [default: reduce if radii are chosen, else keep]
    #[arg(long, value_parser = word::<Bias>(BIAS))]
    bias: Bias,
    /// Divide merged flux by the area of the surface or of a disc [default: area]
    #[arg(long, value_parser = word::<Kernel>(KERNEL))]
    kernel: Kernel,
    /// Cut and merge camera paths at their diffuse vertex K [default: 2]
    #[arg(long, value_name = "K")]
    merge_vertex: u32,
    /// Sample each path by one technique or by several [default: single]
    #[arg(long, value_parser = word::<Strategy>(STRATEGY))]
    strategy: Strategy,
    /// Learn in N iterations where light paths should start [default: 0]
    #[arg(long, value_name = "N")]
    guide: u32,
    /// Start light paths from Sobol points, in sets of S light paths [default: 1]
    #[arg(long, value_name = "S")]
    sobol_set: u32,
    /// Split light paths at their first diffuse vertex into M times as many [default: 1]
    #[arg(long, value_name = "M")]
    splitting: u32,
    /// Learn by N shadow rays which lights are visible from where [default: 0]
    #[arg(long, value_name = "N")]
    light_visibility: u32,
    /// Connect to lights, or take direct light from photons [default: connect]
    #[arg(long, value_parser = word::<Direct>(DIRECT))]
    direct: Direct,
    /// Seed all random numbers with S [default: 1]
    #[arg(long, value_name = "S")]
    seed: u64,
}

/// The option with the default `chosen` in its help, if automatic rendering chooses its value.
pub fn with_chosen_default(option: Arg) -> Arg {
    let name = option.get_id().as_str();
    let is_count = matches!(name, "light_paths" | "camera_paths");
    if !(is_count || FreeParameters::ALL.includes(name)) {
        return option;
    }
    let help = option.get_help().map_or(String::new(), StyledStr::to_string);
    let (meaning, _) = help.split_once(" [default: ").expect("a fixed default");
    option.help(format!("{meaning} [default: chosen]"))
}

/// The option with the conflicts that the table of combinations lists.
pub fn with_conflicts(option: Arg) -> Arg {
    let name = option.get_long().map_or(String::new(), |name| format!("--{name}"));
    let own = COMBINATIONS.iter().filter(|row| row.options[0] == name);
    own.fold(option, |option, row| match row.outcome {
        Outcome::Usage(others) => option.conflicts_with_all(others),
        Outcome::Refused(_) | Outcome::Weakened => option,
    })
}

/// Values of an enumeration, as files spell them, with their meaning.
type Words = &'static [(&'static str, &'static str)];

const BIAS: Words = &[
    ("keep", "Keep the bias of the paper's estimator"),
    ("reduce", "Subtract the bias where it exceeds the noise"),
];
const KERNEL: Words = &[
    ("area", "Lit surface area within the radius: no bias at edges"),
    ("disc", "Disc of the merge radius, as in the paper"),
];
const MEDIUM_QUERY: Words = &[
    ("points", "In balls around points: for dense media"),
    ("beams", "In cylinders around segments: for thin media"),
];
const STRATEGY: Words = &[
    ("single", "Merge at the merge vertex, or connect"),
    ("mis", "Merge at vertices 1 and 2, connect and hit lights, weighted"),
    ("cut-mis", "As mis, with camera paths that end at vertex 2"),
    ("path", "Trace camera paths only: connect and hit lights, weighted"),
    ("path-caustics", "As path, with photons of caustics alone, merged at all vertices"),
    ("gather", "As path, but look light up at the merge vertex, where full paths left it"),
    ("gather-caustics", "As gather, with photons of caustics"),
];
const DIRECT: Words = &[
    ("connect", "Shadow ray from each diffuse vertex of the camera path"),
    ("photon-map", "Photon map, as for indirect light"),
];
pub const QUALITY: Words = &[
    ("fast", "The small network, guided by noisy albedo and normals"),
    ("high", "The large network, guided by denoised albedo and normals: 14 times as long"),
];
pub const OBJECTIVE: Words = &[
    ("relative", "Variance relative to squared luminance: dark parts count as much as bright ones"),
    ("pooled", "Mean variance"),
    ("mean-rms", "Mean RMS, as in the paper"),
    ("max-rms", "99.5th percentile of the RMS of the pixels"),
];
pub const ESTIMATOR: Words = &[
    ("pairs", "All pairs of light and camera paths"),
    ("halves", "Halves of the paths, as published"),
];

/// Parses one of `words` as files spell it.
pub fn word<T>(words: Words) -> impl TypedValueParser<Value = T>
where
    T: DeserializeOwned + Clone + Send + Sync + 'static,
{
    let values = words.iter().map(|&(word, meaning)| PossibleValue::new(word).help(meaning));
    PossibleValuesParser::new(values)
        .map(|word| T::deserialize(StrDeserializer::<Error>::new(&word)).expect("a listed word"))
}

/// Parses the name of a backend.
pub fn backend() -> impl TypedValueParser<Value = Backend> {
    PossibleValuesParser::new(Backend::ALL.map(Backend::name)).map(|name| {
        let mut all = Backend::ALL.into_iter();
        all.find(|backend| backend.name() == name).expect("a listed name")
    })
}

/// Parses a resolution such as 512x384.
fn parse_resolution(text: &str) -> Result<[u32; 2], &'static str> {
    let pixels = text.split_once(['x', 'X']).and_then(|(width, height)| {
        Some([width.trim().parse().ok()?, height.trim().parse().ok()?])
    });
    pixels.ok_or("give a width and a height, such as 512x384")
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm::adaptive::optimize::Objective;
    use bdpm::noise::Measure;
    use bdpm::output::denoise::Quality;
    use serde::Serialize;

    #[test]
    fn resolution_is_two_numbers() {
        assert_eq!(parse_resolution("640x480"), Ok([640, 480]));
        for bad in ["", "640", "x", "640x", "640x-1", "640x480x3", "axb", "99999999999x1"] {
            assert!(parse_resolution(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn listed_words_are_spelled_as_in_files() {
        fn check<T: DeserializeOwned + Serialize>(words: Words) {
            for (word, _) in words {
                let value = T::deserialize(StrDeserializer::<Error>::new(word)).expect(word);
                assert_eq!(serde_json::to_value(&value).unwrap(), *word);
            }
        }
        check::<Bias>(BIAS);
        check::<Kernel>(KERNEL);
        check::<MediumQuery>(MEDIUM_QUERY);
        check::<Strategy>(STRATEGY);
        check::<Direct>(DIRECT);
        check::<Objective>(OBJECTIVE);
        check::<Quality>(QUALITY);
        check::<Measure>(ESTIMATOR);
    }
}
