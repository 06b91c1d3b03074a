//! Weather of a year: files in the format of EnergyPlus (EPW).

use crate::sky::PlaceAndTime;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::input::read_text;
use glam::DVec3;
use std::path::Path;

/// Lines before the hours.
const HEADER: usize = 8;

/// Fields of an hour that are read: `[month, day, hour]`, and diffuse and direct irradiance.
const FIELDS: usize = 16;

/// An irradiance that is missing has this value or more, W/m^2.
const MISSING: f64 = 9999.0;

/// Irradiances above this are errors, W/m^2.
const MOST: f64 = 1500.0;

/// Weather of a year at a place.
#[derive(Clone, Debug, PartialEq)]
pub struct Weather {
    /// City and country.
    pub place: String,
    /// Degrees, north is positive.
    pub latitude: f64,
    /// Degrees, east is positive.
    pub longitude: f64,
    /// Hours that the clock is ahead of Universal Time.
    pub timezone: f64,
    /// All hours, in the order of the file.
    pub hours: Vec<WeatherHour>,
}

/// An hour of weather.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeatherHour {
    /// From 1.
    pub month: u32,
    /// From 1.
    pub day: u32,
    /// Hours of the clock in the middle of the hour, such as 12.5.
    pub middle: f64,
    /// Irradiance of the horizontal by the sky over the whole solar spectrum, W/m^2.
    pub diffuse: f64,
    /// Irradiance by the sun of a surface that faces it, W/m^2.
    pub direct: f64,
}

impl Weather {
    /// Reads an `.epw` file.
    ///
    /// # Errors
    /// Names the line that is not one of this format.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(path, &read_text(path)?)
    }

    /// Parses the text of an `.epw` file; errors name `path` as its file.
    ///
    /// # Errors
    /// Names the line that is not one of this format.
    pub fn parse(path: &Path, text: &str) -> Result<Self> {
        let mut lines = text.lines().zip(1..);
        let first = lines.next().map_or("", |(line, _)| line);
        let fields: Vec<&str> = first.split(',').map(str::trim).collect();
        let of_place = |index: usize, most: f64| {
            let number: Option<f64> = fields.get(index).and_then(|own| own.parse().ok());
            number.filter(|own| own.abs() <= most)
        };
        let place = (of_place(6, 90.0), of_place(7, 180.0), of_place(8, 14.0));
        let (Some(latitude), Some(longitude), Some(timezone)) = place else {
            let advice = "give a file that begins with LOCATION, city, state, country, source, station, latitude, \
                          longitude and timezone";
            return Err(Error::new("this is no EPW weather file", advice).at(path).line(1, first));
        };
        if fields[0] != "LOCATION" {
            let advice = "give a file whose first line begins with LOCATION";
            return Err(Error::new("this is no EPW weather file", advice).at(path).line(1, first));
        }
        let hours = lines.skip(HEADER - 1).filter(|(line, _)| !line.trim().is_empty());
        let hours = hours.map(|(line, number)| {
            WeatherHour::parse(line).map_err(|error| error.at(path).line(number, line))
        });
        let hours = hours.collect::<Result<Vec<_>>>()?;
        if hours.is_empty() {
            let problem = "the weather file has no hours";
            let advice = "give a file with a line for each hour of a year";
            return Err(Error::new(problem, advice).at(path));
        }
        let place = format!("{}, {}", fields[1], fields[3]);
        Ok(Self { place, latitude, longitude, timezone, hours })
    }

    /// The unit vector toward the sun in the middle of an hour, in a frame with +y up, +x east and
    /// -z north. Files join months of different years, so the year is a common one.
    pub fn sun(&self, hour: &WeatherHour) -> DVec3 {
        let Self { latitude, longitude, timezone, .. } = *self;
        let (month, day) = (hour.month as i32, hour.day as i32);
        let (year, hours) = (COMMON_YEAR, hour.middle);
        let at = PlaceAndTime { latitude, longitude, timezone, year, month, day, hours };
        let [zenith, azimuth] = at.sun();
        let (across, up) = zenith.sin_cos();
        DVec3::new(across * azimuth.sin(), up, -across * azimuth.cos())
    }
}

