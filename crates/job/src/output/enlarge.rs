//! Enlarges a picture that had to be rendered with fewer pixels.

use bdpm_core::base::math::Rgb;
use rayon::prelude::*;

/// Radiance below which differences count less, over the mean of the picture.
const DARK: f32 = 0.01;

/// Returns the picture `pixels` of `size` at the size `full`, both width and height.
///
/// Cubic interpolation (Keys 1981, the kernel of Catmull and Rom) of logarithms: it keeps edges,
/// and no dark seams surround lamps, as negative weights cause on radiances.
///
/// # Panics
/// If the number of pixels is not that of `size`.
pub fn enlarge(pixels: &[Rgb], size: (u32, u32), full: (u32, u32)) -> Vec<Rgb> {
    assert_eq!(pixels.len(), size.0 as usize * size.1 as usize);
    let sum: f64 = pixels.iter().map(|pixel| f64::from(pixel.element_sum())).sum();
    let dark = DARK * (sum / (3 * pixels.len()) as f64) as f32;
    if dark <= 0.0 || !dark.is_finite() {
        return vec![Rgb::ZERO; full.0 as usize * full.1 as usize];
    }
    let logarithms: Vec<Rgb> =
        pixels.par_iter().map(|pixel| (pixel.max(Rgb::ZERO) / dark + 1.0).map(f32::ln)).collect();
    let columns = Taps::of_line(size.0, full.0);
    let rows = Taps::of_line(size.1, full.1);
    // First along lines, then across them.
    let wide: Vec<Rgb> = logarithms
        .par_chunks(size.0 as usize)
        .flat_map_iter(|line| columns.iter().map(|taps| taps.sum(|column| line[column])))
        .collect();
    let width = full.0 as usize;
    rows.par_iter()
        .flat_map_iter(|taps| {
            let value = |column| taps.sum(|row| wide[row * width + column]);
            (0..width).map(move |column| dark * (value(column).map(f32::exp_m1)).max(Rgb::ZERO))
        })
        .collect()
}

/// Pixels of a line that a pixel of the enlarged line takes its value from.
struct Taps {
    places: [usize; 4],
    weights: [f32; 4],
}

impl Taps {
    /// Those of all `full` pixels of a line of `pixels`.
    fn of_line(pixels: u32, full: u32) -> Vec<Self> {
        let tap = |place: u32| {
            let center = (f64::from(place) + 0.5) * f64::from(pixels) / f64::from(full) - 0.5;
            let first = center.floor();
            let t = (center - first) as f32;
            let places = [-1.0, 0.0, 1.0, 2.0]
                .map(|step| (first + step).clamp(0.0, f64::from(pixels - 1)) as usize);
            let weights = [
                t * (-0.5 + t * (1.0 - 0.5 * t)),
                1.0 + t * t * (1.5 * t - 2.5),
                t * (0.5 + t * (2.0 - 1.5 * t)),
                t * t * (0.5 * t - 0.5),
            ];
            Self { places, weights }
        };
        (0..full).map(tap).collect()
    }

    fn sum(&self, value: impl Fn(usize) -> Rgb) -> Rgb {
        let terms = self.places.iter().zip(self.weights);
        terms.fold(Rgb::ZERO, |sum, (&place, weight)| sum + weight * value(place))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constant_and_smooth_pictures_keep_their_values() {
        let gray = vec![Rgb::new(0.2, 3.0, 40.0); 12 * 7];
        for pixel in enlarge(&gray, (12, 7), (45, 28)) {
            assert!(pixel.abs_diff_eq(gray[0], 1e-4 * 40.0), "{pixel}");
        }
        // A ramp in both directions, away from the edges, where nothing is known beyond them.
        let value = |x: f64, y: f64| Rgb::splat((0.1 * x + 0.05 * y).exp() as f32);
        let ramp: Vec<Rgb> =
            (0..16 * 16).map(|i| value(f64::from(i % 16) + 0.5, f64::from(i / 16) + 0.5)).collect();
        let large = enlarge(&ramp, (16, 16), (64, 64));
        for (x, y) in [(20, 20), (31, 40), (40, 13)] {
            let wanted = value((f64::from(x) + 0.5) / 4.0, (f64::from(y) + 0.5) / 4.0);
            let found = large[y as usize * 64 + x as usize];
            assert!((found.x / wanted.x - 1.0).abs() < 2e-3, "{x} {y}: {found} {wanted}");
        }
    }

    #[test]
    fn no_pixel_is_negative_beside_a_lamp() {
        let mut dark = vec![Rgb::splat(0.01); 64];
        dark[27] = Rgb::splat(1000.0);
        let large = enlarge(&dark, (8, 8), (32, 32));
        let least = large.iter().map(|pixel| pixel.min_element()).fold(f32::INFINITY, f32::min);
        assert!(least >= 0.0, "{least}");
        assert_eq!(enlarge(&[Rgb::ZERO; 4], (2, 2), (4, 4)), vec![Rgb::ZERO; 16]);
    }
}
