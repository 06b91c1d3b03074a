//! The paper's estimator (Sections 3 and 4): products of means over halves of the paths.

use super::pair_table::{PairSum, PairTable};
use super::{Coefficients, Estimator};

/// Halves by parity of the light path's id and of the camera path's number in its pixel; with odd
/// counts the even half is larger by one.
#[derive(Debug, Default)]
pub struct Halves {
    light_paths: PairTable<LightPathSums>,
    /// Number of the current camera path, from 0.
    camera_path: u32,
    /// `sum_i I_ij` over each half of the light paths, of the current camera path.
    i_j: [f64; 2],
    /// Pairs of the current camera path, `sum_i I_ij^2`.
    q_j: f64,
    /// `sum_ij (I_ij^2 + 2 I_ij D_j)`.
    c: f64,
    /// `sum_j B_1(j) B_2(j)`.
    b: f64,
    /// `sum_ij I_ij` over `[half of i][half of j]`.
    i: [[f64; 2]; 2],
    /// `sum_j D_j` over each half of the camera paths, and `sum_j D_j^2`.
    d: [f64; 2],
    d2: f64,
}

/// Sums of one light path over the current pixel.
#[derive(Clone, Copy, Debug, Default)]
struct LightPathSums {
    /// `sum_j I_ij` over each half of the camera paths.
    i_i: [f64; 2],
    pair: PairSum,
}

/// Sizes of the even and the odd half of `count` paths.
#[inline]
fn half_sizes(count: u32) -> [f64; 2] {
    [f64::from(count.div_ceil(2)), f64::from(count / 2)]
}

impl Estimator for Halves {
    #[inline]
    fn start_pixel(&mut self) {
        self.light_paths.clear();
        let light_paths = std::mem::take(&mut self.light_paths);
        *self = Self { light_paths, ..Self::default() };
    }

    #[inline]
    fn pair(&mut self, light_path: u32, value: f64) {
        let entry = self.light_paths.entry(light_path);
        self.q_j += entry.pair.add(self.camera_path + 1, value);
        self.i_j[(light_path & 1) as usize] += value;
        entry.i_i[(self.camera_path & 1) as usize] += value;
    }

    #[inline]
    fn end_path(&mut self, direct: f64, n_light: u32) {
        let n_f = half_sizes(n_light);
        let half = (self.camera_path & 1) as usize;
        let [even, odd] = self.i_j;
        // theory.md (58)
        self.c += self.q_j + 2.0 * (even + odd) * direct;
        // B_k(j) = D_j + 1/N_Fk sum_i I_ij
        // theory.md (56), (59)
        self.b += (direct + even / n_f[0]) * (direct + odd / n_f[1]);
        self.i[0][half] += even;
        self.i[1][half] += odd;
        self.d[half] += direct;
        self.d2 += direct * direct;
        (self.i_j, self.q_j) = ([0.0; 2], 0.0);
        self.camera_path += 1;
    }

    #[inline]
    fn finish_pixel(&mut self, n_light: u32, n_camera: u32) -> Coefficients {
        let (n_f, n_b) = (f64::from(n_light), f64::from(n_camera));
        let (n_fk, n_bk) = (half_sizes(n_light), half_sizes(n_camera));
        let c2 = self.c / (n_f * n_b) + self.d2 / n_b;
        let b = self.b / n_b;
        // F_k(i) = F_k^(I)(i) + F_k^(0): the products of its parts, summed over i.
        // theory.md (57), (60)
        let f0 = [self.d[0] / n_bk[0], self.d[1] / n_bk[1]];
        let products: f64 = self
            .light_paths
            .values()
            .map(|path| {
                let [f1, f2] = [path.i_i[0] / n_bk[0], path.i_i[1] / n_bk[1]];
                f1 * f2 + f1 * f0[1] + f2 * f0[0]
            })
            .sum();
        let f = products / n_f + f0[0] * f0[1];
        // L^2 is from this iteration too, so that the first-order noise of F - L^2 cancels. The
        // means are over [half of i][half of j]; opposite ones are independent. theory.md (61)
        let mean = |i: usize, j: usize| self.i[i][j] / (n_fk[i] * n_bk[j]) + f0[j];
        let l2 = 0.5 * (mean(0, 0) * mean(1, 1) + mean(0, 1) * mean(1, 0));
        Coefficients { a: c2 - b - f + l2, b: b - l2, f: f - l2 }
    }
}
