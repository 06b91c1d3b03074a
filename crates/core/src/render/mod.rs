//! Rendering a scene, iteration after iteration.

pub mod accumulators;
pub mod annulus_moments;
pub mod audit;
mod aov_sums;
pub mod bias_over_noise;
pub mod bias_correction;
pub mod photon_only_light;
pub mod narrow_beam;
pub mod block;
mod coarse_bias;
pub mod combined_image;
mod config;
pub mod guiding;
mod iteration;
mod light_visibility;
mod measured_pixels;
mod memory;
mod partial;
mod report;
mod set_factor;
mod suffixes;
mod tile_paths;
mod tiles;
mod worker;

pub use config::{NestedPart, RenderConfig};
pub use memory::{MemoryNeed, bytes_per_pixel, light_paths_in};
pub use partial::PartialRender;
pub use report::IterationReport;

use crate::accel::Intersect;
use crate::base::error::{Error, Result};
use crate::base::iteration_set::IterationSet;
use crate::base::memory::available_memory;
use crate::base::pool::Pool;
use crate::film::aov::AovSelection;
use crate::film::cells::CellGrid;
use crate::film::counts::Counts;
use crate::film::features::FeatureFolds;
use crate::film::radiance::Film;
use crate::film::statistic::StatisticRequest;
use crate::scene::lights::guide::Guide;
use crate::scene::{Media, Scene, View};
use crate::settings::combinations::{self, Request};
use crate::settings::{AllowedLightPaths, Kernel, MAX_LIGHT_PATHS, Settings};
use crate::transport::area::{Areas, CellWork};
use crate::transport::camera_paths::LightEdges;
use crate::transport::clearance::Clearance;
use crate::transport::kernel::MergeKernel;
use crate::transport::light_paths::LightPaths;
use crate::transport::medium_kernel::MediumKernel;
use crate::transport::medium_photons::MediumPhotons;
use crate::transport::mis::Mis;
use crate::transport::photon_map::PhotonMap;
use accumulators::SharedStatistics;
use block::Block;
use memory::{bytes_per_light_path, check_memory, film_bytes};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use suffixes::Suffixes;
use worker::Worker;

/// Maximum number of blocks of a render that chooses its counts. Each block keeps its own sums in
/// memory.
const MAX_BLOCKS: usize = 7;

/// Maximum number of blocks of a large image, whose pixels share statistics: one at the counts of
/// the settings and one at the best counts.
const MAX_LARGE_BLOCKS: usize = 2;

/// Maximum number of blocks of a render with these settings that chooses its counts.
pub fn max_blocks(settings: &Settings) -> usize {
    let is_small = CellGrid::of(settings.resolution()).is_single_pixels();
    if is_small { MAX_BLOCKS } else { MAX_LARGE_BLOCKS }
}

/// Renders one scene, iteration after iteration.
pub struct Renderer {
    scene: Arc<Scene>,
    accel: Arc<dyn Intersect>,
    settings: Settings,
    config: RenderConfig,
    view: View,
    /// At least one block.
    sums: PartialRender,
    /// Index of the current block.
    current: usize,
    /// Numbers of the iterations that this process renders.
    assigned: IterationSet,
    /// Areas of the surfaces, for the area kernel only.
    areas: Option<Arc<Areas>>,
    /// Where light paths start unless it was learned; `None` in proportion to the lights' power.
    aim: Option<Arc<Guide>>,
    light_paths: LightPaths,
    photon_map: PhotonMap,
    medium_photons: MediumPhotons,
    suffixes: Suffixes,
    /// Where surfaces are near, in scenes with media.
    clearance: Option<Arc<Clearance>>,
    /// Edges of light sources in the image, once they were needed.
    light_edges: OnceLock<Option<LightEdges>>,
    workers: Pool<Worker>,
    /// Abandons the first iteration once it is true.
    interrupt: Option<Arc<AtomicBool>>,
}

/// Refuses a scene without light.
///
/// # Errors
/// If there is none.
pub fn check_has_light(scene: &Scene) -> Result<()> {
    if !scene.lights().is_empty() {
        return Ok(());
    }
    Err(Error::new("the scene has no light", "add a [[light]], or give a material some emission"))
}

