//! The commands `gensky` and `gendaylit`: the sun and the brightness of a sky by place and time, as
//! the primitives that they print.
//!
//! Formulas are those of the programs: IES RP-21 for the position of the sun, the CIE and Matsuura
//! for skies of `gensky`, Perez (1990, 1993) for those of `gendaylit`.

use super::generators::Generated;
use super::tokens::Primitive;
use bdpm_core::base::error::{Error, Result};
use bdpm_light::sky::{LuminanceDistribution, SkyCondition, day_of_year, eccentricity};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Lumens of a watt of white light, and of those of the sky and the sun in `gensky`.
const WHITE: f64 = 179.0;
const SKY: f64 = 203.0;
const SUN: f64 = 208.0;

/// Luminance of the sun outside of the atmosphere, cd/m^2.
const SOLAR_LUMINANCE: f64 = 1.5e9;

/// Solid angle of the sun of `gensky`, sr, and half of the angle of that of `gendaylit`, degrees.
const SUN_SOLID_ANGLE: f64 = 6e-5;
const HALF_SUN: f64 = 0.2665;

/// Solid angle of the sun in the light of the ground of `gendaylit`, sr.
const SOLID_ANGLE: f64 = 6.8e-5;

/// Mean radiance of the overcast sky over the horizontal, over that of the zenith.
const OVERCAST: f64 = 0.777_778;

/// Clearness from which on a sky is clear.
const CLEAR: f64 = 6.0;

/// Height of the sun to which `gensky` lowers it, degrees.
const HIGHEST: f64 = 87.0;

/// Standard meridians of time zones, degrees west.
const ZONES: [(&str, f64); 20] = [
    ("YST", 135.0),
    ("YDT", 120.0),
    ("PST", 120.0),
    ("PDT", 105.0),
    ("MST", 105.0),
    ("MDT", 90.0),
    ("CST", 90.0),
    ("CDT", 75.0),
    ("EST", 75.0),
    ("EDT", 60.0),
    ("GMT", 0.0),
    ("BST", -15.0),
    ("CET", -15.0),
    ("CEST", -30.0),
    ("EET", -30.0),
    ("EEST", -45.0),
    ("GST", -60.0),
    ("JST", -135.0),
    ("NZST", -180.0),
    ("NZDT", -195.0),
];

/// When and where, and what else the commands have in common.
struct Request {
    /// Day of the year from 1, and hour, unless the angles of the sun are given.
    time: Option<(f64, f64)>,
    /// Whether the hour is that of the sun.
    is_solar_time: bool,
    /// Height and azimuth of the sun, radians; the azimuth is 0 in the south, positive in the west.
    angles: [f64; 2],
    /// Degrees north, and degrees west.
    latitude: f64,
    longitude: f64,
    meridian: f64,
    ground: f64,
    options: Vec<(String, Vec<f64>)>,
}

impl Default for Request {
    /// The place of the programs, without a time.
    fn default() -> Self {
        Self {
            time: None,
            is_solar_time: false,
            angles: [0.0; 2],
            latitude: 0.66f64.to_degrees(),
            longitude: 2.13f64.to_degrees(),
            meridian: 120.0,
            ground: 0.2,
            options: Vec::new(),
        }
    }
}

