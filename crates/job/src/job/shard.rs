//! Shards: the iterations of an image that one of several machines renders.

use crate::output::checkpoint::ShardedImage;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::iteration_set::IterationSet;
use bdpm_core::render::block::Block;
use std::fmt;
use std::str::FromStr;

/// One of several shards of an image, written as `3/16`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Number of this shard, from 1.
    number: u32,
    /// Number of all shards.
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
            Error::new(problem, "give the number of the part and the number of parts, such as 1/16")
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
    pub sharded: ShardedImage,
    pub assigned: IterationSet,
}

impl Shard {
    /// The iterations of this shard: of an image of `iterations` iterations, or of the image that
    /// was started before.
    pub(super) fn iterations(
        self,
        iterations: Option<u64>,
        begun: Option<ShardedImage>,
    ) -> Result<ShardIterations> {
        let of = self.of;
        if let Some(begun) = begun.filter(|begun| begun.shards != of) {
            let problem = format!("the checkpoint is one of {} parts, not of {of}", begun.shards);
            return Err(Error::new(problem, "resume the part with its own numbers"));
        }
        // An open number is refused before.
        let iterations = iterations.or(begun.map(|begun| begun.iterations)).unwrap_or(0);
        if let Some(begun) = begun.filter(|begun| begun.iterations != iterations) {
            let problem = format!(
                "the checkpoint is a part of {} iterations, not of {iterations}",
                begun.iterations
            );
            return Err(Error::new(
                problem,
                "give the number of iterations that the image was started with",
            ));
        }
        if iterations < of.into() {
            let problem = format!("{iterations} iterations are fewer than {of} parts");
            return Err(Error::new(problem, "use fewer parts or more iterations"));
        }
        let sharded = ShardedImage { iterations, shards: of };
        Ok(ShardIterations { shard: self, sharded, assigned: sharded.shard(self.number - 1) })
    }
}

impl ShardIterations {
    /// Refuses a checkpoint with iterations of other shards.
    pub fn check_holds(&self, blocks: &[Block]) -> Result<()> {
        let held =
            blocks.iter().fold(IterationSet::default(), |all, block| all.with(&block.numbers));
        let others = held.without(&self.assigned);
        if others.is_empty() {
            return Ok(());
        }
        Err(Error::new(
            format!(
                "the checkpoint holds iterations {others}, which are not in part {}",
                self.shard
            ),
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
