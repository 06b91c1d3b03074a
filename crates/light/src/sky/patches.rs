//! Patches of the sky: those of Tregenza, *Subdivision of the sky hemisphere for luminance
//! measurements* (1987), each row of which Reinhart divides further.

use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Patches in the rows of Tregenza from the horizon up. One more covers the zenith.
const ROWS: [usize; 7] = [30, 30, 24, 24, 18, 12, 6];

/// Patches of the hemisphere above the horizon, in a frame with +y up.
#[derive(Clone, Debug, PartialEq)]
pub struct SkyPatches {
    /// Factor on the rows of Tregenza and on the patches in each.
    division: usize,
    /// First patch of each row.
    first: Vec<usize>,
}

impl SkyPatches {
    /// The patches with `division` times as many rows, and as many times the patches in each: 145,
    /// 577 or 2305 patches for 1, 2 and 4.
    ///
    /// # Panics
    /// If the factor is 0.
    pub fn new(division: usize) -> Self {
        assert!(division > 0);
        let mut first = vec![0];
        for row in 0..ROWS.len() * division {
            first.push(first[row] + ROWS[row / division] * division);
        }
        Self { division, first }
    }

    /// Number of patches.
    pub fn count(&self) -> usize {
        self.first.last().expect("there are rows") + 1
    }

    /// Height of a row, radians: the cap has half of it around the zenith.
    fn step(&self) -> f64 {
        FRAC_PI_2 / ((ROWS.len() * self.division) as f64 + 0.5)
    }

    /// The patch of a unit direction; `None` below the horizon.
    pub fn find(&self, direction: DVec3) -> Option<usize> {
        if direction.y < 0.0 {
            return None;
        }
        let row = (direction.y.min(1.0).asin() / self.step()) as usize;
        if row >= ROWS.len() * self.division {
            return Some(self.count() - 1);
        }
        let count = self.first[row + 1] - self.first[row];
        // From the north, which is -z, by the east.
        let turn = direction.x.atan2(-direction.z) / TAU;
        let column = ((turn - turn.floor()) * count as f64) as usize;
        Some(self.first[row] + column.min(count - 1))
    }

    /// The unit vector toward the middle of a patch.
    ///
    /// # Panics
    /// If there is no such patch.
    pub fn middle(&self, patch: usize) -> DVec3 {
        assert!(patch < self.count());
        if patch == self.count() - 1 {
            return DVec3::Y;
        }
        let row = self.first.partition_point(|&first| first <= patch) - 1;
        let count = (self.first[row + 1] - self.first[row]) as f64;
        let height = (row as f64 + 0.5) * self.step();
        let turn = TAU * ((patch - self.first[row]) as f64 + 0.5) / count;
        let (up, across) = height.sin_cos();
        DVec3::new(across * turn.sin(), up, -across * turn.cos())
    }

    /// Projected solid angle of a patch on the horizontal, sr.
    ///
    /// # Panics
    /// If there is no such patch.
    pub fn projected(&self, patch: usize) -> f64 {
        let ([low, high], count) = self.row(patch);
        0.5 * TAU * (high * high - low * low) / count
    }

    /// Solid angle of a patch, sr.
    ///
    /// # Panics
    /// If there is no such patch.
    pub fn solid_angle(&self, patch: usize) -> f64 {
        let ([low, high], count) = self.row(patch);
        TAU * (high - low) / count
    }

    /// Heights of a unit vector toward the lower and the upper edge of a patch, and the number of
    /// patches in its row.
    fn row(&self, patch: usize) -> ([f64; 2], f64) {
        assert!(patch < self.count());
        let row = self.first.partition_point(|&first| first <= patch) - 1;
        let low = (row as f64 * self.step()).sin();
        if patch == self.count() - 1 {
            return ([low, 1.0], 1.0);
        }
        let high = ((row + 1) as f64 * self.step()).sin();
        ([low, high], (self.first[row + 1] - self.first[row]) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn patches_are_as_many_as_published_and_cover_the_sky() {
        for (division, count) in [(1, 145), (2, 577), (4, 2305)] {
            let patches = SkyPatches::new(division);
            assert_eq!(patches.count(), count);
            let all: f64 = (0..count).map(|patch| patches.projected(patch)).sum();
            assert!((all / PI - 1.0).abs() < 1e-12, "{all}");
            let all: f64 = (0..count).map(|patch| patches.solid_angle(patch)).sum();
            assert!((all / TAU - 1.0).abs() < 1e-12, "{all}");
            for patch in 0..count {
                assert_eq!(patches.find(patches.middle(patch)), Some(patch));
            }
        }
    }

    #[test]
    fn patches_begin_in_the_north_and_turn_by_the_east() {
        let patches = SkyPatches::new(1);
        let at = |x: f64, y: f64, z: f64| patches.find(DVec3::new(x, y, z).normalize());
        assert_eq!(at(0.01, 0.05, -1.0), Some(0));
        assert_eq!(at(1.0, 0.05, -0.01), Some(7));
        assert_eq!(at(-0.01, 0.05, -1.0), Some(29));
        assert_eq!(at(0.0, 1.0, 0.0), Some(144));
        assert_eq!(at(0.0, -0.01, 1.0), None);
    }
}
