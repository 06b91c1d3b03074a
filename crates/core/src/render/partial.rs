//! Rendering some iterations of an image in this process: their assignment, and their sums.

use super::Renderer;
use super::accumulators::SharedStatistics;
use super::block::{Block, PhaseClock, different_statistics};
use super::memory::check_memory;
use crate::base::error::Result;
use crate::base::iteration_set::IterationSet;
use crate::film::counts::Counts;
use serde::{Deserialize, Serialize};
use std::mem;

/// Sums over some iterations of an image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PartialRender {
    /// All blocks, in the order of their first iterations.
    pub blocks: Vec<Block>,
    /// Statistics over all blocks.
    pub shared: SharedStatistics,
    /// Times of the blocks, which are not serialized with the blocks.
    clocks: Vec<PhaseClock>,
}

impl PartialRender {
    /// Sums of `blocks`, which are in the order of their first iterations.
    pub fn new(blocks: Vec<Block>, shared: SharedStatistics) -> Self {
        let clocks = blocks.iter().map(|block| block.clock).collect();
        Self { blocks, shared, clocks }
    }

    /// Adds the sums over other iterations of the same image.
    ///
    /// # Errors
    /// If both contain the same iteration, or have different counts or statistics.
    pub fn merge(&mut self, mut other: Self) -> Result<()> {
        if other.blocks.is_empty() {
            return Ok(());
        }
        for (block, clock) in other.blocks.iter_mut().zip(&other.clocks) {
            block.clock = *clock;
        }
        if self.blocks.is_empty() {
            *self = other;
            return Ok(());
        }
        if !self.shared.can_merge(&other.shared) {
            return Err(different_statistics());
        }
        self.shared.merge(&other.shared);
        for block in other.blocks {
            let at = self.blocks.partition_point(|own| own.first < block.first);
            match self.blocks.get_mut(at).filter(|own| own.first == block.first) {
                Some(own) => own.merge(&block)?,
                None => self.blocks.insert(at, block),
            }
        }
        self.clocks = self.blocks.iter().map(|block| block.clock).collect();
        Ok(())
    }
}

impl Renderer {
    /// Renders only the iterations with these numbers from now on.
    pub fn assign(&mut self, iterations: IterationSet) {
        self.assigned = iterations;
    }

    /// Numbers of the iterations that this process renders, including those that are done.
    pub fn assigned(&self) -> &IterationSet {
        &self.assigned
    }

    /// Assigned iterations of the current block that are not done. The last block has no end.
    pub fn remaining(&self) -> IterationSet {
        let block = self.block();
        IterationSet::from(block.first..u64::MAX).without(&block.numbers).within(&self.assigned)
    }

    /// Number of the next iteration in the current block, among those of the whole image.
    pub fn next_iteration(&self) -> u64 {
        self.remaining().first().unwrap_or(u64::MAX)
    }

    /// Number of iterations in the current block before the next one, whichever process renders
    /// them.
    pub fn block_iteration(&self) -> u64 {
        self.next_iteration() - self.block().first
    }

    /// Takes the sums so far and starts again from zero; empty if there is no iteration.
    pub fn take_partial(&mut self) -> PartialRender {
        if self.iterations() == 0 {
            return PartialRender::default();
        }
        let Block { first, counts, .. } = self.block();
        let empty = Block::new(&self.request(), *first, counts.clone());
        let mut shared = SharedStatistics::default();
        shared.start(&self.request());
        self.current = 0;
        let mut sums = mem::replace(&mut self.sums, PartialRender::new(vec![empty], shared));
        sums.blocks.retain(|block| block.film.iterations > 0);
        PartialRender::new(sums.blocks, sums.shared)
    }

    /// Adds the sums over other iterations of the same image.
    ///
    /// # Errors
    /// Those of [`PartialRender::merge`].
    pub fn add_partial(&mut self, other: PartialRender) -> Result<()> {
        let first = self.block().first;
        let added = self.sums.merge(other);
        self.current = self.sums.blocks.iter().position(|block| block.first == first).unwrap_or(0);
        added
    }

    /// Renders the block whose first iteration has the number `first` from now on. If there is no
    /// such block, it is started; blocks without iterations are removed.
    ///
    /// # Errors
    /// If the counts are out of bounds, do not fit in the memory, or differ from those of the
    /// block.
    ///
    /// # Panics
    /// If there are counts for another number of pixels.
    pub fn enter_block(&mut self, first: u64, counts: Counts) -> Result<()> {
        counts.validate(&self.settings)?;
        let request = self.config.request(&self.settings);
        check_memory(&self.scene, &request, counts.light_paths)?;
        let blocks = &mut self.sums.blocks;
        blocks.retain(|block| block.film.iterations > 0);
        self.current = blocks.partition_point(|block| block.first < first);
        match blocks.get(self.current) {
            Some(block) if block.first == first => block.check_counts(&counts),
            _ => {
                blocks.insert(self.current, Block::new(&request, first, counts));
                Ok(())
            }
        }
    }
}
