//! Merge phase: sums the photons near the gather points of camera paths, and lists the pairs of
//! paths that meet.
//!
//! Gather points query the photon map packet by packet, in the order of their camera paths. Where
//! the map exceeds the caches, many camera paths are merged together and their queries are sorted
//! by zones of the map. Both orders differ in `Merge::merge_in_order` and `Merge::merge_by_zone`
//! only and share all code for a query.

mod reduced;
mod medium_merge;
mod output;
mod point;

pub use output::MergeOutput;

use super::camera_paths::CameraPaths;
use super::gather::{GatherPacket, GatherPoint};
use super::kernel::{Admission, ByClass, MergeKernel, NestedRadii, PointKernels};
use super::medium_kernel::MediumKernel;
use super::medium_photons::MediumPhotons;
use super::mis::Mis;
use super::near_planes::Surroundings;
use super::pair_list::PairList;
use super::photon::PhotonClass;
use super::photon_map::{MergeQueries, MergeQuery, PhotonMap, PointSearch, QueryKind, Ranges};
use crate::base::math::Rgb;
use crate::simd::f32x8::{F32x8, F32x8Work, by_f32x8};
use crate::simd::{LANES, Mask, Vec3s};
use medium_merge::MediumMerge;
use std::array::from_fn;
use std::{ops, slice};

/// Camera paths or gather points of a batch that is merged zone by zone: enough for neighbors to
/// share what they read of a large photon map.
const ZONE_BATCH: usize = 65_536;

/// Size of such a batch in iterations that list pairs, which take room in the caches, too.
const ZONE_BATCH_WITH_PAIRS: usize = 16_384;

/// Maximum number of pairs in a list. Camera paths that have more are merged in several parts.
const MAX_PAIRS: usize = 1 << 22;

/// Quantities to record beside the sums, and MIS.
#[derive(Clone, Copy, Debug, Default)]
pub struct MergeOptions {
    /// Weights of merges at the first two vertices.
    pub mis: Option<Mis>,
    /// Record [`MergeOutput::caustics`].
    pub records_caustics: bool,
    /// Record [`MergeOutput::annulus`].
    pub records_annulus: bool,
}

/// A merge kernel over a photon map.
#[derive(Clone, Copy)]
pub struct Merge<'a> {
    map: &'a PhotonMap,
    merge_vertex: u32,
    kernel: MergeKernel<'a>,
    admission: Admission,
    /// Photons in media, if there are any.
    medium: Option<MediumMerge<'a>>,
    options: MergeOptions,
    by_zone: bool,
    max_pairs: usize,
}

/// Buffers for a batch of camera paths.
#[derive(Debug, Default)]
struct Workspace {
    queries: MergeQueries,
    ranges: Ranges,
    /// Flux at the gather points of each packet, W.
    flux: Vec<ByClass<Vec3s>>,
    /// Flux within half the merge radii, W; empty unless the annulus is recorded.
    inner: Vec<ByClass<Vec3s>>,
    kernels: Vec<PointKernels>,
}

/// Camera paths that are merged together.
struct Batch<'a, E> {
    eight: E,
    paths: &'a CameraPaths,
    /// The paths among them that gather.
    part: &'a ops::Range<usize>,
}

impl<E> Batch<'_, E> {
    #[inline(always)] // vectorized
    fn packets(&self) -> &[GatherPacket] {
        self.paths.gather_points.packets()
    }

    /// The lanes of a packet that gather.
    #[inline(always)] // vectorized
    fn gathers(&self, packet: &GatherPacket) -> Mask {
        packet.gathers_of(self.part)
    }
}

/// Flux that is found at the gather points of consecutive packets, and the pairs that it consists
/// of.
struct PacketFlux<'a> {
    /// Number of the first packet.
    first: usize,
    flux: &'a mut [ByClass<Vec3s>],
    /// Flux within half the merge radii; may be empty unless the annulus is recorded.
    inner: &'a mut [ByClass<Vec3s>],
    /// The kernels at the points, where they are known: if pairs are listed.
    kernels: &'a [PointKernels],
    pairs: &'a mut PairList,
}

/// Sums of the camera paths.
struct PathSums<'a> {
    sums: &'a mut [Rgb],
    caustics: &'a mut [Rgb],
    annulus: &'a mut [ByClass<Rgb>],
}

/// The merging of some camera paths.
struct MergePart<'a, 'b, const PAIRS: bool> {
    merge: &'a Merge<'b>,
    paths: &'a CameraPaths,
    part: &'a ops::Range<usize>,
    output: &'a mut MergeOutput,
}