impl Request {
    /// The words after the name of a command. `valued` are options that have one number, `paired`
    /// those that have two, and `flags` those that have none.
    fn parse(
        words: std::vec::IntoIter<String>,
        [flags, valued, paired]: [&str; 3],
    ) -> Result<Self> {
        let words: Vec<String> = words.collect();
        let usage = |what: &str| {
            let advice = "give month, day and hour, or -ang and two angles, and then options; or run \
                          it, and put `!xform sky.rad` in its place";
            Error::new(format!("the command has {what}"), advice)
        };
        let number = |index: usize| {
            let given = words.get(index).and_then(|word| word.parse::<f64>().ok());
            given.filter(|own| own.is_finite()).ok_or_else(|| usage("a number that is missing"))
        };
        let mut own = Self::default();
        let mut has_zone = false;
        if words.first().is_some_and(|word| word == "-ang") {
            own.angles = [number(1)?.to_radians(), number(2)?.to_radians()];
        } else {
            let (month, day) = (number(0)?, number(1)?);
            if !(1.0..=12.0).contains(&month) || !(1.0..=31.0).contains(&day) {
                return Err(usage("no such day"));
            }
            let word = words.get(2).ok_or_else(|| usage("no hour"))?;
            let (hour, zone) = hour(word).ok_or_else(|| usage("no hour"))?;
            own.is_solar_time = word.starts_with('+');
            (own.meridian, has_zone) = (zone.unwrap_or(own.meridian), zone.is_some());
            own.time = Some((f64::from(day_of_year(month as u32, day as u32)), hour));
        }
        let mut at = 3;
        while let Some(word) = words.get(at) {
            let is_in = |list: &str| list.split(' ').any(|option| option == word);
            let count = match (is_in(flags), is_in(valued), is_in(paired)) {
                (true, ..) => 0,
                (_, true, _) => 1,
                (.., true) => 2,
                _ => return Err(usage(&format!("the option `{word}`"))),
            };
            let numbers = (0..count).map(|k| number(at + 1 + k)).collect::<Result<Vec<_>>>()?;
            match (&word[..], &numbers[..]) {
                ("-a", [degrees]) => own.latitude = *degrees,
                ("-o", [degrees]) => own.longitude = *degrees,
                ("-m", [degrees]) if !has_zone => own.meridian = *degrees,
                ("-g", [share]) => own.ground = share.clamp(0.0, 1.0),
                _ => {}
            }
            own.options.push((word.clone(), numbers));
            at += 1 + count;
        }
        own.angles = own.sun_angles();
        Ok(own)
    }

    /// Height and azimuth of the sun, radians.
    fn sun_angles(&self) -> [f64; 2] {
        let Some((day, hour)) = self.time else { return self.angles };
        let declination = 0.4093 * (TAU / 365.0 * (day - 81.0)).sin();
        let shift = 0.170 * (2.0 * TAU / 373.0 * (day - 80.0)).sin()
            - 0.129 * (TAU / 355.0 * (day - 8.0)).sin()
            + 12.0 / PI * (self.meridian - self.longitude).to_radians();
        let solar = hour + if self.is_solar_time { 0.0 } else { shift };
        let [(sin_lat, cos_lat), (sin, cos), (sin_hour, cos_hour)] =
            [self.latitude.to_radians(), declination, solar * PI / 12.0].map(f64::sin_cos);
        let height = (sin_lat * sin - cos_lat * cos * cos_hour).asin();
        let azimuth = -(cos * sin_hour).atan2(-cos_lat * sin - sin_lat * cos * cos_hour);
        [height, azimuth]
    }

    fn has(&self, options: &[&str]) -> bool {
        self.options.iter().any(|(name, _)| options.contains(&&name[..]))
    }

    fn value(&self, option: &str) -> Option<f64> {
        let found = self.options.iter().rev().find(|(name, _)| name == option);
        found.map(|(_, numbers)| numbers[0])
    }
}

/// Unit vector of a height and an azimuth, with +z up and +y in the north.
fn toward(angles: [f64; 2]) -> DVec3 {
    let [(up, across), (west, south)] = angles.map(f64::sin_cos);
    DVec3::new(-west * across, -south * across, up)
}

/// An hour such as `14`, `14:30`, `+14.5` or `14:30EDT`, with the meridian of its zone.
fn hour(word: &str) -> Option<(f64, Option<f64>)> {
    let word = word.strip_prefix('+').unwrap_or(word);
    let end = word.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(word.len());
    let (time, zone) = word.split_at(end);
    let hour = match time.split_once(':') {
        Some((hours, minutes)) => hours.parse::<f64>().ok()? + minutes.parse::<f64>().ok()? / 60.0,
        None => time.parse().ok()?,
    };
    if zone.is_empty() {
        return Some((hour, None));
    }
    let known = ZONES.iter().find(|(name, _)| name.eq_ignore_ascii_case(zone));
    known.map(|(_, meridian)| (hour, Some(*meridian)))
}

