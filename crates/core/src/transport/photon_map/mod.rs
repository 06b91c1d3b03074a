//! The photon map: a grid, sorted by counting, that finds every photon within the merge radius
//! once.

mod build;
mod grid;
mod grid_choice;
mod mis_weights;
mod occupancy;
mod octet;
mod queries;

use super::kernel::{Admission, ByClass, PointKernel};
use super::light_paths::LightPaths;
use super::mis::weights::PhotonPartials;
use super::photon::{Extent, Photon};
use crate::base::math::{Bounds, Rgb};
use crate::simd::f32x8::{F32x8, Portable};
use crate::simd::{LANES, Mask, Vec3s, bits, lanes_of};
use build::{PhotonChunk, PhotonSlices};
use glam::{Vec3, Vec3A};
use grid::{PhotonGrid, Rows};
use occupancy::Occupancy;
use octet::{FluxSum, OCTET, Octet, OctetQuery};
use std::array::from_fn;
use std::ops;
use std::time::{Duration, Instant};

pub(crate) use mis_weights::{OctetPartials, PhotonWeights, Unweighted};
pub(crate) use octet::{NoPairs, PairSink, PointPairs};
pub(crate) use queries::{MergeQueries, MergeQuery, QueryKind};

/// Photons sorted by the cell of a uniform grid. The cells form an array, or are hashed where
/// photons crowd.
#[derive(Debug, Default)]
pub struct PhotonMap {
    /// Sorted by bucket; places without a photon have the position NaN.
    octets: Vec<Octet>,
    /// Packed directions of the photons; empty if no BSDF needs them.
    directions: Vec<u32>,
    /// MIS partials of the photons; empty without MIS.
    mis_partials: Vec<OctetPartials>,
    /// Start of each bucket, and the end of the last one.
    starts: Vec<u32>,
    /// Buffers for sorting, kept for their memory.
    chunks: Vec<PhotonChunk>,
    count: usize,
    grid: PhotonGrid,
    /// Most queries find no photon, so that it pays to test `occupancy` first.
    is_sparse: bool,
    occupancy: Occupancy,
    /// Buckets of a zone, as a power of two.
    zone_shift: u32,
    radius: f32,
    radius2: f32,
    /// The radius, increased by more than the rounding of distances.
    slack_radius: f32,
    /// Bounding box of the positions that may find photons.
    reach: Option<[Vec3A; 2]>,
    has_caustic_photons: bool,
}

/// Flux that a query merges, W. A uniform [`Admission`] adds all of it to the diffuse class.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MergedFlux {
    /// Flux within the merge radii.
    pub all: ByClass<Rgb>,
    /// Flux within half the merge radii, if the annulus is recorded.
    pub inner: ByClass<Rgb>,
}

/// A query at one gather point, and the photons to test for it.
#[derive(Clone, Copy)]
pub(crate) struct PointSearch<'a> {
    /// Position, normal and photon classes.
    pub query: &'a MergeQuery,
    /// Ranges of photons to test.
    pub ranges: &'a [Range],
    /// The kernel at the point, which pairs are multiplied with. Sums without pairs do not use it.
    pub kernel: PointKernel,
}

impl PointSearch<'_> {
    /// Number of photons in all octets to test.
    #[inline(always)]
    pub fn places(&self) -> usize {
        self.ranges.iter().map(|range| range.octets().len() * OCTET).sum()
    }
}

/// Widens the box of a query past the rounding of distances and coordinates.
const SLACK: f32 = 1.0 + 1e-6;

/// Ranges of photons to test for the queries of up to sixteen lanes, lane by lane.
///
/// Finding the ranges of all lanes before the first photon is read lets the waits for memory
/// overlap.
#[derive(Clone, Debug)]
pub struct Ranges {
    ranges: [Range; LANES * MAX_ROWS],
    count: usize,
}

/// Consecutive octets of the map to test, at least one. No other range of the query has any of
/// them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Range {
    start: u32,
    end: u32,
    /// Lane of the query.
    pub lane: usize,
}

impl Range {
    /// The octets of the photons from `start` to before `end`.
    #[inline(always)]
    fn of(start: u32, end: u32, lane: usize) -> Self {
        Self { start: start / OCTET as u32, end: end.div_ceil(OCTET as u32), lane }
    }

    /// Indices of the octets.
    fn octets(&self) -> ops::Range<usize> {
        self.start as usize..self.end as usize
    }
}

/// Maximum number of ranges of one query: two by two rows of cells, and one more as a row may lie
/// at both ends of the table.
const MAX_ROWS: usize = 5;

impl Default for Ranges {
    fn default() -> Self {
        Self { ranges: [Range::default(); LANES * MAX_ROWS], count: 0 }
    }
}

impl Ranges {
    /// Tests whether no lane has a range.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The lanes that have ranges.
    #[inline(always)]
    pub fn lanes(&self) -> Mask {
        let mut lanes = Mask::default();
        for range in &self.ranges[..self.count] {
            lanes[range.lane] = true;
        }
        lanes
    }