impl<const PAIRS: bool> F32x8Work for MergePart<'_, '_, PAIRS> {
    type Output = bool;

    #[inline(always)]
    fn run<E: F32x8>(self, eight: E) -> bool {
        let Self { merge, paths, part, output } = self;
        let MergeOutput { sums, pairs, caustics, annulus, workspace } = output;
        let sums = &mut PathSums { sums, caustics, annulus };
        if !merge.merge_media::<PAIRS>(paths, part, pairs, sums) {
            return false;
        }
        let batch = &Batch { eight, paths, part };
        if merge.by_zone {
            merge.merge_by_zone::<E, PAIRS>(batch, workspace, pairs, sums)
        } else {
            merge.merge_in_order::<E, PAIRS>(batch, &mut workspace.ranges, pairs, sums)
        }
    }
}

impl<'a> Merge<'a> {
    /// Merges the photons of `map`, which was built for the kernel's reach, with camera paths that
    /// are cut at their diffuse vertex number `merge_vertex`.
    pub fn new(
        map: &'a PhotonMap,
        merge_vertex: u32,
        kernel: MergeKernel<'a>,
        options: MergeOptions,
    ) -> Self {
        let has_caustics = map.has_caustic_photons();
        let kernel = if has_caustics { kernel } else { kernel.without_caustics() };
        let mut admission = kernel.admission();
        // Whatever is recorded, so that layers do not change the order of sums.
        admission.separate_classes = has_caustics;
        let (by_zone, max_pairs) = (map.is_large(), MAX_PAIRS);
        Self { map, merge_vertex, kernel, admission, medium: None, options, by_zone, max_pairs }
    }

    /// Also merges the photons in media, which were prepared for a kernel of this reach or a larger
    /// one.
    #[must_use]
    pub fn with_medium(
        self,
        photons: &'a MediumPhotons,
        kernel: MediumKernel,
        surroundings: Surroundings<'a>,
    ) -> Self {
        Self {
            medium: (!photons.is_empty()).then_some(MediumMerge { photons, kernel, surroundings }),
            ..self
        }
    }

    /// Quantities that are recorded beside the sums, and MIS.
    pub fn options(&self) -> &MergeOptions {
        &self.options
    }

    /// Approximate number of camera paths or gather points that are best merged together.
    pub fn batch_size(&self, lists_pairs: bool) -> usize {
        match (self.by_zone, lists_pairs) {
            (true, true) => ZONE_BATCH_WITH_PAIRS,
            (true, false) => ZONE_BATCH,
            (false, _) => CameraPaths::BATCH,
        }
    }

    /// Sets `output` to the merged light of these camera paths, without pairs.
    pub fn gather(&self, paths: &CameraPaths, output: &mut MergeOutput) {
        output.clear(paths.direct.len(), &self.options);
        self.merge::<false>(paths, &(0..paths.direct.len()), output);
    }

    /// Sets `output` to the merged light of as many gather points, which are numbered in place of
    /// their paths, without other sums.
    pub fn gather_points(&self, paths: &CameraPaths, count: usize, output: &mut MergeOutput) {
        let options =
            MergeOptions { records_annulus: false, records_caustics: false, ..self.options };
        output.clear(count, &options);
        if count > 0 {
            Self { options, ..*self }.merge::<false>(paths, &(0..count), output);
        }
    }

    /// Sets `output` to the merged light of these camera paths with its pairs, and calls `visit`
    /// with the range of camera paths that are complete. It is called once, or several times in the
    /// order of the camera paths if these have more than [`MAX_PAIRS`] pairs.
    pub fn gather_pairs(
        &self,
        paths: &CameraPaths,
        output: &mut MergeOutput,
        mut visit: impl FnMut(&MergeOutput, ops::Range<usize>),
    ) {
        output.clear(paths.direct.len(), &self.options);
        let (mut first, end) = (0, paths.direct.len());
        let mut count = end;
        while first < end {
            let part = first..first.saturating_add(count).min(end);
            output.pairs.clear();
            if self.merge::<true>(paths, &part, output) {
                output.pairs.order_by_path(part.clone());
                visit(output, part.clone());
                first = part.end;
                count = count.saturating_mul(2);
            } else {
                output.clear_part(&part);
                count = part.len().div_ceil(2);
            }
        }
    }

    /// Adds the merged light of a part of the camera paths, and lists pairs if `PAIRS`. Returns
    /// false if it stopped because several camera paths have too many pairs.
    fn merge<const PAIRS: bool>(
        &self,
        paths: &CameraPaths,
        part: &ops::Range<usize>,
        output: &mut MergeOutput,
    ) -> bool {
        by_f32x8(MergePart::<PAIRS> { merge: self, paths, part, output })
    }

