//! Parsing of TOML, with the errors of serde and of the parser in our words.

use bdpm_core::base::error::{Error, Result};
use bdpm_core::settings::ADVICE;
use serde::de::DeserializeOwned;
use std::path::Path;

/// Reads the tables in `text`.
///
/// # Errors
/// Names the line that is not TOML, or the key that is unknown, missing or has a wrong value.
pub fn parse_table<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T> {
    toml::from_str(text).map_err(|error| {
        let problem = explain(error.message()).at(path);
        match error.span() {
            Some(span) => problem.at_offset(text, span.start),
            None => problem,
        }
    })
}

/// Rewords the errors of serde and of the TOML parser.
fn explain(message: &str) -> Error {
    if let Some((problem, advice)) = message.split_once(ADVICE) {
        return Error::new(problem, advice);
    }
    let message = message.replace('\n', ", ");
    let (what, expected) = match message.split_once(", expected ") {
        Some((what, expected)) => (what, Some(expected)),
        None => (message.as_str(), None),
    };
    let choices = |expected: Option<&str>| match expected {
        Some(one) => format!("use {one}"),
        None => "remove it".to_owned(),
    };
    if let Some(key) = what.strip_prefix("unknown field ") {
        Error::new(format!("unknown key {key}"), choices(expected))
    } else if let Some(value) = what.strip_prefix("unknown variant ") {
        Error::new(format!("unknown value {value}"), choices(expected))
    } else if let Some(key) = what.strip_prefix("missing field ") {
        let advice = "add it; docs/reference/scene-format.md lists the keys that a table needs";
        Error::new(format!("the key {key} is missing"), advice)
    } else if let (Some(found), Some(expected)) = (what.strip_prefix("invalid type: "), expected) {
        let expected = match expected {
            "u32" | "u64" => "a whole number without a decimal point",
            "f32" | "f64" => "a number",
            other => other,
        };
        Error::new(format!("wrong type: {found}"), format!("give {expected}"))
    } else if let (Some(found), Some(expected)) = (what.strip_prefix("invalid value: "), expected) {
        Error::new(format!("wrong value: {found}"), format!("give {expected}"))
    } else {
        Error::new(
            message.clone(),
            "correct the TOML; docs/reference/scene-format.md has an example",
        )
    }
}
