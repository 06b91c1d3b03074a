//! Guide of the directions in which camera paths leave diffuse vertices: cells of space, each with
//! a density over directions that paths beside the image learned. theory.md, section 11a.

mod cell;
mod grid;
mod learn;
mod moments;

use crate::base::math::cosine_hemisphere;
use crate::simd::{LANES, Mask, Vec3s};
use cell::Cell;
use grid::Grid;
pub use learn::DirectionSample;
use std::f32::consts::FRAC_1_PI;

/// Minimum cosine to which a direction of the mixture is divided: rounding may leave none.
const MIN_COSINE: f32 = 1e-9;

/// Densities over directions, by cells of space and sides that surfaces face.
#[derive(Clone, Debug)]
pub struct DirectionGuide {
    grid: Grid,
    /// Index of the cell of each place of the grid. The first cell guides nothing.
    index: Vec<u16>,
    cells: Vec<Cell>,
}

/// Vertices of sixteen paths at diffuse surfaces.
#[derive(Clone, Copy, Debug)]
pub struct GuidedVertices<'a> {
    /// Paths that have a vertex.
    pub active: &'a Mask,
    /// Positions.
    pub position: &'a Vec3s,
    /// Unit normals of the triangles.
    pub normal: &'a Vec3s,
    /// Unit normals by which the surfaces scatter.
    pub shading_normal: &'a Vec3s,
}

/// Directions of sixteen paths.
#[derive(Clone, Copy, Debug, Default)]
pub struct GuidedDirections {
    /// Unit directions. Those of a guide may be below the surface.
    pub wi: Vec3s,
    /// Indices of the cells that the paths left from.
    cell: [u32; LANES],
}

impl DirectionGuide {
    /// Samples a direction of each path from the mixture of the cosine and the guide, by two
    /// uniform numbers. theory.md (44a)
    #[inline(always)] // part of the loops over vertices, as the function below
    pub fn sample(&self, at: &GuidedVertices, [u, v]: [&[f32; LANES]; 2]) -> GuidedDirections {
        let mut own = GuidedDirections::default();
        let mut place = [0; LANES];
        for (lane, place) in place.iter_mut().enumerate() {
            *place = self.grid.place(at.position.get(lane), at.normal.get(lane));
        }
        let (mut guided, mut rescaled) = (Mask::default(), [0.0; LANES]);
        for lane in 0..LANES {
            let cell = if at.active[lane] { self.index[place[lane] as usize] } else { 0 };
            own.cell[lane] = u32::from(cell);
            let share = self.cells[cell as usize].bsdf_share();
            guided[lane] = u[lane] >= share;
            let (start, length) = if guided[lane] { (share, 1.0 - share) } else { (0.0, share) };
            rescaled[lane] = ((u[lane] - start) / length).min(1.0 - 0.5 * f32::EPSILON);
        }
        for lane in 0..LANES {
            let numbers = [rescaled[lane], v[lane]];
            own.wi.set(lane, cosine_hemisphere(at.shading_normal.get(lane), numbers));
        }
        for lane in 0..LANES {
            if guided[lane] {
                let cell = &self.cells[own.cell[lane] as usize];
                own.wi.set(lane, cell.sample([rescaled[lane], v[lane]]));
            }
        }
        own
    }

    /// Density of the mixture over that of the cosine, at directions `wi` of the paths that were
    /// sampled; meaningless below the surface. theory.md (44a)
    #[inline(always)]
    pub fn mixtures(
        &self,
        at: &GuidedVertices,
        sampled: &GuidedDirections,
        wi: &Vec3s,
    ) -> [f32; LANES] {
        let (mut share, mut guide) = ([1.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let cell = &self.cells[sampled.cell[lane] as usize];
            if cell.bsdf_share() < 1.0 {
                share[lane] = cell.bsdf_share();
                guide[lane] = cell.pdf_w(wi.get(lane));
            }
        }
        let mut mixtures = [1.0; LANES];
        for (lane, mixture) in mixtures.iter_mut().enumerate() {
            let cos = at.shading_normal.get(lane).dot(wi.get(lane)).max(MIN_COSINE);
            *mixture = share[lane] + (1.0 - share[lane]) * guide[lane] / (cos * FRAC_1_PI);
        }
        mixtures
    }
}
