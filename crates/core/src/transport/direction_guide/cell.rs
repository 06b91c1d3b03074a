//! A density over directions, constant over the bins of an unfolded octahedron.
//!
//! The octahedron needs neither roots nor angles: a direction is divided by the sum of its absolute
//! components, whose cube is the quotient of both measures.

use glam::Vec3;

/// Bins along each side of the unfolded octahedron.
const ACROSS: usize = 16;

/// Number of bins.
pub const BINS: usize = ACROSS * ACROSS;

/// Units of probabilities.
const UNITS: f32 = 65536.0;

/// Cumulative probabilities before each of the bins, in units of 1/65536.
type Sums = [u16; ACROSS];

/// The density of a cell: probabilities of its rows, and of the columns of each row. Its first
/// cache line leads to one other.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct Cell {
    rows: Sums,
    bsdf_share: f32,
    columns: [Sums; ACROSS],
}

/// Coordinates of a direction on the unfolded octahedron, in units of bins, and its density over
/// that on the square, both in units of one bin.
#[inline(always)] // part of the loops over vertices, as those below
fn unfold(direction: Vec3) -> ([f32; 2], f32) {
    let inverse = direction.abs().element_sum().recip();
    let (x, y) = (direction.x * inverse, direction.y * inverse);
    let is_below = direction.z < 0.0;
    let (folded_x, folded_y) = ((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y));
    let (x, y) = (if is_below { folded_x } else { x }, if is_below { folded_y } else { y });
    let half = 0.5 * ACROSS as f32;
    let density = half * half * inverse * inverse * inverse;
    ([(x + 1.0) * half, (y + 1.0) * half], density)
}

/// Unit direction of coordinates in units of bins.
#[inline(always)]
fn fold([x, y]: [f32; 2]) -> Vec3 {
    let scale = 2.0 / ACROSS as f32;
    let (x, y) = (x * scale - 1.0, y * scale - 1.0);
    let z = 1.0 - x.abs() - y.abs();
    let is_below = z < 0.0;
    let (folded_x, folded_y) = ((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y));
    let (x, y) = (if is_below { folded_x } else { x }, if is_below { folded_y } else { y });
    let at = Vec3::new(x, y, z);
    at * at.length_squared().sqrt().recip()
}

#[inline(always)]
fn bin_of(at: f32) -> usize {
    (at as i32).clamp(0, ACROSS as i32 - 1) as usize
}

/// Unit direction of the center of a bin.
pub fn center(bin: usize) -> Vec3 {
    fold([(bin % ACROSS) as f32 + 0.5, (bin / ACROSS) as f32 + 0.5])
}

/// Density in solid angle of a bin of probability 1, 1/sr.
pub fn density_of(direction: Vec3) -> f32 {
    unfold(direction).1
}

/// The four bins nearest to a direction, with shares that are linear in its coordinates.
pub fn nearest_bins(direction: Vec3) -> [(usize, f32); 4] {
    let ([x, y], _) = unfold(direction);
    let (x, y) = (x - 0.5, y - 0.5);
    let (left, top) = (x.floor(), y.floor());
    let (right, bottom) = (x - left, y - top);
    let [column, row] = [left as i32, top as i32];
    [
        (neighbor(column, row), (1.0 - right) * (1.0 - bottom)),
        (neighbor(column + 1, row), right * (1.0 - bottom)),
        (neighbor(column, row + 1), (1.0 - right) * bottom),
        (neighbor(column + 1, row + 1), right * bottom),
    ]
}

/// Index of a bin that may be one step outside of the square. Beyond an edge, the octahedron goes
/// on in the other half of the same edge.
fn neighbor(column: i32, row: i32) -> usize {
    let across = ACROSS as i32;
    let is_inside = |at: i32| (0..across).contains(&at);
    let row_across = if is_inside(column) { row } else { across - 1 - row };
    let column_across = if is_inside(row) { column } else { across - 1 - column };
    let [column, row] = [column_across, row_across].map(|at| at.clamp(0, across - 1));
    (row * across + column) as usize
}

/// Index of the bin that contains `at`, in units of 1/65536, and the position in it.
#[inline(always)]
fn choose(sums: &Sums, at: f32) -> (usize, f32) {
    let units = at as i32 as u16;
    let mut count = 0_u16;
    for &sum in sums {
        count += u16::from(sum <= units);
    }
    let index = (count - 1) as usize & (ACROSS - 1);
    let [start, end] = interval(sums, index);
    (index, (at - start) / (end - start))
}

#[inline(always)]
fn interval(sums: &Sums, index: usize) -> [f32; 2] {
    let end = if index + 1 < ACROSS { f32::from(sums[index + 1]) } else { UNITS };
    [f32::from(sums[index]), end]
}

