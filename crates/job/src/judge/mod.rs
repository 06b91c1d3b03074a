//! Judges an image of a scene that any program rendered: is it right?
//!
//! The judge renders its own estimate by path tracing, until it can tell: theory.md, section 22c.
//! Its cells, tiles and scores are those of an audit.

mod findings;

pub use findings::{Findings, JudgeVerdict, Judgment, NoiseSource};

use crate::job::thread_pool;
use bdpm_core::accel::Intersect;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::film::radiance::luminance;
use bdpm_core::render::Renderer;
use bdpm_core::render::audit::{Auditor, brightest_path};
use bdpm_core::scene::Scene;
use bdpm_core::scene::backend;
use bdpm_core::scene::backend::Backend;
use bdpm_core::settings::{Kernel, PartialSettings, Settings, Strategy};
use bdpm_load::Loaded;
use rayon::ThreadPool;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Time of the judge's own estimate, unless it can tell earlier.
pub const DEFAULT_TIME: Duration = Duration::from_secs(60);

/// Relative differences of this size must be excluded before a judge ends early, unless a precision
/// is given.
pub const DEFAULT_PRECISION: f64 = 0.01;

/// Relative differences of this size must be excluded at the end before an image is right, unless a
/// precision is given. The verdict names the difference that is excluded.
pub const ACCEPTED_PRECISION: f64 = 0.05;

/// Smallest precision that can be given.
pub const LEAST_PRECISION: f64 = 1e-4;

/// Number of looks at the images. The time doubles from one to the next.
const LOOKS: u32 = 6;

/// Minimum steps of the estimate before the first look, so that its noise is known.
const MIN_STEPS: u64 = 8;

/// Judges one or two images of a scene.
pub struct JudgeJob {
    scene: Arc<Scene>,
    defaults: PartialSettings,
    settings: PartialSettings,
    images: Vec<Vec<f64>>,
    size: (u32, u32),
    backend: Option<Backend>,
    threads: Option<Arc<ThreadPool>>,
    time: Duration,
    /// Precision at which the judge ends early, and that at its end.
    precision: f64,
    accepted: f64,
    interrupt: Arc<AtomicBool>,
}

impl JudgeJob {
    /// Judges images of this size: radiances of all pixels, W/(m^2 sr), in row order. Two images
    /// must have independent noise, such as those of two seeds.
    ///
    /// # Errors
    /// Unless there are one or two images, which have this size and finite values.
    pub fn new(loaded: &Loaded, images: &[Vec<Rgb>], size: (u32, u32)) -> Result<Self> {
        if !(1..=2).contains(&images.len()) {
            let problem = format!("there are {} images", images.len());
            return Err(Error::new(problem, "give one image, or two of different seeds"));
        }
        if images.iter().any(|image| image.len() as u64 != u64::from(size.0) * u64::from(size.1)) {
            let advice = "give two images of the same resolution";
            return Err(Error::new("the images differ in size", advice));
        }
        if let Some(index) = images.iter().flatten().position(|pixel| !pixel.is_finite()) {
            let index = index as u32 % (size.0 * size.1);
            let (x, y) = (index % size.0, index / size.0);
            let problem = format!("pixel ({x}, {y}) of the image is not finite");
            return Err(Error::new(
                problem,
                "replace it, since no estimate can be compared with it",
            ));
        }
        if images.len() == 2 && images[0] == images[1] {
            let advice = "render the second image with another seed, or give one image";
            return Err(Error::new(
                "both images are equal, so that their noise is unknown",
                advice,
            ));
        }
        let luminances =
            |image: &Vec<Rgb>| image.iter().map(|own| luminance(own.as_dvec3())).collect();
        Ok(Self {
            scene: Arc::clone(&loaded.scene),
            defaults: loaded.defaults.clone(),
            settings: PartialSettings::default(),
            images: images.iter().map(luminances).collect(),
            size,
            backend: None,
            threads: None,
            time: DEFAULT_TIME,
            precision: DEFAULT_PRECISION,
            accepted: ACCEPTED_PRECISION,
            interrupt: Arc::default(),
        })
    }

    /// Fixes settings of the judge's estimate, such as its seed and the crop of the images.
    #[must_use]
    pub fn settings(self, settings: PartialSettings) -> Self {
        Self { settings, ..self }
    }

