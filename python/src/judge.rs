//! Judgments of images of other programs.

use crate::arrays::{pixels, values};
use crate::error::{positive, raised};
use crate::estimate::Estimate;
use crate::scene::Scene;
use crate::settings;
use crate::tables;
use bdpm::judge::{JudgeJob, JudgeVerdict, NoiseSource};
use bdpm::settings::PartialSettings;
use numpy::PyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Time between two checks for Ctrl-C.
const POLL: Duration = Duration::from_millis(50);

/// A judgment of an image. `str()` has the lines of `bdpm compare --scene`.
#[pyclass(frozen, module = "bdpm")]
pub struct Judgment {
    judgment: bdpm::judge::Judgment,
}

#[pymethods]
impl Judgment {
    /// "right", "wrong" or "undecided".
    #[getter]
    fn verdict(&self) -> &'static str {
        match self.judgment.verdict {
            JudgeVerdict::Right => "right",
            JudgeVerdict::Wrong => "wrong",
            JudgeVerdict::Undecided => "undecided",
        }
    }

    /// Probability that a right image is called wrong.
    #[getter]
    fn risk(&self) -> f64 {
        self.judgment.risk
    }

    /// Mean luminance of the image over that of the estimate, or None if the estimate is black.
    #[getter]
    fn mean_ratio(&self) -> Option<Estimate> {
        self.judgment.mean.map(|mean| Estimate { value: mean.ratio, error: Some(mean.error) })
    }

    /// Mean squared relative difference beyond the noise, by the side of the squares of pixels that
    /// are compared. Negative values are noise.
    #[getter]
    fn scales<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for scale in &self.judgment.scales {
            let square = Estimate { value: scale.square, error: Some(scale.error) };
            all.set_item(scale.side, square.into_pyobject(py)?)?;
        }
        Ok(all)
    }

    /// Difference of each square of `map_side` pixels over its standard error, positive where the
    /// image is brighter: float32 of shape (rows, columns), the first row at the top.
    #[getter]
    fn map<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let map = &self.judgment.map;
        values(py, map.scores.clone(), (map.width, map.height))
    }

    /// Side of the squares of `map`, pixels.
    #[getter]
    fn map_side(&self) -> u32 {
        self.judgment.map.side
    }

    /// Magnitude from which on a value of `map` is significant among all of them.
    #[getter]
    fn map_threshold(&self) -> f64 {
        self.judgment.tile_threshold
    }

    /// Relative difference in squares of `map_side` pixels below which the true one lies with a
    /// probability of 95 %.
    #[getter]
    fn agreement(&self) -> f64 {
        self.judgment.agreement
    }

    /// The factor by which the whole image is too bright, if that is the only difference.
    #[getter]
    fn factor(&self) -> Option<f64> {
        self.judgment.factor
    }

    /// Shift to the right and down that explains most of the difference, pixels, or None.
    #[getter]
    fn shift(&self) -> Option<(f64, f64)> {
        self.judgment.shift.map(Into::into)
    }

    /// Parts that differ, the most important first: dictionaries with the keys of
    /// `bdpm compare --json`, such as `pixels`, `ratio`, `objects` and `materials`.
    #[getter]
    fn regions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        tables::object(py, &self.judgment.regions)
    }

    /// Where the noise of the image is known from: "two-images", or "neighbors" among the pixels of
    /// one image.
    #[getter]
    fn noise_source(&self) -> &'static str {
        match self.judgment.noise {
            NoiseSource::TwoImages => "two-images",
            NoiseSource::Neighbors => "neighbors",
        }
    }

    /// Whether the image lacks light of point lights, spots and suns through glass or off mirrors,
    /// which no path tracer finds, and agrees otherwise.
    #[getter]
    fn lacks_point_lights(&self) -> bool {
        self.judgment.lacks_it
    }

    /// Camera paths of the estimate.
    #[getter]
    fn paths(&self) -> f64 {
        self.judgment.paths
    }

    /// Time of the judge, seconds.
    #[getter]
    fn seconds(&self) -> f64 {
        self.judgment.seconds
    }

    fn __str__(&self) -> String {
        self.judgment.describe()
    }

    fn __repr__(&self) -> String {
        let text = self.judgment.describe();
        format!("<Judgment: {}>", text.lines().next().unwrap_or_default())
    }
}

