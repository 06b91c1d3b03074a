//! The measured noise of an image, predictions and best counts.

use crate::arrays;
use crate::calibrate::Timings;
use crate::error::raised;
use crate::estimate::Estimate;
use crate::job::target;
use crate::plan::Plan;
use crate::settings::{self, OBJECTIVES, word};
use crate::tables;
use bdpm::adaptive::optimize::compared::{ComparedCounts, CountsRow, RowName};
use bdpm::adaptive::optimize::measured::{Budget, MeasuredProblem};
use bdpm::adaptive::optimize::predict::{RenderTime, Source, Timed};
use bdpm::film::counts::{CameraCounts, Counts};
use bdpm::noise::file::NoiseFile;
use bdpm::noise::image::PixelEstimate;
use bdpm::noise::region;
use bdpm::settings::MAX_LIGHT_PATHS;
use bdpm::settings::provenance::Provenance;
use bdpm::timing::TimeModel;
use numpy::{PyArray2, PyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::PathBuf;

/// Measured noise coefficients of each pixel.
///
/// The variance of the luminance of one iteration with `N_F` light paths and `N_B` camera paths per
/// pixel is a/(N_F N_B) + b/N_B + f/N_F.
#[pyclass(frozen, module = "bdpm")]
pub struct Noise {
    pub file: NoiseFile,
}

type Image<'py> = PyResult<Bound<'py, PyArray2<f32>>>;

impl Noise {
    fn values<'py>(&self, py: Python<'py>, of: impl Fn(&PixelEstimate) -> f64) -> Image<'py> {
        let noise = &self.file.noise;
        let values = noise.pixels.iter().map(|pixel| of(pixel) as f32).collect();
        arrays::values(py, values, (noise.width, noise.height))
    }

    /// Indices of the pixels of a region.
    fn region(&self, region: Option<&str>) -> bdpm::Result<Vec<usize>> {
        let region = region::find(region, &self.file.regions)?;
        region::pixels(&region, &self.file.noise)
    }

    /// The time model, if it belongs to this image.
    fn model(&self, timings: &Timings) -> bdpm::Result<TimeModel> {
        let NoiseFile { noise, facts, .. } = &self.file;
        timings.timings.check_fits(facts, noise.width, noise.height)?;
        Ok(timings.timings.model)
    }
}

