//! Whether the merge bias exceeds the noise that is left: more samples then help no further.

use super::block::{Block, Combined};
use crate::noise::film::{BATCHES, BatchGrain};
use crate::settings::policy::BIAS_CERTAINTY;
use serde::Serialize;

/// Measuring iterations that it takes to tell: two in each batch.
const LEAST_MEASURED: u64 = 2 * BATCHES as u64;

/// Merge bias against the noise of an image, tile by tile.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MergeBias {
    /// Share of the image in tiles whose mean bias is certain and greater than the RMS noise of
    /// their pixels.
    pub share_beyond_noise: f64,
    /// The greatest ratio of certain bias to noise of any tile.
    pub worst_over_noise: f64,
}

impl MergeBias {
    /// Of the image that `blocks` make; `None` before enough iterations are measured.
    ///
    /// The bias is `2 (L(r) - L(r/sqrt 2))` (theory.md (69)), the same at all counts, so that
    /// the blocks' sums add. Its error comes from the batches.
    pub fn new(blocks: &[Block], image: &Combined) -> Option<Self> {
        let measured: Vec<_> = blocks.iter().filter_map(|block| block.noise.as_ref()).collect();
        let iterations: u64 = measured.iter().map(|noise| noise.iterations).sum();
        if iterations < LEAST_MEASURED {
            return None;
        }
        let film = &blocks[0].film;
        let mut nested: Vec<[f64; BATCHES]> = vec![[0.0; BATCHES]; film.tiles().count()];
        let mut counts = [0.0; BATCHES];
        for noise in measured {
            for (batch, count) in counts.iter_mut().enumerate() {
                *count += noise.batch_size(batch) as f64;
            }
            let mut batches = noise.batches();
            for (tile, sums) in film.tiles().zip(&mut nested) {
                let groups = match noise.grain() {
                    BatchGrain::Pixel => tile.len(),
                    BatchGrain::Tile => 1,
                };
                for group in batches.by_ref().take(groups) {
                    for (sum, batch) in sums.iter_mut().zip(group) {
                        *sum += f64::from(batch.nested);
                    }
                }
            }
        }

        let variance = image.variance_of_mean()?;
        let (mut beyond, mut worst) = (0, 0.0f64);
        for (tile, sums) in film.tiles().zip(&nested) {
            let pixels = tile.len() as f64;
            // theory.md (69)
            let means = std::array::from_fn(|k| 2.0 * sums[k] / (counts[k] * pixels));
            let own = (0..tile.len() as u32).map(|index| {
                let (x, y) = tile.pixel(index);
                variance[film.index(x, y)]
            });
            let noise = (own.sum::<f64>() / pixels).sqrt();
            let certain = certain_part(&means);
            if certain > noise {
                beyond += tile.len();
            }
            if certain > 0.0 && noise > 0.0 {
                worst = worst.max(certain / noise);
            }
        }
        let share_beyond_noise = beyond as f64 / film.pixels() as f64;
        Some(Self { share_beyond_noise, worst_over_noise: worst })
    }
}

/// Absolute mean of the batches less [`BIAS_CERTAINTY`] standard errors, at least 0.
/// theory.md (71).
fn certain_part(means: &[f64; BATCHES]) -> f64 {
    let n = BATCHES as f64;
    let mean = means.iter().sum::<f64>() / n;
    let scatter = means.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean.abs() - BIAS_CERTAINTY * (scatter / n).sqrt()).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_stands_out_is_certain() {
        let alternating = std::array::from_fn(|k| if k % 2 == 0 { 1.0 } else { -1.0 });
        assert_eq!(certain_part(&alternating), 0.0);
        let shifted = alternating.map(|x| x - 10.0);
        // Standard error sqrt(16/15 / 16).
        let expected = 10.0 - 2.0 * (1.0f64 / 15.0).sqrt();
        assert!((certain_part(&shifted) - expected).abs() < 1e-12);
    }
}
