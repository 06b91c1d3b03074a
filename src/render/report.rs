//! What an iteration tells of itself.

use super::worker::Worker;
use crate::base::pool::Pool;
use crate::film::PhaseTimes;
use crate::transport::light_paths::LightPaths;
use crate::transport::photon_map::PhotonMap;
use std::time::{Duration, Instant};

/// What one iteration did.
#[derive(Clone, Debug, Default)]
pub struct IterationReport {
    /// Time of each phase.
    pub times: PhaseTimes,
    /// Rays traced in the light and camera phases.
    pub rays: u64,
    /// Photons in the map.
    pub photons: usize,
    /// Pixels whose value was not finite and was left out: column and row, in image order.
    pub non_finite: Vec<(u32, u32)>,
}

impl IterationReport {
    /// Of the iteration that began at `start`, from what took part in it: `build_time` is that of the photon
    /// map on all threads together.
    pub(super) fn new(
        light_paths: &LightPaths,
        build_time: Duration,
        photon_map: &PhotonMap,
        workers: &mut Pool<Worker>,
        start: Instant,
    ) -> Self {
        let mut report =
            Self { rays: light_paths.rays(), photons: photon_map.len(), ..Self::default() };
        report.times.light = light_paths.busy_time() + build_time;
        for worker in workers.free_mut() {
            let counts = worker.take_counts();
            report.times.camera += counts.camera;
            report.times.merge += counts.merge;
            report.rays += counts.rays;
            report.non_finite.extend(counts.non_finite);
        }
        report.non_finite.sort_unstable_by_key(|&(x, y)| (y, x));
        report.times.wall = start.elapsed();
        report
    }

    /// The same with times per iteration of so many processes together.
    pub(super) fn with_ranks(mut self, ranks: u32) -> Self {
        self.times = self.times / ranks;
        self
    }
}
