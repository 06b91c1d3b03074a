//! From planes of a file, possibly a part of them by symmetry, to a grid over all directions.

use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::{IntensityDistribution, Photometry};

/// Intensities as a file lists them.
pub(super) struct Planes {
    /// Angles within each plane, degrees, ascending.
    pub within: Vec<f64>,
    /// Angles of the planes, degrees, ascending.
    pub planes: Vec<f64>,
    /// Intensity of each plane at each angle within it, cd.
    pub values: Vec<Vec<f64>>,
}

/// Angles this close are equal, degrees.
const TOLERANCE: f64 = 1e-3;

pub(super) fn is_near(a: f64, b: f64) -> bool {
    (a - b).abs() < TOLERANCE
}

impl Planes {
    /// Appends the mirror images of all planes about the angle `about`, degrees, in reverse order.
    /// A plane at that angle is its own image.
    fn mirror(&mut self, about: f64) {
        for index in (0..self.planes.len()).rev() {
            if !is_near(self.planes[index], about) {
                self.planes.push(2.0 * about - self.planes[index]);
                self.values.push(self.values[index].clone());
            }
        }
    }

    /// Completes the planes of type C, whose angles are azimuths, to a whole turn.
    ///
    /// # Errors
    /// If the range of the angles is none that the formats define. The error names no file.
    pub fn close(mut self, notes: &mut Vec<String>) -> Result<Self> {
        let range = |own: &Self| [own.planes[0], own.planes[own.planes.len() - 1]];
        let [first, last] = range(&self);
        let spans = |from: f64, to: f64| is_near(first, from) && is_near(last, to);
        if self.planes.len() == 1 {
            self.planes = vec![0.0, 360.0];
            self.values.push(self.values[0].clone());
            return Ok(self);
        }
        if spans(0.0, 90.0) {
            self.mirror(90.0);
            self.mirror(180.0);
        } else if spans(0.0, 180.0) {
            self.mirror(180.0);
        } else if spans(90.0, 270.0) || spans(-90.0, 90.0) || spans(270.0, 450.0) {
            self.mirror(last);
        }
        let [first, last] = range(&self);
        if !is_near(last - first, 360.0) {
            // Some files leave out the last plane, which is the first one.
            let is_open = last - first > 180.0 && last - first < 360.0;
            if !is_open {
                let problem = format!("the planes are from {first} to {last} degrees");
                let advice = "give planes from 0 to 0, 90, 180 or 360 degrees, or from 90 to 270";
                return Err(Error::new(problem, advice));
            }
            notes.push(format!("added the plane {} degrees, a copy of the first", first + 360.0));
            self.planes.push(first + 360.0);
            self.values.push(self.values[0].clone());
        }
        Ok(self)
    }

    /// Completes the planes of types A and B, of a half of the sphere.
    pub fn mirror_half(mut self) -> Self {
        let count = self.planes.len();
        if count > 1 && is_near(self.planes[0], 0.0) {
            let others = (1..count).rev();
            let planes = others.clone().map(|index| -self.planes[index]);
            let values = others.map(|index| self.values[index].clone());
            self.planes.splice(0..0, planes.collect::<Vec<_>>());
            self.values.splice(0..0, values.collect::<Vec<_>>());
        }
        self
    }

    /// The distribution. In types A and C the planes are azimuths, in type B they are latitudes.
    ///
    /// # Errors
    /// If the angles are not those of a grid. The error names no file.
    pub fn distribution(self, photometry: Photometry) -> Result<IntensityDistribution> {
        let Self { within, planes, values } = self;
        let radians = |angles: &[f64], from: f64| -> Vec<f64> {
            angles.iter().map(|angle| (angle + from).to_radians()).collect()
        };
        let (rows, columns) = (within.len(), planes.len());
        let transposed =
            || (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))).map(|(i, j)| values[j][i]);
        let (polar, azimuth, values) = match photometry {
            Photometry::C => (radians(&within, 0.0), radians(&planes, 0.0), transposed().collect()),
            Photometry::A => {
                (radians(&within, 90.0), radians(&planes, 0.0), transposed().collect())
            }
            Photometry::B => {
                let rows = values.iter().flatten().copied().collect();
                (radians(&planes, 90.0), radians(&within, 0.0), rows)
            }
        };
        IntensityDistribution::new(photometry, polar, azimuth, values).ok_or_else(|| {
            let problem = "the angles do not make a grid on the sphere";
            Error::new(problem, "give at least two angles in each direction, in ascending order")
        })
    }
}
