//! Skies with a sun, computed as maps of radiance.
//!
//! All models have a frame with +y up, +x east and -z north.

mod efficacy;
mod hosek_wilkie;
mod luminance_distribution;
mod patches;
mod sun_position;

pub use efficacy::SkyCondition;
pub use hosek_wilkie::{HosekWilkie, LUMINOUS_WIDTH, cone, sun_irradiance};
pub use luminance_distribution::LuminanceDistribution;
pub use patches::SkyPatches;
pub use sun_position::{PlaceAndTime, day_of_year, eccentricity};

use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::{Environment, Inset, InsetGrid};
use glam::{DMat3, DVec3};
use luminance_distribution::horizontal_irradiance;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Half the angle that the sun subtends, radians.
pub const SUN_HALF_ANGLE: f64 = 0.5 * 0.5358 * PI / 180.0;

/// Width of the map, pixels. Under a clear sky 1 % of the directions then differ by more than 1 %
/// from their pixel, all of them within 1.5 degrees of the horizon, where the radiance is steep.
const WIDTH: u32 = 2048;
/// Height of the map, pixels.
const HEIGHT: u32 = WIDTH / 2;
/// Samples of the dome across and down each pixel.
const MAP_SAMPLES: u32 = 2;

/// Pixels of the inset across the sun.
const SUN_PIXELS: f64 = 64.0;
/// Samples of the sun across and down each pixel of the inset.
const INSET_SAMPLES: u32 = 8;
/// Maximum width and height of the inset, pixels.
const MOST_PIXELS: u32 = 2048;

/// Models of the radiance of the sky.
#[derive(Clone, Debug)]
pub enum SkyModel {
    /// That of Hosek and Wilkie.
    HosekWilkie(HosekWilkie),
    /// A distribution of luminance by angles.
    Distribution(LuminanceDistribution),
}

/// The disc of the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunDisc {
    /// Unit vector toward its center.
    pub toward: DVec3,
    /// Half the angle that it subtends, radians, below a right angle.
    pub half_angle: f64,
    /// W/(m^2 sr).
    pub radiance: Rgb,
}

/// A sky.
#[derive(Clone, Debug)]
pub struct Sky {
    /// The model, and a factor of its radiance.
    pub dome: Option<(SkyModel, Rgb)>,
    /// The disc of the sun, if the sky shows it.
    pub sun: Option<SunDisc>,
    /// Radiance from all directions below the horizon, W/(m^2 sr).
    pub ground: Rgb,
}

impl Sky {
    /// Radiance from a unit direction, W/(m^2 sr).
    #[cfg(test)]
    pub fn radiance(&self, direction: DVec3) -> Rgb {
        let is_sun = self.sun.is_some_and(|sun| sun.contains(direction));
        let sun = self.sun.filter(|_| is_sun && direction.y >= 0.0);
        self.dome_radiance(direction) + sun.map_or(Rgb::ZERO, |sun| sun.radiance)
    }

    /// The sky over a ground of this albedo, which reflects the light of the sky and the sun as a
    /// diffuse plane.
    #[must_use]
    pub fn over_ground(self, albedo: Rgb) -> Self {
        let sky = horizontal_irradiance(|direction| self.dome_radiance(direction).as_dvec3());
        let of_sun =
            |sun: SunDisc| sun.radiance.as_dvec3() * cone(sun.half_angle) * sun.toward.y.max(0.0);
        let irradiance = sky + self.sun.map_or(DVec3::ZERO, of_sun);
        Self { ground: albedo * (irradiance / PI).as_vec3(), ..self }
    }

    /// Radiance without the sun from a unit direction, W/(m^2 sr).
    fn dome_radiance(&self, direction: DVec3) -> Rgb {
        if direction.y < 0.0 {
            return self.ground;
        }
        match &self.dome {
            Some((SkyModel::HosekWilkie(model), scale)) => model.radiance(direction) * *scale,
            Some((SkyModel::Distribution(model), scale)) => {
                model.radiance(direction) as f32 * *scale
            }
            None => Rgb::ZERO,
        }
    }

    /// The map of the sky as seen from a scene, whose directions `to_sky` turns or mirrors into the
    /// frame of the sky while +y stays up. The sun is an inset of finer pixels.
    ///
    /// # Errors
    /// If a radiance overflows.
    pub fn environment(&self, to_sky: DMat3, turn_deg: f32) -> Result<Environment> {
        let whole = InsetGrid { first: [0, 0], replaced: [WIDTH, HEIGHT], size: [WIDTH, HEIGHT] };
        let pixels = self.pixels(&whole, None, to_sky);
        let inset = self.sun.map(|sun| {
            let grid = around(&SunDisc { toward: to_sky.transpose() * sun.toward, ..sun });
            Inset { grid, radiance: self.pixels(&grid, Some(sun), to_sky) }
        });
        let finer = inset.iter().flat_map(|inset| &inset.radiance);
        if !pixels.iter().chain(finer).all(|radiance| radiance.is_finite()) {
            let problem = "the radiance of the sky or of its sun overflows";
            return Err(Error::new(
                problem,
                "lower `sky_scale` or `sun_scale`, or the irradiances",
            ));
        }
        Ok(Environment::with_inset(WIDTH, HEIGHT, pixels, turn_deg, inset))
    }

