//! Tiles of the image during an iteration, and their assignment to threads.

use super::accumulators::{BlockStatisticsTile, IterationSample, SharedStatisticsTile};
use crate::film::radiance::FilmTile;

/// One tile of all sums.
pub struct TileSums<'a> {
    /// Values of the pixels.
    pub film: FilmTile<'a>,
    /// Statistics of the block.
    pub block: BlockStatisticsTile<'a>,
    /// Statistics of all blocks.
    pub shared: SharedStatisticsTile<'a>,
}

impl TileSums<'_> {
    /// Adds one iteration to the tile's pixel `index`.
    #[inline]
    pub fn add_sample(&mut self, index: usize, sample: &IterationSample) {
        self.film.add_sample(index, &sample.pixel);
        self.block.add_sample(index, sample);
        self.shared.add_sample(index, sample);
    }

    /// Adds one iteration to the tile's pixel `index`, but not to statistics of cells.
    #[inline]
    pub fn add_pixel(&mut self, index: usize, sample: &IterationSample) {
        self.film.add_sample(index, &sample.pixel);
        self.block.add_sample_of(false, index, sample);
        self.shared.add_sample_of(false, index, sample);
    }

    /// Adds one iteration to the statistics of the tile's cell `index`.
    pub fn add_cell(&mut self, index: usize, mean: &IterationSample) {
        self.block.add_sample_of(true, index, mean);
        self.shared.add_sample_of(true, index, mean);
    }
}

/// Divides tiles into batches for the threads. The first batches are large, so that many camera
/// paths are merged together. They shrink toward the end, so that no thread waits long for another.
pub struct TileBatches<'a, 'b> {
    rest: &'a mut [TileSums<'b>],
    /// Tiles of a batch, at most.
    max_tiles: usize,
    /// Number of batches that the remaining tiles are divided into.
    divisor: usize,
}

impl<'a, 'b> TileBatches<'a, 'b> {
    /// Divides `tiles` for the threads of the current rayon pool.
    pub fn new(tiles: &'a mut [TileSums<'b>], max_tiles: usize) -> Self {
        let divisor = 2 * rayon::current_num_threads();
        Self { rest: tiles, max_tiles: max_tiles.max(1), divisor }
    }
}

impl<'a, 'b> Iterator for TileBatches<'a, 'b> {
    type Item = &'a mut [TileSums<'b>];

    fn next(&mut self) -> Option<Self::Item> {
        let size = self.rest.len().div_ceil(self.divisor).min(self.max_tiles);
        (size > 0).then(|| self.rest.split_off_mut(..size).expect("the batch is not larger"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::counts::Counts;
    use crate::film::statistic::CurrentIteration;
    use crate::render::RenderConfig;
    use crate::render::accumulators::SharedStatistics;
    use crate::render::block::Block;
    use crate::settings::{PartialSettings, Settings};

    #[test]
    fn tile_batches_cover_all_tiles_and_shrink() {
        let partial = PartialSettings { resolution: Some([160, 160]), ..Default::default() };
        let settings = Settings::resolve(&partial, &Default::default(), 1.0).unwrap();
        let request = RenderConfig::default().request(&settings);
        let mut block = Block::new(&request, 0, Counts::uniform(10, 1));
        let mut shared = SharedStatistics::default();
        let iteration = CurrentIteration { number: 0, is_measured: false };
        let (_, mut tiles) = block.begin_iteration(iteration, request, &mut shared);
        for (max_tiles, first, count) in [(7, 7, 100), (1000, 25, 100), (0, 1, 100), (5, 1, 1)] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
            let batches = pool.install(|| TileBatches::new(&mut tiles[..count], max_tiles));
            let sizes: Vec<usize> = batches.map(|batch| batch.len()).collect();
            assert_eq!(sizes.iter().sum::<usize>(), count);
            assert_eq!((sizes[0], *sizes.last().unwrap()), (first, 1));
            assert!(sizes.is_sorted_by(|one, next| one >= next), "{sizes:?}");
        }
    }
}