/// `gensky month day hour [options]`, or with `-ang altitude azimuth`.
pub fn gensky(words: std::vec::IntoIter<String>) -> Result<Generated> {
    let own = Request::parse(words, ["-s +s -c -u -i +i", "-t -b -B -r -R -g -a -o -m", ""])?;
    let last = own.options.iter().rev().find(|(_, numbers)| numbers.is_empty());
    let kind = last.map_or("+s", |(name, _)| &name[..]);
    let (number, is_overcast) = match kind {
        "-c" => (2.0, true),
        "-u" => (3.0, true),
        "-i" | "+i" => (4.0, false),
        _ => (1.0, false),
    };
    let height = own.angles[0];
    let highest = if is_overcast { FRAC_PI_2 } else { HIGHEST.to_radians() };
    let height = height.min(highest);
    let sun = toward([height, own.angles[1]]);
    let is_intermediate = number == 4.0;
    // Radiance of the sky over that of the zenith, mean over the horizontal.
    let (over_zenith, at_zenith) = match kind {
        "-u" => (1.0, 1.0),
        "-c" => (OVERCAST, 1.0),
        _ => normalization(height, sun.z, is_intermediate),
    };
    let zenith = match (own.value("-b"), own.value("-B")) {
        (_, Some(irradiance)) => irradiance / (over_zenith * PI),
        (Some(radiance), None) => radiance,
        (None, None) => {
            let overcast = 8.6 * sun.z + 0.123;
            let turbidity = own.value("-t").unwrap_or(2.45);
            let clear = (1.376 * turbidity - 1.81) * height.tan() + 0.38;
            let luminance = match (is_overcast, is_intermediate) {
                (true, _) => overcast,
                (false, true) => 0.5 * (clear + overcast),
                (false, false) => clear,
            };
            luminance.max(0.0) * 1000.0 / SKY
        }
    };
    let mut ground = zenith * over_zenith;
    let mut all = Vec::new();
    let given = own.value("-r").or(own.value("-R").map(|own| own / (SUN_SOLID_ANGLE * sun.z)));
    if !is_overcast && sun.z > 0.0 && given.is_none_or(|own| own > 0.0) {
        let through = 1.147 - 0.147 / sun.z.max(0.16);
        let haze = if is_intermediate { 0.15 } else { 1.0 };
        let radiance = given.unwrap_or(SOLAR_LUMINANCE / SUN * through * haze);
        ground += SUN_SOLID_ANGLE / PI * radiance * sun.z;
        if kind.starts_with('+') {
            all.extend(solar(radiance, sun, 0.5));
        }
    }
    ground *= own.ground;
    let mut numbers = vec![number, zenith, ground];
    if !is_overcast {
        numbers.extend([at_zenith, sun.x, sun.y, sun.z]);
    }
    all.push(pattern("skybr", "skybright.cal", numbers));
    Ok((all, Vec::new()))
}

/// Mean radiance of a clear or intermediate sky over the horizontal, over that of the zenith, and
/// the relative value at the zenith by which `skybright.cal` divides.
fn normalization(height: f64, sun_z: f64, is_intermediate: bool) -> (f64, f64) {
    let from_zenith = FRAC_PI_2 - height;
    let (at_zenith, polynomial) = if is_intermediate {
        let wave = 2.739 + 0.9891 * (0.3119 + 2.6 * height).sin();
        let fall = (-from_zenith * (0.4441 + 1.48 * height)).exp();
        (wave * fall, [3.5556, -2.7152, -1.3081, 1.0660, 0.60227])
    } else {
        let glow = 0.91 + 10.0 * (-3.0 * from_zenith).exp() + 0.45 * sun_z * sun_z;
        (0.274 * glow, [2.766521, 0.547665, -0.369832, 0.009237, 0.059229])
    };
    let x = (height - FRAC_PI_4) / FRAC_PI_4;
    let sum = polynomial.iter().rev().fold(0.0, |sum, factor| sum * x + factor);
    (sum / at_zenith / PI, at_zenith)
}

