//! Shadow rays under way.

use crate::simd::{LANES, Vec3s};
use crate::transport::path_queue::Columns;
use bytemuck::{Pod, Zeroable};

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
