//! A measurement as a table of comma-separated values.

use bdpm::Measurement;
use bdpm::base::atomic::write_atomically;
use bdpm::base::error::{Error, Result};
use bdpm::base::names::visible;
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
        "indirect", "x", "y", "z",
    ])?;
    for set in &measurement.sets {
        let all = std::iter::once(("all", &set.readings));
        let groups = set.groups.iter().map(|(name, readings, _)| (&name[..], readings));
        for (lights, readings) in all.chain(groups) {
            for ((index, reading), place) in (0..).zip(readings).zip(&set.places) {
                let (row, column) = (index / set.grid[0], index % set.grid[0]);
                let Reading { value, noise, bias, expanded, direct } = *reading;
                let numbers = [value, expanded, noise, bias, direct, reading.indirect()];
                let [row, column] = [row, column].map(|index| index.to_string());
                let texts =
                    [as_text(&set.name), row, column, as_text(lights), set.unit().to_owned()];
                // Readings and uncertainties that are unknown are empty.
                let field = |number: f64| {
                    if number.is_finite() { number.to_string() } else { String::new() }
                };
                let position = place.position.to_array().map(|number| number.to_string());
                let fields = texts.into_iter().chain(numbers.map(field)).chain(position);
                writer.write_record(fields)?;
            }
        }
    }
    writer.into_inner().map_err(|error| csv::Error::from(error.into_error()))
}

/// Starts of formulas in spreadsheets. Those of East Asia take wide characters for narrow ones.
const FORMULA: [char; 11] = ['=', '+', '-', '@', '\t', '\r', '\n', '＝', '＋', '－', '＠'];

/// A name as a field that spreadsheets read as text. An apostrophe precedes names that begin like a
/// formula. Characters that control a terminal or the direction of text are replaced.
pub fn as_text(name: &str) -> String {
    let shown: String = name.chars().map(visible).collect();
    if name.starts_with(FORMULA) { format!("'{shown}") } else { shown }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm::measurement::SetReadings;
    use bdpm::scene::MeterKind;
    use std::time::Duration;

    #[test]
    fn unknown_readings_are_empty() {
        let set = SetReadings::single("desk", MeterKind::Irradiance, Reading::unknown());
        let table = String::from_utf8(table(&measurement(vec![set])).unwrap()).unwrap();
        assert!(table.lines().any(|row| row == "desk,0,0,all,lx,,,,,,,0,0,0"), "{table}");
    }

    fn measurement(sets: Vec<SetReadings>) -> Measurement {
        Measurement {
            sets,
            reached: true,
            time: Duration::ZERO,
            techniques: Vec::new(),
            warnings: Vec::new(),
        }
    }

    #[test]
    fn names_that_begin_like_a_formula_have_an_apostrophe() {
        let reading = Reading { value: -2.5, noise: 0.0, bias: 0.0, expanded: 0.0, direct: 1.0 };
        let set = |name: &str| {
            let mut set = SetReadings::single(name, MeterKind::Irradiance, reading);
            set.groups = vec![("@lamp".to_owned(), vec![reading], reading)];
            set
        };
        let names = ["=cmd", "+1", "-1", "@SUM", "\tx", "desk", "a=b", "'=1", "＝1", "a\u{202e}b"];
        let measurement = measurement(names.map(set).into());
        let table = String::from_utf8(table(&measurement).unwrap()).unwrap();
        let rows: Vec<&str> = table.lines().skip(1).collect();
        let expected =
            ["'=cmd", "'+1", "'-1", "'@SUM", "'\tx", "desk", "a=b", "'=1", "'＝1", "a\u{fffd}b"];
        assert_eq!(rows.len(), 2 * expected.len(), "{table}");
        for (rows, name) in rows.chunks(2).zip(expected) {
            assert!(rows[0].starts_with(&format!("{name},0,0,all,lx,-2.5,")), "{table}");
            assert!(rows[1].starts_with(&format!("{name},0,0,'@lamp,lx,-2.5,")), "{table}");
        }
    }
}
