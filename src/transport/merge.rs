//! Merge phase: what light paths bring to camera paths, all together or pair by pair.

use super::camera_paths::CameraPaths;
use super::gather::{GatherPacket, GatherPoint};
use super::pair_list::{Pair, PairList};
use super::photon::PhotonClass;
use super::photon_map::{LookUp, LookUps, PhotonMap, Range, Ranges};
use crate::base::math::{LUMINANCE, Rgb, disc_area};
use crate::lanes::simd::{Simd, vectorized};
use crate::lanes::{LANES, Vec3s};
use std::array::from_fn;
use std::ops;

/// Camera paths or gather points merged together where look-ups in any order wait for memory: enough for
/// neighbors to share what they read of a large photon map.
const MERGED: usize = 65_536;

/// The same in iterations that measure: their pairs take room in the caches, too.
const MEASURED: usize = 16_384;

/// Pairs found at a time: as many camera paths as find more are merged in parts.
const MOST_PAIRS: usize = 1 << 22;

/// The constant merge kernel `1/(pi r^2)` over a photon map.
#[derive(Clone, Copy, Debug)]
pub struct Merge<'a> {
    map: &'a PhotonMap,
    merge_vertex: u32,
    kernel: f32,
    in_zones: bool,
    most_pairs: usize,
}

/// What camera paths gathered; buffers are reused by the next.
#[derive(Debug, Default)]
pub struct Gathered {
    /// `sum_i I_ij` of each camera path, W/(m^2 sr).
    pub sums: Vec<Rgb>,
    /// All of which these are the sums, if they were asked for.
    pub pairs: PairList,
    look_ups: LookUps,
    ranges: Ranges,
    /// At the gather points, W.
    flux: Vec<Vec3s>,
}

impl<'a> Merge<'a> {
    /// Merges with the photons of `map`, at the radius it was built for, camera paths that are cut
    /// at their diffuse vertex number `merge_vertex`.
    pub fn new(map: &'a PhotonMap, merge_vertex: u32) -> Self {
        // theory.md (45)
        let kernel = disc_area(map.radius()).recip();
        Self { map, merge_vertex, kernel, in_zones: map.is_large(), most_pairs: MOST_PAIRS }
    }

    /// How many camera paths or gather points it pays to merge together, about, with or without their pairs.
    pub fn together(&self, pairs: bool) -> usize {
        let large = if pairs { MEASURED } else { MERGED };
        if self.in_zones { large } else { CameraPaths::BATCH }
    }

    /// Sets `gathered` to what these camera paths gather.
    pub fn gather(&self, paths: &CameraPaths, gathered: &mut Gathered) {
        gathered.clear(paths);
        self.find::<false>(paths, 0..paths.direct.len(), gathered);
    }

    /// Sets `gathered` to what these camera paths gather and the pairs that this consists of, and shows it
    /// to `visit` with the camera paths that are complete, in their order: all at once unless they have
    /// very many pairs.
    pub fn gather_pairs(
        &self,
        paths: &CameraPaths,
        gathered: &mut Gathered,
        mut visit: impl FnMut(&Gathered, ops::Range<usize>),
    ) {
        gathered.clear(paths);
        let (mut first, end) = (0, paths.direct.len());
        let mut count = end;
        while first < end {
            let part = first..first.saturating_add(count).min(end);
            gathered.pairs.clear();
            if self.find::<true>(paths, part.clone(), gathered) {
                gathered.pairs.order_by_path(part.clone());
                visit(gathered, part.clone());
                first = part.end;
                count = count.saturating_mul(2);
            } else {
                gathered.sums[part.clone()].fill(Rgb::ZERO);
                count = part.len().div_ceil(2);
            }
        }
    }

    /// Adds what these camera paths gather, and their pairs if asked for. Returns whether all are found: if
    /// not, there are more pairs than are kept at a time, and several camera paths.
    fn find<const PAIRS: bool>(
        &self,
        paths: &CameraPaths,
        part: ops::Range<usize>,
        gathered: &mut Gathered,
    ) -> bool {
        vectorized(
            #[inline(always)]
            |simd| {
                if self.in_zones {
                    self.find_in_zones::<PAIRS>(simd, paths, part, gathered)
                } else {
                    self.find_in_order::<PAIRS>(simd, paths, part, gathered)
                }
            },
        )
    }

    /// Packet by packet.
    #[inline(always)] // vectorized
    fn find_in_order<const PAIRS: bool>(
        &self,
        simd: Simd,
        paths: &CameraPaths,
        part: ops::Range<usize>,
        gathered: &mut Gathered,
    ) -> bool {
        let Gathered { sums, pairs, ranges, .. } = gathered;
        for (packet, first) in paths.gather_points.packets().iter().zip((0..).step_by(LANES)) {
            let gathers = if PAIRS { packet.gathers_of(&part) } else { packet.gathers };
            self.map.find_ranges(&packet.position, &gathers, ranges);
            let mut flux = Vec3s::default();
            for ranges in ranges.by_look_up() {
                let lane = ranges[0].look_up;
                let point = packet.get(lane);
                let look_up = self.look_up(&point, first + lane);
                let weight = self.pair_weight(&point);
                let to = (weight, &mut *pairs);
                flux.set(lane, self.flux_in::<PAIRS>(simd, paths, ranges, &look_up, to));
            }
            self.add(packet, &flux, sums);
            if PAIRS && pairs.len() > self.most_pairs && part.len() > 1 {
                return false;
            }
        }
        true
    }

