//! Taking off the merge bias where it stands out from the noise: theory.md, section 17a.
//!
//! What photons beyond half the merge radii add to a pixel is bias and noise. Its square over iterations tells both
//! apart; around each pixel as much is taken off as leaves the least squared error. What one half of the iterations
//! tells is taken off the other, so that no noise decides what becomes of itself.

use super::block::Block;
use crate::base::math::Rgb;
use crate::film::annulus::{FOLDS, Moments, Side};
use crate::film::radiance::{luminance, luminance_weights};
use crate::settings::policy::BIAS_EXCESS;
use rayon::prelude::*;

/// What is taken off an image, row by row.
#[derive(Clone, Debug)]
pub struct BiasCorrection {
    /// Radiance, W/(m^2 sr).
    pub amount: Vec<Rgb>,
    /// What that adds to the variance of the mean's luminance; often less than 0: noise beyond half the radii that
    /// is taken off no longer shows.
    pub variance: Vec<f64>,
    /// Estimate of the squared luminance of the bias that is left, row by row; of either sign where noise hides it.
    pub bias2: Vec<f64>,
}

/// Sums over the iterations of one side, times the weights of their blocks.
#[derive(Clone, Copy, Default)]
struct Sums {
    sum: Rgb,
    /// Estimate of the squared mean.
    bias2: f64,
    /// Variance of the sum, and its covariance with that of the values.
    variance: f64,
    covariance: f64,
}

/// Sums of the weights of a side's iterations, and of their squares.
#[derive(Clone, Copy, Default)]
struct Weight {
    first: f64,
    second: f64,
}

impl BiasCorrection {
    /// Bytes of a pixel while it is worked out, and of what is found.
    pub const BYTES: usize = size_of::<[Sums; FOLDS]>()
        + size_of::<[RawSums; FOLDS]>()
        + 3 * size_of::<[f64; 2 * FOLDS]>()
        + size_of::<Rgb>()
        + 4 * size_of::<f64>();

    /// Of the image that `blocks` make with these weights of their iterations, and that has this luminance; `None` where
    /// not all blocks tell it, or before the second iteration of either side.
    pub fn new(blocks: &[Block], weights: &[f64], luminance: &[f64]) -> Option<Self> {
        let (width, height) = blocks[0].film.resolution();
        let mut sides = [Weight::default(); FOLDS];
        for (block, &weight) in blocks.iter().zip(weights) {
            let iterations = block.beyond.as_ref()?.iterations().map(|n| n as f64);
            for (side, n) in sides.iter_mut().zip(iterations) {
                side.first += weight * n;
                side.second += weight * weight * n;
            }
        }
        // theory.md (71b)
        let pairs = |side: &Weight| side.first.powi(2) - side.second;
        if sides.iter().any(|side| pairs(side) <= 1e-9 * side.first.powi(2)) {
            return None;
        }
        let importance = luminance_weights(luminance);
        let pixels = importance.len();
        let mut all = Self {
            amount: vec![Rgb::ZERO; pixels],
            variance: vec![0.0; pixels],
            bias2: vec![0.0; pixels],
        };
        let typical = blocks[0].beyond.as_ref()?.left_at_half;
        for (class, typical) in typical.into_iter().enumerate() {
            let sums = Sums::all(blocks, weights, &sides, class);
            if sums.par_iter().flatten().any(|side| side.variance > 0.0 || side.bias2 > 0.0) {
                all.add(typical, &sums, &sides, (luminance, &importance), (width, height));
            }
        }
        Some(all)
    }

