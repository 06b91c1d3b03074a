//! Skies by a relative distribution of luminance: the general sky of the CIE (ISO 15469:2004), and
//! the all-weather model of Perez, Seals and Michalsky, *All-Weather Model for Sky Luminance
//! Distribution* (1993).

use super::efficacy::SkyCondition;
use bdpm_core::base::error::{Error, Result};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Parameters `a` to `e` of the types 1 to 15 of the CIE general sky: ISO 15469:2004, table 1.
const CIE: [[f64; 5]; 15] = [
    [4.0, -0.70, 0.0, -1.0, 0.0],
    [4.0, -0.70, 2.0, -1.5, 0.15],
    [1.1, -0.80, 0.0, -1.0, 0.0],
    [1.1, -0.80, 2.0, -1.5, 0.15],
    [0.0, -1.0, 0.0, -1.0, 0.0],
    [0.0, -1.0, 2.0, -1.5, 0.15],
    [0.0, -1.0, 5.0, -2.5, 0.30],
    [0.0, -1.0, 10.0, -3.0, 0.45],
    [-1.0, -0.55, 2.0, -1.5, 0.15],
    [-1.0, -0.55, 5.0, -2.5, 0.30],
    [-1.0, -0.55, 10.0, -3.0, 0.45],
    [-1.0, -0.32, 10.0, -3.0, 0.45],
    [-1.0, -0.32, 16.0, -3.0, 0.30],
    [-1.0, -0.15, 16.0, -3.0, 0.30],
    [-1.0, -0.15, 24.0, -2.8, 0.15],
];

/// Number of the traditional overcast sky (Moon and Spencer 1942), whose luminance is
/// `(1 + 2 sin gamma)/3` of that of the zenith: ISO 15469:2004, type 16.
const TRADITIONAL: u32 = 16;

/// Parameters of a type. Those of the traditional overcast sky are for its indicatrix alone, which
/// is 1.
fn parameters(kind: u32) -> Option<[f64; 5]> {
    if kind == TRADITIONAL {
        return Some([0.0, -1.0, 0.0, -1.0, 0.0]);
    }
    let index = (kind as usize).checked_sub(1)?;
    CIE.get(index).copied()
}

/// Coefficients 1 to 4 of `a` to `e` for each category of clearness: Perez et al. 1993, table 1.
const PEREZ: [[[f64; 4]; 5]; 8] = [
    [
        [1.3525, -0.2576, -0.2690, -1.4366],
        [-0.7670, 0.0007, 1.2734, -0.1233],
        [2.8000, 0.6004, 1.2375, 1.0000],
        [1.8734, 0.6297, 0.9738, 0.2809],
        [0.0356, -0.1246, -0.5718, 0.9938],
    ],
    [
        [-1.2219, -0.7730, 1.4148, 1.1016],
        [-0.2054, 0.0367, -3.9128, 0.9156],
        [6.9750, 0.1774, 6.4477, -0.1239],
        [-1.5798, -0.5081, -1.7812, 0.1080],
        [0.2624, 0.0672, -0.2190, -0.4285],
    ],
    [
        [-1.1000, -0.2515, 0.8952, 0.0156],
        [0.2782, -0.1812, -4.5000, 1.1766],
        [24.7219, -13.0812, -37.7000, 34.8438],
        [-5.0000, 1.5218, 3.9229, -2.6204],
        [-0.0156, 0.1597, 0.4199, -0.5562],
    ],
    [
        [-0.5484, -0.6654, -0.2672, 0.7117],
        [0.7234, -0.6219, -5.6812, 2.6297],
        [33.3389, -18.3000, -62.2500, 52.0781],
        [-3.5000, 0.0016, 1.1477, 0.1062],
        [0.4659, -0.3296, -0.0876, -0.0329],
    ],
    [
        [-0.6000, -0.3566, -2.5000, 2.3250],
        [0.2937, 0.0496, -5.6812, 1.8415],
        [21.0000, -4.7656, -21.5906, 7.2492],
        [-3.5000, -0.1554, 1.4062, 0.3988],
        [0.0032, 0.0766, -0.0656, -0.1294],
    ],
    [
        [-1.0156, -0.3670, 1.0078, 1.4051],
        [0.2875, -0.5328, -3.8500, 3.3750],
        [14.0000, -0.9999, -7.1406, 7.5469],
        [-3.4000, -0.1078, -1.0750, 1.5702],
        [-0.0672, 0.4016, 0.3017, -0.4844],
    ],
    [
        [-1.0000, 0.0211, 0.5025, -0.5119],
        [-0.3000, 0.1922, 0.7023, -1.6317],
        [19.0000, -5.0000, 1.2438, -1.9094],
        [-4.0000, 0.0250, 0.3844, 0.2656],
        [1.0468, -0.3788, -2.4517, 1.4656],
    ],
    [
        [-1.0500, 0.0289, 0.4260, 0.3590],
        [-0.3250, 0.1156, 0.7781, 0.0025],
        [31.0625, -14.5000, -46.1148, 55.3750],
        [-7.2312, 0.4050, 13.3500, 0.6234],
        [1.5000, -0.6426, 1.8564, 0.5636],
    ],
];

/// Least cosine of the zenith angle in the gradation toward the horizon.
const LEAST_COSINE: f64 = 0.01;