#[pymethods]
impl Noise {
    /// Reads a noise file of `bdpm analyze`, `bdpm render --noise` or `Noise.save`.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let file = py.detach(|| NoiseFile::read(&path)).map_err(raised)?;
        Ok(Self { file })
    }

    /// Writes a noise file (EXR), which `bdpm predict` and `bdpm optimize` read as well.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.file.write(&path)).map_err(raised)
    }

    /// Coefficient `a`, squared luminance: float32 of shape (height, width).
    #[getter]
    fn a<'py>(&self, py: Python<'py>) -> Image<'py> {
        self.values(py, |pixel| pixel.noise.coefficients.a)
    }

    /// Coefficient `b`, squared luminance: float32 of shape (height, width).
    #[getter]
    fn b<'py>(&self, py: Python<'py>) -> Image<'py> {
        self.values(py, |pixel| pixel.noise.coefficients.b)
    }

    /// Coefficient `f`, squared luminance: float32 of shape (height, width).
    #[getter]
    fn f<'py>(&self, py: Python<'py>) -> Image<'py> {
        self.values(py, |pixel| pixel.noise.coefficients.f)
    }

    /// Sample variance of the luminance of one iteration at the measured counts, which does not
    /// depend on the law: float32 of shape (height, width).
    #[getter]
    fn sampled_variance<'py>(&self, py: Python<'py>) -> Image<'py> {
        self.values(py, |pixel| pixel.noise.sampled)
    }

    /// Mean luminance, W/(m^2 sr): float32 of shape (height, width).
    #[getter]
    fn luminance<'py>(&self, py: Python<'py>) -> Image<'py> {
        self.values(py, |pixel| pixel.luminance)
    }

    /// The image: radiance, W/(m^2 sr), float32 of shape (height, width, 3).
    #[getter]
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let NoiseFile { noise, pixels, .. } = &self.file;
        arrays::colors(py, pixels.clone(), (noise.width, noise.height))
    }

    /// Light paths per iteration while the noise was measured.
    #[getter]
    fn light_paths(&self) -> u32 {
        self.file.noise.light_paths
    }

    /// Camera paths per pixel and iteration while the noise was measured.
    #[getter]
    fn camera_paths(&self) -> u32 {
        self.file.noise.camera_paths
    }

    /// Number of measured iterations.
    #[getter]
    fn iterations(&self) -> u64 {
        self.file.noise.iterations
    }

    /// Names of the regions of the image.
    #[getter]
    fn regions(&self) -> Vec<String> {
        self.file.regions.iter().map(|region| region.name.clone()).collect()
    }

    /// Predicts the noise of one iteration at any path counts, and after `time` if
    /// `timings` are given.
    ///
    /// - `region`: name of a region, or "x0,y0,x1,y1" in fractions of the image; by default the
    ///   whole image.
    /// - `timings`: the times of an iteration, from `bdpm.calibrate`.
    #[pyo3(signature = (*, light_paths, camera_paths, region=None, timings=None, time=None))]
    fn predict(
        &self,
        py: Python<'_>,
        light_paths: f64,
        camera_paths: f64,
        region: Option<&str>,
        timings: Option<&Timings>,
        time: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Prediction> {
        for (name, value) in [("light_paths", light_paths), ("camera_paths", camera_paths)] {
            if !(value >= 1.0 && value.is_finite()) {
                let text = format!("{name} is {value}: give a number of at least 1");
                return Err(PyValueError::new_err(text));
            }
        }
        let render = match (timings, time) {
            (Some(timings), Some(time)) => {
                let model = self.model(timings).map_err(raised)?;
                Some(RenderTime { model, time: settings::time("time", time)?.as_secs_f64() })
            }
            (None, None) => None,
            _ => return Err(PyValueError::new_err("give both timings and time, or none of them")),
        };
        let pixels = self.region(region).map_err(raised)?;
        let predicted = py.detach(|| {
            let source = Source::Measured(&self.file.noise, &pixels);
            source.predict(light_paths, camera_paths, render.as_ref())
        });
        Ok(Prediction(predicted))
    }

    /// Finds the path counts with the least noise, given the times of an iteration.
    ///
    /// - `timings`: from `bdpm.calibrate`, for the same scene and settings.
    /// - `time`: rendering time, seconds or text such as "2m"; at least 16 iterations fit in it.
    /// - `target_rms`: RMS to reach: luminance, W/(m^2 sr), or text such as "1%" of the mean
    ///   luminance of the region.
    /// - `objective`: "relative", "pooled", "mean-rms" or "max-rms".
    /// - `region`: name of a region, or "x0,y0,x1,y1" in fractions of the image; by default the
    ///   whole image.
    /// - `per_pixel`: choose a number of camera paths for each pixel.
    #[pyo3(signature = (
        timings, *, time=None, target_rms=None, objective="relative", region=None, per_pixel=false
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments")]
    fn optimize(
        &self,
        py: Python<'_>,
        timings: &Timings,
        time: Option<&Bound<'_, PyAny>>,
        target_rms: Option<&Bound<'_, PyAny>>,
        objective: &str,
        region: Option<&str>,
        per_pixel: bool,
    ) -> PyResult<BestCounts> {
        let pixels = self.region(region).map_err(raised)?;
        let objective = word("objective", objective, &OBJECTIVES)?;
        let model = self.model(timings).map_err(raised)?;
        let noise = &self.file.noise;
        let source = Source::Measured(noise, &pixels);
        let budget = match (time, target_rms) {
            (None, None) => Budget::Unbounded,
            (Some(time), None) => Budget::Time(settings::time("time", time)?.as_secs_f64()),
            (None, Some(rms)) => Budget::to_target(target(rms)?, &source).map_err(raised)?,
            _ => return Err(PyValueError::new_err("give time or target_rms, not both")),
        };
        let (rows, counts) = py.detach(|| {
            let measured = MeasuredProblem::new(source, objective, model);
            let light_paths = 1..=MAX_LIGHT_PATHS;
            let problem = measured.problem(light_paths.clone(), budget);
            let image = noise.width * noise.height;
            let compared = ComparedCounts::new(&measured, &problem, &light_paths, image, per_pixel);
            (compared.rows(&measured, budget), compared.recommended().clone())
        });
        let best = if per_pixel { RowName::PerPixel } else { RowName::Uniform };
        let best = rows.iter().position(|row| row.name == best);
        let best = best.expect("the recommended counts are among the compared ones");
        let made_by = Provenance::from_metadata(&self.file.facts_with(&counts)).map_err(raised)?;
        Ok(BestCounts { size: (noise.width, noise.height), rows, best, counts, made_by })
    }

    fn __repr__(&self) -> String {
        let noise = &self.file.noise;
        format!(
            "<Noise: {}x{} pixels, {} iterations of {} light paths and {} camera paths>",
            noise.width, noise.height, noise.iterations, noise.light_paths, noise.camera_paths
        )
    }
}

