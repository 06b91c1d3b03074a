//! The environment: a map of radiance over directions, importance sampled.

use super::cutpoints::{Choice, Cutpoints, Outcome, UNITS, interval_ends};
use super::{Emission, LightSample, below_one};
use crate::base::math::{Bounds, Rgb, luminance, uniform_disc, uniform_disc_inverse};
use crate::base::rng::Rng;
use glam::{DVec3, Vec3};
use std::f32::consts::{PI, TAU};

/// Radiance that arrives from each direction, uniform in each pixel of a latitude-longitude map. The first row is
/// around +y, the last row around -y. The middle column is toward -z, and columns continue toward +x.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    width: u32,
    height: u32,
    /// Row by row.
    pixels: Vec<Pixel>,
    rows: Vec<Row>,
    row_cutpoints: Cutpoints,
    /// Cutpoints for the pixels of each row.
    column_cutpoints: Cutpoints,
    /// Rotation about +y, in full turns; counterclockwise seen from +y.
    turn: f32,
    /// Integral of the radiance over all directions, W/m^2.
    integral: Rgb,
    /// Center and radius of a sphere around the scene.
    center: Vec3,
    radius: f32,
}

/// Regions of a map across and down: equal intervals of the numbers that sample it, hence of equal power.
const REGIONS_ACROSS: usize = 8;

/// Number of regions of a map.
pub(super) const REGIONS: usize = REGIONS_ACROSS * REGIONS_ACROSS;

/// A pixel of the map. A sample reads all of it at once: maps are larger than the caches.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(16))]
struct Pixel {
    /// W/(m^2 sr).
    radiance: Rgb,
    /// Upper end of the interval in the choice among the pixels of the row, units.
    end: u32,
}

/// The environment in one direction.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    /// Radiance that arrives, W/(m^2 sr).
    pub radiance: Rgb,
    /// Density in solid angle with which light paths, and connections without learned visibility, choose the
    /// direction, 1/sr.
    pub pdf_w: f32,
    /// Region of the direction.
    pub region: usize,
}

/// Position of a direction in the map.
struct Location {
    row: usize,
    /// Index of the first pixel of the row.
    first: usize,
    column: usize,
    /// Position across the pixel, in [0, 1].
    across: f32,
}

/// A row of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Row {
    /// Upper end of the interval in the choice among the rows, units.
    end: u32,
    /// Cosines of the angles between +y and the upper and lower edge.
    edges: [f32; 2],
    /// The reciprocal of the density in solid angle of a pixel's directions, sr, times the pixel's units. Infinite for
    /// a row without light.
    inverse_pdf_w: f32,
}

impl Outcome for Pixel {
    #[inline]
    fn end(&self) -> u32 {
        self.end
    }
}

impl Outcome for Row {
    #[inline]
    fn end(&self) -> u32 {
        self.end
    }
}

impl Environment {
    /// An environment of `radiance`, W/(m^2 sr), row by row, rotated by `turn_deg` about +y.
    ///
    /// # Panics
    /// If the number of pixels is not `width * height`, or one is negative or not finite.
    pub fn new(width: u32, height: u32, radiance: Vec<Rgb>, turn_deg: f32) -> Self {
        assert_eq!(radiance.len(), width as usize * height as usize);
        assert!(radiance.iter().all(|r| r.is_finite() && r.min_element() >= 0.0));
        let mut environment = Self {
            width,
            height,
            pixels: Vec::with_capacity(radiance.len()),
            rows: Vec::with_capacity(height as usize),
            row_cutpoints: Cutpoints::new(height as usize),
            column_cutpoints: Cutpoints::new(width as usize),
            turn: turn_deg / 360.0,
            integral: Rgb::ZERO,
            center: Vec3::ZERO,
            radius: 0.0,
        };
        let rows = radiance.chunks_exact(width as usize).zip(0..);
        let (fluxes, weights): (Vec<DVec3>, Vec<f64>) =
            rows.map(|(radiance, row)| environment.add_pixels(radiance, row)).unzip();
        environment.add_rows(&weights);
        environment.integral = fluxes.iter().sum::<DVec3>().as_vec3();
        environment
    }

    /// Adds the pixels of a row. Returns the integral of their radiance over the solid angle, W/m^2, and its luminance.
    fn add_pixels(&mut self, radiance: &[Rgb], row: u32) -> (DVec3, f64) {
        let solid_angle = f64::from(self.solid_angle(row));
        let weights = radiance.iter().map(|one| f64::from(luminance(*one)));
        let weights: Vec<f64> = weights.collect();
        let pixels = radiance.iter().zip(interval_ends(&weights));
        let first = self.pixels.len();
        self.pixels.extend(pixels.map(|(&radiance, end)| Pixel { radiance, end }));
        self.column_cutpoints.add(&self.pixels[first..]);
        let sum: DVec3 = radiance.iter().map(|one| one.as_dvec3()).sum();
        (sum * solid_angle, weights.iter().sum::<f64>() * solid_angle)
    }

