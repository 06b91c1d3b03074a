//! Paths under way, of either kind: sixteen side by side, or one.

use super::path_queue::{Columns, Flight};
use crate::accel::{Hit, Ray};
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use crate::scene::diffuse::DiffuseVertices;
use crate::scene::{Scene, Surface};
use crate::simd::{LANES, Rngs, Vec3s};
use bytemuck::{Pod, Zeroable};

/// Paths whose weight fell below this share of what they started with play roulette: light paths with
/// [`Roulette::Weight`](crate::settings::Roulette::Weight), camera paths where they pass through.
pub(super) const WEIGHT_FLOOR: f32 = 1.0 / 16.0;

/// Sixteen paths under way.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Walks {
    /// Of the next rays.
    pub origin: Vec3s,
    /// Unit vectors.
    pub direction: Vec3s,
    pub rng: Rngs,
    /// Of light paths the flux, W; of camera paths the throughput.
    pub weight: Vec3s,
    /// Reciprocals of the largest channel of the weight at the start.
    pub inverse_start: [f32; LANES],
    /// Which path it is.
    pub path: [u32; LANES],
    /// Vertices so far.
    pub depth: [Depth; LANES],
}

impl Columns<16> for Walks {
    const T_FAR: f32 = f32::INFINITY;
}

/// How many vertices a path has: where it scattered diffusely, and where it passed through.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub(super) struct Depth(u32);

impl Depth {
    /// Bits for the diffuse ones; the others are above them.
    const DIFFUSE: u32 = 16;

    /// Vertices at which the path scattered diffusely. Paths end by roulette long before 65,535.
    #[inline(always)] // as the next: parts of vector loops
    pub fn diffuse(self) -> u32 {
        self.0 & ((1 << Self::DIFFUSE) - 1)
    }

    /// Vertices through which it passed.
    #[inline(always)]
    pub fn passed(self) -> u32 {
        self.0 >> Self::DIFFUSE
    }

    /// With one more diffuse vertex.
    #[inline(always)]
    #[must_use]
    pub fn scattered(self) -> Self {
        Self(self.0.wrapping_add(1))
    }

    /// With one more vertex passed through.
    #[must_use]
    pub fn passed_on(self) -> Self {
        Self(self.0.wrapping_add(1 << Self::DIFFUSE))
    }

    /// Whether there is none of either kind.
    #[inline(always)]
    pub fn is_start(self) -> bool {
        self.0 == 0
    }
}

/// One of [`Walks`], without its ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    pub rng: Rng,
    pub weight: Rgb,
    pub inverse_start: f32,
    pub path: u32,
    pub depth: Depth,
}

impl Walks {
    pub fn get(&self, lane: usize) -> (Ray, Walk) {
        let ray = Ray::new(self.origin.get(lane), self.direction.get(lane));
        let walk = Walk {
            rng: self.rng.get(lane),
            weight: self.weight.get(lane),
            inverse_start: self.inverse_start[lane],
            path: self.path[lane],
            depth: self.depth[lane],
        };
        (ray, walk)
    }

    pub fn set(&mut self, lane: usize, ray: &Ray, walk: &Walk) {
        self.origin.set(lane, ray.origin);
        self.direction.set(lane, ray.direction);
        self.rng.set(lane, walk.rng);
        self.weight.set(lane, walk.weight);
        self.inverse_start[lane] = walk.inverse_start;
        self.path[lane] = walk.path;
        self.depth[lane] = walk.depth;
    }
}

impl Flight<Walks, 16> {
    /// Adds one path.
    pub fn push_walk(&mut self, ray: &Ray, walk: &Walk) {
        let mut one = Walks::default();
        one.set(0, ray, walk);
        self.push(&one);
    }
}

/// Where a path hit what [`Scene::lambertian`] leaves out: a surface that is Lambertian here sets its
/// diffuse vertex, at any other the path goes on as `scatter` says.
#[inline(never)] // keeps the loops over Lambertian vertices short
pub(super) fn at_other_surface(
    scene: &Scene,
    ray: &Ray,
    hit: &Hit,
    (at, lane): (&mut DiffuseVertices, usize),
    scatter: impl FnOnce(&Surface) -> Option<(Ray, Walk)>,
) -> Option<(Ray, Walk)> {
    let surface = scene.surface(ray, hit);
    match surface.diffuse() {
        Some(point) => {
            at.set(lane, &point);
            None
        }
        None => scatter(&surface),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_count_both_kinds() {
        let mut depth = Depth::default();
        assert!(depth.is_start());
        for _ in 0..300 {
            depth = depth.scattered();
        }
        let depth = depth.passed_on().passed_on();
        assert_eq!((depth.diffuse(), depth.passed(), depth.is_start()), (300, 2, false));
    }
}
