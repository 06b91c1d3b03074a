//! Light of points, spots and parallel light that arrives at meters by mirrors and through glass
//! that is no pane: photons on discs, with their noise and bias.

use super::meter_photons::{DiscIrradiances, MeterPhotons, RADII, RATIO};
use super::reading::{Reading, SampleTail};
use bdpm_core::accel::Intersect;
use bdpm_core::scene::{Meter, Scene};
use std::ops::Range;
use std::time::{Duration, Instant};

/// Radius of the largest disc over the longest side of the scene. This disc measures only the bias
/// of the next smaller one.
const RADIUS: f32 = 0.02;

/// Iterations that choose the radius.
const CHOOSING: u64 = 8;

/// Minimum number of iterations after these.
const MIN_ITERATIONS: u64 = 16;

/// Maximum number of iterations if there is no time.
const MOST_ITERATIONS: u64 = 1024;

/// Flux of a meter that none of many paths brought is, with a probability of 95 %, at most that of
/// so many paths.
const UNSEEN_PATHS: f64 = 3.0;

/// Share of its variance that the square of a bias has at least: a bias below it is not seen.
const LEAST_SQUARE: f64 = 0.25;

/// Sums over iterations of a quantity.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    count: f64,
    sum: f64,
    squares: f64,
    cubes: f64,
}

impl Sums {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
        self.cubes += value.powi(3);
    }

    fn mean(&self) -> f64 {
        self.sum / self.count.max(1.0)
    }

    /// Variance of the mean.
    fn variance(&self) -> f64 {
        let spread = (self.squares - self.sum * self.mean()).max(0.0);
        spread / ((self.count - 1.0).max(1.0) * self.count.max(1.0))
    }

    /// Skewness of the mean; 0 if the values are equal.
    fn skewness(&self) -> f64 {
        let [mean, square, cube] =
            [self.sum, self.squares, self.cubes].map(|sum| sum / self.count.max(1.0));
        let variance = square - mean * mean;
        if variance <= 1e-12 * square {
            return 0.0;
        }
        let third = cube - 3.0 * mean * square + 2.0 * mean.powi(3);
        third / (variance.powf(1.5) * self.count.sqrt())
    }
}

/// Irradiances on the discs of a meter, or of the mean of a set, W/m^2.
#[derive(Clone, Copy, Debug, Default)]
struct DiscSums {
    values: [Sums; RADII],
    /// Each radius less the next smaller one.
    differences: [Sums; RADII - 1],
}

impl DiscSums {
    fn add(&mut self, values: &DiscIrradiances) {
        self.values.iter_mut().zip(values).for_each(|(sums, value)| sums.add(*value));
        for (sums, pair) in self.differences.iter_mut().zip(values.windows(2)) {
            sums.add(pair[0] - pair[1]);
        }
    }

    /// The bias of a radius that has a smaller and a larger one, by the difference to each of
    /// them, W/m^2, with its variance. It grows with the square of the radius. theory.md (5c)
    fn biases(&self, level: usize) -> [(f64, f64); 2] {
        let square = f64::from(RATIO * RATIO);
        let of = |difference: &Sums, factor: f64| {
            (factor * difference.mean(), factor * factor * difference.variance())
        };
        [
            of(&self.differences[level], 1.0 / (1.0 - square)),
            of(&self.differences[level - 1], square / (1.0 - square)),
        ]
    }

    /// Bound of the bias of a radius, W/m^2: that of both estimates together, and by how much they
    /// differ beyond their noise. The larger disc has far less noise, but the irradiance may vary
    /// there in another way, such as at the edge of a shadow.
    fn bias(&self, level: usize) -> f64 {
        let [inner, outer] = self.biases(level);
        let differ = (inner.0 - outer.0).abs() - (inner.1 + outer.1).sqrt();
        let [a, b] = [inner, outer].map(|(_, variance)| 1.0 / variance.max(1e-200));
        let (bias, variance) = ((a * inner.0 + b * outer.0) / (a + b), 1.0 / (a + b));
        (bias * bias - variance).max(LEAST_SQUARE * variance).sqrt() + differ.max(0.0)
    }

