//! The result of a trial, which measures one technique at given radii on a sample of the pixels:
//! noise, merge bias and times.

use super::start_up::StartUp;
use crate::timing::TimeModel;
use bdpm_core::noise::Coefficients;
use bdpm_core::noise::image::NoiseImage;
use bdpm_core::transport::kernel::ByClass;
use bdpm_core::transport::photon::PhotonClass;

/// Part of the mean luminance that may be missing from a trial because of its merge bias.
pub const BIAS_TOLERANCE: f64 = 0.05;

/// Result of a trial.
pub struct Trial {
    /// Merge radii, scene units.
    pub radii: ByClass<f64>,
    /// The class of photons whose bias was measured, if any.
    pub nests: Option<PhotonClass>,
    /// Noise of the sample of the pixels.
    pub noise: NoiseImage,
    /// Times of an iteration of the whole image.
    pub times: TimeModel,
    /// Start-up of the whole image at these radii; `None` without areas.
    pub start_up: Option<StartUp>,
    /// Second moment of the contribution of a light path to a camera path, relative, if photons
    /// were spread evenly over all surfaces.
    pub even: f64,
    /// Coefficients of light that the trial missed, relative.
    pub missed: Coefficients,
    /// Whether there were photons that merge at every vertex.
    pub has_caustic_photons: bool,
    /// Whether photons are merged.
    pub merges: bool,
}

/// Share of the light that an image of this mean luminance lacks beyond its merge bias, if it is
/// at least `least`.
pub fn missed_share(luminance: f64, least: f64) -> f64 {
    let share = 1.0 - luminance / least - BIAS_TOLERANCE;
    if share > 0.0 && least > 0.0 { share } else { 0.0 }
}

/// Noise of light of which so many `paths` missed a share: light paths if photons are merged.
/// theory.md (93f)
pub fn missed_light(merges: bool, paths: f64, share: f64) -> Coefficients {
    let missed = paths * share.powi(2);
    let [b, f] = if merges { [0.0, missed] } else { [missed, 0.0] };
    Coefficients { a: 0.0, b, f }
}

impl Trial {
    /// Mean luminance of the sample, W/(m^2 sr).
    pub fn luminance(&self) -> f64 {
        let pixels = &self.noise.pixels;
        pixels.iter().map(|pixel| pixel.luminance).sum::<f64>() / pixels.len() as f64
    }

    /// Mean luminance that the sample has at least: two standard errors below the mean of the
    /// trial, as if all pixels saw the same photons.
    pub fn least_luminance(&self) -> f64 {
        let NoiseImage { pixels, iterations, light_paths, .. } = &self.noise;
        let (count, iterations) = (pixels.len() as f64, *iterations as f64);
        let sampled = pixels.iter().map(|pixel| pixel.noise.sampled).sum::<f64>() / count;
        let f = pixels.iter().map(|pixel| pixel.noise.coefficients.f.max(0.0)).sum::<f64>() / count;
        let error2 = (sampled / count + f / f64::from(*light_paths)) / iterations;
        self.luminance() - 2.0 * error2.sqrt()
    }

    /// Adds the noise of light that the trial missed, because it found it too rarely: the image has
    /// at least this mean luminance. If `n` paths miss a share `d` of the light, few of them carry
    /// it, and its second moment is about `n d^2`. theory.md (93f)
    pub fn set_missed_light(&mut self, least_luminance: f64) {
        let share = missed_share(self.luminance(), least_luminance);
        let NoiseImage { pixels, iterations, light_paths, camera_paths, .. } = &self.noise;
        let camera_paths = pixels.len() as f64 * f64::from(*camera_paths);
        let paths = if self.merges { f64::from(*light_paths) } else { camera_paths };
        self.missed = missed_light(self.merges, paths * *iterations as f64, share);
    }

    /// Mean coefficients over weighted pixels. While few pixels have received photons, evenly
    /// spread light counts as one more pixel: theory.md (93e).
    pub fn relative(&self, weights: &[f64]) -> Coefficients {
        let weighted = self.noise.pixels.iter().zip(weights);
        let sum: Coefficients = weighted.map(|(pixel, &w)| pixel.noise.coefficients * w).sum();
        let mean = (sum * (weights.len() as f64).recip()).clamped();
        let more = (self.even - (mean.a + mean.f)).max(0.0) / (self.lit_pixels(weights) + 1.0);
        Coefficients { f: mean.f + more, ..mean } + self.missed
    }

    /// Effective number of pixels that have received photons: theory.md (93e).
    pub fn lit_pixels(&self, weights: &[f64]) -> f64 {
        let (mut sum, mut squares) = (0.0, 0.0);
        for (pixel, &weight) in self.noise.pixels.iter().zip(weights) {
            let Coefficients { a, f, .. } = pixel.noise.coefficients;
            sum += (a + f) * weight;
            squares += ((a + f) * weight).powi(2);
        }
        if squares > 0.0 { sum * sum / squares } else { 0.0 }
    }
}
