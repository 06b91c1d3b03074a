//! The kernel by true area: photons merged at a point are divided by the area of the surface within
//! the sphere that could have sent one there, instead of that of a disc.
//!
//! What counts, of all triangles in the sphere of radius `r` around a point `y`:
//!
//! 1. those whose material merges and whose normal, packed as photons pack theirs, has a dot product
//!    above one half with the normal at `y` ([`admission`]);
//! 2. of these the part in the sphere, a disc in the triangle's plane, in closed form ([`disc`]);
//! 3. only on sides that light reaches ([`sides`]);
//! 4. only where nothing covers it: of layers the highest, and nothing inside of solids (`covered`);
//! 5. of cut-outs the mean opacity.
//!
//! All of this is worked out once per patch of a triangle about as large as the sphere (`patch`):
//! most are flat, or have one straight edge. [`Areas`] keeps what it finds.

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
