//! Inverts cumulative distributions in constant time on average, by cutpoints (Chen and Asau, *On
//! Generating Random Variates from an Empirical Distribution*, 1974).
//!
//! The unit interval has 2^32 - 1 units. Each outcome owns an interval of whole units, so that its
//! probability is exact in 32 bits. Buckets of equal length divide the unit interval. For each
//! bucket a table stores the first outcome that meets it. The outcome of a random number increases
//! with the number, unlike that of an alias table.

/// Number of units of the unit interval.
pub(super) const UNITS: u32 = u32::MAX;

/// Outcomes per bucket. More of them make the tables smaller, and searches longer.
const OUTCOMES_PER_BUCKET: usize = 4;

/// An outcome, which stores the upper end of its interval.
pub(super) trait Outcome {
    /// Upper end of the interval, units.
    fn end(&self) -> u32;
}

/// A random choice of an outcome.
#[derive(Clone, Copy, Debug)]
pub(super) struct Choice {
    pub index: usize,
    /// Length of the outcome's interval, units.
    pub units: u32,
    /// Position of the random number in the interval, in [0, 1].
    pub rest: f64,
}

/// The cutpoints of several distributions over equally many outcomes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cutpoints {
    /// Binary logarithm of the number of buckets.
    log_buckets: u32,
    /// For each distribution the first outcome of each bucket, and the last outcome of all.
    first: Vec<u32>,
}

impl Cutpoints {
    /// Cutpoints for distributions over this number of outcomes.
    pub(super) fn new(outcomes: usize) -> Self {
        let buckets = outcomes.div_ceil(OUTCOMES_PER_BUCKET).next_power_of_two();
        Self { log_buckets: buckets.ilog2().min(31), first: Vec::new() }
    }

    /// Adds a distribution.
    pub(super) fn add<T: Outcome>(&mut self, outcomes: &[T]) {
        let mut index = 0;
        for bucket in 0..=1_u64 << self.log_buckets {
            let begin = (bucket << 32 >> self.log_buckets).min(u64::from(UNITS - 1)) as u32;
            while outcomes[index].end() <= begin {
                index += 1;
            }
            self.first.push(index as u32);
        }
    }

    /// Chooses an outcome of the distribution with the index `distribution` by a number `u` of [0,
    /// 1).
    #[inline]
    pub(super) fn choose<T: Outcome>(&self, distribution: usize, outcomes: &[T], u: f64) -> Choice {
        self.bucket(distribution, u).choose(outcomes)
    }

    /// The bucket of a number `u` of [0, 1) in the distribution with the index `distribution`.
    #[inline]
    pub(super) fn bucket(&self, distribution: usize, u: f64) -> Bucket {
        let units = (u * f64::from(UNITS)).min(f64::from(UNITS) - 0.5);
        let buckets = 1 << self.log_buckets;
        let bucket = (u64::from(units as u32) << self.log_buckets >> 32) as usize;
        let at = distribution * (buckets + 1) + bucket;
        Bucket { first: self.first[at], last: self.first[at + 1], units }
    }
}

/// A number in a bucket of a distribution.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bucket {
    /// The first and the last outcome that meet the bucket.
    first: u32,
    last: u32,
    /// The number, units.
    units: f64,
}

impl Bucket {
    /// The first outcome that meets the bucket.
    #[inline]
    pub(super) fn first(&self) -> usize {
        self.first as usize
    }

    /// The outcome of the number.
    #[inline]
    pub(super) fn choose<T: Outcome>(&self, outcomes: &[T]) -> Choice {
        let (first, last, whole) = (self.first as usize, self.last as usize, self.units as u32);
        let index = first + outcomes[first..last].partition_point(|one| one.end() <= whole);
        let begin = if index == 0 { 0 } else { outcomes[index - 1].end() };
        let length = outcomes[index].end() - begin;
        let rest = ((self.units - f64::from(begin)) / f64::from(length)).clamp(0.0, 1.0);
        Choice { index, units: length, rest }
    }
}

/// Upper end of each weight's interval, units. All intervals are equal if all weights are 0.
/// Otherwise the interval of a positive weight has at least one unit, and that of the weight 0 is
/// empty.
pub(super) fn interval_ends(weights: &[f64]) -> impl Iterator<Item = u32> {
    let total: f64 = weights.iter().sum();
    let weight = move |weight: f64| if total > 0.0 { weight } else { 1.0 };
    let total = if total > 0.0 { total } else { weights.len() as f64 };
    let positive = weights.iter().filter(|one| weight(**one) > 0.0).count() as u32;
    let shared = f64::from(UNITS - positive);
    let (mut sum, mut count) = (0.0, 0);
    weights.iter().map(move |one| {
        sum += weight(*one);
        count += u32::from(weight(*one) > 0.0);
        (sum / total * shared).round() as u32 + count
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Outcome for u32 {
        fn end(&self) -> u32 {
            *self
        }
    }

    fn weights(count: u32) -> Vec<f64> {
        let weight = |i: u32| match i % 7 {
            0 => 0.0,
            3 => 1e9,
            _ => f64::from(i.wrapping_mul(2_654_435_761) >> 12),
        };
        (0..count).map(weight).collect()
    }

    #[test]
    fn intervals_fill_the_units_and_have_their_weights() {
        for weights in [weights(1000), vec![1e-300, 0.0], vec![0.0, 1e300, 0.0], vec![0.0; 5]] {
            let ends: Vec<u32> = interval_ends(&weights).collect();
            assert_eq!(ends.last(), Some(&UNITS));
            let total: f64 = weights.iter().sum();
            let mut begin = 0;
            for (end, weight) in ends.into_iter().zip(weights.iter()) {
                let length = end.checked_sub(begin).expect("ends increase");
                assert_eq!(length > 0, *weight > 0.0 || total == 0.0);
                let expected = weight / total * f64::from(UNITS);
                assert!(total == 0.0 || (f64::from(length) - expected).abs() <= 1001.0);
                begin = end;
            }
        }
    }

    #[test]
    fn choices_are_those_of_a_search_through_all_intervals() {
        for count in [1, 2, 3, 30, 1000] {
            let both = [weights(count + 1), vec![0.0; count as usize + 1]];
            let ends = both.map(|weights| interval_ends(&weights).collect::<Vec<u32>>());
            let mut cutpoints = Cutpoints::new(count as usize + 1);
            ends.iter().for_each(|ends| cutpoints.add(ends));
            for (distribution, ends) in ends.iter().enumerate() {
                let edges = ends.iter().flat_map(|end| [-0.5, 0.5].map(|d| f64::from(*end) + d));
                let edges = edges.map(|units| units / f64::from(UNITS)).filter(|u| *u < 1.0);
                let grid = (0..10_000).map(|i| f64::from(i) / 10_000.0);
                for u in grid.chain(edges).chain([1.0_f64.next_down(), 1.0]) {
                    let Choice { index, units, rest } = cutpoints.choose(distribution, ends, u);
                    let whole = ((u * f64::from(UNITS)) as u32).min(UNITS - 1);
                    assert_eq!(index, ends.iter().position(|end| *end > whole).unwrap());
                    let begin = ends[index] - units;
                    let back = (f64::from(begin) + rest * f64::from(units)) / f64::from(UNITS);
                    assert!((back - u).abs() < 1e-9, "{u} {back}");
                }
            }
        }
    }
}
