//! Luminous intensity distributions of luminaires, and their exact sampling.
//!
//! A distribution is known at the nodes of a grid of polar angles and azimuths, and bilinear in
//! both angles between them. Outside of the grid it is 0.
//!
//! Directions are in the frame of the luminaire: it hangs with -z down, and x and y are horizontal.

use super::spot::inverted;
use glam::DVec3;
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// Coordinates of a distribution, as IES LM-63 and LM-75 name them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Photometry {
    /// The polar axis is horizontal in the image of a headlamp's beam: V is the latitude and H the
    /// longitude.
    A,
    /// The polar axis lies across the beam of a floodlight: H is the latitude and V the longitude.
    B,
    /// The polar axis is vertical: gamma is the angle from the nadir, and C the azimuth from +x
    /// toward +y.
    C,
}

impl Photometry {
    /// Unit vectors of the pole, of azimuth 0 and of azimuth 90 degrees. The beams of types A and B
    /// point down, V grows toward +x and H toward -y.
    fn axes(self) -> [DVec3; 3] {
        match self {
            Self::A => [DVec3::NEG_X, DVec3::NEG_Z, DVec3::NEG_Y],
            Self::B => [DVec3::Y, DVec3::NEG_Z, DVec3::X],
            Self::C => [DVec3::NEG_Z, DVec3::X, DVec3::Y],
        }
    }
}

/// A luminous intensity distribution.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IntensityDistribution {
    photometry: Photometry,
    /// Angles from the pole, ascending, in [0, pi], radians.
    polar: Vec<f64>,
    /// Azimuths, ascending over at most a turn, radians.
    azimuth: Vec<f64>,
    /// Intensity at the nodes, cd, one row of azimuths after the other.
    values: Vec<f64>,
    /// Integral of the intensity over the azimuth from the first to each node, cd rad, in the
    /// layout of `values`.
    #[serde(skip)]
    rings: Vec<f64>,
    /// Flux from the first to each polar angle, lm.
    #[serde(skip)]
    flux: Vec<f64>,
}

/// A cell of the grid and the place in it.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// Index of the node below.
    index: usize,
    /// Share of the way to the next node, in [0, 1].
    share: f64,
}

fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + t * (b - a)
}

/// The cell of ascending `nodes` that contains `at`; `None` outside.
fn place(nodes: &[f64], at: f64) -> Option<Place> {
    let (first, last) = (*nodes.first()?, *nodes.last()?);
    if !(first..=last).contains(&at) {
        return None;
    }
    let index = nodes.partition_point(|&node| node <= at).clamp(1, nodes.len() - 1) - 1;
    let share = (at - nodes[index]) / (nodes[index + 1] - nodes[index]);
    Some(Place { index, share: share.clamp(0.0, 1.0) })
}

/// Integral of `(a + b t) sin t` from `from` to `to`.
fn ring_integral([a, b]: [f64; 2], from: f64, to: f64) -> f64 {
    let antiderivative = |t: f64| b * t.sin() - (a + b * t) * t.cos();
    antiderivative(to) - antiderivative(from)
}

impl IntensityDistribution {
    /// A distribution with `values[i][j]`, cd, at the i-th polar angle and the j-th azimuth.
    ///
    /// The polar angles ascend within [0, pi], the azimuths over at most a turn. There are at least
    /// two of each. The values are finite and at least 0. `None` if any of this does not hold.
    pub fn new(
        photometry: Photometry,
        polar: Vec<f64>,
        azimuth: Vec<f64>,
        values: Vec<f64>,
    ) -> Option<Self> {
        const ROUNDING: f64 = 1e-9;
        let ascends = |nodes: &[f64]| nodes.len() > 1 && nodes.windows(2).all(|w| w[0] < w[1]);
        let (rows, columns) = (polar.len(), azimuth.len());
        let is_valid = ascends(&polar)
            && ascends(&azimuth)
            && polar[0] >= 0.0
            && polar[rows - 1] <= TAU / 2.0 + ROUNDING
            && azimuth[columns - 1] - azimuth[0] <= TAU + ROUNDING
            && values.len() == rows * columns
            && values.iter().all(|value| (0.0..f64::INFINITY).contains(value));
        if !is_valid {
            return None;
        }
        let mut rings = Vec::with_capacity(values.len());
        for row in values.chunks(columns) {
            let mut sum = 0.0;
            rings.push(sum);
            for (value, angle) in row.windows(2).zip(azimuth.windows(2)) {
                sum += 0.5 * (value[0] + value[1]) * (angle[1] - angle[0]);
                rings.push(sum);
            }
        }
        let mut flux = vec![0.0];
        for (row, angle) in polar.windows(2).enumerate() {
            let [ring, next] = [row, row + 1].map(|row| rings[(row + 1) * columns - 1]);
            let line = line_through([angle[0], angle[1]], [ring, next]);
            flux.push(flux[row] + ring_integral(line, angle[0], angle[1]).max(0.0));
        }
        Some(Self { photometry, polar, azimuth, values, rings, flux })
    }

