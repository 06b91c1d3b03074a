//! Rare light of an image of few iterations: it is spread over its surroundings before the image is
//! denoised.
//!
//! A photon that carries much makes a bright disc of several pixels, which a denoiser takes for a
//! part of the scene. What belongs to the scene is in both halves of the iterations, and what one
//! half alone has is rare light. Its energy is kept: it goes to the pixels around it.

use super::BOX_RADIUS;
use super::folded_image::FoldedImage;
use super::pooling::boxes;
use super::window::Window;
use bdpm_core::base::math::Rgb;
use bdpm_core::film::radiance::{box_filter, luminance};
use bdpm_core::render::block::CombinedImage;
use rayon::prelude::*;

/// Number of iterations from which on rare light is no longer seen as spots.
const FEW_ITERATIONS: u64 = 8;

/// Light is rare where the mean over 5 by 5 pixels of one half exceeds that of the other and the
/// surroundings by this factor.
const RARE: f64 = 3.0;

/// Side of the squares of pixels that spread rare light together.
const SIDE: u32 = 4;

/// Radii over which these squares spread it one after the other: together they have no edges that
/// are seen.
const SPREAD: [u32; 3] = [2, 6, 18];

/// The radiance of an image whose light that only one half of its iterations has is spread; as it
/// is with [`FEW_ITERATIONS`] or more, or without halves.
pub fn spread_rare_light(image: &CombinedImage, radiance: Vec<Rgb>) -> Vec<Rgb> {
    let iterations: u64 = image.blocks().iter().map(|block| block.film.iterations).sum();
    let halves = (iterations < FEW_ITERATIONS).then(|| FoldedImage::new(image, 2)).flatten();
    let Some(halves) = halves else { return radiance };
    let whole = Window::whole(image.resolution());
    let [one, other] = [0, 1].map(|fold| halves.luminance_of(whole, fold));
    spread(&radiance, [&one, &other], image.resolution())
}

/// `radiance` with its rare light spread, by the luminances of both halves.
fn spread(radiance: &[Rgb], [one, other]: [&[f32]; 2], size: (u32, u32)) -> Vec<Rgb> {
    let (width, height) = size;
    let squares = Squares { size, columns: width.div_ceil(SIDE), rows: height.div_ceil(SIDE) };
    let halves: Vec<[f64; 2]> =
        one.iter().zip(other).map(|(one, other)| [f64::from(*one), f64::from(*other)]).collect();
    let near = box_filter(&halves, width, height);
    let common: Vec<f64> = near.iter().map(|[one, other]| one.min(*other)).collect();
    let around = squares.means(&common, BOX_RADIUS / SIDE);
    let kept = |index: usize| {
        let [one, other] = near[index];
        // Sums that run over black pixels may end below 0.
        let most = (RARE * (common[index] + around[squares.of(index)])).max(0.0);
        let own = luminance(radiance[index].as_dvec3());
        if one.max(other) > most && own > most { (most / own) as f32 } else { 1.0 }
    };
    let kept: Vec<f32> = (0..radiance.len()).into_par_iter().map(kept).collect();
    if kept.iter().all(|share| *share == 1.0) {
        return radiance.to_vec();
    }
    let added: Vec<Vec<f64>> = (0..3)
        .into_par_iter()
        .map(|channel| {
            let removed = |(own, kept): (&Rgb, &f32)| f64::from(own[channel] * (1.0 - kept));
            let removed: Vec<f64> = radiance.iter().zip(&kept).map(removed).collect();
            squares.spread(&removed)
        })
        .collect();
    let value = |index: usize| {
        let square = squares.of(index);
        let [red, green, blue] = [0, 1, 2].map(|channel: usize| added[channel][square] as f32);
        radiance[index] * kept[index] + Rgb::new(red, green, blue)
    };
    (0..radiance.len()).into_par_iter().map(value).collect()
}

/// Squares of [`SIDE`] by [`SIDE`] pixels. Those at the right and the lower border may have fewer.
struct Squares {
    size: (u32, u32),
    columns: u32,
    rows: u32,
}

impl Squares {
    /// The square of a pixel.
    fn of(&self, pixel: usize) -> usize {
        let width = self.size.0 as usize;
        let [x, y] = [pixel % width, pixel / width].map(|at| at / SIDE as usize);
        y * self.columns as usize + x
    }

    /// Number of pixels of each square.
    fn counts(&self) -> Vec<f64> {
        let (width, height) = self.size;
        let side = |at: u32, end: u32| f64::from((end - at * SIDE).min(SIDE));
        let rows = (0..self.rows).map(|row| side(row, height));
        rows.flat_map(|row| (0..self.columns).map(move |column| row * side(column, width)))
            .collect()
    }

