//! The photon map: a grid, sorted by counting, that finds every photon within the merge radius once.

mod build;
mod grid;
mod grid_choice;
mod mis_weights;
mod occupancy;
mod quad;
mod queries;

use super::kernel::{Admission, ByClass, PointKernel};
use super::light_paths::LightPaths;
use super::mis::weights::PhotonPartials;
use super::photon::{Extent, Photon};
use crate::base::math::{Bounds, Rgb};
use crate::simd::{LANES, Mask, Vec3s, bits, lanes_of};
use build::{PhotonChunk, PhotonSlices};
use glam::{BVec4A, Vec3, Vec3A};
use grid::Grid;
use occupancy::Occupancy;
use quad::{FluxSum, QUAD, Quad, QuadQuery, lanes_from};
use std::array::from_fn;
use std::ops;
use std::time::{Duration, Instant};

pub(crate) use mis_weights::{PhotonWeights, QuadPartials, Unweighted};
pub(crate) use quad::{NoPairs, PairSink, PointPairs};
pub(crate) use queries::{MergeQueries, MergeQuery, QueryKind};

/// Photons sorted by the cell of a uniform grid. The cells form an array, or are hashed where photons crowd.
#[derive(Debug, Default)]
pub struct PhotonMap {
    /// Sorted by bucket; places without a photon have the position NaN.
    quads: Vec<Quad>,
    /// Packed directions of the photons; empty if no BSDF needs them.
    directions: Vec<u32>,
    /// MIS partials of the photons; empty without MIS.
    mis_partials: Vec<QuadPartials>,
    /// Start of each bucket, and the end of the last one.
    starts: Vec<u32>,
    /// Buffers for sorting, kept for their memory.
    chunks: Vec<PhotonChunk>,
    count: usize,
    grid: Grid,
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
    /// Number of photons in all quads to test.
    #[inline(always)]
    pub fn places(&self) -> usize {
        self.ranges.iter().map(|range| range.quads().len() * QUAD).sum()
    }
}

/// Widens the box of a query past the rounding of distances and coordinates.
const SLACK: f32 = 1.0 + 1e-6;

/// Ranges of photons to test for the queries of up to sixteen lanes, lane by lane.
///
/// Finding the ranges of all lanes before the first photon is read lets the waits for memory overlap.
#[derive(Clone, Debug)]
pub struct Ranges {
    ranges: [Range; LANES * MAX_ROWS],
    count: usize,
}

/// Consecutive photons of the map to test, at least one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Range {
    start: u32,
    end: u32,
    /// Lane of the query.
    pub lane: usize,
}

impl Range {
    /// The quads that it overlaps.
    fn quads(&self) -> ops::Range<usize> {
        self.start as usize / QUAD..(self.end as usize).div_ceil(QUAD)
    }
}

