//! The photon map: a counting-sort grid that finds all photons within the merge radius, each once.

mod build;
mod grid_choice;
mod grid;
mod queries;
mod quad;
mod occupancy;
mod mis_weights;

use super::kernel::{Admission, ByClass, PointKernel};
use super::light_paths::LightPaths;
use super::pair_list::PairList;
use super::photon::{Extent, Photon};
use crate::base::math::{Bounds, Rgb};
use crate::simd::dispatch::{Simd, interleave_selected};
use crate::simd::{LANES, Mask, Vec3s, bits, lanes_of};
use build::Chunk;
use glam::{BVec4A, Vec3, Vec3A, Vec4};
use grid::Grid;
use occupancy::Vicinity;
use quad::{Counting, Flux, QUAD, Quad, lanes_from};
use std::array::from_fn;
use std::ops;
use std::time::{Duration, Instant};

pub(crate) use mis_weights::{Unweighted, Weighing, of_quad};
pub(crate) use queries::{LookUp, LookUps};

/// Photons sorted by the cell of a uniform grid: an array of cells, or hashed ones where photons crowd.
#[derive(Debug, Default)]
pub struct PhotonMap {
    /// Sorted by bucket; positions of places without a photon are NaN.
    quads: Vec<Quad>,
    /// Where they came from; empty if that was not told.
    froms: Vec<u32>,
    /// What they carry of their paths' weights; empty if paths are not weighted.
    parts: Vec<f32>,
    /// Where each bucket starts, and the end of all in the last place.
    starts: Vec<u32>,
    /// While sorting, kept for their memory.
    chunks: Vec<Chunk>,
    count: usize,
    grid: Grid,
    /// Whether most look-ups find none, so that it pays to ask `vicinity` first.
    is_sparse: bool,
    vicinity: Vicinity,
    /// Buckets in a zone, as a power of two.
    zone_shift: u32,
    radius: f32,
    radius2: f32,
    /// The radius, widened past rounding.
    slack_radius: f32,
    /// Positions outside see no photons.
    reach: Option<[Vec3A; 2]>,
    has_caustic_photons: bool,
}

/// The flux that a look-up finds, W; all in the last class where both count within the same radius.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Found {
    /// Of all photons that count.
    pub all: ByClass<Rgb>,
    /// Of those within half the merge radius, if that was asked for.
    pub half: ByClass<Rgb>,
}

/// Widens a look-up's box past the rounding of distances and coordinates.
const SLACK: f32 = 1.0 + 1e-6;

/// Where a number of look-ups have to search, in their order.
///
/// Finding that of many look-ups before the first of them searches makes their waits for memory
/// overlap.
#[derive(Clone, Debug)]
pub struct Ranges {
    ranges: [Range; LANES * MOST_ROWS],
    count: usize,
}

/// Consecutive places in the map, one of them at least, that a look-up has to search.
#[derive(Clone, Copy, Debug, Default)]
pub struct Range {
    start: u32,
    end: u32,
    /// The lane that looks it up.
    pub look_up: usize,
}

impl Range {
    /// The quads that have a part of it.
    fn quads(&self) -> ops::Range<usize> {
        self.start as usize / QUAD..(self.end as usize).div_ceil(QUAD)
    }
}

/// Ranges of one look-up: two by two rows of cells, one of which may lie at both ends of the table.
const MOST_ROWS: usize = 5;

impl Default for Ranges {
    fn default() -> Self {
        Self { ranges: [Range::default(); LANES * MOST_ROWS], count: 0 }
    }
}

impl Ranges {
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Which lanes have any.
    #[inline(always)]
    pub fn look_ups(&self) -> Mask {
        let mut look_ups = Mask::default();
        for range in &self.ranges[..self.count] {
            look_ups[range.look_up] = true;
        }
        look_ups
    }

    /// Those of each look-up that has any.
    #[inline(always)]
    pub fn by_look_up(&self) -> impl Iterator<Item = &[Range]> {
        self.ranges[..self.count].chunk_by(|one, next| one.look_up == next.look_up)
    }
}

impl PhotonMap {
    /// Bytes of photons from which on it pays to look them up zone by zone (measured with 1 MiB of
    /// second-level and 32 MiB of shared third-level cache).
    const CACHE: usize = 1 << 22;

