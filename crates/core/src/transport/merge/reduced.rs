//! Points that merge again: within smaller radii, where too many triangles are in reach of an area
//! query, or with photons of their own layer, where several are in reach.

use super::super::camera_paths::CameraPaths;
use super::super::kernel::{ByClass, PointKernels};
use super::super::pair_list::PairList;
use super::super::photon_map::Ranges;
use super::{Batch, Merge, PacketFlux};
use crate::simd::f32x8::{F32x8, F32x8Work, by_f32x8};
use crate::simd::{LANES, Mask, Vec3s, any};
use std::{ops, slice};

impl Merge<'_> {
    /// Merges again where the kernels show that not all photons within the radii count.
    #[inline(always)] // vectorized
    pub(super) fn merge_reduced<E>(
        &self,
        batch: &Batch<E>,
        index: usize,
        kernels: &PointKernels,
        ranges: &mut Ranges,
        flux: [&mut ByClass<Vec3s>; 2],
    ) {
        let reduced = kernels.domain.map(|domain| !domain.is_whole());
        if any(&reduced) {
            let Batch { paths, part, .. } = *batch;
            let lanes = (index, reduced);
            merge_again(ReducedLanes { merge: self, paths, part, lanes, kernels, ranges, flux });
        }
    }
}

/// Points of a packet that are merged again, within their domains.
struct ReducedLanes<'a, 'b> {
    merge: &'a Merge<'a>,
    paths: &'a CameraPaths,
    part: &'a ops::Range<usize>,
    /// Index of the packet, and its points.
    lanes: (usize, Mask),
    kernels: &'a PointKernels,
    ranges: &'b mut Ranges,
    /// Flux within the radii and within half of them.
    flux: [&'b mut ByClass<Vec3s>; 2],
}

#[inline(never)] // rare
fn merge_again(reduced: ReducedLanes) {
    by_f32x8(reduced);
}

impl F32x8Work for ReducedLanes<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<E: F32x8>(self, eight: E) {
        let Self { merge, paths, part, lanes: (index, reduced), kernels, ranges, flux } = self;
        let batch = &Batch { eight, paths, part };
        let packet = &batch.packets()[index];
        merge.map.find_ranges(&packet.position, &reduced, ranges);
        let [flux, inner] = flux;
        let mut found = PacketFlux {
            first: index,
            flux: slice::from_mut(flux),
            inner: slice::from_mut(inner),
            kernels: slice::from_ref(kernels),
            pairs: &mut PairList::default(),
        };
        let query = |lane: usize| merge.query(&packet.get(lane), index * LANES + lane);
        merge.merge_ranges::<E, false, true>(batch, ranges, query, &mut found);
    }
}
