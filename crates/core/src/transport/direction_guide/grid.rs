//! Places of vertices: voxels of space, each six times for the sides that surfaces face.

use glam::{UVec3, Vec3};

/// Sides that surfaces face: an axis and its sign.
pub const SIDES: u32 = 6;

/// Voxels along the longest side.
const VOXELS: f32 = 48.0;

/// Share of the vertices on each side of the grid, along each axis, that it leaves out: they use
/// the voxels at its border. Few vertices may be far from all others.
const LEFT_OUT: f32 = 0.005;

/// A grid of voxels.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    /// Corner of the first voxel, scene units.
    low: Vec3,
    /// Reciprocal of the side of a voxel.
    inverse_side: f32,
    /// Voxels along each axis.
    count: UVec3,
}

impl Grid {
    /// A grid around most of these positions.
    pub fn around(positions: &[Vec3]) -> Self {
        let [mut low, mut high] = [Vec3::ZERO; 2];
        for axis in 0..3 {
            let mut all: Vec<f32> = positions.iter().map(|at| at[axis]).collect();
            all.sort_unstable_by(f32::total_cmp);
            let left_out = (LEFT_OUT * all.len() as f32) as usize;
            if let (Some(first), Some(last)) =
                (all.get(left_out), all.get((all.len() - left_out).saturating_sub(1)))
            {
                (low[axis], high[axis]) = (*first, *last);
            }
        }
        let side = ((high - low).max_element() / VOXELS).max(f32::MIN_POSITIVE);
        let count = ((high - low) / side).ceil().clamp(Vec3::ONE, Vec3::splat(VOXELS)).as_uvec3();
        Self { low, inverse_side: side.recip(), count }
    }

    /// Number of places.
    pub fn len(&self) -> usize {
        (self.count.element_product() * SIDES) as usize
    }

    /// Sets the places of a box of voxels for a side to an index.
    pub fn fill(&self, index: &mut [u16], [low, high]: [UVec3; 2], side: u32, cell: u16) {
        for z in low.z..high.z {
            for y in low.y..high.y {
                let row = self.at([low.x, y, z], side) as usize;
                index[row..row + (high.x - low.x) as usize].fill(cell);
            }
        }
    }

    /// Voxels along each axis.
    pub fn count(&self) -> UVec3 {
        self.count
    }

    /// Voxel of a position.
    #[inline(always)]
    pub fn voxel(&self, position: Vec3) -> [u32; 3] {
        let at = (position - self.low) * self.inverse_side;
        let of = |x: f32, count: u32| (x.clamp(0.0, 1024.0) as i32 as u32).min(count - 1);
        [of(at.x, self.count.x), of(at.y, self.count.y), of(at.z, self.count.z)]
    }

    /// The side that a surface of this normal faces.
    #[inline(always)]
    pub fn side(normal: Vec3) -> u32 {
        let along = normal.abs();
        let is_x = (along.x >= along.y) & (along.x >= along.z);
        let is_y = along.y >= along.z;
        let (axis, value) = if is_x {
            (0, normal.x)
        } else if is_y {
            (2, normal.y)
        } else {
            (4, normal.z)
        };
        axis + u32::from(value < 0.0)
    }

    /// Index of a voxel for a side.
    #[inline(always)]
    fn at(&self, [x, y, z]: [u32; 3], side: u32) -> u32 {
        ((side * self.count.z + z) * self.count.y + y) * self.count.x + x
    }

    /// Index of the place of a vertex.
    #[inline(always)]
    pub fn place(&self, position: Vec3, normal: Vec3) -> u32 {
        self.at(self.voxel(position), Self::side(normal))
    }
}
