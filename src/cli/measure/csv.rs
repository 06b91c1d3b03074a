//! A measurement as a table of comma-separated values.

use bdpm::Measurement;
use bdpm::base::atomic::write_atomically;
use bdpm::base::error::{Error, Result};
use bdpm::measurement::Reading;
use std::path::Path;

/// Writes one row per meter, and one per meter and group of lights if they were measured apart.
pub fn write(path: &Path, measurement: &Measurement) -> Result<()> {
    let table = table(measurement).map_err(|error| Error::io("write", path, error.into()))?;
    write_atomically(path, |file| file.write_all(&table))
}

fn table(measurement: &Measurement) -> csv::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record([
        "name", "row", "column", "lights", "unit", "value", "expanded", "noise", "bias", "direct",
        "indirect",
    ])?;
    for set in &measurement.sets {
        let all = std::iter::once(("all", &set.readings));
        let groups = set.groups.iter().map(|(name, readings, _)| (&name[..], readings));
        for (lights, readings) in all.chain(groups) {
            for (index, reading) in (0..).zip(readings) {
                let (row, column) = (index / set.grid[0], index % set.grid[0]);
                let Reading { value, noise, bias, expanded, direct } = *reading;
                let numbers = [value, expanded, noise, bias, direct, reading.indirect()];
                let places = [row, column].map(|index| index.to_string());
                let texts =
                    [&set.name, &places[0], &places[1], lights, set.unit()].map(str::to_owned);
                let fields = texts.into_iter().chain(numbers.map(|number| number.to_string()));
                writer.write_record(fields)?;
            }
        }
    }
    writer.into_inner().map_err(|error| csv::Error::from(error.into_error()))
}