    /// The radius with the least error.
    fn level(&self) -> usize {
        let error = |level: &usize| self.values[*level].variance() + self.bias(*level).powi(2);
        (1..RADII - 1).min_by(|a, b| error(a).total_cmp(&error(b))).expect("there are radii")
    }
}

/// Light at the meters of a render job.
pub(super) struct ArrivingLight<'a> {
    photons: MeterPhotons<'a>,
    /// Meters of each set.
    sets: Vec<Range<usize>>,
    /// Of the meters, then of the means of the sets: sums that choose the radius, and sums of the
    /// result.
    choosing: Vec<DiscSums>,
    sums: Vec<DiscSums>,
    levels: Vec<usize>,
    count: usize,
}

impl<'a> ArrivingLight<'a> {
    /// Starts to measure, and learns from where light arrives for about at most the time
    /// `learning`; `None` if no such light can arrive.
    pub fn new(
        scene: &'a Scene,
        accel: &'a dyn Intersect,
        meters: &[Meter],
        sets: Vec<Range<usize>>,
        seed: u64,
        learning: Option<Duration>,
    ) -> Option<Self> {
        let radius = RADIUS * scene.size();
        let photons = MeterPhotons::new(scene, accel, meters, radius, seed, learning)?;
        let count = meters.len();
        let all = vec![DiscSums::default(); count + sets.len()];
        let levels = vec![1; all.len()];
        Some(Self { photons, sets, choosing: all.clone(), sums: all, levels, count })
    }

    /// Traces photons until `time` is over, or `is_enough` returns true for the readings so far; at
    /// least some iterations.
    pub fn run(&mut self, time: Option<Duration>, mut is_enough: impl FnMut(&Self) -> bool) {
        let start = Instant::now();
        if let Some(time) = time {
            // The iterations that are always done must fit in the time.
            self.photons.fit(CHOOSING + MIN_ITERATIONS, time);
        }
        while self.photons.arrives() {
            let iterations = self.photons.iterations();
            let is_over = match time {
                Some(time) => start.elapsed() >= time,
                None => iterations >= MOST_ITERATIONS,
            };
            let is_long = iterations >= CHOOSING + MIN_ITERATIONS;
            if is_long && (is_over || is_enough(self)) {
                return;
            }
            self.iterate();
        }
    }

    fn iterate(&mut self) {
        let of_meters = self.photons.iterate();
        let mean = |range: &Range<usize>| -> DiscIrradiances {
            let own = &of_meters[range.clone()];
            std::array::from_fn(|level| {
                own.iter().map(|values| values[level]).sum::<f64>() / own.len() as f64
            })
        };
        let is_choosing = self.photons.iterations() <= CHOOSING;
        let sums = if is_choosing { &mut self.choosing } else { &mut self.sums };
        let means: Vec<DiscIrradiances> = self.sets.iter().map(mean).collect();
        sums.iter_mut().zip(of_meters.iter().chain(&means)).for_each(|(sums, own)| sums.add(own));
        if self.photons.iterations() == CHOOSING {
            self.levels = self.choosing.iter().map(DiscSums::level).collect();
        }
    }

    fn reading(&self, index: usize) -> Reading {
        let (sums, level) = (&self.sums[index], self.levels[index]);
        let values = &sums.values[level];
        let unseen = UNSEEN_PATHS * self.photons.of_one_path();
        if values.count < 2.0 {
            return Reading::with_bias(0.0, 0.0, unseen, 0.0, f64::INFINITY);
        }
        let bias = sums.bias(level) + unseen;
        let value = values.mean();
        let own = Reading::with_bias(value, values.variance(), bias, value, values.count);
        own.with_tail(&SampleTail { unseen: 0.0, skewness: values.skewness() })
    }

