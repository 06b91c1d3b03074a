//! Which iterations are measured.

use super::Measure;
use crate::film::counts::Counts;
use crate::settings::Settings;
use serde::{Deserialize, Serialize};

/// Measured iterations at the start of a render at fixed counts: the fewest from which batches of
/// two iterations yield a standard error.
const FIXED_PILOT: u64 = 8;

/// After the pilot, one of this many iterations is measured. With a million light paths a measured
/// iteration takes 1.5 times as long as another one (`docs/measurements/performance.md`), so that
/// measuring costs at most 6 % of the time.
pub const MEASURE_EVERY: u64 = 8;

/// Number of measured iterations among the first `iterations` at equal counts.
pub fn measured_before(iterations: u64) -> u64 {
    let pilot = iterations.min(FIXED_PILOT);
    pilot + iterations.div_ceil(MEASURE_EVERY) - pilot.div_ceil(MEASURE_EVERY)
}

/// Which iterations of a block are measured, by their index in the block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeasureSchedule {
    /// First iterations, which are all measured.
    pub pilot: u64,
    /// One of this many of the other iterations is measured.
    pub every: u64,
    /// The estimator of measured iterations.
    pub estimator: Measure,
}

impl Default for MeasureSchedule {
    /// A pilot, and one iteration in eight after it.
    fn default() -> Self {
        Self { pilot: FIXED_PILOT, every: MEASURE_EVERY, estimator: Measure::Pairs }
    }
}

impl MeasureSchedule {
    /// Measures every iteration with `estimator`.
    pub fn always(estimator: Measure) -> Self {
        Self { pilot: 0, every: 1, estimator }
    }

    /// Measurement of the iteration with this index in its block, at these counts.
    pub fn measure(self, block_iteration: u64, counts: &Counts, settings: &Settings) -> Measure {
        let measures = block_iteration < self.pilot || block_iteration.is_multiple_of(self.every);
        if measures && counts.can_measure(settings) { self.estimator } else { Measure::Off }
    }
}
