//! What a job is asked for, as far as combinations of options matter.

use super::{RenderJob, Start};
use crate::mpi::Ranks;
use bdpm_core::scene::Scene;
use bdpm_core::settings::Settings;
use bdpm_core::settings::combinations::{JobOptions, Request};

impl RenderJob {
    /// The job with these settings, which are not chosen yet, on some processes.
    pub(super) fn asked<'a>(
        &self,
        scene: &Scene,
        settings: &'a Settings,
        ranks: &dyn Ranks,
    ) -> Request<'a> {
        let stop = self.stop_with_default();
        let job = JobOptions {
            is_automatic: self.is_automatic(),
            is_continued: !matches!(self.start, Start::New),
            is_part: self.shard.is_some(),
            loses_part: false,
            has_iterations: stop.iterations.is_some() || self.begun_shards().is_some(),
            gives_iterations: self.stop.iterations.is_some(),
            has_times: self.times.is_some(),
            has_pixel_noise: self.pixel_noise,
            has_ranks: ranks.count() > 1,
            has_light_groups: false, // Each group is a job of its own.
        };
        Request { settings, given: self.settings.clone(), job, scene: scene.facts() }
    }
}
