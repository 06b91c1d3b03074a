//! The reading of a meter with its uncertainty.

use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::base::quantiles::student_95;
use bdpm_core::scene::MeterKind;
use serde::Serialize;

/// Factor of the light that was hardly seen in the interval. Intervals of light that ten samples in
/// all carry then hold with 95 to 97 %.
const UNSEEN_FACTOR: f64 = 3.0;

/// Trials without an event bound its probability, with 95 %, by this number over theirs.
pub(super) const RULE_OF_THREE: f64 = 3.0;

/// Share of the interval without it from which the light that was hardly seen makes the interval
/// uncertain.
const UNSEEN_SHARE: f64 = 0.5;

/// Skewness of a mean from which about six samples or fewer carry the light above it: a mean of
/// events that happened `k` times has the skewness `1/sqrt(k)`. Intervals of more samples hold with
/// 95 %.
const FEW_SAMPLES: f64 = 0.4;

/// Share of the value below which an interval is so narrow that no note is worth it.
const NOTED_SHARE: f64 = 2e-3;

/// Light that few samples of a mean carry.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleTail {
    /// Light that the samples are expected to miss, in radiometric units. theory.md (5e)
    pub unseen: f64,
    /// Skewness of the mean: that of the samples over the square root of their number. theory.md
    /// (5g)
    pub skewness: f64,
}

/// Value of a meter and its uncertainty, in the [unit](unit()) of its kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Reading {
    /// Estimate of the quantity.
    pub value: f64,
    /// Standard error of the value: its noise.
    pub noise: f64,
    /// Bound of the merge bias, from its estimate over all meters.
    pub bias: f64,
    /// Half of the width of the interval that holds the true value with a probability of 95 %:
    /// noise and bias.
    pub expanded: f64,
    /// Part of the value that arrives straight from the light sources, or through clear glass and
    /// mirrors only.
    pub direct: f64,
}

impl Reading {
    /// A reading from the mean of this number of samples, in radiometric units, with the noise and
    /// the bias that its mean has. The interval has a probability of 95 %.
    pub fn new(value: f64, variance: f64, relative_bias: f64, direct: f64, samples: f64) -> Self {
        Self::with_bias(value, variance, relative_bias * value, direct, samples)
    }

    /// [`Self::new`] with a bias in radiometric units.
    pub fn with_bias(value: f64, variance: f64, bias: f64, direct: f64, samples: f64) -> Self {
        let [value, noise, bias, direct] = [value, variance.max(0.0).sqrt(), bias, direct]
            .map(|watts| watts * f64::from(LUMENS_PER_WATT));
        Self { value, noise, bias, expanded: student_95(samples - 1.0) * noise + bias, direct }
    }

    /// The reading with a wider interval, for samples of which few carry much light.
    /// theory.md (5e), (5g)
    #[must_use]
    pub fn with_tail(self, tail: &SampleTail) -> Self {
        let spread = self.expanded - self.bias;
        let skewed = tail.skewness.max(0.0) * spread;
        let unseen = UNSEEN_FACTOR * tail.unseen * f64::from(LUMENS_PER_WATT);
        Self { expanded: self.expanded + skewed + unseen, ..self }
    }

    /// The reading of so many paths of equal light, whose interval holds what one that was never
    /// traced may lack: with a probability of 95 %, an event that no path had has a probability of
    /// at most three over their number. theory.md (5f)
    #[must_use]
    pub(super) fn with_unseen_dark(self, paths: f64) -> Self {
        let unseen = RULE_OF_THREE * (self.indirect() / paths).max(0.0);
        match self.has_uncertainty() {
            true => Self { expanded: self.expanded.max(self.bias + unseen), ..self },
            false => self,
        }
    }

    /// Returns true if the interval of these samples is open above: so few of them carry much of
    /// the light that there may be more than any interval of them says. The reading is that before
    /// [`Self::with_tail`].
    pub fn is_open(&self, tail: &SampleTail) -> bool {
        let spread = self.expanded - self.bias;
        let unseen = tail.unseen * f64::from(LUMENS_PER_WATT);
        let is_rare = unseen > UNSEEN_SHARE * spread && unseen > 1e-3 * self.value;
        let is_few = tail.skewness > FEW_SAMPLES && spread > NOTED_SHARE * self.value;
        self.value > 0.0 && (is_rare || is_few)
    }

    /// A reading of 0. `bound` is an upper bound of the light that no path saw, in radiometric
    /// units; `seen` is the reading without it.
    pub(super) fn dark(bound: f64, seen: &Self) -> Self {
        let expanded = seen.expanded + bound * f64::from(LUMENS_PER_WATT);
        Self { expanded, bias: seen.bias, ..Self::default() }
    }

    /// The reading in another unit, of which one of its own is so many.
    #[must_use]
    pub(super) fn times(&self, factor: f64) -> Self {
        let Self { value, noise, bias, expanded, direct } = *self;
        let [value, noise, bias, expanded, direct] =
            [value, noise, bias, expanded, direct].map(|own| factor * own);
        Self { value, noise, bias, expanded, direct }
    }

