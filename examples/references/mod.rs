//! Scenes at a size with long renders of them, kept from one run to the next; the error of other
//! renders.

use bdpm::accel::Intersect;
use bdpm::adaptive::error_interval::ErrorInterval;
use bdpm::adaptive::stopping::{importance, without_noise};
use bdpm::adaptive::technique::{Candidate, FreeParameters, Technique};
use bdpm::film::radiance::{luminance, luminance_weights};
use bdpm::load::load;
use bdpm::render::block;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::{PartialSettings, Strategy};
use bdpm::{RenderJob, RenderResult, Scene, Settings, Stop};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

pub type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Seconds of each half of a reference, unless the variable `REFERENCE` says otherwise.
const REFERENCE: f64 = 40.0;

fn reference_seconds() -> Result<f64> {
    match std::env::var("REFERENCE") {
        Ok(text) => text.parse().map_err(|_| format!("REFERENCE={text} is no number").into()),
        Err(_) => Ok(REFERENCE),
    }
}

/// A scene at a size.
pub struct Subject {
    scene: Arc<Scene>,
    accel: Arc<dyn Intersect>,
    pub settings: Settings,
    name: String,
    /// The reference is rendered by path tracing.
    by_path: bool,
}

/// An image and what the program says of it.
pub struct Image {
    pub luminance: Vec<f64>,
    pub chosen: Candidate,
    /// Relative squared noise.
    pub noise2: f64,
    /// Squared noise that a second more of rendering would leave, alone: time times variance of an
    /// iteration; `None` after too few iterations.
    pub cost: Option<f64>,
    /// Relative error that was promised.
    pub promised: Option<Stated>,
    /// Relative error that is reported.
    pub reported: Option<Stated>,
    /// Means of `a`, `b` and `f` over the pixels, relative.
    pub parts: [f64; 3],
}

/// A relative error as the program states it.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Stated {
    pub error: f64,
    pub interval: ErrorInterval,
}

impl Stated {
    fn new(error: Option<f64>, interval: Option<ErrorInterval>) -> Option<Self> {
        Some(Self { error: error?, interval: interval? })
    }
}

/// A technique at its radii.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Place {
    pub technique: Technique,
    pub radius: f32,
    pub caustic_radius: f32,
}

/// Does something with a scene of `scenes/`, or of any path, at so many pixels along each side.
/// With `@path` after its name, the reference is rendered by path tracing, which shares no photons
/// with the images. Only scenes whose light path tracing finds well have such a reference.
pub fn with<T>(
    scene: &str,
    side: u32,
    work: impl FnOnce(&Subject, &Reference) -> Result<T>,
) -> Result<T> {
    let (scene, by_path) = match scene.strip_suffix("@path") {
        Some(scene) => (scene, true),
        None => (scene, false),
    };
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(scene);
    let loaded = load(if own.exists() { own } else { PathBuf::from(scene) })?;
    let accel = build(Backend::default(), &loaded.scene)?;
    let wishes = PartialSettings { resolution: Some([side; 2]), ..Default::default() };
    let settings = Settings::resolve(&wishes, &loaded.defaults, loaded.scene.size())?;
    let scene = scene.trim_matches('/').replace('/', "-");
    let name = format!("{scene}-{side}{}", if by_path { "-by-path" } else { "" });
    let subject = Subject { scene: loaded.scene, accel, settings, name, by_path };
    let reference = Reference::new(&subject)?;
    work(&subject, &reference)
}

impl Subject {
    /// Reads the value that an earlier run kept for `key`, or computes and keeps it.
    pub fn kept<T: Serialize + DeserializeOwned>(
        &self,
        key: &str,
        make: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        let folder = std::env::var_os("MEASURED").map_or_else(
            || Path::new(env!("CARGO_MANIFEST_DIR")).join("target/measured"),
            PathBuf::from,
        );
        fs::create_dir_all(&folder)?;
        let file = folder.join(format!("{}-{key}.json", self.name));
        if let Ok(text) = fs::read_to_string(&file) {
            return Ok(serde_json::from_str(&text)?);
        }
        let made = make()?;
        let new = file.with_extension("new");
        fs::write(&new, serde_json::to_string(&made)?)?;
        fs::rename(new, file)?;
        Ok(made)
    }

