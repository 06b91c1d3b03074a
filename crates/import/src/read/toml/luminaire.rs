//! `[[light]]` of the type `luminaire`: an IES or EULUMDAT file with its place in the scene.

use super::keys::Point;
use super::numbers::NonNegative;
use crate::luminaires::{PlacedLuminaire, frame};
use crate::text::RELATIVE_NAME;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::scene::IntensityDistribution;
use bdpm_light::photometry::{LuminaireFile, OpeningShape};
use serde::Deserialize;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A `[[light]]` of the type `luminaire`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LuminaireTable {
    file: String,
    position: Point,
    /// Toward the nadir of the file, gamma = 0.
    direction: Option<Point>,
    /// Toward the plane C0.
    c0: Option<Point>,
    /// Turn about the direction, counterclockwise as seen from behind the luminaire.
    #[serde(default)]
    turn_deg: f64,
    /// Tilt for the tilt factors of the file.
    #[serde(default)]
    tilt_deg: f64,
    scale: Option<f64>,
    lumen: Option<f64>,
    color: Option<NonNegative>,
    #[serde(default)]
    opening: OpeningChoice,
    /// Whether camera rays pass the opening.
    #[serde(default)]
    hidden: bool,
}

/// Whether the luminous opening of the file is built.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
enum OpeningChoice {
    #[default]
    File,
    Point,
}

/// Photometric files of a scene, each read once however many luminaires it describes.
#[derive(Default)]
pub struct LuminaireFiles(HashMap<PathBuf, (LuminaireFile, Arc<IntensityDistribution>)>);

impl LuminaireFiles {
    fn read(&mut self, path: &Path) -> Result<&(LuminaireFile, Arc<IntensityDistribution>)> {
        if !self.0.contains_key(path) {
            let file = LuminaireFile::read(path)?;
            let distribution = Arc::new(file.distribution.clone());
            self.0.insert(path.to_owned(), (file, distribution));
        }
        Ok(&self.0[path])
    }
}

impl LuminaireTable {
    /// Reads the file, and places the luminaire.
    pub fn luminaire(
        &self,
        folder: &Path,
        files: &mut LuminaireFiles,
    ) -> Result<(PlacedLuminaire, Vec<String>)> {
        let path = folder.join(&self.file);
        if !path.is_file() {
            return Err(Error::new(format!("there is no file `{}`", self.file), RELATIVE_NAME));
        }
        let (read, distribution) = files.read(&path)?;
        let direction = self.direction.map(|direction| direction.0.as_dvec3());
        let c0 = self.c0.map(|c0| c0.0.as_dvec3());
        let axes = frame(direction, c0, self.turn_deg)?;
        let flux = read.distribution.flux();
        let factor = match (self.scale, self.lumen) {
            (None, None) => 1.0,
            (Some(scale), None) => scale,
            (None, Some(lumen)) => lumen / flux,
            (Some(_), Some(_)) => {
                let problem = "the luminaire has both `scale` and `lumen`";
                return Err(Error::new(problem, "give one of them"));
            }
        };
        let factor = factor * read.tilt_factor(self.tilt_deg);
        // Written so that NaN fails.
        if !(factor >= 0.0 && factor.is_finite()) {
            let problem = format!("the factor of the intensity is {factor}");
            let advice = "give a `scale` or `lumen` of at least 0, and a file that is not dark";
            return Err(Error::new(problem, advice));
        }
        // Colors change the hue only.
        let color = self.color.map_or(Rgb::ONE, |color| color.0);
        let own = luminance(color);
        if own <= 0.0 {
            let advice = "give a color of any brightness: only its hue counts";
            return Err(Error::new("the color of the luminaire is black", advice));
        }
        let factor = color / own * (factor as f32 / LUMENS_PER_WATT);
        let opening = match self.opening {
            OpeningChoice::File => read.opening,
            OpeningChoice::Point => OpeningShape::Point,
        };
        let name = if read.name.is_empty() { self.file.clone() } else { read.name.clone() };
        let position = self.position.0;
        let luminaire = PlacedLuminaire {
            name,
            distribution: Arc::clone(distribution),
            opening,
            axes,
            position,
            factor,
            is_hidden: self.hidden,
        };
        let notes = read.notes.iter().map(|note| format!("{}: {note}", path.display()));
        Ok((luminaire, notes.collect()))
    }
}
