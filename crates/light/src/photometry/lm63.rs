//! IES LM-63, the standard file format of photometric data of the Illuminating Engineering Society,
//! of 1986, 1991, 1995, 2002 and 2019.
//!
//! Read are the tilt, the candela multiplier, the ballast factor, the luminous opening and the
//! candela values. Keywords other than `LUMINAIRE` have no effect.

use super::opening::OpeningShape;
use super::planes::Planes;
use super::{LuminaireFile, check_values};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::input::{decoded, read_bytes};
use bdpm_core::scene::Photometry;
use std::borrow::Cow;
use std::path::Path;

/// Meters per foot.
const FOOT: f64 = 0.3048;
/// Largest accepted number of angles of a kind.
const MOST_ANGLES: usize = 100_000;
/// Largest accepted file of tilt factors, bytes.
const MAX_TILT: u64 = 1 << 20;

/// Years of the versions of the format, by the first line of the file; older files have none.
const VERSIONS: &[(&str, u32)] = &[
    ("IESNA91", 1991),
    ("IESNA:LM-63-1995", 1995),
    ("IESNA:LM-63-2002", 2002),
    ("IES:LM-63-2019", 2019),
];

/// The words of a file, separated by white space or commas.
struct Words<'a> {
    path: &'a Path,
    lines: &'a [Cow<'a, str>],
    /// Index of the next line.
    next: usize,
    /// Byte offset of the rest of the line before.
    offset: usize,
}

const IS_SEPARATOR: fn(char) -> bool = |c| c.is_whitespace() || c == ',' || c == '\u{1a}';

impl<'a> Words<'a> {
    fn new(path: &'a Path, lines: &'a [Cow<'a, str>], next: usize) -> Self {
        let offset = lines.get(next.wrapping_sub(1)).map_or(0, |line| line.len());
        Self { path, lines, next, offset }
    }

    /// A problem in the line of the last word.
    fn error(&self, problem: impl Into<String>, advice: &str) -> Error {
        let error = Error::new(problem, advice).at(self.path);
        match self.next.checked_sub(1).and_then(|index| self.lines.get(index)) {
            Some(line) => error.line(self.next, line.trim_end()),
            None => error,
        }
    }

    /// The next word; `what` names it for the error at the end of the file.
    fn word(&mut self, what: &str) -> Result<&'a str> {
        loop {
            let line = self.next.checked_sub(1).map_or("", |index| &self.lines[index]);
            let rest = line[self.offset..].trim_start_matches(IS_SEPARATOR);
            if !rest.is_empty() {
                let end = rest.find(IS_SEPARATOR).unwrap_or(rest.len());
                self.offset = line.len() - rest.len() + end;
                return Ok(&rest[..end]);
            }
            if self.next == self.lines.len() {
                let problem = format!("the file ends before {what}");
                return Err(self.error(problem, "give the whole file"));
            }
            self.next += 1;
            self.offset = 0;
        }
    }