    /// Readings of this light alone: those of the meters of a set, and of their mean.
    pub fn readings(&self, set: usize) -> (Vec<Reading>, Reading) {
        let meters = self.sets[set].clone().map(|index| self.reading(index)).collect();
        (meters, self.reading(self.count + set))
    }

    /// Light paths and those of them that arrived, in words.
    pub fn technique(&self) -> String {
        format!(
            "{} iterations of {} light paths to the meters, {} arrived",
            self.photons.iterations(),
            self.photons.paths(),
            self.photons.arrived()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::base::rng::{Stream, StreamKey};

    /// Irradiances on discs by photons, whose number in each annulus varies with the square root of
    /// its mean, `mean` in the disc of level 1. The mean over a disc of the radius `r` is
    /// `1 + c r^2`, where the disc of level 1 has the radius 1; that of level 0 has `beyond` more.
    fn sums_of([c, mean, beyond]: [f64; 3], seed: u64) -> DiscSums {
        let mut rng = StreamKey::new(seed, Stream::Test, 0).rng(0);
        let mut normal = || (0..12).map(|_| f64::from(rng.next_1d())).sum::<f64>() - 6.0;
        let mut sums = DiscSums::default();
        // Over pi.
        let area = |level: usize| 4.0 * f64::from(RATIO).powi(2 * level as i32);
        for _ in 0..400 {
            let (mut inside, mut values) = (0.0, [0.0; RADII]);
            for level in (0..RADII).rev() {
                let next = if level + 1 < RADII { area(level + 1) } else { 0.0 };
                let own = area(level);
                let expected = mean * (own - next + c * (own * own - next * next));
                inside += expected + expected.sqrt() * normal();
                values[level] = inside / (mean * own);
            }
            values[0] += beyond;
            sums.add(&values);
        }
        sums
    }

    #[test]
    fn bias_of_a_square_law_is_found_and_the_radius_balances_it_with_the_noise() {
        let count = 20;
        for (c, mean, expected) in [(0.0, 25.0, 1), (0.3, 100.0, 3)] {
            let mut chosen = 0;
            for seed in 0..count {
                let sums = sums_of([c, mean, 0.0], 300 + seed);
                let error = sums.biases(1)[0].1.sqrt();
                assert!((sums.bias(1) - c).abs() < 4.5 * error, "{} {c}", sums.bias(1));
                chosen += u64::from(sums.level() == expected);
            }
            assert!(chosen >= count - 5, "{chosen} of {count}");
        }
    }

    /// Where the irradiance is even, the bound of the bias is a small part of the interval.
    #[test]
    fn bound_of_no_bias_is_less_than_the_noise() {
        let (mut shares, runs) = (0.0, 60);
        for seed in 0..runs {
            let sums = sums_of([0.0, 25.0, 0.0], 100 + seed);
            shares += sums.bias(1) / sums.values[1].variance().sqrt();
        }
        let share = shares / runs as f64;
        // By the smaller disc alone it is more than 1.5.
        assert!(share < 0.9, "{share}");
    }

    #[test]
    fn skewness_of_one_of_four_values_is_that_of_their_mean() {
        let mut sums = Sums::default();
        [0.0, 0.0, 1.0, 0.0].iter().for_each(|value| sums.add(*value));
        let expected = (3.0 / 32.0) / (3.0f64 / 16.0).powf(1.5) / 2.0;
        assert!((sums.skewness() - expected).abs() < 1e-9, "{}", sums.skewness());
        assert_eq!(Sums::default().skewness(), 0.0);
    }

    /// An irradiance that is even up to the disc of level 1, and other beyond it.
    #[test]
    fn discs_of_another_law_widen_the_bound() {
        let sums = sums_of([0.0, 400.0, 0.5], 9);
        assert!((sums.biases(1)[1].0 - 0.5 / 3.0).abs() < 0.01);
        // The smaller discs show no bias, so that the difference widens the bound once more.
        assert!((sums.bias(1) - 1.0 / 3.0).abs() < 0.02, "{}", sums.bias(1));
    }
}
