//! Sets of iteration numbers: those that an image contains, or that a process renders.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;

/// A set of iteration numbers, as ranges that neither touch nor overlap, in ascending order.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct IterationSet(Vec<Range<u64>>);

impl From<Range<u64>> for IterationSet {
    fn from(range: Range<u64>) -> Self {
        Self(if range.is_empty() { Vec::new() } else { vec![range] })
    }
}

impl IterationSet {
    /// The set of all iterations.
    pub fn all() -> Self {
        Self::from(0..u64::MAX)
    }

    /// Returns true if the set is empty.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Number of iterations in the set.
    #[inline]
    pub fn count(&self) -> u64 {
        self.0.iter().map(|range| range.end - range.start).sum()
    }

    /// The ranges, in ascending order.
    #[inline]
    pub fn ranges(&self) -> &[Range<u64>] {
        &self.0
    }

    /// Smallest iteration number.
    #[inline]
    pub fn first(&self) -> Option<u64> {
        self.0.first().map(|range| range.start)
    }

    /// Returns true if the ranges are in order, which a file may violate.
    pub fn is_consistent(&self) -> bool {
        self.0.iter().all(|range| !range.is_empty())
            && self.0.windows(2).all(|pair| pair[0].end < pair[1].start)
    }

    /// Adds one iteration.
    #[inline]
    pub fn add(&mut self, number: u64) {
        match self.0.last_mut() {
            Some(last) if last.end == number => last.end += 1,
            _ => *self = self.with(&Self::from(number..number + 1)),
        }
    }

    /// Union of two sets.
    #[must_use]
    pub fn with(&self, others: &Self) -> Self {
        let mut all: Vec<_> = self.0.iter().chain(&others.0).cloned().collect();
        all.sort_unstable_by_key(|range| range.start);
        let mut merged: Vec<Range<u64>> = Vec::with_capacity(all.len());
        for range in all {
            match merged.last_mut() {
                Some(last) if range.start <= last.end => last.end = last.end.max(range.end),
                _ => merged.push(range),
            }
        }
        Self(merged)
    }

    /// Iterations of this set that are not in `others`.
    #[must_use]
    pub fn without(&self, others: &Self) -> Self {
        let mut left = Vec::new();
        let mut others = others.0.iter().peekable();
        for range in &self.0 {
            let mut start = range.start;
            while others.next_if(|other| other.end <= start).is_some() {}
            let mut ahead = others.clone();
            while let Some(other) = ahead.next_if(|other| other.start < range.end) {
                left.extend((start < other.start).then_some(start..other.start));
                start = other.end;
            }
            left.extend((start < range.end).then_some(start..range.end));
        }
        Self(left)
    }

    /// Intersection of two sets.
    #[must_use]
    pub fn within(&self, others: &Self) -> Self {
        self.without(&self.without(others))
    }

    /// The first `count` iterations, or all if there are fewer.
    #[must_use]
    pub fn take(&self, count: u64) -> Self {
        let mut left = count;
        let mut taken = Vec::new();
        for range in &self.0 {
            let length = left.min(range.end - range.start);
            left -= length;
            taken.extend((length > 0).then_some(range.start..range.start + length));
        }
        Self(taken)
    }

    /// Part `index` of `of` parts in ascending order, whose sizes differ by at most one.
    ///
    /// # Panics
    /// Unless `index` is below `of`.
    #[must_use]
    pub fn share(&self, index: u32, of: u32) -> Self {
        assert!(index < of, "there are {of} shares");
        let count = u128::from(self.count());
        let until = |share: u32| (count * u128::from(share) / u128::from(of)) as u64;
        self.take(until(index + 1)).without(&self.take(until(index)))
    }
}

/// First and last of each range, such as `0 to 7, 16 to 23`.
impl fmt::Display for IterationSet {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        for (index, Range { start, end }) in self.0.iter().enumerate() {
            let comma = if index > 0 { ", " } else { "" };
            match end - start {
                1 => write!(f, "{comma}{start}")?,
                _ => write!(f, "{comma}{start} to {}", end - 1)?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    fn set(numbers: &IterationSet) -> BTreeSet<u64> {
        numbers.ranges().iter().cloned().flatten().collect()
    }

    fn any() -> impl Strategy<Value = IterationSet> {
        proptest::collection::btree_set(0u64..40, 0..30).prop_map(|set| {
            let mut numbers = IterationSet::default();
            set.into_iter().for_each(|number| numbers.add(number));
            numbers
        })
    }

    proptest! {
        #[test]
        fn they_are_sets(a in any(), b in any(), count in 0u64..50, of in 1u32..7) {
            let (one, other) = (set(&a), set(&b));
            prop_assert_eq!(set(&a.with(&b)), &one | &other);
            prop_assert_eq!(set(&a.without(&b)), &one - &other);
            prop_assert_eq!(set(&a.within(&b)), &one & &other);
            prop_assert_eq!(set(&a.take(count)), one.iter().copied().take(count as usize).collect());
            prop_assert_eq!((a.count(), a.first()), (one.len() as u64, one.first().copied()));
            let mut backward = IterationSet::default();
            one.iter().rev().for_each(|&number| backward.add(number));
            prop_assert_eq!(&backward, &a);
            for numbers in [a.with(&b), a.without(&b), a.within(&b), a.take(count)] {
                prop_assert!(numbers.is_consistent(), "{:?}", numbers);
            }
            let shares: Vec<IterationSet> = (0..of).map(|index| a.share(index, of)).collect();
            let sizes: Vec<u64> = shares.iter().map(IterationSet::count).collect();
            prop_assert!(sizes.iter().max().unwrap() - sizes.iter().min().unwrap() <= 1);
            let all = shares.iter().fold(IterationSet::default(), |all, share| all.with(share));
            prop_assert_eq!((all, sizes.iter().sum::<u64>()), (a.clone(), a.count()));
        }
    }

    #[test]
    fn they_are_told_by_first_and_last() {
        let mut numbers = IterationSet::from(0..8).with(&IterationSet::from(16..24));
        numbers.add(30);
        assert_eq!(numbers.to_string(), "0 to 7, 16 to 23, 30");
        assert_eq!(IterationSet::all().without(&numbers).first(), Some(8));
        assert!(
            !IterationSet(vec![0..2, 3..3]).is_consistent()
                && !IterationSet(vec![0..2, 2..3]).is_consistent()
        );
    }
}
