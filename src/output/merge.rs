//! One image of parts that were rendered apart, each in a checkpoint.

use super::checkpoint::{Checkpoint, Whole};
use crate::adaptive::plan::Plan;
use crate::base::error::{Error, Result};
use crate::base::iteration_set::IterationSet;
use crate::render::block::Block;
use crate::settings::provenance::{Provenance, Reuse};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// What the parts make together.
#[derive(Debug)]
pub struct Merged {
    /// As if one machine had rendered all of their iterations.
    pub checkpoint: Checkpoint<'static>,
    /// What is missing to the whole, in words.
    pub missing: Vec<String>,
    /// Files that could not be read, and are left out.
    pub unreadable: Vec<Error>,
    /// How many files were merged.
    pub files: usize,
}

/// What must agree, and what is in which file: read before any sums are added.
struct Head<'a> {
    path: &'a Path,
    origin: Provenance,
    plan: Option<Plan>,
    whole: Option<Whole>,
    numbers: IterationSet,
}

/// Merges checkpoints in the order of their first iterations, whatever the order of `paths`: equal files give an
/// equal result. At most two are in the memory at a time; each is read twice.
///
/// Sums of f64 are those of one run within `2^-52` times the number of iterations, relative to the sums of their
/// terms' magnitudes, those of f32 (batches, guides, parts for the denoiser) within `2^-23` times as many.
///
/// # Errors
/// If no file can be read, or one does not belong to the others: it is of another scene, settings, version, counts
/// or number of parts, keeps other things, chose its counts by itself, or holds an iteration that another one holds.
/// Files are named.
pub fn merge(paths: &[PathBuf]) -> Result<Merged> {
    let (mut heads, mut unreadable) = (Vec::new(), Vec::new());
    for path in paths {
        match Checkpoint::load(path) {
            Ok(checkpoint) => heads.push(Head::new(path, checkpoint)?),
            Err(error) => unreadable.push(error),
        }
    }
    if heads.is_empty() {
        return Err(Error::all(unreadable).err().unwrap_or_else(|| {
            Error::new("there is nothing to merge", "give the checkpoints of the parts")
        }));
    }
    check_agree(&heads)?;
    heads.sort_by_key(|head| head.numbers.first().unwrap_or(u64::MAX));
    let mut checkpoint = Checkpoint::load(heads[0].path)?;
    let mut sums = checkpoint.take_partial();
    for Head { path, .. } in &heads[1..] {
        let next = Checkpoint::load(path)?.take_partial();
        sums.merge(next).map_err(|e| e.at(*path))?;
    }
    let all = numbers(&sums.blocks);
    let whole = heads.iter().find_map(|head| head.whole);
    let missing = missing(&all, whole);
    // Nothing is a part any more that lacks nothing.
    let whole = whole.filter(|_| !missing.is_empty());
    let (blocks, shared) = (Cow::Owned(sums.blocks), Cow::Owned(sums.shared));
    let checkpoint = Checkpoint { blocks, shared, whole, ..checkpoint };
    Ok(Merged { checkpoint, missing, unreadable, files: heads.len() })
}

/// Iterations of all blocks.
fn numbers(blocks: &[Block]) -> IterationSet {
    blocks.iter().fold(IterationSet::default(), |all, block| all.with(&block.numbers))
}

impl<'a> Head<'a> {
    fn new(path: &'a Path, checkpoint: Checkpoint) -> Result<Self> {
        let Checkpoint { origin, blocks, autopilot, plan, whole, .. } = checkpoint;
        if autopilot.is_some() {
            let problem =
                "its numbers of paths were chosen on the way: no other part can have the same";
            let advice = "render its image again in parts, with --plan";
            return Err(Error::new(problem, advice).at(path));
        }
        Ok(Self { path, origin, plan, whole, numbers: numbers(&blocks) })
    }
}

/// Whether all are of one image, and no iteration is there twice.
fn check_agree(heads: &[Head]) -> Result<()> {
    let first = &heads[0];
    let whole = heads.iter().find_map(|head| Some((head.path, head.whole?)));
    for (index, head) in heads.iter().enumerate() {
        let refuse = |problem: String, advice: &str| Err(Error::new(problem, advice).at(head.path));
        head.origin.check_agrees(&first.origin, Reuse::Merge).map_err(|e| e.at(head.path))?;
        if head.plan != first.plan {
            let problem = format!("its --plan is not that of {}", first.path.display());
            return refuse(problem, "render all parts by the same plan");
        }
        if let (Some((path, whole)), Some(own)) = (whole, head.whole)
            && whole != own
        {
            let told = |whole: Whole| {
                format!("one of {} parts of {} iterations", whole.parts, whole.iterations)
            };
            let (own, other, path) = (told(own), told(whole), path.display());
            let problem = format!("it is {own}, but {path} is {other}");
            return refuse(problem, "merge the parts of one image");
        }
        for other in &heads[..index] {
            let both = head.numbers.within(&other.numbers);
            if !both.is_empty() {
                let problem =
                    format!("it holds iterations {both}, as {} does", other.path.display());
                return refuse(problem, "give every part once");
            }
        }
    }
    Ok(())
}

/// What is missing to a whole, or else between the first iteration and the last.
fn missing(held: &IterationSet, whole: Option<Whole>) -> Vec<String> {
    let Some(whole) = whole else {
        let end = held.ranges().last().map_or(0, |range| range.end);
        let missing = IterationSet::from(0..end).without(held);
        let told = (!missing.is_empty()).then(|| format!("iterations {missing}"));
        return told.into_iter().collect();
    };
    let told = |index: u32| {
        let part = whole.part(index);
        let missing = part.without(held);
        let name = format!("part {}/{}", index + 1, whole.parts);
        if missing.is_empty() {
            None
        } else if missing == part {
            Some(format!("{name} (iterations {part})"))
        } else {
            Some(format!("iterations {missing} of {name}"))
        }
    };
    (0..whole.parts).filter_map(told).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_named() {
        let whole = Some(Whole { iterations: 10, parts: 4 });
        // 0 1 | 2 3 4 | 5 6 | 7 8 9
        let held = IterationSet::from(0..2).with(&IterationSet::from(4..7));
        assert_eq!(
            missing(&held, whole),
            ["iterations 2 to 3 of part 2/4", "part 4/4 (iterations 7 to 9)"]
        );
        assert_eq!(missing(&held, None), ["iterations 2 to 3"]);
        assert!(missing(&IterationSet::from(0..10), whole).is_empty());
        assert!(missing(&IterationSet::from(0..3), None).is_empty());
    }
}