    /// A reading that is not known: all numbers are NaN.
    pub fn unknown() -> Self {
        let nan = f64::NAN;
        Self { value: nan, noise: nan, bias: nan, expanded: nan, direct: nan }
    }

    /// Returns true unless the value is unknown.
    pub fn is_known(&self) -> bool {
        self.value.is_finite()
    }

    /// Returns true if the uncertainty is known: a single iteration has none.
    pub fn has_uncertainty(&self) -> bool {
        self.expanded.is_finite()
    }

    /// Expanded uncertainty over the value, or over `least` if that is larger: in the dark, hardly
    /// any light is worth the time to know it exactly. It is 0 if the reading is certain, and
    /// infinite if it is unknown, or 0 with an uncertainty.
    pub fn relative(&self, least: f64) -> f64 {
        let value = self.value.max(least);
        match (self.expanded == 0.0, value > 0.0 && self.expanded.is_finite()) {
            (true, _) => 0.0,
            (false, true) if self.is_known() => self.expanded / value,
            _ => f64::INFINITY,
        }
    }

    /// Part of the value that was reflected before it arrived.
    pub fn indirect(&self) -> f64 {
        self.value - self.direct
    }

    /// The reading under both of two independent groups of lights.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        let squares = |a: f64, b: f64| a.hypot(b);
        let spread = squares(self.expanded - self.bias, other.expanded - other.bias);
        let bias = self.bias + other.bias;
        Self {
            value: self.value + other.value,
            noise: squares(self.noise, other.noise),
            bias,
            expanded: spread + bias,
            direct: self.direct + other.direct,
        }
    }
}

/// Unit of the readings of a kind of meters.
pub fn unit(kind: MeterKind) -> &'static str {
    match kind {
        MeterKind::Irradiance => "lx",
        MeterKind::Radiance => "cd/m2",
    }
}

/// Name of the photometric quantity of a kind of meters.
pub fn quantity(kind: MeterKind) -> &'static str {
    match kind {
        MeterKind::Irradiance => "illuminance",
        MeterKind::Radiance => "luminance",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_paths_bound_what_none_of_them_had() {
        let reading =
            |expanded, direct| Reading { value: 300.0, noise: 0.0, bias: 0.0, expanded, direct };
        let bound = |own: Reading| own.with_unseen_dark(1000.0).expanded;
        assert!((bound(reading(0.0, 100.0)) - 3.0 * 200.0 / 1000.0).abs() < 1e-12);
        assert_eq!(bound(reading(2.0, 100.0)), 2.0);
        assert_eq!(bound(reading(0.0, 300.0)), 0.0);
        assert!(bound(reading(f64::NAN, 100.0)).is_nan());
    }

    #[test]
    fn relative_uncertainties_of_dark_and_unknown_readings_are_numbers() {
        let certain = Reading::default();
        assert_eq!((certain.relative(0.0), certain.relative(1.0)), (0.0, 0.0));
        let bounded = Reading::dark(0.01, &certain);
        assert_eq!(bounded.relative(0.0), f64::INFINITY);
        assert!((bounded.relative(10.0) - 0.001 * f64::from(LUMENS_PER_WATT)).abs() < 1e-9);
        assert_eq!(Reading::unknown().relative(1.0), f64::INFINITY);
        let one_iteration = Reading::new(1.0, 0.0, 0.0, 0.0, 1.0);
        assert_eq!(one_iteration.relative(0.0), f64::INFINITY);
    }

    #[test]
    fn light_that_was_hardly_seen_widens_the_interval() {
        let own = Reading::new(1.0, 1e-4, 0.0, 0.0, 100.0);
        let tail = |unseen, skewness| SampleTail { unseen, skewness };
        let lumens = f64::from(LUMENS_PER_WATT);
        let wide = own.with_tail(&tail(0.02, 0.0));
        assert!((wide.expanded - own.expanded - 0.06 * lumens).abs() < 1e-9);
        assert!(own.is_open(&tail(0.02, 0.0)) && !own.is_open(&tail(0.005, 0.0)));
        let skewed = own.with_tail(&tail(0.0, 0.5));
        assert!((skewed.expanded / own.expanded - 1.5).abs() < 1e-9);
        assert!(own.is_open(&tail(0.0, 0.5)) && !own.is_open(&tail(0.0, 0.2)));
        assert_eq!(own.with_tail(&tail(0.0, -3.0)), own, "light is not missed below the mean");
        assert!(!Reading::default().is_open(&tail(1.0, 1.0)));
    }

    #[test]
    fn independent_readings_add_variances_and_biases() {
        let lumens = f64::from(LUMENS_PER_WATT);
        let one = Reading::new(1.0, 9e-6, 0.01, 0.5, 1e6);
        let other = Reading::new(2.0, 16e-6, 0.0, 0.5, 1e6);
        let sum = one.plus(&other);
        assert!((sum.value / lumens - 3.0).abs() < 1e-9);
        assert!((sum.noise / lumens - 5e-3).abs() < 1e-9);
        assert!((sum.bias / lumens - 0.01).abs() < 1e-9);
        assert!((sum.expanded - 1.96 * sum.noise - sum.bias).abs() < 1e-3 * sum.noise);
        assert!((sum.indirect() / lumens - 2.0).abs() < 1e-9);
    }
}
