//! Intensity in a direction by a quadratic fit to the nodes around it.
//!
//! A node's value is the mean of the intensity over its hat function. The fit is therefore one to
//! the means of the polynomials over the hat functions: it gives the intensity itself.

use glam::{DMat3, DVec3};
use std::f64::consts::{PI, TAU};

/// Polynomials up to the second degree in two coordinates.
const TERMS: usize = 6;

/// Samples of a hat function along gamma.
const SAMPLES: usize = 64;

/// Means of the directions and of their products over the hat function of a node in the plane C0.
#[derive(Clone, Copy, Debug)]
struct Moments {
    /// Solid angle of the hat function, sr.
    solid: f64,
    mean: DVec3,
    products: DMat3,
}

/// The nodes of a grid: gamma from 0 to 180 degrees, and C planes of a whole turn, in even steps.
/// The nadir is -z, and the plane C0 is toward +x.
#[derive(Clone, Debug)]
pub(super) struct Nodes {
    planes: usize,
    rows: Vec<Moments>,
}

/// Sum of the values of nodes, times factors.
pub(super) type Functional = Vec<(usize, f64)>;

/// Unit direction at angles in radians.
fn direction(gamma: f64, c: f64) -> DVec3 {
    let ((sin, cos), (y, x)) = (gamma.sin_cos(), c.sin_cos());
    DVec3::new(sin * x, sin * y, -cos)
}

/// The square of sin(x)/x, the mean of the cosine of twice an angle over a hat function of the
/// half-width `x`, times two.
fn squared_sinc(x: f64) -> f64 {
    (x.sin() / x).powi(2)
}

impl Nodes {
    /// The nodes of a grid with at least two rows and a plane.
    pub fn new(rows: usize, planes: usize) -> Self {
        let step = PI / (rows - 1) as f64;
        let c_step = TAU / planes as f64;
        let row = |row: usize| {
            let is_pole = row == 0 || row + 1 == rows;
            // Means of the cosine of C and of that of twice C: poles have one node
            let [k1, k2] = match is_pole {
                true => [0.0, 0.0],
                false => [squared_sinc(0.5 * c_step), squared_sinc(c_step)],
            };
            let width_c = if is_pole { TAU } else { c_step };
            let mut own = Moments { solid: 0.0, mean: DVec3::ZERO, products: DMat3::ZERO };
            for sample in 0..SAMPLES {
                let off = 2.0 * (sample as f64 + 0.5) / SAMPLES as f64 - 1.0;
                let gamma = step * (row as f64 + off);
                if !(0.0..=PI).contains(&gamma) {
                    continue;
                }
                let (sin, cos) = gamma.sin_cos();
                let weight = (1.0 - off.abs()) * sin * width_c * 2.0 * step / SAMPLES as f64;
                own.solid += weight;
                own.mean += weight * DVec3::new(sin * k1, 0.0, -cos);
                let [xx, yy] = [0.5 * (1.0 + k2), 0.5 * (1.0 - k2)].map(|own| own * sin * sin);
                let xz = -sin * cos * k1;
                let columns = [[xx, 0.0, xz], [0.0, yy, 0.0], [xz, 0.0, cos * cos]];
                own.products += DMat3::from_cols_array_2d(&columns) * weight;
            }
            own.mean /= own.solid;
            own.products *= own.solid.recip();
            own
        };
        Self { planes, rows: (0..rows).map(row).collect() }
    }

    /// Angle between rows, radians.
    pub fn step(&self) -> f64 {
        PI / (self.rows.len() - 1) as f64
    }

    /// Angle of a plane, radians.
    fn plane(&self, plane: usize) -> f64 {
        TAU * plane as f64 / self.planes as f64
    }

    /// Direction of a node by its index.
    pub fn direction(&self, node: usize) -> DVec3 {
        direction(self.step() * (node / self.planes) as f64, self.plane(node % self.planes))
    }

    /// Direction of a row of a plane, in radians.
    pub fn in_plane(&self, row: usize, c: f64) -> DVec3 {
        direction(self.step() * row as f64, c)
    }

    /// Solid angle of the hat function of a node, sr.
    pub fn solid_angle(&self, node: usize) -> f64 {
        self.rows[node / self.planes].solid
    }

