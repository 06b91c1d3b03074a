//! Photometric files of luminaires: IES LM-63 and EULUMDAT.
//!
//! Angles are in degrees in the files. The frame of a luminaire is that of
//! [`IntensityDistribution`]: z is up, C0 is along x and C90 along y.

mod eulumdat;
mod lm63;
mod opening;
mod planes;
mod write;

use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::input::{extension, read_bytes};
use bdpm_core::scene::IntensityDistribution;
pub use opening::OpeningShape;
use std::path::Path;
pub use write::{LuminaireDescription, write_eulumdat, write_lm63};

/// Largest accepted file, bytes: distributions of 0.1 degrees in both angles fit.
const MAX_FILE: u64 = 64 << 20;

/// Maximum number of intensities of a file: distributions of 0.1 degrees in both angles fit.
const MAX_VALUES: usize = 1 << 23;

/// Refuses more intensities than [`MAX_VALUES`], by a problem and its advice.
fn check_values(count: usize) -> std::result::Result<(), [String; 2]> {
    if count <= MAX_VALUES {
        return Ok(());
    }
    let advice = format!("give fewer angles: at most {MAX_VALUES} intensities are read");
    Err([format!("there are {count} intensities"), advice])
}

/// The contents of a photometric file.
#[derive(Clone, Debug, PartialEq)]
pub struct LuminaireFile {
    /// Name of the luminaire, possibly empty.
    pub name: String,
    /// Intensity with all factors of the file but that of the tilt.
    pub distribution: IntensityDistribution,
    /// Shape and size of the luminous opening.
    pub opening: OpeningShape,
    /// Flux of all lamps, lm, if the file has it.
    pub lamp_lumens: Option<f64>,
    /// Electric power, W.
    pub watts: f64,
    /// Factor of the intensity by the angle of the tilt, degrees; empty if it is always 1.
    pub tilt: Vec<[f64; 2]>,
    /// Departures from the format that were accepted, each a sentence without a full stop.
    pub notes: Vec<String>,
}

impl LuminaireFile {
    /// Reads a `.ies` or `.ldt` file. Of several sets of lamps it takes the first, with a note.
    ///
    /// # Errors
    /// Names the line that is not valid.
    pub fn read(path: &Path) -> Result<Self> {
        Self::read_with(path, None)
    }

    /// Reads a `.ies` or `.ldt` file with the set of lamps of this number from 1, which only an
    /// EULUMDAT file has.
    ///
    /// # Errors
    /// Names the line that is not valid, or how many sets of lamps there are.
    pub fn read_with(path: &Path, lamp_set: Option<usize>) -> Result<Self> {
        let is_eulumdat = match &extension(path)[..] {
            "ldt" => true,
            "ies" => false,
            _ => {
                let problem = "the file is neither an IES file nor an EULUMDAT file";
                return Err(Error::new(problem, "give a file ending in .ies or .ldt").at(path));
            }
        };
        let bytes = read_bytes(path, MAX_FILE + 1)?;
        if bytes.len() as u64 > MAX_FILE {
            let problem = format!("the file is larger than {} MiB", MAX_FILE >> 20);
            return Err(Error::new(problem, "give a photometric file").at(path));
        }
        if is_eulumdat {
            return eulumdat::parse(path, &bytes, lamp_set);
        }
        if lamp_set.is_some() {
            let problem = "the file has no sets of lamps: an IES file describes one set";
            let advice = "leave out `lamp_set`, or give an EULUMDAT file";
            return Err(Error::new(problem, advice).at(path));
        }
        lm63::parse(path, &bytes)
    }

    /// Reads the text of an IES file that is inside another file. A file of tilt factors is looked
    /// for beside `path`.
    ///
    /// # Errors
    /// Names the line that is not valid.
    pub fn parse_ies(path: &Path, bytes: &[u8]) -> Result<Self> {
        lm63::parse(path, bytes)
    }

    /// Factor of the intensity of a luminaire that is tilted by this angle from its normal
    /// position, degrees.
    pub fn tilt_factor(&self, degrees: f64) -> f64 {
        let Some([first, last]) = self.tilt.first().zip(self.tilt.last()).map(|(a, b)| [*a, *b])
        else {
            return 1.0;
        };
        let at = degrees.clamp(first[0], last[0]);
        let above = self.tilt.partition_point(|[angle, _]| *angle <= at);
        if above == self.tilt.len() {
            return last[1];
        }
        let ([from, a], [to, b]) = (self.tilt[above - 1], self.tilt[above]);
        a + (b - a) * (at - from) / (to - from)
    }
}
