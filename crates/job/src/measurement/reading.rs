//! The reading of a meter with its uncertainty.

use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::base::quantiles::student_95;
use bdpm_core::scene::MeterKind;
use serde::Serialize;

/// Factor of the light that was hardly seen in the interval. Intervals of light that ten samples in
/// all carry then hold with 95 to 97 %.
const UNSEEN_FACTOR: f64 = 3.0;

/// Share of the interval without it from which the light that was hardly seen makes the interval
/// uncertain.
const UNSEEN_SHARE: f64 = 0.5;

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

    /// The reading with a wider interval, for light that its samples are expected to miss, in
    /// radiometric units. theory.md (5e)
    #[must_use]
    pub fn with_unseen(self, unseen: f64) -> Self {
        let unseen = UNSEEN_FACTOR * unseen * f64::from(LUMENS_PER_WATT);
        Self { expanded: self.expanded + unseen, ..self }
    }

    /// Returns true if so much of the interval is for light that was hardly seen that it holds less
    /// often than it says. `samples` is the number of iterations.
    pub fn saw_little(&self, samples: f64) -> bool {
        let spread = student_95(samples - 1.0) * self.noise;
        let unseen = (self.expanded - self.bias - spread) / UNSEEN_FACTOR;
        unseen > UNSEEN_SHARE * spread && unseen > 1e-3 * self.value
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

    /// The reading, or an unknown one if no path contributed to it. No interval follows from
    /// nothing seen.
    #[must_use]
    pub fn if_seen(self) -> Self {
        if self.value > 0.0 { self } else { Self::unknown() }
    }

    /// Expanded uncertainty over the value, or over `least` if that is larger: in the dark, hardly
    /// any light is worth the time to know it exactly. It is infinite if no path contributed, since
    /// nothing is known then.
    pub fn relative(&self, least: f64) -> f64 {
        let value = self.value.max(least);
        if self.value > 0.0 { self.expanded / value } else { f64::INFINITY }
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
    fn readings_without_a_contribution_are_unknown() {
        let dark = Reading::new(0.0, 0.0, 0.0, 0.0, 1e6);
        assert!(!dark.if_seen().is_known() && dark.if_seen().expanded.is_nan());
        assert_eq!(dark.relative(1.0), f64::INFINITY);
        assert_eq!(Reading::unknown().relative(1.0), f64::INFINITY);
        let lit = Reading::new(1.0, 0.0, 0.0, 0.0, 1e6);
        assert_eq!(lit.if_seen(), lit);
    }

    #[test]
    fn light_that_was_hardly_seen_widens_the_interval() {
        let own = Reading::new(1.0, 1e-4, 0.0, 0.0, 100.0);
        let wide = own.with_unseen(0.02);
        let lumens = f64::from(LUMENS_PER_WATT);
        assert!((wide.expanded - own.expanded - 0.06 * lumens).abs() < 1e-9);
        assert!(wide.saw_little(100.0) && !own.saw_little(100.0));
        assert!(!own.with_unseen(0.005).saw_little(100.0));
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
