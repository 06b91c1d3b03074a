//! One iteration: light phase, photon map, camera and merge phases for some tiles at a time.

use super::Renderer;
use super::report::IterationReport;
use super::tiles::Shares;
use super::worker::Job;
use crate::base::rng::{Stream, StreamKey};
use crate::noise::Measure;
use crate::settings::Bias;
use crate::transport::camera_paths::CameraPass;
use crate::transport::kernel::MergeKernel;
use crate::transport::merge::{Merge, MergeOptions};
use crate::transport::mis::Mis;
use rayon::prelude::*;
use std::time::Instant;

impl Renderer {
    /// Renders one iteration on the threads of the current rayon pool. One that measures takes at
    /// least two camera paths in each pixel; those that the counts do not ask for stay out of the
    /// image, which is the same whether it is measured or not.
    ///
    /// # Panics
    /// If it is to measure with fewer than two light paths, or all its own iterations are there.
    pub fn iterate(&mut self, measure: Measure) -> IterationReport {
        let start = Instant::now();
        let iteration = self.next();
        assert!(iteration < u64::MAX, "there are iterations to render");
        // Out of the way of what all threads share.
        let mut block = self.blocks.remove(self.current);
        let mut features = self.features.take();

        let Self { scene, accel, settings, light_paths, .. } = self;
        light_paths.trace(scene, &**accel, settings, block.counts.light_paths, iteration);
        let reach = self.kernel().reach();
        let build_time = self.photon_map.build(&self.light_paths, reach);

        let (pass, merge) = self.passes(iteration);
        let before = block.film.iterations;
        let (counts, mut tiles) =
            block.begin_iteration((iteration, measure), self.grain, features.as_mut());
        let job = Job::new(pass, merge, counts, measure, before).with_aovs(self.kept);
        // Results do not depend on which tiles one thread takes together.
        Shares::new(&mut tiles, job.tiles_together())
            .par_bridge()
            .for_each_init(|| self.workers.lease(), |worker, tiles| worker.render(&job, tiles));

        // Summed in the order of the tiles, whoever rendered them.
        let deviations = tiles.iter().map(|tile| tile.deviation).sum();
        block.end_iteration((iteration, measure), deviations);
        if let Some(features) = &mut features {
            features.end_iteration(iteration);
        }
        let Self { light_paths, photon_map, workers, .. } = self;
        let report = IterationReport::new(light_paths, build_time, photon_map, workers, start);
        let report = report.with_ranks(self.ranks);
        block.clock.add(measure, &report.times);
        self.blocks.insert(self.current, block);
        self.features = features;
        report
    }

    fn kernel(&self) -> MergeKernel<'_> {
        let all = MergeKernel::new(&self.settings, self.areas.as_deref());
        self.nesting.map_or(all, |class| all.with_nested_class(class))
    }

    /// How an iteration traces camera paths, and what it merges them with: its photons are in the map.
    pub(super) fn passes(&self, iteration: u64) -> (CameraPass<'_>, Merge<'_>) {
        let Self { scene, accel, settings, view, photon_map, kept, .. } = self;
        let mis = Mis::new(settings);
        let pass = CameraPass {
            scene,
            view: *view,
            accel: &**accel,
            settings,
            key: StreamKey::new(settings.seed, Stream::CameraPath, iteration),
            gather_early: mis.is_some() || photon_map.has_caustic_photons(),
        };
        let options = MergeOptions {
            mis,
            records_caustics: kept.light,
            records_annulus: settings.bias == Bias::Reduce,
        };
        (pass, Merge::new(photon_map, settings.merge_vertex, self.kernel(), options))
    }
}
