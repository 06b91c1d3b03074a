//! Builds the cells of all sizes from records: sorts the records by key once, so that the records
//! of every cell are neighbors.

use super::{CellLight, Grid, LEAST_RECORDS, LEVELS, SuffixRecord};
use crate::base::math::Rgb;
use rayon::prelude::*;
use std::array::from_fn;

/// No cell has this key: those of cells have fewer bits.
const EMPTY: u64 = u64::MAX;

/// The cells of one size: a hash table with open addressing.
#[derive(Clone, Debug)]
pub struct Level {
    /// Keys of the slots, a power of two; at least one slot is empty.
    keys: Vec<u64>,
    lights: Vec<CellLight>,
}

/// The cells of all sizes, the smallest first.
pub fn levels(records: &[SuffixRecord], grid: &Grid) -> [Level; LEVELS] {
    let is_usable = |own: &SuffixRecord| own.light.is_finite() && own.carried.is_finite();
    let key = |(index, own): (usize, &SuffixRecord)| {
        let key = grid.key(own.at).at_level(0);
        (if is_usable(own) { key } else { EMPTY }, index as u32)
    };
    let mut sorted: Vec<(u64, u32)> = records.par_iter().enumerate().map(key).collect();
    sorted.par_sort_unstable();
    let used = sorted.partition_point(|(key, _)| *key != EMPTY);
    sorted.truncate(used);
    let build = |level: usize| Level::new(records, &sorted, 3 * level as u32);
    let mut levels: Vec<Level> = (0..LEVELS).into_par_iter().map(build).collect();
    levels.reverse();
    from_fn(|_| levels.pop().expect("one for each size"))
}

impl Level {
    /// Cells of records that are sorted by keys without the last `shift` bits. `sorted` has keys
    /// and indices.
    fn new(records: &[SuffixRecord], sorted: &[(u64, u32)], shift: u32) -> Self {
        let mut cells = Vec::new();
        let same_cell = |one: &(u64, u32), other: &(u64, u32)| one.0 >> shift == other.0 >> shift;
        for cell in sorted.chunk_by(same_cell) {
            if cell.len() >= LEAST_RECORDS as usize {
                let own = cell.iter().map(|(_, index)| &records[*index as usize]);
                cells.push((cell[0].0 >> shift, light(own)));
            }
        }
        let slots = (2 * cells.len()).next_power_of_two().max(2);
        let (keys, lights) = (vec![EMPTY; slots], vec![CellLight::default(); slots]);
        let mut level = Self { keys, lights };
        for (key, light) in cells {
            let slot = level.slot(key);
            (level.keys[slot], level.lights[slot]) = (key, light);
        }
        level
    }

    /// The cell of this key, if it has enough records.
    #[inline]
    pub fn find(&self, key: u64) -> Option<&CellLight> {
        let slot = self.slot(key);
        (self.keys[slot] == key).then(|| &self.lights[slot])
    }

    /// Slot of a key, or the empty one where it would be.
    #[inline]
    fn slot(&self, key: u64) -> usize {
        let mask = self.keys.len() - 1;
        // The multiplier of `rng`: neighboring keys land far from each other.
        let mut slot = (key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize & mask;
        while self.keys[slot] != key && self.keys[slot] != EMPTY {
            slot = (slot + 1) & mask;
        }
        slot
    }
}

/// Means over records, weighted by what their paths carry: theory.md (44h).
fn light<'a>(records: impl Iterator<Item = &'a SuffixRecord>) -> CellLight {
    let mut sums = [[Rgb::ZERO; 2]; 2];
    for own in records {
        let [light, carried] = &mut sums[own.half()];
        *light += own.light;
        *carried += own.carried;
    }
    let [[light_0, carried_0], [light_1, carried_1]] = sums;
    let ratio = |light: Rgb, carried: Rgb, unknown: Rgb| {
        Rgb::select(carried.cmpgt(Rgb::ZERO), light / carried, unknown)
    };
    let mean = ratio(light_0 + light_1, carried_0 + carried_1, Rgb::ZERO);
    // A half without records tells nothing about the difference of both.
    let halves = [ratio(light_0, carried_0, mean), ratio(light_1, carried_1, mean)];
    CellLight { mean, halves }
}
