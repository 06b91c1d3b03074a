//! Tables of meters in files of their own: CSV, TOML, or the points of Radiance's `rtrace`.

use crate::read::extension;
use crate::read::toml::keys::meters_alone;
use crate::text;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::{Meter, MeterKind, MeterSet, Scene};
use glam::DVec3;
use std::path::Path;

/// Columns that every table has, in this order.
const COLUMNS: [&str; 7] = ["name", "x", "y", "z", "nx", "ny", "nz"];

/// Column of the opening angle of meters of luminance, degrees. Without it, or where it is empty,
/// meters measure illuminance.
const OPENING: &str = "opening_deg";

/// Reads meters of a scene from a file: `[[meter]]` tables of a `.toml` file, the rows of a `.csv`
/// file with a header `name,x,y,z,nx,ny,nz` and optionally `opening_deg`, or the lines of a `.pts`
/// file, six numbers each, as `rtrace -I` reads them. Positions are in the coordinates of the
/// scene's file.
///
/// # Errors
/// If the file cannot be read, or a row is not valid; names its line.
pub fn read_meters(path: &Path, scene: &Scene) -> Result<Vec<MeterSet>> {
    let (content, origin) = (text::read(path)?, scene.file_origin());
    match &extension(path)[..] {
        "toml" => meters_alone(path, &content, origin),
        "csv" => parse_csv(path, &content, origin),
        "pts" => parse_points(path, &content, origin),
        _ => {
            let problem = "the table of meters is neither a .csv nor a .toml nor a .pts file";
            Err(Error::new(problem, "give a file ending in .csv, .toml or .pts").at(path))
        }
    }
}

/// Reads meters of a scene from the text of `[[meter]]` tables; errors name `origin` as their file.
///
/// # Errors
/// Names the line of a table that is not valid.
pub fn parse_meters(origin: &Path, text: &str, scene: &Scene) -> Result<Vec<MeterSet>> {
    meters_alone(origin, text, scene.file_origin())
}

fn parse_csv(path: &Path, content: &str, origin: DVec3) -> Result<Vec<MeterSet>> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(content.as_bytes());
    let header = reader.headers().map_err(|error| csv_error(path, &error))?.clone();
    let names: Vec<&str> = header.iter().collect();
    let has_opening = match &names[..] {
        [known @ .., last] if known == COLUMNS && *last == OPENING => true,
        known if known == COLUMNS => false,
        _ => {
            let problem = format!("the columns are `{}`", names.join(","));
            let advice = format!("use `{}`, and optionally `{OPENING}`", COLUMNS.join(","));
            return Err(Error::new(problem, advice).at(path).line(1, names.join(",")));
        }
    };
    let mut sets = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| csv_error(path, &error))?;
        let line = record.position().map_or(0, |position| position.line() as usize);
        let row = || record.iter().collect::<Vec<_>>().join(",");
        let place = |error: Error| error.at(path).line(line, row());
        sets.push(set(&record, has_opening, origin).map_err(place)?);
    }
    if sets.is_empty() {
        return Err(Error::new("the table has no meters", "add a row for each meter").at(path));
    }
    Ok(sets)
}

/// Meters of illuminance at the lines of a text: position and direction of each.
fn parse_points(path: &Path, content: &str, origin: DVec3) -> Result<Vec<MeterSet>> {
    let mut sets = Vec::new();
    for (index, line) in content.lines().enumerate() {
        let words: Vec<&str> = line.split_whitespace().collect();
        if words.is_empty() || words[0].starts_with('#') {
            continue;
        }
        let place = |error: Error| error.at(path).line(index + 1, line);
        let numbers: Option<Vec<f64>> = words.iter().map(|word| word.parse().ok()).collect();
        let Some(&[x, y, z, nx, ny, nz]) = numbers.as_deref() else {
            let advice = "give six numbers: a position and a direction";
            return Err(place(Error::new("the line is no point with its direction", advice)));
        };
        let position = (DVec3::new(x, y, z) - origin).as_vec3();
        let meter = Meter::irradiance(position, DVec3::new(nx, ny, nz).as_vec3()).map_err(place)?;
        let name = format!("point {}", sets.len() + 1);
        sets.push(MeterSet::single(&name, MeterKind::Irradiance, meter));
    }
    if sets.is_empty() {
        return Err(Error::new("the file has no points", "add a line for each meter").at(path));
    }
    Ok(sets)
}

