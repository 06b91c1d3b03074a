//! Decimal places of readings.

use bdpm::measurement::Reading;

/// Decimal places that show two digits of the uncertainty.
pub fn digits(reading: &Reading) -> usize {
    digits_of(reading.expanded)
}

/// Decimal places that show two digits of this uncertainty.
pub fn digits_of(expanded: f64) -> usize {
    let size = expanded.abs();
    if !(size > 0.0 && size.is_finite()) {
        return 1;
    }
    (1.0 - size.log10().floor()).clamp(0.0, 6.0) as usize
}

/// An uncertainty with these decimal places, or that it is unknown.
pub fn uncertainty(value: f64, digits: usize) -> String {
    if value.is_finite() { format!("{value:.digits$}") } else { UNKNOWN.to_owned() }
}

/// Shown in place of a number that is not known.
pub const UNKNOWN: &str = "unknown";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_show_two_digits_of_the_uncertainty() {
        for (expanded, expected) in [(0.0, 1), (0.1, 2), (0.099, 3), (1.3, 1), (14.0, 0), (1e9, 0)]
        {
            let reading = Reading { expanded, ..Reading::default() };
            assert_eq!(digits(&reading), expected, "{expanded}");
        }
    }

    #[test]
    fn uncertainties_of_one_iteration_are_unknown() {
        assert_eq!(uncertainty(1.25, 1), "1.2");
        for value in [f64::NAN, f64::INFINITY] {
            assert_eq!(uncertainty(value, digits_of(value)), UNKNOWN);
        }
    }
}
