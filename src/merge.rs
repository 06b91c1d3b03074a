//! Merge phase: what light paths bring to camera paths, all together or pair by pair.

use crate::camera_paths::CameraPaths;
use crate::gather::{GatherPacket, GatherPoint};
use crate::lanes::{LANES, Vec3s, vectorized};
use crate::math::{Rgb, disc_area};
use crate::photon::{Photon, PhotonClass};
use crate::photon_map::{LookUp, LookUps, PhotonMap, Range, Ranges};
use std::array::from_fn;
use std::mem;

/// What is done with the pairs (light path, camera path) that meet.
pub trait PairVisitor {
    /// Part of the contribution of light path `light_path` to the current camera path,
    /// W/(m^2 sr); its parts add up to `I_ij`. `inner` tells whether the photon lies within
    /// `1/sqrt(2)` of the merge radius, in half the kernel's area.
    fn pair(&mut self, light_path: u32, contribution: Rgb, inner: bool);

    /// The current camera path is complete; `direct` is its `D_j`, `gathered` its `sum_i I_ij`.
    fn end_path(&mut self, direct: Rgb, gathered: Rgb);
}

/// The constant merge kernel `1/(pi r^2)` over a photon map.
#[derive(Clone, Copy, Debug)]
pub struct Merge<'a> {
    map: &'a PhotonMap,
    merge_vertex: u32,
    kernel: f32,
    inner_radius2: f32,
}

/// What camera paths gathered; buffers are reused by the next.
#[derive(Debug, Default)]
pub struct Gathered {
    /// `sum_i I_ij` of each camera path, W/(m^2 sr).
    pub sums: Vec<Rgb>,
    look_ups: LookUps,
    ranges: Ranges,
    /// At the gather points, W.
    flux: Vec<Vec3s>,
}

impl<'a> Merge<'a> {
    /// Merges with the photons of `map`, at the radius it was built for, camera paths that are cut
    /// at their diffuse vertex number `merge_vertex`.
    pub fn new(map: &'a PhotonMap, merge_vertex: u32) -> Self {
        let radius = map.radius();
        let kernel = disc_area(radius).recip();
        Self { map, merge_vertex, kernel, inner_radius2: 0.5 * radius * radius }
    }

    /// Sets `gathered` to what these camera paths gather.
    pub fn gather(&self, paths: &CameraPaths, gathered: &mut Gathered) {
        gathered.sums.clear();
        gathered.sums.resize(paths.direct.len(), Rgb::ZERO);
        vectorized(
            #[inline(always)]
            || {
                if self.map.is_large() {
                    self.gather_in_regions(paths, gathered);
                } else {
                    self.gather_in_order(paths, gathered);
                }
            },
        );
    }

    /// Packet by packet.
    #[inline(always)] // vectorized
    fn gather_in_order(&self, paths: &CameraPaths, gathered: &mut Gathered) {
        let Gathered { sums, ranges, .. } = gathered;
        for (packet, first) in paths.gather_points.packets().iter().zip((0..).step_by(LANES)) {
            self.map.find_ranges(&packet.position, &packet.gathers, ranges);
            let mut flux = Vec3s::default();
            for range in ranges.as_slice() {
                let lane = range.look_up;
                let look_up = self.look_up(&packet.get(lane), first + lane);
                let found = self.flux_in(paths, range, &look_up);
                flux.set(lane, flux.get(lane) + found);
            }
            self.add(packet, &flux, sums);
        }
    }

    /// First all look-ups in one part of the photon map, then in the next: they read the same photons.
    #[inline(always)] // vectorized
    fn gather_in_regions(&self, paths: &CameraPaths, gathered: &mut Gathered) {
        let Gathered { sums, look_ups, ranges, flux } = gathered;
        let packets = paths.gather_points.packets();
        look_ups.sort(
            self.map,
            packets.iter().zip((0..).step_by(LANES)).flat_map(|(packet, first)| {
                let lanes = (0..LANES).filter(|&lane| packet.gathers[lane]);
                lanes.map(move |lane| self.look_up(&packet.get(lane), first + lane))
            }),
        );
        flux.clear();
        flux.resize(packets.len(), Vec3s::default());
        for look_ups in look_ups.packets() {
            let mut positions = Vec3s::default();
            for (lane, look_up) in look_ups.iter().enumerate() {
                positions.set(lane, look_up.position);
            }
            self.map.find_ranges(&positions, &from_fn(|lane| lane < look_ups.len()), ranges);
            for range in ranges.as_slice() {
                let look_up = &look_ups[range.look_up];
                let found = self.flux_in(paths, range, look_up);
                let point = look_up.point as usize;
                let (flux, lane) = (&mut flux[point / LANES], point % LANES);
                flux.set(lane, flux.get(lane) + found);
            }
        }
        for (packet, flux) in packets.iter().zip(flux) {
            self.add(packet, flux, sums);
        }
    }

