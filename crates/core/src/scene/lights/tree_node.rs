//! A node of the light tree: up to eight clusters side by side, and estimates of their irradiance
//! at a point.

use super::Receiver;
use super::cluster::Cluster;
use glam::Vec3;
use std::f32::consts::PI;

/// Number of children of a node.
pub(super) const WIDE: usize = 8;

/// The children of a node, field by field, as the estimates read them.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub(super) struct TreeNode {
    /// Centers of the boxes around their emitters.
    center: [[f32; WIDE]; 3],
    /// Half the sides of those boxes.
    half: [[f32; WIDE]; 3],
    axis: [[f32; WIDE]; 3],
    cos_spread: [f32; WIDE],
    sin_spread: [f32; WIDE],
    cos_reach: [f32; WIDE],
    /// At least half the extents of the boxes along any of their emitters' axes.
    emitting_extent: [f32; WIDE],
    /// Luminance of the radiant intensity, W/sr; 0 for missing children.
    intensity: [f32; WIDE],
    /// Means of the emitters' axes, weighted by intensity: of length 1 if all shine in one
    /// direction.
    net: [[f32; WIDE]; 3],
    /// Square of twice the mean share of the intensity in any direction, scaled by how much the
    /// axes differ.
    all_around2: [f32; WIDE],
    /// The children's content, in the encoding of the tree.
    pub content: [u32; WIDE],
}

/// Slack of bounds, radians and relative length: rounding must not lose any light.
const SLACK: f32 = 1e-3;

/// Squared distances to a cluster's center grow by this share of the squared half diagonal. Of 0.1
/// to 0.5 it gave the smallest variance for lamps in a grid, in rows, in clumps and at random.
const SPREAD_OUT: f32 = 0.25;

/// Cosine of `a - b`, or 1 if `b` is the larger angle; both in [0, pi].
#[inline(always)]
fn cos_of_rest(cos_a: f32, (sin_b, cos_b): (f32, f32)) -> f32 {
    let rest = cos_a * cos_b + (1.0 - cos_a * cos_a).max(0.0).sqrt() * sin_b;
    if cos_a >= cos_b { 1.0 } else { rest }
}

/// Middle of the part above the horizon of a body that reaches from `height - extent` to
/// `height + extent`.
#[inline(always)]
fn above_horizon(height: f32, extent: f32) -> f32 {
    if height >= extent { height } else { 0.5 * (height + extent) }
}

/// Approximate mean of the positive part of numbers around `mean`: `mean` itself if it is large,
/// half the root of `spread2` at 0.
#[inline(always)]
fn positive_part(mean: f32, spread2: f32) -> f32 {
    let root = (mean * mean + spread2).sqrt();
    let beyond = spread2 / (root + mean.abs()).max(f32::MIN_POSITIVE);
    0.5 * if mean > 0.0 { mean + root } else { beyond }
}

#[inline(always)]
fn at(columns: &[[f32; WIDE]; 3], child: usize) -> Vec3 {
    // `map` would keep the compiler from vector instructions.
    Vec3::new(columns[0][child], columns[1][child], columns[2][child])
}

impl TreeNode {
    /// Sets one child.
    pub fn set(&mut self, child: usize, cluster: &Cluster, content: u32) {
        let Cluster { bounds, beam, intensity, net, mean } = cluster;
        let half = 0.5 * (bounds.max - bounds.min);
        let half = half + SLACK * half.length();
        let spread = (beam.spread + SLACK).min(PI);
        let (sin_spread, cos_spread) = spread.sin_cos();
        // For an axis off by the spread: |a'| <= |a| + |a' - a|.
        let radius = half.length();
        let along = beam.axis.abs().dot(half) + 2.0 * (0.5 * spread).sin() * radius;
        let (net, mean) =
            (*net / intensity.max(f32::MIN_POSITIVE), mean / intensity.max(f32::MIN_POSITIVE));
        let columns = [&mut self.center, &mut self.half, &mut self.axis, &mut self.net];
        for (columns, vector) in columns.into_iter().zip([bounds.center(), half, beam.axis, net]) {
            columns.iter_mut().zip(vector.to_array()).for_each(|(column, x)| column[child] = x);
        }
        self.cos_spread[child] = cos_spread;
        self.sin_spread[child] = sin_spread.max(0.0); // not the -8e-8 of pi
        self.cos_reach[child] = (beam.reach + SLACK).cos();
        self.emitting_extent[child] = along.min(radius);
        self.intensity[child] = *intensity;
        self.all_around2[child] = 4.0 * mean * mean * (1.0 - net.length_squared()).max(0.0);
        self.content[child] = content;
    }

