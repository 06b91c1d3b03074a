//! Noise where a correction exceeds it.

use super::*;

#[test]
fn noise_is_a_number_where_the_correction_exceeds_the_variance() {
    for (variances, expected) in [([3.0, 4.0], 3.0), ([-1.0, 4.0], 4.0), ([-1.0, 0.0], 0.0)] {
        assert_eq!(positive_variance(variances), expected);
    }
}
