//! Commands of files: `xform`, `genbox` and `genprism`. They are done here, one after another or in
//! a pipe.

use super::generators::{Generated, genbox, genprism};
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
                ("genbox", None) => Self::of(genbox(words)?),
                ("genprism", None) => Self::of(genprism(words)?),
                _ => return Err(unknown(&name)),
            });
        }
        own.ok_or_else(|| unknown(""))
    }

    /// The command that makes these primitives.
    fn of((primitives, notes): Generated) -> Self {
        let source = Source::Primitives(primitives);
        Self { source, modifier: None, notes, transforms: Vec::new() }
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
        "run it, `{name} ... > part.rad`, and put `!xform part.rad` in its place; only xform, \
         genbox and genprism are done without running commands"
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