    /// Estimates of each child's irradiance at `at`, W/m^2; 0 only if a child cannot light it.
    ///
    /// Each is the intensity toward the point times the cosine there over the squared distance. The
    /// bounds of the cosines of the paper would be 1 for all large clusters; means over the part
    /// above the horizon are closer. theory.md (16).
    #[inline(always)] // as all here: part of vectorized code
    pub fn estimates(&self, Receiver { position, normal }: Receiver) -> [f32; WIDE] {
        let mut estimates = match normal {
            Some(normal) => self.estimates_by(position, |to_center, half, _| {
                above_horizon(to_center.dot(normal), normal.abs().dot(half))
            }),
            None => self.estimates_by(position, |_, _, spread_out| spread_out),
        };
        if self.cos_reach.iter().any(|&cos| cos > 0.0) {
            self.leave_out_spots(position, &mut estimates);
        }
        estimates
    }

    /// Estimates that ignore the cones of spots; `received` gives the heights over the surface.
    #[inline(always)]
    fn estimates_by(
        &self,
        position: Vec3,
        received: impl Fn(Vec3, Vec3, f32) -> f32,
    ) -> [f32; WIDE] {
        let mut estimates = [0.0; WIDE];
        for (child, estimate) in estimates.iter_mut().enumerate() {
            let (to_center, half) = (at(&self.center, child) - position, at(&self.half, child));
            let distance2 = to_center.length_squared();
            let spread_out2 = distance2 + SPREAD_OUT * half.length_squared();
            let spread_out2 = spread_out2.max(f32::MIN_POSITIVE);
            let spread_out = spread_out2.sqrt();
            let received = received(to_center, half, spread_out);
            let distance = distance2.sqrt().max(f32::MIN_POSITIVE);
            let cos_axis = -to_center.dot(at(&self.axis, child)) / distance;
            let spread = (self.sin_spread[child], self.cos_spread[child]);
            let cos_nearest = cos_of_rest(cos_axis, spread);
            let emitted = above_horizon(distance * cos_nearest, self.emitting_extent[child]);
            let extent = self.emitting_extent[child] / spread_out;
            let spread2 = self.all_around2[child] + extent * extent;
            let cos = -to_center.dot(at(&self.net, child)) / spread_out;
            let cosines = (received / spread_out).min(1.0) * positive_part(cos, spread2).min(1.0);
            // The sum over children is finite, also at the position of a light.
            let value = (self.intensity[child] * cosines / spread_out2).min(f32::MAX / 32.0);
            *estimate = if (received > 0.0) & (emitted > 0.0) { value } else { 0.0 };
        }
        estimates
    }

    /// Sets the estimate of spots that shine elsewhere to 0: the angle outside their spread, less
    /// half the angular diameter of the cluster, exceeds their reach.
    #[inline(always)]
    fn leave_out_spots(&self, position: Vec3, estimates: &mut [f32; WIDE]) {
        for (child, estimate) in estimates.iter_mut().enumerate() {
            let to_center = at(&self.center, child) - position;
            let distance2 = to_center.length_squared();
            let sin2 = at(&self.half, child).length_squared() / distance2;
            let cos_axis = -to_center.dot(at(&self.axis, child)) / distance2.sqrt();
            let spread = (self.sin_spread[child], self.cos_spread[child]);
            let cos_nearest = cos_of_rest(cos_axis, spread);
            let seen = (sin2.sqrt(), (1.0 - sin2).sqrt());
            let elsewhere = cos_of_rest(cos_nearest, seen) < self.cos_reach[child];
            if (sin2 < 1.0) & (self.cos_reach[child] > 0.0) & elsewhere {
                *estimate = 0.0;
            }
        }
    }
}
