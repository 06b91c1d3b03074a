//! The merge bias of a class of photons at any radius: what a trial saw of it, mixed with what is typical.

use super::Technique;
use super::trial::Trial;
use crate::noise::bias::weighted_square;
use crate::noise::image::Statistic;
use crate::settings::policy::*;
use crate::settings::{Direct, Kernel};
use crate::transport::photon::PhotonClass;

/// Squared relative bias at a radius, and how it falls.
#[derive(Clone, Copy, Debug)]
pub struct Bias {
    pub radius: f64,
    pub square: f64,
    /// Standard error of `square`.
    pub error: f64,
    /// From a radius to `1/sqrt(2)` of it.
    pub falls_to: f64,
}

/// Squared bias of light of a kind where nothing is known of it.
#[derive(Clone, Copy, Debug)]
pub struct Typical {
    square: f64,
    falls_to: f64,
    /// The least that is believed.
    least: f64,
}

impl Typical {
    /// At a radius in widths of what the image shows.
    pub fn new(class: PhotonClass, technique: Technique, radius: f64) -> Self {
        let disc = technique.kernel == Kernel::Disc;
        let (square, falls_to) = match (class, disc) {
            (PhotonClass::Diffuse, false) => (TYPICAL_BIAS * radius.powi(3), TYPICAL_FALL),
            (PhotonClass::Diffuse, true) => (DISC_BIAS * TYPICAL_BIAS * radius.powi(3), DISC_FALL),
            (PhotonClass::Caustic, _) => {
                let sharp = TYPICAL_SHARP_BIAS[usize::from(technique.direct == Direct::PhotonMap)];
                (sharp * radius.powi(2), TYPICAL_SHARP_FALL)
            }
        };
        Self { square, falls_to, least: LEAST_OF_PRIOR[usize::from(disc)] * square }
    }
}

impl Bias {
    /// Of a trial at this radius: theory.md (93d).
    pub fn new(trial: &Trial, radius: f64, weights: &[f64], typical: Typical) -> Self {
        let (Statistic { value, error, .. }, falls_to) = weighted_square(&trial.noise, weights);
        let spread = PRIOR_SPREAD * typical.square;
        let certainty = spread.powi(2) / (spread.powi(2) + error * error);
        let mixed =
            |measured: f64, typical: f64| certainty * measured + (1.0 - certainty) * typical;
        Self {
            radius,
            square: mixed(value, typical.square).max(typical.least),
            error: error.min(spread),
            falls_to: mixed(falls_to, typical.falls_to),
        }
    }

    /// Where no trial has told anything.
    pub fn typical(radius: f64, Typical { square, falls_to, .. }: Typical) -> Self {
        Self { radius, square, error: PRIOR_SPREAD * square, falls_to }
    }

    /// The square and its standard error at another radius: theory.md (93b).
    pub fn at(&self, radius: f64) -> [f64; 2] {
        let scale = self.falls_to.powf(4.0 * (self.radius / radius).log2());
        [scale * self.square.max(0.0), scale * self.error]
    }
}
