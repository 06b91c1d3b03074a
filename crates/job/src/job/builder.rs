//! What a job renders and how: the methods of [`RenderJob`] before it runs.

use super::denoise_mode::Denoise;
use super::{PlantedFailure, RenderJob, Shard, Start};
use crate::output::checkpoint::Checkpoint;
use bdpm_auto::adaptive::plan::Plan;
use bdpm_auto::adaptive::stopping::Stop;
use bdpm_auto::adaptive::technique::FreeParameters;
use bdpm_auto::timing::Timings;
use bdpm_core::accel::Intersect;
use bdpm_core::film::aov::AovSelection;
use bdpm_core::noise::Measure;
use bdpm_core::noise::schedule::MeasureSchedule;
use bdpm_core::scene::Scene;
use bdpm_core::scene::backend::Backend;
use bdpm_core::settings::PartialSettings;
use bdpm_core::settings::provenance::Provenance;
use bdpm_load::Loaded;
use rayon::ThreadPool;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

impl RenderJob {
    /// Renders a scene that was loaded from a file. The settings of the file are the defaults.
    pub fn new(loaded: &Loaded) -> Self {
        Self { scene_settings: loaded.defaults.clone(), ..Self::from_scene(&loaded.scene) }
    }

    /// Renders a scene that a program built, with the default settings.
    pub fn from_scene(scene: &Arc<Scene>) -> Self {
        Self {
            scene: Arc::clone(scene),
            scene_settings: PartialSettings::default(),
            settings: PartialSettings::default(),
            backend: None,
            accel: None,
            threads: None,
            stop: Stop::default(),
            start: Start::New,
            times: None,
            free: None,
            reserve_per_pixel: Duration::ZERO,
            started: None,
            min_iterations: 1,
            reserve_per_enlarged_pixel: None,
            fewer_paths: [false; 2],
            schedule: MeasureSchedule::default(),
            pixel_noise: false,
            aovs: AovSelection::default(),
            denoise: Denoise::Never,
            audit: None,
            shard: None,
            interrupt: Arc::default(),
            planted: None,
            audited: None,
        }
    }

    /// Fixes settings, which the job then does not choose.
    #[must_use]
    pub fn settings(self, settings: PartialSettings) -> Self {
        Self { settings, ..self }
    }

    /// Lets the pilot choose exactly these parameters, even if the settings fix them. The settings
    /// are then the start of the search.
    #[must_use]
    pub fn free_parameters(self, free: FreeParameters) -> Self {
        Self { free: Some(free), ..self }
    }

    /// Ends the job when one of these conditions holds [default: at a relative error of 1 %].
    #[must_use]
    pub fn stop(self, stop: Stop) -> Self {
        Self { stop, ..self }
    }

    /// Finds intersections with this backend [default: Embree if the crate was built with it].
    #[must_use]
    pub fn backend(self, backend: Option<Backend>) -> Self {
        Self { backend, ..self }
    }

    /// Uses an existing acceleration structure of the scene.
    #[must_use]
    pub fn acceleration(self, backend: Backend, accel: Arc<dyn Intersect>) -> Self {
        Self { accel: Some((backend, accel)), ..self }
    }

    /// Renders on these threads [default: one per processor]. The image does not depend on their
    /// number.
    #[must_use]
    pub fn threads(self, threads: Arc<ThreadPool>) -> Self {
        Self { threads: Some(threads), ..self }
    }

    /// Renders the steps of a plan. It was read from the image `file` with the provenance
    /// `made_by`.
    #[must_use]
    pub fn plan(self, plan: Plan, made_by: Provenance, file: &Path) -> Self {
        Self {
            start: Start::Plan { plan, made_by: Box::new(made_by), file: file.to_owned() },
            ..self
        }
    }

    /// Continues the image of a checkpoint that was read from `file`, with its settings.
    #[must_use]
    pub fn resume(self, checkpoint: Checkpoint<'static>, file: &Path) -> Self {
        let checkpoint = Box::new(checkpoint);
        Self { start: Start::Checkpoint { checkpoint, file: file.to_owned() }, ..self }
    }

