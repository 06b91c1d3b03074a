//! Light phase: traces light paths breadth-first and stores their photons.

mod photon_list;
mod tracer;

use super::area::Areas;
use super::mis::weights::PhotonPartials;
use super::path_state::History;
use super::photon::{Extent, Photon, PhotonClass};
pub(super) use super::roulette::{MAX_SURVIVAL, survival};
use crate::accel::Intersect;
use crate::base::pool::Pool;
use crate::base::rng::{Stream, StreamKey};
use crate::scene::lights::guide::Guide;
use crate::scene::{PrimarySamples, Scene};
use crate::settings::Settings;
use crate::simd::Rngs;
use crate::simd::sobol::ScrambledSobol;
use photon_list::PhotonList;
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tracer::Tracer;

/// Light paths per batch. It is fixed, so that results do not depend on the number of threads. As
/// many fill ray packets, and a batch of them stays in the second-level cache.
const BATCH: u32 = 1024;

/// The photons of one iteration; buffers are reused by the next.
#[derive(Default)]
pub struct LightPaths {
    batches: Vec<Batch>,
    count: u64,
    tracers: Pool<Tracer>,
    /// Density of the starts of paths; without it they start in proportion to the lights' power.
    pub guide: Option<Arc<Guide>>,
    /// Distinguishes the sides of surfaces, for merges by area.
    pub areas: Option<Arc<Areas>>,
    /// Leaves out paths once it is true.
    pub interrupt: Option<Arc<AtomicBool>>,
    /// Keeps only paths that no camera path finds: from lights that no ray can hit, whose first
    /// vertex takes a single direction. Direct light must be connected.
    pub photon_only: bool,
}

impl LightPaths {
    /// Traces `light_paths` paths of `iteration`.
    ///
    /// # Panics
    /// If the scene has no lights.
    pub fn trace(
        &mut self,
        scene: &Scene,
        accel: &dyn Intersect,
        settings: &Settings,
        light_paths: u32,
        iteration: u64,
    ) {
        let key = StreamKey::new(settings.seed, Stream::LightPath, iteration);
        self.count = u64::from(light_paths);
        let count = light_paths.div_ceil(BATCH);
        self.batches.resize_with(count as usize, Batch::default);
        let Self { batches, tracers, guide, areas, interrupt, photon_only, .. } = self;
        let photon_only = *photon_only;
        let (guide, areas) = (guide.as_deref(), areas.as_deref());
        let sets = StreamKey::new(settings.seed, Stream::LightPathSet, iteration);
        let splitting = settings.continuations() as f32;
        let pass =
            LightPass { scene, accel, settings, guide, areas, key, sets, splitting, photon_only };
        let batches = batches.par_iter_mut().zip(0..count);
        batches.for_each_init(
            || tracers.lease(),
            |tracer, (batch, index)| {
                let first = index * BATCH;
                let is_over = interrupt.as_ref().is_some_and(|own| own.load(Ordering::Relaxed));
                let count = if is_over { 0 } else { BATCH.min(light_paths - first) };
                tracer.trace(&pass, first..first + count, batch);
            },
        );
    }

    /// All photons in slices of consecutive paths. The photons of a slice are ordered bounce by
    /// bounce.
    pub fn photons(&self) -> impl Iterator<Item = &[Photon]> + Clone {
        self.batches.iter().map(|batch| batch.photons.as_slice())
    }

    /// All photons in media, in slices of consecutive paths.
    pub fn medium_photons(&self) -> impl Iterator<Item = &[Photon]> + Clone {
        self.batches.iter().map(|batch| batch.medium_photons.as_slice())
    }

    /// MIS partials of all photons in the same slices, which are empty without MIS.
    pub fn mis_partials(&self) -> impl Iterator<Item = &[PhotonPartials]> + Clone {
        self.batches.iter().map(|batch| batch.mis_partials.as_slice())
    }

    /// Bounds and number of all photons.
    pub fn extent(&self) -> Extent {
        self.batches.iter().map(|batch| batch.extent).fold(Extent::default(), Extent::and)
    }

    /// Number of light paths that were started.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Number of photons.
    pub fn len(&self) -> usize {
        self.extent().count
    }

    /// Tests whether no path left a photon.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Time that all threads together spent on tracing.
    pub fn busy_time(&self) -> Duration {
        self.batches.iter().map(|batch| batch.busy).sum()
    }

    /// Number of rays traced.
    pub fn rays(&self) -> u64 {
        self.batches.iter().map(|batch| batch.rays).sum()
    }
}

/// Settings that all light paths of an iteration share.
struct LightPass<'a> {
    scene: &'a Scene,
    accel: &'a dyn Intersect,
    settings: &'a Settings,
    guide: Option<&'a Guide>,
    areas: Option<&'a Areas>,
    /// Random streams of the light paths. The upper half of an index numbers their continuations
    /// where they split.
    key: StreamKey,
    /// Random streams of their sets.
    sets: StreamKey,
    /// Factor on the number of continuations at the first diffuse vertex.
    splitting: f32,
    /// See [`LightPaths::photon_only`].
    photon_only: bool,
}

impl LightPass<'_> {
    /// Numbers that start the sixteen light paths from `first`, a multiple of sixteen.
    #[inline(always)] // part of the loop over light paths
    fn starts(&self, first: u32, rngs: &mut Rngs) -> PrimarySamples {
        let size = self.settings.sobol_set;
        if size == 1 {
            return PrimarySamples::independent(rngs);
        }
        let set = ScrambledSobol::new(self.sets.rng(u64::from(first / size)));
        PrimarySamples::of_points(&set.points(first % size), rngs)
    }

    /// Tests whether a path of this history ends at its next vertex unless that takes a single
    /// direction: see [`LightPaths::photon_only`].
    #[inline(always)] // part of vector loops
    fn leaves_out(&self, history: History) -> bool {
        self.photon_only & history.is_start()
    }

    /// The independent sample that a light path belongs to: its set of Sobol points.
    #[inline(always)]
    fn sample_of(&self, path: u32) -> u32 {
        path >> self.settings.sobol_set.trailing_zeros()
    }
}

/// Photons of consecutive paths.
#[derive(Debug, Default)]
struct Batch {
    /// Ordered bounce by bounce.
    photons: PhotonList,
    /// Photons where media scattered the paths.
    medium_photons: PhotonList,
    /// MIS partials of the photons; empty without MIS.
    mis_partials: Vec<PhotonPartials>,
    extent: Extent,
    rays: u64,
    busy: Duration,
}

/// Class of the next photon of a path: theory.md, section 4.
#[inline(always)] // part of vector loops
pub(super) fn class_of(history: History) -> PhotonClass {
    if history.diffuse() == 0 { PhotonClass::Caustic } else { PhotonClass::Diffuse }
}
