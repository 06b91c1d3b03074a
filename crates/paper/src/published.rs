//! The numbers in the paper's figures and tables.
//!
//! No unit of light is given and the machine is not ours, so that ratios can be compared,
//! luminances and times cannot.

use serde::Serialize;

/// `N_F` of Figures 2 and 3.
pub const LIGHT_PATHS: u32 = 1000;

/// `N_B` of Figures 2 and 3a and of Table 2, and of Figure 3b.
pub const CAMERA_PATHS: [u32; 2] = [25, 100];

/// Time of rendering in Tables 1 and 2 and in Figure 4, seconds.
pub const TIME: f64 = 1000.0;

/// Region means in Figure 2: RMS sampled, and by formula.
pub const FIGURE_2: [f64; 2] = [1.2767, 1.2769];

/// Region means in Figure 3 at `N_B = 25` and `100`.
pub const FIGURE_3: [Terms; 2] = [
    Terms { roots: [0.381_206_5, 1.218_83, 0.019_07], total: 1.276_89 },
    Terms { roots: [0.196_02, 0.610_129, 0.020_410_5], total: 0.639_361 },
];

/// `N_B` of the columns of Table 1.
pub const TABLE_1_CAMERA_PATHS: [u32; 4] = [5, 10, 25, 100];

/// Table 1: `N_F`, and the RMS after [`TIME`] at each `N_B`.
pub const TABLE_1: [(u32, [f64; 4]); 6] = [
    (100, [0.135, 0.135, 0.135, 0.135]),
    (1000, [0.101, 0.101, 0.101, 0.101]),
    (3000, [0.099, 0.099, 0.099, 0.099]),
    (10_000, [0.101, 0.101, 0.101, 0.101]),
    (30_000, [0.110, 0.110, 0.109, 0.109]),
    (100_000, [0.136, 0.136, 0.135, 0.135]),
];

/// Table 2, for 25 camera paths per pixel.
pub const TABLE_2: [Table2Column; 6] = [
    Table2Column::new(1000, 0.1, 1.277, 160.0, 6.25, [6.0, 0.0, 0.25]),
    Table2Column::new(3000, 0.098, 1.234, 158.0, 6.33, [6.0, 0.0, 0.33]),
    Table2Column::new(10_000, 0.1, 1.224, 149.0, 6.7, [6.0, 0.0, 0.7]),
    Table2Column::new(30_000, 0.11, 1.222, 130.0, 7.7, [6.0, 0.0, 1.7]),
    Table2Column::new(100_000, 0.13, 1.21, 89.0, 11.25, [6.0, 0.05, 5.2]),
    Table2Column::new(300_000, 0.18, 1.202, 47.0, 21.47, [6.0, 0.17, 15.3]),
];

/// The minimum that the authors read off Figure 4.
pub const BEST_LIGHT_PATHS: f64 = 3100.0;

/// Region means of the roots of the three terms of (1), and of the root of their sum.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Terms {
    /// The C, B and F term.
    pub roots: [f64; 3],
    /// Mean RMS of one iteration.
    pub total: f64,
}

/// A column of Table 2.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Table2Column {
    /// `N_F`.
    pub light_paths: u32,
    /// RMS after [`TIME`], `sqrt(V_T)`.
    pub rms_after: f64,
    /// RMS of one iteration, `sqrt(V)`.
    pub rms: f64,
    /// `N_I`, iterations in the time.
    pub iterations: f64,
    /// `tau`, seconds per iteration.
    pub time: f64,
    /// Times of the camera, light (about 0 where 0) and merge phase, seconds.
    pub parts: [f64; 3],
}

impl Table2Column {
    const fn new(
        light_paths: u32,
        rms_after: f64,
        rms: f64,
        iterations: f64,
        time: f64,
        parts: [f64; 3],
    ) -> Self {
        Self { light_paths, rms_after, rms, iterations, time, parts }
    }
}
