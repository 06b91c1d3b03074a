//! Numbers of sixteen rays side by side, one ray per lane.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Number of rays side by side: two registers of AVX2, four of SSE.
pub const LANES: usize = 16;

/// A condition for each ray.
pub type Mask = [bool; LANES];

/// A vector of each ray, component by component.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Vec3s {
    /// First components.
    pub x: [f32; LANES],
    /// Second components.
    pub y: [f32; LANES],
    /// Third components.
    pub z: [f32; LANES],
}

impl Vec3s {
    /// One vector for all rays.
    #[inline(always)]
    pub fn splat(vector: Vec3) -> Self {
        let [x, y, z] = vector.to_array().map(|number| [number; LANES]);
        Self { x, y, z }
    }

    /// The vector of one ray.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }

    /// Replaces the vector of one ray.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, vector: Vec3) {
        (self.x[lane], self.y[lane], self.z[lane]) = vector.into();
    }
}

/// Runs `work`, compiled for AVX2 if the processor has it. Functions that `work` calls must be
/// inlined to profit. Results do not depend on AVX2.
#[cfg(feature = "embree")]
#[inline(always)]
pub(crate) fn vectorized<T>(work: impl FnOnce() -> T) -> T {
    /// Work without arguments.
    struct Work<F>(F);
    impl<T, F: FnOnce() -> T> pulp::WithSimd for Work<F> {
        type Output = T;

        #[inline(always)]
        fn with_simd<S: pulp::Simd>(self, _: S) -> T {
            (self.0)()
        }
    }
    #[cfg(target_arch = "x86_64")]
    if let Some(v3) = pulp::x86::V3::try_new() {
        return pulp::Simd::vectorize(v3, Work(work));
    }
    work()
}
