//! The light of each hour of a year: luminances of the patches of the sky, and the sun.

use bdpm_core::base::error::Result;
use bdpm_light::sky::{LuminanceDistribution, SkyCondition, SkyPatches, day_of_year, eccentricity};
use bdpm_light::weather::{Weather, WeatherHour};
use glam::{DMat3, DVec3, Vec3};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Least sine of the height of the sun: below the horizon there is no light.
const LEAST_HEIGHT: f64 = 0.005;

/// Irradiances below this are dark, W/m^2.
const DARK: f64 = 0.5;

/// Ranges of the clearness and brightness of a sky in the model of Perez.
const CLEARNESS: [f64; 2] = [1.0, 12.1];
const BRIGHTNESS: [f64; 2] = [0.01, 0.6];

/// Light of a year.
pub struct Year<'a> {
    /// All hours, also dark ones.
    pub hours: Vec<HourLight>,
    /// Groups of unit vectors toward the sun, in the coordinates of the scene. Those of one patch
    /// of the sky are a group.
    pub suns: Vec<Vec<Vec3>>,
    /// For each patch its group of suns and its solid angle, sr, if it has any.
    suns_of_patch: Vec<Option<(usize, f32)>>,
    patches: &'a SkyPatches,
    to_sky: DMat3,
}

/// Light of an hour.
#[derive(Clone, Debug, Default)]
pub struct HourLight {
    /// From 1.
    pub month: u32,
    /// Hours of the clock in the middle of the hour.
    pub middle: f64,
    /// Luminances of the patches, and of the ground below the horizon, cd/m^2; empty in the dark.
    pub sky: Vec<f32>,
    /// Irradiance over illuminance of the light of the sky, W/lm.
    pub watts_per_lumen: f64,
    /// Radiance of the ground over the whole solar spectrum, W/(m^2 sr).
    pub ground_watts: f64,
    /// The sun, if it shines.
    pub sun: Option<Sun>,
}

/// The sun in an hour.
#[derive(Clone, Copy, Debug)]
pub struct Sun {
    /// Unit vector toward it, in the coordinates of the scene.
    pub toward: Vec3,
    /// Illuminance of a surface that faces it, lx.
    pub lux: f32,
    /// Irradiance of such a surface over the whole solar spectrum, W/m^2.
    pub watts: f64,
    /// Its group.
    pub group: usize,
}

impl<'a> Year<'a> {
    /// The light of this weather above a ground of this reflectance. The sky is turned about +y,
    /// counterclockwise as seen from +y.
    pub fn new(
        weather: &Weather,
        patches: &'a SkyPatches,
        turn_deg: f64,
        ground: f64,
    ) -> Result<Self> {
        let to_scene = DMat3::from_rotation_y(turn_deg.to_radians());
        let mut groups: BTreeMap<usize, usize> = BTreeMap::new();
        let mut suns: Vec<Vec<Vec3>> = Vec::new();
        let mut hours = Vec::with_capacity(weather.hours.len());
        for hour in &weather.hours {
            let mut own =
                HourLight { month: hour.month, middle: hour.middle, ..HourLight::default() };
            let toward = weather.sun(hour);
            if toward.y > LEAST_HEIGHT && hour.diffuse > DARK {
                let [diffuse, direct] = illuminances(hour, toward);
                own.sky = luminances(hour, toward, patches, diffuse)?;
                let below = ground * (diffuse + direct * toward.y) / PI;
                own.sky.push(below as f32);
                own.watts_per_lumen = hour.diffuse / diffuse;
                own.ground_watts = ground * (hour.diffuse + hour.direct * toward.y) / PI;
                if direct > 0.0 {
                    let patch = patches.find(toward).expect("the sun is above the horizon");
                    let group = *groups.entry(patch).or_insert_with(|| {
                        suns.push(Vec::new());
                        suns.len() - 1
                    });
                    let toward = (to_scene * toward).as_vec3().normalize();
                    suns[group].push(toward);
                    let (lux, watts) = (direct as f32, hour.direct);
                    own.sun = Some(Sun { toward, lux, watts, group });
                }
            }
            hours.push(own);
        }
        let mut suns_of_patch = vec![None; patches.count()];
        for (patch, group) in groups {
            suns_of_patch[patch] = Some((group, patches.solid_angle(patch) as f32));
        }
        Ok(Self { hours, suns, suns_of_patch, patches, to_sky: to_scene.transpose() })
    }

    /// The group of the suns in a bin, and its solid angle, sr.
    pub fn suns_of_bin(&self, bin: usize) -> Option<(usize, f32)> {
        *self.suns_of_patch.get(bin)?
    }

