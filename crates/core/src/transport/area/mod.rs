//! The kernel by true area. The flux of photons merged at a point is divided by the area of the
//! surface within the sphere that could have sent one there. (The kernel of the paper is a disc.)
//!
//! The area around a point `y` counts triangles in the sphere of radius `r`:
//!
//! 1. *Admitted* are materials that merge. The normal, packed as in photons, must have a dot
//!    product above one half with the normal at `y`. The other side of the component of `y` is not
//!    admitted, such as the inside of a thin box ([`admission`]).
//! 2. The part in the sphere is a disc in the triangle's plane, in closed form ([`disc`]).
//! 3. Only sides count that light reaches ([`lit_sides`]).
//! 4. Covered parts do not count: of layers only the highest does, and nothing inside of solids
//!    (`covered`).
//! 5. Cut-outs count by their mean opacity.
//!
//! This is computed once per cell: a part of a triangle about as large as the sphere (`patch`).
//! Most cells are flat, or have one straight edge. [`Areas`] keeps the cells that were computed.
//!
//! The work for one cell is bounded (`cell`). Where more triangles are in reach of a cell, its
//! points are merged within half the radii, or a quarter of them, and so on: `2^-level` of them.
//! All radii of a query shrink together, and [`PointAreas`] has the level of each point. Cells for
//! smaller radii are those of other [`Areas`]. At [`MAX_LEVEL`], the area is that of a disc times
//! the mean opacity of the surface. The level depends on the geometry, the point and the largest
//! radius alone, not on time, threads or earlier queries. Hence the kernel at a point is the same
//! in each iteration, as the law of the noise requires.

pub mod admission;
mod boundary;
mod box_tree;
mod cell;
mod components;
mod solids;
pub mod disc;
pub mod domain;
mod index;
mod edge_list;
mod cell_builder;
mod patch;
mod pilot;
mod polygon;
mod triangle_index;
mod scene;
pub mod lit_sides;
mod surfaces;
mod tags;
mod neighbors;

pub use domain::{Domain, MAX_LEVEL};
pub use index::{Areas, CellWork, Memory, PointAreas, Query};
pub use lit_sides::{Marks, Sides};
pub use surfaces::{Hole, Surfaces};
