//! Light from far away: `source`, with the skies of `gensky` and `gendaylit`.

use super::materials::{Definition, Materials, emitted};
use super::tokens::Primitive;
use crate::warnings::GroupedWarnings;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::{Directional, Emitter, Environment};
use glam::{DAffine3, DVec3, Vec3};
use std::f64::consts::PI;
use std::rc::Rc;

/// Width of the map of the sky, pixels; half of it is the height.
const WIDTH: u32 = 1024;

/// Largest angle of a sun, degrees. Its light is parallel.
const SUN_DEGREES: f64 = 5.0;

/// The sources of a scene.
#[derive(Default)]
pub struct Sky {
    /// Small sources, as parallel light.
    pub suns: Vec<Emitter>,
    domes: Vec<Dome>,
}

/// A part of the sky or the ground.
struct Dome {
    toward: DVec3,
    /// Cosine of half of its angle.
    cos: f64,
    radiance: Rgb,
    brightness: Brightness,
    /// From the scene to the coordinates of the file.
    to_file: DAffine3,
}

/// A factor of the radiance that depends on the direction.
enum Brightness {
    Uniform,
    /// `skybright.cal`, with its numbers.
    Cie(Vec<f64>),
    /// `perezlum.cal`, with its numbers.
    Perez([f64; 10]),
}

impl Sky {
    /// Takes a `source`.
    ///
    /// # Errors
    /// If its material is not defined, or its numbers are not those of a source.
    pub fn add(
        &mut self,
        own: &Primitive,
        modifier: &str,
        materials: &Materials,
        map: DAffine3,
        warnings: &mut GroupedWarnings,
    ) -> Result<()> {
        let [x, y, z, degrees] = own.exactly()?;
        let toward = map.transform_vector3(DVec3::new(x, y, z)).try_normalize();
        let toward = toward.filter(|_| degrees > 0.0 && degrees <= 360.0).ok_or_else(|| {
            own.error("has no direction or no angle", "give a vector and an angle of 1e-3 to 360")
        })?;
        let (material, patterns) = materials.resolve(modifier)?;
        let Primitive { kind, name, .. } = &material.primitive;
        if !matches!(&kind[..], "light" | "glow" | "illum" | "spotlight") {
            warnings.skipped("left out the sources that do not emit:", &own.name);
            return Ok(());
        }
        let [r, g, b] = material.primitive.at_least()?;
        let radiance = emitted([r, g, b].map(|own| own.max(0.0)));
        let half = 0.5 * degrees.to_radians();
        if degrees <= SUN_DEGREES {
            let irradiance = radiance * (PI * half.sin().powi(2)) as f32;
            if irradiance != Rgb::ZERO {
                warnings.chosen("parallel light, without a disc, of", &own.name);
                let direction = -toward.as_vec3();
                self.suns.push(Emitter::Directional(Directional::new(direction, irradiance)));
            }
            return Ok(());
        }
        let brightness = match patterns.iter().find_map(brightness) {
            Some(own) => own,
            None => {
                if !patterns.is_empty() {
                    warnings.skipped("ignored the patterns of the sky", name);
                }
                Brightness::Uniform
            }
        };
        let to_file = map.inverse();
        self.domes.push(Dome { toward, cos: half.cos(), radiance, brightness, to_file });
        Ok(())
    }

    /// The map of all large sources.
    pub fn environment(&self) -> Option<Environment> {
        if self.domes.is_empty() {
            return None;
        }
        let (width, height) = (WIDTH, WIDTH / 2);
        let pixel = |index: u32| {
            let (column, row) = (index % width, index / width);
            let polar = (f64::from(row) + 0.5) / f64::from(height) * PI;
            let turn = ((f64::from(column) + 0.5) / f64::from(width) - 0.5) * 2.0 * PI;
            let (sin, cos) = polar.sin_cos();
            let direction = DVec3::new(sin * turn.sin(), cos, -sin * turn.cos());
            self.domes.iter().map(|dome| dome.seen(direction)).sum::<Vec3>()
        };
        let pixels = (0..width * height).map(pixel).collect();
        Some(Environment::new(width, height, pixels, 0.0))
    }
}

impl Dome {
    /// Radiance from a direction, W/(m^2 sr).
    fn seen(&self, direction: DVec3) -> Rgb {
        if direction.dot(self.toward) < self.cos {
            return Rgb::ZERO;
        }
        let in_file = self.to_file.transform_vector3(direction).normalize();
        self.radiance * self.brightness.at(in_file).max(0.0) as f32
    }
}

