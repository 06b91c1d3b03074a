//! One iteration: light phase, photon map, camera phase and merge.

use super::accumulators::SharedStatistics;
use super::block::Block;
use super::measured_pixels::MeasuredPixels;
use super::report::IterationReport;
use super::tiles::TileBatches;
use super::worker::Job;
use super::{NestedPart, Renderer};
use crate::accel::Intersect;
use crate::base::rng::{Stream, StreamKey};
use crate::film::cells::CellGrid;
use crate::film::counts::Counts;
use crate::film::statistic::CurrentIteration;
use crate::noise::Measure;
use crate::scene::Scene;
use crate::transport::camera_paths::{CameraPass, CameraPoints, LightEdges};
use crate::transport::clearance::Clearance;
use crate::transport::kernel::MergeKernel;
use crate::transport::medium_kernel::MediumKernel;
use crate::transport::merge::{Merge, MergeOptions};
use crate::transport::mis::Mis;
use crate::transport::near_planes::Surroundings;
use rayon::prelude::*;
use std::mem;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// What cuts the merges in media that scatter, if there are any.
fn surroundings<'a>(
    scene: &'a Scene,
    accel: &'a dyn Intersect,
    clearance: &'a Option<Arc<Clearance>>,
) -> Option<Surroundings<'a>> {
    clearance.as_ref().map(|clearance| Surroundings { scene, accel, clearance })
}

impl Renderer {
    /// Renders one iteration on the threads of the current rayon pool.
    ///
    /// A measured iteration traces at least two camera paths in each pixel, or in one pixel of each
    /// cell of a large image. Camera paths beyond the pixel's count are left out of the image, so
    /// that the image does not depend on `measure`. An interrupted first iteration is left out of
    /// the image: see [`Self::interrupted_by`].
    ///
    /// # Panics
    /// If the iteration is measured with fewer than two light paths, or no iteration remains.
    pub fn iterate(&mut self, measure: Measure) -> IterationReport {
        let start = Instant::now();
        let number = self.next_iteration();
        assert!(number < u64::MAX, "there are iterations to render");
        let iteration = CurrentIteration { number, is_measured: measure != Measure::Off };
        let interrupt = self.interrupt.clone().filter(|_| self.iterations() == 0);
        // Taken out, so that all threads can read the rest of the renderer.
        let mut block = self.sums.blocks.remove(self.current);
        let mut shared = mem::take(&mut self.sums.shared);

        // Light phase: trace light paths and store their photons
        let Self { scene, accel, settings, light_paths, .. } = self;
        light_paths.interrupt = interrupt.clone();
        light_paths.photon_only = self.config.photon_only;
        let traced = if settings.has_photons() { block.counts.light_paths } else { 0 };
        light_paths.trace(scene, &**accel, settings, traced, number);

        // Build the photon map
        let mut build_time = self.photon_map.build(&self.light_paths, self.kernel().reach());
        if let Some(surroundings) = surroundings(&self.scene, &*self.accel, &self.clearance) {
            let kernel = self.medium_kernel();
            build_time += self.medium_photons.build(&self.light_paths, &kernel, &surroundings);
        }

        // Fill the cache with the suffixes of full camera paths
        self.fill_cache(block.counts.light_paths, (number, interrupt.as_deref()));

        // Camera phase and merge: each thread traces and merges the camera paths of some tiles
        let mut render_tiles = || {
            let (counts, mut tiles) = block.begin_iteration(iteration, self.request(), &mut shared);
            let job = self.job((counts, measure), iteration, interrupt.as_deref());
            TileBatches::new(&mut tiles, job.tiles_per_batch())
                .par_bridge()
                .for_each_init(|| self.workers.lease(), |worker, tiles| worker.render(&job, tiles));
            // Add up in the order of the tiles: the sum does not depend on the threads
            tiles.iter().map(|tile| tile.film.deviation).sum()
        };
        let deviation = catch_unwind(AssertUnwindSafe(&mut render_tiles));
        let is_abandoned = interrupt.is_some_and(|interrupt| interrupt.load(Ordering::Relaxed));
        if is_abandoned {
            block = Block::new(&self.request(), block.first, block.counts);
            shared = SharedStatistics::default();
            shared.start(&self.request());
        } else if let Ok(deviation) = deviation {
            block.end_iteration(iteration, deviation);
            shared.end_iteration(iteration);
        }
        let report = IterationReport::new(self, build_time, start);
        if !iteration.is_measured && !is_abandoned {
            block.clock.add(&report.times);
        }
        self.sums.blocks.insert(self.current, block);
        self.sums.shared = shared;
        // Even a fault of the program leaves the sums in place.
        if let Err(panic) = deviation {
            resume_unwind(panic);
        }
        report
    }

