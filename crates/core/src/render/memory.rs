//! Check that an image fits in the memory, before anything is allocated.

use super::RenderConfig;
use super::accumulators::{BlockStatistics, SharedStatistics};
use super::bias_correction::BiasCorrection;
use crate::base::error::{Error, Result};
use crate::base::math::Rgb;
use crate::base::memory::{GIB, available_memory};
use crate::film::aov::AovSelection;
use crate::film::cells::CellGrid;
use crate::film::radiance::PixelSums;
use crate::film::statistic::StatisticRequest;
use crate::scene::bsdf::Bsdf;
use crate::scene::{Media, Scene};
use crate::settings::Settings;
use crate::transport::mis::weights::PhotonPartials;
use crate::transport::near_planes::NearPlanes;
use crate::transport::photon::Photon;
use crate::transport::suffix_cache::SuffixRecord;

/// Mean memory of a light path, bytes. A path stores at most `1/(1 - albedo)` photons on average;
/// surfaces with specular reflection only store none. The same holds in media. Splitting multiplies
/// their number.
pub(super) fn bytes_per_light_path(scene: &Scene, settings: &Settings) -> f64 {
    let suffixes = if settings.has_cache() { SUFFIXES_PER_PATH * BYTES_PER_SUFFIX } else { 0.0 };
    if !settings.has_photons() || settings.strategy.has_only_caustics() {
        let photons = if settings.has_photons() { bytes_per_photon(settings) } else { 0.0 };
        return suffixes + photons;
    }
    let storing = scene.materials().iter().map(|m| m.bsdf).filter(Bsdf::merges);
    let albedo = storing.map(|bsdf| bsdf.albedo().max_element()).fold(0.0, f32::max);
    let in_media = scene.media().map_or(0.0, Media::largest_albedo);
    let albedo = albedo.max(in_media);
    let photons_per_path = (1.0 - f64::from(albedo)).recip().min(20.0);
    // Planes around photons near surfaces
    let planes = if in_media > 0.0 { size_of::<NearPlanes>() } else { 0 };
    f64::from(settings.splitting) * photons_per_path * (bytes_per_photon(settings) + planes as f64)
}

/// Suffixes of a camera path in bright rooms, on average.
const SUFFIXES_PER_PATH: f64 = 10.0;

/// Memory of a suffix, bytes: in its batch, among all, and with its key while they are sorted.
const BYTES_PER_SUFFIX: f64 = (2 * size_of::<SuffixRecord>() + 16) as f64;

/// Memory of a photon, bytes: as traced, while it is sorted with its bucket in two orders, and in
/// the map, where its normal takes 4 bytes more, with up to eight buckets. MIS adds partials each
/// time.
fn bytes_per_photon(settings: &Settings) -> f64 {
    let weight = if settings.strategy.is_weighted() { size_of::<PhotonPartials>() } else { 0 };
    (3 * (size_of::<Photon>() + weight) + 2 * 4 + 4 + 8 * 4) as f64
}

/// Number of light paths with `photons_per_path` photons on average that fit in `memory` bytes
/// beside the image; below 1 if not even one fits.
pub fn light_paths_in(memory: f64, photons_per_path: f64, settings: &Settings) -> f64 {
    (memory - film_bytes(&RenderConfig::default().request(settings), 1))
        / (photons_per_path * bytes_per_photon(settings))
}

/// Memory per pixel of an image with `blocks` blocks, bytes: all statistics, the path counts of all
/// blocks but the first, and the combined image.
pub fn bytes_per_pixel(request: &StatisticRequest, blocks: usize) -> f64 {
    let cell = CellGrid::of(request.settings.resolution()).pixels_per_cell();
    let correction = if request.settings.corrects_bias() { BiasCorrection::BYTES } else { 0 };
    let block = size_of::<PixelSums>() as f64 + BlockStatistics::bytes_per_pixel(request);
    let combined = size_of::<Rgb>() + request.aovs.output_bytes_per_pixel();
    combined as f64
        + SharedStatistics::bytes_per_pixel(request)
        + correction.max(ESTIMATE_BYTES) as f64 / cell
        + blocks as f64 * block
        + blocks.saturating_sub(1).max(1) as f64 * size_of::<u32>() as f64
}

/// Memory per cell of estimates of noise and error: variances, weights and coefficients with their
/// smoothed copies.
const ESTIMATE_BYTES: usize = 32 * size_of::<f64>();

/// [`bytes_per_pixel`] of all pixels.
pub(super) fn film_bytes(request: &StatisticRequest, blocks: usize) -> f64 {
    request.settings.pixels() as f64 * bytes_per_pixel(request, blocks)
}

/// Memory of a render, bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MemoryNeed {
    /// Photons and other data of the light paths of an iteration.
    pub light_paths: f64,
    /// Statistics of all pixels.
    pub image: f64,
}

impl MemoryNeed {
    pub(super) fn new(scene: &Scene, request: &StatisticRequest, light_paths: u32) -> Self {
        Self {
            light_paths: f64::from(light_paths) * bytes_per_light_path(scene, request.settings),
            // The memory of earlier blocks is no longer available.
            image: film_bytes(request, 1),
        }
    }

    /// Memory of a render of the scene with these settings and layers.
    pub fn of_image(scene: &Scene, settings: &Settings, aovs: AovSelection) -> Self {
        let config = RenderConfig { aovs, ..RenderConfig::default() };
        Self::new(scene, &config.request(settings), settings.light_paths)
    }

    /// Sum of both parts.
    pub fn total(&self) -> f64 {
        self.light_paths + self.image
    }

    /// Refuses more memory than is available. The settings are those that need it.
    ///
    /// # Errors
    /// Names the needed and the available memory.
    pub fn check(&self, settings: &Settings) -> Result<()> {
        match available_memory() {
            Some(available) if self.total() > available => Err(Error::new(
                format!(
                    "about {:.1} GiB of memory are needed, {:.1} GiB for {} light paths and {:.1} GiB for {}x{} \
                     pixels, but {:.1} GiB are available",
                    self.total() / GIB,
                    self.light_paths / GIB,
                    settings.light_paths,
                    self.image / GIB,
                    settings.width,
                    settings.height,
                    available / GIB,
                ),
                "use fewer light paths or a lower resolution; more iterations make up for fewer light paths",
            )),
            _ => Ok(()),
        }
    }
}

/// Refuses light paths and statistics that do not fit in the available memory.
pub(super) fn check_memory(
    scene: &Scene,
    request: &StatisticRequest,
    light_paths: u32,
) -> Result<()> {
    let settings = Settings { light_paths, ..request.settings.clone() };
    MemoryNeed::new(scene, request, light_paths).check(&settings)
}
