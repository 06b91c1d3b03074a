//! Diffuse vertices, sixteen paths at a time: what both kinds of paths do most.

use crate::lanes::{LANES, Rngs, Vec3s};
use crate::math::{Rgb, cosine_hemisphere};
use crate::rng::Rng;
use crate::scene::LightSamples;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Where a path arrived at a Lambertian surface, on the side that it came from.
#[derive(Clone, Copy, Debug)]
pub struct DiffusePoint {
    /// The point that was hit.
    pub position: Vec3,
    /// Unit normal of the triangle.
    pub normal: Vec3,
    /// The point, moved off the surface: where new rays start.
    pub off_surface: Vec3,
    /// Reflected share of the incident flux, in [0, 1].
    pub albedo: Rgb,
    /// Emitted radiance, W/(m^2 sr).
    pub emission: Rgb,
}

/// Up to sixteen vertices, each of another path.
#[derive(Clone, Copy, Debug, Default)]
pub struct DiffuseVertices {
    len: usize,
    /// Index of each path under way.
    walks: [u32; LANES],
    /// As in [`DiffusePoint`].
    pub position: Vec3s,
    /// As in [`DiffusePoint`].
    pub normal: Vec3s,
    /// As in [`DiffusePoint`].
    pub off_surface: Vec3s,
    /// As in [`DiffusePoint`].
    pub albedo: Vec3s,
    /// Throughput of camera paths, flux of light paths: where they arrive.
    pub carried: Vec3s,
    /// Random numbers.
    pub rng: Rngs,
}

impl DiffuseVertices {
    /// Adds the vertex of the path `walk`.
    ///
    /// # Panics
    /// If it is full.
    #[inline(always)] // as those below: parts of the loops over vertices
    pub fn push(&mut self, walk: usize, point: &DiffusePoint, carried: Rgb, rng: Rng) {
        let lane = self.len;
        self.walks[lane] = walk as u32;
        self.position.set(lane, point.position);
        self.normal.set(lane, point.normal);
        self.off_surface.set(lane, point.off_surface);
        self.albedo.set(lane, point.albedo);
        self.carried.set(lane, carried);
        self.rng.set(lane, rng);
        self.len += 1;
    }

    /// Whether there is no room for another.
    #[inline(always)]
    pub fn is_full(&self) -> bool {
        self.len == LANES
    }

    /// Takes all out.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Each lane with its path.
    #[inline(always)]
    pub fn lanes(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let walks = self.walks;
        (0..self.len).map(move |lane| (lane, walks[lane] as usize))
    }

    /// What the albedo and so much light from these directions contribute to each path.
    #[inline(always)]
    pub fn contributions(&self, light: &LightSamples) -> Vec3s {
        let mut contributions = Vec3s::default();
        for lane in 0..LANES {
            let cos_theta = light.wi.get(lane).dot(self.normal.get(lane)).max(0.0);
            let weight = self.weight(lane) * cos_theta;
            contributions.set(lane, weight * light.irradiance.get(lane));
        }
        contributions
    }

    /// What the path carries times the BSDF, 1/sr.
    #[inline(always)]
    pub fn weight(&self, lane: usize) -> Rgb {
        self.carried.get(lane) * self.albedo.get(lane) * FRAC_1_PI
    }

    /// Samples where each path goes on, in proportion to the cosine: the weight of each direction is
    /// the albedo.
    #[inline(always)]
    pub fn sample(&mut self) -> Vec3s {
        let mut directions = Vec3s::default();
        for lane in 0..LANES {
            let mut rng = self.rng.get(lane);
            directions.set(lane, cosine_hemisphere(self.normal.get(lane), rng.next_2d()));
            self.rng.set(lane, rng);
        }
        directions
    }
}
