//! The cells of the photon map, and their buckets.

use super::SLACK;
use crate::base::math::Bounds;
use crate::simd::{LANES, Mask, Vec3s};
use glam::Vec3A;

/// Cells relative to a corner outside of the photons' bounding box.
///
/// A cell is wider than a query's sphere along y and z, so that a query meets at most two rows of
/// cells per axis. The bucket of cell `(x, y, z)` is `x + y * stride_y + z * stride_z`, modulo the
/// number of buckets. The cells of a row are neighbors in the sorted array, and a query reads at
/// most four ranges of it. Cells along x are finer, which makes the ranges shorter and costs only
/// their places.
///
/// In an array every cell has its own bucket. The strides of hashed cells keep the four ranges of a
/// query from overlapping, so that no photon is met twice. Photons of other cells in the same
/// bucket fail the distance test.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhotonGrid {
    corner: Vec3A,
    inverse_cell: Vec3A,
    stride_y: u32,
    stride_z: u32,
    /// Number of buckets less one: a power of two less one, or all ones where the grid is an array.
    mask: u32,
    buckets: u32,
}

/// One row of cells for the query of each lane.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rows {
    /// The first bucket that the query needs.
    pub first: [u32; LANES],
    /// The last bucket. If it is below the first one, the row lies at both ends of the table.
    pub last: [u32; LANES],
    /// The query meets the row.
    pub met: Mask,
}

/// Width of a cell over the diameter of a query: room for the rounding of cell coordinates.
const CELL_MARGIN: f32 = 1.01;
/// Minimum width of a cell over the largest coordinate. It keeps cell coordinates exact enough for
/// the margin: their errors add up to 6 half units in the last place, 0.4 % of a cell.
const MIN_CELL: f32 = 1e-4;
/// Cells along x for one along y and z.
const FINE: f32 = 2.0;
/// Maximum number of cells or buckets.
const MAX_BUCKETS: usize = 1 << 30;
/// Buckets per photon of hashed grids.
const BUCKETS_PER_PHOTON: usize = 4;
/// Minimum number of buckets of a hashed grid: the four ranges of a query are short compared with
/// it.
const MIN_HASHED: usize = 256;

/// Minimum width of a cell for queries of this radius.
fn narrowest(bounds: Bounds, radius: f32) -> f32 {
    let largest = bounds.min.abs().max(bounds.max.abs()).max_element();
    (2.0 * radius * SLACK * CELL_MARGIN).max(largest * MIN_CELL)
}

/// Corner of the grid: queries reach up to a diameter past the photons on each side.
fn corner(bounds: Bounds, narrowest: f32) -> Vec3A {
    Vec3A::from(bounds.min) - narrowest
}

/// `2^23`: cells are fewer along each axis.
const TO_BITS: f32 = 8_388_608.0;

/// Number of a cell along one axis, the grid's corner being that of cell 0.
#[inline(always)] // part of a vector loop
fn cell_along(position: f32, corner: f32, inverse_cell: f32) -> u32 {
    // Adding 2^23 leaves the nearest whole number in the lowest bits.
    ((position - corner) * inverse_cell + TO_BITS).to_bits() & (TO_BITS as u32 - 1)
}

impl PhotonGrid {
    /// An array of at most `max_cells` cells, 64 or more, for photons within `bounds`, and the
    /// width of the cells over the [`narrowest`]. The cells are up to 5 % wider than the bound
    /// requires. `None` where bounds or radius are not finite, or too large to count in cells.
    pub fn array(bounds: Bounds, radius: f32, max_cells: usize) -> Option<(Self, f32)> {
        let narrowest = narrowest(bounds, radius);
        let corner = corner(bounds, narrowest);
        // One more for rounding, and two that queries may read.
        let extent = Vec3A::from(bounds.max) - corner + narrowest;
        let mut width = 1.0;
        while width < f32::MAX {
            let inverse_cell = Vec3A::new(FINE, 1.0, 1.0) / (width * narrowest);
            let size = (extent * inverse_cell).floor() + 3.0;
            let buckets = size.as_dvec3().element_product();
            let excess = buckets / max_cells.min(MAX_BUCKETS) as f64;
            if excess <= 1.0 {
                let stride_y = size.x as u32;
                let stride_z = stride_y * size.y as u32;
                let (mask, buckets) = (u32::MAX, buckets as u32);
                return Some((
                    Self { corner, inverse_cell, stride_y, stride_z, mask, buckets },
                    width,
                ));
            }
            width *= (excess.cbrt() as f32).max(1.05);
        }
        None
    }

    /// Hashed cells of the minimum width for a number of photons within `bounds`.
    pub fn hashed(bounds: Bounds, radius: f32, photons: usize) -> Self {
        let narrowest = narrowest(bounds, radius);
        let corner = corner(bounds, narrowest);
        let inverse_cell = Vec3A::new(FINE, 1.0, 1.0) / narrowest;
        let buckets =
            (BUCKETS_PER_PHOTON * photons).next_power_of_two().clamp(MIN_HASHED, MAX_BUCKETS);
        // Odd strides at fractions of the table after the plastic number's powers: rows of cells
        // spread evenly, and neighboring rows are at least 12 % of the table apart (tested).
        let stride = |fraction: f64| (buckets as f64 * fraction) as u32 | 1;
        let (stride_y, stride_z) = (stride(0.754_877_666), stride(0.569_840_291));
        let buckets = buckets as u32;
        Self { corner, inverse_cell, stride_y, stride_z, mask: buckets - 1, buckets }
    }