/// Predicted noise at one pair of path counts. Luminances are in W/(m^2 sr).
#[pyclass(frozen, module = "bdpm")]
pub struct Prediction(bdpm::adaptive::optimize::predict::Prediction);

#[pymethods]
impl Prediction {
    /// Light paths per iteration.
    #[getter]
    fn light_paths(&self) -> f64 {
        self.0.light_paths
    }

    /// Camera paths per pixel and iteration.
    #[getter]
    fn camera_paths(&self) -> f64 {
        self.0.camera_paths
    }

    /// Pooled RMS of one iteration: the root of the mean variance of the pixels.
    #[getter]
    fn pooled_rms(&self) -> Estimate {
        self.0.pooled_rms.into()
    }

    /// Mean RMS of one iteration: the mean of the RMS of the pixels.
    #[getter]
    fn mean_rms(&self) -> Estimate {
        self.0.mean_rms.into()
    }

    /// Time of one iteration, seconds, if timings were given.
    #[getter]
    fn iteration_time(&self) -> Option<f64> {
        self.0.timed.map(|timed: Timed| timed.tau)
    }

    /// Iterations in the time, not rounded, if timings were given.
    #[getter]
    fn iterations(&self) -> Option<f64> {
        self.0.timed.map(|timed| timed.iterations)
    }

    /// Pooled RMS after the time, if timings were given.
    #[getter]
    fn pooled_rms_after(&self) -> Option<Estimate> {
        self.0.timed.map(|timed| timed.pooled_rms.into())
    }

    /// Mean RMS after the time, if timings were given.
    #[getter]
    fn mean_rms_after(&self) -> Option<Estimate> {
        self.0.timed.map(|timed| timed.mean_rms.into())
    }

    fn __repr__(&self) -> String {
        let rms = self.pooled_rms().__repr__();
        format!(
            "<Prediction: pooled RMS {rms} at {} x {}>",
            self.0.light_paths, self.0.camera_paths
        )
    }
}

/// Path counts with the least noise. Luminances are in W/(m^2 sr).
#[pyclass(frozen, module = "bdpm")]
pub struct BestCounts {
    size: arrays::Size,
    rows: Vec<CountsRow>,
    /// Index of the recommended counts in `rows`.
    best: usize,
    counts: Counts,
    made_by: Provenance,
}

impl BestCounts {
    fn row(&self) -> &CountsRow {
        &self.rows[self.best]
    }
}

#[pymethods]
impl BestCounts {
    /// Light paths per iteration.
    #[getter]
    fn light_paths(&self) -> u32 {
        self.counts.light_paths
    }

    /// Camera paths per pixel and iteration: a number, or uint32 of shape (height, width) if
    /// `per_pixel` was set.
    #[getter]
    fn camera_paths<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        match &self.counts.camera_paths {
            CameraCounts::Uniform(count) => Ok(count.into_pyobject(py)?.into_any()),
            CameraCounts::PerPixel(counts) => {
                Ok(arrays::values(py, counts.clone(), self.size)?.into_any())
            }
        }
    }

    /// Time of one iteration, seconds.
    #[getter]
    fn iteration_time(&self) -> f64 {
        self.row().iteration_time
    }

    /// Root of the objective for one iteration.
    #[getter]
    fn rms(&self) -> Estimate {
        self.row().rms.into()
    }

    /// Root of the objective after `time`, if it was given.
    #[getter]
    fn rms_after(&self) -> Option<Estimate> {
        self.row().rms_after.map(Estimate::from)
    }

    /// Time to `target_rms`, seconds, if it was given.
    #[getter]
    fn time_to_target(&self) -> Option<Estimate> {
        self.row().time_to_target.map(Estimate::from)
    }

    /// Rows of `bdpm optimize`: these counts and their alternatives, as dictionaries.
    #[getter]
    fn rows<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        tables::object(py, &self.rows)
    }

    /// Plan for bdpm.render(scene, plan=...). Its number of iterations is open.
    #[getter]
    fn plan(&self) -> Plan {
        let plan = bdpm::adaptive::plan::Plan::new(self.counts.clone());
        Plan { plan, made_by: self.made_by.clone(), origin: "<plan>".into() }
    }

    fn __repr__(&self) -> String {
        let CountsRow { light_paths, camera_paths, iteration_time, .. } = self.row();
        format!(
            "<BestCounts: {light_paths} light paths, {camera_paths:.2} camera paths per pixel, \
             {iteration_time:.3} s per iteration>"
        )
    }
}