    /// Adds all rows, which are chosen in proportion to `weights`.
    fn add_rows(&mut self, weights: &[f64]) {
        let mut begin = 0;
        for (row, end) in (0..).zip(interval_ends(weights)) {
            let prob = f64::from(end - begin) / f64::from(UNITS);
            let inverse_pdf_w = f64::from(self.solid_angle(row)) * f64::from(UNITS) / prob;
            let step = PI / self.height as f32;
            let edges = [row, row + 1].map(|row| (row as f32 * step).cos());
            self.rows.push(Row { end, edges, inverse_pdf_w: inverse_pdf_w as f32 });
            begin = end;
        }
        self.row_cutpoints.add(&self.rows);
    }

    /// Sets the sphere to one around `bounds`.
    pub(in crate::scene) fn enclose(&mut self, bounds: &Bounds) {
        self.center = bounds.center();
        self.radius = bounds.enclosing_radius();
    }

    /// Returns true if it emits no light.
    pub fn is_black(&self) -> bool {
        luminance(self.integral) <= 0.0
    }

    /// Integral of the radiance over all directions, W/m^2.
    pub fn integral(&self) -> Rgb {
        self.integral
    }

    /// Radiant power that meets the sphere around the scene, W.
    pub fn power(&self) -> Rgb {
        self.disc() * self.integral
    }

    /// Width and height, pixels.
    pub(crate) fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// The radiance of each pixel, W/(m^2 sr), row by row.
    pub(crate) fn pixels(&self) -> impl ExactSizeIterator<Item = Rgb> {
        self.pixels.iter().map(|pixel| pixel.radiance)
    }

    /// Rotation about +y, in full turns; counterclockwise seen from +y.
    pub(crate) fn turn(&self) -> f32 {
        self.turn
    }

    fn disc(&self) -> f32 {
        PI * self.radius * self.radius
    }

    /// Solid angle of a pixel in this row, sr.
    /// theory.md (15).
    fn solid_angle(&self, row: u32) -> f32 {
        // cos(a) - cos(b) without cancellation.
        let step = PI / self.height as f32;
        let middle = (row as f32 + 0.5) * step;
        TAU / self.width as f32 * 2.0 * middle.sin() * (0.5 * step).sin()
    }

    /// The pixel in a unit direction.
    #[inline]
    fn locate(&self, direction: Vec3) -> Location {
        let longitude = direction.x.atan2(-direction.z) / TAU + 0.5 + self.turn;
        let latitude = direction.y.clamp(-1.0, 1.0).acos() / PI;
        let index = |share: f32, count: u32| ((share * count as f32) as u32).min(count - 1);
        let around = longitude - longitude.floor();
        let column = index(around, self.width) as usize;
        let row = index(latitude, self.height) as usize;
        let across = around * self.width as f32 - column as f32;
        Location { row, first: row * self.width as usize, column, across }
    }

    /// Unit at which the interval of a pixel in the choice among those of its row begins.
    #[inline]
    fn begin(&self, at: &Location) -> u32 {
        if at.column == 0 { 0 } else { self.pixels[at.first + at.column - 1].end }
    }