    /// Nodes within an angle of a direction, radians. Each pole counts once.
    pub fn within(&self, center: DVec3, radius: f64) -> Vec<usize> {
        let gamma = (-center.z).clamp(-1.0, 1.0).acos();
        let first = ((gamma - radius) / self.step()).ceil().max(0.0) as usize;
        let last = ((gamma + radius) / self.step()).floor() as usize;
        let last_row = self.rows.len() - 1;
        let mut near = Vec::new();
        for row in first..=last.min(last_row) {
            if row == 0 || row == last_row {
                near.push(row * self.planes);
                continue;
            }
            // Planes of a row within the angle, by the cosine rule of spherical triangles
            let (sines, cosines) = self.sides(gamma, row);
            let cosine = (radius.cos() - cosines) / sines;
            let half = if cosine > -1.0 { cosine.min(1.0).acos() } else { PI };
            let c_step = TAU / self.planes as f64;
            let middle = center.y.atan2(center.x) / c_step;
            let (from, to) = ((middle - half / c_step).ceil(), (middle + half / c_step).floor());
            let count = ((to - from + 1.0).max(0.0) as usize).min(self.planes);
            let plane = |at: usize| (from as i64 + at as i64).rem_euclid(self.planes as i64);
            near.extend((0..count).map(|at| row * self.planes + plane(at) as usize));
        }
        near
    }

    /// Products of the sines and of the cosines of an angle and of that of a row.
    fn sides(&self, gamma: f64, row: usize) -> (f64, f64) {
        let (sin, cos) = (self.step() * row as f64).sin_cos();
        (gamma.sin() * sin, gamma.cos() * cos)
    }

    /// The functional that gives the intensity in a direction by the fit to the nodes within an
    /// angle, which count by their solid angles. `None` if there are too few.
    pub fn fit(&self, center: DVec3, radius: f64) -> Option<Functional> {
        let mut wanted = [0.0; TERMS];
        wanted[0] = 1.0;
        self.functional(center, radius, wanted)
    }

    /// The functional that gives the mean of [`Self::fit`] over the hat function of a node.
    pub fn fitted(&self, center: DVec3, radius: f64, node: usize) -> Option<Functional> {
        self.functional(center, radius, self.terms(center, radius, node))
    }

    /// Means of the polynomials around a center over the hat function of a node, in units of the
    /// radius, so that matrices are well conditioned.
    fn terms(&self, center: DVec3, radius: f64, node: usize) -> [f64; TERMS] {
        let (e1, e2) = center.any_orthonormal_pair();
        let Moments { mean, products, .. } = self.rows[node / self.planes];
        let turn = DMat3::from_rotation_z(self.plane(node % self.planes));
        let (mean, products) = (turn * mean, turn * products * turn.transpose());
        let [x, y] = [e1, e2].map(|axis| axis.dot(mean) / radius);
        let second = |a: DVec3, b: DVec3| a.dot(products * b) / (radius * radius);
        [1.0, x, y, second(e1, e1), second(e1, e2), second(e2, e2)]
    }

    /// The functional that gives the fitted polynomial with these values of its terms.
    fn functional(&self, center: DVec3, radius: f64, wanted: [f64; TERMS]) -> Option<Functional> {
        let mut matrix = [[0.0; TERMS]; TERMS];
        let nodes = self.within(center, radius);
        let mut rows = Vec::with_capacity(nodes.len());
        for node in nodes {
            let (solid, terms) = (self.solid_angle(node), self.terms(center, radius, node));
            for (row, own) in matrix.iter_mut().zip(terms) {
                row.iter_mut().zip(terms).for_each(|(sum, other)| *sum += solid * own * other);
            }
            rows.push((node, solid, terms));
        }
        if rows.len() < 2 * TERMS {
            return None;
        }
        let solution = solve(matrix, wanted)?;
        let factor =
            |terms: [f64; TERMS]| terms.iter().zip(solution).map(|(a, b)| a * b).sum::<f64>();
        Some(rows.into_iter().map(|(node, solid, terms)| (node, solid * factor(terms))).collect())
    }
}

