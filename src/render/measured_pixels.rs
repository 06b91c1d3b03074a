//! The pixels that a measured iteration measures.

use crate::film::cells::CellGrid;
use crate::film::statistic::{BatchGrain, CurrentIteration};

/// The pixels of an image that an iteration measures, or those that it does not.
///
/// Measuring a pixel lists all pairs of its light and camera paths, which takes several times as long as their sum. Large
/// images keep coefficients of cells, so that one pixel of each cell suffices.
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
    /// Column and row in the square.
    at: (u32, u32),
}

impl MeasuredPixels {
    /// The measured pixels of an iteration; `None` if all are. Each pixel of a cell has its turn.
    pub fn new(grid: CellGrid, grain: BatchGrain, iteration: CurrentIteration) -> Option<Self> {
        let side = grid.side();
        if side == 1 || grain == BatchGrain::Pixel || !iteration.is_measured {
            return None;
        }
        // Odd multiples visit all of a power of two, also if only every second or eighth iteration is measured.
        let turn = iteration.number ^ iteration.number >> 3;
        let pixel = (turn.wrapping_mul(5) % u64::from(side * side)) as u32;
        Some(Self { side, at: (pixel % side, pixel / side) })
    }

    /// Whether a pixel is measured. At the right and lower border, squares are smaller.
    fn includes(self, (x, y): (u32, u32), (width, height): (u32, u32)) -> bool {
        let Self { side, at } = self;
        let wanted = |at: u32, position: u32, size: u32| {
            let first = position - position % side;
            position - first == at.min(size - first - 1)
        };
        wanted(at.0, x, width) && wanted(at.1, y, height)
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
            let mut visits = [0; 4];
            for number in (0..64).map(|number| number * every) {
                let iteration = CurrentIteration { number, is_measured: true };
                let pixels = MeasuredPixels::new(grid, BatchGrain::Tile, iteration).unwrap();
                visits[(pixels.at.1 * side + pixels.at.0) as usize] += 1;
                for cell in [0, 521, grid.len() - 1] {
                    let first = grid.first_pixel(cell) as u32;
                    let (x, y) = (first % size.0, first / size.0);
                    let square = (y..(y + side).min(size.1))
                        .flat_map(|y| (x..(x + side).min(size.0)).map(move |x| (x, y)));
                    let filter = PixelFilter::Measured(pixels);
                    assert_eq!(square.filter(|&at| filter.includes(at, size)).count(), 1);
                }
            }
            assert!(visits.iter().all(|&count| count == 16), "{every}: {visits:?}");
        }
    }
}
