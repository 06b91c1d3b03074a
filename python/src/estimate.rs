//! Values with a standard error.

use bdpm::adaptive::optimize::predict::Predicted;
use pyo3::prelude::*;

/// A value and its standard error, which is None if it is not known. `float()` returns the value.
#[pyclass(frozen, get_all, module = "bdpm")]
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Standard error of the value, or None.
    pub error: Option<f64>,
}

#[pymethods]
impl Estimate {
    fn __float__(&self) -> f64 {
        self.value
    }

    pub fn __repr__(&self) -> String {
        let error = self.error.map_or(String::new(), |error| format!(" +- {error:.1e}"));
        format!("{:.4e}{error}", self.value)
    }
}

impl From<Predicted> for Estimate {
    fn from(Predicted { value, error }: Predicted) -> Self {
        Self { value, error }
    }
}
