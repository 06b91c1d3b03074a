//! The kernel by true area: the flux of photons merged at a point is divided by the area of the surface
//! within the sphere that could have sent one there, instead of that of a disc.
//!
//! The area around a point `y` counts triangles in the sphere of radius `r`:
//!
//! 1. those whose material merges and whose normal, packed as photons pack theirs, has a dot product
//!    above one half with the normal at `y`, but not the other side of the component of `y`, such as
//!    the inside of a thin box ([`admission`]);
//! 2. of these the part in the sphere, a disc in the triangle's plane, in closed form ([`disc`]);
//! 3. only on sides that light reaches ([`lit_sides`]);
//! 4. only where nothing covers it: of layers the highest, and nothing inside of solids (`covered`);
//! 5. of cut-outs the mean opacity.
//!
//! All of this is computed once per cell: a part of a triangle about as large as the sphere (`patch`).
//! Most cells are flat, or have one straight edge. [`Areas`] keeps the cells that were computed.
//!
//! The work for one cell is bounded. Where more triangles are in reach of a cell than the bound allows
//! (`cell`), all its points take the area of a disc at every radius of a query, times the mean opacity
//! of their own surface. Whether they do depends on the geometry, the point and the largest radius
//! alone: not on time, threads or earlier queries. The kernel at a point is therefore the same in all
//! iterations, as the law of the noise requires. Photons are admitted there as everywhere else. On a
//! flat surface, for which the disc stands, that admits every photon of the disc.

pub mod admission;
mod boundary;
mod bvh;
mod cell;
mod components;
mod solids;
pub mod disc;
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
mod neighbors;

pub use index::{Areas, Memory, Query};
pub use lit_sides::{Marks, Sides};
pub use surfaces::{Hole, Surfaces};