    /// Means of the radiance over the pixels of a grid, W/(m^2 sr). Many samples are taken only
    /// where the edge of the sun crosses a pixel, because the dome is smooth.
    fn pixels(&self, grid: &InsetGrid, sun: Option<SunDisc>, to_sky: DMat3) -> Vec<Rgb> {
        let [width, height] = grid.size;
        let step = [0, 1].map(|i| f64::from(grid.replaced[i]) / f64::from(grid.size[i]));
        let direction = |row: u32, column: u32, [right, down]: [f64; 2]| {
            let x = f64::from(grid.first[0]) + (f64::from(column) + right) * step[0];
            let y = f64::from(grid.first[1]) + (f64::from(row) + down) * step[1];
            to_sky * direction_at([x, y])
        };
        let mean = |row: u32, column: u32, samples: u32, value: &dyn Fn(DVec3) -> DVec3| {
            let shift = |i: u32| (f64::from(i) + 0.5) / f64::from(samples);
            let one =
                |i: u32| value(direction(row, column, [shift(i % samples), shift(i / samples)]));
            (0..samples * samples).map(one).sum::<DVec3>() / f64::from(samples * samples)
        };
        let dome = |direction: DVec3| self.dome_radiance(direction).as_dvec3();
        let pixel = |row: u32, column: u32| {
            let mut sum = mean(row, column, MAP_SAMPLES, &dome);
            if let Some(sun) = sun.filter(|_| self.may_meet(row, column, &direction)) {
                let own = |direction: DVec3| {
                    let is_sun = direction.y >= 0.0 && sun.contains(direction);
                    if is_sun { sun.radiance.as_dvec3() } else { DVec3::ZERO }
                };
                sum += mean(row, column, INSET_SAMPLES, &own);
            }
            sum.as_vec3()
        };
        let rows = (0..height).into_par_iter();
        rows.flat_map_iter(|row| (0..width).map(move |column| (row, column)))
            .map(|(row, column)| pixel(row, column))
            .collect()
    }

    /// Whether the sun may cover a part of a pixel: the ball around its center that holds its
    /// corners meets the disc.
    fn may_meet(
        &self,
        row: u32,
        column: u32,
        direction: &dyn Fn(u32, u32, [f64; 2]) -> DVec3,
    ) -> bool {
        let center = direction(row, column, [0.5, 0.5]);
        let corners = [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]];
        let reach = corners.map(|at| direction(row, column, at).distance(center));
        let reach = 1.01 * reach.into_iter().fold(0.0, f64::max);
        self.sun.is_some_and(|sun| center.distance(sun.toward) <= sun.chord() + reach)
    }
}

impl SunDisc {
    /// Distance of the edge from the center on the unit sphere.
    fn chord(&self) -> f64 {
        2.0 * (0.5 * self.half_angle).sin()
    }

    /// Whether it covers a unit direction.
    fn contains(&self, direction: DVec3) -> bool {
        // Distances are exact for small angles, cosines are not.
        direction.distance(self.toward) <= self.chord()
    }
}

/// Unit direction of a position in the map, columns and rows.
fn direction_at([x, y]: [f64; 2]) -> DVec3 {
    let (sin, cos) = (TAU * (x / f64::from(WIDTH) - 0.5)).sin_cos();
    let (across, up) = (PI * y / f64::from(HEIGHT)).sin_cos();
    DVec3::new(across * sin, up, -across * cos)
}

/// A rectangle of the map that contains the sun, with its own pixels.
fn around(sun: &SunDisc) -> InsetGrid {
    let polar = sun.toward.y.clamp(-1.0, 1.0).acos();
    let edges = [polar - sun.half_angle, polar + sun.half_angle];
    let rows_per_radian = f64::from(HEIGHT) / PI;
    let top = (edges[0].max(0.0) * rows_per_radian).floor() as u32;
    let bottom = ((edges[1] * rows_per_radian).ceil() as u32).clamp(top + 1, HEIGHT);
    let has_pole = edges[0] <= 0.0 || edges[1] >= PI;
    // The tangent planes of the disc that contain the vertical.
    let aside = if has_pole { PI } else { (sun.half_angle.sin() / polar.sin()).min(1.0).asin() };
    let columns_per_radian = f64::from(WIDTH) / TAU;
    let middle = (sun.toward.x.atan2(-sun.toward.z) + PI) * columns_per_radian;
    let left = (middle - aside * columns_per_radian).floor();
    let right = (middle + aside * columns_per_radian).ceil();
    let columns = ((right - left) as u32).clamp(1, WIDTH);
    let first = if columns == WIDTH { 0 } else { left.rem_euclid(f64::from(WIDTH)) as u32 };
    let rows = bottom - top;
    let fineness = SUN_PIXELS / (2.0 * sun.half_angle);
    let widest = if has_pole { sun.half_angle.sin() } else { polar.sin() };
    let width = f64::from(columns) / columns_per_radian * widest * fineness;
    let height = f64::from(rows) / rows_per_radian * fineness;
    let pixels = |wanted: f64, least: u32| (wanted.ceil() as u32).clamp(least, MOST_PIXELS);
    let size = [pixels(width, columns.min(MOST_PIXELS)), pixels(height, rows.min(MOST_PIXELS))];
    InsetGrid { first: [first, top], replaced: [columns, rows], size }
}

#[cfg(test)]
mod tests;
