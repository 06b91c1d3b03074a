//! The loaded scene of a command, with the threads that render it.

use super::progress::ProgressFormat;
use super::{SceneArgs, positive_time, print_notes, say};
use bdpm::accel::Intersect;
use bdpm::base::error::Result;
use bdpm::import::EnvironmentSource;
use bdpm::job;
use bdpm::load::Loaded;
use bdpm::scene::backend;
use bdpm::settings::provenance::Provenance;
use bdpm::settings::{PartialSettings, Settings};
use bdpm::{RenderJob, Scene};
use rayon::ThreadPool;
use std::sync::Arc;
use std::time::{Duration, Instant};

#[derive(Clone, clap::Args)]
pub struct SessionArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Render for about this time, such as 30 (seconds), 2m or 1h [default: no limit]
    #[arg(long, value_name = "TIME", value_parser = positive_time)]
    pub time: Option<Duration>,
    /// Use this many threads, without effect on the image [default: all processors]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Show only errors
    #[arg(long, short)]
    pub quiet: bool,
    /// Show progress in this format
    #[arg(long, value_name = "FORMAT", default_value = "text", conflicts_with = "quiet")]
    progress: ProgressFormat,
}

impl SessionArgs {
    pub fn progress_format(&self) -> ProgressFormat {
        if self.quiet { ProgressFormat::Nothing } else { self.progress }
    }
}

/// A loaded scene.
pub struct SceneInput {
    pub threads: Arc<ThreadPool>,
    pub loaded: Loaded,
    pub load_time: Duration,
}

impl SceneInput {
    /// Loads the scene, and prints its contents and the warnings about it.
    pub fn load(args: &SessionArgs) -> Result<Self> {
        Self::load_under(args, None)
    }

    /// As [`Self::load`], with this environment instead of that of the scene.
    pub fn load_under(args: &SessionArgs, environment: Option<&EnvironmentSource>) -> Result<Self> {
        let threads = Arc::new(job::thread_pool(args.threads.unwrap_or(0).into())?);
        let start = Instant::now();
        let loaded = threads.install(|| args.scene.load_under(environment))?;
        let load_time = start.elapsed();
        if !args.quiet {
            say(&format!("read {}", loaded.summary));
            print_notes(&loaded.warnings);
        }
        Ok(Self { threads, loaded, load_time })
    }

    /// The same with another scene.
    pub fn with_scene(&self, scene: Arc<Scene>) -> Self {
        let loaded = Loaded { scene, ..self.loaded.clone() };
        Self { threads: Arc::clone(&self.threads), loaded, load_time: self.load_time }
    }

    /// A job that renders the scene with the settings of the command line.
    pub fn job(&self, args: &SessionArgs) -> RenderJob {
        RenderJob::new(&self.loaded)
            .settings((&args.scene.settings).into())
            .backend(args.scene.accel)
            .threads(Arc::clone(&self.threads))
    }
}

/// A scene with its acceleration structure, ready to trace.
pub struct LoadedScene {
    pub threads: Arc<ThreadPool>,
    pub scene: Arc<Scene>,
    pub accel: Arc<dyn Intersect>,
    pub provenance: Provenance,
}

impl LoadedScene {
    /// Loads the scene and builds its acceleration structure.
    pub fn new(args: &SessionArgs) -> Result<Self> {
        Self::with_default_resolution(args, None)
    }

    /// As [`Self::new`]; `resolution` replaces the one of the scene file.
    pub fn with_default_resolution(
        args: &SessionArgs,
        resolution: Option<[u32; 2]>,
    ) -> Result<Self> {
        let SceneInput { threads, loaded, .. } = SceneInput::load(args)?;
        let mut requested = PartialSettings::from(&args.scene.settings);
        requested.resolution = requested.resolution.or(resolution);
        let scene = loaded.scene;
        let settings = Settings::resolve(&requested, &loaded.defaults, scene.size())?;
        let backend = args.scene.accel.unwrap_or_default();
        let accel = threads.install(|| backend::build(backend, &scene))?;
        let provenance = job::provenance(&scene, backend, settings);
        Ok(Self { threads, scene, accel, provenance })
    }
}