    /// Renders for so many seconds, with what is open chosen for that.
    pub fn render(&self, settings: Settings, open: FreeParameters, seconds: f64) -> Result<Image> {
        let job = RenderJob::from_scene(&self.scene)
            .acceleration(Backend::default(), Arc::clone(&self.accel))
            .settings((&settings).into())
            .free_parameters(open)
            .stop(Stop::time(Duration::from_secs_f64(seconds)));
        // Only renders that choose their technique are checked, as those of the program.
        let job = if open.any() { job } else { job.audit(0.0) };
        let RenderResult { mut state, error, .. } = job.render()?;
        state.estimate();
        let elapsed = state.elapsed().as_secs_f64();
        let pace = state.policy.iteration_time(&state.renderer, state.totals.iterations, elapsed);
        let convergence = state.status.convergence.as_ref().ok_or("nothing was rendered")?;
        let image = state.image();
        let importance = importance(image.blocks(), state.stop.objective);
        let mut parts = [0.0; 3];
        let coefficients = block::coefficients(image.blocks()).unwrap_or_default();
        for (own, weight) in coefficients.iter().zip(&importance) {
            let of_pixel = [own.a, own.b, own.f];
            for (sum, part) in parts.iter_mut().zip(of_pixel) {
                *sum += weight * part / importance.len() as f64;
            }
        }
        let cost = convergence.per_iteration.zip(pace).map(|(v, tau)| v * tau);
        let pixels = image.mean().into_iter().map(|value| luminance(value.as_dvec3()));
        Ok(Image {
            luminance: pixels.collect(),
            chosen: *state.selection.as_ref().ok_or("the pilot did not run")?.best(),
            cost: cost.filter(|c| *c > 0.0),
            noise2: convergence.weighted_variance.unwrap_or(f64::NAN),
            promised: state
                .promise()
                .and_then(|promise| Stated::new(promise.error, promise.interval)),
            reported: error.and_then(|error| Stated::new(Some(error.total), error.interval)),
            parts,
        })
    }

    /// One half of the reference: by path tracing, or at narrow radii, so that its bias is small.
    fn half(&self, seed: u64) -> Result<Vec<f64>> {
        let own = &self.settings;
        if self.by_path {
            let strategy = Strategy::Path;
            let traced = Settings { strategy, merge_vertex: 2, guide: 0, seed, ..own.clone() };
            return Ok(self.render(traced, FreeParameters::NONE, reference_seconds()?)?.luminance);
        }
        let radius = 0.25 * own.radius;
        let narrow = Settings { radius, caustic_radius: 0.4 * radius, seed, ..own.clone() };
        let strategy = FreeParameters { strategy: true, ..FreeParameters::NONE };
        Ok(self.render(narrow, strategy, reference_seconds()?)?.luminance)
    }

    /// Settings of the scene with a technique at its radii.
    pub fn settings(&self, place: &Place, seed: u64) -> Settings {
        let Place { technique, radius, caustic_radius } = *place;
        let Technique { strategy, merge_vertex, direct, kernel, splitting, .. } = technique;
        let own = self.settings.clone();
        Settings {
            strategy,
            merge_vertex,
            direct,
            kernel,
            splitting,
            radius,
            caustic_radius,
            seed,
            ..own
        }
    }
}

/// Two images of the same, independent of each other, and weights of the pixels: the root of the
/// mean of `(x - A)(x - B)/(L^2 + 0.01 mean(L)^2)` is an error without the noise of either, which
/// does not meet itself. `L` as the program itself weighs errors, theory.md (70a), by the mean of
/// both, whose variance is `(A - B)^2/4`.
pub struct Reference {
    halves: [Vec<f64>; 2],
    weights: Vec<f64>,
}

impl Reference {
    fn new(subject: &Subject) -> Result<Self> {
        let half = |seed: u64| subject.kept(&format!("reference-{seed}"), || subject.half(seed));
        let halves = [half(101)?, half(102)?];
        let pairs = || halves[0].iter().zip(&halves[1]);
        let mean: Vec<f64> = pairs().map(|(a, b)| 0.5 * (a + b)).collect();
        let variance: Vec<f64> = pairs().map(|(a, b)| 0.25 * (a - b).powi(2)).collect();
        let Settings { width, height, .. } = subject.settings;
        let each: Vec<[f64; 2]> = pairs().map(|(a, b)| [*a, *b]).collect();
        let clean = without_noise(&mean, &variance, Some(&each), (width, height));
        let weights = luminance_weights(&clean);
        Ok(Self { halves, weights })
    }

    /// Squared relative error.
    pub fn square(&self, image: &[f64]) -> f64 {
        let [a, b] = &self.halves;
        let terms =
            (0..image.len()).map(|i| self.weights[i] * (image[i] - a[i]) * (image[i] - b[i]));
        terms.sum::<f64>() / image.len() as f64
    }
}
