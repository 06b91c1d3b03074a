//! The position of the sun by place and time: Blanco-Muriel et al., *Computing the Solar Vector*,
//! Solar Energy 70 (2001).

/// A place and a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceAndTime {
    /// Degrees, north is positive.
    pub latitude: f64,
    /// Degrees, east is positive.
    pub longitude: f64,
    /// Hours that the clock is ahead of Universal Time.
    pub timezone: f64,
    /// Year of the Gregorian calendar.
    pub year: i32,
    /// From 1.
    pub month: i32,
    /// From 1.
    pub day: i32,
    /// Decimal hours of the clock.
    pub hours: f64,
}

/// Days before each month of a year that is no leap year.
const DAYS: [u32; 12] = [0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334];

/// Number of a day in a year that is no leap year, from 1. Months are counted from 1 and limited to
/// 12.
pub fn day_of_year(month: u32, day: u32) -> u32 {
    DAYS[(month.clamp(1, 12) - 1) as usize] + day
}

/// Mean radius of the earth over an astronomical unit.
const PARALLAX: f64 = 6371.01 / 149_597_890.0;

/// Squared ratio of the mean distance to the sun to the distance on a day: Spencer, *Fourier Series
/// Representation of the Position of the Sun* (1971). `day` counts from 1 in a year.
pub fn eccentricity(day: f64) -> f64 {
    let angle = std::f64::consts::TAU * (day - 1.0) / 365.0;
    let (sin, cos) = angle.sin_cos();
    let (sin2, cos2) = (2.0 * angle).sin_cos();
    1.000_11 + 0.034_221 * cos + 0.001_28 * sin + 0.000_719 * cos2 + 0.000_077 * sin2
}

impl PlaceAndTime {
    /// Angle of the sun from the zenith, and its azimuth, clockwise from the north as seen from
    /// above, radians.
    pub fn sun(&self) -> [f64; 2] {
        let hours = self.hours - self.timezone;
        // Julian days from noon of 1 January 2000
        let [year, month, day] = [self.year, self.month, self.day].map(i64::from);
        let early = (month - 14) / 12;
        let julian = (1461 * (year + 4800 + early)) / 4 + (367 * (month - 2 - 12 * early)) / 12
            - (3 * ((year + 4900 + early) / 100)) / 4
            + day
            - 32_075;
        let days = julian as f64 - 0.5 + hours / 24.0 - 2_451_545.0;

        let omega = 2.1429 - 0.001_039_459_4 * days;
        let mean_longitude = 4.895_063 + 0.017_202_791_698 * days;
        let anomaly = 6.240_06 + 0.017_201_969_9 * days;
        let ecliptic_longitude =
            mean_longitude + 0.033_416_07 * anomaly.sin() + 0.000_348_94 * (2.0 * anomaly).sin()
                - 0.000_113_4
                - 0.000_020_3 * omega.sin();
        let obliquity = 0.409_092_8 - 6.214e-9 * days + 0.000_039_6 * omega.cos();

        let (sin, cos) = ecliptic_longitude.sin_cos();
        let right_ascension = (obliquity.cos() * sin).atan2(cos);
        let declination = (obliquity.sin() * sin).asin();

        let sidereal_hours = 6.697_424_324_2 + 0.065_709_828_3 * days + hours;
        let hour_angle = (sidereal_hours * 15.0 + self.longitude).to_radians() - right_ascension;
        let (sin_latitude, cos_latitude) = self.latitude.to_radians().sin_cos();
        let height =
            cos_latitude * hour_angle.cos() * declination.cos() + declination.sin() * sin_latitude;
        let zenith = height.clamp(-1.0, 1.0).acos();
        let north = declination.tan() * cos_latitude - sin_latitude * hour_angle.cos();
        let azimuth = (-hour_angle.sin()).atan2(north);
        [zenith + PARALLAX * zenith.sin(), azimuth]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sun_is_in_the_south_at_noon_and_as_high_as_latitude_and_season_give() {
        // Equinox and solstice at Greenwich's longitude, at the solar noon by the equation of time.
        let noon = |month, day, hours, latitude| {
            let (longitude, timezone, year) = (0.0, 0.0, 2024);
            PlaceAndTime { latitude, longitude, timezone, year, month, day, hours }.sun()
        };
        for (month, day, hours, declination) in
            [(3, 20, 12.0 + 7.4 / 60.0, 0.15), (6, 20, 12.0 + 1.6 / 60.0, 23.43)]
        {
            let [zenith, azimuth] = noon(month, day, hours, 50.0);
            assert!((zenith.to_degrees() - (50.0 - declination)).abs() < 0.15, "{zenith}");
            assert!((azimuth.to_degrees().abs() - 180.0).abs() < 0.5, "{azimuth}");
            // In the afternoon it is in the west.
            assert!((-170.0..-10.0).contains(&noon(month, day, 16.0, 50.0)[1].to_degrees()));
        }
    }
}
