//! Pixels and vertices as NumPy arrays.

use bdpm::base::math::Rgb;
use bdpm::image_io::{Layer, ToneMapping, encode_png};
use bytemuck::allocation::cast_vec;
use numpy::{
    AllowTypeChange, PyArray1, PyArray2, PyArray3, PyArrayDescrMethods, PyArrayLike2, PyArrayLike3,
    PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

/// Width and height, pixels.
pub type Size = (u32, u32);

fn shape((width, height): Size) -> [usize; 2] {
    [height as usize, width as usize]
}

/// An array of shape (height, width, 3) that takes over the memory of `pixels`.
pub fn colors(py: Python<'_>, pixels: Vec<Rgb>, size: Size) -> PyResult<Bound<'_, PyArray3<f32>>> {
    let [height, width] = shape(size);
    let numbers = cast_vec::<Rgb, [f32; 3]>(pixels).into_flattened();
    PyArray1::from_vec(py, numbers).reshape([height, width, 3])
}

/// An array of shape (height, width) that takes over the memory of `values`.
pub fn values<T: numpy::Element>(
    py: Python<'_>,
    values: Vec<T>,
    size: Size,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    PyArray1::from_vec(py, values).reshape(shape(size))
}

/// A layer of one channel as (height, width), of several ones as (height, width, channels).
pub fn layer(py: Python<'_>, mut layer: Layer, size: Size) -> PyResult<Bound<'_, PyAny>> {
    if let [_] = layer.channels[..] {
        let (_, only) = layer.channels.remove(0);
        return Ok(values(py, only, size)?.into_any());
    }
    if let Some(pixels) = layer.to_rgb() {
        return Ok(colors(py, pixels, size)?.into_any());
    }
    let [height, width] = shape(size);
    let channels: Vec<_> = layer.channels.iter().map(|(_, values)| &values[..]).collect();
    let pixels = (0..height * width).flat_map(|i| channels.iter().map(move |channel| channel[i]));
    let array = PyArray1::from_vec(py, pixels.collect());
    Ok(array.reshape([height, width, channels.len()])?.into_any())
}

/// A tone-mapped PNG file of an image of shape (height, width, 3).
///
/// # Errors
/// If the array is not contiguous.
pub fn png(image: &Bound<'_, PyArray3<f32>>, mapping: ToneMapping) -> PyResult<Vec<u8>> {
    let image = image.readonly();
    let &[height, width, _] = image.shape() else { unreachable!("it has three dimensions") };
    let pixels: &[Rgb] = bytemuck::cast_slice(image.as_slice()?);
    Ok(png_of(pixels, (width as u32, height as u32), mapping))
}

/// A tone-mapped PNG file.
pub fn png_of(pixels: &[Rgb], (width, height): Size, mapping: ToneMapping) -> Vec<u8> {
    let exposure = mapping.exposure(pixels);
    let bytes: Vec<u8> = pixels.iter().flat_map(|&pixel| mapping.apply(pixel, exposure)).collect();
    encode_png(width, height, &bytes)
}

/// Rows of an array of shape (n, N), of any type of number.
///
/// # Errors
/// Names `what` if the array has another shape.
pub fn rows<const N: usize>(array: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<[f32; N]>> {
    let array = array.extract::<PyArrayLike2<'_, f32, AllowTypeChange>>();
    let array = array.map_err(|error| wrong_shape(what, N, &error.to_string()))?;
    let array = array.as_array();
    if array.ncols() != N {
        return Err(wrong_shape(what, N, &format!("it has {} columns", array.ncols())));
    }
    Ok(array.rows().into_iter().map(|row| std::array::from_fn(|i| row[i])).collect())
}

/// Vertex indices of an array of integers of shape (n, 3).
///
/// # Errors
/// If the array has another shape or type, or holds negative numbers.
pub fn triangles(array: &Bound<'_, PyAny>) -> PyResult<Vec<[u32; 3]>> {
    let py = array.py();
    let array = numpy::get_array_module(py)?.call_method1("asarray", (array,))?;
    let kind = array.cast::<PyUntypedArray>()?.dtype().kind();
    if !b"iu".contains(&kind) {
        return Err(PyTypeError::new_err("triangles are not integers: give indices of vertices"));
    }
    let array = array.extract::<PyArrayLike2<'_, i64, AllowTypeChange>>();
    let array = array.map_err(|error| wrong_shape("triangles", 3, &error.to_string()))?;
    let array = array.as_array();
    if array.ncols() != 3 {
        return Err(wrong_shape("triangles", 3, &format!("it has {} columns", array.ncols())));
    }
    let index = |index: i64| {
        u32::try_from(index).map_err(|_| {
            let text = format!("triangles hold the index {index}: give indices from 0 to 2^32 - 1");
            PyValueError::new_err(text)
        })
    };
    let rows = array.rows().into_iter();
    rows.map(|row| Ok([index(row[0])?, index(row[1])?, index(row[2])?])).collect()
}

/// Pixels and size of an image of shape (height, width, 3), of any type of number.
///
/// # Errors
/// Names `what` if the array has another shape.
pub fn pixels(array: &Bound<'_, PyAny>, what: &str) -> PyResult<(Vec<Rgb>, Size)> {
    let wrong = |found: &str| {
        let text = format!("{what}: expected an array of shape (height, width, 3), but {found}");
        PyValueError::new_err(text)
    };
    let array = array.extract::<PyArrayLike3<'_, f32, AllowTypeChange>>();
    let array = array.map_err(|error| wrong(&error.to_string()))?;
    let array = array.as_array();
    let &[height, width, channels] = array.shape() else { unreachable!("three dimensions") };
    let size = [width, height].map(|side| u32::try_from(side).ok());
    let (3, [Some(width), Some(height)]) = (channels, size) else {
        return Err(wrong(&format!("it has the shape ({height}, {width}, {channels})")));
    };
    let pixels = array.rows().into_iter().map(|rgb| Rgb::new(rgb[0], rgb[1], rgb[2])).collect();
    Ok((pixels, (width, height)))
}

fn wrong_shape(what: &str, columns: usize, found: &str) -> PyErr {
    PyValueError::new_err(format!("{what}: expected an array of shape (n, {columns}), but {found}"))
}
