//! `[sky]` of a scene file: a sky with a sun.

use super::keys::Point;
use super::numbers::{Albedo, NonNegative};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::scene::Environment;
use bdpm_core::settings::FixedArray;
use bdpm_light::sky::{
    HosekWilkie, LUMINOUS_WIDTH, LuminanceDistribution, PlaceAndTime, SUN_HALF_ANGLE, Sky,
    SkyCondition, SkyModel, SunDisc, cone, day_of_year, eccentricity, sun_irradiance,
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
    /// Diffuse irradiance of the horizontal over the whole solar spectrum, W/m^2.
    diffuse: Option<f64>,
    /// Direct irradiance of a surface that faces the sun over the whole solar spectrum, W/m^2.
    direct: Option<f64>,
    /// Diffuse illuminance of the horizontal, lx.
    diffuse_lx: Option<f64>,
    /// Direct illuminance of a surface that faces the sun, lx.
    direct_lx: Option<f64>,
    sky_scale: Option<NonNegative>,
    sun_scale: Option<NonNegative>,
    /// Angle that the sun subtends.
    sun_angle_deg: Option<f64>,
    #[serde(default)]
    turn_deg: f32,
}

/// Light of weather data.
#[derive(Clone, Copy, Debug)]
struct Daylight {
    /// Diffuse on the horizontal, and direct on a surface that faces the sun: lux over 683 lm/W.
    irradiances: [f64; 2],
    /// State of the sky; `None` if the position of the sun is unknown.
    condition: Option<SkyCondition>,
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
        let (model, irradiance, albedo) = self.model(toward)?;
        let radiance = irradiance * sun_scale / cone(half_angle) as f32;
        let sun = toward.map(|toward| SunDisc { toward, half_angle, radiance });
        let sky = Sky {
            dome: (sky_scale != Rgb::ZERO).then_some((model, sky_scale)),
            sun: sun.filter(|_| radiance != Rgb::ZERO),
            ground: Rgb::ZERO,
        };
        sky.over_ground(albedo).environment(DMat3::IDENTITY, self.turn_deg)
    }

    /// The radiance of the sky, the irradiance of a surface that faces the sun, W/m^2, and the
    /// albedo of the ground.
    fn model(&self, toward: Option<DVec3>) -> Result<(SkyModel, Rgb, Rgb)> {
        let albedo = self.albedo.as_ref().map(|albedo| albedo.0);
        if self.model == Model::HosekWilkie {
            let turbidity = within("turbidity", self.turbidity.unwrap_or(3.0), 1.0..=10.0)?;
            let albedo = albedo.unwrap_or(Rgb::splat(0.3));
            let toward = toward.ok_or_else(no_sun)?;
            let model = HosekWilkie::new(turbidity, albedo, toward).times(LUMINOUS_WIDTH);
            let irradiance = LUMINOUS_WIDTH * sun_irradiance(turbidity, toward.y.asin());
            return Ok((SkyModel::HosekWilkie(model), irradiance, albedo));
        }
        let Daylight { irradiances: [diffuse, direct], condition } = self.daylight(toward)?;
        let model = match self.model {
            Model::Cie => {
                let kind = required("cie_type", self.cie_type)?;
                if toward.is_none() && !LuminanceDistribution::is_sunless(kind) {
                    return Err(no_sun());
                }
                LuminanceDistribution::cie(kind, diffuse, toward.unwrap_or(DVec3::Y))?
            }
            _ => {
                let (toward, condition) = toward.zip(condition).ok_or_else(no_sun)?;
                LuminanceDistribution::perez(condition, diffuse, toward)?
            }
        };
        let albedo = albedo.unwrap_or(Rgb::ZERO);
        Ok((SkyModel::Distribution(model), Rgb::splat(direct as f32), albedo))
    }

    /// The light that the table gives in lux, or in watts per square meter of the whole solar
    /// spectrum.
    fn daylight(&self, toward: Option<DVec3>) -> Result<Daylight> {
        let watts = [("diffuse", self.diffuse), ("direct", self.direct)];
        let lux = [("diffuse_lx", self.diffuse_lx), ("direct_lx", self.direct_lx)];
        let is_given = |own: [(&str, Option<f64>); 2]| own.iter().any(|(_, value)| value.is_some());
        if is_given(watts) && is_given(lux) {
            let problem = "the sky has irradiances besides illuminances";
            return Err(Error::new(problem, "give both in W/m^2, or both in lux"));
        }
        let own = if is_given(lux) { lux } else { watts };
        let direct = match self.model {
            Model::Perez => required(own[1].0, own[1].1)?,
            _ => own[1].1.unwrap_or(0.0),
        };
        let amounts = [required(own[0].0, own[0].1)?, direct];
        for ((name, _), amount) in own.iter().zip(amounts) {
            within(name, amount, AMOUNTS)?;
        }
        let lumens_per_watt = f64::from(LUMENS_PER_WATT);
        let of_sun = |toward| {
            if is_given(lux) {
                SkyCondition::of_illuminances(amounts, toward, self.eccentricity())
            } else {
                SkyCondition::new(amounts, toward, self.eccentricity())
            }
        };
        let condition = toward.map(of_sun);
        if is_given(lux) {
            if direct > 0.0 && toward.is_none() {
                return Err(no_sun());
            }
            return Ok(Daylight {
                irradiances: amounts.map(|lux| lux / lumens_per_watt),
                condition,
            });
        }
        let Some(efficacy) = condition.map(|condition| condition.efficacy()) else {
            let problem =
                "the luminous efficacy of the sky depends on the sun, whose position is unknown";
            let advice = "give `diffuse_lx` in place of `diffuse`, or the position of the sun";
            return Err(Error::new(problem, advice));
        };
        let irradiances = [0, 1].map(|i| amounts[i] * efficacy[i] / lumens_per_watt);
        Ok(Daylight { irradiances, condition })
    }

    /// Squared ratio of the mean distance to the sun to that on the date; 1 without a date.
    fn eccentricity(&self) -> f64 {
        self.date.map_or(1.0, |FixedArray([_, month, day])| {
            eccentricity(day_of_year(month as u32, day as u32).into())
        })
    }

    /// Refuses keys of other models.
    fn check_keys(&self) -> Result<()> {
        let is_measured = self.model != Model::HosekWilkie;
        let wrong = [
            ("turbidity", self.turbidity.is_some() && is_measured),
            ("diffuse", self.diffuse.is_some() && !is_measured),
            ("direct", self.direct.is_some() && !is_measured),
            ("diffuse_lx", self.diffuse_lx.is_some() && !is_measured),
            ("direct_lx", self.direct_lx.is_some() && !is_measured),
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

    /// Unit vector toward the sun, which is above the horizon; `None` if the table has no position
    /// of the sun.
    fn toward_sun(&self) -> Result<Option<DVec3>> {
        let place = [self.latitude, self.longitude, self.timezone, self.hour];
        let has_place = place.iter().any(Option::is_some) || self.date.is_some();
        if self.sun_direction.is_none() && !has_place {
            return Ok(None);
        }
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
                    return Err(no_sun());
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
        Ok(Some(toward))
    }
}

/// The error of a sky that needs the position of the sun.
fn no_sun() -> Error {
    let advice = "give `sun_direction`, or `latitude`, `longitude`, `timezone`, `date` and `hour`";
    Error::new("the sky does not know where the sun is", advice)
}

/// Irradiances, W/m^2, and illuminances, lx.
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
