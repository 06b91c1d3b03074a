//! Merge queries sorted so that neighbors read the same photons.

use super::PhotonMap;
use crate::simd::LANES;
use crate::transport::area::Domain;
use crate::transport::photon::{Arrival, PhotonSide};
use glam::Vec3;

/// Maximum number of zones of a map: sorting writes to as many places in turn.
pub(super) const ZONES: usize = 4096;

/// A search for the photons of one gather point.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(32))] // half a cache line
pub struct MergeQuery {
    /// Center of the search, scene units.
    pub position: Vec3,
    /// Number of the gather point's lane among the lanes of all packets.
    pub point: u32,
    /// Unit normal on the side that the camera path sees: photons that arrived on that side count.
    pub normal: Vec3,
    /// Which photons count, and how.
    pub kind: QueryKind,
    /// Photons on this side do not count: the other side of the point's surface.
    pub excluded: PhotonSide,
    /// Zone of the position; set by [`MergeQueries::sort`].
    pub zone: u16,
}

impl MergeQuery {
    /// The query for the photons of a domain.
    #[must_use]
    #[inline(always)] // vectorized, as the functions below
    pub fn within(&self, domain: Domain) -> Self {
        let own_layer = u8::from(domain.is_own_layer()) << 2;
        Self { kind: QueryKind(self.kind.0 | own_layer), ..*self }
    }

    /// The only side whose photons count, if there is one.
    #[inline(always)]
    pub fn only_side(&self) -> Option<PhotonSide> {
        (self.kind.0 & 4 != 0).then(|| self.excluded.opposite())
    }

    /// Tests whether photons on the side of one that arrived count.
    #[inline(always)]
    pub(crate) fn admits_side(&self, arrival: Arrival) -> bool {
        match self.only_side() {
            Some(side) => arrival.is_on(side),
            None => !arrival.is_on(self.excluded),
        }
    }
}

/// Which photons count in a query, and how. (In one byte: a query is half a cache line.)
#[derive(Clone, Copy, Debug, Default)]
pub struct QueryKind(u8);

impl QueryKind {
    /// Photons of all classes count, not only caustic photons; photons are merged one by one.
    #[inline(always)] // vectorized, as the functions below
    pub fn new(all_classes: bool, one_by_one: bool) -> Self {
        Self(u8::from(all_classes) | u8::from(one_by_one) << 1)
    }

    /// Photons of all classes count.
    #[inline(always)]
    pub fn all_classes(self) -> bool {
        self.0 & 1 != 0
    }

    /// Photons are merged one by one: the BSDF depends on their directions, or the camera path has
    /// a wavelength.
    #[inline(always)]
    pub fn is_one_by_one(self) -> bool {
        self.0 & 2 != 0
    }
}

/// Merge queries zone by zone; buffers are reused.
#[derive(Debug, Default)]
pub struct MergeQueries {
    sorted: Vec<MergeQuery>,
    unsorted: Vec<MergeQuery>,
}

impl MergeQueries {
    /// Replaces the queries by those of `queries` that may find photons in `map`.
    #[inline(always)] // vectorized
    pub fn sort(&mut self, map: &PhotonMap, queries: impl Iterator<Item = MergeQuery>) {
        let Self { sorted, unsorted } = self;
        let mut starts = [0u32; ZONES + 1];
        unsorted.clear();
        unsorted.extend(queries.filter_map(|query| {
            let zone = map.zone(query.position)?;
            starts[usize::from(zone) + 1] += 1;
            Some(MergeQuery { zone, ..query })
        }));
        for zone in 1..ZONES {
            starts[zone] += starts[zone - 1];
        }
        sorted.resize(unsorted.len(), MergeQuery::default());
        for query in unsorted {
            let next = &mut starts[usize::from(query.zone)];
            sorted[*next as usize] = *query;
            *next += 1;
        }
    }

    /// The queries in batches of up to sixteen.
    pub fn batches(&self) -> impl Iterator<Item = &[MergeQuery]> {
        self.sorted.chunks(LANES)
    }
}
