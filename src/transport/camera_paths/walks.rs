//! Camera paths and shadow rays under way.

use crate::accel::Ray;
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use crate::lanes::{LANES, Rngs, Vec3s};
use crate::transport::flight::Columns;
use bytemuck::{Pod, Zeroable};

/// Camera paths whose throughput fell below this share play roulette where they pass through.
const WEIGHT_FLOOR: f32 = 1.0 / 16.0;

/// From so many vertices on that a path passed through it may end at each of them with this
/// probability: light may be caught between mirrors.
const LONG_CHAIN: u32 = 16;
const LONG_CHAIN_END: f32 = 0.1;

/// Sixteen paths under way.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Walks {
    /// Of the next segments.
    pub origin: Vec3s,
    /// Unit vectors.
    pub direction: Vec3s,
    pub rng: Rngs,
    pub throughput: Vec3s,
    /// Index among those that are merged together.
    pub path: [u32; LANES],
    /// Diffuse vertices so far.
    pub vertices: [u32; LANES],
    /// Vertices passed through so far.
    pub passed: [u32; LANES],
}

impl Columns<16> for Walks {
    const T_FAR: f32 = f32::INFINITY;
}

/// What sixteen shadow rays carry if nothing blocks them.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Connections {
    /// Points on lights.
    pub origin: Vec3s,
    /// To the vertices.
    pub direction: Vec3s,
    pub path: [u32; LANES],
    pub contribution: Vec3s,
}

impl Columns<10> for Connections {
    /// Shadow rays end where they point.
    const T_FAR: f32 = 1.0;
}

/// One of [`Walks`], without its ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    pub rng: Rng,
    pub throughput: Rgb,
    pub path: u32,
    pub vertices: u32,
    pub passed: u32,
}

impl Walks {
    pub fn get(&self, lane: usize) -> (Ray, Walk) {
        let ray = Ray::new(self.origin.get(lane), self.direction.get(lane));
        let walk = Walk {
            rng: self.rng.get(lane),
            throughput: self.throughput.get(lane),
            path: self.path[lane],
            vertices: self.vertices[lane],
            passed: self.passed[lane],
        };
        (ray, walk)
    }

    pub fn set(&mut self, lane: usize, ray: &Ray, walk: &Walk) {
        self.origin.set(lane, ray.origin);
        self.direction.set(lane, ray.direction);
        self.rng.set(lane, walk.rng);
        self.throughput.set(lane, walk.throughput);
        self.path[lane] = walk.path;
        self.vertices[lane] = walk.vertices;
        self.passed[lane] = walk.passed;
    }
}

impl Walk {
    /// Roulette where the path passed through a vertex: whether it goes on. `inverse_weight` is the
    /// reciprocal of the weight that the camera gave it.
    pub fn passes_on(&mut self, inverse_weight: f32) -> bool {
        self.passed += 1;
        let share = self.throughput.max_element() * inverse_weight;
        let mut survival = (share / WEIGHT_FLOOR).min(1.0);
        if self.passed >= LONG_CHAIN {
            survival = survival.min(1.0 - LONG_CHAIN_END);
        }
        if survival < 1.0 {
            if self.rng.next_1d() >= survival {
                return false;
            }
            self.throughput /= survival;
        }
        true
    }
}
