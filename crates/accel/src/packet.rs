//! Rays and hits of several paths side by side, as backends trace them.

use super::{Hit, Ray};
use crate::lanes::{LANES, Vec3s};
use bytemuck::{Pod, Zeroable};
use std::ops::Range;

/// Sixteen rays, component by component; see [`Ray`].
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct RayPacket {
    /// Start points, scene units.
    pub origin: Vec3s,
    /// Directions; any finite, nonzero length.
    pub direction: Vec3s,
    /// Hits at or before these distances may be ignored.
    pub t_near: [f32; LANES],
    /// Hits at or beyond these distances may be ignored.
    pub t_far: [f32; LANES],
}

impl RayPacket {
    /// Rays with only their far end set, in units of the direction's length.
    #[inline]
    pub fn until(t_far: f32) -> Self {
        let (origin, direction) = <(Vec3s, Vec3s)>::default();
        Self { origin, direction, t_near: [0.0; LANES], t_far: [t_far; LANES] }
    }

    /// A packet of at most sixteen rays; the lanes after them repeat the first.
    ///
    /// # Panics
    /// If there are none.
    #[inline]
    pub fn of(rays: &[Ray]) -> Self {
        let mut packet = Self::until(f32::INFINITY);
        for lane in 0..LANES {
            packet.set(lane, rays.get(lane).unwrap_or(&rays[0]));
        }
        packet
    }

    /// One of the rays.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> Ray {
        Ray {
            origin: self.origin.get(lane),
            t_near: self.t_near[lane],
            direction: self.direction.get(lane),
            t_far: self.t_far[lane],
        }
    }

    /// Replaces one of the rays.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, ray: &Ray) {
        self.origin.set(lane, ray.origin);
        self.direction.set(lane, ray.direction);
        self.t_near[lane] = ray.t_near;
        self.t_far[lane] = ray.t_far;
    }
}

/// Sixteen hits, component by component; see [`Hit`].
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct HitPacket {
    /// Distances in units of the direction's length; infinite for a miss.
    pub t: [f32; LANES],
    /// Barycentric weights of the triangles' second vertices.
    pub u: [f32; LANES],
    /// Barycentric weights of the triangles' third vertices.
    pub v: [f32; LANES],
    /// Indices of the instances; `u32::MAX` for a miss.
    pub mesh: [u32; LANES],
    /// Indices of the triangles within their meshes.
    pub triangle: [u32; LANES],
}

impl HitPacket {
    /// One of the hits.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> Hit {
        Hit {
            t: self.t[lane],
            u: self.u[lane],
            v: self.v[lane],
            mesh: self.mesh[lane],
            triangle: self.triangle[lane],
        }
    }

    /// Replaces one of the hits.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, hit: &Hit) {
        self.t[lane] = hit.t;
        self.u[lane] = hit.u;
        self.v[lane] = hit.v;
        self.mesh[lane] = hit.mesh;
        self.triangle[lane] = hit.triangle;
    }
}

impl Default for HitPacket {
    /// Sixteen misses.
    #[inline]
    fn default() -> Self {
        let [t, u, v] = [Hit::MISS.t, Hit::MISS.u, Hit::MISS.v].map(|number| [number; LANES]);
        Self { t, u, v, mesh: [Hit::MISS.mesh; LANES], triangle: [Hit::MISS.triangle; LANES] }
    }
}

/// The lanes in use of each of `packets` packets that hold `count` rays.
///
/// # Panics
/// If `count` rays take another number of packets.
pub fn used(count: usize, packets: usize) -> impl Iterator<Item = Range<usize>> {
    assert_eq!(packets, count.div_ceil(LANES), "packets for {count} rays");
    (0..packets).map(move |packet| 0..(count - packet * LANES).min(LANES))
}