    /// Number of bins of directions: the patches and the ground.
    pub fn bins(&self) -> usize {
        self.patches.count() + 1
    }

    /// The bin of a unit direction of the scene.
    pub fn bin(&self, direction: Vec3) -> usize {
        let in_sky = self.to_sky * direction.as_dvec3();
        self.patches.find(in_sky).unwrap_or(self.patches.count())
    }
}

fn condition(hour: &WeatherHour, toward: DVec3) -> SkyCondition {
    let day = day_of_year(hour.month, hour.day);
    let own = SkyCondition::new([hour.diffuse, hour.direct], toward, eccentricity(day.into()));
    // Measured irradiances are means over an hour, which no single sky may have.
    let clearness = own.clearness.clamp(CLEARNESS[0], CLEARNESS[1]);
    let brightness = own.brightness.clamp(BRIGHTNESS[0], BRIGHTNESS[1]);
    SkyCondition { clearness, brightness, ..own }
}

/// Illuminances of an hour: of the horizontal by the sky, and of a surface that faces the sun, lx.
fn illuminances(hour: &WeatherHour, toward: DVec3) -> [f64; 2] {
    let [diffuse, direct] = condition(hour, toward).efficacy();
    [hour.diffuse * diffuse, hour.direct * direct.max(0.0)]
}

/// Luminances of the patches, cd/m^2, whose sky has this illuminance on the horizontal, lx.
fn luminances(
    hour: &WeatherHour,
    toward: DVec3,
    patches: &SkyPatches,
    diffuse: f64,
) -> Result<Vec<f32>> {
    let sky = LuminanceDistribution::perez_relative(condition(hour, toward), toward)?;
    let relative: Vec<f64> =
        (0..patches.count()).map(|patch| sky.radiance(patches.middle(patch))).collect();
    let shares = relative.iter().enumerate().map(|(patch, own)| own * patches.projected(patch));
    let scale = diffuse / shares.sum::<f64>();
    Ok(relative.into_iter().map(|own| (scale * own) as f32).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weather() -> Weather {
        let hour = |month, day, middle, diffuse, direct| WeatherHour {
            month,
            day,
            middle,
            diffuse,
            direct,
        };
        let hours = vec![
            hour(6, 21, 12.5, 120.0, 850.0),
            hour(12, 21, 9.5, 60.0, 0.0),
            hour(1, 1, 0.5, 0.0, 0.0),
        ];
        let (latitude, longitude, timezone) = (48.1, 11.6, 1.0);
        Weather { place: "Munich, DEU".into(), latitude, longitude, timezone, hours }
    }

    #[test]
    fn skies_have_the_illuminance_of_the_weather() {
        let (patches, weather) = (SkyPatches::new(2), weather());
        let year = Year::new(&weather, &patches, 0.0, 0.2).unwrap();
        let [clear, overcast, night] = &year.hours[..] else { panic!("three hours") };
        for (hour, own) in [(&weather.hours[0], clear), (&weather.hours[1], overcast)] {
            let [diffuse, direct] = illuminances(hour, weather.sun(hour));
            let sum: f64 = (0..patches.count())
                .map(|patch| f64::from(own.sky[patch]) * patches.projected(patch))
                .sum();
            assert!((sum / diffuse - 1.0).abs() < 1e-5);
            // Efficacies are 90 to 150 lm/W.
            assert!((90.0..150.0).contains(&(diffuse / hour.diffuse)), "{diffuse}");
            assert_eq!(own.sky.len(), year.bins());
            assert_eq!(own.sun.is_some(), direct > 0.0);
        }
        assert!(night.sky.is_empty() && night.sun.is_none());
        assert_eq!(year.suns.len(), 1);
        // The sky is brightest around the sun.
        let sun = clear.sun.unwrap();
        let most = clear.sky[..patches.count()].iter().copied().fold(0.0, f32::max);
        let found = year.bin(sun.toward);
        assert!(clear.sky[found] > 0.5 * most);
    }

    #[test]
    fn turned_skies_turn_sun_and_bins() {
        let (patches, weather) = (SkyPatches::new(2), weather());
        let [straight, turned] = [0.0, 90.0].map(|turn| {
            let year = Year::new(&weather, &patches, turn, 0.2).unwrap();
            let toward = year.hours[0].sun.unwrap().toward;
            (year.bin(toward), toward)
        });
        assert_eq!(straight.0, turned.0);
        // South, +z, becomes east, +x.
        assert!((turned.1.x - straight.1.z).abs() < 1e-6, "{} {}", turned.1, straight.1);
    }
}