    /// Sorts the photons of `paths` for look-ups within `radius` on the threads of the current
    /// rayon pool, reusing the map's memory. Look-ups find the same in the same order for any number of
    /// threads. Returns the time that takes of all of them: none has anything else to do meanwhile.
    ///
    /// # Panics
    /// If there are 2^32 photons or nearly as many.
    pub fn build(&mut self, paths: &LightPaths, radius: f32) -> Duration {
        let start = Instant::now();
        let mut parts: Vec<_> = paths.parts().collect();
        if parts.iter().all(|parts| parts.is_empty()) {
            parts.clear();
        }
        self.build_within(&paths.photons().collect::<Vec<_>>(), &parts, paths.extent(), radius);
        start.elapsed() * rayon::current_num_threads() as u32
    }

    /// [`Self::build`] from slices of photons.
    pub fn build_from(&mut self, slices: &[&[Photon]], radius: f32) {
        let extents = slices.iter().map(|photons| Extent::of(photons));
        self.build_within(slices, &[], extents.fold(Extent::default(), Extent::and), radius);
    }

    fn build_within(
        &mut self,
        slices: &[&[Photon]],
        parts: &[&[f32]],
        extent: Extent,
        radius: f32,
    ) {
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
            self.is_sparse = Vicinity::pays(bounds, radius, count);
            if self.is_sparse {
                self.vicinity.mark(slices, count, radius);
            }
            self.grid = Grid::choose(slices, bounds, radius, count, self.is_sparse);
            let shortest = (self.grid.buckets() as usize).div_ceil(queries::ZONES);
            self.zone_shift = shortest.next_power_of_two().ilog2();
            self.sort(slices, parts, &extent);
        }
    }

    /// Sets `ranges` to where the photons within the radius of these positions are, as far as the
    /// lanes look them up.
    #[inline(always)] // vectorized
    pub fn find_ranges(&self, positions: &Vec3s, looks_up: &Mask, ranges: &mut Ranges) {
        let near = self.near(positions, looks_up);
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
        for look_up in lanes_of(near) {
            for row in &rows {
                let (first, last) = (row.first[look_up], row.last[look_up]);
                let (start, end) = (self.starts[first as usize], self.starts[last as usize + 1]);
                if first <= last {
                    push(Range { start, end, look_up }, row.met[look_up]);
                } else {
                    let last_end = self.starts[self.grid.buckets() as usize];
                    push(Range { start, end: last_end, look_up }, row.met[look_up]);
                    push(Range { start: 0, end, look_up }, row.met[look_up]);
                }
            }
        }
        ranges.count = count;
    }

    /// Which lanes may find photons, a bit for each.
    #[inline(always)] // vectorized
    fn near(&self, positions: &Vec3s, looks_up: &Mask) -> u32 {
        let Some([min, max]) = self.reach else { return 0 };
        let inside: Mask = from_fn(|lane| {
            let [x, y, z] = positions.get(lane).to_array();
            let inside = (x >= min.x) & (x <= max.x) & (y >= min.y) & (y <= max.y);
            looks_up[lane] & inside & (z >= min.z) & (z <= max.z)
        });
        let near = bits(&inside);
        if self.is_sparse { near & bits(&self.vicinity.is_near(positions)) } else { near }
    }

    /// Look-ups of one zone search the same memory: a number below [`queries::ZONES`], or `None`
    /// where there are no photons.
    #[inline(always)] // vectorized
    fn zone(&self, position: Vec3) -> Option<u16> {
        let [min, max] = self.reach?;
        let position = Vec3A::from(position);
        let near = (position.cmpge(min) & position.cmple(max)).all();
        near.then(|| (self.grid.bucket(self.grid.cell(position)) >> self.zone_shift) as u16)
    }

    /// Calls `visit` once with each photon within the radius of `position` (its edge included) and
    /// its squared distance, in an order that depends on the photons and the position only.
    pub fn for_each_within(&self, position: Vec3, mut visit: impl FnMut(&Photon, f32)) {
        let mut ranges = Ranges::default();
        let first = from_fn(|lane| lane == 0);
        self.find_ranges(&Vec3s::splat(position), &first, &mut ranges);
        for ranges in ranges.by_look_up() {
            self.for_each_in(ranges, position, |photon, distance2, _| visit(photon, distance2));
        }
    }

    /// [`Self::for_each_within`] by the ranges of this position, and each photon's part of its path's
    /// weight, 0 without weights.
    #[inline]
    pub fn for_each_in(
        &self,
        ranges: &[Range],
        position: Vec3,
        mut visit: impl FnMut(&Photon, f32, f32),
    ) {
        for range in ranges {
            let (start, end) = (range.start as usize, range.end as usize);
            // Up to 64 places at a time, a bit for each that is within the radius.
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
                    let part = self.parts.get(place).copied().unwrap_or(0.0);
                    visit(&photon, photon.position.distance_squared(position), part);
                }
                first += 64;
            }
        }
    }

    /// The flux of the photons in the ranges of a look-up that it counts, wherever they come from.
    #[inline(always)] // vectorized
    pub(crate) fn flux_in<const HALF: bool>(
        &self,
        ranges: &[Range],
        look_up: &LookUp,
        admission: &Admission,
        weighing: &impl Weighing,
    ) -> Found {
        let counting = Counting::new(look_up, admission, &PointKernel::default(), weighing);
        let (mut sum, mut half) = (Flux::default(), Flux::default());
        self.for_each_block(
            ranges,
            #[inline(always)]
            |index, quad, lanes| {
                let counts = quad.counting(&counting, lanes);
                let weights = weighing.weights(&self.parts, index);
                quad.add_to(&mut sum, &counting, counts, weights);
                if HALF {
                    let near = counts & quad.within_half(&counting);
                    quad.add_to(&mut half, &counting, near, weights);
                }
            },
        );
        Found { all: sum.total(&counting), half: half.total(&counting) }
    }

    /// [`Self::flux_in`], and adds to `pairs` those of the same photons with a camera path, for which the
    /// luminance that they contribute is the scalar product of their flux and a weight.
    #[inline(always)] // vectorized
    pub(crate) fn pairs_in<const HALF: bool>(
        &self,
        simd: Simd,
        ranges: &[Range],
        look_up: &LookUp,
        (admission, kernel): (&Admission, &PointKernel),
        weighing: &impl Weighing,
        (camera_path, weight, pairs): (u32, Rgb, &mut PairList),
    ) -> Found {
        let counting = Counting::new(look_up, admission, kernel, weighing);
        let (mut sum, mut half) = (Flux::default(), Flux::default());
        let mut nested = [Vec4::ZERO; 2];
        let places: usize = ranges.iter().map(|range| range.quads().len() * QUAD).sum();
        let (space, mut found) = (pairs.space(places), 0);
        self.for_each_block(
            ranges,
            #[inline(always)]
            |index, quad, lanes| {
                let counts = quad.counting(&counting, lanes);
                let weights = weighing.weights(&self.parts, index);
                quad.add_to(&mut sum, &counting, counts, weights);
                if HALF {
                    let near = counts & quad.within_half(&counting);
                    quad.add_to(&mut half, &counting, near, weights);
                }
                let (light_paths, values) = quad.pairs(&counting, weight);
                let values = weights.map_or(values, |weights| values * weights);
                for (sum, nested) in nested.iter_mut().zip(quad.nested(&counting, values)) {
                    *sum += Vec4::select(counts, nested, Vec4::ZERO);
                }
                // All are written, but only those that count are kept: how many nobody foresees.
                let counts = counts.bitmask();
                let values = values.to_array().map(f32::to_bits);
                let together = interleave_selected(simd, counts, light_paths, values);
                space[found..found + QUAD].copy_from_slice(bytemuck::cast_slice(&together));
                found += counts.count_ones() as usize;
            },
        );
        if found > 0 {
            pairs.take(found, camera_path, nested.map(Vec4::element_sum));
        }
        Found { all: sum.total(&counting), half: half.total(&counting) }
    }

    /// The quads of some ranges with their numbers, and which of their lanes are in them.
    #[inline(always)] // vectorized
    fn for_each_block(&self, ranges: &[Range], mut visit: impl FnMut(usize, &Quad, BVec4A)) {
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
        Photon { from: self.froms.get(place).copied().unwrap_or(0), ..photon }
    }

    /// Whether look-ups in any order wait for memory.
    pub fn is_large(&self) -> bool {
        size_of_val(&self.quads[..]) > Self::CACHE
    }

    /// The radius of look-ups, scene units.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Number of photons.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there are no photons.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Whether look-ups at vertices before the last can find anything.
    pub fn has_caustic_photons(&self) -> bool {
        self.has_caustic_photons
    }
}

#[cfg(test)]
mod tests;
