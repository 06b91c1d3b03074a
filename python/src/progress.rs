//! Progress of a job.

use bdpm::job::RenderState;
use pyo3::prelude::*;

/// Progress of a job after an iteration.
#[pyclass(frozen, get_all, module = "bdpm")]
#[derive(Clone, Copy, Debug, Default)]
pub struct Progress {
    /// Iterations of the image. 0 while the technique is chosen.
    pub iterations: u64,
    /// Rendering time so far, seconds.
    pub seconds: f64,
    /// Expected rendering time from now to the end, seconds, or None if it is not known yet.
    pub seconds_left: Option<f64>,
    /// Share of the work that is done, 0 to 1.
    pub done: f64,
    /// Relative RMS error of the image so far (0.01 for 1 %), or None if it is not known yet.
    pub error: Option<f64>,
    /// Expected relative RMS error at the end, or None if it is not known yet.
    pub expected_error: Option<f64>,
    /// Pooled RMS of the noise so far as luminance, W/(m^2 sr), or None if it is not known yet.
    pub rms: Option<f64>,
}

impl Progress {
    /// The progress of a job.
    pub fn of(state: &RenderState) -> Self {
        let seconds = state.elapsed().as_secs_f64();
        let (seconds_left, done) = state.status.time_left(&state.stop, seconds);
        let convergence = state.status.convergence.as_ref();
        let error = |left| convergence.and_then(|convergence| convergence.error(&state.stop, left));
        Self {
            iterations: state.status.iterations,
            seconds,
            seconds_left,
            done: done.clamp(0.0, 1.0),
            error: error(1.0),
            expected_error: state.status.forecast.and_then(|end| error(end.left)),
            rms: convergence.and_then(|convergence| convergence.rms()),
        }
    }
}

#[pymethods]
impl Progress {
    fn __repr__(&self) -> String {
        let error = self.error.map_or(String::new(), |e| format!(", error {:.2} %", 100.0 * e));
        format!("<Progress: {:.0} %, {} iterations{error}>", 100.0 * self.done, self.iterations)
    }
}