    /// The ranges of each lane that has any.
    #[inline(always)]
    pub fn by_lane(&self) -> impl Iterator<Item = &[Range]> {
        self.ranges[..self.count].chunk_by(|one, next| one.lane == next.lane)
    }
}

impl PhotonMap {
    /// Bytes of photons from which on zone by zone is the faster order of queries, measured with 1
    /// MiB of second-level and 32 MiB of shared third-level cache.
    const CACHE: usize = 1 << 22;

    /// Sorts the photons of `paths` for queries within `radius` on the threads of the current rayon
    /// pool, and reuses the map's memory. Queries find the same photons in the same order for any
    /// number of threads. Returns the time multiplied by the number of threads: none of them does
    /// anything else meanwhile.
    ///
    /// # Panics
    /// If the photons take 2^32 places.
    pub fn build(&mut self, paths: &LightPaths, radius: f32) -> Duration {
        let start = Instant::now();
        let mut mis_partials: Vec<_> = paths.mis_partials().collect();
        if mis_partials.iter().all(|partials| partials.is_empty()) {
            mis_partials.clear();
        }
        let photons = &paths.photons().collect::<Vec<_>>();
        let slices = PhotonSlices { photons, mis_partials: &mis_partials };
        self.build_within(slices, paths.extent(), radius);
        start.elapsed() * rayon::current_num_threads() as u32
    }

    /// Builds the map from slices of photons, without MIS.
    pub fn build_from(&mut self, photons: &[&[Photon]], radius: f32) {
        let extents = photons.iter().map(|photons| Extent::of(photons));
        let extent = extents.fold(Extent::default(), Extent::and);
        self.build_within(PhotonSlices { photons, mis_partials: &[] }, extent, radius);
    }

    fn build_within(&mut self, slices: PhotonSlices, extent: Extent, radius: f32) {
        let Extent { bounds, count, .. } = extent;
        self.radius = radius;
        self.radius2 = radius * radius;
        self.slack_radius = radius * SLACK;
        self.has_caustic_photons = extent.has_caustic_photons;
        self.count = count;
        self.reach = None;
        if count > 0 {
            let Bounds { min, max } = bounds;
            let reach = Vec3::splat(self.slack_radius);
            self.reach = Some([(min - reach).into(), (max + reach).into()]);
            self.is_sparse = Occupancy::pays(bounds, radius, count);
            if self.is_sparse {
                self.occupancy.mark(slices.photons, count, radius);
            }
            self.grid = PhotonGrid::choose(slices.photons, bounds, radius, count, self.is_sparse);
            let shortest = (self.grid.buckets() as usize).div_ceil(queries::ZONES);
            self.zone_shift = shortest.next_power_of_two().ilog2();
            self.sort(slices, &extent);
        }
    }

    /// Sets `ranges` to the photons to test for queries at the positions of the wanted lanes.
    #[inline(always)] // vectorized
    pub fn find_ranges(&self, positions: &Vec3s, wanted: &Mask, ranges: &mut Ranges) {
        let near = self.near(positions, wanted);
        ranges.count = 0;
        if near == 0 {
            return;
        }
        let rows = self.grid.rows(positions, self.slack_radius);
        for lane in lanes_of(near) {
            if self.grid.is_hashed() {
                self.hashed_ranges(lane, &rows, ranges);
            } else {
                self.array_ranges(lane, &rows, ranges);
            }
        }
    }

    /// Adds the ranges of one lane where the cells form an array: its rows are in the order of the
    /// photons.
    ///
    /// All photons of an octet are tested. The photons outside of the row are farther away than the
    /// radius, or in another row. An octet of two rows belongs to the first one.
    #[inline(always)] // vectorized
    fn array_ranges(&self, lane: usize, rows: &[Rows; 4], ranges: &mut Ranges) {
        let mut free = 0;
        for row in rows {
            let start = self.starts[row.first[lane] as usize];
            let end = self.starts[row.last[lane] as usize + 1];
            let octets = Range::of(start, end, lane);
            let range = Range { start: octets.start.max(free), ..octets };
            let is_new = row.met[lane] & (start < end) & (range.start < range.end);
            ranges.ranges[ranges.count] = range;
            ranges.count += usize::from(is_new);
            free = if is_new { range.end } else { free };
        }
    }

    /// Adds the ranges of one lane where cells share buckets: its rows are in any order, and a row
    /// may lie at both ends of the table.
    #[inline(always)] // vectorized
    fn hashed_ranges(&self, lane: usize, rows: &[Rows; 4], ranges: &mut Ranges) {
        let all = self.starts[self.grid.buckets() as usize];
        let before = ranges.count;
        for row in rows {
            let (first, last) = (row.first[lane], row.last[lane]);
            let (start, end) = (self.starts[first as usize], self.starts[last as usize + 1]);
            let parts: &[(u32, u32)] =
                if first <= last { &[(start, end)] } else { &[(start, all), (0, end)] };
            for &(start, end) in parts {
                let mut range = Range::of(start, end, lane);
                // Photons of different rows share the octets at the ends of ranges only.
                for earlier in &ranges.ranges[before..ranges.count] {
                    range.start += u32::from(range.start + 1 == earlier.end);
                    range.end -= u32::from(range.end == earlier.start + 1);
                }
                let is_new = row.met[lane] & (start < end) & (range.start < range.end);
                ranges.ranges[ranges.count] = range;
                ranges.count += usize::from(is_new);
            }
        }
    }

