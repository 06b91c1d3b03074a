//! Everything besides the scene that determines an image, validated.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

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
    /// Carry the albedo as weight. Camera paths end at their cut anyway; light paths
    /// survive for certain until their weight falls below 1/16 of its start, then by roulette.
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

    /// Refuses what cannot be rendered.
    ///
    /// # Errors
    /// Names the setting and its bounds.
    pub fn validate(&self) -> Result<()> {
        let refuse = |problem: String, advice: &str| Err(Error::new(problem, advice));
        if self.width == 0 || self.height == 0 || self.width > 65_536 || self.height > 65_536 {
            return refuse(
                format!("the resolution is {}x{} pixels", self.width, self.height),
                "give a width and a height between 1 and 65536, such as 512x512",
            );
        }
        if self.light_paths == 0 || self.light_paths > MAX_LIGHT_PATHS {
            return refuse(
                format!("{} light paths per iteration", self.light_paths),
                "give between 1 and 2147483648 light paths",
            );
        }
        if self.camera_paths == 0 {
            return refuse(
                "0 camera paths per pixel".into(),
                "give at least 1 camera path per pixel",
            );
        }
        if !(self.radius > 0.0 && self.radius.is_finite()) {
            return refuse(
                format!("the merge radius is {}", self.radius),
                "give a positive radius in scene units, or a share of the scene size such as 0.8%",
            );
        }
        if self.merge_vertex == 0 || self.merge_vertex > 255 {
            return refuse(
                format!("merge vertex {}", self.merge_vertex),
                "give the number of the diffuse vertex at which camera paths are cut, 1 to 255",
            );
        }
        Ok(())
    }
}
