//! The photon map: a counting-sort grid that finds all photons within the merge radius, each once.

mod build;
mod grid;

use crate::light_paths::LightPaths;
use crate::math::{Bounds, Rgb};
use crate::photon::{Photon, Side};
use build::{Chunk, Extent};
use glam::{Vec3, Vec3A, Vec4};
use grid::Grid;

/// Photons sorted by the cell of a uniform grid, cells hashed into buckets.
///
/// Positions lie apart from the rest, which is read of photons within the radius only.
#[derive(Debug, Default)]
pub struct PhotonMap {
    /// Positions, sorted by bucket; places without a photon are NaN.
    blocks: Vec<Block>,
    /// What they carry.
    lights: Vec<Light>,
    /// Their light paths.
    paths: Vec<u32>,
    /// Where they came from; empty if that was not told.
    froms: Vec<u32>,
    /// Where each bucket starts, and the end of all in the last place.
    starts: Vec<u32>,
    /// While sorting, kept for their memory.
    chunks: Vec<Chunk>,
    count: usize,
    grid: Grid,
    radius: f32,
    radius2: f32,
    /// The radius, widened past rounding.
    slack_radius: f32,
    /// Positions outside see no photons.
    reach: Option<[Vec3A; 2]>,
    any_at_every_vertex: bool,
}

/// Widens a look-up's box past the rounding of distances and coordinates.
const SLACK: f32 = 1.0 + 1e-6;

/// Positions whose distance is tested at once.
const LANES: usize = 4;

/// Coordinates of [`LANES`] photons.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(16))]
struct Block([[f32; LANES]; 3]);

impl Block {
    #[inline]
    fn set(&mut self, lane: usize, position: Vec3) {
        for (lanes, coordinate) in self.0.iter_mut().zip(position.to_array()) {
            lanes[lane] = coordinate;
        }
    }

    #[inline]
    fn get(&self, lane: usize) -> Vec3 {
        Vec3::from_array(self.0.map(|lanes| lanes[lane]))
    }

    /// The lanes within a distance of `center`, a bit for each.
    #[inline]
    fn within(&self, center: [Vec4; 3], radius2: Vec4) -> u64 {
        let [x, y, z] = self.0.map(Vec4::from_array);
        let (dx, dy, dz) = (x - center[0], y - center[1], z - center[2]);
        // In the order of `Vec3::distance_squared`.
        (dx * dx + dy * dy + dz * dz).cmple(radius2).bitmask().into()
    }
}

/// What is read of each photon that is found.
#[derive(Clone, Copy, Debug, Default)]
struct Light {
    flux: Rgb,
    side: Side,
}

impl Light {
    #[inline]
    fn of(photon: &Photon) -> Self {
        Self { flux: photon.flux, side: photon.side }
    }
}

/// Where a number of look-ups have to search, in their order.
///
/// Finding that of many look-ups before the first of them searches makes their waits for memory
/// overlap.
#[derive(Clone, Debug)]
pub struct Ranges {
    ranges: [Range; Self::LOOK_UPS * MOST_ROWS],
    count: usize,
}

/// Consecutive places in the map, one of them at least, that a look-up has to search.
#[derive(Clone, Copy, Debug, Default)]
pub struct Range {
    start: u32,
    end: u32,
    /// Number of the look-up among those that were asked for together.
    pub look_up: u32,
}

/// Ranges of one look-up: two by two rows of cells, one of which may lie at both ends of the table.
const MOST_ROWS: usize = 5;

impl Default for Ranges {
    fn default() -> Self {
        Self { ranges: [Range::default(); Self::LOOK_UPS * MOST_ROWS], count: 0 }
    }
}

impl Ranges {
    /// Most look-ups at once.
    pub const LOOK_UPS: usize = 32;

    /// All ranges.
    #[inline]
    pub fn as_slice(&self) -> &[Range] {
        &self.ranges[..self.count]
    }

    /// Adds a range if it is `met` and not empty.
    #[inline]
    fn push(&mut self, range: Range, met: bool) {
        self.ranges[self.count] = range;
        self.count += usize::from(met & (range.start < range.end));
    }
}

