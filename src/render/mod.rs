//! Renders a scene, iteration after iteration: what a renderer holds, and how one is made of another.

pub mod bias;
mod aov_sums;
pub mod bias_correction;
pub mod block;
mod iteration;
pub mod guiding;
mod memory;
mod report;
mod partial;
mod tile_paths;
mod tiles;
mod worker;

pub use memory::light_paths_in;
pub use partial::Sums;
pub use report::IterationReport;

use crate::accel::Intersect;
use crate::base::error::{Error, Result};
use crate::base::iteration_set::IterationSet;
use crate::base::memory::available_memory;
use crate::base::pool::Pool;
use crate::film::aov::{AovSelection, FeatureBuffers};
use crate::film::counts::Counts;
use crate::film::radiance::Film;
use crate::noise::film::{BatchGrain, NoiseFilm};
use crate::noise::image::NoiseImage;
use crate::scene::lights::guide::Guide;
use crate::scene::{Scene, View};
use crate::settings::policy::MOST_BLOCKS;
use crate::settings::{Kernel, MAX_LIGHT_PATHS, Settings};
use crate::transport::area::Areas;
use crate::transport::light_paths::LightPaths;
use crate::transport::photon::PhotonClass;
use crate::transport::photon_map::PhotonMap;
use block::Block;
use memory::{bytes_per_light_path, check_memory, film_bytes};
use std::sync::Arc;
use worker::Worker;

/// Renders one scene, iteration after iteration.
pub struct Renderer {
    scene: Arc<Scene>,
    accel: Arc<dyn Intersect>,
    settings: Settings,
    view: View,
    /// At least one, by the numbers of their iterations.
    blocks: Vec<Block>,
    /// The block under way.
    current: usize,
    /// IterationSet of the iterations to render.
    own: IterationSet,
    /// Processes that render this image together.
    ranks: u32,
    grain: BatchGrain,
    /// The only photons whose merges measuring iterations repeat at nested radii, if not all do.
    nesting: Option<PhotonClass>,
    /// What is kept beside the image.
    kept: AovSelection,
    /// Over all blocks, if they are kept.
    features: Option<FeatureBuffers>,
    /// Of the surfaces, if the kernel asks for them.
    areas: Option<Arc<Areas>>,
    light_paths: LightPaths,
    photon_map: PhotonMap,
    workers: Pool<Worker>,
}

impl Renderer {
    /// Prepares to render from the first iteration.
    ///
    /// # Errors
    /// If the settings are invalid, the scene has no light, or the memory does not suffice.
    pub fn new(scene: &Arc<Scene>, accel: &Arc<dyn Intersect>, settings: Settings) -> Result<Self> {
        Self::unguided(scene, accel, settings)?.learning()
    }

    /// [`Self::new`] but for the guide.
    fn unguided(
        scene: &Arc<Scene>,
        accel: &Arc<dyn Intersect>,
        settings: Settings,
    ) -> Result<Self> {
        Self::with_areas(scene, accel, settings, |settings| match settings.kernel {
            Kernel::Area => Some(Arc::new(Areas::of_scene(scene, &**accel, settings.reach()))),
            Kernel::Disc => None,
        })
    }

    /// Learns where light paths start, if the settings ask for it.
    fn learning(self) -> Result<Self> {
        let all = self.settings.guide;
        let learned = (all > 0).then(|| self.learn_guide(|done, _| done < all)).transpose()?;
        Ok(self.guided(learned.map(|learned| learned.guide)))
    }

    /// Starts light paths where `guide` says, whatever the settings ask for.
    #[must_use]
    pub fn guided(mut self, guide: Option<Arc<Guide>>) -> Self {
        self.light_paths.guide = guide;
        self
    }

    /// Where light paths start; in proportion to the lights' power if there is none.
    pub fn guide(&self) -> Option<&Arc<Guide>> {
        self.light_paths.guide.as_ref()
    }

