//! Storage of one value per pixel, tile by tile, so that each thread writes to memory of its own.

use super::cells::CellGrid;
use super::statistic::PixelSample;
use bytemuck::Zeroable;
use bytemuck::allocation::zeroed_vec;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Width and height of a tile, pixels.
pub(super) const TILE: u32 = 16;

/// Values that a thread handles at once. Sums over an image are added chunk by chunk, so that they
/// do not depend on the number of threads.
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
    #[inline]
    pub fn len(&self) -> usize {
        (self.width * self.height) as usize
    }

    /// Always false: a tile holds at least one pixel.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Column and row in the image of the tile's pixel `index`.
    #[inline]
    pub fn pixel(&self, index: u32) -> (u32, u32) {
        (self.x + index % self.width, self.y + index / self.width)
    }

    /// Number of cells of `side` by `side` pixels.
    #[inline]
    pub fn cells(&self, side: u32) -> usize {
        (self.width.div_ceil(side) * self.height.div_ceil(side)) as usize
    }

    /// Index of the cell of `side` by `side` pixels that contains the tile's pixel `index`.
    #[inline]
    pub fn cell_of(&self, index: u32, side: u32) -> usize {
        let (column, row) = (index % self.width / side, index / self.width / side);
        (row * self.width.div_ceil(side) + column) as usize
    }

    /// First column and first row after the tile.
    #[inline]
    pub fn end(&self) -> [u32; 2] {
        [self.x + self.width, self.y + self.height]
    }
}

/// Tiles of an image of `width` by `height` pixels, row by row.
#[inline]
pub fn tiles(resolution: (u32, u32)) -> impl Iterator<Item = Tile> {
    tiles_of(resolution, TILE)
}

/// The same tiles, measured in cells.
#[inline]
pub fn tiles_of_cells(grid: CellGrid) -> impl Iterator<Item = Tile> {
    tiles_of(grid.size(), TILE / grid.side())
}

/// Tiles of `side` by `side` values.
#[inline]
fn tiles_of((all_width, all_height): (u32, u32), side: u32) -> impl Iterator<Item = Tile> {
    (0..all_height).step_by(side as usize).flat_map(move |y| {
        (0..all_width).step_by(side as usize).map(move |x| {
            let (width, height) = (side.min(all_width - x), side.min(all_height - y));
            Tile { x, y, width, height }
        })
    })
}

/// Indices in tile order of the values of a row: one range for each tile.
#[inline]
fn row_ranges(
    (width, height): (u32, u32),
    side: u32,
    y: u32,
) -> impl Iterator<Item = Range<usize>> {
    let top = y - y % side;
    let rows = side.min(height - top);
    (0..width).step_by(side as usize).map(move |left| {
        let columns = side.min(width - left);
        let tile = top as usize * width as usize + left as usize * rows as usize;
        let start = tile + (y - top) as usize * columns as usize;
        start..start + columns as usize
    })
}

/// Sums over iterations of one pixel or cell.
pub trait Accumulate {
    /// Whether the sums are kept for each [cell](CellGrid) instead of each pixel. Samples are then
    /// means over the pixels of a cell.
    const BY_CELL: bool = false;

    /// Adds one iteration.
    fn add_sample(&mut self, sample: &PixelSample);

    /// Adds the sums of other iterations.
    fn merge(&mut self, other: &Self);
}

/// One value for each pixel or cell of an image. The values of a tile are stored one after the
/// other, row by row; the tiles follow each other row by row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TiledBuffer<T> {
    width: u32,
    height: u32,
    /// Width and height of a tile, values.
    side: u32,
    values: Vec<T>,
}

impl<T> TiledBuffer<T> {
    /// Zeros for an image of this width and height, pixels. The system provides the memory when it
    /// is first written.
    pub fn new(resolution: (u32, u32)) -> Self
    where
        T: Zeroable,
    {
        Self::of_cells(CellGrid::single_pixels(resolution))
    }

    /// Zeros for the cells of an image.
    pub fn of_cells(grid: CellGrid) -> Self
    where
        T: Zeroable,
    {
        let (width, height) = grid.size();
        let values = zeroed_vec(width as usize * height as usize);
        Self { width, height, side: TILE / grid.side(), values }
    }

