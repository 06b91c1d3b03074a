//! Means over squares around each pixel.

use rayon::prelude::*;

/// Means over the pixels at most `radius` away along either axis.
pub fn boxes(values: &[f64], (width, height): (usize, usize), radius: usize) -> Vec<f64> {
    // Sums over rectangles from the corner, one column and row larger.
    let mut corner = vec![0.0; (width + 1) * (height + 1)];
    for y in 0..height {
        let mut row = 0.0;
        for x in 0..width {
            row += values[y * width + x];
            corner[(y + 1) * (width + 1) + x + 1] = corner[y * (width + 1) + x + 1] + row;
        }
    }
    let at = |x: usize, y: usize| corner[y * (width + 1) + x];
    let mean = |index: usize| {
        let (x, y) = (index % width, index / width);
        let (left, right) = (x.saturating_sub(radius), (x + radius + 1).min(width));
        let (top, bottom) = (y.saturating_sub(radius), (y + radius + 1).min(height));
        let sum = at(right, bottom) - at(left, bottom) - at(right, top) + at(left, top);
        sum / ((right - left) * (bottom - top)) as f64
    };
    (0..width * height).into_par_iter().map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_at_the_border_are_means_over_the_inside() {
        let values: Vec<f64> = (0..35).map(|i| f64::from(i * i % 11)).collect();
        for radius in [0, 1, 3, 40] {
            for (index, mean) in boxes(&values, (7, 5), radius).into_iter().enumerate() {
                let near = |i: &usize| {
                    (i % 7).abs_diff(index % 7) <= radius && (i / 7).abs_diff(index / 7) <= radius
                };
                let own: Vec<f64> = (0..35).filter(near).map(|i| values[i]).collect();
                let expected = own.iter().sum::<f64>() / own.len() as f64;
                assert!((mean - expected).abs() < 1e-9, "{radius} {index}");
            }
        }
    }
}
