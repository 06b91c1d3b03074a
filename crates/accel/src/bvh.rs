//! The pure-Rust backend: `obvhs`'s BVH with our own watertight triangle test.
//!
//! It needs no library, runs everywhere, and is the reference that Embree is checked against. It
//! stays simple: it copies a mesh for each of its instances.

use super::packet::used;
use super::{
    AccelInfo, Coherence, Geometry, Hit, HitPacket, Intersect, MeshError, Ray, RayPacket,
    TriangleMesh,
};
use crate::lanes::Mask;
use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::fast_stack;
use obvhs::faststack::FastStack;
use obvhs::{Boundable, BvhBuildParams};
use std::time::{Duration, Instant};

/// A mesh that could not become part of a BVH.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BvhError {
    /// A mesh breaks a rule that all backends share.
    #[error("mesh {mesh}: {problem}")]
    Mesh {
        /// Index of the mesh.
        mesh: u32,
        /// The rule that it breaks.
        #[source]
        problem: MeshError,
    },
    /// All meshes together have more triangles than this BVH can number.
    #[error("{count} triangles are more than 32-bit indices can name")]
    TooManyTriangles {
        /// Number of triangles.
        count: usize,
    },
}

/// An immutable BVH over copies of triangle meshes.
pub struct Bvh {
    tree: Bvh2,
    /// Maximum number of entries of a traversal's stack.
    depth: usize,
    /// In the order of the tree's leaves, so that a leaf's triangles are neighbors in memory.
    triangles: Vec<LeafTriangle>,
    build_time: Duration,
}

/// A triangle with its indices in a [`Hit`].
#[derive(Clone, Copy)]
struct LeafTriangle {
    vertices: [Vec3; 3],
    mesh: u32,
    triangle: u32,
}

impl Boundable for LeafTriangle {
    /// The bounds, grown by a few rounding errors: no box is flat, and a ray that runs inside the
    /// plane of a box's face, parallel to an axis, is inside the box.
    fn aabb(&self) -> Aabb {
        let [a, b, c] = self.vertices.map(Vec3A::from);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let margin = Vec3A::splat(low.abs().max(high.abs()).max_element() * 4.0 * f32::EPSILON);
        Aabb { min: low - margin, max: high + margin }
    }
}

