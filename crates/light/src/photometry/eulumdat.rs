//! EULUMDAT (`.ldt`), the European format of photometric data (Stockmar 1990).
//!
//! Intensities are in cd per 1000 lm of the lamps. A file may list several sets of lamps, of which
//! the caller chooses one. Intensities are multiplied by the conversion factor of line 24. Headers,
//! dimensions of the housing, ratios and utilization factors have no effect.

use super::opening::OpeningShape;
use super::planes::Planes;
use super::{LuminaireFile, check_values};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::input::decoded;
use bdpm_core::scene::Photometry;
use std::borrow::Cow;
use std::path::Path;

/// Largest accepted number of planes or angles.
const MOST_ANGLES: f64 = 100_000.0;

/// Sets of lamps that a note lists, at most.
const MOST_LISTED: usize = 20;

/// The set of lamps that is in the luminaire.
struct Lamps {
    /// Number of lamps; negative for absolute photometry, whose flux is that of the luminaire.
    count: f64,
    /// Luminous flux of all of them, lm.
    lumens: f64,
    /// Electric power of all of them, W.
    watts: f64,
}

/// The lines of a file, one value each.
struct Fields<'a> {
    path: &'a Path,
    lines: Vec<Cow<'a, str>>,
    /// Number of lines that were read.
    read: usize,
}

impl Fields<'_> {
    /// A problem in the last line that was read.
    fn error(&self, problem: impl Into<String>, advice: &str) -> Error {
        let error = Error::new(problem, advice).at(self.path);
        match self.read.checked_sub(1).and_then(|index| self.lines.get(index)) {
            Some(line) => error.line(self.read, line.trim_end()),
            None => error,
        }
    }

    fn text(&mut self, what: &str) -> Result<&str> {
        if self.read == self.lines.len() {
            let problem = format!("the file ends before {what}");
            return Err(self.error(problem, "give the whole file"));
        }
        self.read += 1;
        Ok(self.lines[self.read - 1].trim())
    }

    fn skip(&mut self, count: usize) -> Result<()> {
        (0..count).try_for_each(|_| self.text("the intensities").map(|_| ()))
    }

    /// A number, possibly with a decimal comma; an empty line is 0.
    fn number(&mut self, what: &str) -> Result<f64> {
        let text = self.text(what)?.replace(',', ".");
        let number = if text.is_empty() { Ok(0.0) } else { text.parse::<f64>() };
        number.ok().filter(|number| number.is_finite()).ok_or_else(|| {
            let shown: String = text.chars().take(40).collect();
            self.error(format!("`{shown}` stands for {what}"), "give a number")
        })
    }

    fn count(&mut self, what: &str, least: f64) -> Result<usize> {
        let number = self.number(what)?;
        if number.fract() == 0.0 && (least..=MOST_ANGLES).contains(&number) {
            return Ok(number as usize);
        }
        let problem = format!("{what} is {number}");
        Err(self.error(problem, &format!("give a whole number from {least} to {MOST_ANGLES}")))
    }

    /// The sets of lamps (lines 26 to 26f): the one with this number from 1, or the first with a
    /// note that names all of them.
    fn lamps(&mut self, chosen: Option<usize>, notes: &mut Vec<String>) -> Result<Lamps> {
        let sets = self.count("the number of sets of lamps (line 26)", 1.0)?;
        let number = chosen.unwrap_or(1);
        if !(1..=sets).contains(&number) {
            let (problem, advice) = (format!("there is no set of lamps {number}"), no_set(sets));
            return Err(self.error(problem, &advice));
        }
        let (mut own, mut listed) = (None, Vec::new());
        for set in 1..=sets {
            let start = self.read;
            if set == number {
                own = Some(self.lamp_set()?);
            } else {
                self.skip(6)?;
            }
            if listed.len() < MOST_LISTED {
                let text = |line: usize| -> String {
                    self.lines[start + line].trim().chars().take(40).collect()
                };
                let [lamps, kind, lumens, watts] = [0, 1, 2, 5].map(text);
                let lamps = lamps.trim_start_matches('-');
                listed.push(format!("{set} ({lamps} x {kind}, {lumens} lm, {watts} W)"));
            }
        }
        if chosen.is_none() && sets > 1 {
            let rest = if sets > MOST_LISTED { ", and more" } else { "" };
            notes.push(format!(
                "used the first of {sets} sets of lamps, {}{rest}; `lamp_set` of [[light]] selects \
                 another",
                listed.join(", ")
            ));
        }
        own.ok_or_else(|| self.error("there are no lamps", "give a set of lamps"))
    }

    /// The six lines of a set of lamps.
    fn lamp_set(&mut self) -> Result<Lamps> {
        let count = self.number("the number of lamps")?;
        self.skip(1)?;
        let lumens = self.number("the luminous flux of the lamps")?;
        if lumens <= 0.0 {
            let problem = format!("the luminous flux of the lamps is {lumens}");
            return Err(self.error(problem, "give a flux above 0: intensities are per 1000 lm"));
        }
        self.skip(2)?;
        let watts = self.number("the power of the lamps")?;
        Ok(Lamps { count, lumens, watts })
    }

    fn angles(&mut self, what: &str, count: usize, most: f64) -> Result<Vec<f64>> {
        let mut angles: Vec<f64> = Vec::new();
        for _ in 0..count {
            let angle = self.number(what)?;
            if !(0.0..=most).contains(&angle) {
                let problem = format!("{what} is {angle}");
                return Err(self.error(problem, &format!("give an angle from 0 to {most}")));
            }
            if angles.last().is_some_and(|last| *last >= angle) {
                let problem = format!("{what} is {angle} after {}", angles[angles.len() - 1]);
                return Err(self.error(problem, "give angles in ascending order"));
            }
            angles.push(angle);
        }
        Ok(angles)
    }
}

