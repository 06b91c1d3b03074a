//! The photon map: a counting-sort grid that finds all photons within the merge radius, each once.

use crate::light_paths::{LightPaths, Photon, PhotonClass};
use crate::math::Bounds;
use glam::{IVec3, Vec3};

/// Photons sorted by the cell of a uniform grid, cells hashed into buckets.
///
/// A cell is slightly wider than a look-up's sphere, so that a look-up meets at most two cells per
/// axis. The bucket of cell `(x, y, z)` is `x + y * stride_y + z * stride_z`, modulo the number of
/// buckets: the two cells along x are neighbors in the sorted array, and a look-up reads four
/// ranges of it. Where the whole grid fits, the strides are those of an array and every cell has
/// its own bucket. Otherwise they are chosen so that the four ranges of a look-up never overlap,
/// and no photon is met twice; photons of other cells in the same bucket fail the distance test.
#[derive(Debug, Default)]
pub struct PhotonMap {
    /// Sorted by bucket; within a bucket by light path.
    photons: Vec<Photon>,
    /// Where each bucket starts in `photons`, and its end in the last place.
    starts: Vec<u32>,
    /// Bucket of each photon in path order, kept for its memory.
    buckets: Vec<u32>,
    grid: Grid,
    radius: f32,
    radius2: f32,
    /// The radius, widened past rounding.
    slack_radius: f32,
    /// Positions outside see no photons.
    reach: Option<Bounds>,
    any_at_every_vertex: bool,
}

/// Cells relative to the corner of the photons' bounding box.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Grid {
    corner: Vec3,
    inverse_cell: f32,
    stride_y: u32,
    stride_z: u32,
    /// Number of buckets less one: a power of two less one, or all ones where the grid is an array.
    mask: u32,
}

/// Widens a look-up's box past the rounding of distances and coordinates.
const SLACK: f32 = 1.0 + 1e-6;
/// Width of a cell over the diameter of a look-up: room for the rounding of cell coordinates.
const CELL_MARGIN: f32 = 1.01;
/// Smallest width of a cell over the largest coordinate: keeps cell coordinates exact enough for
/// the margin (their errors add up to 6 half units in the last place, 0.4 % of a cell).
const MIN_CELL: f32 = 1e-4;
/// A grid of up to this many cells is an array, however few the photons (its starts take 1 MiB).
const ARRAY_CELLS: usize = 1 << 18;
/// Buckets per photon beyond that.
const BUCKETS_PER_PHOTON: usize = 4;

impl Grid {
    fn new(bounds: Bounds, radius: f32, photons: usize) -> Self {
        let largest = bounds.min.abs().max(bounds.max.abs()).max_element();
        let cell = (2.0 * radius * SLACK * CELL_MARGIN).max(largest * MIN_CELL);
        // A look-up may reach one cell beyond the photons on each side.
        let corner = bounds.min - Vec3::splat(cell);
        let inverse_cell = cell.recip();
        let cells = ((bounds.max - corner) * inverse_cell).ceil() + 2.0;
        let array = cells.as_dvec3().element_product() as usize;
        if array <= ARRAY_CELLS.max(BUCKETS_PER_PHOTON * photons).min(1 << 30) {
            let stride_y = cells.x as u32;
            let stride_z = stride_y * cells.y as u32;
            return Self { corner, inverse_cell, stride_y, stride_z, mask: u32::MAX };
        }
        let buckets = (BUCKETS_PER_PHOTON * photons).next_power_of_two().clamp(64, 1 << 30);
        // Odd strides at fractions of the table after the plastic number's powers: rows of cells
        // spread evenly, and neighboring rows are at least 12 % of the table apart (tested).
        let stride = |fraction: f64| (buckets as f64 * fraction) as u32 | 1;
        let (stride_y, stride_z) = (stride(0.754_877_666), stride(0.569_840_291));
        Self { corner, inverse_cell, stride_y, stride_z, mask: buckets as u32 - 1 }
    }

    /// Coordinates of photons and within reach of them are positive: truncating rounds down.
    #[inline]
    fn cell(&self, position: Vec3) -> IVec3 {
        ((position - self.corner) * self.inverse_cell).as_ivec3()
    }

    #[inline]
    fn bucket(&self, cell: IVec3) -> u32 {
        let row = (cell.y as u32).wrapping_mul(self.stride_y);
        let layer = (cell.z as u32).wrapping_mul(self.stride_z);
        (cell.x as u32).wrapping_add(row).wrapping_add(layer) & self.mask
    }
}

impl PhotonMap {
    /// Sorts the photons of `paths` for look-ups within `radius`, reusing the map's memory.
    pub fn build(&mut self, paths: &LightPaths, radius: f32) {
        self.build_from(paths.photons(), radius);
    }

