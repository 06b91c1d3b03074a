//! Glare of fisheye images.

use crate::arrays::pixels;
use crate::result::RenderResult;
use crate::settings::unknown;
use crate::tables;
use bdpm::light::glare::{Glare, LuminanceImage, PEAK, SEARCH_ANGLE, SourceSearch, THRESHOLD};
use bdpm::scene::FisheyeProjection;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Rates the glare of a fisheye image, and returns a dictionary with the keys of
/// `bdpm glare --json`.
///
/// - `image`: a `RenderResult` of a fisheye camera, or radiances, W/(m^2 sr), of shape (height,
///   width, 3), the first row at the top.
/// - `projection`, `fov`: of an array: "equidistant" or "equisolid", and the full angle of the
///   image circle, degrees.
/// - `threshold`: pixels above this luminance are glare sources, cd/m^2. `peak`: pixels above this
///   luminance leave their source, cd/m^2. `search_angle`: joins sources within this angle,
///   radians.
///
/// `expanded` in the result has the uncertainties of the ratings. It is None unless the image is a
/// `RenderResult` without photons, whose pixels have independent errors.
#[pyfunction]
#[pyo3(signature = (
    image, *, projection="equidistant", fov=180.0, threshold=THRESHOLD, peak=PEAK, search_angle=SEARCH_ANGLE
))]
pub fn glare<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    projection: &str,
    fov: f64,
    threshold: f64,
    peak: f64,
    search_angle: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let image = match image.cast::<RenderResult>() {
        Ok(result) => result.get().fisheye(py)?,
        Err(_) => array(image, projection, fov)?,
    };
    for (name, value) in [("threshold", threshold), ("peak", peak), ("search_angle", search_angle)]
    {
        crate::error::positive(name, value, "2000")?;
    }
    let search = SourceSearch { threshold, peak, angle: search_angle };
    tables::object(py, &py.detach(|| Glare::new(&image, &search)))
}

/// An array with its lens.
fn array(image: &Bound<'_, PyAny>, projection: &str, fov: f64) -> PyResult<LuminanceImage> {
    let names = FisheyeProjection::ALL.map(FisheyeProjection::name);
    let named = FisheyeProjection::ALL.into_iter().find(|one| one.name() == projection);
    let projection = named.ok_or_else(|| unknown("projection", projection, &names))?;
    if !(fov > 0.0 && fov <= 360.0) {
        let text = format!("fov is {fov}: give an angle above 0, of at most 360 degrees");
        return Err(PyValueError::new_err(text));
    }
    let (pixels, size) = pixels(image, "image that is no RenderResult")?;
    if !pixels.iter().all(|pixel| pixel.is_finite()) {
        return Err(PyValueError::new_err("image: expected finite numbers"));
    }
    Ok(LuminanceImage::new(size, &pixels, projection, fov.to_radians()))
}
