//! Differences between two images.

use super::radiance::luminance;
use bdpm_base::error::{Error, Result};
use bdpm_base::math::Rgb;
use serde::Serialize;

/// Differences of image `a` from the reference `b`, over pixels that are finite in both.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Mean luminance of `a` over that of `b`; `None` if `b` is black.
    pub mean_ratio: Option<f64>,
    /// Root of the mean squared difference of luminance, W/(m^2 sr).
    /// theory.md (95).
    pub rmse: f64,
    /// Mean over pixels of `(a - b)^2 / (b^2 + 0.01 mean(b)^2)` on luminance: noise in dark regions
    /// has the same weight as in bright ones, down to a tenth of the mean. `None` if `b` is black.
    pub relative_mse: Option<f64>,
    /// Maximum absolute difference in any channel, W/(m^2 sr); 0 only for equal images.
    pub max_difference: f64,
    /// Column and row of the first pixel with the maximum difference.
    pub max_pixel: [u32; 2],
    /// Pixels of `a` with a value that is not finite.
    pub non_finite_a: usize,
    /// Pixels of `b` with a value that is not finite.
    pub non_finite_b: usize,
}

/// Compares two images of the same size, row by row.
///
/// # Errors
/// If the sizes differ or no pixel is finite in both.
pub fn compare(
    (a, a_size): (&[Rgb], (u32, u32)),
    (b, b_size): (&[Rgb], (u32, u32)),
) -> Result<Comparison> {
    if a_size != b_size {
        let ((aw, ah), (bw, bh)) = (a_size, b_size);
        return Err(Error::new(
            format!("the images differ in size: {aw}x{ah} and {bw}x{bh} pixels"),
            "compare images of the same resolution",
        ));
    }
    let bad = |image: &[Rgb]| image.iter().filter(|pixel| !pixel.is_finite()).count();
    let (non_finite_a, non_finite_b) = (bad(a), bad(b));
    let both = || {
        let pairs = a.iter().zip(b).enumerate();
        pairs
            .filter(|(_, (a, b))| a.is_finite() && b.is_finite())
            .map(|(index, (a, b))| (index, a.as_dvec3(), b.as_dvec3()))
    };
    let count = both().count() as f64;
    if count == 0.0 {
        return Err(Error::new(
            "the images have no pixel that is finite in both",
            "render them again; this should never happen with images of this program",
        ));
    }
    let mean_a = both().map(|(_, a, _)| luminance(a)).sum::<f64>() / count;
    let mean_b = both().map(|(_, _, b)| luminance(b)).sum::<f64>() / count;
    let (mut squared, mut relative) = (0.0, 0.0);
    let (mut max_difference, mut max_index) = (0.0, 0);
    for (index, a, b) in both() {
        let difference2 = luminance(a - b).powi(2);
        squared += difference2;
        // theory.md (95)
        relative += difference2 / (luminance(b).powi(2) + 0.01 * mean_b * mean_b);
        let largest = (a - b).abs().max_element();
        if largest > max_difference {
            (max_difference, max_index) = (largest, index);
        }
    }
    let (width, height) = a_size;
    let lit = mean_b != 0.0;
    Ok(Comparison {
        width,
        height,
        mean_ratio: lit.then(|| mean_a / mean_b),
        rmse: (squared / count).sqrt(),
        relative_mse: lit.then(|| relative / count),
        max_difference,
        max_pixel: [(max_index % width as usize) as u32, (max_index / width as usize) as u32],
        non_finite_a,
        non_finite_b,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_of_small_images_match_hand_calculation() {
        let b = [Rgb::splat(1.0), Rgb::splat(3.0), Rgb::splat(2.0), Rgb::splat(2.0)];
        let mut a = b;
        let equal = compare((&a, (2, 2)), (&b, (2, 2))).unwrap();
        assert_eq!((equal.rmse, equal.relative_mse), (0.0, Some(0.0)));
        assert_eq!((equal.max_difference, equal.mean_ratio), (0.0, Some(1.0)));
        a[2] = Rgb::splat(6.0);
        let c = compare((&a, (2, 2)), (&b, (2, 2))).unwrap();
        let close = |x: f64, y: f64| (x - y).abs() < 1e-6;
        assert!(close(c.mean_ratio.unwrap(), 1.5), "{c:?}");
        assert!(close(c.rmse, 2.0), "{c:?}");
        assert!(close(c.relative_mse.unwrap(), 16.0 / (4.0 + 0.04) / 4.0), "{c:?}");
        assert_eq!((c.max_difference, c.max_pixel), (4.0, [0, 1]));
    }

    #[test]
    fn change_of_hue_at_equal_luminance_is_reported() {
        // Luminance stays: 0.2126 * 0.7152 - 0.7152 * 0.2126 = 0.
        let (a, b) = ([Rgb::ONE + Rgb::new(0.7152, -0.2126, 0.0)], [Rgb::ONE]);
        let c = compare((&a, (1, 1)), (&b, (1, 1))).unwrap();
        assert!(c.rmse < 1e-6 && c.max_difference > 0.7, "{c:?}");
    }

    #[test]
    fn non_finite_pixels_are_counted_and_ignored() {
        let a = [Rgb::splat(f32::NAN), Rgb::ONE, Rgb::ONE];
        let b = [Rgb::ONE, Rgb::splat(f32::INFINITY), Rgb::ONE];
        let c = compare((&a, (3, 1)), (&b, (3, 1))).unwrap();
        assert_eq!((c.non_finite_a, c.non_finite_b, c.rmse), (1, 1, 0.0));
        assert!(compare((&a[..1], (1, 1)), (&b[..1], (1, 1))).is_err());
    }

    #[test]
    fn images_of_other_sizes_are_refused_and_black_has_no_ratio() {
        let black = [Rgb::ZERO; 6];
        assert!(compare((&black, (2, 3)), (&black, (3, 2))).is_err());
        let c = compare((&black, (2, 3)), (&black, (2, 3))).unwrap();
        assert_eq!((c.mean_ratio, c.relative_mse, c.rmse), (None, None, 0.0));
    }
}
