//! `[sky]` of a scene file: a sky with a sun.

use super::keys::Point;
use super::numbers::{Albedo, NonNegative};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::Environment;
use bdpm_core::settings::FixedArray;
use bdpm_light::sky::{
    HosekWilkie, LuminanceDistribution, PlaceAndTime, SUN_HALF_ANGLE, Sky, SkyModel, SunDisc, cone,
    eccentricity, sun_irradiance,
};
use glam::{DMat3, DVec3};
use serde::Deserialize;
use std::ops::RangeInclusive;

/// Models of the sky.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
enum Model {
    #[default]
    HosekWilkie,
    Cie,
    Perez,
}

/// `[sky]`
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkyTable {
    #[serde(default)]
    model: Model,
    /// Vector toward the sun.
    sun_direction: Option<Point>,
    /// `[year, month, day]`
    date: Option<FixedArray<i32, 3>>,
    /// Decimal hours of the clock.
    hour: Option<f64>,
    latitude: Option<f64>,
    longitude: Option<f64>,
    timezone: Option<f64>,
    turbidity: Option<f64>,
    albedo: Option<Albedo>,
    /// Type of the CIE general sky.
    cie_type: Option<u32>,
    /// Diffuse irradiance of the horizontal, W/m^2.
    diffuse: Option<f64>,
    /// Direct irradiance of a surface that faces the sun, W/m^2.
    direct: Option<f64>,
    sky_scale: Option<NonNegative>,
    sun_scale: Option<NonNegative>,
    /// Angle that the sun subtends.
    sun_angle_deg: Option<f64>,
    #[serde(default)]
    turn_deg: f32,
}

impl SkyTable {
    /// The sky as a map.
    pub fn environment(&self) -> Result<Environment> {
        if !self.turn_deg.is_finite() {
            return Err(Error::new("`turn_deg` is not finite", "give an angle in degrees"));
        }
        let toward = self.toward_sun()?;
        let degrees = self.sun_angle_deg.unwrap_or(2.0 * SUN_HALF_ANGLE.to_degrees());
        let half_angle = 0.5 * within("sun_angle_deg", degrees, 0.01..=179.0)?.to_radians();
        let scale = |given: Option<NonNegative>| given.map_or(Rgb::ONE, |scale| scale.0);
        let (sky_scale, sun_scale) = (scale(self.sky_scale), scale(self.sun_scale));
        self.check_keys()?;
        let (model, irradiance) = match self.model {
            Model::HosekWilkie => {
                let turbidity = within("turbidity", self.turbidity.unwrap_or(3.0), 1.0..=10.0)?;
                let albedo = self.albedo.map_or(Rgb::splat(0.3), |albedo| albedo.0);
                let model = HosekWilkie::new(turbidity, albedo, toward);
                (SkyModel::HosekWilkie(model), sun_irradiance(turbidity, toward.y.asin()))
            }
            Model::Cie => {
                let diffuse = within("diffuse", required("diffuse", self.diffuse)?, AMOUNTS)?;
                let direct = within("direct", self.direct.unwrap_or(0.0), AMOUNTS)?;
                let kind = required("cie_type", self.cie_type)?;
                let model = LuminanceDistribution::cie(kind, diffuse, toward)?;
                (SkyModel::Distribution(model), Rgb::splat(direct as f32))
            }
            Model::Perez => {
                let diffuse = within("diffuse", required("diffuse", self.diffuse)?, AMOUNTS)?;
                let direct = within("direct", required("direct", self.direct)?, AMOUNTS)?;
                // Without a date, the sun has its mean distance.
                let eccentricity = self.date.map_or(1.0, |FixedArray([_, month, day])| {
                    const DAYS: [i32; 12] = [0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334];
                    eccentricity(f64::from(DAYS[(month - 1) as usize] + day))
                });
                let model = LuminanceDistribution::perez(diffuse, direct, toward, eccentricity)?;
                (SkyModel::Distribution(model), Rgb::splat(direct as f32))
            }
        };
        let radiance = irradiance * sun_scale / cone(half_angle) as f32;
        let sun = SunDisc { toward, half_angle, radiance };
        let sky = Sky {
            dome: (sky_scale != Rgb::ZERO).then_some((model, sky_scale)),
            sun: (radiance != Rgb::ZERO).then_some(sun),
        };
        sky.environment(DMat3::IDENTITY, self.turn_deg)
    }

