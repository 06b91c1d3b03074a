//! Ray-scene intersection behind one small trait, batched from the ground up.
//!
//! Two backends implement [`Intersect`]: Intel Embree 4 (feature `embree`) and a pure-Rust BVH.
//! They are interchangeable at run time, so tests check each against the other. The crate knows
//! nothing of the renderer: programs that need only Embree, safely, use it alone. Scenes,
//! materials and what a ray is for belong above.

use crate::lanes::{LANES, Mask};
use glam::Vec3;

pub mod bvh;
#[cfg(feature = "embree")]
pub mod embree;
mod geometry;
pub mod lanes;
pub mod packet;
pub mod shared_library;

pub use geometry::{Geometry, Instance, instance_transform};
/// Vectors and transforms of the interface, in the version that this crate uses.
pub use glam;
pub use packet::{HitPacket, RayPacket};

/// A ray segment: `origin + t * direction` for `t` in `(t_near, t_far)`.
///
/// `direction` need not have unit length; distances are in units of its length.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Ray {
    /// Start point, scene units.
    pub origin: Vec3,
    /// Hits at or before this distance may be ignored; not negative.
    pub t_near: f32,
    /// Direction; any finite, nonzero length.
    pub direction: Vec3,
    /// Hits at or beyond this distance may be ignored.
    pub t_far: f32,
}

impl Ray {
    /// An unbounded ray from `origin`.
    #[inline]
    pub const fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, t_near: 0.0, direction, t_far: f32::INFINITY }
    }

    /// The open segment between two points, parametrized by `t` in (0, 1).
    #[inline]
    pub fn segment(from: Vec3, to: Vec3) -> Self {
        Self { origin: from, t_near: 0.0, direction: to - from, t_far: 1.0 }
    }
}

/// The closest intersection of a ray, or [`Hit::MISS`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Hit {
    /// Distance in units of the ray direction's length; infinite for a miss.
    pub t: f32,
    /// Barycentric weight of the triangle's second vertex.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex.
    pub v: f32,
    /// Index of the mesh, or of its instance if meshes are instanced, in the order in which they
    /// were added; `u32::MAX` for a miss.
    pub mesh: u32,
    /// Index of the triangle within its mesh.
    pub triangle: u32,
}

impl Hit {
    /// The result of a ray that hits nothing.
    pub const MISS: Self =
        Self { t: f32::INFINITY, u: 0.0, v: 0.0, mesh: u32::MAX, triangle: u32::MAX };

    /// Whether the ray hit nothing.
    #[inline]
    pub const fn is_miss(&self) -> bool {
        self.mesh == u32::MAX
    }
}

/// The next hit of `ray` that begins a relative `step` behind `hit`, and the step to take from
/// there. Rounding may return the same point again: the step then doubles.
pub fn next_after(accel: &dyn Intersect, ray: &Ray, hit: &Hit, step: f32) -> (Hit, f32) {
    let t_near = (hit.t * (1.0 + step)).max(f32::MIN_POSITIVE);
    let next = accel.closest_hit(&Ray { t_near, ..*ray });
    let again = (next.mesh, next.triangle) == (hit.mesh, hit.triangle);
    (next, if again { 2.0 * step } else { f32::EPSILON })
}

/// Coherence of neighboring rays of a batch: a hint that never changes the results of rays whose
/// numbers are finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coherence {
    /// Neighbors start close together and point the same way (camera rays, shadow rays to one
    /// point).
    Coherent,
    /// Neighbors are unrelated (diffuse bounces).
    Incoherent,
}

/// Closest-hit and occlusion queries on an immutable set of triangle meshes.
///
/// Queries never fail and may run from any number of threads at once. Triangles are hit from both
/// sides. The two edges of the open interval `(t_near, t_far)` are unspecified to within rounding.
pub trait Intersect: Send + Sync {
    /// Writes the closest hits of the first `count` rays of all packets, or [`Hit::MISS`], to the
    /// same lanes of `hits`. The unused lanes of the last packet stay unchanged or are overwritten.
    ///
    /// # Panics
    /// If `count` rays take another number of packets.
    fn intersect(
        &self,
        rays: &[RayPacket],
        count: usize,
        hits: &mut [HitPacket],
        coherence: Coherence,
    );

    /// Writes for each of the first `count` rays whether anything lies in its interval.
    ///
    /// # Panics
    /// As [`intersect`](Self::intersect).
    fn occlude(
        &self,
        rays: &[RayPacket],
        count: usize,
        occluded: &mut [Mask],
        coherence: Coherence,
    );

    /// The closest hit of a single ray, or [`Hit::MISS`].
    fn closest_hit(&self, ray: &Ray) -> Hit;

    /// Whether anything lies in the interval of a single ray.
    fn is_occluded(&self, ray: &Ray) -> bool;

