//! Merges the parts of an image that were rendered separately. Each part is a checkpoint.

use super::checkpoint::{Checkpoint, ShardedImage};
use bdpm_auto::adaptive::plan::Plan;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::iteration_set::IterationSet;
use bdpm_core::render::block::Block;
use bdpm_core::settings::provenance::{Provenance, Reuse};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// The merged image.
#[derive(Debug)]
pub struct Merged {
    /// Checkpoint that a single machine would have written after these iterations.
    pub checkpoint: Checkpoint<'static>,
    /// Parts and iterations that the image lacks, in words.
    pub missing: Vec<String>,
    /// Errors of files that could not be read and are left out.
    pub unreadable: Vec<Error>,
    /// Number of merged files.
    pub files: usize,
}

/// Identity and iterations of a part, which are checked before any sums are added.
struct ShardHeader<'a> {
    path: &'a Path,
    provenance: Provenance,
    plan: Option<Plan>,
    sharded: Option<ShardedImage>,
    numbers: IterationSet,
}

/// Merges checkpoints in the order of their first iterations, so that the order of `paths` does not
/// matter. At most two of them are in the memory at a time, and each is read twice.
///
/// Sums of f64 differ from those of a single run by at most `2^-52` times the number of iterations,
/// relative to the sums of the magnitudes of their terms. For sums of f32 (batches, guides, folds
/// for the denoiser), the factor is `2^-23`.
///
/// # Errors
/// If no file can be read, or if the files do not belong to one image: they differ in scene,
/// settings, version, path counts, number of parts or statistics, one of them chose its path
/// counts, or two of them have common iterations. The error names the file.
pub fn merge(paths: &[PathBuf]) -> Result<Merged> {
    let (mut heads, mut unreadable) = (Vec::new(), Vec::new());
    for path in paths {
        match Checkpoint::load(path) {
            Ok(checkpoint) => heads.push(ShardHeader::new(path, checkpoint)?),
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
    let mut audit = checkpoint.audit.take();
    for ShardHeader { path, .. } in &heads[1..] {
        let mut next = Checkpoint::load(path)?;
        if let (Some(own), Some(other)) = (&mut audit, &next.audit) {
            own.merge(other);
        }
        sums.merge(next.take_partial()).map_err(|e| e.at(*path))?;
    }
    let all = numbers(&sums.blocks);
    let sharded = heads.iter().find_map(|head| head.sharded);
    let missing = missing(&all, sharded);
    // A complete image is not a part.
    let sharded = sharded.filter(|_| !missing.is_empty());
    let (blocks, shared) = (Cow::Owned(sums.blocks), Cow::Owned(sums.shared));
    let checkpoint = Checkpoint { blocks, shared, sharded, audit, ..checkpoint };
    Ok(Merged { checkpoint, missing, unreadable, files: heads.len() })
}

/// Iterations of all blocks.
fn numbers(blocks: &[Block]) -> IterationSet {
    blocks.iter().fold(IterationSet::default(), |all, block| all.with(&block.numbers))
}

impl<'a> ShardHeader<'a> {
    fn new(path: &'a Path, checkpoint: Checkpoint) -> Result<Self> {
        let Checkpoint { provenance, blocks, autopilot, plan, sharded, .. } = checkpoint;
        if autopilot.is_some() {
            let problem =
                "its path counts were chosen during the render, so no other part has the same";
            let advice = "render the image again in parts, with the plan of this image";
            return Err(Error::new(problem, advice).at(path));
        }
        Ok(Self { path, provenance, plan, sharded, numbers: numbers(&blocks) })
    }
}

/// Checks that all parts belong to one image and have no common iterations.
fn check_agree(heads: &[ShardHeader]) -> Result<()> {
    let first = &heads[0];
    let sharded = heads.iter().find_map(|head| Some((head.path, head.sharded?)));
    for (index, head) in heads.iter().enumerate() {
        let refuse = |problem: String, advice: &str| Err(Error::new(problem, advice).at(head.path));
        head.provenance
            .check_agrees(&first.provenance, Reuse::Merge)
            .map_err(|e| e.at(head.path))?;
        if head.plan != first.plan {
            let problem = format!("its plan differs from that of {}", first.path.display());
            return refuse(problem, "render all parts by the same plan");
        }
        if let (Some((path, sharded)), Some(own)) = (sharded, head.sharded)
            && sharded != own
        {
            let describe = |sharded: ShardedImage| {
                format!("one of {} parts of {} iterations", sharded.shards, sharded.iterations)
            };
            let (own, other, path) = (describe(own), describe(sharded), path.display());
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

/// Parts and iterations that an image lacks. If its size is not known, gaps before its last
/// iteration.
fn missing(held: &IterationSet, sharded: Option<ShardedImage>) -> Vec<String> {
    let Some(sharded) = sharded else {
        let end = held.ranges().last().map_or(0, |range| range.end);
        let missing = IterationSet::from(0..end).without(held);
        let gaps = (!missing.is_empty()).then(|| format!("iterations {missing}"));
        return gaps.into_iter().collect();
    };
    let missing_of_part = |index: u32| {
        let part = sharded.shard(index);
        let missing = part.without(held);
        let name = format!("part {}/{}", index + 1, sharded.shards);
        if missing.is_empty() {
            None
        } else if missing == part {
            Some(format!("{name} (iterations {part})"))
        } else {
            Some(format!("iterations {missing} of {name}"))
        }
    };
    (0..sharded.shards).filter_map(missing_of_part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_parts_and_iterations_are_named() {
        let sharded = Some(ShardedImage { iterations: 10, shards: 4 });
        // 0 1 | 2 3 4 | 5 6 | 7 8 9
        let held = IterationSet::from(0..2).with(&IterationSet::from(4..7));
        assert_eq!(
            missing(&held, sharded),
            ["iterations 2 to 3 of part 2/4", "part 4/4 (iterations 7 to 9)"]
        );
        assert_eq!(missing(&held, None), ["iterations 2 to 3"]);
        assert!(missing(&IterationSet::from(0..10), sharded).is_empty());
        assert!(missing(&IterationSet::from(0..3), None).is_empty());
    }
}
