//! Jobs that render in the background.

use crate::arrays;
use crate::calibrate::Timings;
use crate::error::{positive, raised};
use crate::job_thread::JobThread;
use crate::plan::Plan;
use crate::progress::Progress;
use crate::result::RenderResult;
use crate::scene::Scene;
use crate::settings::{self, OBJECTIVES, unknown, word};
use bdpm::adaptive::stopping::Target;
use bdpm::image_io::ToneMapping;
use bdpm::output::layers::{LayerName, LayerSelection};
use bdpm::settings::PartialSettings;
use bdpm::{RenderJob, Stop};
use numpy::PyArray3;
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use pyo3::types::{PyBytes, PyDict};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// A render in the background. `bdpm.start` makes it.
///
/// A notebook shows the image so far. If a Job is deleted, its render ends.
#[pyclass(frozen, weakref, module = "bdpm")]
pub struct Job {
    thread: JobThread,
    layers: LayerSelection,
    keeps_noise: bool,
    result: Mutex<Option<PyResult<Py<RenderResult>>>>,
}

#[pymethods]
impl Job {
    /// Waits for the end of the render and returns its result.
    ///
    /// `progress` is called with a `Progress` up to 20 times per second. If it returns False, the
    /// render ends with the present image. Ctrl-C does that as well; a second Ctrl-C raises
    /// KeyboardInterrupt.
    #[pyo3(signature = (progress=None))]
    fn result(
        &self,
        py: Python<'_>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Py<RenderResult>> {
        self.thread.wait(py, progress)?;
        self.finished(py)
    }

    /// Asks the render to end after the current iteration.
    fn stop(&self) {
        self.thread.stop();
    }

    /// True if the render has ended.
    #[getter]
    fn done(&self) -> bool {
        self.thread.is_finished()
    }

    /// Progress after the latest iteration.
    #[getter]
    fn progress(&self) -> Progress {
        self.thread.progress()
    }

    /// The image so far: radiance, W/(m^2 sr), float32 of shape (height, width, 3). Waits for the
    /// end of the current iteration. None while the technique is chosen.
    #[getter]
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<f32>>>> {
        if let Some(snapshot) = self.thread.snapshot(py)? {
            return Ok(Some(arrays::colors(py, snapshot.pixels, snapshot.size)?));
        }
        if self.thread.is_finished() {
            return Ok(Some(self.finished(py)?.get().image(py)));
        }
        Ok(None)
    }

    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let Some(image) = self.image(py)? else { return Ok(None) };
        let png = arrays::png(&image, ToneMapping::default())?;
        Ok(Some(PyBytes::new(py, &png)))
    }

    fn __repr__(&self) -> String {
        let progress = self.progress();
        format!("<Job: {:.0} %, {} iterations>", 100.0 * progress.done, progress.iterations)
    }
}

impl Job {
    /// The result of a render that has ended.
    fn finished(&self, py: Python<'_>) -> PyResult<Py<RenderResult>> {
        // Another thread may hold the lock while it waits for the interpreter.
        let result = self.result.lock_py_attached(py);
        let mut result = result.unwrap_or_else(PoisonError::into_inner);
        if result.is_none() {
            let outcome = self.thread.take_outcome(py).expect("a job ends with an outcome");
            let converted = outcome.and_then(|outcome| {
                let layers = self.layers.clone();
                Py::new(py, RenderResult::new(py, outcome, layers, self.keeps_noise)?)
            });
            *result = Some(converted);
        }
        match result.as_ref().expect("it was just set") {
            Ok(result) => Ok(result.clone_ref(py)),
            Err(error) => Err(error.clone_ref(py)),
        }
    }
}

/// Keywords of [`start`] beside the settings, for errors.
const KEYWORDS: &[&str] = &[
    "time",
    "target_error",
    "target_rms",
    "iterations",
    "objective",
    "plan",
    "timings",
    "denoise",
    "layers",
    "noise",
    "threads",
    "accel",
];

/// Starts to render a scene in the background and returns a `Job`. The arguments are those of
/// `bdpm.render`.
#[pyfunction]
#[pyo3(signature = (
    scene, *, time=None, target_error=None, target_rms=None, iterations=None, objective="relative", plan=None,
    timings=None, denoise=false, layers=None, noise=false, threads=None, accel=None, **settings
))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments")]
pub fn start(
    scene: &Scene,
    time: Option<&Bound<'_, PyAny>>,
    target_error: Option<f64>,
    target_rms: Option<&Bound<'_, PyAny>>,
    iterations: Option<u64>,
    objective: &str,
    plan: Option<&Plan>,
    timings: Option<&Timings>,
    denoise: bool,
    layers: Option<Vec<String>>,
    noise: bool,
    threads: Option<u16>,
    accel: Option<&str>,
    settings: Option<&Bound<'_, PyDict>>,
) -> PyResult<Job> {
    let time = time.map(|time| settings::time("time", time)).transpose()?;
    let error = target_error.map(|error| positive("target_error", error, "0.02 for 2 %"));
    let target = target_rms.map(target).transpose()?;
    let objective = word("objective", objective, &OBJECTIVES)?;
    let stop =
        Stop { iterations, time, target, error: error.transpose()?, objective, ..Stop::default() };
    let layers = layer_selection(layers)?;
    let settings = settings::settings(settings, KEYWORDS)?;
    let job = RenderJob::new(&scene.loaded)
        .backend(settings::backend(accel)?)
        .threads(settings::threads(threads)?)
        .stop(stop)
        .aovs(layers.aovs())
        .denoise(denoise)
        .pixel_noise(noise);
    let job = match timings {
        Some(timings) => job.times(timings.timings.clone(), Path::new("<timings>")),
        None => job,
    };
    let job = match plan {
        Some(plan) => with_plan(job, plan, &settings),
        None => job,
    };
    let thread = JobThread::start(job.settings(settings));
    Ok(Job { thread, layers, keeps_noise: noise, result: Mutex::default() })
}

/// A plan with an open number of iterations fixes neither the seed nor the version.
fn with_plan(job: RenderJob, plan: &Plan, settings: &PartialSettings) -> RenderJob {
    let mut made_by = plan.made_by.clone();
    if plan.plan.iterations().is_none() {
        made_by.version = env!("CARGO_PKG_VERSION").into();
        made_by.settings.seed = settings.seed.unwrap_or(made_by.settings.seed);
    }
    job.plan(plan.plan.clone(), made_by, &plan.origin)
}

/// A pooled RMS: a luminance, or text such as "1%" for a share of the mean luminance.
pub fn target(value: &Bound<'_, PyAny>) -> PyResult<Target> {
    value.str()?.to_str()?.parse().map_err(raised)
}

fn layer_selection(names: Option<Vec<String>>) -> PyResult<LayerSelection> {
    let Some(names) = names else { return Ok(LayerSelection::new(&[])) };
    let known = LayerName::ALL.map(LayerName::name);
    let named =
        |name: &String| LayerName::named(name).ok_or_else(|| unknown("layers", name, &known));
    let names = names.iter().map(named).collect::<PyResult<Vec<_>>>()?;
    let none = [LayerName::None];
    Ok(LayerSelection::new(if names.is_empty() { &none } else { &names }))
}
