//! Merge phase: hands every pair (light path, camera path) that meets to a visitor.

use crate::camera_paths::{CameraPaths, GatherPoint};
use crate::light_paths::{Photon, PhotonClass};
use crate::math::{Rgb, disc_area};
use crate::photon_map::{PhotonMap, Rows};

/// What is done with the pairs of a batch of camera paths.
pub trait PairVisitor {
    /// Part of the contribution of light path `light_path` to the current camera path,
    /// W/(m^2 sr); its parts add up to `I_ij`. `inner` tells whether the photon lies within
    /// `1/sqrt(2)` of the merge radius, in half the kernel's area.
    fn pair(&mut self, light_path: u32, contribution: Rgb, inner: bool);

    /// The current camera path is complete; `direct` is its `D_j`.
    fn end_path(&mut self, direct: Rgb);
}

/// Gather points whose rows are found before the first of them is merged: waiting for memory
/// overlaps.
const GROUP: usize = 32;

/// The constant merge kernel `1/(pi r^2)` over a photon map.
#[derive(Clone, Copy, Debug)]
pub struct Merge<'a> {
    map: &'a PhotonMap,
    merge_vertex: u32,
    kernel: f32,
    inner_radius2: f32,
}

impl<'a> Merge<'a> {
    /// Merges with the photons of `map`, at the radius it was built for, camera paths that are cut
    /// at their diffuse vertex number `merge_vertex`.
    pub fn new(map: &'a PhotonMap, merge_vertex: u32) -> Self {
        let radius = map.radius();
        let kernel = disc_area(radius).recip();
        Self { map, merge_vertex, kernel, inner_radius2: 0.5 * radius * radius }
    }

    /// Shows `visitor` all pairs of the batch, camera path after camera path.
    #[inline]
    pub fn visit(&self, paths: &CameraPaths, visitor: &mut impl PairVisitor) {
        let mut ended = 0;
        let mut rows = [Rows::default(); GROUP];
        for points in paths.gather_points.chunks(GROUP) {
            for (rows, point) in rows.iter_mut().zip(points) {
                *rows = self.map.rows(point.position);
            }
            for (point, rows) in points.iter().zip(&rows) {
                for &direct in &paths.direct[ended..point.path as usize] {
                    visitor.end_path(direct);
                }
                ended = point.path as usize;
                match paths.views.get(point.view as usize) {
                    None => self.at_point(point, rows, visitor, |_| Rgb::ONE),
                    Some(view) => {
                        self.at_point(point, rows, visitor, |photon| view.value(photon, point));
                    }
                }
            }
        }
        for &direct in &paths.direct[ended..] {
            visitor.end_path(direct);
        }
    }

    /// Merges at one vertex of the current camera path, where photons count by `value` besides the
    /// vertex' weight.
    #[inline]
    fn at_point(
        &self,
        point: &GatherPoint,
        rows: &Rows,
        visitor: &mut impl PairVisitor,
        value: impl Fn(&Photon) -> Rgb,
    ) {
        let weight = point.weight * self.kernel;
        let last = point.vertex == self.merge_vertex;
        self.map.for_each_in(rows, point.position, |photon, distance2| {
            let counts = last || photon.class() == PhotonClass::EveryVertex;
            if counts && photon.faces(point.normal) {
                let contribution = weight * photon.flux * value(photon);
                visitor.pair(photon.path, contribution, distance2 <= self.inner_radius2);
            }
        });
    }
}
