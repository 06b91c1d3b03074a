//! The result of a render.

use crate::arrays::{self, Size};
use crate::error::{raised, warn};
use crate::estimate::Estimate;
use crate::noise::Noise;
use crate::plan::Plan;
use crate::settings::{unknown, word};
use crate::tables;
use bdpm::base::math::Rgb;
use bdpm::image_io::{DisplayWindow, ExrFormat, Image, ToneMapping, write_exr_as, write_png_as};
use bdpm::light::glare::LuminanceImage;
use bdpm::noise::Measure;
use bdpm::output::layers::LayerSelection;
use bdpm::scene::Optics;
use bdpm::settings::Crop;
use numpy::{PyArray3, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyBytes, PyDict};
use std::path::PathBuf;

/// Relative RMS error of an image: the root of the mean over pixels of squared errors over squared
/// luminances (0.01 for 1 %).
#[pyclass(frozen, get_all, module = "bdpm")]
pub struct RelativeError {
    /// Noise and bias together.
    total: f64,
    /// Noise alone.
    noise: f64,
    /// Merge bias alone.
    bias: f64,
    /// Range that holds the true error with a probability of 90 %; None if it is not known.
    interval: Option<(f64, f64)>,
}

#[pymethods]
impl RelativeError {
    fn __float__(&self) -> f64 {
        self.total
    }

    fn __repr__(&self) -> String {
        let [total, noise, bias] = [self.total, self.noise, self.bias].map(|x| 100.0 * x);
        format!("<RelativeError: {total:.2} % (noise {noise:.2} %, bias {bias:.2} %)>")
    }
}

/// A rendered image with its error, layers, noise and plan. A notebook shows it as a picture.
#[pyclass(frozen, module = "bdpm")]
pub struct RenderResult {
    result: bdpm::RenderResult,
    image: Py<PyArray3<f32>>,
    selection: LayerSelection,
    seconds: f64,
    layers: PyOnceLock<Py<PyDict>>,
    noise: Option<Py<Noise>>,
}

impl RenderResult {
    pub fn new(
        py: Python<'_>,
        mut result: bdpm::RenderResult,
        selection: LayerSelection,
        keeps_noise: bool,
    ) -> PyResult<Self> {
        let seconds = result.state.elapsed().as_secs_f64();
        let image = arrays::colors(py, std::mem::take(&mut result.image), result.resolution)?;
        // The image is returned even if a step after the first iteration fails or the noise is not
        // known.
        if let Some(failure) = result.state.failure.take() {
            warn(py, &format!("the image is incomplete or not denoised: {failure}"))?;
        }
        let noise = match keeps_noise.then(|| result.noise_file(Measure::Pairs)) {
            Some(Ok(file)) => Some(Py::new(py, Noise { file })?),
            Some(Err(error)) => {
                warn(py, &error.to_string())?;
                None
            }
            None => None,
        };
        let (image, layers) = (image.unbind(), PyOnceLock::new());
        Ok(Self { result, image, selection, seconds, layers, noise })
    }

    fn size(&self) -> Size {
        self.result.resolution
    }

    /// The image for a rating of glare, with the noise of its pixels if that is independent.
    ///
    /// # Errors
    /// If it is not a whole fisheye image.
    pub fn fisheye(&self, py: Python<'_>) -> PyResult<LuminanceImage> {
        let settings = &self.result.state.provenance.settings;
        let optics = self.result.state.camera().optics();
        let (Optics::Fisheye { projection, field_of_view }, None) = (optics, settings.crop) else {
            let text = "this is no whole fisheye image: render the scene with a camera of the type \
                        \"fisheye\", without `crop`";
            return Err(PyValueError::new_err(text));
        };
        let pixels = self.image.bind(py).readonly();
        let pixels: &[Rgb] = bytemuck::cast_slice(pixels.as_slice()?);
        let fov = f64::from(field_of_view).to_radians();
        let image = LuminanceImage::new(self.size(), pixels, projection, fov);
        let is_independent = !settings.has_photons() && self.result.denoised.is_none();
        let noise = self.result.state.image().rms().filter(|_| is_independent);
        Ok(match noise {
            Some(noise) => image.with_noise(&noise),
            None => image,
        })
    }

    /// Returns true if both images show the same scene by the same camera at one size.
    pub fn has_view_of(&self, other: &Self) -> bool {
        let view = |own: &Self| (own.result.state.provenance.fingerprint, own.size());
        view(self) == view(other)
    }

    /// Seed of the random numbers of the image.
    pub fn seed(&self) -> u64 {
        self.result.state.provenance.settings.seed
    }

    fn file(&self, py: Python<'_>) -> Image {
        py.detach(|| self.result.to_image_file(&self.selection))
    }
}

#[pymethods]
impl RenderResult {
    /// Radiance, W/(m^2 sr), linear Rec. 709: float32 of shape (height, width, 3), the first row at
    /// the top. The denoised image if the job denoises.
    #[getter]
    pub fn image<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f32>> {
        self.image.bind(py).clone()
    }

