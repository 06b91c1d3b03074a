//! A small hash table of the contribution of each light path to the current pixel.

/// One entry per light path that touched the current pixel, in the order in which they did; lists
/// of those with the same hash. Starting the next pixel costs nothing: places below `first` are of
/// pixels before it.
///
/// A pixel meets few of the `N_F` light paths, so the table stays in the first-level cache where an
/// array over all of them would not.
#[derive(Debug)]
pub struct PairTable<T> {
    entries: Vec<Entry<T>>,
    /// By hash the place of the last entry, counted from those of all pixels: a power of two of
    /// them, four times as many as entries or more.
    last: Vec<u32>,
    /// Place of the first entry of the current pixel.
    first: u32,
}

#[derive(Clone, Copy, Debug)]
struct Entry<T> {
    light_path: u32,
    /// Place of the entry before it with the same hash.
    before: u32,
    value: T,
}

/// Places are renumbered after this many entries.
const MOST_PLACES: u32 = 1 << 31;

impl<T: Copy + Default> Default for PairTable<T> {
    fn default() -> Self {
        // Place 0 is of no pixel.
        Self { entries: Vec::new(), last: vec![0; 256], first: 1 }
    }
}

impl<T: Copy + Default> PairTable<T> {
    /// Forgets all entries.
    pub fn clear(&mut self) {
        self.first += self.entries.len() as u32;
        self.entries.clear();
        if self.first > MOST_PLACES {
            self.last.fill(0);
            self.first = 1;
        }
    }

    /// The entry of `light_path`, made from the default where there is none.
    #[inline]
    pub fn entry(&mut self, light_path: u32) -> &mut T {
        let hash = self.hash(light_path);
        let mut place = self.last[hash];
        loop {
            // Entries of other pixels wrap around to what is beyond the last.
            let index = place.wrapping_sub(self.first) as usize;
            let Some(entry) = self.entries.get(index) else { break };
            if entry.light_path == light_path {
                return &mut self.entries[index].value;
            }
            place = entry.before;
        }
        self.insert(hash, light_path)
    }

    #[inline]
    fn hash(&self, light_path: u32) -> usize {
        // Neighboring ids are common (batches of light paths): multiply to spread them.
        (light_path.wrapping_mul(0x9e37_79b9) >> 7) as usize & (self.last.len() - 1)
    }

    #[inline]
    fn insert(&mut self, hash: usize, light_path: u32) -> &mut T {
        let index = self.entries.len();
        let before = std::mem::replace(&mut self.last[hash], self.first + index as u32);
        self.entries.push(Entry { light_path, before, value: T::default() });
        if 4 * self.entries.len() > self.last.len() {
            self.grow();
        }
        &mut self.entries[index].value
    }

    #[cold]
    fn grow(&mut self) {
        self.last = vec![0; 2 * self.last.len()];
        for index in 0..self.entries.len() {
            let hash = self.hash(self.entries[index].light_path);
            let place = self.first + index as u32;
            self.entries[index].before = std::mem::replace(&mut self.last[hash], place);
        }
    }

    /// All entries with their light paths, in the order in which they were made.
    pub fn entries(&self) -> impl Iterator<Item = (u32, &T)> {
        self.entries.iter().map(|entry| (entry.light_path, &entry.value))
    }

    /// The values of all entries, in the order in which they were made.
    pub fn values(&self) -> impl Iterator<Item = &T> {
        self.entries.iter().map(|entry| &entry.value)
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
    use bdpm_base::rng::{Stream, StreamKey};
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
    fn old_entries_do_not_come_back_when_places_are_renumbered() {
        let mut table = PairTable::<f64>::default();
        *table.entry(5) = 1.0;
        table.first = MOST_PLACES;
        *table.entry(6) = 2.0;
        table.clear();
        assert_eq!(table.first, 1);
        assert!(table.last.iter().all(|&place| place == 0), "a list may end in itself");
        assert_eq!(table.values().count(), 0);
        assert_eq!(*table.entry(5), 0.0);
        assert_eq!(*table.entry(6), 0.0);
    }
}