    fn sums(&self, values: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; (self.columns * self.rows) as usize];
        for (index, value) in values.iter().enumerate() {
            sums[self.of(index)] += value;
        }
        sums
    }

    /// Number of squares around each square that are in the image.
    fn number_around(&self, radius: u32) -> Vec<f64> {
        let count = move |at: u32, end: u32| {
            f64::from((at + radius + 1).min(end) - at.saturating_sub(radius))
        };
        let (columns, rows) = (self.columns, self.rows);
        let of_row = move |y: u32| (0..columns).map(move |x| count(x, columns) * count(y, rows));
        (0..rows).flat_map(of_row).collect()
    }

    /// Means over the squares around each square.
    fn around(&self, values: &[f64], radius: u32) -> Vec<f64> {
        boxes(values, (self.columns as usize, self.rows as usize), radius as usize)
    }

    /// Means of pixels over the squares around each square.
    fn means(&self, values: &[f64], radius: u32) -> Vec<f64> {
        let (sums, counts) = (self.sums(values), self.counts());
        let [sums, counts] = [sums, counts].map(|own| self.around(&own, radius));
        sums.iter().zip(counts).map(|(sum, count)| sum / count).collect()
    }

    /// The values spread over [`SPREAD`], as the mean of a pixel of each square. Their sum stays:
    /// each square divides its own evenly among those around it that are in the image.
    fn spread(&self, values: &[f64]) -> Vec<f64> {
        let mut sums = self.sums(values);
        for radius in SPREAD {
            let taking = self.number_around(radius);
            let shares: Vec<f64> =
                sums.iter().zip(&taking).map(|(own, number)| own / number).collect();
            let means = self.around(&shares, radius);
            sums = means.iter().zip(&taking).map(|(mean, number)| mean * number).collect();
        }
        sums.iter().zip(self.counts()).map(|(sum, count)| sum / count).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::base::rng::{Stream, StreamKey};

    const SIZE: (u32, u32) = (80, 60);

    /// Two halves of noise around 1, and what `add` adds to each pixel of each half.
    fn halves(add: impl Fn(u32, u32) -> [f32; 2]) -> [Vec<f32>; 2] {
        let mut rng = StreamKey::new(5, Stream::Test, 0).rng(0);
        let mut all = [Vec::new(), Vec::new()];
        for (y, x) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (y, x))) {
            for (half, add) in all.iter_mut().zip(add(x, y)) {
                half.push(2.0 * rng.next_1d() + add);
            }
        }
        all
    }

    fn spread_mean([one, other]: &[Vec<f32>; 2]) -> (Vec<Rgb>, Vec<Rgb>) {
        let mean: Vec<Rgb> =
            one.iter().zip(other).map(|(one, other)| Rgb::splat(0.5 * (one + other))).collect();
        let spread = spread(&mean, [one, other], SIZE);
        (mean, spread)
    }

    fn sum(image: &[Rgb]) -> f64 {
        image.iter().map(|own| f64::from(own.x)).sum()
    }

    fn is_disc(x: u32, y: u32, at: [u32; 2]) -> bool {
        x.abs_diff(at[0]).pow(2) + y.abs_diff(at[1]).pow(2) <= 16
    }

    #[test]
    fn a_disc_of_one_half_is_spread_with_its_energy() {
        for at in [[40, 30], [1, 58]] {
            let own = halves(|x, y| [if is_disc(x, y, at) { 100.0 } else { 0.0 }, 0.0]);
            let (mean, spread) = spread_mean(&own);
            let most = |image: &[Rgb]| image.iter().map(|own| own.x).fold(0.0, f32::max);
            assert!(most(&mean) > 50.0 && most(&spread) < 15.0, "{}", most(&spread));
            assert!((sum(&mean) / sum(&spread) - 1.0).abs() < 1e-4);
        }
    }

    /// Differences of sums from a corner of the image have rounding errors of either sign where all
    /// pixels of a square are black, with light above and beside them.
    #[test]
    fn black_pixels_among_bright_ones_stay_finite() {
        let size = (320, 240);
        let mut rng = StreamKey::new(5, Stream::Test, 1).rng(0);
        let mut half = || -> Vec<f32> {
            let pixels = (0..size.0 * size.1).map(|index| (index % size.0, index / size.0));
            let is_black = |x: u32, y: u32| (30..310).contains(&x) && (20..230).contains(&y);
            pixels.map(|(x, y)| if is_black(x, y) { 0.0 } else { rng.next_1d().powi(8) }).collect()
        };
        let [one, other] = [half(), half()];
        let mean: Vec<Rgb> =
            one.iter().zip(&other).map(|(one, other)| Rgb::splat(0.5 * (one + other))).collect();
        let spread = spread(&mean, [&one, &other], size);
        assert!(spread.iter().all(|pixel| pixel.is_finite()));
        assert!((sum(&mean) / sum(&spread) - 1.0).abs() < 1e-4);
    }

    #[test]
    fn what_both_halves_have_stays() {
        let plain = halves(|_, _| [0.0; 2]);
        let lit = halves(|x, y| [if is_disc(x, y, [40, 30]) { 100.0 } else { 0.0 }; 2]);
        for own in [plain, lit] {
            let (mean, spread) = spread_mean(&own);
            assert_eq!(mean, spread);
        }
    }
}