/// Solves a system with a symmetric positive matrix by Gaussian elimination; `None` if it is nearly
/// singular.
fn solve(mut matrix: [[f64; TERMS]; TERMS], mut right: [f64; TERMS]) -> Option<[f64; TERMS]> {
    let scale = matrix[0][0];
    for pivot in 0..TERMS {
        // Pivots of positive matrices need no exchange.
        let own = matrix[pivot][pivot];
        if own.is_nan() || own <= 1e-6 * scale {
            return None;
        }
        for row in pivot + 1..TERMS {
            let factor = matrix[row][pivot] / own;
            let above = matrix[pivot];
            matrix[row].iter_mut().zip(above).for_each(|(value, above)| *value -= factor * above);
            right[row] -= factor * right[pivot];
        }
    }
    for row in (0..TERMS).rev() {
        let known: f64 = (row + 1..TERMS).map(|other| matrix[row][other] * right[other]).sum();
        right[row] = (right[row] - known) / matrix[row][row];
    }
    Some(right)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean of a function over the hat function of a node, by brute force.
    fn over_hat(rows: usize, planes: usize, node: usize, of: impl Fn(DVec3) -> f64) -> f64 {
        let (row, plane) = (node / planes, node % planes);
        let [step, c_step] = [PI / (rows - 1) as f64, TAU / planes as f64];
        let is_pole = row == 0 || row == rows - 1;
        let (mut sum, mut weights) = (0.0, 0.0);
        let count = 60;
        for cell in 0..count * count {
            let off = |at: i32| 2.0 * (f64::from(at) + 0.5) / f64::from(count) - 1.0;
            let [a, b] = [off(cell % count), off(cell / count)];
            let gamma = step * (row as f64 + a);
            if !(0.0..=PI).contains(&gamma) {
                continue;
            }
            let (c, hat_c) = match is_pole {
                true => (PI * b, 1.0),
                false => (c_step * (plane as f64 + b), 1.0 - b.abs()),
            };
            let weight = (1.0 - a.abs()) * hat_c * gamma.sin();
            sum += weight * of(direction(gamma, c));
            weights += weight;
        }
        sum / weights
    }

    #[test]
    fn hat_functions_have_their_means_and_the_sphere() {
        let (rows, planes) = (19, 12);
        let nodes = Nodes::new(rows, planes);
        let all = nodes.within(DVec3::Z, PI);
        let solid: f64 = all.iter().map(|node| nodes.solid_angle(*node)).sum();
        assert!((solid / (4.0 * PI) - 1.0).abs() < 1e-3, "{solid}");
        assert_eq!(all.len(), (rows - 2) * planes + 2);
        for node in [0, planes, 5 * planes + 7, 18 * planes] {
            let Moments { mean, products, .. } = nodes.rows[node / planes];
            let turn = DMat3::from_rotation_z(nodes.plane(node % planes));
            let (mean, products) = (turn * mean, turn * products * turn.transpose());
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let expected = over_hat(rows, planes, node, |own| own.dot(axis));
                assert!((mean.dot(axis) - expected).abs() < 1e-3, "{node} {axis}");
                let expected = over_hat(rows, planes, node, |own| own.dot(axis) * own.x);
                assert!(((products * axis).x - expected).abs() < 1e-3, "{node} {axis}");
            }
        }
    }

    #[test]
    fn fit_gives_the_intensity_of_smooth_distributions_and_not_its_mean() {
        let (rows, planes) = (37, 24);
        let nodes = Nodes::new(rows, planes);
        let axis = DVec3::new(0.1, 0.05, -1.0).normalize();
        let lamp = |own: DVec3| own.dot(axis).max(0.0);
        let values: Vec<f64> =
            (0..rows * planes).map(|node| over_hat(rows, planes, node, lamp)).collect();
        for center in [axis, DVec3::NEG_Z, direction(0.3, 1.0)] {
            for (radius, tolerance) in [(10f64, 1e-4), (20.0, 2e-3)] {
                let fit = nodes.fit(center, radius.to_radians()).unwrap();
                let found: f64 = fit.iter().map(|(node, factor)| factor * values[*node]).sum();
                assert!((found - lamp(center)).abs() < tolerance, "{center} {radius}: {found}");
            }
        }
        assert!(nodes.fit(axis, 0.03).is_none(), "too few nodes");
    }
}