    /// The distribution of a luminaire whose y axis is mirrored, as by a transform with a negative
    /// determinant. `None` if rounding makes angles equal that nearly were.
    pub fn mirrored(&self) -> Option<Self> {
        let columns = self.azimuth.len();
        let rows = self.values.chunks(columns);
        let (polar, azimuth, values) = match self.photometry {
            // The pole is y. Rounding may leave the range by its tolerance.
            Photometry::B => {
                let polar = self.polar.iter().rev().map(|angle| (PI - angle).max(0.0)).collect();
                (polar, self.azimuth.clone(), rows.rev().flatten().copied().collect())
            }
            // Azimuths are about x, or begin there. Those of type C begin within the first turn.
            Photometry::A | Photometry::C => {
                let last = self.azimuth[columns - 1];
                let turns =
                    if self.photometry == Photometry::C { (last / TAU).ceil() } else { 0.0 };
                let azimuth = self.azimuth.iter().rev().map(|angle| turns * TAU - angle).collect();
                let values = rows.flat_map(|row| row.iter().rev()).copied().collect();
                (self.polar.clone(), azimuth, values)
            }
        };
        Self::new(self.photometry, polar, azimuth, values)
    }

    /// Coordinates of the angles.
    pub fn photometry(&self) -> Photometry {
        self.photometry
    }

    /// Angles from the pole, radians, ascending.
    pub fn polar(&self) -> &[f64] {
        &self.polar
    }

    /// Azimuths, radians, ascending.
    pub fn azimuth(&self) -> &[f64] {
        &self.azimuth
    }

    /// Intensity at the nodes, cd, one row of azimuths for each polar angle.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Luminous flux, lm: the integral of the intensity over all directions.
    pub fn flux(&self) -> f64 {
        self.flux[self.flux.len() - 1]
    }

    /// Greatest intensity, cd.
    pub fn peak(&self) -> f64 {
        self.values.iter().copied().fold(0.0, f64::max)
    }