    /// Adds what photons of so much flux contribute to the camera paths of a packet of points.
    #[inline(always)] // vectorized
    fn add(&self, packet: &GatherPacket, flux: &Vec3s, sums: &mut [Rgb]) {
        let mut contribution = Vec3s::default();
        for lane in 0..LANES {
            let weight = packet.weight.get(lane) * self.kernel;
            contribution.set(lane, weight * flux.get(lane));
        }
        for lane in (0..LANES).filter(|&lane| packet.gathers[lane] & (flux.get(lane) != Rgb::ZERO))
        {
            sums[packet.path[lane] as usize] += contribution.get(lane);
        }
    }

    /// Shows `visitor` all pairs, camera path after camera path. Gather points must be
    /// [in this order](CameraPaths::order_by_path). What they gather is the same as by [`Self::gather`].
    #[inline]
    pub fn visit(&self, paths: &CameraPaths, ranges: &mut Ranges, visitor: &mut impl PairVisitor) {
        let points = &paths.gather_points;
        debug_assert!(points.is_ordered(), "gather points are to be put in order");
        let mut gathered = Rgb::ZERO;
        let mut ended = 0;
        for first in (0..points.len()).step_by(LANES) {
            let count = LANES.min(points.len() - first);
            let mut positions = Vec3s::default();
            for lane in 0..count {
                positions.set(lane, points.get(first + lane).position);
            }
            self.map.find_ranges(&positions, &from_fn(|lane| lane < count), ranges);
            for ranges in ranges.as_slice().chunk_by(|one, next| one.look_up == next.look_up) {
                let number = points.number(first + ranges[0].look_up);
                let point = &points.at(number);
                let path = point.path as usize;
                for &direct in &paths.direct[ended..path] {
                    visitor.end_path(direct, mem::take(&mut gathered));
                }
                ended = path;
                let mut flux = Rgb::ZERO;
                for range in ranges {
                    flux += self.flux_in(paths, range, &self.look_up(point, number));
                    self.for_each_in(paths, range, point, |photon, value, distance2| {
                        let inner = distance2 <= self.inner_radius2;
                        visitor.pair(photon.path, self.contribution(point, value), inner);
                    });
                }
                if flux != Rgb::ZERO {
                    gathered += self.contribution(point, flux);
                }
            }
        }
        for &direct in &paths.direct[ended..] {
            visitor.end_path(direct, mem::take(&mut gathered));
        }
    }

    /// The flux of the photons in one range that a look-up counts, W; times the BSDF where that is
    /// not the same for all photons.
    #[inline(always)] // vectorized
    fn flux_in(&self, paths: &CameraPaths, range: &Range, look_up: &LookUp) -> Rgb {
        if look_up.view {
            let mut sum = Rgb::ZERO;
            let point = paths.gather_points.at(look_up.point as usize);
            self.for_each_in(paths, range, &point, |_, value, _| sum += value);
            sum
        } else {
            self.map.flux_in(range, look_up)
        }
    }

    /// Calls `found` with the photons of one range that a gather point counts, their flux (times the
    /// BSDF where that is not the same for all photons) and their squared distances.
    #[inline]
    fn for_each_in(
        &self,
        paths: &CameraPaths,
        range: &Range,
        point: &GatherPoint,
        mut found: impl FnMut(&Photon, Rgb, f32),
    ) {
        let last = point.vertex == self.merge_vertex;
        let view = paths.views.get(point.view as usize);
        self.map.for_each_in(range, point.position, |photon, distance2| {
            let counts = last || photon.class() == PhotonClass::EveryVertex;
            if counts && photon.faces(point.normal) {
                let value = view.map_or(Rgb::ONE, |view| view.value(photon, point));
                found(photon, photon.flux * value, distance2);
            }
        });
    }

    /// Where a gather point of this number looks for photons.
    #[inline(always)] // vectorized
    fn look_up(&self, point: &GatherPoint, number: usize) -> LookUp {
        let GatherPoint { position, normal, vertex, view, .. } = *point;
        let last = vertex == self.merge_vertex;
        let view = view != GatherPoint::NO_VIEW;
        LookUp { position, point: number as u32, normal, last, view, region: 0 }
    }