    /// Layers by name: float32 of shape (height, width, 3), or (height, width) for layers of one
    /// channel.
    ///
    /// "rms" is the RMS of the noise of each pixel as luminance, W/(m^2 sr). The others are those
    /// of the argument `layers`. They are evaluated at the first use.
    #[getter]
    fn layers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let layers = self.layers.get_or_try_init(py, || -> PyResult<_> {
            let layers = PyDict::new(py);
            let file = self.file(py);
            for layer in file.layers.into_iter().filter(|layer| !layer.name.is_empty()) {
                let name = layer.name.clone();
                layers.set_item(name, arrays::layer(py, layer, self.size())?)?;
            }
            Ok(layers.unbind())
        })?;
        Ok(layers.bind(py).clone())
    }

    /// Relative error of the image when it ended, also by Ctrl-C. None for fixed counts, a pooled
    /// objective, or fewer than two iterations.
    #[getter]
    fn error(&self) -> Option<RelativeError> {
        let bdpm::job::RelativeError { total, noise, bias, interval } = self.result.error?;
        let interval = interval.map(|interval| (interval.low, interval.high));
        Some(RelativeError { total, noise, bias, interval })
    }

    /// RMS of the noise as luminance, W/(m^2 sr), pooled over all pixels; None if there are too few
    /// iterations.
    #[getter]
    fn rms(&self) -> Option<Estimate> {
        let (value, error) = self.result.rms?;
        Some(Estimate { value, error: error.is_finite().then_some(error) })
    }

    /// Comparison of the image with its audit by path tracing; None if it was not audited.
    #[getter]
    fn audit<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        tables::object(py, &self.result.audit)
    }

    /// Relative error that was promised for the end after the first iterations, or None.
    #[getter]
    fn promised_error(&self) -> Option<f64> {
        self.result.state.promise()?.error
    }

    /// Noise coefficients of each pixel if the render had `noise=True`; None otherwise, or with too
    /// few iterations.
    #[getter]
    fn noise(&self, py: Python<'_>) -> Option<Py<Noise>> {
        self.noise.as_ref().map(|noise| noise.clone_ref(py))
    }

    /// Path counts and iterations that repeat the image: bdpm.render(scene, plan=result.plan).
    #[getter]
    fn plan(&self) -> Plan {
        let made_by = self.result.state.provenance.clone();
        Plan { plan: self.result.plan.clone(), made_by, origin: "<plan>".into() }
    }

    /// Settings of the image, chosen ones included.
    #[getter]
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        tables::object(py, &self.result.state.provenance.settings)
    }

    /// Number of iterations.
    #[getter]
    fn iterations(&self) -> u64 {
        self.result.state.renderer.iterations()
    }

    /// Rendering time, seconds, with the choice of the technique.
    #[getter]
    fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Reason for the end of the render: "iterations", "time", "target" or "interrupt".
    #[getter]
    fn stopped_by<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        tables::object(py, &self.result.stopped_by)
    }

    /// The image as a PNG file. `tonemap` is "srgb", "agx" or "filmic"; `exposure` is in stops
    /// beside the automatic one.
    #[pyo3(signature = (*, tonemap="srgb", exposure=0.0))]
    fn to_png<'py>(
        &self,
        py: Python<'py>,
        tonemap: &str,
        exposure: f32,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let png = arrays::png(self.image.bind(py), mapping(tonemap, exposure)?)?;
        Ok(PyBytes::new(py, &png))
    }

    /// Writes the image: to NAME.exr with all layers, settings and the plan, or to NAME.png for
    /// viewing.
    ///
    /// `tonemap` and `exposure` are for PNG files, as in `to_png`.
    #[pyo3(signature = (path, *, tonemap="srgb", exposure=0.0))]
    fn save(&self, py: Python<'_>, path: PathBuf, tonemap: &str, exposure: f32) -> PyResult<()> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let written = match &extension[..] {
            "exr" => {
                let file = self.file(py);
                let crop = self.result.state.provenance.settings.crop;
                let window = crop.map(|Crop { origin, full }| DisplayWindow { origin, size: full });
                let format = ExrFormat { window, ..ExrFormat::default() };
                py.detach(|| write_exr_as(&path, &file, format))
            }
            "png" => {
                let mapping = mapping(tonemap, exposure)?;
                let image = self.image.bind(py).readonly();
                let pixels = bytemuck::cast_slice(image.as_slice()?);
                write_png_as(&path, self.size(), pixels, mapping).map(drop)
            }
            other => return Err(unknown("the extension", other, &["exr", "png"])),
        };
        written.map_err(raised)
    }

    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        self.to_png(py, "srgb", 0.0)
    }

    fn __repr__(&self) -> String {
        let (width, height) = self.size();
        let error = self.result.error.map_or(String::new(), |error| {
            format!(", relative error {:.2} %", 100.0 * error.total)
        });
        let (iterations, seconds) = (self.iterations(), self.seconds);
        format!("<RenderResult: {width}x{height}, {iterations} iterations, {seconds:.1} s{error}>")
    }
}

fn mapping(tonemap: &str, stops: f32) -> PyResult<ToneMapping> {
    let curve = word("tonemap", tonemap, &["srgb", "agx", "filmic"])?;
    Ok(ToneMapping { curve, stops })
}