    /// Finds intersections with this backend [default: Embree if the crate was built with it].
    #[must_use]
    pub fn backend(self, backend: Option<Backend>) -> Self {
        Self { backend, ..self }
    }

    /// Judges on these threads [default: one per processor].
    #[must_use]
    pub fn threads(self, threads: Arc<ThreadPool>) -> Self {
        Self { threads: Some(threads), ..self }
    }

    /// Ends after about this time at the latest [default: 60 s].
    #[must_use]
    pub fn time(self, time: Duration) -> Self {
        Self { time, ..self }
    }

    /// Calls an image right only if relative differences of this size are excluded [default: 0.05;
    /// the judge ends early at 0.01]. At least [`LEAST_PRECISION`].
    #[must_use]
    pub fn precision(self, precision: f64) -> Self {
        let precision = precision.max(LEAST_PRECISION);
        Self { precision, accepted: precision, ..self }
    }

    /// Ends with the present result once this flag is set.
    #[must_use]
    pub fn interrupted_by(self, interrupt: Arc<AtomicBool>) -> Self {
        Self { interrupt, ..self }
    }

    /// Judges the images. `observer` gets the share of the time that has passed.
    ///
    /// # Errors
    /// If the scene has no light, the image is smaller than 8 by 8 pixels, or the memory does not
    /// suffice.
    pub fn run(self, mut observer: impl FnMut(f64) + Send) -> Result<Judgment> {
        let threads = match &self.threads {
            Some(threads) => Arc::clone(threads),
            None => Arc::new(thread_pool(0)?),
        };
        threads.install(|| self.judge(&mut observer))
    }

    fn judge(&self, observer: &mut (impl FnMut(f64) + Send)) -> Result<Judgment> {
        let start = Instant::now();
        let accel = backend::build(self.backend.unwrap_or_default(), &self.scene)?;
        let mut auditor = self.auditor(&accel)?;
        let brightest = brightest_path(&self.scene);
        let mut number = 0;
        for look in 0..LOOKS {
            let until = self.time.mul_f64(0.5f64.powi((LOOKS - 1 - look) as i32));
            while number < MIN_STEPS || start.elapsed() < until {
                auditor.step(number);
                number += 1;
                observer(start.elapsed().as_secs_f64() / self.time.as_secs_f64().max(1e-9));
                if self.interrupt.load(Ordering::Relaxed) {
                    break;
                }
            }
            let findings =
                Findings::new(auditor.sums(), (&self.images, self.size), brightest, LOOKS)
                    .ok_or_else(|| {
                        let advice = "judge an image of at least 8 by 8 pixels";
                        Error::new("the image is too small to be judged", advice)
                    })?;
            let is_last = look + 1 == LOOKS || self.interrupt.load(Ordering::Relaxed);
            if is_last || findings.is_wrong() || findings.is_right(self.precision) {
                let settings = self.resolved()?;
                let place = (&*self.scene, &*accel, &settings);
                return Ok(findings.judgment(place, self.accepted, start.elapsed()));
            }
        }
        unreachable!("the last look returns")
    }

    /// Settings of the estimate.
    fn resolved(&self) -> Result<Settings> {
        let (width, height) = self.size;
        let mut given = self.settings.clone();
        if given.crop.is_none() {
            given.resolution = Some([width, height]);
        }
        let own = Settings::resolve(&given, &self.defaults, self.scene.size())?;
        if own.resolution() != self.size {
            let (w, h) = own.resolution();
            let problem =
                format!("the image has {width}x{height} pixels, and the settings {w}x{h}");
            return Err(Error::new(
                problem,
                "leave out the resolution, or give that of the full image",
            ));
        }
        // Photons merge only for light that path tracing does not find.
        let (strategy, merge_vertex) = (Strategy::Single, 1);
        Ok(Settings { strategy, merge_vertex, guide: 0, sobol_set: 1, splitting: 1, ..own })
    }

    fn auditor(&self, accel: &Arc<dyn Intersect>) -> Result<Auditor> {
        let settings = self.resolved()?;
        // Areas of surfaces take time, and matter for photons alone.
        let needs_areas = bdpm_core::render::photon_only_light::has_photon_only_light(&self.scene);
        let kernel = if needs_areas { settings.kernel } else { Kernel::Disc };
        let renderer = Renderer::new(&self.scene, accel, Settings { kernel, ..settings })?;
        Auditor::of_any(&renderer)
    }
}

#[cfg(test)]
mod tests;
