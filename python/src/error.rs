//! Errors of the library as exceptions of Python.

use pyo3::exceptions::{PyUserWarning, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ffi::CString;

/// The exception `bdpm.Error` with problem, help, file and line.
pub fn raised(error: bdpm::Error) -> PyErr {
    Python::attach(|py| {
        let exception = || {
            let class = py.import("bdpm._error")?.getattr("Error")?;
            let fields = PyDict::new(py);
            fields.set_item("problem", error.problem())?;
            fields.set_item("help", error.advice())?;
            fields.set_item("file", error.path().map(|path| path.to_string_lossy()))?;
            fields.set_item("line", error.line_number())?;
            class.call((error.to_string(),), Some(&fields))
        };
        exception().map_or_else(|failure: PyErr| failure, PyErr::from_value)
    })
}

/// Shows a warning, a UserWarning of Python.
///
/// # Errors
/// If the user turned warnings into errors.
pub fn warn(py: Python<'_>, text: &str) -> PyResult<()> {
    let text = CString::new(text.replace('\0', "")).expect("no NUL is left");
    PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 1)
}

/// The value of a positive argument.
///
/// # Errors
/// If it is not positive or not finite; `example` completes "give a positive number, such as ...".
pub fn positive(name: &str, value: f64, example: &str) -> PyResult<f64> {
    if value > 0.0 && value.is_finite() {
        return Ok(value);
    }
    let text = format!("{name} is {value}: give a positive number, such as {example}");
    Err(PyValueError::new_err(text))
}
