//! Images of which this process renders a part: which iterations, and their sums for others.

use super::Renderer;
use super::block::{Block, PhaseClock};
use super::memory::check_memory;
use crate::base::error::{Error, Result};
use crate::base::iteration_set::IterationSet;
use crate::film::aov::FeatureBuffers;
use crate::film::counts::Counts;
use serde::{Deserialize, Serialize};
use std::mem;

/// All that is kept of some iterations.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sums {
    /// By the numbers of their iterations; none where there is no iteration.
    pub blocks: Vec<Block>,
    /// What is seen, if that is kept.
    pub features: Option<FeatureBuffers>,
    /// Times of the blocks, which these have not when they are read.
    clocks: Vec<PhaseClock>,
}

impl Sums {
    /// Of blocks in the order of their numbers.
    pub fn new(blocks: Vec<Block>, features: Option<FeatureBuffers>) -> Self {
        let clocks = blocks.iter().map(|block| block.clock).collect();
        Self { blocks, features, clocks }
    }

    /// Puts the times in their place that came along when it was read.
    fn with_clocks(mut self) -> Self {
        for (block, clock) in self.blocks.iter_mut().zip(&self.clocks) {
            block.clock = *clock;
        }
        self
    }

    /// Adds those of other iterations of the same image.
    ///
    /// # Errors
    /// If an iteration is in both, or they have other counts or keep other things.
    pub fn add(&mut self, other: Self) -> Result<()> {
        if other.blocks.is_empty() {
            return Ok(());
        }
        let other = other.with_clocks();
        if self.blocks.is_empty() {
            *self = other;
            return Ok(());
        }
        let same = match (&mut self.features, &other.features) {
            (Some(features), Some(others)) => features.merge(others),
            (None, None) => true,
            _ => false,
        };
        if !same {
            return Err(Error::new(
                "it does not keep what the others do",
                "render all parts with the same --layers, --noise and --denoise",
            ));
        }
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
    /// Renders none but the iterations of these numbers from now on.
    #[must_use]
    pub fn sharing(mut self, own: IterationSet) -> Self {
        self.share(own);
        self
    }

    /// The same.
    pub fn share(&mut self, own: IterationSet) {
        self.own = own;
    }

    /// Is one of so many processes that render the image together: times are those of all of them, per iteration.
    #[must_use]
    pub fn with_ranks(self, ranks: u32) -> Self {
        Self { ranks, ..self }
    }

    /// Processes that render the image together.
    pub fn ranks(&self) -> u32 {
        self.ranks
    }

    /// IterationSet of the iterations to render, those that there are included.
    pub fn assigned(&self) -> &IterationSet {
        &self.own
    }

    /// IterationSet of its own iterations in the block under way that there are not yet; the last block has no end.
    pub fn remaining(&self) -> IterationSet {
        let block = self.block();
        IterationSet::from(block.first..u64::MAX).without(&block.numbers).within(&self.own)
    }

    /// Number of the next iteration in the block under way, among those of the whole image.
    pub fn next(&self) -> u64 {
        self.remaining().first().unwrap_or(u64::MAX)
    }

    /// How many iterations of the block under way go before the next one, whoever renders them.
    pub fn block_iteration(&self) -> u64 {
        self.next() - self.block().first
    }

    /// Hands over the sums so far, and goes on without; nothing where there is no iteration.
    pub fn take_sums(&mut self) -> Sums {
        if self.iterations() == 0 {
            return Sums::default();
        }
        let Block { first, counts, .. } = self.block();
        let empty = Block::new(&self.settings, *first, counts.clone()).with_aovs(self.kept);
        let blocks = mem::replace(&mut self.blocks, vec![empty]);
        self.current = 0;
        let (pixels, in_parts) = (self.settings.pixels(), self.kept.parts);
        let features = self.features.as_mut();
        let features =
            features.map(|features| mem::replace(features, FeatureBuffers::new(pixels, in_parts)));
        let with_iterations = blocks.into_iter().filter(|block| block.film.iterations > 0);
        Sums::new(with_iterations.collect(), features)
    }

    /// Adds sums of other iterations.
    ///
    /// # Errors
    /// As [`Sums::add`].
    pub fn add_sums(&mut self, others: Sums) -> Result<()> {
        let first = self.block().first;
        let mut all = Sums::new(mem::take(&mut self.blocks), self.features.take());
        let added = all.add(others);
        (self.blocks, self.features) = (all.blocks, all.features);
        self.current = self.blocks.iter().position(|block| block.first == first).unwrap_or(0);
        added
    }

    /// The same for the block whose first iteration has the number `first`, which may be there already.
    ///
    /// # Errors
    /// If the counts are out of bounds, do not fit in the memory, or are not those of the block that is there.
    ///
    /// # Panics
    /// If there are counts for another number of pixels.
    pub fn enter_block(&mut self, first: u64, counts: Counts) -> Result<()> {
        counts.validate(&self.settings)?;
        check_memory(&self.scene, &self.settings, self.kept, counts.light_paths)?;
        self.blocks.retain(|block| block.film.iterations > 0);
        self.current = self.blocks.partition_point(|block| block.first < first);
        match self.blocks.get(self.current) {
            Some(block) if block.first == first => block.check_counts(&counts),
            _ => {
                let block = Block::new(&self.settings, first, counts).with_aovs(self.kept);
                self.blocks.insert(self.current, block);
                Ok(())
            }
        }
    }
}