impl Bvh {
    /// Builds the BVH of these meshes; their indices are those in the slice.
    ///
    /// # Errors
    /// If [`TriangleMesh::validate`] refuses a mesh, or all together are too many.
    pub fn build(meshes: &[TriangleMesh<'_>]) -> Result<Self, BvhError> {
        Self::new(&Geometry::of_meshes(meshes))
    }

    /// Builds the BVH of instances, whose indices the hits have.
    ///
    /// # Errors
    /// As [`build`](Self::build).
    pub fn new(geometry: &Geometry<'_>) -> Result<Self, BvhError> {
        let start = Instant::now();
        let count = geometry.instanced_triangles();
        if count >= u32::MAX as usize / 2 {
            return Err(BvhError::TooManyTriangles { count }); // nodes share the 32-bit indices
        }
        let mut triangles = Vec::with_capacity(count);
        for (mesh, instance) in (0..).zip(&geometry.instances) {
            let positions = &*geometry.positions(instance);
            let data = TriangleMesh { positions, ..geometry.mesh(instance) };
            data.validate().map_err(|problem| BvhError::Mesh { mesh, problem })?;
            triangles.extend((0..).zip(data.triangles).map(|(triangle, indices)| LeafTriangle {
                vertices: indices.map(|index| positions[index as usize]),
                mesh,
                triangle,
            }));
        }
        if triangles.is_empty() {
            let tree = Bvh2::default();
            return Ok(Self { tree, depth: 0, triangles, build_time: start.elapsed() });
        }
        let tree = build_bvh2(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
        let triangles = tree.primitive_indices.iter().map(|&i| triangles[i as usize]).collect();
        let depth = stack_depth(&tree.nodes);
        Ok(Self { tree, depth, triangles, build_time: start.elapsed() })
    }

    /// Calls `visit` with triangles near the ray, nearer boxes first, until it returns false.
    /// `visit` may lower the maximum distance.
    #[inline(always)]
    fn traverse(&self, ray: &PreparedRay, mut visit: impl FnMut(&LeafTriangle, &mut f32) -> bool) {
        let Some(root) = self.tree.nodes.first() else { return };
        let mut t_max = ray.t_far;
        if ray.enters(root, t_max) == f32::INFINITY {
            return;
        }
        let nodes = &self.tree.nodes;
        fast_stack!((u32, f32), (64, 256), self.depth, stack, {
            stack.push((0, 0.0));
            while let Some((index, entry)) = stack.pop() {
                if entry > t_max {
                    continue; // a nearer triangle was hit meanwhile
                }
                let node = &nodes[index as usize];
                let first = node.first_index as usize;
                if node.is_leaf() {
                    for triangle in &self.triangles[first..first + node.prim_count as usize] {
                        if !visit(triangle, &mut t_max) {
                            return;
                        }
                    }
                    continue;
                }
                let [left, right] = [first, first + 1]
                    .map(|child| (child as u32, ray.enters(&nodes[child], t_max)));
                let (near, far) = if left.1 <= right.1 { (left, right) } else { (right, left) };
                if far.1 < f32::INFINITY {
                    stack.push(far);
                }
                if near.1 < f32::INFINITY {
                    stack.push(near);
                }
            }
        });
    }
}

/// Maximum number of entries of a traversal's stack: a sibling per level, and the node itself.
fn stack_depth(nodes: &[Bvh2Node]) -> usize {
    let mut deepest = 0;
    let mut open = vec![(0, 2)];
    while let Some((index, depth)) = open.pop() {
        deepest = deepest.max(depth);
        let Some(node) = nodes.get(index).filter(|node| !node.is_leaf()) else { continue };
        let child = node.first_index as usize;
        open.extend([(child, depth + 1), (child + 1, depth + 1)]);
    }
    deepest
}

/// A ray with the terms that all its box and triangle tests share.
///
/// The triangle test is the watertight one of Woop, Benthin and Wald (2013), with their equations.
/// Space is sheared so that the ray runs along an axis. Neighbors that share an edge compute its
/// edge function from the same numbers, so they agree on which side a ray passes.
struct PreparedRay {
    origin: Vec3,
    /// Componentwise, of the scaled direction.
    inverse: Vec3,
    t_near: f32,
    t_far: f32,
    axes: [usize; 3],
    shear: Vec3,
    /// Scaled direction.
    direction: Vec3,
    /// Distances times this are in units of the caller's direction.
    scale: f32,
}

impl PreparedRay {
    fn new(ray: &Ray) -> Self {
        // Scale by a power of two (exact) to a length near one: box tests use reciprocals, and
        // those of very long or short directions leave the range of f32.
        let largest = ray.direction.abs().max_element();
        let exponent = (largest.to_bits() >> 23).clamp(1, 253);
        let scale = f32::from_bits((254 - exponent) << 23);
        let direction = ray.direction * scale;

        // A zero component gets a huge reciprocal, because an infinite one times zero would be NaN.
        // The ray then stays within a slab that contains its origin, for all distances.
        let reciprocal = |x: f32| if x.abs() < 1e-30 { 1e30_f32.copysign(x) } else { 1.0 / x };
        let inverse = Vec3::from_array(direction.to_array().map(reciprocal));
        let (t_near, t_far) = (ray.t_near / scale, ray.t_far / scale);

        let z = direction.abs().max_position();
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if direction[z] < 0.0 {
            (x, y) = (y, x); // keeps the winding
        }
        let shear = Vec3::new(direction[x], direction[y], 1.0) / direction[z];
        let origin = ray.origin;
        Self { origin, inverse, t_near, t_far, axes: [x, y, z], shear, direction, scale }
    }

    /// Distance at which the ray enters a node's box, at least `t_near`; infinite if it misses it.
    #[inline(always)]
    fn enters(&self, node: &Bvh2Node, t_max: f32) -> f32 {
        /// More than the relative error of a slab's two distances (Ize 2013): rounding never loses
        /// a box that the ray touches.
        const CONSERVATIVE: f32 = 1.0 + 4.0 * f32::EPSILON;
        let (origin, inverse) = (Vec3A::from(self.origin), Vec3A::from(self.inverse));
        let bounds = node.aabb();
        let t1 = (bounds.min - origin) * inverse;
        let t2 = (bounds.max - origin) * inverse;
        let entry = t1.min(t2).max_element().max(self.t_near);
        let exit = (t1.max(t2).min_element() * CONSERVATIVE).min(t_max);
        if entry <= exit { entry } else { f32::INFINITY }
    }

    /// Distance, in units of the scaled direction, and barycentric weights of the second and third
    /// vertex, if the ray passes through the triangle from either side within its interval.
    #[inline(always)]
    fn hit(&self, triangle: &LeafTriangle, t_max: f32) -> Option<(f32, f32, f32)> {
        let [kx, ky, kz] = self.axes;
        let [a, b, c] = triangle.vertices.map(|vertex| vertex - self.origin);
        let sheared = |p: Vec3| (p[kx] - self.shear.x * p[kz], p[ky] - self.shear.y * p[kz]);
        let ((ax, ay), (bx, by), (cx, cy)) = (sheared(a), sheared(b), sheared(c));

        let mut u = cx * by - cy * bx;
        let mut v = ax * cy - ay * cx;
        let mut w = bx * ay - by * ax;
        if u == 0.0 || v == 0.0 || w == 0.0 {
            // On an edge to within f32: repeat in f64, where products of f32 are exact.
            let cross = |x1: f32, y1: f32, x2: f32, y2: f32| {
                (f64::from(x1) * f64::from(y2) - f64::from(y1) * f64::from(x2)) as f32
            };
            u = cross(cx, cy, bx, by);
            v = cross(ax, ay, cx, cy);
            w = cross(bx, by, ax, ay);
        }
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let determinant = u + v + w;
        if determinant == 0.0 {
            return None; // edge-on, or without area
        }
        let [near, far] = [a[kz].min(b[kz]).min(c[kz]), a[kz].max(b[kz]).max(c[kz])];
        let [near, far] = [near * self.shear.z, far * self.shear.z];
        // By the plane: the part of the origin's distance along the normal has no rounding errors
        // of coordinates across it, so that rays may start very near to large triangles. Those that
        // run almost in the plane lose the distance, but not the range of the corners.
        let normal = (b - a).cross(c - a);
        let distance = match normal.dot(self.direction) {
            0.0 => self.shear.z * (u * a[kz] + v * b[kz] + w * c[kz]) / determinant,
            along => (normal.dot(a) / along).max(near.min(far)).min(near.max(far)),
        };
        // Written so that NaN, from coordinates near the limit, is no hit.
        let inside = distance > self.t_near && distance < t_max;
        inside.then(|| (distance, v / determinant, w / determinant))
    }
}

impl Intersect for Bvh {
    fn intersect(&self, rays: &[RayPacket], count: usize, hits: &mut [HitPacket], _: Coherence) {
        assert_eq!(rays.len(), hits.len(), "one packet of hits per packet of rays");
        for ((rays, hits), lanes) in rays.iter().zip(hits).zip(used(count, rays.len())) {
            for lane in lanes {
                hits.set(lane, &self.closest_hit(&rays.get(lane)));
            }
        }
    }

    fn occlude(&self, rays: &[RayPacket], count: usize, occluded: &mut [Mask], _: Coherence) {
        assert_eq!(rays.len(), occluded.len(), "one packet of answers per packet of rays");
        for ((rays, occluded), lanes) in rays.iter().zip(occluded).zip(used(count, rays.len())) {
            for lane in lanes {
                occluded[lane] = self.is_occluded(&rays.get(lane));
            }
        }
    }

    fn closest_hit(&self, ray: &Ray) -> Hit {
        let prepared = PreparedRay::new(ray);
        let mut closest = Hit::MISS;
        self.traverse(&prepared, |triangle, t_max| {
            if let Some((t, u, v)) = prepared.hit(triangle, *t_max) {
                *t_max = t;
                let (mesh, triangle) = (triangle.mesh, triangle.triangle);
                closest = Hit { t: t * prepared.scale, u, v, mesh, triangle };
            }
            true
        });
        closest
    }

    fn is_occluded(&self, ray: &Ray) -> bool {
        let prepared = PreparedRay::new(ray);
        let mut occluded = false;
        self.traverse(&prepared, |triangle, t_max| {
            occluded = prepared.hit(triangle, *t_max).is_some();
            !occluded
        });
        occluded
    }

    fn describe(&self) -> AccelInfo {
        AccelInfo {
            name: "pure-Rust BVH (obvhs)".into(),
            packet_size: 1,
            triangles: self.triangles.len(),
            bytes: self.tree.nodes.capacity() * size_of::<Bvh2Node>()
                + self.tree.primitive_indices.capacity() * size_of::<u32>()
                + self.triangles.capacity() * size_of::<LeafTriangle>(),
            build_time: self.build_time,
        }
    }
}