/// `gendaylit month day hour -W direct diffuse [options]`, or with `-ang altitude azimuth`.
pub fn gendaylit(words: std::vec::IntoIter<String>) -> Result<Generated> {
    let own = Request::parse(words, ["-s -w", "-g -a -o -m", "-W -L"])?;
    let last = own.options.iter().rev().find(|(_, numbers)| numbers.len() == 2);
    let Some((unit, numbers)) = last else {
        let advice = "give -W and the direct normal and diffuse horizontal irradiance, W/m2, or -L and \
                      both illuminances, lx; or run it, and put `!xform sky.rad` in its place";
        return Err(Error::new("`gendaylit` has no light", advice));
    };
    let (sun, day) = (toward(own.angles), own.time.map_or(0.0, |(day, _)| day));
    let [direct, diffuse] = [numbers[0].max(0.0), numbers[1].max(0.0)];
    if sun.z <= 0.0 || diffuse == 0.0 {
        // Below the horizon there is no light.
        return Ok((vec![pattern("skybr", "skybright.cal", vec![3.0, 0.0, 0.0])], Vec::new()));
    }
    // A frame with +y up.
    let in_sky = |toward: DVec3| DVec3::new(toward.x, toward.z, -toward.y);
    let pair = [diffuse, direct];
    let (condition, illuminances) = if unit == "-W" {
        let condition = SkyCondition::new(pair, in_sky(sun), eccentricity(day));
        let efficacy = condition.efficacy();
        (condition, [0, 1].map(|i| pair[i] * efficacy[i]))
    } else {
        (SkyCondition::of_illuminances(pair, in_sky(sun), eccentricity(day)), pair)
    };
    let sky = LuminanceDistribution::perez_relative(condition, in_sky(sun))?;
    let scale = illuminances[0] / sky.horizontal() / WHITE;
    let half = HALF_SUN.to_radians();
    let radiance = illuminances[1] / (TAU * (1.0 - half.cos())) / WHITE;
    // The ground has the light of a sky of `gensky` with this radiance at the zenith, as there.
    let over_zenith = match condition.clearness {
        clearness if clearness <= 1.0 => OVERCAST,
        clearness => normalization(own.angles[0], sun.z, clearness < CLEAR).0,
    };
    let of_sun = if condition.clearness > 1.0 { radiance * sun.z } else { 0.0 };
    let of_sky = scale * sky.radiance(DVec3::Y) * over_zenith;
    let ground = own.ground * (of_sky + SOLID_ANGLE / PI * of_sun);
    let mut all = Vec::new();
    if !own.has(&["-s"]) && radiance > 0.0 {
        all.extend(solar(radiance, sun, 2.0 * HALF_SUN));
    }
    let mut numbers = vec![scale, ground];
    numbers.extend(sky.coefficients());
    numbers.extend(sun.to_array());
    all.push(pattern("skybright", "perezlum.cal", numbers));
    Ok((all, Vec::new()))
}

/// The disc of the sun.
fn solar(radiance: f64, toward: DVec3, degrees: f64) -> [Primitive; 2] {
    let light = Primitive {
        modifier: "void".into(),
        kind: "light".into(),
        name: "solar".into(),
        numbers: vec![radiance; 3],
        ..Primitive::default()
    };
    let source = Primitive {
        modifier: "solar".into(),
        kind: "source".into(),
        name: "sun".into(),
        numbers: vec![toward.x, toward.y, toward.z, degrees],
        ..Primitive::default()
    };
    [light, source]
}