    /// [`Self::build`] from slices of photons in path order.
    ///
    /// # Panics
    /// If there are 2^32 photons or more.
    pub fn build_from<'a>(
        &mut self,
        slices: impl Iterator<Item = &'a [Photon]> + Clone,
        radius: f32,
    ) {
        let photons = || slices.clone().flatten();
        let mut bounds = Bounds::EMPTY;
        let mut count = 0usize;
        self.any_at_every_vertex = false;
        for photon in photons() {
            bounds = bounds.with(photon.position);
            count += 1;
            self.any_at_every_vertex |= photon.class() == PhotonClass::EveryVertex;
        }
        assert!(u32::try_from(count).is_ok(), "the photon map holds fewer than 2^32 photons");
        self.radius = radius;
        self.radius2 = radius * radius;
        self.photons.clear();
        if count == 0 {
            self.reach = None;
            return;
        }
        self.slack_radius = radius * SLACK;
        let reach = Vec3::splat(self.slack_radius);
        self.reach = Some(Bounds { min: bounds.min - reach, max: bounds.max + reach });
        self.grid = Grid::new(bounds, radius, count);

        // Counting sort: sizes, running sum, each photon into its place. Sizes are kept two places
        // ahead and places handed out one ahead, so that `starts` ends as it is read.
        self.buckets.clear();
        self.buckets
            .extend(photons().map(|photon| self.grid.bucket(self.grid.cell(photon.position))));
        let last = match self.grid.mask {
            // Array: a look-up may read one layer, row and cell past the last photon's.
            u32::MAX => self.grid.bucket(self.grid.cell(bounds.max) + 1),
            mask => mask,
        };
        self.starts.clear();
        self.starts.resize(last as usize + 3, 0);
        for &bucket in &self.buckets {
            self.starts[bucket as usize + 2] += 1;
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        let filler = *photons().next().expect("there is a photon");
        self.photons.resize(count, filler);
        for (photon, &bucket) in photons().zip(&self.buckets) {
            let next = &mut self.starts[bucket as usize + 1];
            self.photons[*next as usize] = *photon;
            *next += 1;
        }
        self.starts.pop();
    }

    /// Calls `visit` once with each photon within the radius of `position` (its edge included) and
    /// its squared distance, in an order that depends on the photons and the position only.
    #[inline]
    pub fn for_each_within(&self, position: Vec3, mut visit: impl FnMut(&Photon, f32)) {
        let inside = self.reach.is_some_and(|reach| {
            position.cmpge(reach.min).all() && position.cmple(reach.max).all()
        });
        if !inside {
            return;
        }
        let low = self.grid.cell(position - self.slack_radius);
        let high = self.grid.cell(position + self.slack_radius);
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                let first = self.grid.bucket(IVec3::new(low.x, y, z));
                let last = self.grid.bucket(IVec3::new(high.x, y, z));
                if first <= last {
                    self.scan(first, last, position, &mut visit);
                } else {
                    // The two cells lie at the two ends of the table.
                    self.scan(first, first, position, &mut visit);
                    self.scan(last, last, position, &mut visit);
                }
            }
        }
    }

    /// Visits what is close enough in the buckets `first..=last`.
    #[inline]
    fn scan(&self, first: u32, last: u32, position: Vec3, visit: &mut impl FnMut(&Photon, f32)) {
        let range = self.starts[first as usize] as usize..self.starts[last as usize + 1] as usize;
        for photon in &self.photons[range] {
            let distance2 = photon.position.distance_squared(position);
            if distance2 <= self.radius2 {
                visit(photon, distance2);
            }
        }
    }

    /// The radius of look-ups, scene units.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Number of photons.
    pub fn len(&self) -> usize {
        self.photons.len()
    }

    /// Whether there are no photons.
    pub fn is_empty(&self) -> bool {
        self.photons.is_empty()
    }

    /// Whether look-ups at vertices before the last can find anything.
    pub fn any_at_every_vertex(&self) -> bool {
        self.any_at_every_vertex
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, StreamKey};

    fn photon(position: Vec3, path: usize) -> Photon {
        Photon::new(position, path as u32, Vec3::ONE, Vec3::Z, PhotonClass::LastVertex)
    }

    /// Looks up every query and compares with a search of all photons by the same distance test.
    #[track_caller]
    fn assert_exact(photons: &[Photon], queries: &[Vec3], radius: f32) -> usize {
        let mut map = PhotonMap::default();
        // Two slices, as from two batches.
        let (front, back) = photons.split_at(photons.len() / 3);
        map.build_from([front, back].into_iter(), radius);
        let mut found_in_all = 0;
        for &query in queries {
            let mut found = Vec::new();
            map.for_each_within(query, |photon, _| found.push(photon.path));
            found.sort_unstable();
            let near = |p: &&Photon| p.position.distance_squared(query) <= radius * radius;
            let expected: Vec<u32> = photons.iter().filter(near).map(|p| p.path).collect();
            assert_eq!(found, expected, "around {query} within {radius}");
            found_in_all += found.len();
        }
        found_in_all
    }

    /// Points in a box, half of them on its floor as on a surface.
    fn points(count: u64, corner: Vec3, size: Vec3, seed: u64) -> Vec<Vec3> {
        let key = StreamKey::new(seed, Stream::Test, 0);
        let point = |index| {
            let mut rng = key.rng(index);
            let height = if index % 2 == 0 { rng.next_1d() } else { 0.0 };
            corner + size * Vec3::new(rng.next_1d(), rng.next_1d(), height)
        };
        (0..count).map(point).collect()
    }

    fn photons(positions: &[Vec3]) -> Vec<Photon> {
        positions.iter().enumerate().map(|(path, &position)| photon(position, path)).collect()
    }

    #[test]
    fn finds_what_a_search_of_all_photons_finds() {
        let boxes = [
            (Vec3::ZERO, Vec3::splat(556.0)),
            (Vec3::new(-3.0, 20.0, -7e3), Vec3::new(1e3, 1e-3, 5.0)),
            (Vec3::splat(1e6), Vec3::splat(2.0)),
            (Vec3::splat(-1e-6), Vec3::splat(1e-6)),
        ];
        for (corner, size) in boxes {
            let photons = photons(&points(3000, corner, size, 1));
            // Queries in the box, around it, and on photons.
            let mut queries = points(300, corner, size, 2);
            queries.extend(points(300, corner - 0.5 * size, 2.0 * size, 3));
            queries.extend(photons.iter().step_by(30).map(|p| p.position));
            for share in [1e-9, 1e-5, 1e-3, 0.01, 0.1, 0.5, 1.0, 10.0, 1e6] {
                assert_exact(&photons, &queries, share * size.max_element());
            }
        }
    }

    #[test]
    fn hashed_grids_find_the_same_once() {
        // 2^18 cells do not hold a radius of a thousandth of the box: buckets are shared.
        let photons = photons(&points(20_000, Vec3::ZERO, Vec3::splat(10.0), 4));
        let mut map = PhotonMap::default();
        map.build_from(std::iter::once(&photons[..]), 0.01);
        assert_ne!(map.grid.mask, u32::MAX, "this test means to hash");
        let queries: Vec<Vec3> = photons.iter().step_by(50).map(|p| p.position).collect();
        for radius in [0.003, 0.01, 0.05] {
            assert!(assert_exact(&photons, &queries, radius) >= queries.len());
        }
    }

    #[test]
    fn photons_on_cell_borders_and_on_the_edge_of_the_radius_are_found_once() {
        // A lattice at all multiples of half a cell, looked up from all lattice points.
        for radius in [0.5, 1.0 / 3.0] {
            let half = radius * SLACK * CELL_MARGIN;
            let coordinates = || (0..8).map(|i| i as f32 * half);
            let mut positions = Vec::new();
            for x in coordinates() {
                for y in coordinates() {
                    positions.extend(coordinates().map(|z| Vec3::new(x, y, z)));
                }
            }
            assert_exact(&photons(&positions), &positions, radius);
        }
        let edge = [Vec3::ZERO, Vec3::X, Vec3::Y, -Vec3::Z];
        assert_eq!(assert_exact(&photons(&edge), &[Vec3::ZERO], 1.0), 4);
    }

    #[test]
    fn the_four_ranges_of_a_look_up_never_overlap() {
        for bits in 6..=30 {
            let count = (1usize << bits) / BUCKETS_PER_PHOTON;
            let bounds = Bounds { min: Vec3::ZERO, max: Vec3::splat(1.0) };
            let grid = Grid::new(bounds, 1e-5, count);
            let Grid { stride_y, stride_z, mask, .. } = grid;
            if mask == u32::MAX {
                continue;
            }
            let distance = |step: u32| (step & mask).min(step.wrapping_neg() & mask);
            let steps = [
                stride_y,
                stride_z,
                stride_y.wrapping_add(stride_z),
                stride_y.wrapping_sub(stride_z),
            ];
            for step in steps {
                assert!(distance(step) >= 2, "{grid:?}");
                assert!(f64::from(distance(step)) > 0.12 * f64::from(mask), "{grid:?}");
            }
        }
    }

    #[test]
    fn an_empty_map_finds_nothing_also_after_a_full_one() {
        let mut map = PhotonMap::default();
        map.for_each_within(Vec3::ZERO, |_, _| panic!("there is no photon"));
        map.build_from(std::iter::once(&[photon(Vec3::ZERO, 0)][..]), 1.0);
        assert_eq!(map.len(), 1);
        map.build_from(std::iter::empty(), 1.0);
        assert!(map.is_empty());
        map.for_each_within(Vec3::ZERO, |_, _| panic!("there is no photon"));
    }
}
