//! All pairs: unbiased `a`, `b`, `f` from the pairs of a single iteration (the default estimator).

use super::pair_table::{PairSum, PairTable};
use super::{Coefficients, Estimator};

/// Six sums over the touched pairs of a pixel, with `S_j = sum_i I_ij` and `T_i = sum_j I_ij`.
///
/// Squares are updated with their terms, `(x + v)^2 = x^2 + v (2x + v)`, so that neither `T_i` nor
/// the pairs need a second pass.
// theory.md (51)
#[derive(Debug, Default)]
pub struct AllPairs {
    light_paths: PairTable<LightPathSums>,
    /// Number of the current camera path, from 1.
    camera_path: u32,
    /// `S_j` of the current camera path.
    s_j: f64,
    /// `S = sum_ij I_ij`.
    s: f64,
    /// `sum_j S_j^2`.
    s_j2: f64,
    /// `sum_i T_i^2`.
    t_i2: f64,
    /// `Q = sum_ij I_ij^2`.
    q: f64,
    /// `sum_j x_j` and `sum_j x_j^2` of `x_j = S_j/N_F + D_j`, minus the first `x_j` for accuracy.
    shift: f64,
    x: f64,
    x2: f64,
}

/// Sums of one light path over the current pixel.
#[derive(Clone, Copy, Debug, Default)]
struct LightPathSums {
    /// `T_i` so far.
    t_i: f64,
    pair: PairSum,
}

impl Estimator for AllPairs {
    #[inline]
    fn start_pixel(&mut self) {
        self.light_paths.clear();
        let light_paths = std::mem::take(&mut self.light_paths);
        *self = Self { light_paths, camera_path: 1, ..Self::default() };
    }

    #[inline]
    fn pair(&mut self, light_path: u32, value: f64) {
        let entry = self.light_paths.entry(light_path);
        self.q += entry.pair.add(self.camera_path, value);
        self.t_i2 += value * (2.0 * entry.t_i + value);
        self.s_j += value;
        entry.t_i += value;
    }

    #[inline]
    fn end_path(&mut self, direct: f64, n_light: u32) {
        let x = self.s_j / f64::from(n_light) + direct;
        if self.camera_path == 1 {
            self.shift = x;
        }
        self.x += x - self.shift;
        self.x2 += (x - self.shift).powi(2);
        self.s += self.s_j;
        self.s_j2 += self.s_j.powi(2);
        self.s_j = 0.0;
        self.camera_path += 1;
    }

    /// Takes `a` and `f` from the merged light alone, so that they have no noise of the direct
    /// light.
    // theory.md (51) to (54)
    #[inline]
    fn finish_pixel(&mut self, n_light: u32, n_camera: u32) -> Coefficients {
        let (n_f, n_b) = (f64::from(n_light), f64::from(n_camera));
        let Self { s, s_j2, t_i2, q, x, x2, .. } = *self;
        // theory.md (52)
        let c2_i = q / (n_f * n_b);
        let b_i = (s_j2 - q) / (n_b * n_f * (n_f - 1.0));
        let f_i = (t_i2 - q) / (n_f * n_b * (n_b - 1.0));
        let l2_i = (s * s - s_j2 - t_i2 + q) / (n_f * (n_f - 1.0) * n_b * (n_b - 1.0));
        // theory.md (53)
        let a = c2_i - b_i - f_i + l2_i;
        let f = f_i - l2_i;
        let sample_variance = (x2 - x * x / n_b) / (n_b - 1.0);
        // theory.md (54)
        Coefficients { a, b: sample_variance - a / n_f, f }
    }
}