    /// Number of buckets.
    #[inline]
    pub fn buckets(&self) -> u32 {
        self.buckets
    }

    /// The cell around a position no farther from the photons than a diameter.
    #[inline]
    pub fn cell(&self, position: Vec3A) -> [u32; 3] {
        let Self { corner, inverse_cell, .. } = self;
        std::array::from_fn(|axis| cell_along(position[axis], corner[axis], inverse_cell[axis]))
    }

    /// The bucket of a cell.
    #[inline]
    pub fn bucket(&self, [x, y, z]: [u32; 3]) -> u32 {
        x.wrapping_add(self.row([y, z])) & self.mask
    }

    /// The rows of cells that queries at these positions meet. The queries reach `reach` to all
    /// sides.
    #[inline(always)] // vectorized
    pub fn rows(&self, positions: &Vec3s, reach: f32) -> [Rows; 4] {
        let Self { corner, inverse_cell, mask, .. } = *self;
        let Vec3s { x, y, z } = positions;
        let axis = |positions: &[f32; LANES], corner: f32, inverse_cell: f32| {
            let cell = |position| cell_along(position, corner, inverse_cell);
            (positions.map(|p| cell(p - reach)), positions.map(|p| cell(p + reach)))
        };
        let (x0, x1) = axis(x, corner.x, inverse_cell.x);
        let (y0, y1) = axis(y, corner.y, inverse_cell.y);
        let (z0, z1) = axis(z, corner.z, inverse_cell.z);
        let mut rows = [Rows::default(); 4];
        for lane in 0..LANES {
            let first = self.row([y0[lane], z0[lane]]);
            let (up, deep) = (first.wrapping_add(self.stride_y), first.wrapping_add(self.stride_z));
            let (y, z) = (y1[lane] > y0[lane], z1[lane] > z0[lane]);
            let both = up.wrapping_add(self.stride_z);
            let all = [(first, true), (up, y), (deep, z), (both, y & z)];
            for (rows, (row, met)) in rows.iter_mut().zip(all) {
                rows.first[lane] = x0[lane].wrapping_add(row) & mask;
                rows.last[lane] = x1[lane].wrapping_add(row) & mask;
                rows.met[lane] = met;
            }
        }
        rows
    }

    #[inline]
    fn row(&self, [y, z]: [u32; 2]) -> u32 {
        y.wrapping_mul(self.stride_y).wrapping_add(z.wrapping_mul(self.stride_z))
    }

    /// Tests whether cells share buckets.
    #[inline]
    pub fn is_hashed(&self) -> bool {
        self.mask != u32::MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn array_of_any_bounds_keeps_to_the_maximum_number_of_cells() {
        let corners = [1.0, 1e4, 1e30].map(Vec3::splat);
        for max in corners.into_iter().chain([Vec3::ZERO, Vec3::X, Vec3::new(1e5, 1.0, 0.0)]) {
            for radius in [1e-9, 1e-3, 1.0, 1e9] {
                for most in [64, 1 << 14, 1 << 20] {
                    let bounds = Bounds { min: Vec3::ZERO, max };
                    let (grid, width) = PhotonGrid::array(bounds, radius, most).expect("finite");
                    assert!(grid.buckets() as usize <= most, "{max} {radius} {most}: {grid:?}");
                    // Cells 5 % and the rounding of their number narrower would be too many.
                    let (narrower, _) =
                        PhotonGrid::array(bounds, radius / 1.2 / width, 1 << 40).unwrap();
                    assert!(
                        width == 1.0 || narrower.buckets() as usize > most,
                        "{max} {radius} {most}"
                    );
                }
            }
        }
        for max in [Vec3::splat(f32::INFINITY), Vec3::new(f32::NAN, 1.0, 1.0)] {
            let bounds = Bounds { min: Vec3::ZERO, max };
            assert!(PhotonGrid::array(bounds, 1.0, 1 << 14).is_none());
        }
    }

    #[test]
    fn four_ranges_of_a_query_never_overlap() {
        for bits in 8..=30 {
            let count = (1usize << bits) / BUCKETS_PER_PHOTON;
            let bounds = Bounds { min: Vec3::ZERO, max: Vec3::splat(1.0) };
            let grid = PhotonGrid::hashed(bounds, 1e-5, count);
            let PhotonGrid { stride_y, stride_z, mask, .. } = grid;
            let distance = |step: u32| (step & mask).min(step.wrapping_neg() & mask);
            let steps = [
                stride_y,
                stride_z,
                stride_y.wrapping_add(stride_z),
                stride_y.wrapping_sub(stride_z),
            ];
            for step in steps {
                // A range has one bucket more than cells in a diameter, and one for rounding.
                assert!(distance(step) as f32 >= FINE + 2.0, "{grid:?}");
                assert!(f64::from(distance(step)) > 0.12 * f64::from(mask), "{grid:?}");
            }
        }
    }
}