    /// The distribution times a factor of at least 0.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let times = |values: &[f64]| values.iter().map(|value| factor * value).collect();
        Self {
            values: times(&self.values),
            rings: times(&self.rings),
            flux: times(&self.flux),
            ..self.clone()
        }
    }

    /// Polar angle and azimuth of a unit direction. The azimuth is in the turn that begins with the
    /// grid.
    fn angles(&self, direction: DVec3) -> [f64; 2] {
        let [z, x, y] = self.photometry.axes().map(|axis| axis.dot(direction));
        let first = self.azimuth[0];
        [x.hypot(y).atan2(z), first + (y.atan2(x) - first).rem_euclid(TAU)]
    }

    fn places(&self, direction: DVec3) -> Option<[Place; 2]> {
        let [polar, azimuth] = self.angles(direction);
        // Rounding must not leave a gap between the last angle and the first.
        let last = self.azimuth[self.azimuth.len() - 1];
        let is_closed = last - self.azimuth[0] >= TAU - 1e-9;
        let azimuth = if is_closed { azimuth.min(last) } else { azimuth };
        Some([place(&self.polar, polar)?, place(&self.azimuth, azimuth)?])
    }

    /// Value of one of the tables at a node of the polar angles and a place between the azimuths.
    fn row(&self, row: usize, at: Place) -> f64 {
        let start = row * self.azimuth.len() + at.index;
        lerp(self.values[start], self.values[start + 1], at.share)
    }

    /// Intensity in a unit direction of the luminaire's frame, cd.
    pub fn intensity(&self, direction: DVec3) -> f64 {
        let Some([polar, azimuth]) = self.places(direction) else { return 0.0 };
        let [below, above] = [0, 1].map(|next| self.row(polar.index + next, azimuth));
        lerp(below, above, polar.share)
    }

    /// Integral over the azimuth, up to its node `column`, at a polar angle, cd rad.
    fn ring(&self, polar: Place, column: usize) -> f64 {
        let columns = self.azimuth.len();
        let [below, above] = [0, 1].map(|next| self.rings[(polar.index + next) * columns + column]);
        lerp(below, above, polar.share)
    }

    /// A unit direction whose density is the intensity over the flux, from two uniform numbers.
    ///
    /// The first number selects the polar angle by inversion of the marginal distribution, in which
    /// the integral over the azimuth is linear between nodes. The second selects the azimuth, in
    /// which the intensity is linear between nodes. Both inversions are exact, so that the flux of
    /// all samples is equal.
    pub fn sample(&self, [u, v]: [f64; 2]) -> DVec3 {
        let target = u * self.flux();
        let rows = self.polar.len();
        let row = self.flux.partition_point(|&flux| flux <= target).clamp(1, rows - 1) - 1;
        let polar = self.polar_angle(row, target - self.flux[row]);
        let share = (polar - self.polar[row]) / (self.polar[row + 1] - self.polar[row]);
        let at = Place { index: row, share };

        let last = self.azimuth.len() - 1;
        let target = v * self.ring(at, last);
        // The first node whose integral exceeds the target
        let (mut low, mut high) = (0, last);
        while high - low > 1 {
            let middle = usize::midpoint(low, high);
            if self.ring(at, middle) <= target { low = middle } else { high = middle }
        }
        let width = self.azimuth[low + 1] - self.azimuth[low];
        let [p, q] = [low, low + 1].map(|column| {
            let node = |row: usize| self.values[row * (last + 1) + column];
            lerp(node(row), node(row + 1), share)
        });
        let rest = ((target - self.ring(at, low)) / width).max(0.0);
        let root = (p * p + 2.0 * (q - p) * rest).max(0.0).sqrt();
        let across = if p + root > 0.0 { (2.0 * rest / (p + root)).min(1.0) } else { 0.0 };
        self.direction(polar, self.azimuth[low] + across * width)
    }

    /// The polar angle in a row of cells below which the row has the flux `rest`, lm.
    fn polar_angle(&self, row: usize, rest: f64) -> f64 {
        let (from, to) = (self.polar[row], self.polar[row + 1]);
        let line = self.ring_line(row);
        inverted(rest, [from, to], 0.5 * (from + to), |at| {
            [ring_integral(line, from, at), (line[0] + line[1] * at) * at.sin()]
        })
    }

    /// The integral over the azimuth in a row of cells, a linear function of the polar angle, cd
    /// rad.
    fn ring_line(&self, row: usize) -> [f64; 2] {
        let columns = self.azimuth.len();
        let rings = [row, row + 1].map(|row| self.rings[(row + 1) * columns - 1]);
        line_through([self.polar[row], self.polar[row + 1]], rings)
    }

    /// Inverse of [`Self::sample`]: the numbers that select this direction; `None` where the
    /// intensity is 0.
    pub fn numbers(&self, direction: DVec3) -> Option<[f64; 2]> {
        let [polar, azimuth] = self.places(direction)?;
        let row = polar.index;
        let angle = lerp(self.polar[row], self.polar[row + 1], polar.share);
        let below = ring_integral(self.ring_line(row), self.polar[row], angle);
        let u = (self.flux[row] + below) / self.flux();
        let whole = self.ring(polar, self.azimuth.len() - 1);
        let width = self.azimuth[azimuth.index + 1] - self.azimuth[azimuth.index];
        let at = |share: f64| {
            let at = Place { share, ..azimuth };
            lerp(self.row(row, at), self.row(row + 1, at), polar.share)
        };
        let part = 0.5 * (at(0.0) + at(azimuth.share)) * azimuth.share * width;
        let v = (self.ring(polar, azimuth.index) + part) / whole;
        (u.is_finite() && v.is_finite()).then(|| [u, v].map(|x| x.clamp(0.0, 1.0f64.next_down())))
    }

    /// Unit direction of a polar angle and an azimuth, radians.
    pub fn direction(&self, polar: f64, azimuth: f64) -> DVec3 {
        let [pole, zero, quarter] = self.photometry.axes();
        let ((sin, cos), (y, x)) = (polar.sin_cos(), azimuth.sin_cos());
        cos * pole + sin * (x * zero + y * quarter)
    }
}

/// Coefficients `[a, b]` of the linear function `a + b t` through two points.
fn line_through([t0, t1]: [f64; 2], [y0, y1]: [f64; 2]) -> [f64; 2] {
    let slope = (y1 - y0) / (t1 - t0);
    [y0 - slope * t0, slope]
}

#[cfg(test)]
mod tests;