    /// Chooses path counts by known times, read from `file`, instead of measured ones. Known times
    /// hold for the present settings, so only the path counts are chosen.
    #[must_use]
    pub fn times(self, times: Timings, file: &Path) -> Self {
        Self { times: Some((times, file.to_owned())), ..self }
    }

    /// Measures every iteration with this estimator, at fixed path counts, and keeps the noise of
    /// each pixel.
    #[must_use]
    pub fn measure_always(self, estimator: Measure) -> Self {
        Self { schedule: MeasureSchedule::always(estimator), pixel_noise: true, ..self }
    }

    /// Keeps the noise of each pixel instead of each tile, for
    /// [`RenderResult::noise_image`](super::RenderResult::noise_image). Path counts are then equal
    /// in every pixel.
    #[must_use]
    pub fn pixel_noise(self, pixel_noise: bool) -> Self {
        Self { pixel_noise, ..self }
    }

    /// Reserves a part of the time of [`Self::stop`] for the caller's work after the render, such
    /// as writing files: this time for each pixel. An observer may replace it by a measured time:
    /// [`RenderState::reserve`](super::RenderState::reserve).
    #[must_use]
    pub fn reserve_per_pixel(self, time: Duration) -> Self {
        Self { reserve_per_pixel: time, ..self }
    }

    /// Counts the time of [`Self::stop`] from here, such as the start of the program [default: the
    /// start of [`Self::run`]].
    #[must_use]
    pub fn started(self, start: Instant) -> Self {
        Self { started: Some(start), ..self }
    }

    /// Renders at least this many iterations, even if the time is over.
    #[must_use]
    pub fn at_least(self, iterations: u64) -> Self {
        Self { min_iterations: iterations, ..self }
    }

    /// Renders with fewer light paths, or fewer camera paths, than the settings have, where its
    /// fewest iterations would not fit in the time.
    #[must_use]
    pub fn fewer_paths(self, light: bool, camera: bool) -> Self {
        Self { fewer_paths: [light, camera], ..self }
    }

    /// Renders fewer pixels than the settings have, where the time is too short for all of them.
    /// The caller enlarges the image to [`RenderState::full_size`](super::RenderState::full_size).
    /// This `reserve` for each pixel of that size takes the place of [`Self::reserve_per_pixel`].
    #[must_use]
    pub fn fewer_pixels(self, reserve: Option<Duration>) -> Self {
        Self { reserve_per_enlarged_pixel: reserve, ..self }
    }

    /// Accumulates these layers beside the image.
    #[must_use]
    pub fn aovs(self, aovs: AovSelection) -> Self {
        Self { aovs, ..self }
    }

    /// Denoises the image. The conditions of [`Self::stop`] then apply to the denoised image.
    #[must_use]
    pub fn denoise(self, denoise: bool) -> Self {
        Self { denoise: if denoise { Denoise::Always } else { Denoise::Never }, ..self }
    }

    /// Denoises the image if a time ends the render, its noise will be visible, and a denoiser is
    /// installed. Images whose settings or path counts are given stay as they are.
    #[must_use]
    pub fn denoise_if_noisy(self) -> Self {
        Self { denoise: Denoise::IfNoisy, ..self }
    }

    /// Checks the image by path tracing for this share of the time, or of the paths at fixed path
    /// counts. 0 checks nothing [default: 5 % of images that choose their path counts]. Images
    /// without photons are not checked.
    #[must_use]
    pub fn audit(self, share: f64) -> Self {
        Self { audit: Some(share), ..self }
    }

    /// Renders one shard of the iterations of an image.
    #[must_use]
    pub fn shard(self, shard: Option<Shard>) -> Self {
        Self { shard, ..self }
    }

    /// Plants a failure, so that a test can see that the image is not lost.
    #[doc(hidden)]
    #[must_use]
    pub fn plant_failure(self, planted: PlantedFailure) -> Self {
        Self { planted: Some(planted), ..self }
    }

    /// Ends the job after the iteration in which this flag is set. If that is the first one, or a
    /// pilot, the job ends at once with [`Error::interrupted`](bdpm_core::Error::interrupted).
    #[must_use]
    pub fn interrupted_by(self, interrupt: Arc<AtomicBool>) -> Self {
        Self { interrupt, ..self }
    }
}
