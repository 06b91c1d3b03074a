//! Scales of plots, and numbers rounded to their significant digits.

/// The value that the given share (in \[0, 1\]) of `values` does not exceed; 1 if it is not
/// positive.
pub fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let index = (share * values.len().saturating_sub(1) as f64).ceil() as usize;
    let found = values.get(index).copied().unwrap_or(0.0);
    if found > 0.0 { found } else { 1.0 }
}

/// 1, 2 or 5 times a power of ten, such that the scale has at most `steps` whole steps, and more
/// than a third as many.
pub fn tick_step(scale: f64, steps: f64) -> f64 {
    let rough = scale / steps;
    let power = 10f64.powf(rough.log10().floor());
    let factor = [1.0, 2.0, 5.0, 10.0].into_iter().find(|f| f * power >= rough * (1.0 - 1e-9));
    factor.unwrap_or(10.0) * power
}

/// Three significant digits without trailing zeros.
pub fn number(value: f64) -> String {
    if value == 0.0 {
        "0".into()
    } else if (1e-3..1e5).contains(&value.abs()) {
        let digits = (2 - value.abs().log10().floor() as i32).max(0) as usize;
        let text = format!("{value:.digits$}");
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').into()
        } else {
            text
        }
    } else {
        format!("{value:.2e}")
    }
}

/// Digits after the point that show an error with two significant digits; without an error, the
/// value with four.
pub fn digits(value: f64, error: f64) -> usize {
    let size = if error > 0.0 && error.is_finite() { error * 0.1 } else { value.abs() * 1e-3 };
    if size > 0.0 { (-size.log10().floor()).clamp(0.0, 12.0) as usize } else { 4 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tick_steps_divide_scales_into_4_to_10_round_steps() {
        for (scale, step) in [(1.0, 0.1), (1.9, 0.2), (2.1, 0.5), (0.00499, 5e-4), (740.0, 100.0)] {
            let found = tick_step(scale, 10.0);
            assert!((found / step - 1.0).abs() < 1e-9, "{scale}: {found}");
        }
    }

    #[test]
    fn numbers_have_only_significant_digits() {
        let numbers = [0.05, 120.0, 1e-5, -1.5, 0.0].map(number);
        assert_eq!(numbers, ["0.05", "120", "1.00e-5", "-1.5", "0"]);
        assert_eq!([digits(1.23456, 0.0123), digits(1234.5, 210.0), digits(0.5, 0.0)], [3, 0, 4]);
    }

    #[test]
    fn quantile_leaves_out_the_brightest_values() {
        assert_eq!(quantile((1..=1000).map(f64::from).collect(), 0.995), 996.0);
        assert_eq!(quantile(vec![-1.0, -2.0], 0.5), 1.0);
        assert_eq!(quantile(Vec::new(), 0.5), 1.0);
    }
}
