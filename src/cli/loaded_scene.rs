//! A scene that is ready to render: from the arguments to the hierarchy.

use super::progress::Manner;
use super::{SceneArgs, say};
use bdpm::accel::Intersect;
use bdpm::base::error::{Error, Result};
use bdpm::import::SceneSummary;
use bdpm::render::Renderer;
use bdpm::scene::Scene;
use bdpm::scene::backend;
use bdpm::scene::backend::Backend;
use bdpm::settings::provenance::{Provenance, Reuse};
use bdpm::settings::{PartialSettings, Settings};
use std::path::Path;
use std::time::{Duration, Instant};

#[derive(clap::Args)]
pub struct SessionArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Render for about this long, such as 30s, 2m or 1h; at least one iteration, which must not take
    /// far longer
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    pub time: Option<Duration>,
    /// Number of threads; the image does not depend on it [default: all processors]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Show nothing but errors
    #[arg(long, short)]
    pub quiet: bool,
    /// How to tell how far it is
    #[arg(long, value_name = "MANNER", default_value = "text", conflicts_with = "quiet")]
    progress: Manner,
}

impl SessionArgs {
    /// How to tell how far it is.
    pub fn manner(&self) -> Manner {
        if self.quiet { Manner::Nothing } else { self.progress }
    }
}

/// What there is of an image: what it was made of, its file, and what is done with it.
#[derive(Clone, Copy)]
pub struct Continuation<'a> {
    pub origin: &'a Provenance,
    pub file: &'a Path,
    pub reuse: Reuse,
}

/// A scene ready to render.
pub struct LoadedScene {
    pub threads: rayon::ThreadPool,
    pub scene: Scene,
    pub summary: SceneSummary,
    pub accel: Box<dyn Intersect>,
    pub origin: Provenance,
    pub load_time: Duration,
    pub build_time: Duration,
}

impl LoadedScene {
    /// Loads the scene and builds its hierarchy, for an image that may have begun.
    pub fn new(args: &SessionArgs, begun: Option<Continuation>) -> Result<Self> {
        Self::with_wishes(args, args.scene.wishes.clone(), begun)
    }

    /// The same for the first time, at `resolution` unless the arguments say otherwise: that of the
    /// scene file does not count.
    pub fn with_resolution(args: &SessionArgs, resolution: [u32; 2]) -> Result<Self> {
        let mut wishes = args.scene.wishes.clone();
        wishes.resolution.get_or_insert(resolution);
        Self::with_wishes(args, wishes, None)
    }

    fn with_wishes(
        args: &SessionArgs,
        asked: PartialSettings,
        begun: Option<Continuation>,
    ) -> Result<Self> {
        let threads = rayon::ThreadPoolBuilder::new()
            .num_threads(args.threads.unwrap_or(0).into())
            .build()
            .map_err(|e| Error::new(format!("cannot start the threads: {e}"), "lower --threads"))?;
        let start = Instant::now();
        let loaded = threads.install(|| args.scene.load())?;
        let load_time = start.elapsed();
        if !args.quiet {
            loaded.warnings.iter().for_each(|note| say(&format!("note: {note}")));
        }
        let (scene, summary) = (loaded.scene, loaded.summary);
        // A resumed image has its own settings; arguments that agree with them do no harm.
        let defaults = begun.map_or(loaded.defaults, |begun| (&begun.origin.settings).into());
        let settings = Settings::resolve(&asked, &defaults, scene.size())?;
        let begun_backend = begun.and_then(|Continuation { origin, .. }| {
            Backend::ALL.into_iter().find(|backend| backend.name() == origin.backend)
        });
        let backend = args.scene.accel.or(begun_backend).unwrap_or_default();
        let origin = Provenance {
            version: env!("CARGO_PKG_VERSION").into(),
            scene: scene.name.clone(),
            fingerprint: scene.fingerprint(),
            backend: backend.name().into(),
            settings,
        };
        if let Some(Continuation { origin: begun, file, reuse }) = begun {
            begun.check_agrees(&origin, reuse).map_err(|e| e.at(file))?;
        }
        let start = Instant::now();
        let accel = threads.install(|| backend::build(backend, &scene))?;
        let build_time = start.elapsed();
        Ok(Self { threads, scene, summary, accel, origin, load_time, build_time })
    }

    /// A renderer from the first iteration.
    pub fn renderer(&self) -> Result<Renderer<'_>> {
        let settings = self.origin.settings.clone();
        self.threads.install(|| Renderer::new(&self.scene, &*self.accel, settings))
    }
}
