//! Image files.

use crate::arrays;
use crate::error::raised;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Reads the layers of an EXR file as float32 arrays by name.
///
/// The image itself has the name "". A layer of one channel has the shape (height, width), another
/// one (height, width, channels).
#[pyfunction]
pub fn read_exr(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let image = py.detach(|| bdpm::image_io::read_exr(&path)).map_err(raised)?;
    let size = (image.width, image.height);
    let layers = PyDict::new(py);
    for layer in image.layers {
        let name = layer.name.clone();
        layers.set_item(name, arrays::layer(py, layer, size)?)?;
    }
    Ok(layers)
}