/// Maximum number of ranges of one query: two by two rows of cells, and one more as a row may lie at both ends of the
/// table.
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
    /// Bytes of photons from which on zone by zone is the faster order of queries, measured with 1 MiB of
    /// second-level and 32 MiB of shared third-level cache.
    const CACHE: usize = 1 << 22;

    /// Sorts the photons of `paths` for queries within `radius` on the threads of the current rayon pool, and
    /// reuses the map's memory. Queries find the same photons in the same order for any number of threads.
    /// Returns the time multiplied by the number of threads: none of them does anything else meanwhile.
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
            self.grid = Grid::choose(slices.photons, bounds, radius, count, self.is_sparse);
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
        let mut count = 0;
        let mut push = |range: Range, met: bool| {
            ranges.ranges[count] = range;
            count += usize::from(met & (range.start < range.end));
        };
        for lane in lanes_of(near) {
            for row in &rows {
                let (first, last) = (row.first[lane], row.last[lane]);
                let (start, end) = (self.starts[first as usize], self.starts[last as usize + 1]);
                if first <= last {
                    push(Range { start, end, lane }, row.met[lane]);
                } else {
                    let last_end = self.starts[self.grid.buckets() as usize];
                    push(Range { start, end: last_end, lane }, row.met[lane]);
                    push(Range { start: 0, end, lane }, row.met[lane]);
                }
            }
        }
        ranges.count = count;
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

    /// Zone of a position, below [`queries::ZONES`]; `None` where no photon is near. Queries of one zone read the
    /// same memory.
    #[inline(always)] // vectorized
    fn zone(&self, position: Vec3) -> Option<u16> {
        let [min, max] = self.reach?;
        let position = Vec3A::from(position);
        let near = (position.cmpge(min) & position.cmple(max)).all();
        near.then(|| (self.grid.bucket(self.grid.cell(position)) >> self.zone_shift) as u16)
    }

    /// Calls `visit` once with each photon within the radius of `position`, its edge included, and with the squared
    /// distance. The order depends on the photons and the position only.
    pub fn for_each_within(&self, position: Vec3, mut visit: impl FnMut(&Photon, f32)) {
        let mut ranges = Ranges::default();
        let first = from_fn(|lane| lane == 0);
        self.find_ranges(&Vec3s::splat(position), &first, &mut ranges);
        for ranges in ranges.by_lane() {
            self.for_each_in(ranges, position, |photon, distance2, _| visit(photon, distance2));
        }
    }

    /// Calls `visit` as [`Self::for_each_within`] does, given the ranges of this position, and with the photon's MIS
    /// partials, which are 0 without MIS.
    #[inline]
    pub fn for_each_in(
        &self,
        ranges: &[Range],
        position: Vec3,
        mut visit: impl FnMut(&Photon, f32, PhotonPartials),
    ) {
        for range in ranges {
            let (start, end) = (range.start as usize, range.end as usize);
            // Up to 64 places at a time: bits of those within the radius.
            let mut first = start / QUAD * QUAD;
            while first < end {
                let quads = first / QUAD..(first + 64).min(end).div_ceil(QUAD);
                let mut found = 0;
                for (quad, lane) in self.quads[quads].iter().zip((0..).step_by(QUAD)) {
                    found |= quad.within(position, self.radius2) << lane;
                }
                found &= u64::MAX << start.saturating_sub(first);
                found &= u64::MAX >> (first + 64).saturating_sub(end);
                while found != 0 {
                    let place = first + found.trailing_zeros() as usize;
                    found &= found - 1;
                    let photon = self.photon(place);
                    let of_quad = self.mis_partials.get(place / QUAD).copied().unwrap_or_default();
                    let partials = of_quad.map(|lanes| lanes[place % QUAD]);
                    visit(&photon, photon.position.distance_squared(position), partials);
                }
                first += 64;
            }
        }
    }

    /// Merges the photons of a search that count: returns their flux, and adds each to `pairs`. `ANNULUS` adds the
    /// flux within half the merge radii, which costs a test for each photon.
    #[inline(always)] // vectorized
    pub(crate) fn merge<const ANNULUS: bool>(
        &self,
        search: &PointSearch,
        admission: &Admission,
        weights: &impl PhotonWeights,
        pairs: &mut impl PairSink,
    ) -> MergedFlux {
        let query = QuadQuery::new(search.query, admission, &search.kernel, weights);
        let (mut sum, mut inner) = (FluxSum::default(), FluxSum::default());
        self.for_each_quad(
            search.ranges,
            #[inline(always)]
            |index, quad, lanes| {
                let count = quad.admitted(&query, lanes);
                let weights = weights.of_quad(&self.mis_partials, index, || quad.is_caustic());
                quad.add_to(&mut sum, &query, count, weights);
                if ANNULUS {
                    quad.add_to(&mut inner, &query, count & quad.within_half(&query), weights);
                }
                pairs.add(quad, &query, count, weights);
            },
        );
        MergedFlux { all: sum.total(&query), inner: inner.total(&query) }
    }

    /// Calls `visit` with each quad of the ranges, its index, and its lanes that are in the range.
    #[inline(always)] // vectorized
    fn for_each_quad(&self, ranges: &[Range], mut visit: impl FnMut(usize, &Quad, BVec4A)) {
        for range in ranges {
            let (start, end) = (range.start as usize, range.end as usize);
            let (first, last) = (start / QUAD, (end - 1) / QUAD);
            let mut lanes = lanes_from(start - first * QUAD);
            for (index, quad) in (first..last).zip(&self.quads[first..last]) {
                visit(index, quad, lanes);
                lanes = lanes_from(0);
            }
            visit(last, &self.quads[last], lanes & !lanes_from(end - last * QUAD));
        }
    }

    /// The photon at a place.
    #[inline]
    fn photon(&self, place: usize) -> Photon {
        let photon = self.quads[place / QUAD].get(place % QUAD);
        Photon { from: self.directions.get(place).copied().unwrap_or(0), ..photon }
    }

    /// Tests whether the photons exceed the caches, so that queries in any order wait for memory.
    pub fn is_large(&self) -> bool {
        size_of_val(&self.quads[..]) > Self::CACHE
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

    /// Tests whether there are caustic photons: queries at vertices before the last one find no others.
    pub fn has_caustic_photons(&self) -> bool {
        self.has_caustic_photons
    }
}

#[cfg(test)]
mod tests;
