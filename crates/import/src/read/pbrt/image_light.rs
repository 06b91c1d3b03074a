//! Infinite lights: constant radiance, or a square image by Clarberg's equal-area mapping.

use super::lights::color;
use super::params::Params;
use super::spectra::ColorSpace;
use super::textures::Textures;
use crate::environment;
use crate::look::radiances;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::scene::Environment;
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::{FRAC_PI_4, PI, TAU};

/// Largest width of the map that an image is resampled to, pixels.
const MAX_WIDTH: u32 = 4096;

/// Samples across and down a pixel of the new map.
const SAMPLES: u32 = 3;

/// The environment of an infinite light, in the scene that `to_scene` turns it to.
pub(super) fn environment(
    params: &Params,
    space: ColorSpace,
    to_scene: DMat3,
    film_scale: f32,
    textures: &mut Textures,
) -> Result<Environment> {
    let mut scale = params.float_in("scale", 1.0, [0.0, 1e30])? * f64::from(film_scale);
    let illuminance = params.float_or("illuminance", -1.0)?;
    if params.get("portal").is_some() {
        textures.warnings.skipped("ignored the portal of", "the infinite light");
    }
    let Some(name) = params.text("filename")? else {
        let radiance = color(params, "L", space, textures)?;
        if illuminance > 0.0 {
            scale *= illuminance / PI;
        }
        return Ok(Environment::new(1, 1, vec![scale as f32 * radiance], 0.0));
    };
    let path = textures.find(params, name)?;
    let (width, height, mut pixels) = radiances(&path)?;
    if width != height {
        let problem = format!("the image `{name}` has {width} x {height} pixels and is not square");
        return Err(params.error(problem, "convert it by pbrt's `imgtool makeequiarea`"));
    }
    let invalid = environment::scale_pixels(&mut pixels, Rgb::ONE).len();
    if invalid > 0 {
        let phrase = format!("used 0 for {invalid} pixels that are negative or not finite of");
        textures.warnings.skipped(phrase, name);
    }
    let map = EqualAreaMap { size: width, pixels };
    if illuminance > 0.0 {
        scale *= illuminance / map.upper_illuminance().max(1e-30);
    }
    // The inverse of the rotation; scales have no effect on directions.
    let (columns, rows, made) = map.resampled(to_scene.inverse(), scale as f32);
    if made.iter().any(|pixel| !pixel.is_finite()) {
        return Err(params.error("the radiance is too large", "lower `scale`"));
    }
    Ok(Environment::new(columns, rows, made, 0.0))
}

/// A square image of the sphere, whose +z is in its center.
struct EqualAreaMap {
    size: u32,
    pixels: Vec<Rgb>,
}

impl EqualAreaMap {
    /// Columns, rows and pixels of a map in longitude and latitude, times `scale`. `from_scene`
    /// turns directions of the scene.
    fn resampled(&self, from_scene: DMat3, scale: f32) -> (u32, u32, Vec<Rgb>) {
        let columns = (2 * self.size).min(MAX_WIDTH);
        let rows = columns / 2;
        let radiance = |column: u32, row: u32| {
            let mut sum = Rgb::ZERO;
            for sample in 0..SAMPLES * SAMPLES {
                let part = |i: u32| (f64::from(i) + 0.5) / f64::from(SAMPLES);
                let x = (f64::from(column) + part(sample % SAMPLES)) / f64::from(columns);
                // Equal shares of the solid angle of the row.
                let edge = |row: u32| (PI * f64::from(row) / f64::from(rows)).cos();
                let height = edge(row) + (edge(row + 1) - edge(row)) * part(sample / SAMPLES);
                let across = (1.0 - height * height).max(0.0).sqrt();
                // The middle column is toward -z, and columns continue toward +x.
                let (sin, cos) = (TAU * (x - 0.5)).sin_cos();
                let direction = DVec3::new(across * sin, height, -across * cos);
                sum += self.radiance((from_scene * direction).normalize());
            }
            sum * (scale / (SAMPLES * SAMPLES) as f32)
        };
        let rows_of = |row| (0..columns).map(move |column| (column, row));
        let made = (0..rows).flat_map(rows_of).map(|(column, row)| radiance(column, row));
        (columns, rows, made.collect())
    }

