//! A cache of light at diffuse vertices, filled by the suffixes of full camera paths. Short paths
//! end at their second diffuse vertex and look it up there. theory.md, section 11c.

mod build;
mod key;
mod recorder;

pub use recorder::{MergedLight, SuffixRecord, SuffixRecorder};

use crate::base::math::{Bounds, Rgb};
use build::Level;
use glam::Vec3;
use key::CellKey;

pub use key::CellPoint;

/// Sizes of cells; each is twice the one before.
pub const LEVELS: usize = 4;

/// Width of the smallest cells over the merge radius.
const CELL_WIDTH: f32 = 4.0;

/// Minimum number of records in a cell: with fewer, the next larger cell is taken.
const LEAST_RECORDS: u32 = 16;

/// The light at the vertices of one iteration.
#[derive(Clone, Debug)]
pub struct SuffixCache {
    grid: Grid,
    levels: [Level; LEVELS],
}

/// Where cells are.
#[derive(Clone, Copy, Debug)]
struct Grid {
    origin: Vec3,
    /// Width of the smallest cells, scene units.
    width: f32,
}

/// What a cell holds: incident light, averaged over the directions of the diffuse lobe.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CellLight {
    /// Mean radiance of all records, W/(m^2 sr).
    pub mean: Rgb,
    /// Mean radiance of the records of each half of the suffix paths, W/(m^2 sr).
    pub halves: [Rgb; 2],
}

impl Grid {
    fn new(bounds: &Bounds, radius: f32) -> Self {
        let width = CELL_WIDTH * radius;
        // Walls at round coordinates then lie within cells, not between them.
        let offset = width * Vec3::new(0.382, 0.236, 0.146) * (1 << (LEVELS - 1)) as f32;
        Self { origin: bounds.min - offset, width }
    }

    fn key(&self, at: CellPoint) -> CellKey {
        CellKey::new(CellPoint { position: (at.position - self.origin) / self.width, ..at })
    }
}

impl SuffixCache {
    /// The cache of records within `bounds`, whose cells have widths in proportion to the merge
    /// radius. It does not depend on the number of threads.
    pub fn new(records: &[SuffixRecord], bounds: &Bounds, radius: f32) -> Self {
        let grid = Grid::new(bounds, radius);
        Self { grid, levels: build::levels(records, &grid) }
    }

    /// The light at a vertex whose path came over this distance. `None` if too little is known
    /// there, or if the path is so short that it would read the light of the cell that it comes
    /// from.
    #[inline]
    pub fn find(&self, at: CellPoint, distance: f32) -> Option<&CellLight> {
        if distance < self.grid.width {
            return None;
        }
        let key = self.grid.key(at);
        let mut levels = self.levels.iter().enumerate();
        levels.find_map(|(number, level)| level.find(key.at_level(number)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Stream, StreamKey};

    fn on_floor(position: Vec3) -> CellPoint {
        CellPoint { position, normal: Vec3::Z, front: true }
    }

    fn records(count: u32, seed: u64) -> Vec<SuffixRecord> {
        let mut rng = StreamKey::new(seed, Stream::Test, 0).rng(0);
        (0..count)
            .map(|path| {
                let [x, y] = rng.next_2d();
                let carried = Rgb::new(0.5 + rng.next_1d(), 0.2 + rng.next_1d(), 0.0);
                let light = Rgb::new(1.0 + x, 2.0 * y, 1.0);
                SuffixRecord {
                    at: on_floor(Vec3::new(x, y, 0.0)),
                    carried,
                    light: carried * light,
                    prob: 1.0,
                    distance: 1.0,
                    path,
                    wave: 0,
                }
            })
            .collect()
    }

    fn cache(records: &[SuffixRecord], radius: f32) -> SuffixCache {
        let bounds = Bounds { min: Vec3::ZERO, max: Vec3::new(1.0, 1.0, 0.0) };
        SuffixCache::new(records, &bounds, radius)
    }

    /// Cells have the means of their records, weighted by what the paths carry.
    #[test]
    fn cells_have_weighted_means() {
        let records = records(40_000, 1);
        let cache = cache(&records, 1.0 / 40.0);
        let grid = cache.grid;
        for at in [Vec3::new(0.31, 0.72, 0.0), Vec3::new(0.99, 0.01, 0.0)] {
            let key = grid.key(on_floor(at)).at_level(0);
            let own: Vec<_> =
                records.iter().filter(|own| grid.key(own.at).at_level(0) == key).collect();
            assert!(own.len() >= LEAST_RECORDS as usize);
            let mean = |own: &[&SuffixRecord]| {
                let light: Rgb = own.iter().map(|own| own.light).sum();
                let carried: Rgb = own.iter().map(|own| own.carried).sum();
                // No path carries light of the last channel.
                Rgb::new(light.x / carried.x, light.y / carried.y, 0.0)
            };
            let found = cache.find(on_floor(at), 1.0).unwrap();
            assert!((found.mean - mean(&own)).abs().max_element() < 1e-4, "{found:?}");
            for (half, found) in found.halves.iter().enumerate() {
                let own: Vec<_> =
                    own.iter().copied().filter(|own| own.path % 2 == half as u32).collect();
                assert!((*found - mean(&own)).abs().max_element() < 1e-4, "{found:?}");
            }
        }
    }

    #[test]
    fn few_records_are_found_in_larger_cells_and_not_from_nearby() {
        // About 2 records in each of the smallest cells, and 128 in each of the largest.
        let records = records(1250, 2);
        let cache = cache(&records, 0.01);
        let at = Vec3::new(0.5, 0.5, 0.0);
        let own = on_floor(at);
        assert!(cache.find(own, 1.0).is_some());
        assert!(cache.find(own, 0.03).is_none());
        // Another direction, the back, and no record at all.
        assert!(cache.find(CellPoint { normal: -Vec3::Z, ..own }, 1.0).is_none());
        assert!(cache.find(CellPoint { front: false, ..own }, 1.0).is_none());
        assert!(cache.find(on_floor(Vec3::new(0.5, 0.5, 5.0)), 1.0).is_none());
    }

    #[test]
    fn cells_do_not_depend_on_the_number_of_threads() {
        let records = records(30_000, 3);
        let build = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| cache(&records, 0.01))
        };
        let (one, four) = (build(1), build(4));
        let mut rng = StreamKey::new(4, Stream::Test, 0).rng(0);
        for _ in 0..500 {
            let [x, y] = rng.next_2d();
            let at = Vec3::new(x, y, 0.0);
            assert_eq!(one.find(on_floor(at), 1.0), four.find(on_floor(at), 1.0));
        }
    }
}
