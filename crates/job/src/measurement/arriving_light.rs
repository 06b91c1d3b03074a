//! Light of points, spots and parallel light that arrives at meters by mirrors and through glass
//! that is no pane: photons on discs, with their noise and bias.

use super::reading::Reading;
use bdpm_core::accel::Intersect;
use bdpm_core::scene::{Meter, Scene};
use bdpm_core::transport::meter_photons::{DiscIrradiances, MeterPhotons, RADII, RATIO};
use std::ops::Range;
use std::time::{Duration, Instant};

/// Radius of the largest disc over the longest side of the scene.
const RADIUS: f32 = 0.01;

/// Iterations that choose the radius.
const CHOOSING: u64 = 8;

/// Minimum number of iterations after these.
const MIN_ITERATIONS: u64 = 16;

/// Maximum number of iterations if there is no time.
const MOST_ITERATIONS: u64 = 1024;

/// Flux of a meter that none of many paths brought is, with a probability of 95 %, at most that of
/// so many paths.
const UNSEEN_PATHS: f64 = 3.0;

/// Share of the variance of a difference of two radii that its square has at least: a bias below it
/// is not seen.
const LEAST_SQUARE: f64 = 0.25;

/// Sums over iterations of a quantity.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    count: f64,
    sum: f64,
    squares: f64,
}

impl Sums {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    fn mean(&self) -> f64 {
        self.sum / self.count.max(1.0)
    }

    /// Variance of the mean.
    fn variance(&self) -> f64 {
        let spread = (self.squares - self.sum * self.mean()).max(0.0);
        spread / ((self.count - 1.0).max(1.0) * self.count.max(1.0))
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

    /// Bound of the bias of a radius, W/m^2. It grows with the square of the radius, hence it is
    /// the difference to the next radius over `1 - RATIO^2`.
    fn bias(&self, level: usize) -> f64 {
        let difference = &self.differences[level];
        let variance = difference.variance();
        let square = (difference.mean().powi(2) - variance).max(LEAST_SQUARE * variance);
        square.sqrt() / f64::from(1.0 - RATIO * RATIO)
    }

    /// The radius with the least error.
    fn level(&self) -> usize {
        let error = |level: &usize| self.values[*level].variance() + self.bias(*level).powi(2);
        (0..RADII - 1).min_by(|a, b| error(a).total_cmp(&error(b))).expect("there are radii")
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
        let levels = vec![0; all.len()];
        Some(Self { photons, sets, choosing: all.clone(), sums: all, levels, count })
    }

    /// Traces photons until `time` is over, or `is_enough` returns true for the readings so far; at
    /// least some iterations.
    pub fn run(&mut self, time: Option<Duration>, mut is_enough: impl FnMut(&Self) -> bool) {
        let start = Instant::now();
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
        Reading::with_bias(value, values.variance(), bias, value, values.count)
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
            bdpm_core::transport::meter_photons::PATHS,
            self.photons.arrived()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::base::rng::{Stream, StreamKey};

    /// Irradiances with a bias of `c r^2` and more noise on smaller discs.
    #[test]
    fn bias_of_a_square_law_is_found_and_the_radius_balances_it_with_the_noise() {
        for (c, expected) in [(0.0, 0), (0.3, 2)] {
            let mut rng = StreamKey::new(5, Stream::Test, 0).rng(0);
            let mut sums = DiscSums::default();
            for _ in 0..400 {
                let values = std::array::from_fn(|level| {
                    let radius = f64::from(RATIO).powi(level as i32);
                    let noise = 0.02 / radius * (f64::from(rng.next_1d()) - 0.5);
                    1.0 + c * radius * radius + noise
                });
                sums.add(&values);
            }
            let error = 2.0 * sums.differences[0].variance().sqrt();
            assert!((sums.bias(0) - c).abs() < 3.0 * error + 1e-9, "{} {c}", sums.bias(0));
            assert_eq!(sums.level(), expected);
        }
    }
}
