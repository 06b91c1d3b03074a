//! The noise model: `V(N_F, N_B) = a/(N_F N_B) + b/N_B + f/N_F`, and its three coefficients.
//!
//! `N_F` light paths and `N_B` camera paths meet in pairs that contribute `C_ij = I_ij + D_j` to a
//! pixel. Equation (1) of the paper and of docs/explanation/theory.md is proved there in section
//! 13. It is the two-way random-effects decomposition of the variance of their mean, with
//!
//! ```text
//! a = C2 - B - F + L^2    interaction           C2 = <<C^2>>
//! b = B - L^2             camera main effect    B  = <<C>_F^2>_B
//! f = F - L^2             light main effect     F  = <<C>_B^2>_F
//! ```
//!
//! None of the coefficients depends on the two counts.

pub mod merge_bias;
mod tile_map;
pub mod difference;
pub mod file;
pub mod film;
pub mod halves;
pub mod image;
pub mod pair_table;
pub mod pairs;
#[cfg(feature = "pictures")]
pub mod picture;
pub mod rare_light;
pub mod region;
pub mod schedule;
pub mod significance;
pub mod summary;

use bytemuck::Zeroable;
use serde::{Deserialize, Serialize};
use std::ops::{Add, AddAssign, Mul, Sub};

/// The three coefficients of a pixel, or their mean over pixels, squared luminance.
///
/// Estimates from few iterations may be negative: average before clamping.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Zeroable)]
pub struct Coefficients {
    /// Interaction of light and camera paths.
    pub a: f64,
    /// Camera main effect.
    pub b: f64,
    /// Light main effect.
    pub f: f64,
}

impl Coefficients {
    /// Variance of one iteration's value at `n_light` light and `n_camera` camera paths.
    // theory.md (1), (2)
    #[inline]
    pub fn variance(&self, n_light: f64, n_camera: f64) -> f64 {
        let [interaction, camera, light] = self.terms(n_light, n_camera);
        interaction + camera + light
    }

    /// Coefficients for numbers of light paths, from those for numbers of samples of as many light
    /// paths each. For a fixed size of the samples `V` has the same form in both numbers.
    // theory.md (40e)
    #[must_use]
    #[inline]
    pub fn per_light_path(self, per_sample: f64) -> Self {
        Self { a: self.a * per_sample, b: self.b, f: self.f * per_sample }
    }

    /// The coefficients with 0 in place of negative ones.
    #[must_use]
    #[inline]
    pub fn clamped(self) -> Self {
        Self { a: self.a.max(0.0), b: self.b.max(0.0), f: self.f.max(0.0) }
    }

    /// The three summands of [`Self::variance`].
    // theory.md (2)
    #[inline]
    pub fn terms(&self, n_light: f64, n_camera: f64) -> [f64; 3] {
        [self.a / (n_light * n_camera), self.b / n_camera, self.f / n_light]
    }

    /// The three summands as the paper writes (1), from `C2 - L^2`, `B - L^2`, `F - L^2`. They have
    /// the sum of [`Self::terms`].
    // theory.md (1)
    #[inline]
    pub fn paper_terms(&self, n_light: f64, n_camera: f64) -> [f64; 3] {
        let Self { a, b, f } = *self;
        [
            (a + b + f) / (n_light * n_camera),
            (1.0 - 1.0 / n_light) * b / n_camera,
            (1.0 - 1.0 / n_camera) * f / n_light,
        ]
    }
}

impl Add for Coefficients {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self { a: self.a + other.a, b: self.b + other.b, f: self.f + other.f }
    }
}

impl Sub for Coefficients {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        self + other * -1.0
    }
}

impl Mul<f64> for Coefficients {
    type Output = Self;

    #[inline]
    fn mul(self, scale: f64) -> Self {
        Self { a: self.a * scale, b: self.b * scale, f: self.f * scale }
    }
}

impl AddAssign for Coefficients {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl std::iter::Sum for Coefficients {
    #[inline]
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        terms.fold(Self::default(), Add::add)
    }
}

/// Whether an iteration measures the coefficients, and how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Measure {
    /// Production: the image only.
    #[default]
    Off,
    /// All pairs ([`pairs`]).
    Pairs,
    /// The paper's halves ([`halves`]).
    Halves,
}

/// Estimates the coefficients of one pixel from the pairs of one iteration.
///
/// Light paths are numbered by independent samples: each is one, or a set of them is, which
/// contributes the mean over its light paths.
///
/// Calls come in this order: [`start_pixel`](Self::start_pixel), then for each camera path any
/// number of [`pair`](Self::pair) and one [`end_path`](Self::end_path), then
/// [`finish_pixel`](Self::finish_pixel). All values are luminances.
pub trait Estimator: Default + Send {
    /// Clears the sums of the previous pixel.
    fn start_pixel(&mut self);

    /// Light path `light_path` contributes `value` more to the current camera path.
    fn pair(&mut self, light_path: u32, value: f64);

    /// The current camera path is complete; `direct` is its `D_j`.
    fn end_path(&mut self, direct: f64, n_light: u32);

    /// Unbiased estimates for any `n_light` and `n_camera` of at least 2, `n_camera` being the
    /// number of paths that ended.
    fn finish_pixel(&mut self, n_light: u32, n_camera: u32) -> Coefficients;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paper_terms_add_up_to_the_variance() {
        let c = Coefficients { a: 3595.0, b: 37.18, f: 0.3788 };
        for (n_light, n_camera) in [(1.0, 1.0), (1000.0, 25.0), (3e5, 7.0)] {
            let sum: f64 = c.paper_terms(n_light, n_camera).iter().sum();
            let variance = c.variance(n_light, n_camera);
            assert!((sum / variance - 1.0).abs() < 1e-12, "{sum} {variance}");
        }
        // At one path of each kind it is the variance of a single pair, a + b + f = C2 - L^2.
        assert!((c.variance(1.0, 1.0) - (c.a + c.b + c.f)).abs() < 1e-9);
    }
}