    /// Merges packet by packet.
    #[inline(always)] // vectorized
    fn merge_in_order<E: F32x8, const PAIRS: bool>(
        &self,
        batch: &Batch<E>,
        ranges: &mut Ranges,
        pairs: &mut PairList,
        sums: &mut PathSums,
    ) -> bool {
        for (index, packet) in batch.packets().iter().enumerate() {
            self.map.find_ranges(&packet.position, &batch.gathers(packet), ranges);
            if ranges.is_empty() {
                continue;
            }
            let mut kernels = PointKernels::default();
            if PAIRS {
                kernels = self.kernel.at(packet, &ranges.lanes(), NestedRadii::Both);
            }
            let (mut flux, mut inner) = <(ByClass<Vec3s>, ByClass<Vec3s>)>::default();
            let mut found = PacketFlux {
                first: index,
                flux: slice::from_mut(&mut flux),
                inner: slice::from_mut(&mut inner),
                kernels: slice::from_ref(&kernels),
                pairs,
            };
            let query = |lane: usize| self.query(&packet.get(lane), index * LANES + lane);
            self.merge_ranges::<E, PAIRS, PAIRS>(batch, ranges, query, &mut found);
            if PAIRS && self.are_too_many(batch, pairs) {
                return false;
            }
            if !PAIRS {
                kernels = self.kernels_where_lit(packet, &flux);
                self.merge_reduced(batch, index, &kernels, ranges, [&mut flux, &mut inner]);
            }
            self.add_packet(packet, &kernels, &flux, Some(&inner), sums);
        }
        true
    }

    /// Merges zone by zone: all queries in one part of the photon map, which read the same photons,
    /// before those in the next part.
    #[inline(always)] // vectorized
    fn merge_by_zone<E: F32x8, const PAIRS: bool>(
        &self,
        batch: &Batch<E>,
        workspace: &mut Workspace,
        pairs: &mut PairList,
        sums: &mut PathSums,
    ) -> bool {
        let Workspace { queries, ranges, flux, inner, kernels } = workspace;
        let packets = batch.packets();
        queries.sort(
            self.map,
            packets.iter().enumerate().flat_map(|(index, packet)| {
                let gathers = batch.gathers(packet);
                let lanes = (0..LANES).filter(move |&lane| gathers[lane]);
                lanes.map(move |lane| self.query(&packet.get(lane), index * LANES + lane))
            }),
        );
        flux.clear();
        flux.resize(packets.len(), <ByClass<Vec3s>>::default());
        let has_inner = self.options.records_annulus;
        inner.clear();
        inner.resize(if has_inner { packets.len() } else { 0 }, <ByClass<Vec3s>>::default());
        kernels.clear();
        kernels.resize(packets.len(), PointKernels::default());
        if PAIRS {
            for (packet, kernels) in packets.iter().zip(&mut *kernels) {
                let gathers = batch.gathers(packet);
                *kernels = self.kernel.at(packet, &gathers, NestedRadii::Both);
            }
        }
        let mut found = PacketFlux { first: 0, flux, inner, kernels, pairs };
        for queries in queries.batches() {
            let mut positions = Vec3s::default();
            for (lane, query) in queries.iter().enumerate() {
                positions.set(lane, query.position);
            }
            self.map.find_ranges(&positions, &from_fn(|lane| lane < queries.len()), ranges);
            self.merge_ranges::<E, PAIRS, PAIRS>(batch, ranges, |lane| queries[lane], &mut found);
            if PAIRS && self.are_too_many(batch, found.pairs) {
                return false;
            }
        }
        for (index, packet) in packets.iter().enumerate() {
            let (flux, mut inner) = (&mut flux[index], inner.get_mut(index));
            if !PAIRS {
                kernels[index] = self.kernels_where_lit(packet, flux);
                let mut unused = <ByClass<Vec3s>>::default();
                let inner = inner.as_deref_mut().unwrap_or(&mut unused);
                self.merge_reduced(batch, index, &kernels[index], ranges, [flux, inner]);
            }
            self.add_packet(packet, &kernels[index], flux, inner.as_deref(), sums);
        }
        true
    }