    /// Prepares to render the same scene with other settings, from the first iteration: what is known of its surfaces
    /// is kept.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_settings(&self, settings: Settings) -> Result<Self> {
        let like = if settings.kernel != self.settings.kernel {
            Self::unguided(&self.scene, &self.accel, settings)?
        } else {
            Self::with_areas(&self.scene, &self.accel, settings, |settings| {
                let areas = self.areas.as_ref()?;
                Some(if areas.radius() == settings.reach() {
                    Arc::clone(areas)
                } else {
                    Arc::new(areas.at(settings.reach()))
                })
            })?
        };
        // Neither counts nor seed matter to what is learned.
        let Settings { light_paths, camera_paths, seed, mis_scales, .. } = self.settings;
        let counted = Settings { light_paths, camera_paths, seed, ..like.settings.clone() };
        let is_same = Settings { mis_scales, ..counted } == self.settings
            && like.settings.mis_scales() == self.settings.mis_scales();
        if is_same { Ok(like.guided(self.guide().cloned())) } else { like.learning() }
    }

    fn with_areas(
        scene: &Arc<Scene>,
        accel: &Arc<dyn Intersect>,
        settings: Settings,
        areas: impl FnOnce(&Settings) -> Option<Arc<Areas>>,
    ) -> Result<Self> {
        settings.validate()?;
        check_memory(scene, &settings, AovSelection::default(), settings.light_paths)?;
        if scene.lights().is_empty() {
            return Err(Error::new(
                "the scene has no light",
                "add a [[light]], or give a material some emission",
            ));
        }
        let view = scene.camera.view(settings.width, settings.height);
        let counts = Counts::uniform(settings.light_paths, settings.camera_paths);
        let areas = areas(&settings);
        Ok(Self {
            scene: Arc::clone(scene),
            accel: Arc::clone(accel),
            view,
            blocks: vec![Block::new(&settings, 0, counts)],
            current: 0,
            own: IterationSet::all(),
            ranks: 1,
            settings,
            grain: BatchGrain::Tile,
            nesting: None,
            kept: AovSelection::default(),
            features: None,
            areas,
            light_paths: LightPaths::default(),
            photon_map: PhotonMap::default(),
            workers: Pool::default(),
        })
    }

    /// The same for a sample of the image of `settings`: of each square of `stride` by `stride` pixels
    /// one ([`View::every`]). What is measured of these pixels is what it is in the image.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn sample(&self, settings: Settings, stride: u32) -> Result<Self> {
        let view = self.scene.camera.view(settings.width, settings.height).every(stride);
        let [width, height] =
            [settings.width, settings.height].map(|pixels| (pixels / stride).max(1));
        Ok(Self { view, ..self.with_settings(Settings { width, height, ..settings })? })
    }

    /// What it renders.
    pub(crate) fn subject(&self) -> (&Arc<Scene>, &Arc<dyn Intersect>) {
        (&self.scene, &self.accel)
    }

    /// Keeps this beside the image from now on.
    ///
    /// # Errors
    /// If the memory does not suffice.
    ///
    /// # Panics
    /// If anything was rendered before.
    pub fn with_aovs(mut self, kept: AovSelection) -> Result<Self> {
        assert!(self.iterations() == 0, "what is kept is kept of all iterations");
        check_memory(&self.scene, &self.settings, kept, self.block().counts.light_paths)?;
        let pixels = self.settings.pixels();
        let features = kept.features || kept.parts;
        self.features = features.then(|| FeatureBuffers::new(pixels, kept.parts));
        let counts = self.block().counts.clone();
        self.blocks = vec![Block::new(&self.settings, 0, counts).with_aovs(kept)];
        Ok(Self { kept, ..self })
    }

    /// What is kept beside the image.
    pub fn kept(&self) -> AovSelection {
        self.kept
    }

    /// What is seen in each pixel, if it is kept.
    pub fn features(&self) -> Option<&FeatureBuffers> {
        self.features.as_ref()
    }

    /// Goes on after iterations of which this was kept beside the image.
    ///
    /// # Errors
    /// As [`Self::resume`].
    pub fn resume_with(
        &mut self,
        blocks: Vec<Block>,
        features: Option<FeatureBuffers>,
    ) -> Result<()> {
        let pixels = self.settings.pixels();
        self.resume(blocks)?;
        let light = self.blocks.iter().all(|block| block.light.is_some());
        let parts = self.blocks.iter().all(|block| block.parts.is_some());
        self.features = features.filter(|features| features.fits(pixels));
        let features = self.features.is_some();
        let in_parts = self.features.as_ref().is_some_and(FeatureBuffers::is_in_parts);
        self.kept = AovSelection { light, features, parts: parts && in_parts };
        Ok(())
    }

    /// Goes on after the iterations that `blocks` hold.
    ///
    /// # Errors
    /// If there is none, or one does not fit the settings.
    pub fn resume(&mut self, blocks: Vec<Block>) -> Result<()> {
        let Settings { width, height, .. } = self.settings;
        if blocks.is_empty() || !blocks.iter().all(|block| block.is_consistent(&self.settings)) {
            return Err(Error::new(
                format!("the image to go on with is not one of {width}x{height} pixels"),
                "render at the --resolution that it was begun with",
            ));
        }
        self.current = blocks.len() - 1;
        self.blocks = blocks;
        Ok(())
    }

    /// Takes other counts from now on, in a new block; a block without iterations is replaced.
    ///
    /// # Errors
    /// If the counts are out of bounds or do not fit in the memory.
    ///
    /// # Panics
    /// If there are counts for another number of pixels.
    pub fn begin_block(&mut self, counts: Counts) -> Result<()> {
        let end = |block: &Block| block.numbers.ranges().last().map_or(0, |range| range.end);
        self.enter_block(self.blocks.iter().map(end).max().unwrap_or(0), counts)
    }

    /// The most light paths that take no more than half of the memory that is left.
    pub fn most_light_paths(&self) -> u32 {
        let Self { scene, settings, .. } = self;
        let Some(available) = available_memory() else { return MAX_LIGHT_PATHS };
        let for_light = 0.5 * (available - film_bytes(settings, self.kept, MOST_BLOCKS)).max(0.0);
        let most = for_light / bytes_per_light_path(scene, settings);
        most.clamp(2.0, f64::from(MAX_LIGHT_PATHS)) as u32
    }

    /// Keeps the batches of measured noise at `grain` from now on; [`BatchGrain::Tile`] at first.
    ///
    /// # Panics
    /// If something was measured before.
    #[must_use]
    pub fn with_batches(mut self, grain: BatchGrain) -> Self {
        assert!(self.noise().is_none(), "batches change only before the first measurement");
        self.grain = grain;
        self
    }

    /// Repeats only merges with photons of one class at nested radii, which tell the bias: that of these merges
    /// alone. The radii of both classes must not be equal.
    #[must_use]
    pub fn nested_class(self, class: PhotonClass) -> Self {
        Self { nesting: Some(class), ..self }
    }

    /// Whether photons of [`PhotonClass::Caustic`] were found in the last iteration.
    pub fn found_caustic_photons(&self) -> bool {
        self.photon_map.has_caustic_photons()
    }

    /// All blocks, by the numbers of their iterations.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The block under way.
    pub fn block(&self) -> &Block {
        &self.blocks[self.current]
    }

    /// What was measured in the block under way.
    pub fn noise(&self) -> Option<&NoiseFilm> {
        self.block().noise.as_ref()
    }

    /// What was measured of each pixel in the block under way; takes
    /// [batches](Self::with_batches) of single pixels.
    ///
    /// # Errors
    /// As [`Block::noise_image`].
    pub fn noise_image(&self) -> Result<NoiseImage> {
        self.block().noise_image()
    }

    /// The image of the block under way.
    pub fn film(&self) -> &Film {
        &self.block().film
    }

    /// Iterations of all blocks.
    pub fn iterations(&self) -> u64 {
        self.blocks.iter().map(|block| block.film.iterations).sum()
    }

    /// The settings; counts are those of the first block.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }
}
