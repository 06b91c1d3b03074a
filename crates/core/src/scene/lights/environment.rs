//! The environment: a map of radiance over directions, importance sampled.

mod latitudes;
mod sample;

use super::Emission;
use super::cutpoints::{Cutpoints, Outcome, UNITS, interval_ends};
use super::enclosure::Enclosure;
use crate::base::math::{Bounds, Rgb, luminance};
use glam::{DVec3, Vec3};
use sample::EnvironmentSample;
use serde::Serialize;
use std::f32::consts::{PI, TAU};

/// Radiance that arrives from each direction, uniform in each pixel of a latitude-longitude map.
/// The first row is around +y, the last row around -y. The middle column is toward -z, and columns
/// continue toward +x. A finer map, the [`Inset`], may replace a rectangle of pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    width: u32,
    height: u32,
    /// Row by row; those of the inset are last.
    pixels: Vec<Pixel>,
    /// Rows of the map, then those of the inset.
    rows: Vec<Row>,
    row_cutpoints: Cutpoints,
    /// Cutpoints for the pixels of each row.
    column_cutpoints: Cutpoints,
    /// Position of the inset.
    inset: Option<InsetGrid>,
    /// Cutpoints for the pixels of each row of the inset.
    inset_cutpoints: Cutpoints,
    /// Rotation about +y, in full turns; counterclockwise seen from +y.
    turn: f32,
    /// Integral of the radiance over all directions, W/m^2.
    integral: Rgb,
    /// The space around the scene.
    enclosure: Enclosure,
}

/// A finer map in place of a rectangle of pixels, such as the sun in a sky.
#[derive(Clone, Debug, PartialEq)]
pub struct Inset {
    /// Its place in the map.
    pub grid: InsetGrid,
    /// Radiance of its pixels, W/(m^2 sr), row by row. They divide the rectangle equally in
    /// latitude and longitude.
    pub radiance: Vec<Rgb>,
}

/// Place of an inset in its map. The rectangle may cross the edge between the last and the first
/// column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct InsetGrid {
    /// First column and first row of the map that it replaces.
    pub first: [u32; 2],
    /// Number of columns and rows of the map that it replaces, each at least 1.
    pub replaced: [u32; 2],
    /// Width and height of the inset, pixels.
    pub size: [u32; 2],
}

impl InsetGrid {
    /// Returns true if it lies in a map of this size, and has pixels.
    pub fn fits(&self, [width, height]: [u32; 2]) -> bool {
        let Self { first, replaced, size } = *self;
        let rows = u64::from(first[1]) + u64::from(replaced[1]);
        let is_inside = first[0] < width && replaced[0] <= width && rows <= u64::from(height);
        is_inside && replaced.iter().chain(&size).all(|&count| count > 0)
    }
}

/// Regions of a map across and down: equal intervals of the numbers that sample it, hence of equal
/// power.
pub(super) const REGIONS_ACROSS: usize = 16;

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
    /// Density in solid angle with which light paths, and connections without learned visibility,
    /// choose the direction, 1/sr.
    pub pdf_w: f32,
    /// Region of the direction.
    pub region: usize,
}

