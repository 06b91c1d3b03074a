//! Everything besides the scene that determines an image, validated.

mod checks;
mod fixed_array;
mod length;
pub mod provenance;
pub mod policy;
mod table;

pub use checks::MAX_LIGHT_PATHS;
pub(crate) use checks::{ADVICE, as_serde, check_camera_paths, check_light_paths};
pub(crate) use fixed_array::FixedArray;
pub use length::Length;
pub(crate) use table::shared_by;
pub use table::{PartialSettings, Settings};

use serde::{Deserialize, Serialize};

/// How light that comes straight from a light source is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Direct {
    /// By a shadow ray from each diffuse vertex of the camera path.
    #[default]
    Connect,
    /// From the photon map, like all other light.
    PhotonMap,
}

/// In how many ways a path is found: theory.md, section 4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Strategy {
    /// In one: by merging at vertex `k` (caustics at all up to it), or by connection.
    #[default]
    Single,
    /// By merging at vertices 1 and 2 and by connection from both, weighted by the balance heuristic.
    Mis,
}

/// The area that merged photons are divided by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Kernel {
    /// That of a disc of the merge radius, as in the paper.
    #[default]
    Disc,
    /// That of the surface within the merge radius that could have sent a photon: no bias at edges.
    Area,
}

/// What becomes of the bias of merging within radii that are not zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Bias {
    /// It stays: the image is what the paper's estimator finds.
    #[default]
    Keep,
    /// It is taken off where it stands out from the noise, by what half the radii find: theory.md, section 17a.
    Reduce,
}

/// How paths end where they scatter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Roulette {
    /// Analog: survive with probability albedo, so that the weight stays (nearly) constant.
    #[default]
    Albedo,
    /// Carry the albedo as weight. Camera paths end at their cut anyway; light paths survive with
    /// probability 0.995 until their weight falls below 1/16 of its start, then in proportion to it.
    Weight,
}
