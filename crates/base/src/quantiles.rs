//! Quantiles for intervals of a two-sided probability of 95 %.

/// Quantile of the normal distribution that its modulus exceeds with a probability of 5 %.
pub const NORMAL_95: f64 = 1.959_964;

/// Quantiles of Student's distribution for 1 to 3 degrees of freedom, where its expansion is wrong.
const FEW_DEGREES: [f64; 3] = [12.706, 4.303, 3.182];

/// Quantile of Student's distribution of a two-sided probability of 95 %: of tables up to 3 degrees
/// of freedom, else by its expansion in the reciprocal of their number (Abramowitz and Stegun 1964,
/// 26.7.5), within 1 %. Infinite below 1 degree, or if their number is unknown.
#[inline]
pub fn student_95(degrees: f64) -> f64 {
    if degrees.is_nan() || degrees < 1.0 {
        return f64::INFINITY;
    }
    if let Some(quantile) = FEW_DEGREES.get(degrees as usize - 1) {
        return *quantile;
    }
    let z = NORMAL_95;
    let first = (z.powi(3) + z) / 4.0;
    let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0;
    let third = (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / 384.0;
    z + first / degrees + second / degrees.powi(2) + third / degrees.powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_tables() {
        let tables =
            [(1.0, 12.706), (2.0, 4.303), (4.0, 2.776), (10.0, 2.228), (30.0, 2.042), (1e9, 1.960)];
        for (degrees, expected) in tables {
            let quantile = student_95(degrees);
            assert!((quantile / expected - 1.0).abs() < 0.01, "{degrees}: {quantile}");
        }
        assert_eq!(student_95(0.0), f64::INFINITY);
        assert_eq!(student_95(f64::NAN), f64::INFINITY, "unknown degrees give no interval");
    }
}
