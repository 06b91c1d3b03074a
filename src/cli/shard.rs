//! `render --part`: the iterations that one of several machines renders.

use bdpm::adaptive::stopping::Goal;
use bdpm::base::error::{Error, Result};
use bdpm::base::iteration_set::IterationSet;
use bdpm::output::checkpoint::Whole;
use bdpm::render::block::Block;
use std::fmt;
use std::str::FromStr;

/// A part of an image, as it is written: `3/16`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// From 1.
    number: u32,
    of: u32,
}

impl FromStr for Part {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let parsed = text.split_once('/').and_then(|(number, of)| {
            Some(Self { number: number.trim().parse().ok()?, of: of.trim().parse().ok()? })
        });
        parsed.filter(|part| (1..=part.of).contains(&part.number)).ok_or_else(|| {
            let problem = format!("`{text}` is no part");
            Error::new(problem, "give the part's number and how many there are, such as 1/16")
        })
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

/// What a part comes to.
pub struct Share {
    part: Part,
    pub whole: Whole,
    /// IterationSet of its iterations.
    pub own: IterationSet,
}

impl Part {
    /// Its iterations of those of the goal, or of those that it was begun for.
    pub fn share(self, goal: Goal, begun: Option<Whole>) -> Result<Share> {
        let of = self.of;
        if let Some(begun) = begun.filter(|begun| begun.parts != of) {
            let problem = format!("the checkpoint is one of {} parts, not of {of}", begun.parts);
            return Err(Error::new(problem, "give --part as it was begun"));
        }
        let iterations =
            goal.iterations.or(begun.map(|begun| begun.iterations)).ok_or_else(|| {
                let advice = "give the --iterations of all parts together, or a --plan of an image";
                Error::new("--part is about a known number of iterations", advice)
            })?;
        if let Some(begun) = begun.filter(|begun| begun.iterations != iterations) {
            let problem = format!(
                "the checkpoint is a part of {} iterations, not of {iterations}",
                begun.iterations
            );
            return Err(Error::new(problem, "give --iterations as it was begun"));
        }
        if iterations < of.into() {
            let problem = format!("{iterations} iterations are fewer than {of} parts");
            return Err(Error::new(problem, "render in fewer parts, or more iterations"));
        }
        let whole = Whole { iterations, parts: of };
        Ok(Share { part: self, whole, own: whole.part(self.number - 1) })
    }
}

impl Share {
    /// Refuses to go on with other parts' iterations.
    pub fn check_holds(&self, blocks: &[Block]) -> Result<()> {
        let held =
            blocks.iter().fold(IterationSet::default(), |all, block| all.with(&block.numbers));
        let others = held.without(&self.own);
        if others.is_empty() {
            return Ok(());
        }
        Err(Error::new(
            format!("the checkpoint holds iterations {others}, which part {} has not", self.part),
            "resume each part from its own checkpoint",
        ))
    }
}

impl fmt::Display for Share {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { part, whole, own } = self;
        write!(f, "part {part}: iterations {own} of {}", whole.iterations)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_a_number_of_so_many() {
        let part = "3/16".parse::<Part>().unwrap();
        assert_eq!((part.number, part.of, part.to_string().as_str()), (3, 16, "3/16"));
        for bad in ["", "3", "0/4", "5/4", "-1/4", "1/0", "1/2/3", "a/b", "1/99999999999"] {
            assert!(bad.parse::<Part>().unwrap_err().to_string().contains("is no part"), "{bad}");
        }
    }
}
