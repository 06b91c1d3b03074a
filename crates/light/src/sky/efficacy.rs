//! Luminous efficacy of the sky and the sun: Perez, Ineichen, Seals, Michalsky and Stewart,
//! *Modeling Daylight Availability and Irradiance Components from Direct and Global Irradiance*,
//! Solar Energy 44 (1990).

use glam::DVec3;

/// Upper bounds of the clearness of the first seven categories.
const CLEARNESS: [f64; 7] = [1.065, 1.23, 1.5, 1.95, 2.8, 4.5, 6.2];

/// Coefficients of the efficacy of diffuse light for each category of clearness: table 4 of Perez
/// et al. 1990.
const DIFFUSE: [[f64; 4]; 8] = [
    [97.24, -0.46, 12.00, -8.91],
    [107.22, 1.15, 0.59, -3.95],
    [104.97, 2.96, -5.53, -8.77],
    [102.39, 5.59, -13.95, -13.90],
    [100.71, 5.94, -22.75, -23.74],
    [106.42, 3.83, -36.15, -28.83],
    [141.88, 1.90, -53.24, -14.03],
    [152.23, 0.35, -45.27, -7.98],
];

/// Coefficients of the efficacy of direct light for each category of clearness: table 4 of Perez et
/// al. 1990.
const DIRECT: [[f64; 4]; 8] = [
    [57.20, -4.55, -2.98, 117.12],
    [98.99, -3.46, -1.21, 12.38],
    [109.83, -4.90, -1.71, -8.81],
    [110.34, -5.84, -1.99, -4.56],
    [106.36, -3.97, -1.75, -6.16],
    [107.19, -1.25, -1.51, -26.73],
    [105.75, 0.77, -1.26, -34.44],
    [101.18, 1.58, -1.10, -8.29],
];

/// Extraterrestrial normal irradiance, W/m^2, as in the models of 1990 and 1993.
const SOLAR_CONSTANT: f64 = 1367.0;

/// Precipitable water, cm: the usual value where the dew point is unknown.
const WATER: f64 = 2.0;

/// Efficacy with which the search for irradiances starts, lm/W.
const FIRST_EFFICACY: f64 = 110.0;

/// Steps of the search for irradiances. Each halves the change, so that it also ends between two
/// categories.
const STEPS: u32 = 48;

/// State of the sky by the irradiances of weather data: theory.md (19c).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkyCondition {
    /// Angle of the sun from the zenith, radians.
    pub zenith: f64,
    /// Clearness, at least 1.
    pub clearness: f64,
    /// Brightness.
    pub brightness: f64,
}

impl SkyCondition {
    /// The condition with these irradiances: diffuse on the horizontal, and direct on a surface
    /// that faces the sun, W/m^2. The unit vector `sun` points toward the sun in a frame with +y
    /// up. `eccentricity` is the squared ratio of the mean distance to the sun to the distance on
    /// that day.
    pub fn new([diffuse, direct]: [f64; 2], sun: DVec3, eccentricity: f64) -> Self {
        let zenith = sun.y.clamp(0.0, 1.0).acos();
        let cubed = 1.041 * zenith.powi(3);
        let ratio = if direct > 0.0 { direct / diffuse } else { 0.0 };
        let clearness = 1.0 + ratio / (1.0 + cubed);
        let air_mass = 1.0 / (zenith.cos() + 0.15 * (93.885 - zenith.to_degrees()).powf(-1.253));
        let brightness = diffuse * air_mass / (SOLAR_CONSTANT * eccentricity);
        Self { zenith, clearness, brightness }
    }

    /// The condition with these illuminances, lx: the irradiances that their efficacies give.
    pub fn of_illuminances(illuminances: [f64; 2], sun: DVec3, eccentricity: f64) -> Self {
        let mut irradiances = illuminances.map(|lux| lux / FIRST_EFFICACY);
        for _ in 0..STEPS {
            let efficacy = Self::new(irradiances, sun, eccentricity).efficacy();
            for i in 0..2 {
                let next = illuminances[i] / efficacy[i].max(1.0);
                irradiances[i] = 0.5 * (irradiances[i] + next);
            }
        }
        Self::new(irradiances, sun, eccentricity)
    }

    /// Category of the clearness, from 0 (overcast) to 7 (clear).
    pub fn category(&self) -> usize {
        CLEARNESS.iter().take_while(|bound| self.clearness >= **bound).count()
    }

    /// Luminous efficacy of the diffuse and of the direct light, lm/W: theory.md (19d).
    pub fn efficacy(&self) -> [f64; 2] {
        let Self { zenith, brightness, .. } = *self;
        let [a, b, c, d] = DIFFUSE[self.category()];
        let diffuse = a + b * WATER + c * zenith.cos() + d * brightness.max(0.01).ln();
        let [a, b, c, d] = DIRECT[self.category()];
        let direct = a + b * WATER + c * (5.73 * zenith - 5.0).exp() + d * brightness;
        [diffuse.max(0.0), direct.max(0.0)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn toward_sun(elevation_deg: f64) -> DVec3 {
        let (sin, cos) = elevation_deg.to_radians().sin_cos();
        DVec3::new(cos, sin, 0.0)
    }

    /// Ordinary days have 95 to 160 lm/W for the sky, and 85 to 115 lm/W for a sun that is not low.
    #[test]
    fn efficacies_of_ordinary_days_are_about_110_lumens_per_watt() {
        for (irradiances, elevation) in [
            ([100.0, 800.0], 50.0),
            ([200.0, 0.0], 40.0),
            ([250.0, 300.0], 35.0),
            ([80.0, 700.0], 30.0),
        ] {
            let condition = SkyCondition::new(irradiances, toward_sun(elevation), 1.0);
            let [diffuse, direct] = condition.efficacy();
            assert!((95.0..160.0).contains(&diffuse), "{condition:?}: {diffuse}");
            let is_sunny = irradiances[1] > 0.0;
            assert!(!is_sunny || (85.0..115.0).contains(&direct), "{condition:?}: {direct}");
        }
    }

    #[test]
    fn illuminances_have_the_condition_of_their_irradiances() {
        for (irradiances, elevation) in
            [([100.0, 800.0], 50.0), ([220.0, 0.0], 40.0), ([150.0, 500.0], 20.0)]
        {
            let sun = toward_sun(elevation);
            let condition = SkyCondition::new(irradiances, sun, 1.0);
            let efficacy = condition.efficacy();
            let illuminances = [0, 1].map(|i| irradiances[i] * efficacy[i]);
            let found = SkyCondition::of_illuminances(illuminances, sun, 1.0);
            assert!((found.clearness / condition.clearness - 1.0).abs() < 1e-6, "{found:?}");
            assert!((found.brightness / condition.brightness - 1.0).abs() < 1e-6, "{found:?}");
        }
    }

    #[test]
    fn conditions_without_light_are_overcast_and_finite() {
        let condition = SkyCondition::new([0.0, 0.0], DVec3::Y, 1.0);
        assert_eq!((condition.clearness, condition.category()), (1.0, 0));
        assert!(condition.efficacy().iter().all(|efficacy| efficacy.is_finite()));
        assert_eq!(SkyCondition::new([0.0, 5.0], DVec3::Y, 1.0).category(), 7);
    }
}