    /// Refuses keys of other models.
    fn check_keys(&self) -> Result<()> {
        let is_measured = self.model != Model::HosekWilkie;
        let wrong = [
            ("turbidity", self.turbidity.is_some() && is_measured),
            ("albedo", self.albedo.is_some() && is_measured),
            ("diffuse", self.diffuse.is_some() && !is_measured),
            ("direct", self.direct.is_some() && !is_measured),
            ("cie_type", self.cie_type.is_some() && self.model != Model::Cie),
        ];
        match wrong.iter().find(|(_, is_wrong)| *is_wrong) {
            None => Ok(()),
            Some((key, _)) => {
                let problem = format!("`{key}` has no meaning for this model of the sky");
                Err(Error::new(problem, "remove it, or choose another `model`"))
            }
        }
    }

    /// Unit vector toward the sun, which is above the horizon.
    fn toward_sun(&self) -> Result<DVec3> {
        let place = [self.latitude, self.longitude, self.timezone, self.hour];
        let has_place = place.iter().any(Option::is_some) || self.date.is_some();
        let toward = match self.sun_direction {
            Some(_) if has_place => {
                let problem = "the sky has `sun_direction` besides a place or a time";
                return Err(Error::new(problem, "give one of them"));
            }
            Some(Point(direction)) => direction.as_dvec3().try_normalize().ok_or_else(|| {
                let advice = "give a vector toward the sun, such as [0.3, 1, -0.5]";
                Error::new("`sun_direction` has no length", advice)
            })?,
            None => {
                let Some(FixedArray([year, month, day])) = self.date else {
                    let problem = "the sky does not know where the sun is";
                    let advice = "give `sun_direction`, or `latitude`, `longitude`, `timezone`, `date` and `hour`";
                    return Err(Error::new(problem, advice));
                };
                let is_date = (-4000..=9999).contains(&year)
                    && (1..=12).contains(&month)
                    && (1..=31).contains(&day);
                if !is_date {
                    let problem = format!("`date` is [{year}, {month}, {day}]");
                    return Err(Error::new(problem, "give [year, month, day]"));
                }
                let given = |name, value, range| within(name, required(name, value)?, range);
                let [zenith, azimuth] = PlaceAndTime {
                    latitude: given("latitude", self.latitude, -90.0..=90.0)?,
                    longitude: given("longitude", self.longitude, -360.0..=360.0)?,
                    timezone: given("timezone", self.timezone, -24.0..=24.0)?,
                    hours: given("hour", self.hour, 0.0..=24.0)?,
                    year,
                    month,
                    day,
                }
                .sun();
                let (sin, cos) = azimuth.sin_cos();
                DVec3::new(zenith.sin() * sin, zenith.cos(), -zenith.sin() * cos)
            }
        };
        if toward.y < 0.0 {
            let height = toward.y.asin().to_degrees();
            let problem = format!("the sun is {:.1} degrees below the horizon", -height);
            return Err(Error::new(problem, "change `hour`, `date` or `sun_direction`"));
        }
        Ok(toward)
    }
}

/// Irradiances, W/m^2.
const AMOUNTS: RangeInclusive<f64> = 0.0..=1e12;

fn required<T>(name: &str, value: Option<T>) -> Result<T> {
    value.ok_or_else(|| Error::new(format!("the sky needs `{name}`"), "add it"))
}

fn within(name: &str, value: f64, range: RangeInclusive<f64>) -> Result<f64> {
    if range.contains(&value) {
        return Ok(value);
    }
    let advice = format!("give a number from {:?} to {:?}", range.start(), range.end());
    Err(Error::new(format!("`{name}` is {value}"), advice))
}