    /// Radiance that arrives from a unit direction, W/(m^2 sr).
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        let at = self.locate(direction);
        self.pixels[at.first + at.column].radiance
    }

    /// The environment in a unit direction.
    /// theory.md (15).
    pub fn sight(&self, direction: Vec3) -> Sight {
        let at = self.locate(direction);
        let (pixel, begin) = (&self.pixels[at.first + at.column], self.begin(&at));
        let pdf_w = (pixel.end - begin) as f32 / self.rows[at.row].inverse_pdf_w;
        Sight { radiance: pixel.radiance, pdf_w, region: self.region_at(&at, direction) }
    }

    /// Region of a unit direction.
    pub(super) fn region(&self, direction: Vec3) -> usize {
        self.region_at(&self.locate(direction), direction)
    }

    fn region_at(&self, at: &Location, direction: Vec3) -> usize {
        let cell = |share: f64| ((share * REGIONS_ACROSS as f64) as usize).min(REGIONS_ACROSS - 1);
        let [u, v] = self.numbers_at(at, direction).map(cell);
        v * REGIONS_ACROSS + u
    }

    /// Inverse of [`Self::sample`]: the numbers that give a direction.
    fn numbers_at(&self, at: &Location, direction: Vec3) -> [f64; 2] {
        let begin_of_row = if at.row == 0 { 0 } else { self.rows[at.row - 1].end };
        let Row { end, edges: [upper, lower], .. } = self.rows[at.row];
        let down = (direction.y - upper) / (lower - upper);
        let number = |begin: u32, end: u32, rest: f32| {
            let units = f64::from(end - begin) * f64::from(rest.clamp(0.0, 1.0));
            (f64::from(begin) + units) / f64::from(UNITS)
        };
        let end_of_pixel = self.pixels[at.first + at.column].end;
        [number(self.begin(at), end_of_pixel, at.across), number(begin_of_row, end, down)]
    }

    /// A direction in proportion to the luminance, from two uniform numbers: latitude and longitude increase with
    /// them. Also returns the radiance from there over the density, W/m^2, and one over the density, sr.
    /// theory.md (15).
    fn sample(&self, [u, v]: [f64; 2]) -> (Vec3, Rgb, f32) {
        let Choice { index: row, rest: v, .. } = self.row_cutpoints.choose(0, &self.rows, v);
        let Row { edges: [above, below], inverse_pdf_w, .. } = self.rows[row];
        let pixels = &self.pixels[row * self.width as usize..][..self.width as usize];
        let Choice { index: column, units, rest: u } = self.column_cutpoints.choose(row, pixels, u);
        // Uniform in solid angle: in longitude and in the cosine.
        let y = above + v as f32 * (below - above);
        let longitude = TAU * ((column as f32 + u as f32) / self.width as f32 - 0.5 - self.turn);
        let across = (1.0 - y * y).max(0.0).sqrt();
        let (sin, cos) = longitude.sin_cos();
        let direction = Vec3::new(across * sin, y, -across * cos);
        let inverse_pdf_w = inverse_pdf_w / units as f32;
        (direction, pixels[column].radiance * inverse_pdf_w, inverse_pdf_w)
    }

    /// Starts a light path from four uniform numbers; the environment was chosen with probability `prob`.
    pub(super) fn emit(&self, prob: f32, [a, b, c, d]: [f64; 4]) -> Emission {
        let (toward, radiance, _) = self.sample([a, b]);
        let [u, v] = uniform_disc([c, d].map(below_one));
        let (right, up) = toward.any_orthonormal_pair();
        let origin = self.center + self.radius * (u * right + v * up + toward);
        Emission { origin, direction: -toward, flux: radiance * (self.disc() / prob) }
    }

    /// Inverse of [`Self::emit`]: the numbers that give a light path along the ray through `point`.
    pub(super) fn emission_numbers(&self, point: Vec3, direction: Vec3) -> [f64; 4] {
        let toward = -direction;
        let [a, b] = self.numbers_at(&self.locate(toward), toward);
        let (right, up) = toward.any_orthonormal_pair();
        let across = (point - self.center) / self.radius;
        let [c, d] = uniform_disc_inverse([right, up].map(|axis| axis.dot(across))).map(f64::from);
        [a, b, c, d]
    }

    /// A direction to connect `position` with; the environment was chosen with probability `prob`.
    pub(super) fn connect(&self, position: Vec3, prob: f32, rng: &mut Rng) -> LightSample {
        self.connect_from([rng.next_f64(), rng.next_f64()], position, prob)
    }

    /// A direction of a region to connect `position` with. `prob` is the density of the choice of the environment and
    /// the region, relative to that of regions in proportion to their power.
    pub(super) fn connect_in(
        &self,
        region: usize,
        position: Vec3,
        prob: f32,
        rng: &mut Rng,
    ) -> LightSample {
        let corner = [region % REGIONS_ACROSS, region / REGIONS_ACROSS];
        let at = corner.map(|corner| (corner as f64 + rng.next_f64()) / REGIONS_ACROSS as f64);
        self.connect_from(at, position, prob)
    }

    fn connect_from(&self, at: [f64; 2], position: Vec3, prob: f32) -> LightSample {
        let (wi, irradiance, inverse_pdf_w) = self.sample(at);
        // Outside the sphere around the scene, for any position in it.
        let distance = 2.0 * self.radius + (position - self.center).length();
        LightSample {
            target: position + distance * wi,
            wi,
            irradiance: irradiance / prob,
            relative: 1.0,
            inverse_pdf_w: inverse_pdf_w / prob,
        }
    }
}

#[cfg(test)]
mod tests;
