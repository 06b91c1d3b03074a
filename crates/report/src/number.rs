//! Numbers in pages.

use bdpm_core::image_io::digits;
use maud::{Markup, html};

/// A value with two digits of its standard error, or four digits of a value without a standard
/// error.
pub fn shown(estimate: impl Into<(f64, Option<f64>)>) -> Markup {
    let (value, error) = estimate.into();
    let error = error.filter(|error| error.is_finite() && *error > 0.0);
    let digits = digits(value, error.unwrap_or(0.0));
    html! {
        (format!("{value:.digits$}"))
        @if let Some(error) = error {
            span .error { " ± " (format!("{error:.digits$}")) }
        }
    }
}

/// A number with `digits` digits after the point.
pub fn fixed(value: f64, digits: usize) -> String {
    format!("{value:.digits$}")
}

/// Four significant digits.
pub fn significant(value: f64) -> String {
    format!("{value:.*}", digits(value, 0.0))
}

/// A whole number in groups of three digits.
pub fn count(value: impl Into<f64>) -> String {
    let digits = format!("{:.0}", value.into());
    let mut text = String::new();
    for (index, digit) in digits.char_indices() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_has_two_digits_and_count_has_groups_of_three() {
        let value = |value: f64, error: Option<f64>| shown((value, error)).into_string();
        assert_eq!(value(0.29884, Some(0.00123)), "0.2988<span class=\"error\"> ± 0.0012</span>");
        assert_eq!(value(0.29884, None), "0.2988");
        assert_eq!(value(1.0, Some(f64::INFINITY)), "1.000");
        assert_eq!(
            [count(100), count(1000), count(300_000)],
            ["100", "1\u{202f}000", "300\u{202f}000"]
        );
    }
}
