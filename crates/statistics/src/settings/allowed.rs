//! The numbers of light paths that a choice of counts may take.

use super::{MAX_LIGHT_PATHS, MIN_SETS};
use std::ops::RangeInclusive;

/// Minimum number of light paths that is chosen without sets: noise is measured from two of them.
const MIN_LIGHT_PATHS: u32 = 2;

/// The numbers of light paths that an iteration may have. Every choice of counts takes its light
/// paths from here, so that settings and memory allow it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AllowedLightPaths {
    set: u32,
    least_sets: u32,
    most_sets: u32,
}

impl AllowedLightPaths {
    /// Whole sets of `set` light paths: at least [`MIN_SETS`] sets, even if these exceed `most`.
    pub(super) fn new(set: u32, most: u32) -> Self {
        let least_sets = if set == 1 { MIN_LIGHT_PATHS } else { MIN_SETS };
        let most_sets = (most.min(MAX_LIGHT_PATHS) / set).max(least_sets);
        Self { set, least_sets, most_sets }
    }

    /// The smallest and the largest number.
    #[inline]
    pub fn bounds(&self) -> RangeInclusive<u32> {
        self.least_sets * self.set..=self.most_sets * self.set
    }

    /// The allowed number nearest to `wanted`.
    #[inline]
    pub fn nearest(&self, wanted: u32) -> u32 {
        self.sets(wanted.saturating_add(self.set / 2) / self.set)
    }

    /// The largest allowed number up to `wanted`, or the smallest one.
    #[inline]
    pub fn at_most(&self, wanted: u32) -> u32 {
        self.sets(wanted / self.set)
    }

    #[inline]
    fn sets(&self, sets: u32) -> u32 {
        sets.clamp(self.least_sets, self.most_sets) * self.set
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use proptest::prelude::*;

    fn settings() -> Settings {
        Settings::resolve(&Default::default(), &Default::default(), 1.0).unwrap()
    }

    proptest! {
        #[test]
        fn allowed_numbers_pass_validation(
            bits in prop_oneof![Just(0u32), 4u32..=12],
            most in 0u32..,
            wanted in 0u32..,
        ) {
            let settings = Settings { sobol_set: 1 << bits, ..settings() };
            let allowed = settings.allowed_light_paths(most);
            let (least, largest) = allowed.bounds().into_inner();
            prop_assert!(least <= largest && largest <= MAX_LIGHT_PATHS);
            prop_assert!(largest <= most || largest == least);
            for chosen in [allowed.nearest(wanted), allowed.at_most(wanted)] {
                let chosen = Settings { light_paths: chosen, ..settings.clone() };
                prop_assert!(chosen.validate().is_ok(), "{}", chosen.light_paths);
                let chosen = chosen.light_paths;
                prop_assert!(allowed.bounds().contains(&chosen));
                if allowed.bounds().contains(&wanted) {
                    prop_assert!(chosen.abs_diff(wanted) < settings.sobol_set);
                }
            }
            prop_assert!(allowed.at_most(wanted) <= wanted.max(least));
        }
    }
}
