//! Times of the phases of an iteration.

use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Busy times of the phases, summed over threads, and wall-clock time of an iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PhaseTimes {
    /// Tracing light paths and building the photon map.
    pub light: Duration,
    /// Tracing camera paths with their direct light.
    pub camera: Duration,
    /// Photon map queries, merging and statistics.
    pub merge: Duration,
    /// Wall-clock time of the whole iteration.
    pub wall: Duration,
}

impl std::ops::Div<u32> for PhaseTimes {
    type Output = Self;

    fn div(self, parts: u32) -> Self {
        let Self { light, camera, merge, wall } = self;
        let [light, camera, merge, wall] = [light, camera, merge, wall].map(|time| time / parts);
        Self { light, camera, merge, wall }
    }
}

impl std::ops::AddAssign for PhaseTimes {
    fn add_assign(&mut self, other: Self) {
        self.light += other.light;
        self.camera += other.camera;
        self.merge += other.merge;
        self.wall += other.wall;
    }
}