    /// First all look-ups in one part of the photon map, then in the next: they read the same photons.
    #[inline(always)] // vectorized
    fn find_in_zones<const PAIRS: bool>(
        &self,
        simd: Simd,
        paths: &CameraPaths,
        part: ops::Range<usize>,
        gathered: &mut Gathered,
    ) -> bool {
        let Gathered { sums, pairs, look_ups, ranges, flux } = gathered;
        let packets = paths.gather_points.packets();
        look_ups.sort(
            self.map,
            packets.iter().zip((0..).step_by(LANES)).flat_map(|(packet, first)| {
                let gathers = if PAIRS { packet.gathers_of(&part) } else { packet.gathers };
                let lanes = (0..LANES).filter(move |&lane| gathers[lane]);
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
            let mut weights = [<(u32, Rgb)>::default(); LANES];
            if PAIRS {
                // All at once, so that their waits for memory overlap.
                for (weight, look_up) in weights.iter_mut().zip(look_ups) {
                    *weight = self.pair_weight(&paths.gather_points.at(look_up.point as usize));
                }
            }
            for ranges in ranges.by_look_up() {
                let lane = ranges[0].look_up;
                let look_up = &look_ups[lane];
                let to = (weights[lane], &mut *pairs);
                let found = self.flux_in::<PAIRS>(simd, paths, ranges, look_up, to);
                let point = look_up.point as usize;
                flux[point / LANES].set(point % LANES, found);
            }
            if PAIRS && pairs.len() > self.most_pairs && part.len() > 1 {
                return false;
            }
        }
        for (packet, flux) in packets.iter().zip(flux) {
            self.add(packet, flux, sums);
        }
        true
    }

    /// Adds what photons of so much flux contribute to the camera paths of a packet of points.
    #[inline(always)] // vectorized
    fn add(&self, packet: &GatherPacket, flux: &Vec3s, sums: &mut [Rgb]) {
        let mut contribution = Vec3s::default();
        for lane in 0..LANES {
            // theory.md (45)
            let weight = packet.weight.get(lane) * self.kernel;
            contribution.set(lane, weight * flux.get(lane));
        }
        for lane in (0..LANES).filter(|&lane| packet.gathers[lane] & (flux.get(lane) != Rgb::ZERO))
        {
            sums[packet.path[lane] as usize] += contribution.get(lane);
        }
    }

    /// The flux of the photons in the ranges of a look-up that it counts, W; times the BSDF where that is
    /// not the same for all photons. Adds their pairs if asked for.
    #[inline(always)] // vectorized
    fn flux_in<const PAIRS: bool>(
        &self,
        simd: Simd,
        paths: &CameraPaths,
        ranges: &[Range],
        look_up: &LookUp,
        (weight, pairs): ((u32, Rgb), &mut PairList),
    ) -> Rgb {
        if look_up.view {
            self.flux_viewed::<PAIRS>(paths, ranges, look_up, pairs)
        } else if PAIRS {
            self.map.pairs_in(simd, ranges, look_up, weight, pairs)
        } else {
            self.map.flux_in(ranges, look_up)
        }
    }

    /// [`Self::flux_in`] where the BSDF depends on where photons come from.
    #[inline(never)] // keeps the common case short
    fn flux_viewed<const PAIRS: bool>(
        &self,
        paths: &CameraPaths,
        ranges: &[Range],
        look_up: &LookUp,
        pairs: &mut PairList,
    ) -> Rgb {
        let point = paths.gather_points.at(look_up.point as usize);
        let view = &paths.views[point.view as usize];
        let (camera_path, weight) = self.pair_weight(&point);
        let (mut sum, mut nested, mut count) = (Rgb::ZERO, 0.0, 0);
        self.map.for_each_in(ranges, point.position, |photon, distance2| {
            // theory.md (45): [class], and [n_x.n_y > 0] below
            let counts = look_up.last || photon.class() == PhotonClass::EveryVertex;
            if counts && photon.faces(point.normal) {
                let flux = photon.flux * view.value(photon, &point);
                sum += flux;
                if PAIRS {
                    let value = weight.dot(flux);
                    // theory.md (68)
                    nested += if self.map.is_inner(distance2) { -value } else { value };
                    pairs.space(count + 1)[count] = Pair { light_path: photon.path, value };
                    count += 1;
                }
            }
        });
        if count > 0 {
            pairs.take(count, camera_path, nested);
        }
        sum
    }

    /// The camera path of a gather point, and what the flux of a photon is multiplied with to get the
    /// luminance that it contributes.
    #[inline(always)] // vectorized
    fn pair_weight(&self, point: &GatherPoint) -> (u32, Rgb) {
        // theory.md (45), its luminance (4)
        (point.path, LUMINANCE * point.weight * self.kernel)
    }

    /// Where a gather point of this number looks for photons.
    #[inline(always)] // vectorized
    fn look_up(&self, point: &GatherPoint, number: usize) -> LookUp {
        let GatherPoint { position, normal, vertex, view, .. } = *point;
        let last = vertex == self.merge_vertex;
        let view = view != GatherPoint::NO_VIEW;
        LookUp { position, point: number as u32, normal, last, view, zone: 0 }
    }
}

impl Gathered {
    fn clear(&mut self, paths: &CameraPaths) {
        self.sums.clear();
        self.sums.resize(paths.direct.len(), Rgb::ZERO);
    }
}

#[cfg(test)]
mod tests;
