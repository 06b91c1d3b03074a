//! Settings: everything besides the scene that determines an image, validated.

mod allowed;
mod checks;
pub mod combinations;
mod crop;
mod derived;
pub mod differences;
mod fixed_array;
mod length;
pub mod provenance;
mod region;
mod table;

pub use allowed::AllowedLightPaths;
pub use checks::{
    ADVICE, DEFAULT_WAVELENGTH_WIDTH, MAX_IMAGE_SIDE, MAX_LIGHT_PATHS, MEDIUM_SCALES,
    MEDIUM_SHARES, as_serde,
};
pub(crate) use checks::{check_camera_paths, check_light_paths};
pub(crate) use combinations::check_whole_sets;
pub use crop::Crop;
pub use fixed_array::FixedArray;
pub use length::Length;
pub use region::{Region, check_rectangles};
pub use table::{MIN_SETS, PartialSettings, Settings};

use serde::{Deserialize, Serialize};

/// Technique for light straight from a light source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Direct {
    /// A shadow ray from each diffuse vertex of the camera path.
    #[default]
    Connect,
    /// The photon map, as for all other light.
    PhotonMap,
}

/// Techniques that sample a path: theory.md, section 4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Strategy {
    /// One technique: a merge at vertex `k` (caustics: at all vertices up to `k`), or a connection.
    #[default]
    Single,
    /// Merges at vertices 1 and 2, connections from all vertices and light sources that camera
    /// paths hit, weighted by the balance heuristic.
    Mis,
    /// As [`Self::Mis`], with camera paths that end at vertex 2.
    CutMis,
    /// Connections and light sources that camera paths hit: path tracing without light paths.
    Path,
    /// As [`Self::Path`], with photons of caustics alone, which are merged at all diffuse vertices
    /// and share paths with light sources that camera paths hit.
    PathCaustics,
    /// As [`Self::Path`], with camera paths that end at the diffuse vertex `k` and look the light
    /// up in a cache, which the suffixes of some full paths fill.
    Gather,
    /// As [`Self::Gather`], with full paths as of [`Self::PathCaustics`], and as many light paths
    /// as suffix paths.
    GatherCaustics,
}

/// What a strategy consists of. Code that renders tests no more than this; choices of technique
/// also know which strategy they have measured.
struct Traits {
    has_photons: bool,
    continues: bool,
    is_weighted: bool,
    has_cache: bool,
    only_caustics: bool,
}

impl Strategy {
    /// All strategies.
    pub const ALL: [Self; 7] = [
        Self::Single,
        Self::Mis,
        Self::CutMis,
        Self::Path,
        Self::PathCaustics,
        Self::Gather,
        Self::GatherCaustics,
    ];

    #[inline(always)] // part of vector loops, as the functions below
    const fn traits(self) -> Traits {
        let [has_photons, continues, is_weighted, has_cache, only_caustics] = match self {
            Self::Single => [true, false, false, false, false],
            Self::Mis => [true, true, true, false, false],
            Self::CutMis => [true, false, true, false, false],
            Self::Path => [false, true, true, false, false],
            Self::PathCaustics => [true, true, true, false, true],
            Self::Gather => [false, true, true, true, false],
            Self::GatherCaustics => [true, true, true, true, true],
        };
        Traits { has_photons, continues, is_weighted, has_cache, only_caustics }
    }

    /// Tests whether light paths are traced, and their photons merged.
    #[inline(always)]
    pub const fn has_photons(self) -> bool {
        self.traits().has_photons
    }

    /// Tests whether its photons are those of caustics alone: light paths end at their first
    /// diffuse vertex, and camera paths find all other light.
    #[inline(always)]
    pub const fn has_only_caustics(self) -> bool {
        self.traits().only_caustics
    }

    /// Tests whether camera paths end where a cache knows the light. Its suffix paths then are the
    /// light paths of all formulas.
    #[inline(always)]
    pub const fn has_cache(self) -> bool {
        self.traits().has_cache
    }

    /// Its name in files and options.
    #[inline]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Single => "single",
            Self::Mis => "mis",
            Self::CutMis => "cut-mis",
            Self::Path => "path",
            Self::PathCaustics => "path-caustics",
            Self::Gather => "gather",
            Self::GatherCaustics => "gather-caustics",
        }
    }

    /// What the systematic part of its error is called.
    #[inline]
    pub const fn bias_name(self) -> &'static str {
        if self.has_cache() { "bias of the cache" } else { "merge bias" }
    }

    /// Tests whether pixels share the light of photons or of a cache.
    #[inline]
    pub const fn shares_light(self) -> bool {
        self.has_photons() || self.has_cache()
    }

    /// Tests whether camera paths go on after the last diffuse vertex at which photons may be
    /// merged.
    #[inline(always)]
    pub const fn continues(self) -> bool {
        self.traits().continues
    }

    /// Tests whether several techniques sample a path, so that weights share it among them.
    #[inline(always)]
    pub const fn is_weighted(self) -> bool {
        self.traits().is_weighted
    }

    /// Tests whether merges have weights.
    #[inline]
    pub const fn weighs_merges(self) -> bool {
        self.has_photons() && self.is_weighted()
    }

    /// Tests whether photons of all kinds are merged at the first two diffuse vertices, with
    /// weights.
    #[inline]
    pub const fn merges_twice(self) -> bool {
        self.weighs_merges() && !self.has_only_caustics()
    }
}

/// Area that the flux of merged photons is divided by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kernel {
    /// The area of a disc of the merge radius, as in the paper.
    Disc,
    /// The area of the surface within the merge radius that could have sent a photon: no bias at
    /// edges.
    #[default]
    Area,
}

/// Where camera paths merge photons in media that scatter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MediumQuery {
    /// In balls around the vertices of camera paths: theory.md (37i).
    Points,
    /// In cylinders around all of their segments (the beam radiance estimate): theory.md (37m).
    #[default]
    Beams,
}

/// Treatment of the merge bias, which radii above zero cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Bias {
    /// Keep the bias: the image is the mean of the paper's estimator.
    #[default]
    Keep,
    /// Subtract the bias where it exceeds the noise, estimated from half the radii: theory.md,
    /// section 17a.
    Reduce,
}

/// Constants of the MIS weights. They decide about noise only: the mean of the image is the same
/// for any values. They must not change between iterations of one image, because the law of the
/// noise holds for fixed weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MisScales {
    /// Planned light paths per iteration: theory.md (47c).
    pub light_paths: u32,
    /// Scales of merges at the first and at the second vertex: `c_1`, `c_2` of theory.md.
    pub scales: [f64; 2],
}

impl MisScales {
    /// The constants for these counts of an iteration. Merges count less the more camera paths
    /// share the photons: half of their variance is taken to belong to the photons. The optimum is
    /// flat. theory.md (47h)
    #[inline]
    pub fn new(light_paths: u32, camera_paths: u32) -> Self {
        Self { light_paths, scales: [2.0 / (1.0 + f64::from(camera_paths)); 2] }
    }
}