    /// Bits of the wanted lanes that may find photons.
    #[inline(always)] // vectorized
    fn near(&self, positions: &Vec3s, wanted: &Mask) -> u32 {
        let Some([min, max]) = self.reach else { return 0 };
        let inside: Mask = from_fn(|lane| {
            let [x, y, z] = positions.get(lane).to_array();
            let inside = (x >= min.x) & (x <= max.x) & (y >= min.y) & (y <= max.y);
            wanted[lane] & inside & (z >= min.z) & (z <= max.z)
        });
        let near = bits(&inside);
        if self.is_sparse { near & bits(&self.occupancy.may_find(positions)) } else { near }
    }

    /// Zone of a position, below [`queries::ZONES`]; `None` where no photon is near. Queries of one
    /// zone read the same memory.
    #[inline(always)] // vectorized
    fn zone(&self, position: Vec3) -> Option<u16> {
        let [min, max] = self.reach?;
        let position = Vec3A::from(position);
        let near = (position.cmpge(min) & position.cmple(max)).all();
        near.then(|| (self.grid.bucket(self.grid.cell(position)) >> self.zone_shift) as u16)
    }

    /// Calls `visit` once with each photon within the radius of `position`, its edge included, and
    /// with the squared distance. The order depends on the photons and the position only.
    pub fn for_each_within(&self, position: Vec3, mut visit: impl FnMut(&Photon, f32)) {
        let mut ranges = Ranges::default();
        let first = from_fn(|lane| lane == 0);
        self.find_ranges(&Vec3s::splat(position), &first, &mut ranges);
        for ranges in ranges.by_lane() {
            self.for_each_in(ranges, position, |photon, distance2, _| visit(photon, distance2));
        }
    }

    /// Calls `visit` as [`Self::for_each_within`] does, given the ranges of this position, and with
    /// the photon's MIS partials, which are 0 without MIS.
    #[inline]
    pub fn for_each_in(
        &self,
        ranges: &[Range],
        position: Vec3,
        mut visit: impl FnMut(&Photon, f32, PhotonPartials),
    ) {
        for index in ranges.iter().flat_map(Range::octets) {
            let octet = &self.octets[index];
            for lane in lanes_of(octet.within(Portable, position, self.radius2)) {
                let photon = self.photon(OCTET * index + lane);
                let of_octet = self.mis_partials.get(index);
                let partials = of_octet.map_or([0.0; 2], |partials| partials.map(|of| of[lane]));
                visit(&photon, photon.position.distance_squared(position), partials);
            }
        }
    }

    /// Merges the photons of a search that count: returns their flux, and adds each to `pairs`.
    /// `ANNULUS` adds the flux within half the merge radii, which costs a test for each photon.
    #[inline(always)] // vectorized
    pub(crate) fn merge<E: F32x8, const ANNULUS: bool>(
        &self,
        eight: E,
        search: &PointSearch,
        admission: &Admission,
        weights: &impl PhotonWeights,
        pairs: &mut impl PairSink<E>,
    ) -> MergedFlux {
        let query = OctetQuery::new(eight, search.query, admission, &search.kernel, weights);
        let (mut sum, mut inner) = (FluxSum::new(eight), FluxSum::new(eight));
        for range in search.ranges {
            for (index, octet) in range.octets().zip(&self.octets[range.octets()]) {
                let admitted = octet.admitted(&query);
                let is_caustic = octet.is_caustic(eight);
                let weights = weights.of_octet(eight, &self.mis_partials, index, is_caustic);
                octet.add_to(&mut sum, &query, admitted.count, weights);
                if ANNULUS {
                    let within = octet.within_half(&query, &admitted);
                    octet.add_to(&mut inner, &query, within, weights);
                }
                pairs.add(octet, &query, &admitted, weights);
            }
        }
        let inner = if ANNULUS { inner.total(&query) } else { [Rgb::ZERO; 2] };
        MergedFlux { all: sum.total(&query), inner }
    }

    /// The photon at a place.
    #[inline]
    fn photon(&self, place: usize) -> Photon {
        let photon = self.octets[place / OCTET].get(place % OCTET);
        Photon { from: self.directions.get(place).copied().unwrap_or(0), ..photon }
    }

    /// Tests whether the photons exceed the caches, so that queries in any order wait for memory.
    pub fn is_large(&self) -> bool {
        size_of_val(&self.octets[..]) > Self::CACHE
    }

    /// The radius of queries, scene units.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Number of photons.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Tests whether there are no photons.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Tests whether there are caustic photons: queries at vertices before the last one find no
    /// others.
    pub fn has_caustic_photons(&self) -> bool {
        self.has_caustic_photons
    }
}

#[cfg(test)]
mod tests;