/// Position of a direction in the map.
struct Location {
    /// Index in [`Environment::rows`].
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
    /// The reciprocal of the density in solid angle of a pixel's directions, sr, times the pixel's
    /// units. Infinite for a row without light.
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
        Self::with_inset(width, height, radiance, turn_deg, None)
    }

    /// [`Self::new`] with an inset, which replaces the radiance of the map in its rectangle.
    ///
    /// # Panics
    /// If a number of pixels does not match its size, a radiance is negative or not finite, or the
    /// inset does not fit ([`InsetGrid::fits`]).
    pub fn with_inset(
        width: u32,
        height: u32,
        mut radiance: Vec<Rgb>,
        turn_deg: f32,
        inset: Option<Inset>,
    ) -> Self {
        assert_eq!(radiance.len(), width as usize * height as usize);
        if let Some(Inset { grid, radiance: finer }) = &inset {
            assert!(grid.fits([width, height]));
            assert_eq!(finer.len(), grid.size[0] as usize * grid.size[1] as usize);
            for row in grid.first[1]..grid.first[1] + grid.replaced[1] {
                for across in 0..grid.replaced[0] {
                    let column = (grid.first[0] + across) % width;
                    radiance[row as usize * width as usize + column as usize] = Rgb::ZERO;
                }
            }
        }
        let finer = inset.iter().flat_map(|inset| &inset.radiance);
        assert!(radiance.iter().chain(finer).all(|r| r.is_finite() && r.min_element() >= 0.0));
        let grid = inset.as_ref().map(|inset| inset.grid);
        let [inset_width, inset_height] = grid.map_or([1, 0], |grid| grid.size);
        let mut environment = Self {
            width,
            height,
            pixels: Vec::with_capacity(radiance.len()),
            rows: Vec::with_capacity((height + inset_height) as usize),
            row_cutpoints: Cutpoints::new((height + inset_height) as usize),
            column_cutpoints: Cutpoints::new(width as usize),
            inset: grid,
            inset_cutpoints: Cutpoints::new(inset_width as usize),
            turn: turn_deg / 360.0,
            integral: Rgb::ZERO,
            enclosure: Enclosure::default(),
        };
        let finer = inset.map_or(Vec::new(), |inset| inset.radiance);
        let rows = radiance.chunks_exact(width as usize);
        let rows = rows.chain(finer.chunks_exact(inset_width as usize)).zip(0..);
        let (fluxes, weights): (Vec<DVec3>, Vec<f64>) =
            rows.map(|(radiance, row)| environment.add_pixels(radiance, row)).unzip();
        environment.add_rows(&weights);
        environment.integral = fluxes.iter().sum::<DVec3>().as_vec3();
        environment
    }

    /// Adds the pixels of a row. Returns the integral of their radiance over the solid angle,
    /// W/m^2, and its luminance.
    fn add_pixels(&mut self, radiance: &[Rgb], row: u32) -> (DVec3, f64) {
        let solid_angle = f64::from(self.solid_angle(row));
        let weights = radiance.iter().map(|one| f64::from(luminance(*one)));
        let weights: Vec<f64> = weights.collect();
        let pixels = radiance.iter().zip(interval_ends(&weights));
        let first = self.pixels.len();
        self.pixels.extend(pixels.map(|(&radiance, end)| Pixel { radiance, end }));
        let in_map = row < self.height;
        let cutpoints = if in_map { &mut self.column_cutpoints } else { &mut self.inset_cutpoints };
        cutpoints.add(&self.pixels[first..]);
        let sum: DVec3 = radiance.iter().map(|one| one.as_dvec3()).sum();
        (sum * solid_angle, weights.iter().sum::<f64>() * solid_angle)
    }

    /// Adds all rows, which are chosen in proportion to `weights`.
    fn add_rows(&mut self, weights: &[f64]) {
        let mut begin = 0;
        for (row, end) in (0..).zip(interval_ends(weights)) {
            let prob = f64::from(end - begin) / f64::from(UNITS);
            let inverse_pdf_w = f64::from(self.solid_angle(row)) * f64::from(UNITS) / prob;
            let edges = [0.0, 1.0].map(|down| self.polar_angle(row, down).cos());
            self.rows.push(Row { end, edges, inverse_pdf_w: inverse_pdf_w as f32 });
            begin = end;
        }
        self.row_cutpoints.add(&self.rows);
    }

    /// Sets the sphere to one around `bounds`.
    pub(in crate::scene) fn enclose(&mut self, bounds: &Bounds) {
        self.enclosure = Enclosure::new(bounds);
    }

    /// Returns true if it emits no light.
    pub fn is_black(&self) -> bool {
        luminance(self.integral) <= 0.0
    }

    /// Integral of the radiance over all directions, W/m^2.
    pub fn integral(&self) -> Rgb {
        self.integral
    }

    /// Solid angle that the light seems to come from, sr: that of a uniform light of the same
    /// integral of the luminance and of its square. About `4 pi` for an even sky, and less than
    /// `1e-3` if a large share is that of a sun; 0 for a black map.
    pub fn effective_solid_angle(&self) -> f64 {
        let inset_width = self.inset.map_or(1, |inset| inset.size[0]) as usize;
        let (map, inset) = self.pixels.split_at(self.width as usize * self.height as usize);
        let rows = map.chunks_exact(self.width as usize).chain(inset.chunks_exact(inset_width));
        let (mut integral, mut of_squares) = (0.0, 0.0);
        for (pixels, row) in rows.zip(0..) {
            let solid_angle = f64::from(self.solid_angle(row));
            for pixel in pixels {
                let luminance = f64::from(luminance(pixel.radiance));
                integral += solid_angle * luminance;
                of_squares += solid_angle * luminance * luminance;
            }
        }
        if of_squares > 0.0 { integral * integral / of_squares } else { 0.0 }
    }

    /// Radiant power that meets the sphere around the scene, W.
    pub fn power(&self) -> Rgb {
        self.disc() * self.integral
    }

    /// Width and height, pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// The radiance of each pixel, W/(m^2 sr), row by row; 0 under the inset.
    pub fn pixels(&self) -> impl ExactSizeIterator<Item = Rgb> {
        let count = self.width as usize * self.height as usize;
        self.pixels[..count].iter().map(|pixel| pixel.radiance)
    }

    /// The inset's place, and the radiance of each of its pixels, W/(m^2 sr), row by row.
    pub fn inset(&self) -> Option<(InsetGrid, impl ExactSizeIterator<Item = Rgb>)> {
        let first = self.width as usize * self.height as usize;
        self.inset.map(|grid| (grid, self.pixels[first..].iter().map(|pixel| pixel.radiance)))
    }

    /// Rotation about +y, in full turns; counterclockwise seen from +y.
    pub fn turn(&self) -> f32 {
        self.turn
    }

    fn disc(&self) -> f32 {
        self.enclosure.disc()
    }

    /// Angle between +y and the position `down` in a row, from 0 at its upper edge to 1, radians.
    fn polar_angle(&self, row: u32, down: f32) -> f32 {
        let step = PI / self.height as f32;
        match self.inset {
            Some(grid) if row >= self.height => {
                let own = step * grid.replaced[1] as f32 / grid.size[1] as f32;
                grid.first[1] as f32 * step + ((row - self.height) as f32 + down) * own
            }
            _ => (row as f32 + down) * step,
        }
    }

    /// First longitude of a row, in full turns from the map's first column, and the number of its
    /// pixels in a full turn.
    #[inline]
    fn longitudes(&self, row: usize) -> [f32; 2] {
        let width = self.width as f32;
        match self.inset {
            Some(grid) if row >= self.height as usize => {
                let pixels = width * grid.size[0] as f32 / grid.replaced[0] as f32;
                [grid.first[0] as f32 / width, pixels]
            }
            _ => [0.0, width],
        }
    }

    /// Solid angle of a pixel in this row, sr.
    /// theory.md (15).
    fn solid_angle(&self, row: u32) -> f32 {
        // cos(a) - cos(b) without cancellation.
        let step = match self.inset {
            Some(grid) if row >= self.height => grid.replaced[1] as f32 / grid.size[1] as f32,
            _ => 1.0,
        } * (PI / self.height as f32);
        let [_, pixels] = self.longitudes(row as usize);
        TAU / pixels * 2.0 * self.polar_angle(row, 0.5).sin() * (0.5 * step).sin()
    }

    /// The pixel in a unit direction.
    #[inline]
    fn locate(&self, direction: Vec3) -> Location {
        let longitude = direction.x.atan2(-direction.z) / TAU + 0.5 + self.turn;
        let latitude = direction.y.clamp(-1.0, 1.0).acos() / PI;
        let index = |position: f32, count: u32| (position as u32).min(count - 1);
        let x = (longitude - longitude.floor()) * self.width as f32;
        let y = latitude * self.height as f32;
        let (column, row) = (index(x, self.width), index(y, self.height));
        if let Some(grid) = self.inset {
            let beyond = column + self.width - grid.first[0];
            let [column, row] = [beyond % self.width, row.wrapping_sub(grid.first[1])];
            if column < grid.replaced[0] && row < grid.replaced[1] {
                return self.locate_in(&grid, x, y);
            }
        }
        let first = row as usize * self.width as usize;
        let across = x - column as f32;
        Location { row: row as usize, first, column: column as usize, across }
    }

    /// The pixel of the inset at a position in the map, pixels.
    fn locate_in(&self, grid: &InsetGrid, x: f32, y: f32) -> Location {
        let [width, height] = grid.size;
        let right = x - grid.first[0] as f32;
        let right = if right < 0.0 { right + self.width as f32 } else { right };
        let down = y - grid.first[1] as f32;
        let x = right / grid.replaced[0] as f32 * width as f32;
        let y = down / grid.replaced[1] as f32 * height as f32;
        let (column, row) = ((x as u32).min(width - 1), (y as u32).min(height - 1));
        let map = self.width as usize * self.height as usize;
        Location {
            row: (self.height + row) as usize,
            first: map + row as usize * width as usize,
            column: column as usize,
            across: x - column as f32,
        }
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

    /// Starts a light path from four uniform numbers; the environment was chosen with probability
    /// `prob`.
    pub(super) fn emit(&self, prob: f32, [a, b, c, d]: [f64; 4]) -> Emission {
        let EnvironmentSample { direction: toward, irradiance, .. } = self.sample([a, b]);
        let origin = self.enclosure.start(toward, [c, d]);
        Emission { origin, direction: -toward, flux: irradiance * (self.disc() / prob) }
    }

    /// Inverse of [`Self::emit`]: the numbers that give a light path along the ray through `point`.
    pub(super) fn emission_numbers(&self, point: Vec3, direction: Vec3) -> [f64; 4] {
        let toward = -direction;
        let [a, b] = self.numbers_at(&self.locate(toward), toward);
        let [c, d] = self.enclosure.numbers(toward, point);
        [a, b, c, d]
    }
}

#[cfg(test)]
mod tests;
