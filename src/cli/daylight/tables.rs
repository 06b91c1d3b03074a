//! Daylight of a year as JSON and as a table of comma-separated values.

use super::Args;
use crate::cli::measure::as_text;
use bdpm::base::atomic::write_atomically;
use bdpm::base::error::{Error, Result};
use bdpm::daylight::{DaylightSet, DaylightYear, PointYear};
use bdpm::measurement::Estimated;
use serde::Serialize;
use std::path::Path;

/// Daylight of a year. Shares are percent, and `expanded` is half of the width of an interval.
#[derive(Serialize)]
pub struct YearReport<'a> {
    scene: &'a str,
    weather: &'a str,
    /// Illuminance of daylight autonomy, lx, and the hours of the clock that count.
    autonomy_lx: f64,
    occupied: [f64; 2],
    occupied_hours: usize,
    /// Probability of the intervals of single hours.
    probability: f64,
    paths: u64,
    seconds: f64,
    meters: Vec<SetReport<'a>>,
}

#[derive(Serialize)]
struct SetReport<'a> {
    name: &'a str,
    columns: u32,
    rows: u32,
    /// Points with autonomy in half of the hours.
    spatial_autonomy: Estimated,
    /// Points with over 250 hours of direct sun of over 1000 lx.
    sunlight_exposure: f64,
    mean: Estimated,
    /// Row by row.
    positions: Vec<[f64; 3]>,
    points: &'a [PointYear],
    /// Mean illuminance by month and hour of the clock, lx.
    by_month: Vec<Vec<f64>>,
}

impl<'a> YearReport<'a> {
    pub fn new(scene: &'a str, args: &Args, year: &'a DaylightYear) -> Self {
        let of_set = |set: &'a DaylightSet| SetReport {
            name: &set.name,
            columns: set.grid[0],
            rows: set.grid[1],
            spatial_autonomy: set.spatial_autonomy,
            sunlight_exposure: set.sunlight_exposure,
            mean: set.mean,
            positions: set.places.iter().map(|place| place.position.to_array()).collect(),
            points: &set.points,
            by_month: set.by_month().iter().map(|hours| hours.to_vec()).collect(),
        };
        Self {
            scene,
            weather: &year.place,
            autonomy_lx: args.autonomy,
            occupied: args.occupied,
            occupied_hours: year.occupied_hours,
            probability: 0.95,
            paths: year.paths,
            seconds: year.time.as_secs_f64(),
            meters: year.sets.iter().map(of_set).collect(),
        }
    }
}

/// Writes one row per meter.
pub fn write_csv(path: &Path, year: &DaylightYear) -> Result<()> {
    let table = table(year).map_err(|error| Error::io("write", path, error.into()))?;
    write_atomically(path, |file| file.write_all(&table))
}

fn table(year: &DaylightYear) -> csv::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let estimates = [
        "autonomy",
        "below_100",
        "100_to_300",
        "300_to_3000",
        "above_3000",
        "mean",
        "kilowatt_hours",
    ];
    let mut names = ["name", "row", "column"].map(str::to_owned).to_vec();
    for name in estimates {
        names.extend([name.to_owned(), format!("{name}_expanded")]);
    }
    names.extend(["sun_hours", "x", "y", "z"].map(str::to_owned));
    writer.write_record(names)?;
    for set in &year.sets {
        for ((index, point), place) in (0..).zip(&set.points).zip(&set.places) {
            let (row, column) = (index / set.grid[0], index % set.grid[0]);
            let PointYear { autonomy, useful, mean, sun_hours, irradiation, .. } = point;
            let mut fields = vec![as_text(&set.name), row.to_string(), column.to_string()];
            for own in [autonomy].into_iter().chain(useful).chain([mean, irradiation]) {
                fields.extend([own.value, own.expanded].map(|number| number.to_string()));
            }
            fields.push(sun_hours.to_string());
            fields.extend(place.position.to_array().map(|number| number.to_string()));
            writer.write_record(fields)?;
        }
    }
    writer.into_inner().map_err(|error| csv::Error::from(error.into_error()))
}