/// Irradiance of the horizontal by the radiance of the directions above it, W/m^2.
pub(super) fn horizontal_irradiance(radiance: impl Fn(DVec3) -> DVec3) -> DVec3 {
    // Midpoints in the squared cosine: its measure is that of the projected solid angle.
    const STEPS: u32 = 512;
    let middle = |i: u32| (f64::from(i) + 0.5) / f64::from(STEPS);
    let mut sum = DVec3::ZERO;
    for i in 0..STEPS {
        let y = middle(i).sqrt();
        let across = (1.0 - y * y).sqrt();
        for j in 0..STEPS {
            let (sin, cos) = (TAU * middle(j)).sin_cos();
            sum += radiance(DVec3::new(across * cos, y, across * sin));
        }
    }
    sum * PI / f64::from(STEPS * STEPS)
}

/// A sky whose radiance is a gradation by the zenith angle, times an indicatrix by the angle to the
/// sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LuminanceDistribution {
    a: f64,
    b: f64,
    c: f64,
    d: f64,
    e: f64,
    /// Subtracted within the indicatrix.
    offset: f64,
    /// Whether the gradation is that of the traditional overcast sky.
    is_traditional: bool,
    /// Unit vector toward the sun.
    sun: DVec3,
    /// Radiance over the relative value, W/(m^2 sr).
    scale: f64,
}

impl LuminanceDistribution {
    /// The CIE general sky of a type from 1 to 15, or with 16 the traditional overcast sky of Moon
    /// and Spencer, with this horizontal irradiance, W/m^2. The unit vector `sun` points toward the
    /// sun in a frame with +y up.
    ///
    /// # Errors
    /// If there is no such type.
    pub fn cie(kind: u32, irradiance: f64, sun: DVec3) -> Result<Self> {
        let Some([a, b, c, d, e]) = parameters(kind) else {
            let advice = "give a type from 1 (overcast) to 15 (turbid), 12 is the clear sky, or 16, the \
                          traditional overcast sky";
            return Err(Error::new(format!("the CIE has no sky of type {kind}"), advice));
        };
        let offset = c * (d * FRAC_PI_2).exp();
        let is_traditional = kind == TRADITIONAL;
        Ok(Self { a, b, c, d, e, offset, is_traditional, sun, scale: 1.0 }.scaled(irradiance))
    }

    /// The sky of a condition with this horizontal irradiance, W/m^2.
    ///
    /// # Errors
    /// If there is no such sky: the diffuse irradiance is too small or too large.
    pub fn perez(condition: SkyCondition, irradiance: f64, sun: DVec3) -> Result<Self> {
        Ok(Self::perez_relative(condition, sun)?.scaled(irradiance))
    }

    /// As [`Self::perez`], with radiances in proportion to those of the sky.
    ///
    /// # Errors
    /// As [`Self::perez`].
    pub fn perez_relative(condition: SkyCondition, sun: DVec3) -> Result<Self> {
        let SkyCondition { zenith, clearness, brightness } = condition;
        if !(0.01..=0.6).contains(&brightness) || !(1.0..=12.1).contains(&clearness) {
            let problem = format!(
                "no sky of Perez has the clearness {clearness:.3} and the brightness {brightness:.3}"
            );
            let advice =
                "give light with a clearness from 1 to 12.1 and a brightness from 0.01 to 0.6";
            return Err(Error::new(problem, advice));
        }
        let category = condition.category();
        let is_corrected = clearness > 1.065 && clearness < 2.8;
        let brightness = if is_corrected { brightness.max(0.2) } else { brightness };
        let [a, b, c, d, e] = PEREZ[category];
        // Equation (6)
        let linear =
            |[x1, x2, x3, x4]: [f64; 4]| x1 + x2 * zenith + brightness * (x3 + x4 * zenith);
        // Equations (7) and (8)
        let [c, d] = if category == 0 {
            let [c1, c2, c3, c4] = c;
            let [d1, d2, d3, d4] = d;
            let c = (brightness * (c1 + c2 * zenith)).powf(c3).exp() - c4;
            [c, -(brightness * (d1 + d2 * zenith)).exp() + d3 + brightness * d4]
        } else {
            [linear(c), linear(d)]
        };
        let [a, b, e] = [a, b, e].map(linear);
        let (offset, is_traditional) = (0.0, false);
        Ok(Self { a, b, c, d, e, offset, is_traditional, sun, scale: 1.0 })
    }

    /// This distribution with this horizontal irradiance, W/m^2.
    fn scaled(self, irradiance: f64) -> Self {
        Self { scale: irradiance / self.horizontal(), ..self }
    }

    /// The parameters `a` to `e` of gradation and indicatrix.
    pub fn coefficients(&self) -> [f64; 5] {
        let Self { a, b, c, d, e, .. } = *self;
        [a, b, c, d, e]
    }

    /// Irradiance of the horizontal, W/m^2.
    pub fn horizontal(&self) -> f64 {
        horizontal_irradiance(|direction| DVec3::splat(self.radiance(direction))).x
    }

    /// Returns true if a type of the CIE general sky is the same for all positions of the sun.
    pub fn is_sunless(kind: u32) -> bool {
        parameters(kind).is_some_and(|[_, _, c, _, e]| c == 0.0 && e == 0.0)
    }

    /// Radiance from a unit direction, W/(m^2 sr); 0 from below the horizon.
    /// theory.md (19b).
    pub fn radiance(&self, direction: DVec3) -> f64 {
        if direction.y < 0.0 {
            return 0.0;
        }
        let cos_gamma = direction.dot(self.sun).clamp(-1.0, 1.0);
        let gradation = match self.is_traditional {
            true => (1.0 + 2.0 * direction.y) / 3.0,
            false => 1.0 + self.a * (self.b / direction.y.max(LEAST_COSINE)).exp(),
        };
        let around_sun = self.c * (self.d * cos_gamma.acos()).exp() - self.offset;
        let indicatrix = 1.0 + around_sun + self.e * cos_gamma * cos_gamma;
        (self.scale * gradation * indicatrix).max(0.0)
    }
}
