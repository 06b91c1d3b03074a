//! The photon map: a counting-sort grid that finds all photons within the merge radius, each once.

mod build;
mod grid;

use crate::light_paths::{LightPaths, Photon, PhotonClass};
use crate::math::{Bounds, Rgb};
use build::{Chunk, Extent};
use glam::{IVec3, Vec3, Vec4};
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
    reach: Option<Bounds>,
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
    normal: [i8; 3],
    class: PhotonClass,
}

impl Light {
    #[inline]
    fn of(photon: &Photon) -> Self {
        Self { flux: photon.flux, normal: photon.normal, class: photon.class }
    }
}

/// The ranges of places to be searched around one position.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rows {
    ranges: [[u32; 2]; MOST_ROWS],
    count: usize,
}

/// Two by two, of which one may lie at both ends of the table.
const MOST_ROWS: usize = 5;

impl Rows {
    #[inline]
    fn push(&mut self, start: u32, end: u32, valid: bool) {
        self.ranges[self.count] = [start, end];
        self.count += usize::from(valid && start < end);
    }
}

impl PhotonMap {
    /// Sorts the photons of `paths` for look-ups within `radius` on the threads of the current
    /// rayon pool, reusing the map's memory. The map is the same for any number of threads.
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
            let reach = Vec3::splat(self.slack_radius);
            self.reach = Some(Bounds { min: bounds.min - reach, max: bounds.max + reach });
            self.grid = Grid::new(bounds, radius, count);
            self.sort(slices, &extent);
        }
    }

    /// Where the photons within the radius of `position` lie.
    #[inline]
    pub fn rows(&self, position: Vec3) -> Rows {
        let mut rows = Rows::default();
        let inside = self.reach.is_some_and(|reach| {
            position.cmpge(reach.min).all() && position.cmple(reach.max).all()
        });
        if !inside {
            return rows;
        }
        let low = self.grid.cell(position - self.slack_radius);
        let high = self.grid.cell(position + self.slack_radius);
        for z in [low.z, low.z + 1] {
            for y in [low.y, low.y + 1] {
                let valid = y <= high.y && z <= high.z;
                let first = self.grid.bucket(IVec3::new(low.x, y, z));
                let last = self.grid.bucket(IVec3::new(high.x, y, z));
                let (start, end) = (self.starts[first as usize], self.starts[last as usize + 1]);
                if first <= last {
                    rows.push(start, end, valid);
                } else {
                    // The row lies at the two ends of the table.
                    rows.push(start, self.starts[self.grid.buckets()], valid);
                    rows.push(0, end, valid);
                }
            }
        }
        rows
    }

    /// Calls `visit` once with each photon within the radius of `position` (its edge included) and
    /// its squared distance, in an order that depends on the photons and the position only.
    #[inline]
    pub fn for_each_within(&self, position: Vec3, visit: impl FnMut(&Photon, f32)) {
        self.for_each_in(&self.rows(position), position, visit);
    }

    /// [`Self::for_each_within`] for the rows of `position`.
    #[inline]
    pub fn for_each_in(&self, rows: &Rows, position: Vec3, mut visit: impl FnMut(&Photon, f32)) {
        let center = position.to_array().map(Vec4::splat);
        let radius2 = Vec4::splat(self.radius2);
        for &[start, end] in &rows.ranges[..rows.count] {
            let (start, end) = (start as usize, end as usize);
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
    }

    /// The photon at a place; what is not needed of it is not read.
    #[inline]
    fn photon(&self, place: usize) -> Photon {
        let Light { flux, normal, class } = self.lights[place];
        Photon {
            position: self.blocks[place / LANES].get(place % LANES),
            path: self.paths[place],
            flux,
            normal,
            class,
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
