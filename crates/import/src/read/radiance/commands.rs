//! Commands of files: `xform` and `genbox`, which are done here, one after another or in a pipe.

use super::tokens::Primitive;
use super::transforms::Transforms;
use bdpm_core::base::error::{Error, Result};
use glam::DAffine3;

/// A command of a file.
pub struct Command {
    pub source: Source,
    /// Replaces the modifiers of surfaces.
    pub modifier: Option<String>,
    /// Options that have no effect, and names.
    pub notes: Vec<(&'static str, String)>,
    /// Those of each part of a pipe.
    transforms: Vec<Transforms>,
}

/// What a command places.
pub enum Source {
    Files(Vec<String>),
    Primitives(Vec<Primitive>),
}

impl Command {
    /// The command of a line.
    ///
    /// # Errors
    /// If it is another command, or malformed.
    pub fn parse(line: &str) -> Result<Self> {
        let mut own: Option<Self> = None;
        for part in line.split('|') {
            let words: Vec<String> = part.split_whitespace().map(unquoted).collect();
            let mut words = words.into_iter();
            let name = words.next().unwrap_or_default();
            own = Some(match (&name[..], own) {
                ("xform", None) => xform(words, None)?,
                ("xform", Some(before)) => xform(words, Some(before))?,
                ("genbox", None) => genbox(words)?,
                _ => return Err(unknown(&name)),
            });
        }
        own.ok_or_else(|| unknown(""))
    }

    /// The map of each copy.
    ///
    /// # Errors
    /// If there are too many.
    pub fn placements(&self) -> Result<Vec<DAffine3>> {
        let mut all = vec![DAffine3::IDENTITY];
        for transforms in &self.transforms {
            let own = transforms.placements()?;
            if own.len() * all.len() > 1_000_000 {
                let problem = "the arrays have more than a million copies";
                return Err(Error::new(problem, "reduce the numbers of `-a`"));
            }
            all = own.iter().flat_map(|map| all.iter().map(move |first| *map * *first)).collect();
        }
        Ok(all)
    }
}

fn unquoted(word: &str) -> String {
    word.trim_matches(['"', '\'']).to_owned()
}

fn unknown(name: &str) -> Error {
    let advice = format!(
        "run it, `{name} ... > part.rad`, and put `!xform part.rad` in its place; only xform and \
         genbox are done without running commands"
    );
    Error::new(format!("the command `{name}` is not run"), advice)
}

/// `xform [options] files`, or at the end of a pipe.
fn xform(mut words: std::vec::IntoIter<String>, before: Option<Command>) -> Result<Command> {
    let mut transforms = Transforms::default();
    let (mut modifier, mut notes, mut files) = (None, Vec::new(), Vec::new());
    loop {
        if transforms.take(&mut words)? {
            continue;
        }
        let Some(word) = words.next() else { break };
        match &word[..] {
            "-m" => modifier = words.next(),
            // A prefix of names, which changes nothing that is seen.
            "-n" => drop(words.next()),
            "-c" | "-e" => {}
            "-I" => notes.push(("surfaces were not turned inside out by", "xform -I".to_owned())),
            option if option.starts_with('-') => {
                let problem = format!("the option `{option}` of xform is not known");
                return Err(Error::new(problem, "leave it out, or run the command"));
            }
            _ => files.push(word),
        }
    }
    match before {
        None if files.is_empty() => {
            Err(Error::new("`xform` names no file", "give the name of a .rad file"))
        }
        None => Ok(Command {
            source: Source::Files(files),
            modifier,
            notes,
            transforms: vec![transforms],
        }),
        Some(mut before) => {
            before.transforms.push(transforms);
            before.modifier = modifier.or(before.modifier);
            before.notes.append(&mut notes);
            Ok(before)
        }
    }
}

/// `genbox modifier name x y z [-i] [-r radius] [-b bevel]`.
fn genbox(words: std::vec::IntoIter<String>) -> Result<Command> {
    let words: Vec<String> = words.collect();
    let usage = || {
        let advice = "give genbox MODIFIER NAME XSIZE YSIZE ZSIZE";
        Error::new("`genbox` is incomplete", advice)
    };
    let [modifier, name] = [words.first(), words.get(1)].map(|own| own.cloned());
    let (Some(modifier), Some(name)) = (modifier, name) else { return Err(usage()) };
    let mut size = [0.0; 3];
    for (axis, size) in size.iter_mut().enumerate() {
        let given = words.get(axis + 2).and_then(|word| word.parse().ok());
        *size = given.filter(|size: &f64| size.is_finite() && *size > 0.0).ok_or_else(usage)?;
    }
    let options = &words[5..];
    let is_inside = options.iter().any(|word| word == "-i");
    let is_round = options.iter().any(|word| word == "-r" || word == "-b");
    let notes = is_round.then(|| ("sharp edges instead of round ones or bevels of", name.clone()));
    let [x, y, z] = size;
    let corner = |index: usize| {
        let bit = |axis: usize, size: f64| if index >> axis & 1 == 1 { size } else { 0.0 };
        [bit(0, x), bit(1, y), bit(2, z)]
    };
    // Counterclockwise as seen from outside.
    let sides =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let side = |mut corners: [usize; 4]| {
        if is_inside {
            corners.reverse();
        }
        Primitive {
            modifier: modifier.clone(),
            kind: "polygon".into(),
            name: name.clone(),
            numbers: corners.into_iter().flat_map(corner).collect(),
            ..Primitive::default()
        }
    };
    Ok(Command {
        source: Source::Primitives(sides.map(side).into()),
        modifier: None,
        notes: notes.into_iter().collect(),
        transforms: Vec::new(),
    })
}
