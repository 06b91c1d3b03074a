//! Squares of cells whose errors are nearly independent.
//!
//! Neighboring pixels see the same photons, so that the error of a mean over the image does not
//! follow from the errors of single pixels. Sums over squares that are much larger than a merge
//! disc have nearly independent errors.

use rayon::prelude::*;

/// Squares along the longer side of the image.
const ACROSS: u32 = 8;

/// Minimum side of a square, cells.
const MIN_SIDE: u32 = 8;

/// Sum over squares of the image of the squared sums of their `values`, which are in row order. If
/// the values have expectation 0, this is an estimate of the variance of the sum of all values.
pub fn sum_of_squared_sums(values: &[f64], (width, height): (u32, u32)) -> f64 {
    let side = (width.max(height) / ACROSS).max(MIN_SIDE) as usize;
    let (width, height) = (width as usize, height as usize);
    let band = |y: usize| -> f64 {
        let squares = (0..width).step_by(side).map(|x| {
            let rows = y..(y + side).min(height);
            let of_row = |row: usize| {
                let start = row * width + x;
                values[start..row * width + (x + side).min(width)].iter().sum::<f64>()
            };
            rows.map(of_row).sum::<f64>().powi(2)
        });
        squares.sum()
    };
    let bands: Vec<usize> = (0..height).step_by(side).collect();
    let sums: Vec<f64> = bands.into_par_iter().map(band).collect();
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_base::rng::{Stream, StreamKey};

    #[test]
    fn squares_cover_the_image_once() {
        // One value at each place in turn: its square must be found.
        let (width, height) = (70, 20);
        for index in [0, 69, 8 * 70 + 63, 19 * 70 + 69] {
            let mut values = vec![0.0; 1400];
            values[index] = 3.0;
            assert_eq!(sum_of_squared_sums(&values, (width, height)), 9.0);
        }
        // Squares of 8 by 8, and smaller ones at the right and lower border.
        let ones = sum_of_squared_sums(&[1.0; 1400], (width, height));
        let sides = |length: u32| {
            (0..length).step_by(8).map(|x| f64::from((length - x).min(8)).powi(2)).sum::<f64>()
        };
        assert_eq!(ones, sides(70) * sides(20));
    }

    #[test]
    fn estimates_the_variance_of_the_sum_of_correlated_values() {
        // Blobs of 3 by 3 pixels share a random value: the variance of the sum is 81 per blob.
        let (side, blobs) = (96u32, 32 * 32);
        let (mut estimate, mut sampled, runs) = (0.0, 0.0, 200);
        for run in 0..runs {
            let mut rng = StreamKey::new(run, Stream::Pilot, 0).rng(0);
            let own: Vec<f64> = (0..blobs)
                .map(|_| f64::from(rng.next_1d()) - 0.5)
                .map(|uniform| uniform * 12.0f64.sqrt())
                .collect();
            let value = |i: u32| own[(i / side / 3 * 32 + i % side / 3) as usize];
            let values: Vec<f64> = (0..side * side).map(value).collect();
            estimate += sum_of_squared_sums(&values, (side, side)) / runs as f64;
            sampled += values.iter().sum::<f64>().powi(2) / runs as f64;
        }
        let expected = 81.0 * f64::from(blobs);
        // Both have 200 samples of relative variance 2, the estimate of 64 squares each.
        assert!((estimate / expected - 1.0).abs() < 4.0 * (2.0 / (200.0 * 64.0f64)).sqrt());
        assert!((sampled / expected - 1.0).abs() < 4.0 * (2.0 / 200.0f64).sqrt());
    }
}
