//! Predicts the merge bias of one class of photons at any radius, from a trial and a prior.

use super::Technique;
use super::trial::Trial;
use bdpm_core::noise::image::Statistic;
use bdpm_core::noise::merge_bias::weighted_square;
use bdpm_core::settings::Direct;
use bdpm_core::transport::photon::PhotonClass;

/// Factor on the bias from a radius to `1/sqrt(2)` of it, for photons after a diffuse bounce.
///
/// The squared bias of the kernel by true area falls as the cube of the radius along an edge, so
/// that this is `2^(-3/4)`.
pub const TYPICAL_FALL: f64 = 0.5946;

/// [`TYPICAL_FALL`] for light that draws sharp edges (caustics and shadows): the squared bias falls
/// as the square of the radius.
const TYPICAL_SHARP_FALL: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Squared relative bias over the cube of the radius, with the radius in widths of what the image
/// shows. Fixed by trial on the Cornell boxes.
const TYPICAL_BIAS: f64 = 20.0;

/// Squared relative bias over the square of the radius, in the same unit: of caustics, and of
/// direct light from the photon map. Fixed by trial.
const TYPICAL_SHARP_BIAS: [f64; 2] = [5.0, 15.0];

/// Standard deviation of the prior of the squared bias, relative to its mean.
///
/// Standard errors of measured biases are too small where light is rare. A larger value would let
/// such a measurement override the prior.
const PRIOR_SPREAD: f64 = 1.0;

/// Lower bound of a squared bias, relative to the mean of the prior.
const MINIMUM_OF_PRIOR: f64 = 0.05;

/// Squared relative bias at one radius, and how it falls with the radius.
#[derive(Clone, Copy, Debug)]
pub struct BiasLaw {
    /// Scene units.
    pub radius: f64,
    /// Squared relative bias at `radius`.
    pub square: f64,
    /// Standard error of `square`.
    pub error: f64,
    /// Factor on the bias from a radius to `1/sqrt(2)` of it.
    pub falls_to: f64,
}

/// Typical squared relative bias of a cache, where it is corrected: .5 % in rooms.
const CACHE_BIAS: f64 = 0.005 * 0.005;

impl BiasLaw {
    /// Prior of photons of a class or, where there is one, of a cache in place of diffuse photons,
    /// before anything is measured. The image shows the width `across`, scene units.
    pub fn typical(class: PhotonClass, technique: Technique, radius: f64, across: f64) -> Self {
        let share = radius / across;
        let (square, falls_to) = match class {
            // Cells hardly matter: light is averaged over the half space anyway.
            PhotonClass::Diffuse if technique.strategy.has_cache() => (CACHE_BIAS, TYPICAL_FALL),
            PhotonClass::Diffuse => (TYPICAL_BIAS * share.powi(3), TYPICAL_FALL),
            PhotonClass::Caustic => {
                let sharp = TYPICAL_SHARP_BIAS[usize::from(technique.direct == Direct::PhotonMap)];
                (sharp * share.powi(2), TYPICAL_SHARP_FALL)
            }
        };
        Self { radius, square, error: PRIOR_SPREAD * square, falls_to }
    }

    /// The law at another radius as a prior, with an error of at least its own size.
    pub fn prior_at(&self, radius: f64) -> Self {
        let [square, error] = self.at(radius);
        Self { radius, square, error: error.max(PRIOR_SPREAD * square), falls_to: self.falls_to }
    }

    /// Combines this prior with a trial: theory.md (93d).
    pub fn measured(&self, trial: &Trial, weights: &[f64]) -> Self {
        let (Statistic { value, error, .. }, falls_to) = weighted_square(&trial.noise, weights);
        self.combined([value, error], falls_to, self)
    }

    /// Combines this prior with a measured square and its standard error: theory.md (93d). The
    /// `typical` law bounds the result from below.
    pub fn combined(&self, [value, error]: [f64; 2], falls_to: f64, typical: &Self) -> Self {
        let spread = self.error;
        let certainty = spread.powi(2) / (spread.powi(2) + error * error);
        let mixed = |measured: f64, prior: f64| certainty * measured + (1.0 - certainty) * prior;
        Self {
            radius: self.radius,
            square: mixed(value, self.square).max(MINIMUM_OF_PRIOR * typical.square),
            error: error.min(spread),
            falls_to: mixed(falls_to, self.falls_to),
        }
    }

    /// The squared bias and its standard error at another radius: theory.md (93b).
    pub fn at(&self, radius: f64) -> [f64; 2] {
        let scale = self.falls_to.powf(4.0 * (self.radius / radius).log2());
        [scale * self.square.max(0.0), scale * self.error]
    }
}
