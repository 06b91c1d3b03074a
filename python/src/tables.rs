//! Dictionaries of Python as tables of a scene file, and results as dictionaries.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyMapping, PyString, PyTuple};
use serde::Serialize;
use toml::{Table, Value};

/// A dictionary as a table. Entries that are `None` are left out.
///
/// # Errors
/// If a key is no text, or a value has a type that TOML does not have; names the key.
pub fn table(mapping: &Bound<'_, PyAny>) -> PyResult<Table> {
    let mapping = mapping.cast::<PyMapping>()?;
    let mut table = Table::new();
    for item in mapping.items()?.iter() {
        let (key, value): (String, Bound<'_, PyAny>) = item.extract()?;
        if !value.is_none() {
            let value = self::value(&value, &key)?;
            table.insert(key, value);
        }
    }
    Ok(table)
}

fn value(object: &Bound<'_, PyAny>, key: &str) -> PyResult<Value> {
    if object.is_instance_of::<PyBool>() {
        Ok(Value::Boolean(object.extract()?))
    } else if object.is_instance_of::<PyInt>() {
        Ok(Value::Integer(object.extract()?))
    } else if object.is_instance_of::<PyFloat>() {
        Ok(Value::Float(object.extract()?))
    } else if object.is_instance_of::<PyString>() {
        Ok(Value::String(object.extract()?))
    } else if object.is_instance_of::<PyList>() || object.is_instance_of::<PyTuple>() {
        let values = object.try_iter()?.map(|item| value(&item?, key));
        Ok(Value::Array(values.collect::<PyResult<_>>()?))
    } else if object.is_instance_of::<PyDict>() {
        Ok(Value::Table(table(object)?))
    } else if object.hasattr("tolist")? {
        // Arrays and numbers of NumPy.
        value(&object.call_method0("tolist")?, key)
    } else if object.hasattr("__fspath__")? {
        value(&object.call_method0("__fspath__")?, key)
    } else {
        let text = format!(
            "{key} is of type {}: give a number, text, a list or a dictionary",
            object.get_type().name()?
        );
        Err(PyTypeError::new_err(text))
    }
}

/// The text of a table.
pub fn text(table: &Table) -> String {
    toml::to_string(table).expect("tables of plain values have a text")
}

/// A result as dictionaries, lists and numbers.
pub fn object<'py>(py: Python<'py>, value: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).expect("plain numbers and texts");
    py.import("json")?.call_method1("loads", (text,))
}