    /// Adds what is taken off of a class of photons, of whose bias so much is typically left at half the radius.
    fn add(
        &mut self,
        left_at_half: f64,
        sums: &[[Sums; FOLDS]],
        sides: &[Weight; FOLDS],
        (luminance, importance): (&[f64], &[f64]),
        (width, height): (u32, u32),
    ) {
        let total: f64 = sides.iter().map(|side| side.first).sum();
        let told = |(sums, weight): (&[Sums; FOLDS], &f64)| {
            let variance = |side: usize| weight * sums[side].variance / (sides[side].first * total);
            [weight * sums[0].bias2, variance(0), weight * sums[1].bias2, variance(1)]
        };
        let told: Vec<_> = sums.par_iter().zip(importance).map(told).collect();
        let around = smooth(&told, width as usize, height as usize);
        let own = self.amount.par_iter_mut().zip(&mut self.variance).zip(&mut self.bias2);
        let pixels = sums.par_iter().zip(&around).zip(luminance.par_iter().zip(importance));
        own.zip(pixels).for_each(|(((amount, variance), bias2), ((sums, around), of_pixel))| {
            let (luminance, weight) = of_pixel;
            for (side, own) in sums.iter().enumerate() {
                // What the other side tells.
                let other = 2 * (1 - side);
                let share = share(around[other], around[other + 1].max(0.0));
                *amount += own.sum * (share / total) as f32;
                *variance +=
                    share * (share * own.variance - 2.0 * own.covariance) / (total * total);
                // What is seen at half the radius is no less than its own bias: theory.md (71e).
                let size = (around[2 * side].max(0.0) / weight).sqrt();
                let seen = (luminance - share * size).max(0.0);
                let at_half = left_at_half.min(seen / size);
                *bias2 += (1.0 - share + at_half).powi(2) * own.bias2 / FOLDS as f64;
            }
        });
    }
}

/// How much to take off of what is beyond half the radius, of this squared bias and variance: theory.md (71d).
pub fn share(bias2: f64, variance: f64) -> f64 {
    let excess = (bias2 - BIAS_EXCESS * variance).max(0.0);
    if excess > 0.0 { excess / (excess + variance) } else { 0.0 }
}

impl Sums {
    /// Of both sides of a class of photons, row by row.
    fn all(
        blocks: &[Block],
        weights: &[f64],
        sides: &[Weight; FOLDS],
        class: usize,
    ) -> Vec<[Self; FOLDS]> {
        let mut all = vec![<[RawSums; FOLDS]>::default(); blocks[0].film.pixels()];
        for (block, &weight) in blocks.iter().zip(weights) {
            let pixels = block.beyond.as_ref().expect("all blocks tell it").pixels();
            block.film.zip_pixels(&mut all, |all, at| {
                for (sum, side) in all.iter_mut().zip(&pixels[at]) {
                    sum.add(side, &side.classes[class], weight);
                }
            });
        }
        all.par_iter().map(|raw| [0, 1].map(|side| raw[side].sums(&sides[side]))).collect()
    }
}

#[derive(Clone, Copy, Default)]
struct RawSums {
    value: f64,
    sum: Rgb,
    squares: f64,
    products: f64,
}

impl RawSums {
    fn add(&mut self, side: &Side, moments: &Moments, weight: f64) {
        self.value += weight * f64::from(side.value);
        self.sum += moments.sum * weight as f32;
        self.squares += weight * weight * f64::from(moments.squares);
        self.products += weight * weight * f64::from(moments.products);
    }

    /// theory.md (71b), (71c)
    fn sums(&self, Weight { first, second }: &Weight) -> Sums {
        let sum = luminance(self.sum.as_dvec3());
        let pairs = first * first - second;
        let bias2 = (sum * sum - self.squares) / pairs;
        let product = (sum * self.value - self.products) / pairs;
        Sums {
            sum: self.sum,
            bias2,
            variance: self.squares - second * bias2,
            covariance: self.products - second * product,
        }
    }
}

