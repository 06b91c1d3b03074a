//! The report: one HTML file that needs nothing else, and its pictures as files beside it.

mod figures;
mod page;
mod sections;
mod summary;
mod tables;

use super::folder::Folder;
use super::results::Results;
use bdpm_core::base::atomic::write_atomically;
use bdpm_core::base::error::Result;
use figures::Figures;
use std::path::PathBuf;

/// Writes `report.html`, and each figure as a file.
///
/// # Errors
/// If a file cannot be written; names it.
pub fn write(results: &Results, folder: &Folder) -> Result<PathBuf> {
    let figures = Figures::new(results);
    for picture in figures.pictures() {
        let path = folder.path(&format!("{}.png", picture.name));
        write_atomically(&path, |file| file.write_all(&picture.png))?;
    }
    for (name, svg) in figures.plots() {
        let path = folder.path(&format!("{name}.svg"));
        write_atomically(&path, |file| file.write_all(svg.as_bytes()))?;
    }
    let path = folder.path("report.html");
    let html = page::page(results, &figures).into_string();
    write_atomically(&path, |file| file.write_all(html.as_bytes()))?;
    Ok(path)
}
