//! The sky of Hosek and Wilkie, *An Analytic Model for Full Spectral Sky-Dome Radiance* (2012), and
//! its sun, *Adding a Solar-Radiance Function to the Hosek-Wilkie Skylight Model* (2013), in linear
//! sRGB.
//!
//! The tables are those of the authors. `scripts/sky_tables.py` writes them,
//! `hosek_wilkie.LICENSE.txt` is their license.

use bdpm_core::base::math::Rgb;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Little-endian numbers: parameters, mean radiance, irradiance of the sun.
const TABLES: &[u8] = include_bytes!("hosek_wilkie.bin");

const TURBIDITIES: usize = 10;
const CONTROL_POINTS: usize = 6;
const PARAMETERS: usize = 9;
/// Elevations 2, 5, ..., 89 degrees.
const SUN_ELEVATIONS: usize = 30;

/// Indices of the first number of each table.
const RADIANCE_AT: usize = TURBIDITIES * 2 * CONTROL_POINTS * 3 * PARAMETERS;
const SUN_AT: usize = RADIANCE_AT + TURBIDITIES * 2 * CONTROL_POINTS * 3;

/// Integral of the CIE 1931 luminosity function over the wavelength, nm. The tables divide by it,
/// hence their luminance is a mean of the spectral radiance, W/(m^2 sr nm). Times this width and
/// 683 lm/W it is the luminance in cd/m^2.
pub const LUMINOUS_WIDTH: f32 = 106.856_895;

/// The number with this index in the tables.
fn table(index: usize) -> f64 {
    let bytes: [u8; 4] = TABLES[4 * index..4 * index + 4].try_into().expect("four bytes");
    f64::from(f32::from_le_bytes(bytes))
}

/// A sky for one position of the sun.
#[derive(Clone, Debug)]
pub struct HosekWilkie {
    /// For each channel.
    parameters: [[f64; PARAMETERS]; 3],
    /// Mean spectral radiance of each channel, W/(m^2 sr nm).
    radiance: [f64; 3],
    /// Unit vector toward the sun.
    sun: DVec3,
}

/// The two nearest turbidities of the tables, as indices with their weights.
fn turbidities(turbidity: f64) -> [(usize, f64); 2] {
    let at = (turbidity - 1.0).clamp(0.0, (TURBIDITIES - 1) as f64);
    let low = (at as usize).min(TURBIDITIES - 2);
    [(low, 1.0 - (at - low as f64)), (low + 1, at - low as f64)]
}

impl HosekWilkie {
    /// The sky for a turbidity from 1 to 10, an albedo of the ground, and the unit vector `sun`
    /// toward the sun in a frame with +y up. The sun is not below the horizon.
    pub fn new(turbidity: f64, albedo: Rgb, sun: DVec3) -> Self {
        let elevation = sun.y.clamp(0.0, 1.0).asin();
        let x = (elevation / FRAC_PI_2).cbrt();
        // The quintic Bernstein polynomials.
        let bernstein: [f64; CONTROL_POINTS] = std::array::from_fn(|k| {
            let binomial = [1.0, 5.0, 10.0, 10.0, 5.0, 1.0][k];
            binomial * x.powi(k as i32) * (1.0 - x).powi((CONTROL_POINTS - 1 - k) as i32)
        });
        let albedo = albedo.as_dvec3().to_array();
        let mixed = |channel: usize, number: &dyn Fn(usize) -> f64| -> f64 {
            let mut sum = 0.0;
            for (turbidity, share) in turbidities(turbidity) {
                for (ground, weight) in [1.0 - albedo[channel], albedo[channel]].iter().enumerate()
                {
                    for (point, basis) in bernstein.iter().enumerate() {
                        let row = ((turbidity * 2 + ground) * CONTROL_POINTS + point) * 3 + channel;
                        sum += share * weight * basis * number(row);
                    }
                }
            }
            sum
        };
        Self {
            parameters: std::array::from_fn(|channel| {
                std::array::from_fn(|i| mixed(channel, &|row| table(row * PARAMETERS + i)))
            }),
            radiance: std::array::from_fn(|channel| {
                mixed(channel, &|row| table(RADIANCE_AT + row))
            }),
            sun,
        }
    }

    /// The sky with `factor` times its radiance.
    #[must_use]
    pub fn times(self, factor: f32) -> Self {
        Self { radiance: self.radiance.map(|mean| mean * f64::from(factor)), ..self }
    }

    /// Spectral radiance from a unit direction, W/(m^2 sr nm); 0 from below the horizon. Channels
    /// outside the gamut become 0. theory.md (19a).
    pub fn radiance(&self, direction: DVec3) -> Rgb {
        let cos_zenith = direction.y;
        if cos_zenith < 0.0 {
            return Rgb::ZERO;
        }
        let cos_gamma = direction.dot(self.sun).clamp(-1.0, 1.0);
        let gamma = cos_gamma.acos();
        let channel = |channel: usize| {
            let [a, b, c, d, e, f, g, h, i] = self.parameters[channel];
            let chi = (1.0 + cos_gamma.powi(2)) / (1.0 + i * i - 2.0 * i * cos_gamma).powf(1.5);
            let horizon = 1.0 + a * (b / (cos_zenith + 0.01)).exp();
            let around_sun =
                c + d * (e * gamma).exp() + f * cos_gamma.powi(2) + g * chi + h * cos_zenith.sqrt();
            (horizon * around_sun * self.radiance[channel]).max(0.0) as f32
        };
        Rgb::new(channel(0), channel(1), channel(2))
    }
}

/// Spectral irradiance of a surface that faces the sun, W/(m^2 nm), at a turbidity and an elevation
/// in radians.
pub fn sun_irradiance(turbidity: f64, elevation: f64) -> Rgb {
    let at = ((elevation.to_degrees() - 2.0) / 3.0).clamp(0.0, (SUN_ELEVATIONS - 1) as f64);
    let low = (at as usize).min(SUN_ELEVATIONS - 2);
    let mut sum = DVec3::ZERO;
    for (turbidity, share) in turbidities(turbidity) {
        for (step, weight) in [1.0 - (at - low as f64), at - low as f64].iter().enumerate() {
            let first = SUN_AT + (turbidity * SUN_ELEVATIONS + low + step) * 3;
            let color = DVec3::new(table(first), table(first + 1), table(first + 2));
            sum += share * weight * color;
        }
    }
    sum.max(DVec3::ZERO).as_vec3()
}

/// Solid angle of a cone around its axis up to `half_angle`, radians.
pub fn cone(half_angle: f64) -> f64 {
    // 1 - cos(a) without cancellation.
    TAU * 2.0 * (0.5 * half_angle).sin().powi(2)
}