/// Sums of probabilities in proportion to weights; equal ones if there are none.
fn sums(weights: &[f32]) -> Sums {
    let total: f32 = weights.iter().sum();
    let (mut sums, mut before) = ([0; ACROSS], 0.0);
    for (sum, weight) in sums.iter_mut().zip(weights) {
        *sum = (before * UNITS).round().min(UNITS - 1.0) as u16;
        before += if total > 0.0 { weight / total } else { 1.0 / ACROSS as f32 };
    }
    sums
}

impl Cell {
    /// A density in proportion to weights of the bins, row by row, and the share of directions that
    /// do not come from it.
    pub fn new(weights: &[f32; BINS], bsdf_share: f32) -> Self {
        let (mut rows, mut columns) = ([0.0; ACROSS], [Sums::default(); ACROSS]);
        for (row, weights) in weights.chunks_exact(ACROSS).enumerate() {
            rows[row] = weights.iter().sum();
            columns[row] = sums(weights);
        }
        Self { rows: sums(&rows), bsdf_share, columns }
    }

    /// Share of the directions that come from the BSDF.
    #[inline(always)]
    pub fn bsdf_share(&self) -> f32 {
        self.bsdf_share
    }

    /// Samples a unit direction.
    #[inline(always)]
    pub fn sample(&self, [u, v]: [f32; 2]) -> Vec3 {
        let (row, y) = choose(&self.rows, u * UNITS);
        let (column, x) = choose(&self.columns[row], v * UNITS);
        fold([column as f32 + x, row as f32 + y])
    }

    /// Density in solid angle, 1/sr.
    #[inline(always)]
    pub fn pdf_w(&self, direction: Vec3) -> f32 {
        let ([x, y], density) = unfold(direction);
        let (row, column) = (bin_of(y), bin_of(x));
        let [top, bottom] = interval(&self.rows, row);
        let [left, right] = interval(&self.columns[row], column);
        (bottom - top) * (right - left) * (UNITS * UNITS).recip() * density
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::uniform_sphere;
    use crate::base::rng::{Stream, StreamKey};

    /// A density with many empty bins.
    fn uneven() -> ([f32; BINS], Cell) {
        let weight = |bin: usize| if bin.is_multiple_of(5) { 0.0 } else { (bin % 7) as f32 };
        let weights = std::array::from_fn(weight);
        (weights, Cell::new(&weights, 0.5))
    }

    #[test]
    fn samples_have_the_probabilities_of_their_bins() {
        let (weights, cell) = uneven();
        let (key, mut counts) = (StreamKey::new(1, Stream::Test, 0), [0.0; BINS]);
        const SAMPLES: u64 = 400_000;
        for index in 0..SAMPLES {
            let direction = cell.sample(key.rng(index).next_2d());
            assert!((direction.length() - 1.0).abs() < 1e-5);
            let ([x, y], _) = unfold(direction);
            counts[bin_of(y) * ACROSS + bin_of(x)] += 1.0;
        }
        let total: f32 = weights.iter().sum();
        let (mut chi2, mut degrees) = (0.0, -1.0);
        for (count, weight) in counts.into_iter().zip(weights) {
            let expected = f64::from(weight / total) * SAMPLES as f64;
            if expected > 0.0 {
                chi2 += (count - expected).powi(2) / expected;
                degrees += 1.0;
            } else {
                // Rounding moves few samples across an edge.
                assert!(count < 5.0, "{count}");
            }
        }
        // Mean and standard deviation of the distribution
        assert!(chi2 < degrees + 4.0 * f64::sqrt(2.0 * degrees), "{chi2} {degrees}");
    }

    #[test]
    fn density_integrates_to_one() {
        let (_, cell) = uneven();
        let (key, mut sums) = (StreamKey::new(2, Stream::Test, 0), [0.0; 2]);
        const SAMPLES: u64 = 400_000;
        for index in 0..SAMPLES {
            let direction = uniform_sphere(key.rng(index).next_2d());
            let value = f64::from(cell.pdf_w(direction)) * 4.0 * std::f64::consts::PI;
            sums = [sums[0] + value, sums[1] + value * value];
        }
        let [mean, square] = sums.map(|sum| sum / SAMPLES as f64);
        let error = ((square - mean * mean) / SAMPLES as f64).sqrt();
        assert!((mean - 1.0).abs() < 4.0 * error && error < 5e-3, "{mean} {error}");
    }

    #[test]
    fn neighbors_across_edges_are_near() {
        for index in 0..20_000 {
            let direction = uniform_sphere(StreamKey::new(3, Stream::Test, 0).rng(index).next_2d());
            let mut total = 0.0;
            for (bin, share) in nearest_bins(direction) {
                total += share;
                assert!(center(bin).dot(direction) > 0.85, "{bin} {direction}");
            }
            assert!((total - 1.0).abs() < 1e-5);
        }
    }
}
