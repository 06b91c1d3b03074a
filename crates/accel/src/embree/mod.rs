//! A safe layer over Intel Embree 4: triangle scenes and ray queries.
//!
//! It does not depend on the renderer. The order is [`Device`] -> [`SceneBuilder`] ->
//! [`CommittedScene`]. Only the first two can fail; queries return a plain value and may run from
//! any number of threads.
//!
//! ```
//! use bdpm_accel::embree::Device;
//! use bdpm_accel::{Coherence, Hit, Intersect, Ray, TriangleMesh};
//! use glam::Vec3;
//!
//! # fn main() -> Result<(), bdpm_accel::embree::EmbreeError> {
//! let device = Device::new()?;
//! let mut builder = device.scene_builder()?;
//! let floor = builder.add_mesh(TriangleMesh {
//!     positions: &[Vec3::ZERO, Vec3::X, Vec3::Y],
//!     triangles: &[[0, 1, 2]],
//! })?;
//! let scene = builder.commit()?;
//!
//! let down = |x, y| Ray::new(Vec3::new(x, y, 2.0), -Vec3::Z);
//! let hit = scene.closest_hit(&down(0.25, 0.5));
//! assert_eq!((hit.mesh, hit.triangle), (floor.index(), 0));
//! assert!((hit.t - 2.0).abs() < 1e-5);
//! assert!((hit.u - 0.25).abs() < 1e-5 && (hit.v - 0.5).abs() < 1e-5);
//!
//! let rays = [down(0.1, 0.1), down(0.9, 0.9)];
//! let mut hits = [Hit::MISS; 2];
//! scene.closest_hits(&rays, &mut hits, Coherence::Coherent);
//! assert!(!hits[0].is_miss() && hits[1].is_miss());
//! # Ok(())
//! # }
//! ```
//!
//! # Misuse does not compile
//!
//! A committed scene never changes; `commit` consumes the builder:
//! ```compile_fail,E0382
//! # use bdpm_accel::{embree::*, TriangleMesh};
//! # fn main() -> Result<(), EmbreeError> {
//! let mut builder = Device::new()?.scene_builder()?;
//! let scene = builder.commit()?;
//! builder.add_mesh(TriangleMesh { positions: &[], triangles: &[] })?;
//! # Ok(())
//! # }
//! ```
//! A committed scene has no such method either:
//! ```compile_fail,E0599
//! # use bdpm_accel::{embree::*, TriangleMesh};
//! # fn misuse(mut scene: CommittedScene) -> Result<(), EmbreeError> {
//! scene.add_mesh(TriangleMesh { positions: &[], triangles: &[] })?;
//! # Ok(())
//! # }
//! ```
//! A scene that is not committed has no queries, and a committed scene cannot be an instance in
//! another, so there is one level of instances:
//! ```compile_fail,E0599
//! # use bdpm_accel::{embree::*, Intersect, Ray};
//! # fn misuse(builder: SceneBuilder, ray: Ray) {
//! builder.closest_hit(&ray);
//! # }
//! ```
//! ```compile_fail,E0308
//! # use bdpm_accel::embree::*;
//! # fn misuse(builder: &mut SceneBuilder, other: CommittedScene) {
//! builder.place(other, Default::default());
//! # }
//! ```
//! A builder may move to another thread, but two threads cannot share it:
//! ```compile_fail,E0277
//! # use bdpm_accel::embree::*;
//! # fn misuse(builder: SceneBuilder) {
//! let shared = &builder;
//! std::thread::scope(|threads| {
//!     threads.spawn(|| println!("{shared:?}"));
//! });
//! # }
//! ```
//! A scene or an id cannot be forged:
//! ```compile_fail,E0423
//! # use bdpm_accel::embree::*;
//! let id = GeomId(7);
//! ```
//! ```compile_fail,E0423
//! # use bdpm_accel::embree::*;
//! let id = SharedId(7);
//! ```
//! ```compile_fail,E0451
//! # use bdpm_accel::embree::*;
//! # fn misuse(real: CommittedScene) {
//! let CommittedScene { handle, .. } = real;
//! # }
//! ```

// Calls into a C library.
#![allow(unsafe_code)]

mod config;
mod device;
mod geometry;
mod guard;
mod instance;
mod packets;
mod scene;
mod single;

pub use config::{DeviceConfig, Isa};
pub use device::Device;
pub use instance::SharedId;
pub use scene::{CommittedScene, GeomId, SceneBuilder};

use super::MeshError;

/// An error of the Embree layer. Queries never fail.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EmbreeError {
    /// A mesh breaks a rule that memory safety or agreement between backends rests on.
    #[error("mesh {mesh}: {problem}")]
    Mesh {
        /// Index of the mesh, in the order in which meshes were added.
        mesh: u32,
        /// The rule that it breaks.
        #[source]
        problem: MeshError,
    },
    /// There are more meshes and instances of shared ones than 32 bits can number.
    #[error("a scene cannot number more than {} meshes", u32::MAX)]
    TooManyMeshes,
    /// The library is not installed where it is looked for, or cannot be loaded.
    #[error(
        "Embree 4 cannot be loaded: {problem}; install it, or set EMBREE_DIR to the folder whose lib folder has it"
    )]
    Load {
        /// The report of the system.
        problem: String,
    },
    /// The library that was loaded does not fit the header that this program was built with.
    #[error(
        "the Embree library is version {library}, but this program was built with the header of \
         {header}; it needs the same major version, not older"
    )]
    Version {
        /// Version of the library.
        library: String,
        /// Version of the header.
        header: String,
    },
    /// The loaded library has the right version, but other structs than the header of the build.
    #[error(
        "the Embree library, version {library}, writes hits elsewhere than the header says that this \
         program was built with; build it again with EMBREE_DIR set to the folder of both"
    )]
    Layout {
        /// Version of the library.
        library: String,
    },
    /// The library that was loaded was built without what this layer needs.
    #[error("the Embree library was built {0}; use another build of it")]
    Feature(&'static str),
    /// Embree reported an error.
    #[error("Embree failed to {doing}: {code} ({message})")]
    Library {
        /// The operation that failed.
        doing: &'static str,
        /// The error code's name.
        code: &'static str,
        /// Embree's own message, if any.
        message: String,
    },
}