    /// Bilinear interpolation of the four pixels around a direction, across the folded edges of the
    /// octahedron.
    fn radiance(&self, direction: DVec3) -> Rgb {
        let at = square_of(direction) * f64::from(self.size) - DVec2::splat(0.5);
        let low = at.floor();
        let part = (at - low).as_vec2();
        let pixel = |dx: i64, dy: i64| self.pixel(low.x as i64 + dx, low.y as i64 + dy);
        let above = pixel(0, 0).lerp(pixel(1, 0), part.x);
        let below = pixel(0, 1).lerp(pixel(1, 1), part.x);
        above.lerp(below, part.y)
    }

    fn pixel(&self, mut x: i64, mut y: i64) -> Rgb {
        let size = i64::from(self.size);
        // An edge continues at its mirror image.
        if x < 0 || x >= size {
            x = if x < 0 { -x - 1 } else { 2 * size - 1 - x };
            y = size - 1 - y;
        }
        if y < 0 || y >= size {
            y = if y < 0 { -y - 1 } else { 2 * size - 1 - y };
            x = size - 1 - x;
        }
        let [x, y] = [x, y].map(|i| i.clamp(0, size - 1));
        self.pixels[(y * size + x) as usize]
    }

    /// Illuminance of a surface that faces +z, by the luminance of the pixels.
    fn upper_illuminance(&self) -> f64 {
        let size = f64::from(self.size);
        let sum: f64 = self
            .pixels
            .iter()
            .enumerate()
            .map(|(index, pixel)| {
                let (x, y) = (index as u32 % self.size, index as u32 / self.size);
                let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) / size;
                f64::from(luminance(*pixel)) * sphere_of(at).z.max(0.0)
            })
            .sum();
        4.0 * PI * sum / (size * size)
    }
}

/// The direction of a point of the unit square (Clarberg 2008, "Fast equal-area mapping of the
/// (hemi)sphere").
fn sphere_of(at: DVec2) -> DVec3 {
    let p = 2.0 * at - DVec2::ONE;
    let own = p.abs();
    let distance = 1.0 - (own.x + own.y);
    let r = 1.0 - distance.abs();
    let phi = if r == 0.0 { FRAC_PI_4 } else { ((own.y - own.x) / r + 1.0) * FRAC_PI_4 };
    let z = (1.0 - r * r).copysign(distance);
    let across = r * (2.0 - r * r).max(0.0).sqrt();
    DVec3::new((across * phi.cos()).copysign(p.x), (across * phi.sin()).copysign(p.y), z)
}

/// The inverse of [`sphere_of`].
fn square_of(direction: DVec3) -> DVec2 {
    let own = direction.abs();
    let r = (1.0 - own.z).max(0.0).sqrt();
    let phi = if own.x == 0.0 && own.y == 0.0 { 0.0 } else { own.y.atan2(own.x) };
    let v = phi / (2.0 * FRAC_PI_4) * r;
    let mut p = DVec2::new(r - v, v);
    if direction.z < 0.0 {
        p = DVec2::new(1.0 - p.y, 1.0 - p.x);
    }
    let p = DVec2::new(p.x.copysign(direction.x), p.y.copysign(direction.y));
    0.5 * (p + DVec2::ONE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_area_mapping_is_inverted_and_preserves_areas() {
        let n = 512;
        let mut above = [0; 8];
        for index in 0..n * n {
            let part = |i: u32| (f64::from(i) + 0.3) / f64::from(n);
            let at = DVec2::new(part(index % n), part(index / n));
            let direction = sphere_of(at);
            assert!((direction.length() - 1.0).abs() < 1e-12);
            assert!((square_of(direction) - at).length() < 1e-9, "{at}");
            above[(4.0 * (direction.z + 1.0)).min(7.0) as usize] += 1;
        }
        // Equal heights have equal areas.
        let expected = f64::from(n * n) / 8.0;
        assert!(above.iter().all(|count| (f64::from(*count) / expected - 1.0).abs() < 0.01));
        assert!((sphere_of(DVec2::splat(0.5)) - DVec3::Z).length() < 1e-12);
    }

    #[test]
    fn uniform_images_have_the_illuminance_pi() {
        let map = EqualAreaMap { size: 64, pixels: vec![Rgb::ONE; 64 * 64] };
        assert!((map.upper_illuminance() / PI - 1.0).abs() < 1e-3);
        assert_eq!(map.radiance(DVec3::new(0.6, 0.0, -0.8)), Rgb::ONE);
    }
}
