//! What is kept beside an image, and other choices of a renderer that its settings do not make.

use crate::film::aov::AovSelection;
use crate::film::statistic::{BatchGrain, StatisticRequest};
use crate::settings::Settings;
use crate::transport::photon::PhotonClass;
use serde::{Deserialize, Serialize};

/// A part of the merges, whose bias is measured alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum NestedPart {
    /// Photons of a class. The radii of both classes must differ.
    Class(PhotonClass),
    /// Photons in media.
    Media,
}

/// Statistics that are kept beside the image, and other choices that do not change the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RenderConfig {
    /// Layers that are kept beside the image.
    pub aovs: AovSelection,
    /// Resolution of the batches of measured iterations.
    pub grain: BatchGrain,
    /// If set, measured iterations merge at nested radii for this part of the merges only, and the
    /// nested differences estimate the bias of that part.
    pub nested_part: Option<NestedPart>,
    /// Renders nothing but light that no camera path finds: of lights that no ray can hit, through
    /// glass or mirrors.
    pub photon_only: bool,
    /// All numbers of camera paths are independent, also those that would be Sobol points. What
    /// looks at few iterations needs this: an audit, trials of the pilot. So do meters, which are
    /// no pixels.
    pub independent_paths: bool,
    /// Leaves out light sources that paths hit before a diffuse vertex. Their noise is the same
    /// with every technique: a lamp that fills a part of a pixel can hide all differences between
    /// them.
    pub hides_lights: bool,
    /// Number of processes that render the image together. Reported times are divided by it.
    pub ranks: u32,
}

impl Default for RenderConfig {
    fn default() -> Self {
        let (aovs, grain) = (AovSelection::default(), BatchGrain::default());
        Self {
            aovs,
            grain,
            nested_part: None,
            photon_only: false,
            independent_paths: false,
            hides_lights: false,
            ranks: 1,
        }
    }
}

impl RenderConfig {
    /// Batches of single pixels, for [`Block::noise_image`](super::block::Block::noise_image).
    pub fn with_pixel_batches() -> Self {
        Self { grain: BatchGrain::Pixel, ..Self::default() }
    }

    /// The statistics of an image with these settings.
    pub fn request<'a>(&self, settings: &'a Settings) -> StatisticRequest<'a> {
        let Self { aovs, grain, independent_paths, .. } = *self;
        StatisticRequest { settings, aovs, grain, measured_before: None, independent_paths }
    }
}
