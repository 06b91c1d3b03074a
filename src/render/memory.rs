//! Whether an image fits in the memory, before anything is allocated.

use super::bias_correction::BiasCorrection;
use crate::base::error::{Error, Result};
use crate::base::memory::{GIB, available_memory};
use crate::film::annulus::Annulus;
use crate::film::aov::AovSelection;
use crate::film::radiance::PixelSums;
use crate::noise::film::{BatchGrain, NoiseFilm};
use crate::scene::Scene;
use crate::scene::bsdf::Bsdf;
use crate::settings::{Bias, Settings, Strategy};
use crate::transport::photon::Photon;

/// Bytes that a light path takes on average: it leaves at most 1/(1 - albedo) photons. Surfaces that
/// only pass it on leave none.
pub(super) fn bytes_per_light_path(scene: &Scene, settings: &Settings) -> f64 {
    let storing = scene.materials().iter().map(|m| m.bsdf).filter(Bsdf::merges);
    let albedo = storing.map(|bsdf| bsdf.albedo().max_element()).fold(0.0, f32::max);
    let photons_per_path = (1.0 - f64::from(albedo)).recip().min(20.0);
    photons_per_path * bytes_per_photon(settings)
}

/// As traced, while sorting with its bucket in two orders, and in the map with up to eight buckets; each time with
/// its part of a weight where paths are weighted.
fn bytes_per_photon(settings: &Settings) -> f64 {
    let part = if settings.strategy == Strategy::Mis { size_of::<f32>() } else { 0 };
    (3 * (size_of::<Photon>() + part) + 2 * 4 + 8 * 4) as f64
}

/// The light paths, each of so many photons on average, that fit in so many bytes of memory beside
/// the image; below 1 where not even one fits.
pub fn light_paths_in(memory: f64, photons_per_path: f64, settings: &Settings) -> f64 {
    (memory - film_bytes(settings, AovSelection::default(), 1))
        / (photons_per_path * bytes_per_photon(settings))
}

/// Bytes of the image under way: sums of the image and the noise and counts of each block, the image
/// and what is being written.
pub(super) fn film_bytes(settings: &Settings, kept: AovSelection, blocks: usize) -> f64 {
    let written = 2 * size_of::<PixelSums>();
    let block = size_of::<PixelSums>() + NoiseFilm::bytes_per_pixel(BatchGrain::Tile);
    let (in_blocks, once) = kept.bytes_per_pixel();
    let (beyond, reducing) = match settings.bias {
        Bias::Reduce => (Annulus::BYTES, BiasCorrection::BYTES),
        Bias::Keep => (0, 0),
    };
    let per_pixel =
        written + once + reducing + blocks * (block + beyond + size_of::<u32>() + in_blocks);
    settings.pixels() as f64 * per_pixel as f64
}

/// Refuses counts that cannot fit, before anything is allocated.
pub(super) fn check_memory(
    scene: &Scene,
    settings: &Settings,
    kept: AovSelection,
    light_paths: u32,
) -> Result<()> {
    let light = f64::from(light_paths) * bytes_per_light_path(scene, settings);
    // Those of earlier blocks are no longer available.
    let film = film_bytes(settings, kept, 1);
    let needed = light + film;
    match available_memory() {
        Some(available) if needed > available => Err(Error::new(
            format!(
                "about {:.1} GiB of memory are needed, {:.1} GiB for {light_paths} light paths and \
                 {:.1} GiB for {}x{} pixels, but {:.1} GiB are available",
                needed / GIB,
                light / GIB,
                film / GIB,
                settings.width,
                settings.height,
                available / GIB,
            ),
            "lower --light-paths or --resolution; more iterations make up for fewer light paths",
        )),
        _ => Ok(()),
    }
}
