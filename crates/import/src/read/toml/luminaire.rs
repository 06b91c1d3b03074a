//! `[[light]]` of the type `luminaire`: an IES or EULUMDAT file with its place in the scene.

use super::light::LightTable;
use super::numbers::NonNegative;
use crate::luminaires::{PlacedLuminaire, frame};
use crate::text::RELATIVE_NAME;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::scene::IntensityDistribution;
use bdpm_light::photometry::{LuminaireFile, OpeningShape};
use glam::DVec3;
use serde::Deserialize;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Whether the luminous opening of the file is built.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum OpeningChoice {
    #[default]
    File,
    Point,
}

/// Photometric files of a scene, each read once for a set of lamps however many luminaires it
/// describes.
#[derive(Default)]
pub struct LuminaireFiles(HashMap<FileKey, (LuminaireFile, Arc<IntensityDistribution>)>);

/// A file, and the number of the set of lamps that is chosen.
type FileKey = (PathBuf, Option<usize>);

impl LuminaireFiles {
    fn read(
        &mut self,
        path: &Path,
        lamp_set: Option<usize>,
    ) -> Result<&(LuminaireFile, Arc<IntensityDistribution>)> {
        let key = (path.to_owned(), lamp_set);
        if !self.0.contains_key(&key) {
            let file = LuminaireFile::read_with(path, lamp_set)?;
            let distribution = Arc::new(file.distribution.clone());
            self.0.insert(key.clone(), (file, distribution));
        }
        Ok(&self.0[&key])
    }
}

impl LightTable {
    /// Reads the file, and places the luminaire in a scene whose origin is at this point.
    pub(super) fn luminaire(
        &self,
        folder: &Path,
        files: &mut LuminaireFiles,
        origin: DVec3,
    ) -> Result<(PlacedLuminaire, Vec<String>)> {
        let file = self.need("file", self.file.as_ref())?;
        let position = self.need("position", self.position)?.relative_to(origin);
        let path = folder.join(file);
        if !path.is_file() {
            return Err(Error::new(format!("there is no file `{file}`"), RELATIVE_NAME));
        }
        let (read, distribution) = files.read(&path, self.lamp_set()?)?;
        let direction = self.direction.map(|direction| direction.0.as_dvec3());
        let c0 = self.c0.map(|c0| c0.0.as_dvec3());
        let axes = frame(direction, c0, self.turn_deg.unwrap_or(0.0))?;
        let flux = read.distribution.flux();
        let factor = match (self.scale, self.total_lumen()?) {
            (None, None) => 1.0,
            (Some(scale), None) => scale,
            (None, Some(lumen)) => lumen / flux,
            (Some(_), Some(_)) => {
                let problem = "the luminaire has both `scale` and `lumen`";
                return Err(Error::new(problem, "give one of them"));
            }
        };
        let factor = factor * read.tilt_factor(self.tilt_deg.unwrap_or(0.0));
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
        let opening = match self.opening.unwrap_or_default() {
            OpeningChoice::File => read.opening,
            OpeningChoice::Point => OpeningShape::Point,
        };
        let own = [self.name.as_ref(), Some(&read.name)].into_iter().flatten();
        let name = own.into_iter().find(|name| !name.is_empty()).unwrap_or(file).clone();
        let luminaire = PlacedLuminaire {
            name,
            distribution: Arc::clone(distribution),
            opening,
            axes,
            position,
            factor,
            is_hidden: self.hidden.unwrap_or(false),
        };
        let notes = read.notes.iter().map(|note| format!("{}: {note}", path.display()));
        Ok((luminaire, notes.collect()))
    }

    /// The number of the set of lamps, from 1, if it is given.
    fn lamp_set(&self) -> Result<Option<usize>> {
        let Some(given) = self.lamp_set else { return Ok(None) };
        let number = usize::try_from(given).ok().filter(|number| *number > 0);
        number.map(Some).ok_or_else(|| {
            let advice = "give a whole number from 1; the note of the file lists its sets";
            Error::new(format!("`lamp_set` is {given}"), advice)
        })
    }

    /// The luminous flux that the file is scaled to, lm, if it is given.
    fn total_lumen(&self) -> Result<Option<f64>> {
        let Some(NonNegative(lumen)) = self.lumen else { return Ok(None) };
        if lumen == Rgb::splat(lumen.x) {
            return Ok(Some(f64::from(lumen.x)));
        }
        let advice = "give one number, and the hue as `color`";
        Err(Error::new("the `lumen` of a luminaire are three numbers", advice))
    }
}
