//! A side of a triangle, divided into cells about as large as the sphere.

use super::cell::Cell;
use super::cell_builder::PatchFrame;
use glam::{DVec2, DVec3, Vec3};
use std::sync::OnceLock;

/// Sides of cells, in radii, unless a triangle is very large or small.
const CELL: f64 = 2.5;

/// Cells of a triangle along each axis at most; where that is too coarse, cells are split.
const MOST: f64 = 64.0;

/// Cells into which a cell is split along each axis.
pub const SPLIT: usize = 8;

/// A side of a triangle. Coordinates are in its plane, in radii.
#[derive(Debug)]
pub struct Patch {
    origin: Vec3,
    /// Vectors of coordinates: unit vectors over the radius.
    axes: [Vec3; 2],
    grid: PatchGrid,
}

/// The cells of a patch, or into which one of them is split.
#[derive(Debug)]
pub struct PatchGrid {
    low: [f32; 2],
    /// Cells per radius.
    density: [f32; 2],
    /// Numbers of the last cells.
    last: [f32; 2],
    columns: u32,
    /// Sides of a cell.
    size: [f32; 2],
    cells: Box<[OnceLock<Cell>]>,
}

/// The position of a point in a grid.
#[derive(Clone, Copy, Debug)]
pub struct CellPoint {
    /// Index of its cell.
    pub index: usize,
    /// Coordinates from the middle of the cell.
    pub at: [f32; 2],
}

impl Patch {
    /// The side of a triangle with these corners in the scene, where `up` points up.
    pub fn new(corners: [DVec3; 3], up: Vec3, radius: f64) -> Self {
        let frame = PatchFrame::new(corners, up, radius);
        let flat = corners.map(|corner| frame.local(corner).truncate());
        let (low, high) = (flat[0].min(flat[1]).min(flat[2]), flat[0].max(flat[1]).max(flat[2]));
        let counts = ((high - low) / CELL).ceil().clamp(DVec2::ONE, DVec2::splat(MOST));
        let axes = frame.axes.map(|axis| (axis / radius).as_vec3());
        Self {
            origin: frame.origin.as_vec3(),
            axes: [axes[0], axes[1]],
            grid: PatchGrid::new(low, high, counts.as_uvec2().to_array()),
        }
    }

    /// Coordinates of a point on it.
    #[inline(always)] // part of vectorized code
    pub fn local(&self, position: Vec3) -> [f32; 2] {
        let from = position - self.origin;
        self.axes.map(|axis| axis.dot(from))
    }

    /// The cells of the whole patch.
    #[inline(always)]
    pub fn grid(&self) -> &PatchGrid {
        &self.grid
    }

    /// Size in bytes, without the contents of its cells.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + size_of_val(&*self.grid.cells)
    }
}

impl PatchGrid {
    fn new(low: DVec2, high: DVec2, counts: [u32; 2]) -> Self {
        let divisions = DVec2::new(counts[0].into(), counts[1].into());
        let size = (high - low) / divisions;
        let cells = (0..counts[0] as usize * counts[1] as usize).map(|_| OnceLock::new());
        Self {
            low: low.as_vec2().to_array(),
            density: size.recip().as_vec2().to_array(),
            last: counts.map(|count| count as f32 - 1.0),
            columns: counts[0],
            size: size.as_vec2().to_array(),
            cells: cells.collect(),
        }
    }

    /// Splits one of its cells.
    pub fn split(&self, index: usize) -> Self {
        let (middle, half) = self.cell(index);
        Self::new(middle - half, middle + half, [SPLIT as u32; 2])
    }

    /// Finds the cell of a point.
    #[inline(always)] // part of vectorized code
    pub fn place(&self, local: [f32; 2]) -> CellPoint {
        // Adding 1.5 * 2^23 rounds to the nearest integer and leaves it in the lowest bits.
        const ROUND: f32 = 12_582_912.0;
        let mut at = [0.0; 2];
        let mut cell = [0; 2];
        for axis in 0..2 {
            let from = local[axis] - self.low[axis];
            // Numbers of cells from their middles.
            let rounded = (from * self.density[axis] - 0.5).min(self.last[axis]).max(0.0) + ROUND;
            cell[axis] = rounded.to_bits() & 0xffff;
            at[axis] = from - ((rounded - ROUND) + 0.5) * self.size[axis];
        }
        CellPoint { index: (cell[1] * self.columns + cell[0]) as usize, at }
    }

    /// Middle and half of the sides of a cell.
    pub fn cell(&self, index: usize) -> (DVec2, DVec2) {
        let index = index as u32;
        let cell = [index % self.columns, index / self.columns];
        let number = |axis: usize| f64::from(cell[axis]) + 0.5;
        let [low, size] = [self.low, self.size].map(|[x, y]| DVec2::new(x.into(), y.into()));
        (low + size * DVec2::new(number(0), number(1)), 0.5 * size)
    }

    /// The cell of this index, if it was computed.
    #[inline(always)]
    pub fn known(&self, index: usize) -> &OnceLock<Cell> {
        &self.cells[index]
    }

    /// Size in bytes, without the contents of its cells.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + size_of_val(&*self.cells)
    }
}