    /// Of photons that bring so much flux to a gather point, to its camera path.
    #[inline(always)] // vectorized
    fn contribution(&self, point: &GatherPoint, flux: Rgb) -> Rgb {
        point.weight * self.kernel * flux
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::{Bsdf, Vertex};
    use crate::gather::GatherView;
    use crate::math::uniform_sphere;
    use crate::rng::{Rng, Stream, StreamKey};
    use glam::Vec3;

    /// On the floor of a box a unit wide or anywhere in it, with a normal near the vertical.
    fn place(rng: &mut Rng) -> (Vec3, Vec3) {
        let [x, y] = rng.next_2d();
        let z = if rng.next_1d() < 0.5 { 0.0 } else { rng.next_1d() };
        let normal = (Vec3::Z + 1.2 * uniform_sphere(rng.next_2d())).normalize();
        (Vec3::new(x, y, z), normal)
    }

    fn photons(count: u32) -> Vec<Photon> {
        let photon = |path| {
            let mut rng = StreamKey::new(1, Stream::Test, 0).rng(u64::from(path));
            let (position, normal) = place(&mut rng);
            let late = rng.next_1d() < 0.7;
            let class = if late { PhotonClass::LastVertex } else { PhotonClass::EveryVertex };
            let flux = Rgb::new(1.0, rng.next_1d(), rng.next_1d());
            let from = (normal + 0.9 * uniform_sphere(rng.next_2d())).normalize();
            Photon::new(position, path, flux, normal, class).coming_from(from)
        };
        (0..count).map(photon).collect()
    }

    /// Paths with up to three gather points, some of which look at a BSDF that depends on directions.
    fn camera_paths(count: u32) -> CameraPaths {
        let mut paths = CameraPaths::default();
        let mut rng = StreamKey::new(2, Stream::Test, 0).rng(0);
        for vertex in 1..=3 {
            for path in (0..count).filter(|path| path % 4 != vertex) {
                let (position, normal) = place(&mut rng);
                let weight = Rgb::new(rng.next_1d(), 1.0, rng.next_1d());
                let view = if rng.next_1d() < 0.2 {
                    let at = Vertex { normal, wo: normal, front: true };
                    paths.views.push(GatherView { bsdf: Bsdf::diffuse(Rgb::splat(0.5)), at });
                    paths.views.len() as u32 - 1
                } else {
                    GatherPoint::NO_VIEW
                };
                let point = GatherPoint { position, path, weight, vertex, normal, view };
                paths.gather_points.push(&point);
            }
        }
        paths.direct.resize(count as usize, Rgb::ONE);
        paths.order_by_path();
        paths
    }

    /// Light path, contribution, and whether it is an inner one.
    type Pair = (u32, Rgb, bool);

    #[derive(Default)]
    struct Pairs {
        current: Vec<Pair>,
        /// Pairs of each path, and what it gathered.
        paths: Vec<(Vec<Pair>, Rgb)>,
    }

    impl PairVisitor for Pairs {
        fn pair(&mut self, light_path: u32, contribution: Rgb, inner: bool) {
            self.current.push((light_path, contribution, inner));
        }

        fn end_path(&mut self, direct: Rgb, gathered: Rgb) {
            assert_eq!(direct, Rgb::ONE);
            self.paths.push((mem::take(&mut self.current), gathered));
        }
    }

    #[test]
    fn sums_are_those_of_all_pairs_in_any_order_of_look_ups() {
        assert!(assert_sums(20_000, 0.05) > 5000);
        // Ranges of one look-up follow each other in the same block.
        assert!(assert_sums(40, 0.4) > 500);
    }

    fn assert_sums(count: u32, radius: f32) -> usize {
        let photons = photons(count);
        let paths = camera_paths(500);
        let mut map = PhotonMap::default();
        map.build_from(&[&photons], radius);
        let merge = Merge::new(&map, 3);
        let mut pairs = Pairs::default();
        merge.visit(&paths, &mut Ranges::default(), &mut pairs);
        let mut gathered = [Gathered::default(), Gathered::default()];
        gathered.iter_mut().for_each(|gathered| gathered.sums.resize(500, Rgb::ZERO));
        merge.gather_in_order(&paths, &mut gathered[0]);
        merge.gather_in_regions(&paths, &mut gathered[1]);
        let sums: Vec<Rgb> = pairs.paths.iter().map(|(_, sum)| *sum).collect();
        assert_eq!(gathered[0].sums, sums);
        assert_eq!(gathered[1].sums, sums);

        // Every photon with every point.
        let mut found = 0;
        for (path, (pairs, sum)) in pairs.paths.iter_mut().enumerate() {
            let mut expected = Vec::new();
            for point in paths.gather_points.iter().filter(|point| point.path as usize == path) {
                for photon in &photons {
                    let distance2 = photon.position.distance_squared(point.position);
                    let counts = point.vertex == 3 || photon.class() == PhotonClass::EveryVertex;
                    if distance2 <= radius * radius && counts && photon.faces(point.normal) {
                        let view = paths.views.get(point.view as usize);
                        let value = view.map_or(Rgb::ONE, |view| view.value(photon, &point));
                        let kernel = disc_area(radius).recip();
                        let contribution = point.weight * kernel * (photon.flux * value);
                        expected.push((
                            photon.path,
                            contribution,
                            distance2 <= merge.inner_radius2,
                        ));
                    }
                }
            }
            found += expected.len();
            let total = |pairs: &[Pair]| {
                pairs.iter().map(|(_, light, _)| light.as_dvec3()).sum::<glam::DVec3>()
            };
            let off = (total(&expected) - sum.as_dvec3()).abs().max_element();
            assert!(off <= 1e-5 * total(&expected).max_element(), "path {path}: off by {off}");
            let by_light_path = |pairs: &mut Vec<Pair>| {
                pairs.sort_by(|one, other| {
                    (one.0, one.1.x).partial_cmp(&(other.0, other.1.x)).expect("numbers")
                });
            };
            by_light_path(pairs);
            by_light_path(&mut expected);
            assert_eq!(*pairs, expected, "path {path}");
        }
        found
    }
}