/// Judges whether an image of a scene that another program rendered is right, by an estimate by
/// path tracing, and returns a `Judgment`. At most 5 % of right images are called wrong.
///
/// - `image`: radiances, W/(m^2 sr), linear Rec. 709, of shape (height, width, 3), the first row at
///   the top. A pixel is the mean over its square (the box filter).
/// - `second`: the same image with independent noise, such as that of another seed. Both together
///   show their noise; the noise of one image is estimated from neighboring pixels.
/// - `time`: end after about this time at the latest, seconds or text such as "2m" [default: 60].
/// - `precision`: relative difference that must be excluded before an image is right [default:
///   0.05, and an early end at 0.01].
/// - `seed`: of the estimate. `crop`: (left, top, width, height) of the images within an image of
///   the `resolution` (width, height), pixels.
/// - `threads`, `accel`: as for `bdpm.render`.
///
/// Ctrl-C raises KeyboardInterrupt. Raises bdpm.Error if an image is smaller than 8 by 8 pixels,
/// has values that are not finite, or if both images are equal or differ in size.
#[pyfunction]
#[pyo3(signature = (
    image, scene, *, second=None, time=None, precision=None, seed=None, resolution=None, crop=None,
    threads=None, accel=None
))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments")]
pub fn judge(
    py: Python<'_>,
    image: &Bound<'_, PyAny>,
    scene: &Scene,
    second: Option<&Bound<'_, PyAny>>,
    time: Option<&Bound<'_, PyAny>>,
    precision: Option<f64>,
    seed: Option<u64>,
    resolution: Option<[u32; 2]>,
    crop: Option<[u32; 4]>,
    threads: Option<u16>,
    accel: Option<&str>,
) -> PyResult<Judgment> {
    let (image, size) = pixels(image, "image")?;
    let second = second.map(|second| pixels(second, "second")).transpose()?;
    if let Some((_, (width, height))) = &second
        && (*width, *height) != size
    {
        let text = format!(
            "second has {width}x{height} pixels, and image {}x{}: give two images of the same size",
            size.0, size.1
        );
        return Err(PyValueError::new_err(text));
    }
    if resolution.is_some() && crop.is_none() {
        let text =
            "resolution without crop: leave it out, since the image has a size, or give crop";
        return Err(PyValueError::new_err(text));
    }
    let images: Vec<_> = [Some(image), second.map(|(own, _)| own)].into_iter().flatten().collect();
    let interrupt = Arc::new(AtomicBool::new(false));
    let job = JudgeJob::new(&scene.loaded, &images, size)
        .map_err(raised)?
        .settings(PartialSettings { seed, resolution, crop, ..PartialSettings::default() })
        .backend(settings::backend(accel)?)
        .threads(settings::threads(threads)?)
        .interrupted_by(Arc::clone(&interrupt));
    let job = match precision {
        Some(own) => job.precision(positive("precision", own, "0.01 for 1 %")?),
        None => job,
    };
    let job = match time {
        Some(time) => job.time(settings::time("time", time)?),
        None => job,
    };
    // Signals are only seen by the thread that runs Python.
    let thread = std::thread::spawn(move || job.run(|_| {}));
    let mut stopped = None;
    while !thread.is_finished() {
        py.detach(|| std::thread::sleep(POLL));
        if let Err(error) = py.check_signals() {
            interrupt.store(true, Ordering::Relaxed);
            stopped = Some(error);
        }
    }
    let judged = thread.join().unwrap_or_else(|panic| resume_unwind(panic));
    match stopped {
        Some(error) => Err(error),
        None => Ok(Judgment { judgment: judged.map_err(raised)? }),
    }
}
