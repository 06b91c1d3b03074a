//! The pixels that a measured iteration measures.

use crate::film::cells::CellGrid;
use crate::film::statistic::{BatchGrain, CurrentIteration};

/// The pixels of an image that an iteration measures, or those that it does not.
///
/// Measuring a pixel lists all pairs of its light and camera paths, which takes several times as
/// long as their sum. Large images keep coefficients of cells, so that one pixel of each cell
/// suffices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelFilter {
    /// All pixels.
    All,
    /// One pixel of each cell.
    Measured(MeasuredPixels),
    /// All pixels of each cell but that one.
    Unmeasured(MeasuredPixels),
}

/// One pixel of each square of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeasuredPixels {
    /// Pixels along a side of a square.
    side: u32,
    /// Number of the pixel in the first square.
    turn: u32,
}

impl MeasuredPixels {
    /// The measured pixels of an iteration; `None` if all are. Each pixel of a cell has its turn.
    pub fn new(grid: CellGrid, grain: BatchGrain, iteration: CurrentIteration) -> Option<Self> {
        let side = grid.side();
        if side == 1 || grain == BatchGrain::Pixel || !iteration.is_measured {
            return None;
        }
        // Odd multiples visit all of a power of two, also if only every second or eighth iteration
        // is measured.
        let turn = iteration.number ^ iteration.number >> 3;
        Some(Self { side, turn: (turn.wrapping_mul(5) % u64::from(side * side)) as u32 })
    }

    /// Whether a pixel is measured. Its place differs from square to square, as edges of objects
    /// may follow rows of pixels. At the right and lower border, squares are smaller.
    fn includes(self, (x, y): (u32, u32), (width, height): (u32, u32)) -> bool {
        let Self { side, turn } = self;
        let (column, row) = (x / side, y / side);
        let hash = (column.wrapping_mul(0x9e37_79b1) ^ row.wrapping_mul(0x85eb_ca77)) >> 16;
        let number = turn.wrapping_add(hash) % (side * side);
        let wanted = |at: u32, first: u32, size: u32| first + at.min(size - first - 1);
        x == wanted(number % side, column * side, width)
            && y == wanted(number / side, row * side, height)
    }
}

impl PixelFilter {
    /// Whether a pixel of an image of this size passes.
    #[inline]
    pub fn includes(self, position: (u32, u32), size: (u32, u32)) -> bool {
        match self {
            Self::All => true,
            Self::Measured(pixels) => pixels.includes(position, size),
            Self::Unmeasured(pixels) => !pixels.includes(position, size),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_pixel_of_each_cell_is_measured_and_each_has_its_turn() {
        let size = (1043, 1021);
        let grid = CellGrid::of(size);
        let side = grid.side();
        assert_eq!(side, 2);
        for every in [1u64, 2, 8] {
            for cell in [0, 1, 521, 1044, grid.len() - 1] {
                let first = grid.first_pixel(cell) as u32;
                let (x, y) = (first % size.0, first / size.0);
                let square: Vec<(u32, u32)> = (y..(y + side).min(size.1))
                    .flat_map(|y| (x..(x + side).min(size.0)).map(move |x| (x, y)))
                    .collect();
                let mut visits = vec![0; square.len()];
                for number in (0..64).map(|number| number * every) {
                    let iteration = CurrentIteration { number, is_measured: true };
                    let pixels = MeasuredPixels::new(grid, BatchGrain::Tile, iteration).unwrap();
                    let filter = PixelFilter::Measured(pixels);
                    let is_measured = |at: &(u32, u32)| filter.includes(*at, size);
                    let measured: Vec<usize> =
                        (0..square.len()).filter(|&own| is_measured(&square[own])).collect();
                    assert_eq!(measured.len(), 1);
                    visits[measured[0]] += 1;
                }
                let each = 64 / square.len();
                assert!(visits.iter().all(|&count| count == each), "{every}: {visits:?}");
            }
        }
    }
}