    /// The kernels at points with flux: elsewhere they do not matter.
    #[inline(always)] // vectorized
    fn kernels_where_lit(&self, packet: &GatherPacket, flux: &ByClass<Vec3s>) -> PointKernels {
        let lit = from_fn(|lane| flux.iter().any(|flux| flux.get(lane) != Rgb::ZERO));
        let half = self.options.records_annulus;
        let nested = if half { NestedRadii::Half } else { NestedRadii::None };
        self.kernel.at(packet, &lit, nested)
    }

    /// Tests whether there are more pairs than are listed at a time, and several camera paths to
    /// divide.
    fn are_too_many<E>(&self, batch: &Batch<E>, pairs: &PairList) -> bool {
        pairs.len() > self.max_pairs && batch.part.len() > 1
    }

    /// Merges the photons in the ranges of up to sixteen queries; with `DOMAINS`, those of the
    /// kernels' domains.
    #[inline(always)] // vectorized
    fn merge_ranges<E: F32x8, const PAIRS: bool, const DOMAINS: bool>(
        &self,
        batch: &Batch<E>,
        ranges: &Ranges,
        query: impl Fn(usize) -> MergeQuery,
        found: &mut PacketFlux,
    ) {
        for ranges in ranges.by_lane() {
            let query = &query(ranges[0].lane);
            let (packet, lane) =
                (query.point as usize / LANES - found.first, query.point as usize % LANES);
            let kernels = &found.kernels[packet];
            let kernel = kernels.get(lane);
            let flux = if DOMAINS {
                let domain = kernels.domain[lane];
                let search = PointSearch { query: &query.within(domain), ranges, kernel };
                let admission = self.admission.within(domain);
                Self { admission, ..*self }.merge_point::<E, PAIRS>(batch, &search, found.pairs)
            } else {
                let search = PointSearch { query, ranges, kernel };
                self.merge_point::<E, PAIRS>(batch, &search, found.pairs)
            };
            set(&mut found.flux[packet], lane, flux.all);
            if let Some(inner) = found.inner.get_mut(packet) {
                set(inner, lane, flux.inner);
            }
        }
    }

    /// The query of the gather point in the lane of this number.
    #[inline(always)] // vectorized
    fn query(&self, point: &GatherPoint, number: usize) -> MergeQuery {
        let GatherPoint { position, normal, vertex, wavelength, view, facet, .. } = *point;
        let one_by_one = (view != GatherPoint::NO_VIEW) | wavelength.is_some();
        let kind = QueryKind::new(vertex == self.merge_vertex, one_by_one);
        let excluded = self.kernel.excluded_side(facet);
        MergeQuery { position, point: number as u32, normal, kind, excluded, zone: 0 }
    }

    /// Adds the flux at a packet of gather points to their camera paths.
    #[inline(always)] // vectorized
    fn add_packet(
        &self,
        packet: &GatherPacket,
        kernels: &PointKernels,
        flux: &ByClass<Vec3s>,
        inner: Option<&ByClass<Vec3s>>,
        to: &mut PathSums,
    ) {
        let lit: Mask = from_fn(|lane| flux.iter().any(|flux| flux.get(lane) != Rgb::ZERO));
        let (mut weights, mut contributions) = <(Vec3s, Vec3s)>::default();
        for lane in 0..LANES {
            // theory.md (45)
            let weight = packet.weight.get(lane) * kernels.get(lane).inverse_area;
            weights.set(lane, weight);
            contributions.set(lane, weight * kernels.total(lane, flux));
        }
        for lane in (0..LANES).filter(|&lane| packet.gathers[lane] & lit[lane]) {
            let (path, weight) = (packet.path[lane] as usize, weights.get(lane));
            to.sums[path] += contributions.get(lane);
            if self.options.records_caustics && packet.history[lane].diffuse() == 1 {
                let class = PhotonClass::Caustic as usize;
                let caustic = flux[class].get(lane);
                if caustic != Rgb::ZERO {
                    to.caustics[path] += weight * (caustic * kernels.get(lane).relative()[class]);
                }
            }
            if let (true, Some(inner)) = (self.options.records_annulus, inner) {
                // theory.md (71a)
                for (class, to) in to.annulus[path].iter_mut().enumerate() {
                    let [all, inner] = [flux, inner].map(|flux| flux[class].get(lane));
                    if all != Rgb::ZERO {
                        *to += weight * kernels.annulus(lane, class, all, inner);
                    }
                }
            }
        }
    }
}

/// Sets the flux of one lane.
#[inline(always)] // vectorized
fn set(flux: &mut ByClass<Vec3s>, lane: usize, found: ByClass<Rgb>) {
    for (flux, found) in flux.iter_mut().zip(found) {
        flux.set(lane, found);
    }
}

#[cfg(test)]
mod tests;
