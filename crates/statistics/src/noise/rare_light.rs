//! Light that was hardly seen: a bound from the contributions that were seen once.
//!
//! Few paths may carry much of the light: by a keyhole, or in a caustic. Before they are sampled,
//! both the mean and its sample variance are too low. Good and Turing (Good, *The Population
//! Frequencies of Species and the Estimation of Population Parameters*, 1953) estimate what was not
//! seen from what was seen once. With classes `k` of the probability `p_k` and the contribution
//! `c_k`, the light that `n` samples miss and the light of classes that they have exactly once have
//! nearly the same expected value:
//!
//! ```text
//! E[missed] = sum p_k c_k (1 - p_k)^n,   E[seen once]/n = sum p_k c_k (1 - p_k)^(n-1)
//! ```
//!
//! theory.md (5e)

/// Exponents of classes that are kept, as powers of two; smaller contributions count for the
/// smallest.
const LEAST_EXPONENT: i32 = -64;

/// Sums over the samples of a mean, by classes of what they exceed it by: powers of two.
///
/// The mean is not known before the last sample. Classes are therefore those of the values, from a
/// start that the first samples give.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RareLight {
    /// For each power of two of the values: samples, and their sum.
    classes: Vec<(u32, f64)>,
    count: u64,
    /// Sums of the samples, of their squares, and of their cubes.
    powers: [f64; 3],
}

impl RareLight {
    /// Adds a sample, such as the mean of a pixel in an iteration. It is not negative.
    #[inline]
    pub fn add(&mut self, value: f64) {
        self.count += 1;
        for (sum, exponent) in self.powers.iter_mut().zip(1..) {
            *sum += value.powi(exponent);
        }
        if value > 0.0 && value.is_finite() {
            let exponent = (2.0 * value.log2()).floor() as i32;
            let index =
                exponent.clamp(2 * LEAST_EXPONENT, 2 * -LEAST_EXPONENT) - 2 * LEAST_EXPONENT;
            let index = index as usize;
            if self.classes.len() <= index {
                self.classes.resize(index + 1, (0, 0.0));
            }
            let (count, sum) = &mut self.classes[index];
            (*count, *sum) = (*count + 1, *sum + value);
        }
    }

    /// Number of samples.
    #[inline]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Mean square and mean cube of the differences of the samples from their mean.
    pub fn central_moments(&self) -> [f64; 2] {
        if self.count == 0 {
            return [0.0; 2];
        }
        let [mean, square, cube] = self.powers.map(|sum| sum / self.count as f64);
        let variance = square - mean * mean;
        // Rounding of the sums, of which both moments are small differences.
        if variance <= 1e-12 * square {
            return [0.0; 2];
        }
        [variance, cube - 3.0 * mean * square + 2.0 * mean.powi(3)]
    }

    /// Expected value of the light that the samples miss, in their unit: the part above the mean of
    /// the samples that are alone in their class, over the number of samples.
    pub fn unseen(&self) -> f64 {
        if self.count == 0 {
            return 0.0;
        }
        let mean = self.powers[0] / self.count as f64;
        let alone = self.classes.iter().filter(|(count, _)| *count == 1);
        let above: f64 = alone.map(|(_, value)| (value - mean).max(0.0)).sum();
        above / self.count as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_base::rng::{Rng, Stream, StreamKey};

    fn rng(iteration: u64) -> Rng {
        StreamKey::new(11, Stream::Test, iteration).rng(0)
    }

    /// A sample of 1, or with the probability `prob` of a rare value of any size.
    fn sample(rng: &mut Rng, prob: f64) -> f64 {
        let rare = f64::from(rng.next_1d()) < prob;
        let size = -f64::from(1.0 - rng.next_1d()).ln() / prob;
        1.0 + 0.01 * f64::from(rng.next_1d()) + if rare { 0.3 * size } else { 0.0 }
    }

    /// Rare light of many classes: what is missed has the expected value of what is seen once.
    #[test]
    fn light_seen_once_is_the_light_that_is_missed() {
        // Classes of even probability and growing contributions, each far more than the mean.
        let (classes, prob, samples) = (24, 0.004, 150);
        let contribution = |class: i32| 100.0 * 2f64.powi(class % 12);
        let (mut missed, mut unseen, runs) = (0.0, 0.0, 3000);
        for run in 0..runs {
            let mut rng = rng(run);
            let mut rare = RareLight::default();
            let mut seen = vec![false; classes as usize];
            for _ in 0..samples {
                let class = (f64::from(rng.next_1d()) / prob) as i32;
                if class < classes {
                    seen[class as usize] = true;
                    rare.add(contribution(class));
                } else {
                    rare.add(0.0);
                }
            }
            // Classes of one contribution are one class here.
            let of_pair = |class: i32| !seen[class as usize] && !seen[(class + 12) as usize];
            let left = (0..12).filter(|class| of_pair(*class));
            missed += left.map(|class| 2.0 * prob * contribution(class)).sum::<f64>();
            unseen += rare.unseen();
        }
        let ratio = unseen / missed;
        assert!((0.85..1.1).contains(&ratio), "{ratio}");
    }

    #[test]
    fn even_samples_miss_next_to_nothing() {
        let mut rng = rng(0);
        let mut rare = RareLight::default();
        let (mut sum, mut squares, n) = (0.0, 0.0, 400.0);
        for _ in 0..400 {
            let value = 10.0 + f64::from(rng.next_1d());
            rare.add(value);
            (sum, squares) = (sum + value, squares + value * value);
        }
        let error = ((squares / n - (sum / n).powi(2)) / n).sqrt();
        assert!(rare.unseen() < 0.2 * error, "{} {error}", rare.unseen());
    }

    /// Intervals that three times the missed light widens hold more often where light is rare.
    #[test]
    fn wider_intervals_hold_more_often_where_light_is_rare() {
        let (n, runs, expected) = (100, 1500, 1.305);
        let (mut plain, mut wide) = (0, 0);
        for run in 0..runs {
            let mut rng = rng(run);
            let mut rare = RareLight::default();
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..n {
                let value = sample(&mut rng, 0.05);
                rare.add(value);
                (sum, squares) = (sum + value, squares + value * value);
            }
            let count = f64::from(n);
            let mean = sum / count;
            let error = ((squares / count - mean * mean) / (count - 1.0)).sqrt();
            let off: f64 = mean - expected;
            plain += u32::from(off.abs() <= 1.98 * error);
            wide += u32::from(off.abs() <= 1.98 * error + 3.0 * rare.unseen());
        }
        println!("{plain} and {wide} of {runs}");
        assert!(plain < 1290 && wide > plain + 75, "{plain} {wide}");
    }

    #[test]
    fn central_moments_are_those_of_the_samples() {
        let mut rare = RareLight::default();
        [3.0, 3.0, 3.0, 7.0].iter().for_each(|value| rare.add(*value));
        // Differences -1, -1, -1 and 3.
        assert_eq!(rare.central_moments(), [3.0, 6.0]);
        let mut even = RareLight::default();
        (0..5).for_each(|_| even.add(1.0 / 3.0));
        assert_eq!(even.central_moments(), [0.0; 2]);
        assert_eq!(RareLight::default().central_moments(), [0.0; 2]);
    }

    #[test]
    fn nothing_is_known_without_samples() {
        assert_eq!(RareLight::default().unseen(), 0.0);
        let mut one = RareLight::default();
        one.add(5.0);
        assert_eq!((one.count(), one.unseen()), (1, 0.0));
        one.add(f64::INFINITY);
        assert_eq!(one.count(), 2);
    }
}
