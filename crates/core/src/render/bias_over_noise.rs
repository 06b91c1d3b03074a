//! Merge bias compared with the noise of an image: once the bias is larger, more samples do not
//! help.

use super::block::Block;
use super::combined_image::CombinedImage;
use crate::film::cells::CellGrid;
use crate::film::radiance::box_filter;
use crate::film::tiled_buffer::tiles_of_cells;
use crate::noise::film::{BATCHES, BatchGrain};
use crate::noise::merge_bias::{BIAS_CERTAINTY, share_left};
use serde::Serialize;

/// Minimum number of measured iterations: two in each batch.
const MIN_MEASURED: u64 = 2 * BATCHES as u64;

/// Merge bias relative to the noise of an image, tile by tile.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BiasOverNoise {
    /// Fraction of the image in tiles whose mean bias is significant and greater than the RMS noise
    /// of their pixels.
    pub share_beyond_noise: f64,
    /// Maximum ratio of significant bias to noise of any tile.
    pub worst_over_noise: f64,
}

impl BiasOverNoise {
    /// Estimates the bias of `image`, which combines `blocks`; `None` before enough iterations are
    /// measured.
    ///
    /// The bias does not depend on the counts, so that the sums of all blocks add up. It is assumed
    /// to decrease with the radius in each tile as in the whole image: theory.md (70). Its error
    /// comes from the batches.
    pub fn new(blocks: &[Block], image: &CombinedImage) -> Option<Self> {
        let (nested, counts) = nested_by_tile(blocks)?;
        let grid = image.grid();
        let (across, _) = grid.size();
        let scale = 1.0 / (1.0 - share_left(&nested));
        let variance = image.cell_variance()?;
        let (mut biased, mut worst) = (0, 0.0f64);
        for (tile, sums) in tiles_of_cells(grid).zip(&nested) {
            let cells = tile.len() as f64;
            // theory.md (70)
            let means = std::array::from_fn(|k| scale * sums[k][0] / (counts[k] * cells));
            let own = (0..tile.len() as u32).map(|index| {
                let (x, y) = tile.pixel(index);
                variance[(y * across + x) as usize]
            });
            let noise = (own.sum::<f64>() / cells).sqrt();
            let significant = significant_part(&means);
            if significant > noise {
                biased += tile.len();
            }
            if significant > 0.0 && noise > 0.0 {
                worst = worst.max(significant / noise);
            }
        }
        let share_beyond_noise = biased as f64 / variance.len() as f64;
        Some(Self { share_beyond_noise, worst_over_noise: worst })
    }
}

/// Merge bias of the luminance of each cell and its standard error, W/(m^2 sr), in row order,
/// pooled over 5 by 5 cells; `None` before enough iterations are measured. The bias is assumed to
/// decrease with the radius in each cell as in the whole image: theory.md (70).
pub fn per_cell(blocks: &[Block]) -> Option<Vec<[f64; 2]>> {
    let (nested, counts) = nested_by_tile(blocks)?;
    let scale = 1.0 / (1.0 - share_left(&nested));
    let iterations: f64 = counts.iter().sum();
    let grid = CellGrid::of(blocks[0].film.resolution());
    let (width, height) = grid.size();
    let mut sums = vec![[0.0; 2]; grid.len()];
    for noise in blocks.iter().filter_map(|block| block.statistics.noise.as_ref()) {
        for (sums, own) in sums.iter_mut().zip(noise.cell_nested(grid)) {
            sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        }
    }
    // Neighbors share photons, so that pooling does not necessarily reduce the error.
    let bias = |[first, squares]: [f64; 2]| {
        let mean = first / iterations;
        let scatter = (squares / iterations - mean * mean).max(0.0) / (iterations - 1.0);
        [scale * mean, scale * scatter.sqrt()]
    };
    let biases: Vec<_> = sums.into_iter().map(bias).collect();
    Some(box_filter(&biases, width, height))
}

/// Sums of both nested differences in each batch.
type Nested = [[f64; 2]; BATCHES];

/// Nested differences of each tile, summed over its cells, and the iterations of each batch; `None`
/// before enough iterations are measured.
fn nested_by_tile(blocks: &[Block]) -> Option<(Vec<Nested>, [f64; BATCHES])> {
    let measured: Vec<_> =
        blocks.iter().filter_map(|block| block.statistics.noise.as_ref()).collect();
    let iterations: u64 = measured.iter().map(|noise| noise.iterations).sum();
    if iterations < MIN_MEASURED {
        return None;
    }
    let grid = CellGrid::of(blocks[0].film.resolution());
    let mut nested = vec![[[0.0; 2]; BATCHES]; tiles_of_cells(grid).count()];
    let mut counts = [0.0; BATCHES];
    for noise in measured {
        for (batch, count) in counts.iter_mut().enumerate() {
            *count += noise.counts().iterations[batch] as f64;
        }
        let mut batches = noise.batches();
        let pixel_tiles = blocks[0].film.sums.tiles();
        for (tile, sums) in pixel_tiles.zip(&mut nested) {
            let (groups, share) = match noise.grain() {
                BatchGrain::Pixel => (tile.len(), grid.pixels_per_cell().recip()),
                BatchGrain::Tile => (1, 1.0),
            };
            for group in batches.by_ref().take(groups) {
                for (sum, batch) in sums.iter_mut().zip(group) {
                    (0..2).for_each(|a: usize| sum[a] += share * f64::from(batch.nested[a]));
                }
            }
        }
    }
    Some((nested, counts))
}

/// Absolute mean of the batches less [`BIAS_CERTAINTY`] standard errors, at least 0.
/// theory.md (71).
fn significant_part(means: &[f64; BATCHES]) -> f64 {
    let n = BATCHES as f64;
    let mean = means.iter().sum::<f64>() / n;
    let scatter = means.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean.abs() - BIAS_CERTAINTY * (scatter / n).sqrt()).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn significant_part_is_zero_within_the_standard_error() {
        let alternating = std::array::from_fn(|k| if k % 2 == 0 { 1.0 } else { -1.0 });
        assert_eq!(significant_part(&alternating), 0.0);
        let shifted = alternating.map(|x| x - 10.0);
        // Standard error sqrt(16/15 / 16).
        let expected = 10.0 - 2.0 * (1.0f64 / 15.0).sqrt();
        assert!((significant_part(&shifted) - expected).abs() < 1e-12);
    }
}