impl Renderer {
    /// Prepares to render from the first iteration.
    ///
    /// # Errors
    /// If the settings are invalid, the scene has no light, or the memory does not suffice.
    pub fn new(scene: &Arc<Scene>, accel: &Arc<dyn Intersect>, settings: Settings) -> Result<Self> {
        settings.validate()?;
        let located = scene.media().map(|_| Arc::new(scene.with_start_media(&**accel)));
        let scene = located.as_ref().unwrap_or(scene);
        let scene = light_visibility::learned(scene, &**accel, &settings);
        let (renderer, aim) =
            rayon::join(|| Self::unguided(&scene, accel, settings), || Guide::aimed(&scene));
        let renderer = Self { aim: aim.map(Arc::new), ..renderer? };
        renderer.with_learned_guide()
    }

    fn unguided(
        scene: &Arc<Scene>,
        accel: &Arc<dyn Intersect>,
        settings: Settings,
    ) -> Result<Self> {
        Self::with_areas(
            scene,
            accel,
            settings,
            |settings| match settings.kernel {
                Kernel::Area => Some(Arc::new(Areas::of_scene(scene, &**accel, settings.reach()))),
                Kernel::Disc => None,
            },
            None,
        )
    }

    /// Where surfaces are near enough for the merges in media of some settings. Uses `known`, which
    /// is that of other settings, if it is not much larger than needed.
    fn clearance(
        scene: &Scene,
        settings: &Settings,
        known: Option<&Arc<Clearance>>,
    ) -> Arc<Clearance> {
        let radii = MergeKernel::discs(settings.merge_radii());
        let needed = MediumKernel::new(&radii, settings).reach();
        match known {
            Some(known) if (needed..=2.0 * needed).contains(&known.distance()) => known.clone(),
            _ => Arc::new(Clearance::of_scene(scene, needed)),
        }
    }

    fn with_areas(
        scene: &Arc<Scene>,
        accel: &Arc<dyn Intersect>,
        settings: Settings,
        areas: impl FnOnce(&Settings) -> Option<Arc<Areas>>,
        clearance: Option<&Arc<Clearance>>,
    ) -> Result<Self> {
        settings.validate()?;
        let independent_paths = scene.meters().is_some();
        let config = RenderConfig { independent_paths, ..RenderConfig::default() };
        let request = config.request(&settings);
        check_memory(scene, &request, settings.light_paths)?;
        check_has_light(scene)?;
        combinations::check(&Request { scene: scene.facts(), ..Request::of(&settings) })?;
        let counts = Counts::uniform(settings.light_paths, settings.camera_paths);
        let blocks = vec![Block::new(&request, 0, counts)];
        let areas = areas(&settings);
        let mut light_paths = LightPaths::default();
        light_paths.areas = areas.clone();
        let clearance = scene
            .media()
            .is_some_and(Media::any_scatters)
            .then(|| Self::clearance(scene, &settings, clearance));
        Ok(Self {
            scene: Arc::clone(scene),
            accel: Arc::clone(accel),
            config,
            view: scene.camera.view_of(&settings),
            sums: PartialRender::new(blocks, SharedStatistics::default()),
            current: 0,
            assigned: IterationSet::all(),
            settings,
            light_paths,
            areas,
            aim: None,
            photon_map: PhotonMap::default(),
            medium_photons: MediumPhotons::default(),
            suffixes: Suffixes::default(),
            clearance,
            light_edges: OnceLock::new(),
            workers: Pool::default(),
            interrupt: None,
        })
    }