impl PhotonMap {
    /// Sorts the photons of `paths` for look-ups within `radius` on the threads of the current
    /// rayon pool, reusing the map's memory. Look-ups find the same in the same order for any number of
    /// threads.
    ///
    /// # Panics
    /// If there are 2^32 photons or nearly as many.
    pub fn build(&mut self, paths: &LightPaths, radius: f32) {
        self.build_from(&paths.photons().collect::<Vec<_>>(), radius);
    }

    /// [`Self::build`] from slices of photons.
    pub fn build_from(&mut self, slices: &[&[Photon]], radius: f32) {
        let extent = Extent::new(slices);
        let Extent { bounds, count, .. } = extent;
        self.radius = radius;
        self.radius2 = radius * radius;
        self.slack_radius = radius * SLACK;
        self.any_at_every_vertex = extent.any_at_every_vertex;
        self.count = count;
        self.reach = None;
        if count > 0 {
            let Bounds { min, max } = bounds;
            let reach = Vec3::splat(self.slack_radius);
            self.reach = Some([(min - reach).into(), (max + reach).into()]);
            self.grid = Grid::new(bounds, radius, count);
            self.sort(slices, &extent);
        }
    }

    /// Sets `ranges` to where the photons within the radius of `positions` are.
    ///
    /// # Panics
    /// If there are more than there is room for; [`Ranges::LOOK_UPS`] always fit.
    #[inline]
    pub fn find_ranges(&self, positions: impl Iterator<Item = Vec3>, ranges: &mut Ranges) {
        ranges.count = 0;
        let Some([min, max]) = self.reach else { return };
        for (position, look_up) in positions.map(Vec3A::from).zip(0..) {
            if !(position.cmpge(min) & position.cmple(max)).all() {
                continue;
            }
            let low = self.grid.cell(position - self.slack_radius);
            let high = self.grid.cell(position + self.slack_radius);
            for (first, last, met) in self.grid.rows(low, high) {
                let (start, end) = (self.starts[first as usize], self.starts[last as usize + 1]);
                if first <= last {
                    ranges.push(Range { start, end, look_up }, met);
                } else {
                    let last_end = self.starts[self.grid.buckets() as usize];
                    ranges.push(Range { start, end: last_end, look_up }, met);
                    ranges.push(Range { start: 0, end, look_up }, met);
                }
            }
        }
    }

    /// Calls `visit` once with each photon within the radius of `position` (its edge included) and
    /// its squared distance, in an order that depends on the photons and the position only.
    pub fn for_each_within(&self, position: Vec3, mut visit: impl FnMut(&Photon, f32)) {
        let mut ranges = Ranges::default();
        self.find_ranges(std::iter::once(position), &mut ranges);
        for range in ranges.as_slice() {
            self.for_each_in(range, position, &mut visit);
        }
    }

    /// The part of [`Self::for_each_within`] that is in one range of this position.
    #[inline]
    pub fn for_each_in(&self, range: &Range, position: Vec3, mut visit: impl FnMut(&Photon, f32)) {
        let center = position.to_array().map(Vec4::splat);
        let radius2 = Vec4::splat(self.radius2);
        let (start, end) = (range.start as usize, range.end as usize);
        // Up to 64 places at a time, a bit for each that is within the radius.
        let mut first = start / LANES * LANES;
        while first < end {
            let blocks = first / LANES..(first + 64).min(end).div_ceil(LANES);
            let mut found = 0;
            for (block, lane) in self.blocks[blocks].iter().zip((0..).step_by(LANES)) {
                found |= block.within(center, radius2) << lane;
            }
            found &= u64::MAX << start.saturating_sub(first);
            found &= u64::MAX >> (first + 64).saturating_sub(end);
            while found != 0 {
                let place = first + found.trailing_zeros() as usize;
                found &= found - 1;
                let photon = self.photon(place);
                visit(&photon, photon.position.distance_squared(position));
            }
            first += 64;
        }
    }

    /// The photon at a place; what is not needed of it is not read.
    #[inline]
    fn photon(&self, place: usize) -> Photon {
        let Light { flux, side } = self.lights[place];
        Photon {
            position: self.blocks[place / LANES].get(place % LANES),
            path: self.paths[place],
            flux,
            side,
            from: self.froms.get(place).copied().unwrap_or(0),
        }
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
    pub fn any_at_every_vertex(&self) -> bool {
        self.any_at_every_vertex
    }
}

#[cfg(test)]
mod tests;
