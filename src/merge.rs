//! Merge phase: hands every pair (light path, camera path) that meets to a visitor.

use crate::camera_paths::{CameraPaths, GatherPoint};
use crate::light_paths::PhotonClass;
use crate::math::{Rgb, disc_area};
use crate::photon_map::PhotonMap;

/// The constant merge kernel `1/(pi r^2)` over a photon map.
#[derive(Clone, Copy, Debug)]
pub struct Merge<'a> {
    map: &'a PhotonMap,
    merge_vertex: u32,
    kernel: f32,
}

impl<'a> Merge<'a> {
    /// Merges with the photons of `map`, at the radius it was built for, camera paths that are cut
    /// at their diffuse vertex number `merge_vertex`.
    pub fn new(map: &'a PhotonMap, merge_vertex: u32) -> Self {
        Self { map, merge_vertex, kernel: disc_area(map.radius()).recip() }
    }

    /// Calls `visit` with the light path's id and the contribution, W/(m^2 sr), of each photon
    /// that is merged at `point`.
    ///
    /// The contributions of a light path to a camera path add up to `I_ij` over the photons of the
    /// one and the gather points of the other.
    #[inline]
    pub fn at_point(&self, point: &GatherPoint, mut visit: impl FnMut(u32, Rgb)) {
        let weight = point.weight * self.kernel;
        let last = point.vertex == self.merge_vertex;
        self.map.for_each_within(point.position, |photon| {
            let counts = last || photon.class() == PhotonClass::EveryVertex;
            if counts && photon.faces(point.normal) {
                visit(photon.path, weight * photon.flux);
            }
        });
    }

    /// Calls `add` with each path of the batch, in order, and `sum_i I_ij`, the sum of all that it
    /// gathers.
    pub fn sums(&self, paths: &CameraPaths, mut add: impl FnMut(usize, Rgb)) {
        let mut points = &paths.gather_points[..];
        for path in 0..paths.direct.len() {
            let mut sum = Rgb::ZERO;
            while let Some((point, rest)) = points.split_first()
                && point.path as usize == path
            {
                self.at_point(point, |_, contribution| sum += contribution);
                points = rest;
            }
            add(path, sum);
        }
    }
}
