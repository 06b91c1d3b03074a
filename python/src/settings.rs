//! Arguments that several functions share.

use crate::error::{positive, raised};
use crate::tables;
use bdpm::import::render_settings;
use bdpm::job::thread_pool;
use bdpm::scene::backend::Backend;
use bdpm::settings::PartialSettings;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::ThreadPool;
use serde::de::DeserializeOwned;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Settings that keyword arguments fix: the keys of a `[render]` table, and `crop`.
///
/// # Errors
/// Names the key that is unknown or has a wrong value.
pub fn settings(arguments: Option<&Bound<'_, PyDict>>) -> PyResult<PartialSettings> {
    let Some(arguments) = arguments else { return Ok(PartialSettings::default()) };
    let arguments = arguments.copy()?;
    let crop = arguments.get_item("crop")?.filter(|crop| !crop.is_none());
    if arguments.contains("crop")? {
        arguments.del_item("crop")?;
    }
    let crop = crop.map(|crop| crop.extract::<[u32; 4]>()).transpose()?;
    let text = tables::text(&tables::table(&arguments)?);
    let settings = render_settings(Path::new("<settings>"), &text).map_err(raised)?;
    Ok(PartialSettings { crop, ..settings })
}

/// Threads for a job: this many, or one per processor.
pub fn threads(count: Option<u16>) -> PyResult<Arc<ThreadPool>> {
    let pool = thread_pool(count.unwrap_or(0).into()).map_err(raised)?;
    Ok(Arc::new(pool))
}

/// The backend of this name.
pub fn backend(name: Option<&str>) -> PyResult<Option<Backend>> {
    let Some(name) = name else { return Ok(None) };
    match Backend::named(name) {
        Some(backend) => Ok(Some(backend)),
        None => Err(unknown("accel", name, &Backend::ALL.map(Backend::name))),
    }
}

/// A time in seconds.
pub fn seconds(name: &str, value: f64) -> PyResult<Duration> {
    let value = positive(name, value, "20 for 20 seconds")?;
    match Duration::try_from_secs_f64(value) {
        // Less than half a nanosecond
        Ok(time) if time.is_zero() => {
            let text = format!("{name} is {value}: give a longer time, such as 20 for 20 seconds");
            Err(PyValueError::new_err(text))
        }
        Ok(time) => Ok(time),
        Err(error) => Err(PyValueError::new_err(format!("{name} is {value}: {error}"))),
    }
}

/// The value of an enumeration by the name that files have for it.
pub fn word<T: DeserializeOwned>(name: &str, value: &str, known: &[&str]) -> PyResult<T> {
    let parsed = serde_json::from_value(value.into());
    parsed.map_err(|_| unknown(name, value, known))
}

/// The error of an argument that is none of the `known` words.
pub fn unknown(name: &str, value: &str, known: &[&str]) -> PyErr {
    PyValueError::new_err(format!("{name} is `{value}`: use one of {}", known.join(", ")))
}

/// Names of objectives.
pub const OBJECTIVES: [&str; 4] = ["relative", "pooled", "mean-rms", "max-rms"];
