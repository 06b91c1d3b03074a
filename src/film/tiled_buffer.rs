//! Storage of one value per pixel, tile by tile, so that each thread writes to memory of its own.

use super::statistic::PixelSample;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Width and height of a tile, pixels.
const TILE: u32 = 16;

/// Values that a thread handles at once. Sums over an image are added chunk by chunk, so that they do
/// not depend on the number of threads.
pub(crate) const CHUNK: usize = 4096;

/// A rectangle of pixels that one thread works on.
#[derive(Clone, Copy, Debug)]
pub struct Tile {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

impl Tile {
    /// Pixels of a tile that does not lie at the image's border.
    pub const PIXELS: f64 = (TILE * TILE) as f64;

    /// Number of pixels.
    pub fn len(&self) -> usize {
        (self.width * self.height) as usize
    }

    /// Always false: a tile holds at least one pixel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Column and row in the image of the tile's pixel `index`.
    #[inline]
    pub fn pixel(&self, index: u32) -> (u32, u32) {
        (self.x + index % self.width, self.y + index / self.width)
    }

    /// First column and first row after the tile.
    #[inline]
    pub fn end(&self) -> [u32; 2] {
        [self.x + self.width, self.y + self.height]
    }
}

/// Tiles of an image of `width` by `height` pixels, row by row.
pub fn tiles((image_width, image_height): (u32, u32)) -> impl Iterator<Item = Tile> {
    (0..image_height).step_by(TILE as usize).flat_map(move |y| {
        (0..image_width).step_by(TILE as usize).map(move |x| {
            let (width, height) = (TILE.min(image_width - x), TILE.min(image_height - y));
            Tile { x, y, width, height }
        })
    })
}

/// Indices in tile order of the pixels of a row of the image: one range for each tile.
fn row_ranges((width, height): (u32, u32), y: u32) -> impl Iterator<Item = Range<usize>> {
    let top = y - y % TILE;
    let rows = TILE.min(height - top);
    (0..width).step_by(TILE as usize).map(move |left| {
        let columns = TILE.min(width - left);
        let tile = top as usize * width as usize + left as usize * rows as usize;
        let start = tile + (y - top) as usize * columns as usize;
        start..start + columns as usize
    })
}

/// Sums over iterations of one pixel.
pub trait Accumulate {
    /// Adds one iteration.
    fn add_sample(&mut self, sample: &PixelSample);

    /// Adds the sums of other iterations.
    fn merge(&mut self, other: &Self);
}

/// One value for each pixel of an image. The values of a tile are stored one after the other, row by
/// row; the tiles follow each other row by row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TiledBuffer<T> {
    width: u32,
    height: u32,
    values: Vec<T>,
}

impl<T> TiledBuffer<T> {
    /// Default values for an image of `width` by `height` pixels.
    pub fn new((width, height): (u32, u32)) -> Self
    where
        T: Clone + Default,
    {
        Self { width, height, values: vec![T::default(); width as usize * height as usize] }
    }

    /// Width and height, pixels.
    pub fn resolution(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.values.len()
    }

    /// Whether there is one value for each pixel of an image of this resolution. The buffer may come
    /// from a file.
    pub fn fits(&self, resolution: (u32, u32)) -> bool {
        let (width, height) = resolution;
        self.resolution() == resolution && self.values.len() == width as usize * height as usize
    }

    /// All tiles.
    pub fn tiles(&self) -> impl Iterator<Item = Tile> + use<T> {
        tiles(self.resolution())
    }

    /// All tiles with the values of their pixels.
    pub fn tiles_mut(&mut self) -> Vec<(Tile, &mut [T])> {
        let tiles = self.tiles();
        let mut rest = &mut self.values[..];
        let split = |tile: Tile| {
            (tile, rest.split_off_mut(..tile.len()).expect("tiles cover the image once"))
        };
        tiles.map(split).collect()
    }

    /// All values, tile by tile.
    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// Calls `change` with each of `rows`, which are in row order, and the index of its pixel in
    /// [`Self::values`], on all threads.
    pub fn zip_pixels<R: Send>(&self, rows: &mut [R], change: impl Fn(&mut R, usize) + Sync) {
        let resolution = self.resolution();
        rows.par_chunks_mut(self.width as usize).enumerate().for_each(|(y, row)| {
            let indices = row_ranges(resolution, y as u32).flatten();
            row.iter_mut().zip(indices).for_each(|(value, at)| change(value, at));
        });
    }

    /// Maps the value of each pixel, on all threads; the result is in row order.
    pub fn map_rows<R: Send + Clone + Default>(&self, map: impl Fn(&T) -> R + Sync) -> Vec<R>
    where
        T: Sync,
    {
        let mut rows = vec![R::default(); self.values.len()];
        self.zip_pixels(&mut rows, |row, at| *row = map(&self.values[at]));
        rows
    }
}

impl<T: Accumulate> TiledBuffer<T> {
    /// Adds the sums of other iterations of the same image.
    pub fn merge(&mut self, other: &Self) {
        self.values.iter_mut().zip(&other.values).for_each(|(own, other)| own.merge(other));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::Rgb;

    const SIZES: [(u32, u32); 6] = [(1, 1), (16, 16), (17, 15), (100, 37), (15, 33), (1, 40)];

    /// Each pixel's value is its index in row order.
    fn numbered((width, height): (u32, u32)) -> TiledBuffer<u32> {
        let mut buffer = TiledBuffer::new((width, height));
        for (tile, values) in buffer.tiles_mut() {
            assert_eq!(tile.len(), values.len());
            for (index, value) in values.iter_mut().enumerate() {
                let (x, y) = tile.pixel(index as u32);
                assert!(x < tile.end()[0] && y < tile.end()[1]);
                *value = y * width + x;
            }
        }
        buffer
    }

    #[test]
    fn tiles_cover_each_pixel_once() {
        for (width, height) in SIZES {
            let mut values = numbered((width, height)).values;
            values.sort_unstable();
            assert!(values.into_iter().eq(0..width * height), "{width}x{height}");
        }
    }

    #[test]
    fn rows_are_in_image_order() {
        for (width, height) in SIZES {
            let buffer = numbered((width, height));
            let rows = buffer.map_rows(|value| *value);
            assert!(rows.into_iter().eq(0..width * height), "{width}x{height}");
        }
    }

    #[test]
    fn zipped_pixels_have_the_index_of_their_value() {
        let buffer = numbered((35, 18));
        let mut rows: Vec<u32> = (0..35 * 18).collect();
        buffer.zip_pixels(&mut rows, |row, at| {
            assert_eq!(buffer.values()[at], *row);
            *row = 0;
        });
        assert!(rows.iter().all(|row| *row == 0));
    }

    #[test]
    fn merge_adds_values_pixel_by_pixel() {
        let of = |scale: f32| TiledBuffer {
            width: 17,
            height: 3,
            values: (0..51).map(|i| Rgb::splat(scale * i as f32)).collect(),
        };
        let mut sum = of(1.0);
        sum.merge(&of(2.0));
        assert_eq!(sum, of(3.0));
    }

    #[test]
    fn buffer_fits_its_own_resolution_only() {
        let mut buffer = numbered((17, 15));
        assert!(buffer.fits((17, 15)) && !buffer.fits((15, 17)) && !buffer.fits((17, 16)));
        buffer.values.pop();
        assert!(!buffer.fits((17, 15)));
    }
}
