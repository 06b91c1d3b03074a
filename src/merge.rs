//! Merge phase: hands every pair (light path, camera path) that meets to a visitor.

use crate::camera_paths::CameraPaths;
use crate::gather::GatherPoint;
use crate::math::{Rgb, disc_area};
use crate::photon::{Photon, PhotonClass};
use crate::photon_map::{PhotonMap, Range, Ranges};

/// What is done with the pairs of a batch of camera paths.
pub trait PairVisitor {
    /// Part of the contribution of light path `light_path` to the current camera path,
    /// W/(m^2 sr); its parts add up to `I_ij`. `inner` tells whether the photon lies within
    /// `1/sqrt(2)` of the merge radius, in half the kernel's area.
    fn pair(&mut self, light_path: u32, contribution: Rgb, inner: bool);

    /// The current camera path is complete; `direct` is its `D_j`.
    fn end_path(&mut self, direct: Rgb);
}

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
        let mut ranges = Ranges::default();
        let points = &paths.gather_points;
        for first in (0..points.len()).step_by(Ranges::LOOK_UPS) {
            let places = first..points.len().min(first + Ranges::LOOK_UPS);
            self.map.find_ranges(places.map(|place| points.get(place).position), &mut ranges);
            for range in ranges.as_slice() {
                let point = &points.get(first + range.look_up as usize);
                let path = point.path as usize;
                for &direct in &paths.direct[ended..path] {
                    visitor.end_path(direct);
                }
                ended = path;
                match paths.views.get(point.view as usize) {
                    None => self.in_range(range, point, visitor, |_| Rgb::ONE),
                    Some(view) => {
                        self.in_range(range, point, visitor, |photon| view.value(photon, point));
                    }
                }
            }
        }
        for &direct in &paths.direct[ended..] {
            visitor.end_path(direct);
        }
    }

    /// Merges one vertex of the current camera path with photons of one range, which count by
    /// `value` besides the vertex' weight.
    #[inline]
    fn in_range(
        &self,
        range: &Range,
        point: &GatherPoint,
        visitor: &mut impl PairVisitor,
        value: impl Fn(&Photon) -> Rgb,
    ) {
        let weight = point.weight * self.kernel;
        let last = point.vertex == self.merge_vertex;
        self.map.for_each_in(range, point.position, |photon, distance2| {
            let counts = last || photon.class() == PhotonClass::EveryVertex;
            if counts && photon.faces(point.normal) {
                let contribution = weight * photon.flux * value(photon);
                visitor.pair(photon.path, contribution, distance2 <= self.inner_radius2);
            }
        });
    }
}