    /// Width and height, values.
    pub fn resolution(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.values.len()
    }

    /// Whether there is one value for each pixel of an image of this resolution. The buffer may
    /// come from a file.
    pub fn fits(&self, resolution: (u32, u32)) -> bool {
        self.fits_cells(CellGrid::single_pixels(resolution))
    }

    /// Whether there is one value for each cell. The buffer may come from a file.
    pub fn fits_cells(&self, grid: CellGrid) -> bool {
        self.resolution() == grid.size()
            && self.side == TILE / grid.side()
            && self.values.len() == grid.len()
    }

    /// All tiles.
    pub fn tiles(&self) -> impl Iterator<Item = Tile> + use<T> {
        tiles_of(self.resolution(), self.side)
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
    pub fn zip_pixels<R: Send>(&self, rows: &mut [R], change: impl Fn(&mut R, usize) + Sync)
    where
        T: Sync,
    {
        rows.par_chunks_mut(self.width as usize).enumerate().for_each(|(y, row)| {
            row.iter_mut().zip(self.row(y as u32)).for_each(|(value, at)| change(value, at));
        });
    }

    /// Indices in [`Self::values`] of a row of the image.
    pub fn row(&self, y: u32) -> impl Iterator<Item = usize> + use<T> {
        row_ranges(self.resolution(), self.side, y).flatten()
    }

    /// Calls `add` with the result for each cell of `grid` and the index in [`Self::values`] of
    /// each of its pixels, on all threads. The results are in row order and start from `zero`.
    ///
    /// # Panics
    /// If the buffer does not have a value for each pixel of the image.
    pub fn fold_cells<R: Send + Clone>(
        &self,
        grid: CellGrid,
        zero: R,
        add: impl Fn(&mut R, usize) + Sync,
    ) -> Vec<R>
    where
        T: Sync,
    {
        assert_eq!(grid.pixels(), self.values.len(), "there is a value for each pixel");
        let mut cells = vec![zero; grid.len()];
        let side = grid.side() as usize;
        cells.par_chunks_mut(grid.size().0 as usize).enumerate().for_each(|(row, cells)| {
            for y in grid.rows(row as u32) {
                self.row(y).enumerate().for_each(|(x, at)| add(&mut cells[x / side], at));
            }
        });
        cells
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
    use bdpm_base::math::Rgb;

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
            side: TILE,
            values: (0..51).map(|i| Rgb::splat(scale * i as f32)).collect(),
        };
        let mut sum = of(1.0);
        sum.merge(&of(2.0));
        assert_eq!(sum, of(3.0));
    }

    #[test]
    fn cells_of_a_tile_are_stored_together() {
        let grid = CellGrid::of((1283, 1021));
        let mut cells = TiledBuffer::<u32>::of_cells(grid);
        let mut pixels = TiledBuffer::<u32>::new((1283, 1021));
        let side = grid.side();
        assert!(side == 2 && cells.fits_cells(grid) && !cells.fits((1283, 1021)));
        for (number, ((tile, pixels), (_, cells))) in
            pixels.tiles_mut().into_iter().zip(cells.tiles_mut()).enumerate()
        {
            assert_eq!(tile.cells(side), cells.len());
            for index in 0..pixels.len() {
                pixels[index] = number as u32;
                cells[tile.cell_of(index as u32, side)] += 1;
            }
        }
        let counted = pixels.fold_cells(grid, 0, |count, _| *count += 1);
        assert_eq!(cells.map_rows(|count| *count), counted);
        let sums = pixels.fold_cells(grid, 0, |sum, at| *sum += u64::from(pixels.values()[at]));
        let all: u64 = pixels.values().iter().map(|number| u64::from(*number)).sum();
        assert_eq!(sums.iter().sum::<u64>(), all);
    }

    #[test]
    fn buffer_fits_its_own_resolution_only() {
        let mut buffer = numbered((17, 15));
        assert!(buffer.fits((17, 15)) && !buffer.fits((15, 17)) && !buffer.fits((17, 16)));
        buffer.values.pop();
        assert!(!buffer.fits((17, 15)));
    }
}