    fn number(&mut self, what: &str) -> Result<f64> {
        let word = self.word(what)?;
        let number = word.parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| {
            let shown: String = word.chars().take(40).collect();
            self.error(format!("`{shown}` stands for {what}"), "give a number")
        })
    }

    /// A whole number, possibly with a decimal point.
    fn count(&mut self, what: &str, least: usize) -> Result<usize> {
        let number = self.number(what)?;
        if number.fract() == 0.0 && (least as f64..=MOST_ANGLES as f64).contains(&number) {
            return Ok(number as usize);
        }
        let problem = format!("{what} is {number}");
        Err(self.error(problem, &format!("give a whole number from {least} to {MOST_ANGLES}")))
    }

    /// `count` angles in ascending order within a range, degrees.
    fn angles(&mut self, what: &str, count: usize, [from, to]: [f64; 2]) -> Result<Vec<f64>> {
        let mut angles: Vec<f64> = Vec::new();
        for _ in 0..count {
            let angle = self.number(what)?;
            if !(from..=to).contains(&angle) {
                let problem = format!("{what} is {angle}");
                return Err(self.error(problem, &format!("give an angle from {from} to {to}")));
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

/// Splits a file into lines, without blank ones at its end.
fn lines(bytes: &[u8]) -> Vec<Cow<'_, str>> {
    let bytes = bytes.trim_ascii_end();
    let ends = |byte: &u8| *byte == b'\n';
    bytes.split(ends).map(|line| decoded(line.strip_suffix(b"\r").unwrap_or(line))).collect()
}

/// Parses a file. A file of tilt factors is looked for beside `path`.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<LuminaireFile> {
    if memchr::memchr(0, bytes).is_some() {
        let problem = "there is a zero byte, so this is not a text file";
        return Err(Error::new(problem, "give a file in the format IES LM-63").at(path));
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let lines = lines(bytes);
    let first = lines.iter().map(|line| line.trim()).find(|line| !line.is_empty());
    let is = |tag: &str| first.is_some_and(|line| line.eq_ignore_ascii_case(tag));
    let year = VERSIONS.iter().find(|(tag, _)| is(tag)).map_or(1986, |(_, year)| *year);
    let tilt_of = |line: &str| {
        let line = line.trim();
        let (key, value) = line.split_once('=')?;
        key.trim().eq_ignore_ascii_case("tilt").then(|| value.trim().to_owned())
    };
    let found = lines.iter().enumerate().find_map(|(i, line)| Some((i, tilt_of(line)?)));
    let Some((tilt_line, tilt)) = found else {
        let problem = "there is no line TILT=, so this is not an IES file";
        return Err(Error::new(problem, "give a file in the format IES LM-63").at(path));
    };
    let name = lines[..tilt_line].iter().find_map(|line| {
        let line = line.trim();
        let is_name = line.get(..11)?.eq_ignore_ascii_case("[LUMINAIRE]");
        is_name.then(|| line[11..].trim().to_owned())
    });
    let mut words = Words::new(path, &lines, tilt_line + 1);
    let tilt = match &tilt.to_ascii_uppercase()[..] {
        "NONE" => Vec::new(),
        "INCLUDE" => tilt_factors(&mut words)?,
        _ => tilt_file(&words, &tilt)?,
    };
    let mut notes = Vec::new();

    let lamps = words.number("the number of lamps")?;
    let lumens = words.number("the lumens per lamp")?;
    let multiplier = words.number("the candela multiplier")?;
    let vertical = words.count("the number of vertical angles", 2)?;
    let horizontal = words.count("the number of horizontal angles", 1)?;
    check_values(vertical * horizontal)
        .map_err(|[problem, advice]| words.error(problem, &advice))?;
    let photometry = match words.number("the photometric type")? {
        1.0 => Photometry::C,
        2.0 => Photometry::B,
        3.0 => Photometry::A,
        other => {
            let problem = format!("the photometric type is {other}");
            return Err(words.error(problem, "give 1 (C), 2 (B) or 3 (A)"));
        }
    };
    let unit = match words.number("the type of units")? {
        1.0 => FOOT,
        2.0 => 1.0,
        other => {
            let problem = format!("the type of units is {other}");
            return Err(words.error(problem, "give 1 (feet) or 2 (meters)"));
        }
    };
    let mut size = [0.0; 3];
    for (size, what) in size.iter_mut().zip(["width", "length", "height"]) {
        *size = unit * words.number(&format!("the {what} of the luminous opening"))?;
    }
    let opening = OpeningShape::from_lm63(year, size).map_err(|problem| {
        words.error(problem, "give 0 0 0 for a point, or a shape of the standard")
    })?;
    let ballast = words.number("the ballast factor")?;
    // In 1995 it became a number for future use, and in 2019 the origin of the file.
    let photometric = words.number("the ballast lamp photometric factor")?;
    let photometric = if year < 1995 { photometric } else { 1.0 };
    let factor = multiplier * ballast * photometric;
    if !(factor > 0.0 && factor.is_finite()) {
        let problem = format!("the multiplier times the ballast factor is {factor}");
        return Err(words.error(problem, "give factors above 0"));
    }
    let watts = words.number("the input watts")?;

    let ranges = match photometry {
        Photometry::C => [[0.0, 180.0], [-360.0, 720.0]],
        Photometry::A | Photometry::B => [[-90.0, 90.0]; 2],
    };
    let within = words.angles("a vertical angle", vertical, ranges[0])?;
    let planes = words.angles("a horizontal angle", horizontal, ranges[1])?;
    let mut negative = 0;
    let mut values = Vec::new();
    for _ in 0..horizontal {
        let mut plane = Vec::new();
        for _ in 0..vertical {
            let value = words.number("a candela value")?;
            negative += usize::from(value < 0.0);
            let value = factor * value.max(0.0);
            if !value.is_finite() {
                return Err(words.error("the intensity overflows", "lower the multiplier"));
            }
            plane.push(value);
        }
        values.push(plane);
    }
    if negative > 0 {
        notes.push(format!("{negative} candela values below 0 became 0"));
    }
    if words.word("").is_ok() {
        notes.push("ignored what follows the candela values".into());
    }
    let grid = Planes { within, planes, values };
    let grid = match photometry {
        Photometry::C => grid.close(&mut notes),
        Photometry::A | Photometry::B => Ok(grid.mirror_half()),
    };
    let distribution = grid.and_then(|grid| grid.distribution(photometry));
    let distribution = distribution.map_err(|error| error.at(path))?;
    let lamp_lumens = (lumens > 0.0 && lamps > 0.0).then_some(lamps * lumens);
    let name = name.unwrap_or_default();
    Ok(LuminaireFile { name, distribution, opening, lamp_lumens, watts, tilt, notes })
}

/// The records after `TILT=INCLUDE`, also those of a file of tilt factors.
fn tilt_factors(words: &mut Words) -> Result<Vec<[f64; 2]>> {
    // Whether the lamp is vertical, or horizontal along or across the axis of the tilt. The factors
    // already hold for this luminaire, so that it has no effect.
    let geometry = words.number("the lamp to luminaire geometry")?;
    if ![1.0, 2.0, 3.0].contains(&geometry) {
        let problem = format!("the lamp to luminaire geometry is {geometry}");
        return Err(words.error(problem, "give 1, 2 or 3"));
    }
    let count = words.count("the number of tilt angles", 1)?;
    let angles = words.angles("a tilt angle", count, [0.0, 180.0])?;
    let mut factors = Vec::new();
    for angle in angles {
        let factor = words.number("a tilt factor")?;
        if factor < 0.0 {
            return Err(words.error(format!("a tilt factor is {factor}"), "give at least 0"));
        }
        factors.push([angle, factor]);
    }
    Ok(factors)
}

/// Reads the file that `TILT=` names, in the folder of the IES file.
fn tilt_file(words: &Words, name: &str) -> Result<Vec<[f64; 2]>> {
    let path = words.path.with_file_name(name);
    if !path.is_file() {
        let problem = format!("there is no file `{name}` of tilt factors");
        return Err(words.error(problem, "put it beside the IES file, or write TILT=NONE"));
    }
    let bytes = read_bytes(&path, MAX_TILT)?;
    let lines = lines(&bytes);
    tilt_factors(&mut Words::new(&path, &lines, 0))
}