/// The sky of a pattern.
fn brightness(pattern: &Rc<Definition>) -> Option<Brightness> {
    let Primitive { kind, words, numbers, .. } = &pattern.primitive;
    if kind != "brightfunc" {
        return None;
    }
    match &words.get(1)?[..] {
        "skybright.cal" if numbers.len() >= 3 => Some(Brightness::Cie(numbers.clone())),
        "perezlum.cal" => Some(Brightness::Perez(numbers[..].try_into().ok()?)),
        _ => None,
    }
}

/// Where the sky meets the ground, both count by steep weights.
fn over_ground(z: f64, sky: f64, ground: f64) -> f64 {
    let [up, down] = [(z + 1.01).powi(10), (z + 1.01).powi(-10)];
    (up * sky + down * ground) / (up + down)
}

impl Brightness {
    /// The factor in a unit direction, with +z up.
    fn at(&self, toward: DVec3) -> f64 {
        let z = toward.z;
        match self {
            Self::Uniform => 1.0,
            Self::Cie(numbers) => {
                let [zenith, ground] = [numbers[1], numbers[2]];
                let norm = numbers.get(3).copied().unwrap_or(1.0);
                let at = |index: usize| numbers.get(index).copied().unwrap_or(0.0);
                let sun = DVec3::new(at(4), at(5), at(6)).normalize_or(DVec3::Z);
                let cos = toward.dot(sun).clamp(-1.0, 1.0);
                let gamma = cos.acos();
                let sky = match numbers[0] as i64 {
                    1 => {
                        let glow = 0.91 + 10.0 * (-3.0 * gamma).exp() + 0.45 * cos * cos;
                        let haze = if z > 0.01 { 1.0 - (-0.32 / z).exp() } else { 1.0 };
                        zenith * glow * haze / norm
                    }
                    2 => zenith * (1.0 + 2.0 * z) / 3.0,
                    4 => {
                        let [polar, of_sun] = [z, sun.z].map(|z| z.clamp(-1.0, 1.0).acos());
                        let wave = (1.35 * (5.631 - 3.59 * polar).sin() + 3.12)
                            * (4.396 - 2.6 * of_sun).sin()
                            + 6.37
                            - polar;
                        let fall = -0.563 * ((2.629 - polar) * (1.562 - of_sun) + 0.812);
                        zenith * wave / 2.326 * (gamma * fall).exp() / norm
                    }
                    _ => zenith,
                };
                over_ground(z, sky, ground)
            }
            Self::Perez([diffuse, ground, a, b, c, d, e, x, y, height]) => {
                let sun = DVec3::new(*x, *y, *height).normalize_or(DVec3::Z);
                let cos = toward.dot(sun).clamp(-1.0, 1.0);
                let gamma = cos.acos();
                let haze = 1.0 + a * (b / z.max(0.01)).exp();
                let sky = diffuse * haze * (1.0 + c * (d * gamma).exp() + e * cos * cos);
                over_ground(z, sky, *ground)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skies_follow_their_formulas() {
        // The overcast sky of the CIE is three times as bright at the zenith as at the horizon.
        let overcast = Brightness::Cie(vec![2.0, 3.0, 0.5]);
        assert!((overcast.at(DVec3::Z) / 3.0 - 1.0).abs() < 1e-3);
        let low = DVec3::new(0.99f64.sqrt(), 0.0, 0.1);
        assert!((overcast.at(low) / (1.2 * 0.859 + 0.5 * 0.141) - 1.0).abs() < 0.05);
        assert!((overcast.at(DVec3::NEG_Z) / 0.5 - 1.0).abs() < 1e-3, "the ground");
        // Perez's with all coefficients 0 is uniform.
        let sun = [0.0, 0.6, 0.8];
        let perez = |a: f64, c: f64| {
            Brightness::Perez([2.0, 0.1, a, -0.5, c, -3.0, 0.0, sun[0], sun[1], sun[2]])
        };
        assert!((perez(0.0, 0.0).at(DVec3::Z) / 2.0 - 1.0).abs() < 1e-3);
        let toward = DVec3::from_array(sun);
        assert!(perez(0.0, 5.0).at(toward) > 4.0 * perez(0.0, 5.0).at(DVec3::new(0.0, -0.6, 0.8)));
    }

    #[test]
    fn maps_have_the_sky_where_the_file_has_it() {
        let dome = Dome {
            toward: DVec3::Z,
            cos: 0.0,
            radiance: Rgb::ONE,
            brightness: Brightness::Uniform,
            to_file: DAffine3::IDENTITY,
        };
        let sky = Sky { suns: vec![], domes: vec![dome] };
        let map = sky.environment().unwrap();
        for (direction, expected) in [(Vec3::Z, 1.0), (Vec3::NEG_Z, 0.0)] {
            assert_eq!(map.radiance(direction).x, expected, "{direction}");
        }
    }
}
