//! Measuring the noise of a scene.

use crate::error::raised;
use crate::job_thread::JobThread;
use crate::noise::Noise;
use crate::scene::Scene;
use crate::settings::{self, word};
use bdpm::adaptive::optimize::Objective;
use bdpm::{RenderJob, Stop};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Iterations if neither a number nor a time is given, as for `bdpm analyze`.
const DEFAULT_ITERATIONS: u64 = 256;

/// Minimum number of iterations for a sample variance.
const MIN_ITERATIONS: u64 = 2;

/// Keywords of [`analyze`] beside the settings, for errors.
const KEYWORDS: &[&str] = &["iterations", "time", "estimator", "threads", "accel", "progress"];

/// Measures the noise coefficients of each pixel at fixed path counts, and returns a `Noise`.
///
/// - `iterations`: number of measured iterations; standard errors need 32
///   [default: 256, without `time`].
/// - `time`: rendering time, seconds or text such as "2m".
/// - `estimator`: "pairs" for all pairs of paths, or "halves" for the estimator of the paper.
/// - `threads`, `accel`, `progress` and the settings: as for `bdpm.render`.
#[pyfunction]
#[pyo3(signature = (
    scene, *, iterations=None, time=None, estimator="pairs", threads=None, accel=None, progress=None, **settings
))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments")]
pub fn analyze(
    py: Python<'_>,
    scene: &Scene,
    iterations: Option<u64>,
    time: Option<&Bound<'_, PyAny>>,
    estimator: &str,
    threads: Option<u16>,
    accel: Option<&str>,
    progress: Option<&Bound<'_, PyAny>>,
    settings: Option<&Bound<'_, PyDict>>,
) -> PyResult<Noise> {
    let estimator = word("estimator", estimator, &["pairs", "halves"])?;
    let time = time.map(|time| settings::time("time", time)).transpose()?;
    let iterations = iterations.or(time.is_none().then_some(DEFAULT_ITERATIONS));
    let job = RenderJob::new(&scene.loaded)
        .settings(settings::settings(settings, KEYWORDS)?)
        .backend(settings::backend(accel)?)
        .threads(settings::threads(threads)?)
        .measure_always(estimator)
        .at_least(MIN_ITERATIONS)
        .stop(Stop { iterations, time, objective: Objective::Pooled, ..Stop::default() });
    let thread = JobThread::start(job);
    thread.wait(py, progress)?;
    let result = thread.take_outcome(py).expect("a job ends with an outcome")?;
    let file = py.detach(|| result.noise_file(estimator)).map_err(raised)?;
    Ok(Noise { file })
}
