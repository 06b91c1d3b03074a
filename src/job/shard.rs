//! Shards: the iterations of an image that one of several machines renders.

use crate::base::error::{Error, Result};
use crate::base::iteration_set::IterationSet;
use crate::output::checkpoint::Whole;
use crate::render::block::Block;
use std::fmt;
use std::str::FromStr;

/// One of several shards of an image, written as `3/16`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 1.
    number: u32,
    /// Number of shards.
    of: u32,
}

impl FromStr for Shard {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let parsed = text.split_once('/').and_then(|(number, of)| {
            Some(Self { number: number.trim().parse().ok()?, of: of.trim().parse().ok()? })
        });
        parsed.filter(|shard| (1..=shard.of).contains(&shard.number)).ok_or_else(|| {
            let problem = format!("`{text}` is not a part of an image");
            Error::new(problem, "give the part's number and how many there are, such as 1/16")
        })
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

/// The iterations of a shard.
pub(super) struct ShardIterations {
    shard: Shard,
    pub whole: Whole,
    pub assigned: IterationSet,
}

impl Shard {
    /// Its iterations of the image's, or of those that it was begun for.
    pub(super) fn iterations(
        self,
        iterations: Option<u64>,
        begun: Option<Whole>,
    ) -> Result<ShardIterations> {
        let of = self.of;
        if let Some(begun) = begun.filter(|begun| begun.parts != of) {
            let problem = format!("the checkpoint is one of {} parts, not of {of}", begun.parts);
            return Err(Error::new(problem, "resume the part with the numbers it was begun with"));
        }
        let iterations = iterations.or(begun.map(|begun| begun.iterations)).ok_or_else(|| {
            let advice =
                "give the number of iterations of all parts together, or the plan of an image";
            Error::new("parts of an image take a known number of iterations", advice)
        })?;
        if let Some(begun) = begun.filter(|begun| begun.iterations != iterations) {
            let problem = format!(
                "the checkpoint is a part of {} iterations, not of {iterations}",
                begun.iterations
            );
            return Err(Error::new(
                problem,
                "give the number of iterations that it was begun with",
            ));
        }
        if iterations < of.into() {
            let problem = format!("{iterations} iterations are fewer than {of} parts");
            return Err(Error::new(problem, "render in fewer parts, or more iterations"));
        }
        let whole = Whole { iterations, parts: of };
        Ok(ShardIterations { shard: self, whole, assigned: whole.part(self.number - 1) })
    }
}

impl ShardIterations {
    /// Refuses to go on with iterations of other shards.
    pub fn check_holds(&self, blocks: &[Block]) -> Result<()> {
        let held =
            blocks.iter().fold(IterationSet::default(), |all, block| all.with(&block.numbers));
        let others = held.without(&self.assigned);
        if others.is_empty() {
            return Ok(());
        }
        Err(Error::new(
            format!("the checkpoint holds iterations {others}, which part {} has not", self.shard),
            "resume each part from its own checkpoint",
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shard_text_is_a_number_and_a_count() {
        let shard = "3/16".parse::<Shard>().unwrap();
        assert_eq!((shard.number, shard.of, shard.to_string().as_str()), (3, 16, "3/16"));
        for bad in ["", "3", "0/4", "5/4", "-1/4", "1/0", "1/2/3", "a/b", "1/99999999999"] {
            assert!(
                bad.parse::<Shard>().unwrap_err().to_string().contains("is not a part"),
                "{bad}"
            );
        }
    }
}
