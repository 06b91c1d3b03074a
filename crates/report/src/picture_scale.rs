//! Pictures for pages at a limited size.

use rayon::prelude::*;

/// Shrinks pictures by an integer factor, so that they are not larger than a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureScale {
    /// Width and height of the picture, pixels.
    pub size: (u32, u32),
    /// Side of the square of pixels that becomes one pixel.
    pub step: u32,
}

impl PictureScale {
    /// The least factor such that the picture has at most this width and about so many pixels.
    pub fn within(size: (u32, u32), width: u32, pixels: usize) -> Self {
        let all = u64::from(size.0) * u64::from(size.1);
        let by_pixels = (all as f64 / pixels.max(1) as f64).sqrt().ceil() as u32;
        Self { size, step: size.0.div_ceil(width).max(by_pixels).max(1) }
    }

    /// Width and height of the shrunk picture, pixels.
    pub fn shrunk(self) -> (u32, u32) {
        (self.size.0.div_ceil(self.step), self.size.1.div_ceil(self.step))
    }

    /// Means over squares of pixels.
    pub fn shrink<T: Sync, const N: usize>(
        self,
        values: &[T],
        value: impl Fn(&T) -> [f64; N] + Sync,
    ) -> Vec<[f64; N]> {
        let (Self { size: (width, height), step }, (across, down)) = (self, self.shrunk());
        let mean = |index: u32| {
            let (x, y) = (index % across * step, index / across * step);
            let (mut sums, mut count) = ([0.0; N], 0.0);
            for row in y..(y + step).min(height) {
                for column in x..(x + step).min(width) {
                    let value = value(&values[row as usize * width as usize + column as usize]);
                    sums.iter_mut().zip(value).for_each(|(sum, value)| *sum += value);
                    count += 1.0;
                }
            }
            sums.map(|sum| sum / count)
        };
        (0..across * down).into_par_iter().map(mean).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shrinking_at_the_border_keeps_means() {
        let scale = PictureScale { size: (5, 3), step: 2 };
        let values: Vec<f64> = (0..15).map(f64::from).collect();
        let small = scale.shrink(&values, |value| [*value]).into_flattened();
        assert_eq!(scale.shrunk(), (3, 2));
        assert_eq!(small, [3.0, 5.0, 6.5, 10.5, 12.5, 14.0]);
        let same =
            PictureScale { step: 1, ..scale }.shrink(&values, |value| [*value]).into_flattened();
        assert_eq!(same, values);
    }

    #[test]
    fn scale_keeps_width_and_number_of_pixels() {
        let step = |size, width, pixels| PictureScale::within(size, width, pixels).step;
        assert_eq!(step((640, 360), 640, 1 << 20), 1);
        assert_eq!(step((641, 360), 640, 1 << 20), 2);
        assert_eq!(step((100, 10_000), 640, 250_000), 2);
        assert_eq!(step((3, 3), 640, 0), 3);
    }
}