/// A year that is no leap year.
const COMMON_YEAR: i32 = 2023;

impl WeatherHour {
    fn parse(line: &str) -> Result<Self> {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        if fields.len() < FIELDS {
            let advice = "give a line of 35 fields, of which the 14th to 16th are irradiances";
            return Err(Error::new(format!("an hour has {} fields", fields.len()), advice));
        }
        let number = |index: usize, name: &str, most: f64| -> Result<f64> {
            let own: Option<f64> = fields[index].parse().ok();
            own.filter(|own| (0.0..=most).contains(own)).ok_or_else(|| {
                let problem = format!("the {name} of an hour is `{}`", fields[index]);
                Error::new(problem, format!("give a number from 0 to {most}"))
            })
        };
        let irradiance = |index: usize, name: &str| -> Result<f64> {
            match fields[index].parse::<f64>() {
                Ok(own) if own >= MISSING => Ok(0.0),
                _ => number(index, name, MOST),
            }
        };
        let hour = number(3, "hour", 24.0)?;
        Ok(Self {
            month: number(1, "month", 12.0)?.max(1.0) as u32,
            day: number(2, "day", 31.0)?.max(1.0) as u32,
            // The irradiances of the hour 1 are those from 0:00 to 1:00.
            middle: (hour - 0.5).max(0.0),
            diffuse: irradiance(15, "diffuse irradiance")?,
            direct: irradiance(14, "direct irradiance")?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOCATION: &str = "LOCATION,Denver,CO,USA,TMY,724666,39.74,-105.18,-7.0,1829";

    fn parse(text: &str) -> Result<Weather> {
        Weather::parse(Path::new("a.epw"), text)
    }

    fn file(hours: &str) -> String {
        format!("{LOCATION}\n{}{hours}", "HEADER\n".repeat(HEADER - 1))
    }

    #[test]
    fn hours_have_their_irradiances_and_suns() {
        let hour = "1999,6,21,13,60,A,20,10,40,82000,1300,1350,300,900,850,120,0,0";
        let missing = "1999,12,1,1,60,A,20,10,40,82000,0,0,300,9999,9999,9999";
        let weather = parse(&file(&format!("{hour}\n{missing}\n"))).unwrap();
        assert_eq!((weather.latitude, weather.timezone), (39.74, -7.0));
        assert_eq!(weather.place, "Denver, USA");
        let [noon, night] = &weather.hours[..] else { panic!("two hours") };
        assert_eq!((noon.month, noon.day, noon.middle), (6, 21, 12.5));
        assert_eq!((noon.diffuse, noon.direct), (120.0, 850.0));
        assert_eq!((night.diffuse, night.direct), (0.0, 0.0));
        // 28 minutes after noon, at the declination of 23.44 degrees: sin h = sin phi sin delta +
        // cos phi cos delta cos H.
        let sun = weather.sun(noon);
        assert!((sun.y.asin().to_degrees() - 72.72).abs() < 0.1 && sun.z > 0.2, "{sun}");
        assert!(weather.sun(night).y < 0.0);
    }

    #[test]
    fn other_files_are_refused_with_their_line() {
        let refused = |text: &str| parse(text).unwrap_err().to_string();
        assert!(refused("").contains("no EPW weather file"));
        assert!(refused("DESIGN,a,b,c,d,e,1,2,3").contains("no EPW weather file"));
        assert!(refused(LOCATION).contains("no hours"));
        assert!(refused(&file("1999,6,21,13,60\n")).contains("5 fields"));
        let text = "1999,6,21,x,60,A,20,10,40,82000,0,0,300,900,850,120";
        let error = refused(&file(text));
        assert!(error.contains("a.epw:9: the hour of an hour is `x`"), "{error}");
        let text = "1999,6,21,13,60,A,20,10,40,82000,0,0,300,900,850,-120";
        assert!(refused(&file(text)).contains("diffuse irradiance"));
    }
}
