//! The time of an iteration.

use crate::error::raised;
use crate::scene::Scene;
use crate::settings;
use bdpm::job::provenance;
use bdpm::scene::backend;
use bdpm::settings::Settings;
use bdpm::timing::calibrate::{Calibration, calibrate as calibrated};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Duration;

/// Measuring time if none is given, as for `bdpm calibrate`.
const DEFAULT_TIME: Duration = Duration::from_secs(45);

/// The time of an iteration, seconds:
///
/// fixed + light_path N_F + (camera_path + look_up) sum(N_B) + merge_pair N_F sum(N_B), summed over
/// the pixels.
///
/// All coefficients depend on scene, settings, resolution and machine.
#[pyclass(frozen, module = "bdpm")]
pub struct Timings {
    pub timings: bdpm::timing::Timings,
}

#[pymethods]
impl Timings {
    /// Reads a file of `bdpm calibrate` or `Timings.save`.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let timings = bdpm::timing::Timings::load(&path).map_err(raised)?;
        Ok(Self { timings })
    }

    /// Writes a JSON file, which `bdpm predict`, `optimize` and `render` read with --timings.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        self.timings.save(&path).map_err(raised)
    }

    /// Seconds per iteration that no count changes.
    #[getter]
    fn fixed(&self) -> f64 {
        self.timings.model.fixed
    }

    /// Seconds per light path.
    #[getter]
    fn light_path(&self) -> f64 {
        self.timings.model.light_path
    }

    /// Seconds per camera path for tracing it.
    #[getter]
    fn camera_path(&self) -> f64 {
        self.timings.model.camera_path
    }

    /// Seconds per camera path for looking up the photon map.
    #[getter]
    fn look_up(&self) -> f64 {
        self.timings.model.look_up
    }

    /// Seconds per pair of a light path and a camera path for merging.
    #[getter]
    fn merge_pair(&self) -> f64 {
        self.timings.model.merge_pair
    }

    /// Seconds per iteration at these counts, equal in every pixel.
    #[pyo3(signature = (*, light_paths, camera_paths))]
    fn iteration(&self, light_paths: f64, camera_paths: f64) -> f64 {
        self.timings.model.iteration(light_paths, camera_paths)
    }

    /// Seconds per iteration by cause: fixed, light paths, camera paths, merging with its look-ups.
    /// The last three are those of Table 2 of the paper.
    #[pyo3(signature = (*, light_paths, camera_paths))]
    fn parts(&self, light_paths: f64, camera_paths: f64) -> (f64, f64, f64, f64) {
        self.timings.model.parts(light_paths, camera_paths).into()
    }

    fn __str__(&self) -> String {
        self.timings.text()
    }

    fn __repr__(&self) -> String {
        format!("<Timings:\n{}>", self.timings.coefficients_table())
    }
}

/// Keywords of [`calibrate`] beside the settings, for errors.
const KEYWORDS: &[&str] = &["time", "threads", "accel"];

/// Measures the time of an iteration at several path counts, and fits a model to it. Returns
/// `Timings`.
///
/// - `time`: measuring time, seconds or text such as "2m"; at least two rounds over all counts are
///   measured [default: 45].
/// - `threads`, `accel` and the settings: as for `bdpm.render`. Counts are chosen.
///
/// Ctrl-C raises KeyboardInterrupt.
#[pyfunction]
#[pyo3(signature = (scene, *, time=None, threads=None, accel=None, **settings))]
pub fn calibrate(
    py: Python<'_>,
    scene: &Scene,
    time: Option<&Bound<'_, PyAny>>,
    threads: Option<u16>,
    accel: Option<&str>,
    settings: Option<&Bound<'_, PyDict>>,
) -> PyResult<Timings> {
    let time = time.map(|time| settings::time("time", time)).transpose()?;
    let time = time.unwrap_or(DEFAULT_TIME);
    let settings = settings::settings(settings, KEYWORDS)?;
    let (threads, backend) = (settings::threads(threads)?, settings::backend(accel)?);
    let backend = backend.unwrap_or_default();
    let scene = &scene.loaded;
    let mut interrupt = None;
    let measured =
        py.detach(|| {
            let settings = Settings::resolve(&settings, &scene.defaults, scene.scene.size())?;
            let accel = threads.install(|| backend::build(backend, &scene.scene))?;
            let provenance = provenance(&scene.scene, backend, settings);
            calibrated((&scene.scene, &accel), &provenance, &threads, time, |_, _| {
                match Python::attach(|py| py.check_signals()) {
                    Ok(()) => ControlFlow::Continue(()),
                    Err(error) => {
                        interrupt = Some(error);
                        ControlFlow::Break(())
                    }
                }
            })
        });
    match measured.map_err(raised)? {
        Some(Calibration { timings, .. }) => Ok(Timings { timings }),
        None => Err(interrupt.unwrap_or_else(|| PyKeyboardInterrupt::new_err(()))),
    }
}
