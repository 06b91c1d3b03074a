//! Weighted least squares with a handful of unknowns, none of them negative.

use super::measure::TimeSample;
use crate::bisect::bisect;

/// Share of a column's square that the columns before it must leave unexplained, for the column to
/// count as independent.
const INDEPENDENT: f64 = 1e-4;

/// Minimum of the model's relative deviation: keeps the weights of exact samples finite.
const MIN_DEVIATION: f64 = 1e-6;

/// Coefficients of columns.
pub struct Solution {
    /// At least 0.
    pub values: Vec<f64>,
    /// Variances of a solution without that bound, which are rather too large. `None` if there are
    /// as many unknowns as samples and the samples have no errors.
    pub variances: Option<Vec<f64>>,
}

/// Indices of the columns that are not a combination of those before them.
pub fn independent(columns: &[Vec<f64>]) -> Vec<usize> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (mut kept, mut basis) = (Vec::new(), Vec::<Vec<f64>>::new());
    for (index, column) in columns.iter().enumerate() {
        let mut rest = column.clone();
        for unit in &basis {
            let along = dot(&rest, unit);
            rest.iter_mut().zip(unit).for_each(|(x, u)| *x -= along * u);
        }
        let square = dot(&rest, &rest);
        if square > INDEPENDENT * dot(column, column) {
            rest.iter_mut().for_each(|x| *x /= square.sqrt());
            basis.push(rest);
            kept.push(index);
        }
    }
    kept
}

/// Fits `values` by combinations of columns that are not negative: least squares of deviations.
/// `None` for columns that are a combination of those before them.
pub fn not_negative_parts<const N: usize>(
    columns: [Vec<f64>; N],
    values: &[f64],
) -> [Option<f64>; N] {
    let kept = independent(&columns);
    let used: Vec<&[f64]> = kept.iter().map(|&index| &columns[index][..]).collect();
    let (fitted, _) = not_negative(&used, &vec![1.0; values.len()], values);
    let mut parts = [None; N];
    kept.into_iter().zip(fitted).for_each(|(index, part)| parts[index] = Some(part));
    parts
}

/// Fits the samples' times by combinations of independent columns; deviations of the model are
/// relative to `scales`, seconds.
pub fn least_squares(columns: &[&[f64]], samples: &[TimeSample], scales: &[f64]) -> Solution {
    let spare = samples.len() - columns.len();
    let errors_known = samples.iter().all(|sample| sample.error.is_some());
    let weights = |deviation: f64| -> Vec<f64> {
        let weight = |(sample, scale): (&TimeSample, &f64)| {
            // theory.md (78)
            sample.error.unwrap_or(0.0).hypot(deviation * scale).powi(2).recip()
        };
        samples.iter().zip(scales).map(weight).collect()
    };
    let seconds: Vec<f64> = samples.iter().map(|sample| sample.seconds).collect();
    let deviation = match (spare, errors_known) {
        (0, true) => MIN_DEVIATION,
        // The weights matter only if a bound keeps the fit from being exact.
        (0, false) => 1.0,
        (spare, _) => {
            // Mandel and Paule: the square sum of weighted residuals falls with the deviation.
            // theory.md (78)
            let square_sum = |deviation| not_negative(columns, &weights(deviation), &seconds).1;
            bisect([MIN_DEVIATION, 10.0], 1e-11, |own| square_sum(own) <= spare as f64)[1]
        }
    };
    let weights = weights(deviation);
    let variances = (spare > 0 || errors_known).then(|| variances(columns, &weights));
    Solution { values: not_negative(columns, &weights, &seconds).0, variances }
}

/// The diagonal of the inverse of the normal matrix.
fn variances(columns: &[&[f64]], weights: &[f64]) -> Vec<f64> {
    let all: Vec<usize> = (0..columns.len()).collect();
    let unit = |k: usize| all.iter().map(|i| f64::from(u8::from(*i == k))).collect();
    let normal = normal(columns, &all, weights);
    all.iter().map(|&k| gauss(normal.clone(), unit(k))[k]).collect()
}

/// The best values that are not negative, and the weighted square sum of their residuals. The
/// optimum solves the problem of some subset of the columns without bounds. There are at most four
/// columns, so that all subsets can be tried.
fn not_negative(columns: &[&[f64]], weights: &[f64], seconds: &[f64]) -> (Vec<f64>, f64) {
    let square_sum = |values: &[f64]| {
        let fitted =
            |row: usize| columns.iter().zip(values).map(|(own, v)| own[row] * v).sum::<f64>();
        let square = |row: usize| weights[row] * (fitted(row) - seconds[row]).powi(2);
        (0..seconds.len()).map(square).sum::<f64>()
    };
    let zero = vec![0.0; columns.len()];
    let mut best = (zero.clone(), square_sum(&zero));
    for subset in 1u32..1 << columns.len() {
        let chosen: Vec<usize> = (0..columns.len()).filter(|i| subset >> i & 1 == 1).collect();
        let right = chosen.iter().map(|&i| dot(columns[i], seconds, weights)).collect();
        let solved = gauss(normal(columns, &chosen, weights), right);
        if solved.iter().all(|&value| value >= 0.0) {
            let mut values = zero.clone();
            chosen.iter().zip(solved).for_each(|(&i, value)| values[i] = value);
            let sum = square_sum(&values);
            if sum < best.1 {
                best = (values, sum);
            }
        }
    }
    best
}

fn dot(a: &[f64], b: &[f64], weights: &[f64]) -> f64 {
    a.iter().zip(b).zip(weights).map(|((a, b), w)| a * b * w).sum()
}

fn normal(columns: &[&[f64]], chosen: &[usize], weights: &[f64]) -> Vec<Vec<f64>> {
    let row = |&i: &usize| chosen.iter().map(|&j| dot(columns[i], columns[j], weights)).collect();
    chosen.iter().map(row).collect()
}

/// Solves `matrix x = right` for a symmetric positive definite matrix, scaled to a unit diagonal
/// as columns differ by many orders of magnitude.
fn gauss(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
    let n = right.len();
    let scale: Vec<f64> = (0..n).map(|i| matrix[i][i].sqrt().recip()).collect();
    for i in 0..n {
        right[i] *= scale[i];
        (0..n).for_each(|j| matrix[i][j] *= scale[i] * scale[j]);
    }
    for i in 0..n {
        for below in i + 1..n {
            let factor = matrix[below][i] / matrix[i][i];
            (i..n).for_each(|j| matrix[below][j] -= factor * matrix[i][j]);
            right[below] -= factor * right[i];
        }
    }
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|j| matrix[i][j] * right[j]).sum();
        right[i] = (right[i] - known) / matrix[i][i];
    }
    (0..n).map(|i| right[i] * scale[i]).collect()
}
