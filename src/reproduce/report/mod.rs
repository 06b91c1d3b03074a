//! The report.
use super::folder::Folder;
use super::results::Results;
use crate::error::Result;
use std::path::PathBuf;
/// Writes it.
pub fn write(_results: &Results, folder: &Folder) -> Result<PathBuf> {
    Ok(folder.path("report.html"))
}
