//! Memory that grows while a file is read, checked before it is exhausted.

use super::text::check_memory;
use bdpm_core::base::memory::available_memory;

/// Bytes between two checks. Smaller inputs need none.
const STEP: u64 = 1 << 26;

/// Counts the bytes that a reader stores.
#[derive(Debug, Default)]
pub struct Growth {
    stored: u64,
    checked: u64,
}

impl Growth {
    /// Counts `bytes` that are about to be stored. Once in a while it checks that everything stored
    /// so far fits in memory a second time, because lists are copied when they grow. Otherwise the
    /// error is the rest of a sentence about the memory.
    pub fn add(&mut self, bytes: u64) -> Result<(), String> {
        self.stored = self.stored.saturating_add(bytes);
        if self.stored < self.checked.saturating_add(STEP) {
            return Ok(());
        }
        self.checked = self.stored;
        check_memory(self.stored as f64, available_memory())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endless_growth_is_refused_and_small_inputs_are_not() {
        let mut growth = Growth::default();
        (0..1000).for_each(|_| growth.add(1000).unwrap());
        let mut endless = Growth::default();
        let refused = (0..100).find_map(|_| endless.add(1 << 60).err());
        // Systems that do not report their memory refuse nothing.
        if available_memory().is_some() {
            assert!(refused.unwrap().contains("GiB are available"));
        }
    }
}
