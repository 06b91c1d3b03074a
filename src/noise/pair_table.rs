//! What each light path has contributed to the current pixel: a small hash table.

/// One entry per light path that touched the current pixel. Starting the next pixel costs nothing:
/// entries of an older generation count as empty.
///
/// A pixel meets few of the `N_F` light paths, so the table stays in the first-level cache where an
/// array over all of them would not.
#[derive(Debug)]
pub struct PairTable<T> {
    /// A power of two of them, at most half in use.
    entries: Vec<Entry<T>>,
    generation: u32,
    used: usize,
}

#[derive(Clone, Copy, Debug, Default)]
struct Entry<T> {
    generation: u32,
    light_path: u32,
    value: T,
}

impl<T: Copy + Default> Default for PairTable<T> {
    fn default() -> Self {
        Self { entries: vec![Entry::default(); 64], generation: 1, used: 0 }
    }
}

impl<T: Copy + Default> PairTable<T> {
    /// Forgets all entries.
    pub fn clear(&mut self) {
        self.used = 0;
        self.generation = self.generation.wrapping_add(1);
        if self.generation == 0 {
            self.entries.fill(Entry::default());
            self.generation = 1;
        }
    }

    /// The entry of `light_path`, made from the default where there is none.
    #[inline]
    pub fn entry(&mut self, light_path: u32) -> &mut T {
        let slot = self.find(light_path);
        if self.entries[slot].generation == self.generation {
            return &mut self.entries[slot].value;
        }
        self.insert(slot, light_path)
    }

    /// Where `light_path` is, or the empty slot where it belongs.
    #[inline]
    fn find(&self, light_path: u32) -> usize {
        let mask = self.entries.len() - 1;
        // Neighboring ids are common (batches of light paths): multiply to spread them.
        let hash = light_path.wrapping_mul(0x9e37_79b9);
        let mut slot = (hash >> 7) as usize & mask;
        loop {
            let entry = &self.entries[slot];
            if entry.generation != self.generation || entry.light_path == light_path {
                return slot;
            }
            slot = (slot + 1) & mask;
        }
    }

    fn insert(&mut self, slot: usize, light_path: u32) -> &mut T {
        let mut slot = slot;
        if 2 * (self.used + 1) > self.entries.len() {
            let larger = vec![Entry::default(); 2 * self.entries.len()];
            let old = std::mem::replace(&mut self.entries, larger);
            for entry in old.into_iter().filter(|entry| entry.generation == self.generation) {
                let place = self.find(entry.light_path);
                self.entries[place] = entry;
            }
            slot = self.find(light_path);
        }
        self.used += 1;
        self.entries[slot] = Entry { generation: self.generation, light_path, value: T::default() };
        &mut self.entries[slot].value
    }

    /// The values of all entries, in no particular order.
    pub fn values(&self) -> impl Iterator<Item = &T> {
        let in_use = |entry: &&Entry<T>| entry.generation == self.generation;
        self.entries.iter().filter(in_use).map(|entry| &entry.value)
    }
}

/// `I_ij` of one light path with the current camera path, as its parts come in.
#[derive(Clone, Copy, Debug, Default)]
pub struct PairSum {
    sum: f64,
    /// The camera path that `sum` belongs to, numbered from 1.
    camera_path: u32,
}

impl PairSum {
    /// Adds a part, and returns what that adds to `I_ij^2`.
    #[inline]
    pub fn add(&mut self, camera_path: u32, value: f64) -> f64 {
        let before = if self.camera_path == camera_path { self.sum } else { 0.0 };
        *self = Self { sum: before + value, camera_path };
        value * (2.0 * before + value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, StreamKey};
    use std::collections::HashMap;

    #[test]
    fn holds_what_a_map_holds() {
        let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
        let mut table = PairTable::<f64>::default();
        for paths in [1.0, 10.0, 1000.0, 5.0, 1e9] {
            table.clear();
            let mut map = HashMap::new();
            for _ in 0..2000 {
                let path = (rng.next_1d() * paths) as u32;
                let value = f64::from(rng.next_1d());
                *table.entry(path) += value;
                *map.entry(path).or_insert(0.0) += value;
            }
            assert_eq!(table.values().count(), map.len());
            for (&path, value) in &map {
                assert_eq!(table.entry(path), value);
            }
        }
    }

    #[test]
    fn old_entries_do_not_come_back_when_generations_wrap() {
        let mut table = PairTable::<f64>::default();
        *table.entry(5) = 1.0;
        table.generation = u32::MAX;
        *table.entry(6) = 2.0;
        table.clear();
        assert_eq!(table.values().count(), 0);
        assert_eq!(*table.entry(5), 0.0);
        assert_eq!(*table.entry(6), 0.0);
    }
}
