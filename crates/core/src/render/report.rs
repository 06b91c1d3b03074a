//! Result of an iteration beside the image: times and counters.

use super::Renderer;
use crate::film::PhaseTimes;
use std::time::{Duration, Instant};

/// Times and counters of one iteration.
#[derive(Clone, Debug, Default)]
pub struct IterationReport {
    /// Time of each phase, divided by the number of processes that render the image together.
    pub times: PhaseTimes,
    /// Rays traced in the light phase and the camera phase.
    pub rays: u64,
    /// Light paths that were started.
    pub light_paths: u64,
    /// Photons in the map.
    pub photons: usize,
    /// Whether any photon came through glass or off mirrors only.
    pub found_caustics: bool,
    /// Column and row of the pixels whose value was not finite and was left out, in image order.
    pub non_finite: Vec<(u32, u32)>,
}

impl IterationReport {
    /// Collects the counters of the iteration that began at `start`. The photon map took
    /// `build_time` on all threads together.
    pub(super) fn new(renderer: &mut Renderer, build_time: Duration, start: Instant) -> Self {
        let Renderer { light_paths, photon_map, medium_photons, suffixes, workers, config, .. } =
            renderer;
        let mut report = Self {
            rays: light_paths.rays() + suffixes.rays(),
            light_paths: light_paths.count() + suffixes.count(),
            photons: photon_map.len(),
            found_caustics: photon_map.has_caustic_photons()
                || medium_photons.has_caustic_photons(),
            ..Self::default()
        };
        report.times.light = light_paths.busy_time() + suffixes.busy_time() + build_time;
        for worker in workers.free_mut() {
            let counts = worker.take_counts();
            report.times.camera += counts.camera;
            report.times.merge += counts.merge;
            report.rays += counts.rays;
            report.non_finite.extend(counts.non_finite);
        }
        report.non_finite.sort_unstable_by_key(|&(x, y)| (y, x));
        report.times.wall = start.elapsed();
        report.times = report.times / config.ranks;
        report
    }
}
