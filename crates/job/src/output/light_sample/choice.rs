//! Choice of the squares of a sample, and their weights.

use super::{LightImage, LightImages, MixtureSample, SampleSquare, SampledLight, Values};
use bdpm_auto::adaptive::stopping::AROUND_PIXEL;
use bdpm_core::base::math::{Rgb, luminance};

/// Side of a square, pixels. Small squares are more of them, large ones store fewer pixels around.
const SIDE: u32 = 8;

/// Pixels that a square stores, at most.
const STORED: usize = (SIDE as usize + 2 * AROUND_PIXEL).pow(2);

/// Share of the squares that are chosen by their area, for mixtures whose errors are where those of
/// all references are small.
const BY_AREA: f64 = 0.1;

/// Weight of the change of weights against the errors of references, over the mean diagonal of the
/// equations. It decides where references are more than squares.
const RIDGE: f64 = 1e-9;

/// Factor of a light that is dimmed in a reference.
const DIMMED: f64 = 0.25;

/// Maximum number of calibrations: each leaves out the squares that got negative weights.
const CALIBRATIONS: usize = 8;

/// A mixture whose error the sample has exactly: all lights together, one alone, or all with one
/// that is off or dimmed.
pub(super) struct Reference {
    factors: Vec<f64>,
    /// Squared relative errors of noise and of bias, over the grid of all squares.
    squares: Vec<[f64; 2]>,
    /// Sums of them.
    totals: [f64; 2],
    /// Mean luminance without noise over mean luminance.
    pub clean_share: f64,
}

impl Reference {
    /// The references of lights whose error is known: all together first.
    pub fn all(lights: &LightImages) -> Vec<Self> {
        let is_known: Vec<bool> = lights.lights.iter().map(LightImage::has_error).collect();
        let known: Vec<usize> = (0..is_known.len()).filter(|light| is_known[*light]).collect();
        let together: Vec<f64> = is_known.iter().map(|own| f64::from(u8::from(*own))).collect();
        let mut references = Vec::new();
        if !known.is_empty() {
            references.push(Self::new(lights, together.clone()));
        }
        for light in known.iter().copied().filter(|_| known.len() > 1) {
            let mut alone = vec![0.0; is_known.len()];
            alone[light] = 1.0;
            let with = |factor: f64| {
                let mut factors = together.clone();
                factors[light] = factor;
                factors
            };
            // Of two lights, one without the other is alone.
            let without = (known.len() > 2).then(|| with(0.0));
            let all = [alone, with(DIMMED)].into_iter().chain(without);
            references.extend(all.map(|factors| Self::new(lights, factors)));
        }
        references
    }

    fn new(lights: &LightImages, factors: Vec<f64>) -> Self {
        let colors: Vec<Rgb> = factors.iter().map(|own| Rgb::splat(*own as f32)).collect();
        let map = lights.map(&colors);
        let grid = grid(lights.size);
        let sum = |square: &SampleSquare| {
            let [left, top, right, bottom] = square.pixels;
            let mut sums = [0.0; 2];
            for (y, x) in (top..bottom).flat_map(|y| (left..right).map(move |x| (y, x))) {
                let [noise, bias] = map.squares[(y * lights.size.0 + x) as usize];
                sums = [sums[0] + noise, sums[1] + bias];
            }
            sums
        };
        let squares: Vec<[f64; 2]> = grid.iter().map(sum).collect();
        let total = |part: usize| squares.iter().map(|own| own[part]).sum();
        let clean: f64 = map.clean.iter().sum();
        let light = |(light, factor): (&LightImage, &f64)| -> f64 {
            let radiance = light.radiance.iter();
            factor * radiance.map(|own| f64::from(luminance(*own))).sum::<f64>()
        };
        let share = clean / lights.lights.iter().zip(&factors).map(light).sum::<f64>();
        let clean_share = if share.is_finite() { share } else { 1.0 };
        Self { factors, totals: [total(0), total(1)], squares, clean_share }
    }
}

/// All squares of an image.
fn grid((width, height): (u32, u32)) -> Vec<SampleSquare> {
    let steps = |end: u32| (0..end.div_ceil(SIDE)).map(|step| step * SIDE);
    let square = |x: u32, y: u32| SampleSquare {
        pixels: [x, y, (x + SIDE).min(width), (y + SIDE).min(height)],
        weight: 1.0,
    };
    steps(height).flat_map(|y| steps(width).map(move |x| square(x, y))).collect()
}

/// Squares of an image with this many pixels altogether, weighted by the reciprocals of their
/// probabilities. The probability is the share of a square in the squared errors of the references.
pub(super) fn squares(
    size: (u32, u32),
    references: &[Reference],
    pixels: usize,
) -> Vec<SampleSquare> {
    let grid = grid(size);
    let mut shares = vec![BY_AREA / grid.len() as f64; grid.len()];
    let known = references.iter().filter(|own| own.totals[0] + own.totals[1] > 0.0);
    let count = known.clone().count() as f64;
    for own in known {
        let scale = (1.0 - BY_AREA) / (count * (own.totals[0] + own.totals[1]));
        for (share, [noise, bias]) in shares.iter_mut().zip(&own.squares) {
            *share += scale * (noise + bias);
        }
    }
    let chosen = systematic(&shares, (pixels / STORED).max(1));
    let square = |(index, probability): (usize, f64)| SampleSquare {
        weight: 1.0 / probability,
        ..grid[index]
    };
    chosen.into_iter().map(square).collect()
}