    /// [`intersect`](Self::intersect) for rays one after the other.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn closest_hits(&self, rays: &[Ray], hits: &mut [Hit], coherence: Coherence) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        let mut found = [HitPacket::default()];
        for (rays, hits) in rays.chunks(LANES).zip(hits.chunks_mut(LANES)) {
            self.intersect(&[RayPacket::of(rays)], rays.len(), &mut found, coherence);
            for (lane, hit) in hits.iter_mut().enumerate() {
                *hit = found[0].get(lane);
            }
        }
    }

    /// [`occlude`](Self::occlude) for rays one after the other.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn occlusions(&self, rays: &[Ray], occluded: &mut [bool], coherence: Coherence) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        let mut answers = [Mask::default()];
        for (rays, occluded) in rays.chunks(LANES).zip(occluded.chunks_mut(LANES)) {
            self.occlude(&[RayPacket::of(rays)], rays.len(), &mut answers, coherence);
            occluded.copy_from_slice(&answers[0][..rays.len()]);
        }
    }

    /// Facts about the backend, for `bdpm info`.
    fn describe(&self) -> AccelInfo;
}

/// Facts about a built acceleration structure.
#[derive(Clone, Debug)]
pub struct AccelInfo {
    /// Name of the backend, with its version and instruction set where it has them.
    pub name: String,
    /// Rays per packet of the batched queries; 1 if they loop over single rays.
    pub packet_size: usize,
    /// Number of triangles in memory: those of an instanced mesh once, if the backend supports
    /// instances.
    pub triangles: usize,
    /// Bytes of the structure and its copy of the geometry.
    pub bytes: usize,
    /// Wall-clock time of the build.
    pub build_time: std::time::Duration,
}

/// A triangle mesh as a backend sees it; the backend copies it.
#[derive(Clone, Copy, Debug)]
pub struct TriangleMesh<'a> {
    /// Vertex positions, scene units.
    pub positions: &'a [Vec3],
    /// Three vertex indices per triangle.
    pub triangles: &'a [[u32; 3]],
}

impl TriangleMesh<'_> {
    /// Coordinates must be at most this in magnitude, for products of three of them, which
    /// triangle tests need, to stay within `f32`. (Embree itself leaves out triangles beyond about
    /// 1.8e18 without a word, and misses those near it.)
    pub const MAX_COORDINATE: f32 = 1e12;

    /// Checks what every backend relies on, so that all of them see the same set of triangles.
    ///
    /// Unused vertices are checked too. Triangles without area are fine: no ray hits them.
    ///
    /// # Errors
    /// The first problem found, with the index of its vertex or triangle.
    pub fn validate(&self) -> Result<(), MeshError> {
        if u32::try_from(self.positions.len()).is_err() {
            return Err(MeshError::TooManyVertices { count: self.positions.len() });
        }
        // The largest index means "nothing".
        if self.triangles.len() >= u32::MAX as usize {
            return Err(MeshError::TooManyTriangles { count: self.triangles.len() });
        }
        let is_bad = |position: &Vec3| {
            // `max_element` may pass over a NaN.
            position.is_nan() || position.abs().max_element() > Self::MAX_COORDINATE
        };
        if let Some(vertex) = self.positions.iter().position(is_bad) {
            let position = self.positions[vertex];
            return Err(if position.is_finite() {
                MeshError::TooLarge { vertex, position }
            } else {
                MeshError::NotFinite { vertex, position }
            });
        }
        let vertices = self.positions.len();
        for (triangle, indices) in self.triangles.iter().enumerate() {
            if let Some(&index) = indices.iter().find(|&&index| index as usize >= vertices) {
                return Err(MeshError::IndexOutOfRange { triangle, index, vertices });
            }
        }
        Ok(())
    }
}

/// Why a mesh was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} uses vertex {index}, but there are only {vertices} vertices")]
    IndexOutOfRange {
        /// Index of the triangle.
        triangle: usize,
        /// The vertex index that it holds.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} is not finite: {position}")]
    NotFinite {
        /// Index of the vertex.
        vertex: usize,
        /// Its position.
        position: Vec3,
    },
    /// A coordinate is beyond [`TriangleMesh::MAX_COORDINATE`].
    #[error(
        "vertex {vertex} is too far out: {position}; coordinates must be at most {:e}",
        TriangleMesh::MAX_COORDINATE
    )]
    TooLarge {
        /// Index of the vertex.
        vertex: usize,
        /// Its position.
        position: Vec3,
    },
    /// Rays cannot be transformed by an instance's transform and its inverse.
    #[error("the transform is not finite, cannot be undone or scales by more than 1e9")]
    Transform,
    /// An instance reaches beyond [`TriangleMesh::MAX_COORDINATE`].
    #[error(
        "an instance is too far out: {position}; coordinates must be at most {:e}",
        TriangleMesh::MAX_COORDINATE
    )]
    TooFar {
        /// A corner of its box.
        position: Vec3,
    },
    /// There are more vertices than 32 bits can number.
    #[error("{count} vertices are more than 32-bit indices can name")]
    TooManyVertices {
        /// Number of vertices.
        count: usize,
    },
    /// There are more triangles than 32 bits can number.
    #[error("{count} triangles are more than 32-bit indices can name")]
    TooManyTriangles {
        /// Number of triangles.
        count: usize,
    },
}