/// The brightness of the sky, which scenes give to their sources.
fn pattern(function: &str, file: &str, numbers: Vec<f64>) -> Primitive {
    Primitive {
        modifier: "void".into(),
        kind: "brightfunc".into(),
        name: "skyfunc".into(),
        words: vec![function.into(), file.into()],
        numbers,
        ..Primitive::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(
        command: fn(std::vec::IntoIter<String>) -> Result<Generated>,
        text: &str,
    ) -> Vec<Primitive> {
        let words: Vec<String> = text.split_whitespace().map(str::to_owned).collect();
        command(words.into_iter()).unwrap_or_else(|error| panic!("{error}")).0
    }

    /// The numbers of the sky, after those of the sun if there is one.
    fn numbers(all: &[Primitive]) -> Vec<f64> {
        let [sun @ .., sky] = all else { panic!("no sky") };
        let sun = sun.iter().flat_map(|own| own.numbers[..1].to_vec());
        sun.take(1).chain(sky.numbers.iter().copied()).collect()
    }

    #[track_caller]
    fn assert_near(found: &[f64], expected: &[f64], relative: f64) {
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (own, other) in found.iter().zip(expected) {
            assert!((own - other).abs() <= relative * other.abs() + 2e-4, "{found:?} {expected:?}");
        }
    }

    /// What the programs of Radiance print, with three digits.
    #[test]
    fn skies_are_those_of_the_programs() {
        for (text, expected) in [
            ("6 21 11 +s", &[7.139e6, 1.0, 22.25, 28.77, 1.285, 0.274197, -0.222375, 0.935610][..]),
            (
                "12 21 14:30CET +i -a 48.1 -o -11.6",
                &[4.726e5, 4.0, 6.438, 1.881, 1.25, -0.523302, -0.826620, 0.207010],
            ),
            ("3 1 +10 -c -a 52 -g .3", &[2.0, 18.14, 4.233]),
            ("3 1 10 -u -a 52", &[3.0, 16.89, 3.378]),
            ("-ang 40 -30 -s -t 4", &[1.0, 17.14, 22.15, 0.5002, 0.383022, -0.663414, 0.642788]),
            (
                "9 10 9EST -s -B 100 -a 42 -o 71",
                &[1.0, 17.78, 21.72, 0.4749, 0.645311, -0.454160, 0.614258],
            ),
        ] {
            assert_near(&numbers(&run(gensky, text)), expected, 2e-3);
        }
    }

    /// `gendaylit` integrates its skies over 145 directions: 4 %.
    #[test]
    fn skies_of_weather_are_those_of_the_program() {
        for (text, expected) in [
            (
                "6 21 11 -W 600 150",
                &[
                    5.082e6, 37.48, 26.25, -0.953889, -0.216895, 17.263144, -3.932805, 0.677188,
                    0.274197, -0.222375, 0.935610,
                ][..],
            ),
            (
                "12 21 14 -a 48.1 -o -11.6 -m -15 -W 300 60 -g .3",
                &[
                    1.842e6, 22.37, 5.639, -0.956928, -0.290975, 12.305576, -3.318593, 0.057023,
                    -0.420472, -0.872662, 0.248321,
                ],
            ),
            (
                "-ang 30 20 -W 0 180",
                &[
                    18.35, 6.141, 0.633149, -0.476170, 1.318220, -0.855491, 0.023996, -0.296198,
                    -0.813798, 0.5,
                ],
            ),
            (
                "-ang 55 -40 -L 60000 15000",
                &[
                    4.932e6, 33.68, 21.44, -0.968932, -0.210793, 15.953088, -3.932372, 0.666335,
                    0.368688, -0.439385, 0.819152,
                ],
            ),
        ] {
            let found = numbers(&run(gendaylit, text));
            let sky = expected.len() - 10;
            assert_near(&found[..sky], &expected[..sky], 0.01);
            assert_near(&found[sky..sky + 2], &expected[sky..sky + 2], 0.04);
            assert_near(&found[sky + 2..], &expected[sky + 2..], 0.01);
        }
        assert_eq!(numbers(&run(gendaylit, "6 21 23 -W 0 0")), [3.0, 0.0, 0.0], "by night");
        let sunless = run(gendaylit, "6 21 11 -W 600 150 -s");
        assert_eq!(sunless.len(), 1);
    }

    #[test]
    fn unknown_options_and_hours_are_refused() {
        for (command, text) in [
            (gensky as fn(_) -> _, "6 21"),
            (gensky, "6 21 noon"),
            (gensky, "13 1 12"),
            (gensky, "6 21 12 -q"),
            (gensky, "6 21 12 -a"),
            (gendaylit, "6 21 12"),
            (gendaylit, "6 21 12 -W 100"),
        ] {
            let words: Vec<String> = text.split_whitespace().map(str::to_owned).collect();
            assert!(command(words.into_iter()).is_err(), "{text}");
        }
    }
}