/// Means around each pixel with weights that fall to 0 at five pixels along rows and columns.
fn smooth<const N: usize>(values: &[[f64; N]], width: usize, height: usize) -> Vec<[f64; N]> {
    let along = |values: &[[f64; N]], step: usize, across: usize, length: usize| {
        let of = |index: usize| {
            let place = index / step % length;
            let (mut sums, mut all) = ([0.0; N], 0.0);
            for other in place.saturating_sub(across)..(place + across + 1).min(length) {
                let weight = (across + 1 - place.abs_diff(other)) as f64;
                let values = &values[index + other * step - place * step];
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
                all += weight;
            }
            sums.map(|sum| sum / all)
        };
        (0..values.len()).into_par_iter().map(of).collect::<Vec<_>>()
    };
    let rows = along(values, 1, SMOOTHED, width);
    along(&rows, width, SMOOTHED, height)
}

/// Pixels to each side that are taken in.
const SMOOTHED: usize = 4;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Rng, Stream, StreamKey};
    use crate::film::counts::Counts;
    use crate::film::radiance::total;
    use crate::noise::Measure;
    use crate::noise::film::BatchGrain;
    use crate::render::block::CombinedImage;
    use crate::settings::policy::LEFT_AT_HALF;
    use crate::settings::{Bias, PartialSettings, Settings};
    use glam::DVec3;

    const SIDE: u32 = 24;

    /// Blocks of an image of luminance 1 with noise .3, whose left part has such a bias beyond half the radius of the
    /// last vertex; that of the others brings noise alone.
    fn blocks(bias: f64, noise: f64, iterations: &[u64], seed: u64) -> Vec<Block> {
        let wishes = PartialSettings {
            resolution: Some([SIDE, SIDE]),
            bias: Some(Bias::Reduce),
            ..Default::default()
        };
        let settings = Settings::resolve(&wishes, &Default::default(), 1.0).unwrap();
        let mut rng = StreamKey::new(seed, Stream::Pilot, 0).rng(0);
        let gauss = |rng: &mut Rng| (0..12).map(|_| f64::from(rng.next_1d())).sum::<f64>() - 6.0;
        let mut first = 0;
        let block = |&count: &u64| {
            let mut block = Block::new(&settings, first, Counts::uniform(10, 1));
            for iteration in first..first + count {
                let off = (iteration, Measure::Off);
                let (_, mut tiles) = block.begin_iteration(off, BatchGrain::Tile, None);
                for tile in &mut tiles {
                    for index in 0..tile.tile.len() as u32 {
                        let (x, _) = tile.tile.pixel(index);
                        let own = if x < SIDE / 2 { bias } else { 0.0 };
                        let beyond = [0.0, own].map(|bias| bias + noise * gauss(&mut rng));
                        let value = 1.0 + 0.3 * gauss(&mut rng) + beyond[0] + beyond[1];
                        let index = index as usize;
                        tile.sums[index].add(DVec3::splat(value));
                        let to = tile.beyond.as_mut().expect("it is asked for");
                        to.add(index, DVec3::splat(value), beyond.map(DVec3::splat));
                    }
                }
                drop(tiles);
                block.end_iteration(off, 0.0);
            }
            first += count;
            block
        };
        iterations.iter().map(block).collect()
    }

    fn mean(values: &[f64]) -> f64 {
        total(values, |value| *value) / values.len() as f64
    }

    #[test]
    fn a_bias_without_noise_is_taken_off_as_a_whole() {
        let blocks = blocks(0.5, 0.0, &[6], 1);
        let image = CombinedImage::new(&blocks, vec![1.0]);
        let merged = blocks[0].film.mean();
        let off: Vec<f64> = image
            .mean()
            .iter()
            .zip(&merged)
            .map(|(one, other)| f64::from(other.x - one.x))
            .collect();
        for (index, off) in off.iter().enumerate() {
            let expected = if index as u32 % SIDE < SIDE / 2 { 0.5 } else { 0.0 };
            assert!((off - expected).abs() < 1e-5, "{index}: {off}");
        }
        // What is left at half the radius is not seen.
        let left = mean(&image.reduction().unwrap().bias2);
        assert!((left / (0.5 * (LEFT_AT_HALF[1] * 0.5).powi(2)) - 1.0).abs() < 1e-3, "{left}");
    }

    #[test]
    fn noise_alone_stays_and_adds_nothing() {
        let (mut off, mut squares, mut count) = (0.0, 0.0, 0.0);
        for seed in 0..40 {
            let blocks = blocks(0.0, 1.0, &[40], seed);
            let image = CombinedImage::new(&blocks, vec![1.0]);
            for amount in &image.reduction().unwrap().amount {
                off += f64::from(amount.x);
                squares += f64::from(amount.x).powi(2);
                count += 1.0;
            }
        }
        // One side decides about the other: no mean is left but by chance. Neighbors have decisions in common, but
        // not what is decided about.
        let error = squares.sqrt() / count;
        assert!(squares > 0.0 && (off / count).abs() < 3.0 * error, "{} +- {error}", off / count);
        // Noise of 1 in each of two classes.
        assert!(squares / count < 0.05 * 2.0 / 40.0, "{}", squares / count * 40.0);
    }

    #[test]
    fn the_error_that_is_told_is_the_one_that_is_there() {
        for (bias, parts, weights) in
            [(0.1, &[60][..], vec![1.0]), (0.3, &[60], vec![1.0]), (0.2, &[20, 40], vec![0.3, 1.0])]
        {
            let (mut found, mut told, mut seen) = (0.0, 0.0, Vec::new());
            let (runs, half) = (60, LEFT_AT_HALF[1] * bias);
            for seed in 0..runs {
                let blocks = blocks(bias, 1.0, parts, 1000 + seed);
                let image = CombinedImage::new(&blocks, weights.clone());
                let noise = mean(&image.variance_of_mean().unwrap());
                told += (noise + mean(&image.reduction().unwrap().bias2)) / runs as f64;
                let square = |(index, pixel): (usize, &Rgb)| {
                    // With the bias that is left at half the radius, which nothing here shows.
                    let left = if index as u32 % SIDE < SIDE / 2 { half } else { 0.0 };
                    (f64::from(pixel.x) + left - 1.0).powi(2)
                };
                let own = image.mean().iter().enumerate().map(square).sum::<f64>();
                seen.push(own / f64::from(SIDE * SIDE));
                found += seen.last().expect("just now") / runs as f64;
            }
            let spread = seen.iter().map(|x| (x - found).powi(2)).sum::<f64>() / (runs - 1) as f64;
            let error = (spread / runs as f64).sqrt();
            assert!(
                (told - found).abs() < 3.0 * error + 0.03 * found,
                "{bias}: {told}, not {found} +- {error}"
            );
            // Without taking anything off: noise of three terms, and the whole bias.
            let merged = 2.09 / 60.0 + 0.5 * (bias + half).powi(2);
            assert!(bias < 0.2 || found < 0.9 * merged, "{bias}: {found} of {merged}");
        }
    }

    #[test]
    fn two_iterations_of_either_side_are_needed() {
        for (count, known) in [(0, false), (3, false), (4, true)] {
            let blocks = blocks(0.1, 0.1, &[count], 3);
            assert_eq!(
                CombinedImage::new(&blocks, vec![1.0]).reduction().is_some(),
                known,
                "{count}"
            );
        }
    }

    #[test]
    fn means_around_keep_constants_and_sums() {
        let constant = smooth(&[[2.0, 3.0]; 70], 10, 7);
        assert!(
            constant
                .iter()
                .flatten()
                .zip([2.0, 3.0].iter().cycle())
                .all(|(a, b)| (a - b).abs() < 1e-12)
        );
        let mut point = vec![[0.0]; 441];
        point[220] = [1.0];
        let around = smooth(&point, 21, 21);
        assert!((around.iter().flatten().sum::<f64>() - 1.0).abs() < 1e-12);
        assert_eq!(around.iter().filter(|[x]| *x > 0.0).count(), 81);
    }
}