    /// What all threads do in the camera phase of an iteration, whose photons are in the map and
    /// whose suffixes are in the cache.
    fn job<'a>(
        &'a self,
        (counts, measure): (&'a Counts, Measure),
        iteration: CurrentIteration,
        interrupt: Option<&'a AtomicBool>,
    ) -> Job<'a> {
        let (pass, merge) = self.passes(iteration.number);
        let grid = CellGrid::of(self.settings.resolution());
        Job {
            aovs: self.config.aovs,
            cache_bias: self.suffixes.bias(),
            measured: MeasuredPixels::new(grid, self.config.grain, iteration),
            leaves_out_direct: self.config.photon_only,
            interrupt,
            ..Job::new(pass, merge, counts, measure)
        }
    }

    /// Edges of light sources in the image, if any are seen.
    fn light_edges(&self) -> Option<&LightEdges> {
        let edges = self.light_edges.get_or_init(|| {
            let size = self.settings.resolution();
            LightEdges::of(&self.scene, &*self.accel, &self.view, size)
        });
        edges.as_ref()
    }

    fn kernel(&self) -> MergeKernel<'_> {
        let kernel = MergeKernel::new(&self.settings, self.areas.as_deref());
        match self.config.nested_part {
            None => kernel,
            Some(NestedPart::Class(class)) => kernel.with_nested_class(class),
            Some(NestedPart::Media) => kernel.without_nested_radii(),
        }
    }

    fn medium_kernel(&self) -> MediumKernel {
        let at_surfaces = match self.config.nested_part {
            Some(NestedPart::Media) => {
                MergeKernel::new(&self.settings, self.areas.as_deref()).without_nested_width()
            }
            _ => self.kernel(),
        };
        MediumKernel::new(&at_surfaces, &self.settings)
    }

    /// Camera pass of an iteration whose photons are in the map, and the merge with them.
    pub(super) fn passes(&self, iteration: u64) -> (CameraPass<'_>, Merge<'_>) {
        let Self { scene, accel, settings, view, photon_map, medium_photons, .. } = self;
        let mis = Mis::new(settings);
        let pass = CameraPass {
            scene,
            view: *view,
            accel: &**accel,
            settings,
            key: StreamKey::new(settings.seed, Stream::CameraPath, iteration),
            gather_early: settings.strategy.merges_twice() || self.found_caustic_photons(),
            hides_lights: self.config.hides_lights,
            points: CameraPoints::of(settings, iteration)
                .filter(|_| !self.config.independent_paths),
            cache: self.suffixes.cache(),
            light_edges: self.light_edges(),
        };
        let options = MergeOptions {
            mis,
            records_caustics: self.config.aovs.light,
            records_annulus: settings.corrects_bias(),
        };
        let merge = Merge::new(photon_map, settings.merge_vertex, self.kernel(), options);
        let merge = match surroundings(scene, &**accel, &self.clearance) {
            None => merge,
            Some(surroundings) => {
                merge.with_medium(medium_photons, self.medium_kernel(), surroundings)
            }
        };
        (pass, merge)
    }
}
