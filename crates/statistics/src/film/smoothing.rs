//! Means around each pixel with weights that decrease with the distance.

use rayon::prelude::*;

/// Weighted means around each pixel. The weights decrease linearly to 0 at a distance of five
/// pixels along rows and columns.
pub fn smooth<const N: usize>(values: &[[f64; N]], width: usize, height: usize) -> Vec<[f64; N]> {
    let along = |values: &[[f64; N]], step: usize, radius: usize, length: usize| {
        let mean = |index: usize| {
            let center = index / step % length;
            let (mut sums, mut all) = ([0.0; N], 0.0);
            for other in center.saturating_sub(radius)..(center + radius + 1).min(length) {
                let weight = (radius + 1 - center.abs_diff(other)) as f64;
                let values = &values[index + other * step - center * step];
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
                all += weight;
            }
            sums.map(|sum| sum / all)
        };
        (0..values.len()).into_par_iter().map(mean).collect::<Vec<_>>()
    };
    let rows = along(values, 1, SMOOTHING_RADIUS, width);
    along(&rows, width, SMOOTHING_RADIUS, height)
}

/// Sums around each cell. Their weights are a function of `1 - x/size` times `1 - y/size` at a
/// distance of `x` columns and `y` rows, and 0 from `size` cells on.
pub fn tent_sums<const N: usize>(
    values: &[[f64; N]],
    [width, height]: [usize; 2],
    size: usize,
    of: impl Fn(f64) -> f64 + Sync,
) -> Vec<[f64; N]> {
    let along = |values: &[[f64; N]], step: usize, length: usize| {
        let sum = |index: usize| {
            let center = index / step % length;
            let mut sums = [0.0; N];
            for other in (center + 1).saturating_sub(size)..(center + size).min(length) {
                let weight = of(1.0 - center.abs_diff(other) as f64 / size as f64);
                let values = &values[index + other * step - center * step];
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
            }
            sums
        };
        (0..values.len()).into_par_iter().map(sum).collect::<Vec<_>>()
    };
    let rows = along(values, 1, width);
    along(&rows, width, height)
}

/// Means over all cells at most `radius` rows and columns away from each.
pub fn box_means(values: &[f64], width: usize, height: usize, radius: usize) -> Vec<f64> {
    let along = |values: &[f64], step: usize, length: usize, lines: usize| {
        let line = |line: usize| {
            let first = if step == 1 { line * length } else { line };
            let mut sums = vec![0.0; length + 1];
            for index in 0..length {
                sums[index + 1] = sums[index] + values[first + index * step];
            }
            let mean = |center: usize| {
                let (from, to) = (center.saturating_sub(radius), (center + radius + 1).min(length));
                (sums[to] - sums[from]) / (to - from) as f64
            };
            (0..length).map(mean).collect::<Vec<_>>()
        };
        (0..lines).into_par_iter().map(line).collect::<Vec<_>>()
    };
    let rows = along(values, 1, width, height).concat();
    let columns = along(&rows, width, height, width);
    (0..values.len()).into_par_iter().map(|index| columns[index % width][index / width]).collect()
}

/// Radius of [`smooth`], pixels.
const SMOOTHING_RADIUS: usize = 4;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_means_are_those_of_the_cells_around() {
        let (width, height, radius) = (7, 5, 2);
        let values: Vec<f64> = (0..35).map(|index| f64::from(index * index % 11)).collect();
        let means = box_means(&values, width, height, radius);
        for (index, mean) in means.iter().enumerate() {
            let [x, y] = [index % width, index / width];
            let own = (0..values.len())
                .filter(|own| x.abs_diff(own % width) <= radius)
                .filter(|own| y.abs_diff(own / width) <= radius);
            let own: Vec<f64> = own.map(|own| values[own]).collect();
            let expected = own.iter().sum::<f64>() / own.len() as f64;
            assert!((mean - expected).abs() < 1e-12, "{index}");
        }
    }

    #[test]
    fn weights_of_tents_fall_to_zero_at_their_size() {
        let mut point = vec![[0.0]; 49];
        point[24] = [1.0];
        let sums = tent_sums(&point, [7, 7], 2, |weight| weight * weight);
        let at = |column: usize, row: usize| sums[row * 7 + column][0];
        assert_eq!(
            [at(3, 3), at(4, 3), at(3, 2), at(4, 4), at(5, 3)],
            [1.0, 0.25, 0.25, 0.0625, 0.0]
        );
    }

    #[test]
    fn smoothing_keeps_constants_and_sums() {
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