    /// Prepares to render the same scene with other settings and the default configuration, from
    /// the first iteration. The areas of the surfaces and, if they would not differ, the guide and
    /// the visibility of lights are reused.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn with_settings(&self, settings: Settings) -> Result<Self> {
        let scene = if settings.light_visibility == self.settings.light_visibility {
            Arc::clone(&self.scene)
        } else {
            settings.validate()?;
            let unlearned = Arc::new(self.scene.with_visibility(None));
            light_visibility::learned(&unlearned, &*self.accel, &settings)
        };
        let renderer = if settings.kernel != self.settings.kernel {
            Self::unguided(&scene, &self.accel, settings)?
        } else {
            Self::with_areas(
                &scene,
                &self.accel,
                settings,
                |settings| {
                    let areas = self.areas.as_ref()?;
                    Some(if areas.radius() == settings.reach() {
                        Arc::clone(areas)
                    } else {
                        Arc::new(areas.at(settings.reach()))
                    })
                },
                self.clearance.as_ref(),
            )?
        };
        let (interrupt, aim) = (self.interrupt.clone(), self.aim.clone());
        let renderer = Self { interrupt, aim, ..renderer };
        // The guide depends neither on the path counts and sets nor on the seed.
        let Settings { light_paths, camera_paths, sobol_set, seed, mis_scales, .. } = self.settings;
        let new = &renderer.settings;
        let counted =
            Settings { light_paths, camera_paths, sobol_set, seed, mis_scales, ..new.clone() };
        if counted == self.settings && new.mis_scales() == self.settings.mis_scales() {
            Ok(renderer.guided(self.learned_guide()))
        } else {
            renderer.with_learned_guide()
        }
    }

    /// Prepares to render a sample of the image with `settings`: one pixel of each square of
    /// `stride` by `stride` pixels ([`View::every`]). Each of these pixels has the statistics that
    /// it has in the whole image.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn sample(&self, settings: Settings, stride: u32) -> Result<Self> {
        let view = self.scene.camera.view_of(&settings).every(stride);
        let [width, height] =
            [settings.width, settings.height].map(|pixels| (pixels / stride).max(1));
        Ok(Self { view, ..self.with_settings(Settings { width, height, ..settings })? })
    }

    /// Prepares to render the image with `settings` at a lower resolution: squares of `side` by
    /// `side` pixels take the place of pixels. Those beyond the last full square are left out.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn binned(&self, settings: Settings, side: u32) -> Result<Self> {
        let view = self.scene.camera.view_of(&settings).binned(side);
        let [width, height] = [settings.width, settings.height].map(|pixels| pixels / side);
        Ok(Self { view, ..self.with_settings(Settings { width, height, ..settings })? })
    }

    /// Abandons the first iteration, here and in renderers made from this one, once `interrupt` is
    /// true. Later iterations are finished, so that images with equal iterations are equal.
    #[must_use]
    pub fn interrupted_by(self, interrupt: Arc<AtomicBool>) -> Self {
        Self { interrupt: Some(interrupt), ..self }
    }

    /// Finishes even an interrupted first iteration.
    #[must_use]
    pub fn uninterrupted(self) -> Self {
        Self { interrupt: None, ..self }
    }

    /// Refuses to go on once the user has interrupted the program.
    ///
    /// # Errors
    /// [`Error::interrupted`].
    pub fn check_interrupt(&self) -> Result<()> {
        match &self.interrupt {
            Some(interrupt) if interrupt.load(Ordering::Relaxed) => Err(Error::interrupted()),
            _ => Ok(()),
        }
    }

    /// Selects the statistics that are kept; see [`RenderConfig`].
    ///
    /// # Errors
    /// If the memory does not suffice.
    ///
    /// # Panics
    /// If an iteration was rendered before.
    pub fn configure(mut self, config: RenderConfig) -> Result<Self> {
        assert!(self.iterations() == 0, "statistics are kept of all iterations or none");
        self.config = config;
        self.config.independent_paths |= self.scene.meters().is_some();
        let counts = self.block().counts.clone();
        check_memory(&self.scene, &self.request(), counts.light_paths)?;
        let mut shared = SharedStatistics::default();
        shared.start(&self.request());
        self.sums = PartialRender::new(vec![Block::new(&self.request(), 0, counts)], shared);
        self.current = 0;
        Ok(self)
    }

    /// The statistics that are kept.
    pub fn config(&self) -> &RenderConfig {
        &self.config
    }

    fn request(&self) -> StatisticRequest<'_> {
        self.config.request(&self.settings)
    }

    /// Continues after the iterations of `sums`, and keeps the layers that all its blocks have.
    ///
    /// # Errors
    /// If there is no block, or one does not fit the settings.
    pub fn resume(&mut self, sums: PartialRender) -> Result<()> {
        let PartialRender { blocks, shared, .. } = &sums;
        let fits = shared.fits(&self.settings)
            && blocks.iter().all(|block| block.is_consistent(&self.settings));
        if blocks.is_empty() || !fits {
            let Settings { width, height, .. } = self.settings;
            return Err(Error::new(
                format!("the image to continue does not have {width}x{height} pixels"),
                "render at the resolution that it was begun with",
            ));
        }
        let features = shared.features.as_ref();
        self.config.aovs = AovSelection {
            light: shared.compact_direct.is_some()
                || blocks.iter().all(|block| block.statistics.light.is_some()),
            features: features.is_some(),
            folds: features.is_some_and(FeatureFolds::is_folded)
                && blocks.iter().all(|block| block.statistics.folds.is_some()),
            halves: blocks.iter().all(|block| block.statistics.halves.is_some()),
        };
        self.current = blocks.len() - 1;
        self.sums = sums;
        Ok(())
    }

    /// Renders with other counts from now on, in a new block. A block without iterations is
    /// replaced.
    ///
    /// # Errors
    /// If the counts are out of bounds or do not fit in the memory.
    ///
    /// # Panics
    /// If there are counts for another number of pixels.
    pub fn begin_block(&mut self, counts: Counts) -> Result<()> {
        let end = |block: &Block| block.numbers.ranges().last().map_or(0, |range| range.end);
        self.enter_block(self.blocks().iter().map(end).max().unwrap_or(0), counts)
    }

    /// The numbers of light paths from which a choice of counts takes its own: as settings and
    /// memory allow. Where pixels share nothing, no light path is traced, so that there is only one
    /// number.
    pub fn allowed_light_paths(&self) -> AllowedLightPaths {
        let most = if self.settings.shares_light() { self.most_light_paths() } else { 0 };
        self.settings.allowed_light_paths(most)
    }

    /// Maximum number of light paths that take no more than half of the available memory.
    pub fn most_light_paths(&self) -> u32 {
        let Some(available) = available_memory() else { return MAX_LIGHT_PATHS };
        let for_light =
            0.5 * (available - film_bytes(&self.request(), max_blocks(&self.settings))).max(0.0);
        let most = for_light / bytes_per_light_path(&self.scene, &self.settings);
        most.clamp(2.0, f64::from(MAX_LIGHT_PATHS)) as u32
    }

    /// Starts light paths from a learned guide, whatever the settings ask for. Without one, a share
    /// of them aims at what casts caustics, and the others start in proportion to the power of the
    /// lights. Nothing is set where there are no photons.
    #[must_use]
    pub fn guided(mut self, guide: Option<Arc<Guide>>) -> Self {
        self.set_guide(guide);
        self
    }

    /// Sets the guide that light paths start from. With multiple importance sampling a learned
    /// guide is that of the weights, too.
    fn set_guide(&mut self, learned: Option<Arc<Guide>>) {
        // No weight has densities of light paths, which take a tenth of the time under a sky.
        let has_photons = self.settings.has_photons();
        let weighted =
            learned.clone().filter(|_| has_photons && Mis::new(&self.settings).is_some());
        if weighted.is_some() || self.scene.lights().has_weighted_guide() {
            self.scene = Arc::new(self.scene.with_weighted_guide(weighted));
        }
        self.light_paths.guide = learned.or_else(|| self.aim.clone()).filter(|_| has_photons);
    }

    /// The guide that light paths start from, if there is one.
    pub fn guide(&self) -> Option<&Arc<Guide>> {
        self.light_paths.guide.as_ref()
    }

    /// The guide that was learned, if light paths start from one.
    pub fn learned_guide(&self) -> Option<Arc<Guide>> {
        let is_aim = |own: &Arc<Guide>| self.aim.as_ref().is_some_and(|aim| Arc::ptr_eq(aim, own));
        self.guide().filter(|own| !is_aim(own)).cloned()
    }

    /// The scene and its acceleration structure.
    pub fn scene_and_accel(&self) -> (&Arc<Scene>, &Arc<dyn Intersect>) {
        (&self.scene, &self.accel)
    }

    /// The settings. Their path counts are those of the first block.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Whether the last iteration stored photons of the class of caustics.
    pub fn found_caustic_photons(&self) -> bool {
        self.photon_map.has_caustic_photons() || self.medium_photons.has_caustic_photons()
    }

    /// Work so far on the areas around gather points, in this renderer and those that share them;
    /// none if the kernel is a disc.
    pub fn area_work(&self) -> CellWork {
        self.areas.as_ref().map_or(CellWork::default(), |areas| areas.work())
    }

    /// All blocks, in the order of their first iterations.
    pub fn blocks(&self) -> &[Block] {
        &self.sums.blocks
    }

    /// The current block.
    pub fn block(&self) -> &Block {
        &self.sums.blocks[self.current]
    }

    /// Sums of the image over the iterations of the current block.
    pub fn film(&self) -> &Film {
        &self.block().film
    }

    /// Statistics over all blocks.
    pub fn shared(&self) -> &SharedStatistics {
        &self.sums.shared
    }

    /// Number of iterations of all blocks.
    pub fn iterations(&self) -> u64 {
        self.blocks().iter().map(|block| block.film.iterations).sum()
    }
}
