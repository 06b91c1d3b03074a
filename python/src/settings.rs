//! Arguments that several functions share.

use crate::error::raised;
use crate::tables;
use bdpm::base::duration::positive_time;
use bdpm::import::render_settings;
use bdpm::job::thread_pool;
use bdpm::scene::backend::Backend;
use bdpm::settings::{PartialSettings, Settings};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::ThreadPool;
use serde::de::DeserializeOwned;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Settings that keyword arguments fix: the keys of a `[render]` table, and `crop`. `own` are the
/// other keywords of the function.
///
/// # Errors
/// Names the keyword that is unknown or has a wrong value.
pub fn settings(
    arguments: Option<&Bound<'_, PyDict>>,
    own: &[&'static str],
) -> PyResult<PartialSettings> {
    let Some(arguments) = arguments else { return Ok(PartialSettings::default()) };
    let arguments = arguments.copy()?;
    for name in arguments.keys() {
        let name: String = name.extract()?;
        let mut known = own.iter().copied().chain(names());
        if !known.any(|known| known == name) {
            let known: Vec<_> = own.iter().copied().chain(names()).collect();
            let known = known.join(", ");
            let text = format!("unknown keyword `{name}`: use one of {known}");
            return Err(PyTypeError::new_err(text));
        }
    }
    let crop = arguments.get_item("crop")?.filter(|crop| !crop.is_none());
    if arguments.contains("crop")? {
        arguments.del_item("crop")?;
    }
    let crop = crop.map(|crop| crop.extract::<[u32; 4]>()).transpose()?;
    let text = tables::text(&tables::table(&arguments)?);
    let settings = render_settings(Path::new("<settings>"), &text).map_err(raised)?;
    Ok(PartialSettings { crop, ..settings })
}

/// Keywords of settings.
fn names() -> impl Iterator<Item = &'static str> {
    let replaced = ["width", "height"];
    let names = Settings::NAMES.iter().copied().filter(move |name| !replaced.contains(name));
    std::iter::once("resolution").chain(names)
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

/// A time above 0: a number of seconds, or text with units such as "3s" or "2m".
///
/// # Errors
/// Names the argument, if it is no such time.
pub fn time(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Duration> {
    let text = match (value.extract::<String>(), value.extract::<f64>()) {
        (Ok(text), _) => text,
        (_, Ok(seconds)) => seconds.to_string(),
        _ => {
            let kind = value.get_type().name()?;
            let advice = "give seconds such as 20, or text such as \"2m\"";
            return Err(PyTypeError::new_err(format!("{name} is of type {kind}: {advice}")));
        }
    };
    positive_time(&text).map_err(|error| {
        let text = format!("{name}: {}: {}", error.problem(), error.advice());
        PyValueError::new_err(text)
    })
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