fn set(record: &csv::StringRecord, has_opening: bool, origin: DVec3) -> Result<MeterSet> {
    let number = |column: usize| {
        record[column].parse::<f64>().map_err(|_| {
            let name = COLUMNS.get(column).unwrap_or(&OPENING);
            let problem = format!("`{name}` is `{}`", &record[column]);
            Error::new(problem, "give a number")
        })
    };
    let vector = |first: usize| {
        Ok::<_, Error>(DVec3::new(number(first)?, number(first + 1)?, number(first + 2)?))
    };
    let (position, normal) = ((vector(1)? - origin).as_vec3(), vector(4)?.as_vec3());
    if has_opening && !record[COLUMNS.len()].is_empty() {
        let half = (0.5 * number(COLUMNS.len())? as f32).to_radians();
        let meter = Meter::radiance(position, normal, half)?;
        return Ok(MeterSet::single(&record[0], MeterKind::Radiance, meter));
    }
    let meter = Meter::irradiance(position, normal)?;
    Ok(MeterSet::single(&record[0], MeterKind::Irradiance, meter))
}

/// An error of the reader, with its line if it has one.
fn csv_error(path: &Path, error: &csv::Error) -> Error {
    let advice = "give each row as many fields as the header has";
    let problem = Error::new(format!("the table is not valid: {error}"), advice).at(path);
    match error.position() {
        Some(position) => problem.line(position.line() as usize, ""),
        None => problem,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn parse(content: &str) -> Result<Vec<MeterSet>> {
        parse_csv(Path::new("m.csv"), content, DVec3::ZERO)
    }

    #[test]
    fn rows_are_meters_of_illuminance_or_luminance() {
        let text = "name, x, y, z, nx, ny, nz, opening_deg\ndesk, 1, 2.5, -3, 0, 0, 2,\n\"a, b\",0,0,0,0,1,0,20\n";
        let sets = parse(text).unwrap();
        let desk = &sets[0];
        assert_eq!((&desk.name[..], desk.kind, desk.grid), ("desk", MeterKind::Irradiance, [1, 1]));
        let Meter { position, normal, .. } = desk.meters[0];
        assert_eq!((position, normal), (Vec3::new(1.0, 2.5, -3.0), Vec3::Z));
        assert_eq!((&sets[1].name[..], sets[1].kind), ("a, b", MeterKind::Radiance));
        assert!((sets[1].meters[0].half_angle.to_degrees() - 10.0).abs() < 1e-5);
    }

    #[test]
    fn lines_of_points_are_meters_of_illuminance() {
        let parse = |text: &str| parse_points(Path::new("a.pts"), text, DVec3::X);
        let sets = parse("# a comment\n1 2 3  0 0 1\n\n4\t5\t6\t0\t0\t-2\n").unwrap();
        assert_eq!(sets.len(), 2);
        let Meter { position, normal, .. } = sets[1].meters[0];
        assert_eq!((position, normal), (Vec3::new(3.0, 5.0, 6.0), -Vec3::Z));
        assert_eq!(sets[1].name, "point 2");
        for (text, line) in [("1 2 3 0 0 1\n1 2 3 0 0\n", 2), ("1 2 3 0 0 x\n", 1), ("\n", 0)] {
            assert_eq!(parse(text).unwrap_err().line_number().unwrap_or(0), line, "{text}");
        }
    }

    #[test]
    fn bad_tables_name_the_line() {
        let header = "name,x,y,z,nx,ny,nz\n";
        for (rows, line, problem) in [
            ("", 0, "no meters"),
            ("a,1,2,3,0,0,1\nb,1,2,3,0,0,x\n", 3, "`nz` is `x`"),
            ("a,1,2,3,0,0,0\n", 2, "faces"),
            ("a,1,2,3\n", 2, "not valid"),
            ("a,1,2,inf,0,0,1\n", 2, "inf"),
        ] {
            let error = parse(&format!("{header}{rows}")).unwrap_err();
            let text = error.to_string();
            assert!(text.contains(problem) && text.contains("m.csv"), "{text}");
            assert_eq!(error.line_number().unwrap_or(0), line, "{text}");
        }
        let text = parse("name,x,y\na,1,2\n").unwrap_err().to_string();
        assert!(text.contains("the columns are `name,x,y`"), "{text}");
    }
}
