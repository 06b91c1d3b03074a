//! Camera paths per pixel for path tracing: by the noise of the neighbors of a pixel.

use super::optimize::{NEAR_OPTIMUM, PerPixel, Problem, Uniform};
use bdpm_core::noise::Coefficients;

/// Sides of the squares of neighbors are twice these numbers and one: few neighbors show where
/// noise is, many show less of their own noise. The best one is taken.
const NEIGHBORHOODS: [usize; 3] = [2, 5, 12];

/// Counts of path tracing in each cell by the noise of the cells around it alone, with their cost
/// by the noise of the cell itself. Counts that followed the noise of their own cell would follow
/// its few bright paths: in five of six interiors equal counts had .64 to .99 times the squared
/// error (docs/measurements/interiors.md). Paths of different pixels are independent, so this cost
/// has no bias. theory.md (87a)
pub fn by_neighbors(
    noise: Vec<f64>,
    size: (u32, u32),
    problem: impl Fn(&[Coefficients]) -> Problem,
    uniform: &Uniform,
) -> Option<PerPixel> {
    let of_paths = |noise: &[f64]| {
        let cells = noise.iter().map(|&b| Coefficients { b, ..Coefficients::default() });
        problem(&cells.collect::<Vec<_>>())
    };
    // Few cells may hold most of the noise. The rest must gain as well.
    let judges = [of_paths(&noise), of_paths(&without_largest(noise.clone()))];
    let judged = |neighborhood| {
        let around = mean_of_neighbors(&noise, size, neighborhood);
        let best = of_paths(&around).shortest_per_pixel(NEAR_OPTIMUM);
        let share = |own: &Problem| {
            let equal = own.evaluate_uniform(uniform.light_paths, uniform.camera_paths).cost;
            own.evaluate(best.light_paths, best.camera_paths.clone()).cost / equal
        };
        let share = judges.iter().map(share).fold(0.0, f64::max);
        PerPixel { cost: uniform.cost * share, ..best }
    };
    let all = NEIGHBORHOODS.map(judged).into_iter();
    all.min_by(|one, other| one.cost.total_cmp(&other.cost))
}

/// Mean of the values within so many rows and columns of each, without the value itself.
fn mean_of_neighbors(values: &[f64], (width, height): (u32, u32), within: usize) -> Vec<f64> {
    let [width, height] = [width, height].map(|side| side as usize);
    // Sums of all values above and to the left.
    let mut sums = vec![0.0; (width + 1) * (height + 1)];
    for (row, values) in values.chunks(width).enumerate() {
        let mut sum = 0.0;
        for (column, value) in values.iter().enumerate() {
            sum += value;
            sums[(row + 1) * (width + 1) + column + 1] = sums[row * (width + 1) + column + 1] + sum;
        }
    }
    let around = |at: usize, end: usize| [at.saturating_sub(within), (at + within + 1).min(end)];
    let mean = |(index, own): (usize, &f64)| {
        let [left, right] = around(index % width, width);
        let [top, bottom] = around(index / width, height);
        let above = |row: usize| sums[row * (width + 1) + right] - sums[row * (width + 1) + left];
        let others = (right - left) * (bottom - top) - 1;
        // Rounding may leave less than nothing.
        let sum = (above(bottom) - above(top) - own).max(0.0);
        if others > 0 { sum / others as f64 } else { *own }
    };
    values.iter().enumerate().map(mean).collect()
}

/// The values without the largest thousandth, which becomes 0.
fn without_largest(mut values: Vec<f64>) -> Vec<f64> {
    let left_out = values.len() / 1000;
    if left_out > 0 {
        let mut sorted = values.clone();
        let (.., bound, _) = sorted.select_nth_unstable_by(values.len() - left_out, f64::total_cmp);
        let bound = *bound;
        values.iter_mut().filter(|value| **value >= bound).for_each(|value| *value = 0.0);
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adaptive::optimize::{CountLimits, MAX_CAMERA_PATHS, Objective};
    use crate::timing::TimeModel;
    use bdpm_core::base::rng::{Stream, StreamKey};

    /// Counts by neighbors over equal counts, for these variances of a path in 60 by 40 pixels.
    fn share_of_cost(noise: Vec<f64>) -> f64 {
        let time = TimeModel {
            fixed: 0.0,
            light_path: 0.0,
            camera_path: 1e-6,
            look_up: 0.0,
            merge_pair: 0.0,
            pixels: 2400.0,
        };
        let luminance = [1.0; 2400];
        let bounds = CountLimits {
            light_paths: 2..=2,
            camera_paths: 1..=MAX_CAMERA_PATHS,
            iteration_time: 0.1,
        };
        let problem = |cells: &[Coefficients]| {
            Problem::new(cells, &luminance, Objective::Relative, time, &bounds)
        };
        let mean = noise.iter().sum::<f64>() / 2400.0;
        let mean = [Coefficients { b: mean, ..Coefficients::default() }; 2400];
        let uniform = problem(&mean).shortest_uniform(NEAR_OPTIMUM);
        by_neighbors(noise, (60, 40), problem, &uniform).unwrap().cost / uniform.cost
    }

    #[test]
    fn counts_of_path_tracing_follow_noise_that_lasts_and_no_bright_paths() {
        let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
        // The variances that a few paths show: most of them are those of one pixel in 10.
        let mut shown = |mean: f64| {
            let rare = if rng.next_1d() < 0.1 { 9.0 } else { 0.1 };
            let tail = -f64::from(rng.next_1d().max(1e-6)).ln();
            mean * rare * tail
        };
        // Nothing can be gained where all pixels are alike.
        let alike = share_of_cost((0..2400).map(|_| shown(1.0)).collect());
        assert!(alike > 0.95, "{alike}");
        // A tenth of the image is as noisy as all else together: half of the paths are for it.
        let noisy = |pixel: u32| if pixel % 60 < 6 { 25.0 } else { 1.0 };
        let apart = share_of_cost((0..2400).map(|pixel| shown(noisy(pixel))).collect());
        // (.1 * 5 + .9)^2 / (.1 * 25 + .9) = .58 with counts of the true variances.
        assert!((0.55..0.8).contains(&apart), "{apart}");
    }

    #[test]
    fn neighbors_are_the_square_around_a_pixel_without_it() {
        let values: Vec<f64> = (0..35).map(|i| f64::from(i * i % 11)).collect();
        for within in [1, 2, 9] {
            let found = mean_of_neighbors(&values, (7, 5), within as usize);
            for (index, found) in (0..35i32).zip(found) {
                let is_near = |other: &i32| {
                    let [dx, dy] = [other % 7 - index % 7, other / 7 - index / 7];
                    *other != index && dx.abs() <= within && dy.abs() <= within
                };
                let near: Vec<f64> =
                    (0..35).filter(is_near).map(|at| values[at as usize]).collect();
                let expected = near.iter().sum::<f64>() / near.len() as f64;
                assert!((found - expected).abs() < 1e-12, "{index} {within}");
            }
        }
        assert_eq!(mean_of_neighbors(&[3.0], (1, 1), 2), [3.0]);
    }
}