/// Advice for a set of lamps that is not in the file.
fn no_set(sets: usize) -> String {
    match sets {
        1 => "give 1 or leave out the set: the file has one".to_owned(),
        _ => format!("give a set from 1 to {sets}: the file has {sets}"),
    }
}

/// Parses a file, with the set of lamps of this number from 1; otherwise with the first set.
pub(super) fn parse(path: &Path, bytes: &[u8], lamp_set: Option<usize>) -> Result<LuminaireFile> {
    if memchr::memchr(0, bytes).is_some() {
        let problem = "there is a zero byte, so this is not a text file";
        return Err(Error::new(problem, "give a file in the format EULUMDAT").at(path));
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    // Lines may be blank, but not the last one.
    let bytes = bytes.trim_ascii_end();
    let line = |line| decoded(line);
    let lines: Vec<_> = bytes.split(|byte| *byte == b'\n').map(line).collect();
    let mut fields = Fields { path, lines, read: 0 };
    fields.skip(1)?;
    fields.number("the type of the luminaire (line 2)")?;
    let symmetry = fields.number("the symmetry (line 3)")?;
    if ![0.0, 1.0, 2.0, 3.0, 4.0].contains(&symmetry) {
        let problem = format!("the symmetry is {symmetry}");
        return Err(fields.error(problem, "give a whole number from 0 to 4"));
    }
    let planes = fields.count("the number of planes (line 4)", 1.0)?;
    fields.number("the distance between planes (line 5)")?;
    let angles = fields.count("the number of angles in a plane (line 6)", 2.0)?;
    check_values(planes * angles).map_err(|[problem, advice]| fields.error(problem, &advice))?;
    fields.number("the distance between angles (line 7)")?;
    fields.skip(1)?;
    let name = fields.text("the name of the luminaire (line 9)")?.to_owned();
    fields.skip(3)?;
    for what in ["length", "width", "height"] {
        fields.number(&format!("the {what} of the luminaire"))?;
    }
    let length = fields.number("the length of the luminous area (line 16)")?;
    let width = fields.number("the width of the luminous area (line 17)")?;
    let mut heights = [0.0; 4];
    for height in &mut heights {
        *height = fields.number("a height of the luminous area (lines 18 to 21)")?;
    }
    let height = heights.into_iter().fold(0.0, f64::max);
    let opening = OpeningShape::from_eulumdat([length, width, height].map(|mm| 1e-3 * mm));
    let opening = opening.map_err(|problem| {
        fields.error(problem, "give dimensions of at least 0 mm, of at most 1 km")
    })?;
    fields.number("the downward flux fraction (line 22)")?;
    fields.number("the light output ratio (line 23)")?;
    let conversion = fields.number("the conversion factor (line 24)")?;
    fields.number("the tilt of the measurement (line 25)")?;
    let mut notes = Vec::new();
    let Lamps { count: lamps, lumens, watts } = fields.lamps(lamp_set, &mut notes)?;
    // A negative number of lamps marks absolute photometry, whose flux is that of the luminaire.
    let lamp_lumens = (lamps > 0.0).then_some(lumens);
    // Direct ratios.
    fields.skip(10)?;

    let plane_angles = fields.angles("the angle of a plane", planes, 360.0)?;
    let within = fields.angles("an angle in a plane", angles, 180.0)?;
    // First plane and number of planes that the file lists
    let (first, count) = match symmetry as u32 {
        1 => (0, 1),
        2 => (0, planes / 2 + 1),
        3 => (3 * planes / 4, planes / 2 + 1),
        4 => (0, planes / 4 + 1),
        _ => (0, planes),
    };
    let conversion = if conversion == 0.0 { 1.0 } else { conversion };
    let factor = conversion * lumens / 1000.0;
    if !(factor > 0.0 && factor.is_finite()) {
        let problem = format!("the conversion factor is {conversion}");
        return Err(fields.error(problem, "give a factor above 0"));
    }
    let (mut negative, mut values) = (0, Vec::new());
    for _ in 0..count {
        let mut plane = Vec::new();
        for _ in 0..angles {
            let value = fields.number("an intensity")?;
            negative += usize::from(value < 0.0);
            let value = factor * value.max(0.0);
            if !value.is_finite() {
                return Err(fields.error("the intensity overflows", "lower the flux"));
            }
            plane.push(value);
        }
        values.push(plane);
    }
    if negative > 0 {
        notes.push(format!("{negative} intensities below 0 became 0"));
    }
    let turned = |index: usize| {
        let angle = plane_angles.get(index % planes).copied().unwrap_or(0.0);
        if index >= planes { angle + 360.0 } else { angle }
    };
    let listed: Vec<f64> = match symmetry as u32 {
        1 => vec![0.0],
        _ => (first..first + count).map(turned).collect(),
    };
    // Without symmetry, files never repeat the first plane as the last one.
    let grid = Planes { within, planes: listed, values }.close(&mut Vec::new());
    let distribution = grid.and_then(|grid| grid.distribution(Photometry::C));
    let distribution = distribution.map_err(|error| error.at(path))?;
    let tilt = Vec::new();
    Ok(LuminaireFile { name, distribution, opening, lamp_lumens, watts, tilt, notes })
}
