//! Means around each pixel with weights that decrease with the distance.

use rayon::prelude::*;

/// Weighted means around each pixel. The weights decrease linearly to 0 at a distance of five
/// pixels along rows and columns.
pub(super) fn smooth<const N: usize>(
    values: &[[f64; N]],
    width: usize,
    height: usize,
) -> Vec<[f64; N]> {
    let along = |values: &[[f64; N]], step: usize, radius: usize, length: usize| {
        let mean = |index: usize| {
            let center = index / step % length;
            let (mut sums, mut all) = ([0.0; N], 0.0);
            for other in center.saturating_sub(radius)..(center + radius + 1).min(length) {
                let weight = (radius + 1 - center.abs_diff(other)) as f64;
                let values = &values[index + other * step - center * step];
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
                all += weight;
            }
            sums.map(|sum| sum / all)
        };
        (0..values.len()).into_par_iter().map(mean).collect::<Vec<_>>()
    };
    let rows = along(values, 1, SMOOTHING_RADIUS, width);
    along(&rows, width, SMOOTHING_RADIUS, height)
}

/// Radius of [`smooth`], pixels.
const SMOOTHING_RADIUS: usize = 4;
