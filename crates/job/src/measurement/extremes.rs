//! Minimum, maximum and uniformity of a grid of meters, with intervals.
//!
//! The least of many noisy readings is too low: noise chooses it. Readings are therefore drawn
//! together by the share of their spread that is noise, before the least is taken, and intervals
//! hold for all meters at once.

use super::reading::Reading;
use bdpm_core::base::quantiles::NORMAL_95;
use bdpm_core::noise::significance::normal_quantile;
use serde::Serialize;

/// Half of the probability that an interval does not hold.
const TAIL: f64 = 0.025;

/// An estimate and half of the width of its interval with a probability of at least 95 %.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimated {
    /// The estimate; NaN if it is unknown.
    pub value: f64,
    /// Half of the width of the interval.
    pub expanded: f64,
}

impl Estimated {
    /// An estimate that is not known.
    pub const UNKNOWN: Self = Self { value: f64::NAN, expanded: f64::NAN };

    /// The ratio of two estimates. Their relative errors are taken as independent.
    #[must_use]
    pub fn over(&self, other: &Self) -> Self {
        let value = self.value / other.value;
        if !value.is_finite() {
            return Self::UNKNOWN;
        }
        // Of the squared relative errors, so that a value of 0 has an error as well.
        let expanded = (self.expanded / other.value).hypot(value * other.expanded / other.value);
        Self { value, expanded }
    }
}

impl From<&Reading> for Estimated {
    fn from(reading: &Reading) -> Self {
        Self { value: reading.value, expanded: reading.expanded }
    }
}

/// Minimum and maximum of the true values of all meters; unknown if one reading is.
/// theory.md (5d)
pub(super) fn extremes(readings: &[Reading]) -> [Estimated; 2] {
    if readings.is_empty() || !readings.iter().all(Reading::is_known) {
        return [Estimated::UNKNOWN; 2];
    }
    if let [only] = readings {
        return [only.into(); 2];
    }
    let count = readings.len() as f64;
    let mean = readings.iter().map(|own| own.value).sum::<f64>() / count;
    let spread = readings.iter().map(|own| (own.value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let noise = readings.iter().map(|own| own.noise.powi(2)).sum::<f64>() / count;
    // Variance of the true values over meters.
    let own = (spread - noise).max(0.0);
    let drawn = |reading: &Reading| {
        let variance = own + reading.noise.powi(2);
        let share = if variance > 0.0 { own / variance } else { 1.0 };
        mean + share * (reading.value - mean)
    };
    let factor = factor_of_all(readings.len());
    let width = |reading: &Reading| factor * (reading.expanded - reading.bias) + reading.bias;
    // `sign` is -1 for the maximum.
    let extreme = |sign: f64| {
        let least = |of: &dyn Fn(&Reading) -> f64| {
            readings.iter().map(|reading| sign * of(reading)).fold(f64::INFINITY, f64::min)
        };
        let low = least(&|reading| reading.value - sign * width(reading));
        let high = least(&|reading| reading.value + sign * width(reading));
        let value = least(&drawn).clamp(low, high);
        Estimated { value: sign * value, expanded: (high - value).max(value - low) }
    };
    [extreme(1.0), extreme(-1.0)]
}

/// Factor on the width of the interval of each of so many meters, such that all of them hold with a
/// probability of 95 % at once.
pub(super) fn factor_of_all(meters: usize) -> f64 {
    normal_quantile(1.0 - TAIL / meters as f64) / NORMAL_95
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::base::rng::{Rng, Stream, StreamKey};

    /// A normal number, by the sum of twelve uniform ones.
    fn normal(rng: &mut Rng) -> f64 {
        (0..12).map(|_| f64::from(rng.next_1d())).sum::<f64>() - 6.0
    }

    fn readings(rng: &mut Rng, noise: f64, truth: impl Fn(usize) -> f64) -> Vec<Reading> {
        let reading = |index: usize| {
            let value = truth(index) + noise * normal(rng);
            Reading { value, noise, bias: 0.0, expanded: NORMAL_95 * noise, direct: value }
        };
        (0..240).map(reading).collect()
    }

    #[test]
    fn intervals_hold_the_true_extremes_of_even_and_uneven_grids() {
        let mut rng = StreamKey::new(8, Stream::Test, 0).rng(0);
        for (slope, name) in [(0.0, "even"), (1e-3, "sloped"), (0.1, "steep")] {
            let truth = |index: usize| 100.0 * (1.0 + slope * index as f64 / 239.0);
            let (mut held, mut sum) = (0, 0.0);
            let runs = 300;
            for _ in 0..runs {
                let [least, most] = extremes(&readings(&mut rng, 1.0, truth));
                held += usize::from((least.value - truth(0)).abs() <= least.expanded);
                held += usize::from((most.value - truth(239)).abs() <= most.expanded);
                sum += least.value - truth(0);
            }
            // 95 % of 600 are 570 with a standard deviation of 5.3.
            assert!(held >= 555, "{name}: {held}");
            // The plain minimum is off by 2.8 standard deviations.
            let off = sum / f64::from(runs);
            assert!(off.abs() < 1.7, "{name}: {off}");
        }
    }

    #[test]
    fn plane_that_is_exactly_even_has_the_uniformity_1() {
        let mut rng = StreamKey::new(9, Stream::Test, 0).rng(0);
        let own = readings(&mut rng, 3.0, |_| 100.0);
        let plain = own.iter().map(|reading| reading.value).fold(f64::INFINITY, f64::min);
        assert!(plain < 94.0, "{plain}");
        let mean = own.iter().map(|reading| reading.value).sum::<f64>() / 240.0;
        let [least, _] = extremes(&own);
        let uniformity = least.over(&Estimated { value: mean, expanded: 0.4 });
        assert!((uniformity.value - 1.0).abs() < 0.02, "{uniformity:?}");
        assert!((uniformity.value - 1.0).abs() <= uniformity.expanded);
    }

    #[test]
    fn ratios_of_dark_values_are_0_or_unknown() {
        let [dark, lit] = [0.0, 5.0].map(|value| Estimated { value, expanded: 0.1 });
        assert_eq!(dark.over(&lit), Estimated { value: 0.0, expanded: 0.02 });
        let certain = Estimated { value: 0.0, expanded: 0.0 };
        assert_eq!(certain.over(&lit), certain);
        for other in [dark, certain, Estimated::UNKNOWN] {
            assert!(lit.over(&other).value.is_nan() && dark.over(&other).expanded.is_nan());
        }
    }

    #[test]
    fn grids_with_certain_dark_meters_have_the_minimum_0() {
        let (lit, dark) = (Reading::new(1.0, 1e-6, 0.0, 0.0, 1e6), Reading::default());
        let [least, most] = extremes(&[lit, dark, dark, lit]);
        assert!(least.value.abs() < 1e-6 * most.value && least.expanded < 1e-6 * most.value);
        assert!((most.value / lit.value - 1.0).abs() < 1e-3 && most.expanded.is_finite());
    }

    #[test]
    fn grids_with_an_unknown_reading_have_no_extremes() {
        let known = Reading::new(1.0, 0.0, 0.0, 0.0, 1e6);
        let [least, most] = extremes(&[known, Reading::unknown()]);
        assert!(least.value.is_nan() && most.value.is_nan());
        assert_eq!(extremes(&[known])[0], Estimated::from(&known));
        assert_eq!(extremes(&[known; 3])[0].value, known.value);
    }
}