/// A systematic sample of this size with probabilities in proportion to `shares`, at most 1: each
/// index with its probability.
fn systematic(shares: &[f64], count: usize) -> Vec<(usize, f64)> {
    let mut is_sure = vec![count >= shares.len(); shares.len()];
    let factor = loop {
        let rest = shares.iter().zip(&is_sure).filter(|(_, sure)| !**sure);
        let sum: f64 = rest.map(|(share, _)| share).sum();
        let sure = is_sure.iter().filter(|sure| **sure).count();
        let factor = count.saturating_sub(sure) as f64 / sum;
        let mut is_larger = false;
        for (share, sure) in shares.iter().zip(&mut is_sure).filter(|(_, sure)| !**sure) {
            (*sure, is_larger) = (share * factor >= 1.0, is_larger || share * factor >= 1.0);
        }
        if !is_larger {
            break factor;
        }
    };
    let (mut sum, mut next, mut chosen) = (0.0, 0.5, Vec::new());
    for (index, (share, sure)) in shares.iter().zip(is_sure).enumerate() {
        if sure {
            chosen.push((index, 1.0));
            continue;
        }
        sum += share * factor;
        if sum > next {
            chosen.push((index, share * factor));
            next += 1.0;
        }
    }
    chosen
}

impl MixtureSample {
    /// Changes the weights of squares as little as possible, such that the errors of the references
    /// are exact (calibration of Deville and Sarndal, 1992, with their squared distance).
    pub(super) fn calibrate(&mut self, references: &[Reference]) {
        let values: Vec<Values> = self.lights.iter().map(SampledLight::values).collect();
        // Parts of the references that each square states, relative to the true sums.
        let mut parts: Vec<Vec<f64>> = vec![Vec::new(); self.squares.len()];
        for own in references {
            let sums = self.sums(&values, &own.factors);
            for part in (0..2).filter(|part| own.totals[*part] > 0.0) {
                let relative = sums.iter().map(|sums| sums[part] / own.totals[part]);
                parts.iter_mut().zip(relative).for_each(|(all, own)| all.push(own));
            }
        }
        let count = parts.first().map_or(0, Vec::len);
        for _ in 0..CALIBRATIONS {
            if !self.calibrate_once(&parts, count) {
                break;
            }
        }
    }

    /// Changes the weights by these parts of references, and leaves out squares whose weights would
    /// be negative. Returns true if there are any.
    fn calibrate_once(&mut self, parts: &[Vec<f64>], count: usize) -> bool {
        let (mut matrix, mut right) = (vec![vec![0.0; count]; count], vec![1.0; count]);
        for (square, parts) in self.squares.iter().zip(parts) {
            for (i, own) in parts.iter().enumerate() {
                right[i] -= square.weight * own;
                for (j, other) in parts.iter().enumerate() {
                    matrix[i][j] += square.weight * own * other;
                }
            }
        }
        let trace: f64 = (0..count).map(|i| matrix[i][i]).sum();
        (0..count).for_each(|i| matrix[i][i] += RIDGE * trace / count as f64);
        let (factors, mut is_changed) = (solve(matrix, right), false);
        for (square, parts) in self.squares.iter_mut().zip(parts) {
            let change: f64 = parts.iter().zip(&factors).map(|(own, factor)| own * factor).sum();
            square.weight *= 1.0 + change;
            is_changed |= square.weight < 0.0;
            square.weight = square.weight.max(0.0);
        }
        is_changed
    }
}

/// Solution of symmetric positive definite equations by elimination; 0 where a reference says
/// nothing.
fn solve(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
    let count = right.len();
    for column in 0..count {
        let pivot = matrix[column].clone();
        for row in column + 1..count {
            let factor =
                if pivot[column] > 0.0 { matrix[row][column] / pivot[column] } else { 0.0 };
            matrix[row].iter_mut().zip(&pivot).for_each(|(own, pivot)| *own -= factor * pivot);
            right[row] -= factor * right[column];
        }
    }
    let mut solution = vec![0.0; count];
    for row in (0..count).rev() {
        let known: f64 = (row + 1..count).map(|at| matrix[row][at] * solution[at]).sum();
        let pivot = matrix[row][row];
        solution[row] = if pivot > 0.0 { (right[row] - known) / pivot } else { 0.0 };
    }
    solution
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systematic_samples_have_their_size_and_state_their_probabilities() {
        let shares: Vec<f64> = (0..100).map(|n| f64::from(n * n + 1)).collect();
        let chosen = systematic(&shares, 40);
        assert!(chosen.len().abs_diff(40) <= 1, "{}", chosen.len());
        let total: f64 = chosen.iter().map(|(index, own)| shares[*index] / own).sum();
        assert!((total / shares.iter().sum::<f64>() - 1.0).abs() < 0.02, "{total}");
        assert!(chosen.iter().any(|(_, own)| *own == 1.0), "the largest are sure");
        let all = systematic(&shares, 100);
        assert!(all.len() == 100 && all.iter().all(|(_, own)| *own == 1.0));
    }

    #[test]
    fn equations_are_solved() {
        let solution = solve(vec![vec![4.0, 1.0], vec![1.0, 3.0]], vec![1.0, 2.0]);
        assert!((solution[0] - 1.0 / 11.0).abs() < 1e-12, "{solution:?}");
        assert!((solution[1] - 7.0 / 11.0).abs() < 1e-12, "{solution:?}");
        assert_eq!(solve(vec![vec![0.0]], vec![1.0]), [0.0]);
        assert!(solve(Vec::new(), Vec::new()).is_empty());
    }
}
