//! Plans: the path counts of a render.

use crate::error::raised;
use bdpm::image_io::read_exr;
use bdpm::settings::provenance::Provenance;
use pyo3::prelude::*;
use std::path::PathBuf;

/// Path counts of a render, with the scene and settings that they belong to.
///
/// `bdpm.render(scene, plan=result.plan)` repeats an image bit for bit. The plan of
/// `Noise.optimize` leaves the number of iterations open.
#[pyclass(frozen, module = "bdpm")]
pub struct Plan {
    pub plan: bdpm::adaptive::plan::Plan,
    pub made_by: Provenance,
    /// Name of the plan's origin in errors.
    pub origin: PathBuf,
}

#[pymethods]
impl Plan {
    /// Reads the plan of an EXR file that `bdpm render`, `bdpm optimize` or `RenderResult.save`
    /// wrote.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let read = || {
            let image = read_exr(&path)?;
            let plan = bdpm::adaptive::plan::Plan::read_from(&image).map_err(|e| e.at(&path))?;
            let made_by = Provenance::from_metadata(&image.metadata).map_err(|e| e.at(&path))?;
            Ok((plan, made_by))
        };
        let (plan, made_by) = read().map_err(raised)?;
        Ok(Self { plan, made_by, origin: path })
    }

    /// Number of iterations, or None if it is open.
    #[getter]
    fn iterations(&self) -> Option<u64> {
        self.plan.iterations()
    }

    /// For each step its light paths per iteration, its camera paths per pixel and iteration (mean
    /// over the image), and its number of iterations (None if it is open).
    #[getter]
    fn steps(&self) -> Vec<(u32, f64, Option<u64>)> {
        let steps = self.plan.steps.iter();
        let steps = steps.map(|step| {
            let counts = &step.counts;
            let iterations = step.rendered.map(|rendered| rendered.iterations);
            (counts.light_paths, counts.camera_paths.mean(), iterations)
        });
        steps.collect()
    }

    fn __repr__(&self) -> String {
        let step = |(light_paths, camera_paths, iterations): (u32, f64, Option<u64>)| {
            let iterations = iterations.map_or("open".into(), |count| count.to_string());
            format!("{light_paths} x {camera_paths:.4}, {iterations} iterations")
        };
        let steps: Vec<_> = self.steps().into_iter().map(step).collect();
        format!("<Plan: {}>", steps.join("; "))
    }
}
