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
///   width, 3), the first row at the top. The mean of several `RenderResult`s of one view with
///   different seeds is rated if they are in a list.
/// - `projection`, `fov`: of an array: "equidistant" or "equisolid", and the full angle of the
///   image circle, degrees.
/// - `threshold`: pixels above this luminance are glare sources, cd/m^2. `peak`: pixels above this
///   luminance leave their source, cd/m^2. `search_angle`: joins sources within this angle,
///   radians.
///
/// `expanded` in the result has the uncertainties of the ratings: by the spread of the images of a
/// list, or by the noise of the pixels of a `RenderResult` without photons, whose errors are
/// independent. It is None for other images.
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
        Err(_) => match image.extract::<Vec<Bound<'py, RenderResult>>>() {
            Ok(results) if !results.is_empty() => repeated(py, &results)?,
            _ => array(image, projection, fov)?,
        },
    };
    for (name, value) in [("threshold", threshold), ("peak", peak), ("search_angle", search_angle)]
    {
        crate::error::positive(name, value, "2000")?;
    }
    let search = SourceSearch { threshold, peak, angle: search_angle };
    tables::object(py, &py.detach(|| Glare::new(&image, &search)))
}

/// The mean of images of one view with different seeds.
fn repeated(py: Python<'_>, results: &[Bound<'_, RenderResult>]) -> PyResult<LuminanceImage> {
    for (number, result) in results.iter().enumerate().skip(1) {
        let own = result.get();
        if !own.has_view_of(results[0].get()) {
            let text = format!("image {number} of the list is of another view: give images of one");
            return Err(PyValueError::new_err(text));
        }
        if results[..number].iter().any(|other| other.get().seed() == own.seed()) {
            let text = format!(
                "image {number} of the list has the seed of another one, so that both have the \
                 same errors: render each with its own seed"
            );
            return Err(PyValueError::new_err(text));
        }
    }
    let images: PyResult<Vec<_>> = results.iter().map(|one| one.get().fisheye(py)).collect();
    Ok(LuminanceImage::mean_of(&images?))
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
