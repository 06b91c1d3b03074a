//! Learns densities over directions from the contributions of paths.

use super::DirectionGuide;
use super::cell::{BINS, Cell};
use super::grid::{Grid, SIDES};
use super::moments::{ALL, Moments, halves, solid_angles};
use glam::{UVec3, Vec3};
use rayon::prelude::*;

/// A direction in which a path left a diffuse vertex.
#[derive(Clone, Copy, Debug)]
pub struct DirectionSample {
    /// The vertex.
    pub position: Vec3,
    /// Unit normal of the triangle there.
    pub normal: Vec3,
    /// Unit direction.
    pub wi: Vec3,
    /// Density of the cosine, 1/sr.
    pub cosine_pdf_w: f32,
    /// Density of the mixture that the direction was sampled from, 1/sr.
    pub pdf_w: f32,
    /// Number of the path. The halves of the paths judge each other.
    pub path: u32,
    /// Contribution of the path after the vertex, relative to the luminance of its part of the
    /// image.
    pub contribution: f32,
}

/// Samples of a cell: with twice as many, it splits.
const CELL_SAMPLES: usize = 1000;

/// Maximum number of cells for each side that surfaces face: indices have 16 bits.
const MAX_CELLS: usize = 10_000;

/// Shares of the cosine in the mixture that a cell chooses from.
const SHARES: [f32; 4] = [1.0, 0.75, 0.5, 0.3];

/// Samples for which the claim counts that a guide gains nothing.
const SHARE_PRIOR: f32 = 8.0;

/// Second moment with a guide over that without one, above which a cell does without: its look-ups
/// take time, too.
const WORTHWHILE: f32 = 0.98;

/// A sample's voxel and number.
type Placed = ([u32; 3], u32);

/// The cells of one side that surfaces face.
struct SideBuilder<'a> {
    samples: &'a [DirectionSample],
    solid_angles: &'a [f32; BINS],
    cells: Vec<Cell>,
    /// Boxes of voxels, each with the number of its cell in `cells`, from 1 on; 0 for none.
    boxes: Vec<([UVec3; 2], usize)>,
}

impl DirectionGuide {
    /// Learns from the directions of paths. Those whose contribution is not finite are left out.
    pub fn learn(samples: &[DirectionSample]) -> Self {
        let positions: Vec<Vec3> = samples.iter().map(|sample| sample.position).collect();
        let grid = Grid::around(&positions);
        let mut by_side: [Vec<Placed>; SIDES as usize] = Default::default();
        for (sample, number) in samples.iter().zip(0..) {
            if sample.contribution.is_finite() {
                let side = Grid::side(sample.normal) as usize;
                by_side[side].push((grid.voxel(sample.position), number));
            }
        }
        let solid_angles = &solid_angles();
        let built: Vec<SideBuilder> = by_side
            .into_par_iter()
            .map(|mut own| {
                let (cells, boxes) = (Vec::new(), Vec::new());
                let mut builder = SideBuilder { samples, solid_angles, cells, boxes };
                builder.build(&mut own, [UVec3::ZERO, grid.count()], &Moments::even());
                builder
            })
            .collect();
        let mut cells = vec![Cell::new(&[1.0; BINS], 1.0)];
        let mut index = vec![0; grid.len()];
        for (side, built) in (0..).zip(built) {
            for (voxels, number) in built.boxes {
                let cell = if number > 0 { cells.len() + number - 1 } else { 0 };
                grid.fill(&mut index, voxels, side, cell as u16);
            }
            cells.extend(built.cells);
        }
        Self { grid, index, cells }
    }
}

impl SideBuilder<'_> {
    /// Builds the cells of a box of voxels with these samples. `around` has the moments of a box
    /// that contains it.
    fn build(&mut self, placed: &mut [Placed], [low, high]: [UVec3; 2], around: &Moments) {
        let moments = around.of(self.of(placed));
        if let Some((axis, at)) = self.split(placed) {
            placed.sort_unstable_by_key(|&(voxel, number)| (voxel[axis] >= at, number));
            let middle = placed.partition_point(|(voxel, _)| voxel[axis] < at);
            let (below, above) = placed.split_at_mut(middle);
            let (mut start, mut end) = (low, high);
            (start[axis], end[axis]) = (at, at);
            self.build(below, [low, end], &moments);
            self.build(above, [start, high], &moments);
            return;
        }
        let share = self.bsdf_share(placed, &moments);
        if share < 1.0 {
            self.cells.push(Cell::new(&moments.probs(ALL, self.solid_angles), share));
        }
        let number = if share < 1.0 { self.cells.len() } else { 0 };
        self.boxes.push(([low, high], number));
    }

    fn of<'a>(&'a self, placed: &'a [Placed]) -> impl Iterator<Item = &'a DirectionSample> {
        placed.iter().map(|&(_, number)| &self.samples[number as usize])
    }

    /// Axis and voxel that split the samples along their longest side, if there are enough of
    /// them: about in halves.
    fn split(&self, placed: &mut [Placed]) -> Option<(usize, u32)> {
        if placed.len() < 2 * CELL_SAMPLES || self.cells.len() >= MAX_CELLS {
            return None;
        }
        let (mut first, mut last) = (UVec3::MAX, UVec3::ZERO);
        for &(voxel, _) in placed.iter() {
            (first, last) = (first.min(voxel.into()), last.max(voxel.into()));
        }
        let extent = last - first;
        let axis = (0..3).max_by_key(|&axis| extent[axis]).filter(|&axis| extent[axis] > 0)?;
        let middle = placed.len() / 2;
        placed.select_nth_unstable_by_key(middle, |(voxel, _)| voxel[axis]);
        Some((axis, placed[middle].0[axis].max(first[axis] + 1)))
    }

    /// The share of the cosine with the least second moment. The guide of one half of the paths
    /// judges the other half. theory.md (44d)
    fn bsdf_share(&self, placed: &[Placed], moments: &Moments) -> f32 {
        let guides: [Cell; 2] =
            [1, 2].map(|half| Cell::new(&moments.probs(half, self.solid_angles), 0.5));
        let (mut sums, mut squares) = ([0.0; SHARES.len()], 0.0);
        for sample in self.of(placed) {
            let weighted = sample.contribution * sample.contribution * sample.pdf_w;
            let guide = guides[halves(sample.path)[1] - 1].pdf_w(sample.wi);
            for (sum, share) in sums.iter_mut().zip(SHARES) {
                *sum += weighted / (share * sample.cosine_pdf_w + (1.0 - share) * guide);
            }
            let alone = weighted / sample.cosine_pdf_w;
            squares += alone * alone;
        }
        if !(sums[0] > 0.0 && squares > 0.0) {
            return 1.0;
        }
        let effective = sums[0] * sums[0] / squares;
        let best = (0..SHARES.len()).min_by(|&a, &b| sums[a].total_cmp(&sums[b])).unwrap_or(0);
        let claimed = (effective * sums[best] / sums[0] + SHARE_PRIOR) / (effective + SHARE_PRIOR);
        if claimed < WORTHWHILE { SHARES[best] } else { 1.0 }
    }
}
