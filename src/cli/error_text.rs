//! Errors of images in words.

use bdpm::adaptive::error_interval::{COVERAGE, ErrorInterval};

/// An error in words: the value with its interval, or the bound where only that is known.
pub fn error_text(error: f64, interval: Option<&ErrorInterval>) -> String {
    match interval {
        Some(&ErrorInterval { low: 0.0, high }) if high > 0.0 && high.is_finite() => {
            format!("at most {:.2} %", 100.0 * high)
        }
        interval => format!("{:.2} %{}", 100.0 * error, interval.map_or("".into(), interval_text)),
    }
}

/// The interval of an error in words.
pub fn interval_text(interval: &ErrorInterval) -> String {
    let ErrorInterval { low, high } = interval;
    if *low == 0.0 && high.is_finite() {
        return format!(" ({:.0} %: at most {:.2} %)", 100.0 * COVERAGE, 100.0 * high);
    }
    if high.is_infinite() {
        return format!(" (at least {:.2} %)", 100.0 * low);
    }
    format!(" ({:.0} %: {:.2} to {:.2} %)", 100.0 * COVERAGE, 100.0 * low, 100.0 * high)
}
