//! Cells: squares of pixels that share statistics in large images.
//!
//! Coefficients of the noise, the merge bias and the weights of errors vary slowly over the image.
//! Beyond [`MAX_CELLS`] pixels they are kept for squares of pixels instead of single pixels, which
//! saves memory and passes over the image. The image itself and its layers always have all pixels.

use super::tiled_buffer::TILE;
use std::ops::Range;

/// Maximum number of cells. Smaller images have one pixel in each cell.
pub const MAX_CELLS: usize = 1 << 19;

/// Grid of square cells over an image. The side of a cell is a power of two, so that cells do not
/// cross tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellGrid {
    image: (u32, u32),
    side: u32,
}

impl CellGrid {
    /// The grid of an image of this width and height, pixels: the finest with at most [`MAX_CELLS`]
    /// cells.
    #[inline]
    pub fn of(image: (u32, u32)) -> Self {
        let mut grid = Self::single_pixels(image);
        while grid.len() > MAX_CELLS && grid.side < TILE {
            grid.side *= 2;
        }
        grid
    }

    /// A cell for each pixel.
    #[inline]
    pub fn single_pixels(image: (u32, u32)) -> Self {
        Self { image, side: 1 }
    }

    /// Cells of this side, a power of two.
    #[inline]
    pub fn with_side(image: (u32, u32), side: u32) -> Self {
        debug_assert!(side.is_power_of_two());
        Self { image, side }
    }

    /// Pixels along each side of a cell, except at the right and lower border of the image.
    #[inline]
    pub fn side(self) -> u32 {
        self.side
    }

    /// Pixels of a cell that does not lie at the border.
    #[inline]
    pub fn pixels_per_cell(self) -> f64 {
        f64::from(self.side * self.side)
    }

    /// Whether each cell is a single pixel.
    #[inline]
    pub fn is_single_pixels(self) -> bool {
        self.side == 1
    }

    /// Number of cells across and down.
    #[inline]
    pub fn size(self) -> (u32, u32) {
        let (width, height) = self.image;
        (width.div_ceil(self.side), height.div_ceil(self.side))
    }

    /// Number of pixels of the image.
    #[inline]
    pub fn pixels(self) -> usize {
        let (width, height) = self.image;
        width as usize * height as usize
    }

    /// Number of cells.
    #[inline]
    pub fn len(self) -> usize {
        let (across, down) = self.size();
        across as usize * down as usize
    }

    /// Always false: an image has at least one pixel.
    #[inline]
    pub fn is_empty(self) -> bool {
        false
    }

    /// Rows of the image in a row of cells.
    #[inline]
    pub fn rows(self, row: u32) -> Range<u32> {
        let first = row * self.side;
        first..(first + self.side).min(self.image.1)
    }

    /// Index in row order of the first cell in the row of cells that contains a row of the image.
    #[inline]
    pub fn row_of(self, y: u32) -> usize {
        (y / self.side) as usize * self.size().0 as usize
    }

    /// Index in row order of the top left pixel of a cell, which is also given in row order.
    #[inline]
    pub fn first_pixel(self, cell: usize) -> usize {
        let (across, side) = (self.size().0 as usize, self.side as usize);
        cell / across * side * self.image.0 as usize + cell % across * side
    }

    /// Number of pixels of a cell, given in row order.
    #[inline]
    pub fn pixels_of(self, cell: usize) -> f64 {
        let (across, _) = self.size();
        let (column, row) = (cell as u32 % across, cell as u32 / across);
        let length = |at: u32, end: u32| self.side.min(end - at * self.side);
        f64::from(length(column, self.image.0) * length(row, self.image.1))
    }

    /// Copies the value of each cell to its pixels; both are in row order.
    pub fn expanded<T: Copy>(self, cells: &[T]) -> Vec<T> {
        if self.is_single_pixels() {
            return cells.to_vec();
        }
        let (width, height) = self.image;
        let across = self.size().0 as usize;
        let row = |y: u32| {
            let row = (y / self.side) as usize * across;
            (0..width).map(move |x| cells[row + (x / self.side) as usize])
        };
        (0..height).flat_map(row).collect()
    }

    /// Value of `cells` at the center of a pixel, linear between the centers of neighboring cells.
    /// `mix` is the sum of four values times their weights.
    pub fn interpolated<T: Copy>(
        self,
        cells: &[T],
        (x, y): (u32, u32),
        mix: impl Fn([(T, f32); 4]) -> T,
    ) -> T {
        let (across, down) = self.size();
        if self.is_single_pixels() {
            return cells[y as usize * across as usize + x as usize];
        }
        let along = |at: u32, count: u32| {
            let position =
                ((at as f32 + 0.5) / self.side as f32 - 0.5).clamp(0.0, (count - 1) as f32);
            let first = (position as u32).min(count - 1);
            (first, (first + 1).min(count - 1), position - first as f32)
        };
        let ((left, right, u), (top, bottom, v)) = (along(x, across), along(y, down));
        let at = |column: u32, row: u32| cells[row as usize * across as usize + column as usize];
        mix([
            (at(left, top), (1.0 - u) * (1.0 - v)),
            (at(right, top), u * (1.0 - v)),
            (at(left, bottom), (1.0 - u) * v),
            (at(right, bottom), u * v),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_images_of_more_than_half_a_million_pixels_share_cells() {
        for (size, side) in [
            ((1, 1), 1),
            ((800, 600), 1),
            ((1024, 512), 1),
            ((1024, 513), 2),
            ((1280, 720), 2),
            ((1920, 1080), 2),
            ((3840, 2160), 4),
            ((7680, 4320), 8),
            ((32_000, 32_000), 16),
        ] {
            assert_eq!(CellGrid::of(size).side(), side, "{size:?}");
        }
    }

    #[test]
    fn cells_cover_each_pixel_once() {
        for (size, side) in [((7, 5), 2), ((16, 16), 4), ((33, 9), 8), ((3, 2), 1)] {
            let grid = CellGrid { image: size, side };
            let pixels: f64 = (0..grid.len()).map(|cell| grid.pixels_of(cell)).sum();
            assert_eq!(pixels, f64::from(size.0 * size.1), "{size:?}");
            let numbers: Vec<usize> = (0..grid.len()).collect();
            let expanded = grid.expanded(&numbers);
            for cell in 0..grid.len() {
                assert_eq!(expanded[grid.first_pixel(cell)], cell);
                let covered = expanded.iter().filter(|own| **own == cell).count();
                assert_eq!(covered as f64, grid.pixels_of(cell));
            }
        }
    }

    #[test]
    fn interpolation_keeps_linear_functions_inside() {
        let grid = CellGrid { image: (32, 16), side: 4 };
        let cells: Vec<f32> =
            (0..32).map(|cell| (cell % 8) as f32 + 10.0 * (cell / 8) as f32).collect();
        let at = |pixel| {
            grid.interpolated(&cells, pixel, |parts| {
                parts.map(|(value, weight)| value * weight).iter().sum()
            })
        };
        for (x, y) in [(2, 2), (9, 7), (29, 13)] {
            let expected = (x as f32 + 0.5) / 4.0 - 0.5 + 10.0 * ((y as f32 + 0.5) / 4.0 - 0.5);
            assert!((at((x, y)) - expected).abs() < 1e-4, "{x} {y}");
        }
        assert_eq!((at((0, 0)), at((31, 15))), (0.0, 37.0));
    }
}
