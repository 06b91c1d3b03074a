//! Rectangles of an image, and a sample of tiles in which the error of a denoised image is
//! estimated.

use bdpm_core::base::rng::{Stream, StreamKey};

/// Width and height of a sampled tile as the denoiser sees it, pixels.
pub const TILE: u32 = 128;

/// Width of the border of a sampled tile that only shows the denoiser the neighborhood, pixels.
/// Errors are estimated inside of it. There is no border at the edge of the image.
pub const MARGIN: u32 = 16;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Window {
    /// All pixels of an image.
    pub fn whole((width, height): (u32, u32)) -> Self {
        Self { x: 0, y: 0, width, height }
    }

    /// Columns and rows.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Returns true if the window has no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Indices of the pixels, row by row, in an image of this many columns.
    pub fn indices(self, image_width: u32) -> impl Iterator<Item = usize> {
        (self.y..self.y + self.height).flat_map(move |y| {
            let row = y as usize * image_width as usize;
            (self.x..self.x + self.width).map(move |x| row + x as usize)
        })
    }

    /// Values of the pixels, from those of the whole image.
    pub fn crop<T: Copy>(self, values: &[T], image_width: u32) -> Vec<T> {
        self.indices(image_width).map(|index| values[index]).collect()
    }
}

/// A tile that was drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampledTile {
    /// Pixels that the denoiser sees.
    pub window: Window,
    /// Pixels in which the error is estimated.
    pub core: Window,
    /// Factor of the tile's sum in the estimate of the sum over the image: the number of times that
    /// the tile was drawn, over its expectation.
    pub factor: f64,
}

/// Draws about `n` tiles whose cores partition the image. The expected number of draws of a tile is
/// proportional to the square root of its squared noise plus a tenth of the mean, times its pixels.
/// Tiles are drawn systematically in the order of their noise (Madow 1949), so that quiet and noisy
/// tiles have their share in each sample. `squared_noise` has the terms of the squared error of the
/// raw image, row by row.
pub fn sample_tiles(
    size: (u32, u32),
    squared_noise: &[f64],
    n: usize,
    seed: u64,
) -> Vec<SampledTile> {
    let mut tiles: Vec<(f64, Window, Window)> = cores(size)
        .map(|(window, core)| {
            let sum: f64 = core.indices(size.0).map(|index| squared_noise[index]).sum();
            (sum / core.len() as f64, window, core)
        })
        .collect();
    let mean = squared_noise.iter().sum::<f64>() / squared_noise.len() as f64;
    tiles.sort_by(|(one, ..), (other, ..)| one.total_cmp(other));
    let measure = |(noise, _, core): &(f64, Window, Window)| {
        let noise = (noise.max(0.0) + 0.1 * mean).sqrt();
        core.len() as f64 * if noise > 0.0 { noise } else { 1.0 }
    };
    let per_draw = tiles.iter().map(measure).sum::<f64>() / n as f64;
    let start = f64::from(StreamKey::new(seed, Stream::Denoiser, 0).rng(0).next_1d());
    let (mut end, mut sampled) = (0.0, Vec::new());
    for tile in &tiles {
        let expected = measure(tile) / per_draw;
        let draws = (end + expected + start).floor() - (end + start).floor();
        end += expected;
        if draws > 0.0 {
            let &(_, window, core) = tile;
            sampled.push(SampledTile { window, core, factor: draws / expected });
        }
    }
    sampled
}

/// Tiles and their cores, which partition the image.
fn cores((width, height): (u32, u32)) -> impl Iterator<Item = (Window, Window)> {
    let ranges = |length: u32| {
        let step = TILE - 2 * MARGIN;
        let count = length.saturating_sub(2 * MARGIN).div_ceil(step).max(1);
        (0..count).map(move |index| {
            let tile = (index * step).min(length.saturating_sub(TILE));
            let start = if index == 0 { 0 } else { index * step + MARGIN };
            let end = if index + 1 == count { length } else { (index + 1) * step + MARGIN };
            (tile, TILE.min(length), start, end - start)
        })
    };
    ranges(height).flat_map(move |(top, rows, y, core_height)| {
        ranges(width).map(move |(left, columns, x, core_width)| {
            let window = Window { x: left, y: top, width: columns, height: rows };
            (window, Window { x, y, width: core_width, height: core_height })
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cores_partition_the_image_and_have_margins_inside_of_it() {
        for size in [(128, 128), (129, 40), (512, 512), (160, 300), (224, 225), (1000, 130)] {
            let mut covered = vec![0; Window::whole(size).len()];
            for (window, core) in cores(size) {
                core.indices(size.0).for_each(|index| covered[index] += 1);
                assert!(window.x + window.width <= size.0 && window.y + window.height <= size.1);
                let axes = [
                    (window.x, window.width, core.x, core.width, size.0),
                    (window.y, window.height, core.y, core.height, size.1),
                ];
                for (start, length, inner, inner_length, all) in axes {
                    assert!(start == 0 || inner >= start + MARGIN, "{size:?} {window:?} {core:?}");
                    let (end, inner_end) = (start + length, inner + inner_length);
                    assert!(
                        end == all || inner_end + MARGIN <= end,
                        "{size:?} {window:?} {core:?}"
                    );
                }
            }
            assert!(covered.iter().all(|count| *count == 1), "{size:?}");
        }
    }

    #[test]
    fn sums_over_sampled_tiles_are_unbiased() {
        let size = (640, 400);
        let noise = |index: usize| (1.0 + (index % 640) as f64 / 64.0).powi(2);
        let squared: Vec<f64> = (0..Window::whole(size).len()).map(noise).collect();
        // Correlated with the noise, but not proportional to it.
        let error = |index: usize| 3.0 + squared[index].sqrt() + (index / 640) as f64 / 100.0;
        let expected: f64 = (0..squared.len()).map(error).sum();
        let (runs, mut estimates) = (400, Vec::new());
        for seed in 0..runs {
            let tiles = sample_tiles(size, &squared, 6, seed);
            assert!((4..=7).contains(&tiles.len()));
            let sum = |tile: &SampledTile| {
                tile.factor * tile.core.indices(size.0).map(error).sum::<f64>()
            };
            estimates.push(tiles.iter().map(sum).sum::<f64>() / expected);
        }
        let mean = estimates.iter().sum::<f64>() / runs as f64;
        let spread = estimates.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / runs as f64;
        let standard_error = (spread / runs as f64).sqrt();
        assert!((mean - 1.0).abs() < 4.0 * standard_error, "{mean} +- {standard_error}");
        assert!(spread.sqrt() < 0.3, "{spread}");
    }

    #[test]
    fn sample_of_a_black_image_is_uniform() {
        let tiles = sample_tiles((512, 512), &vec![0.0; 512 * 512], 5, 1);
        assert_eq!(tiles.len(), 5);
    }
}
