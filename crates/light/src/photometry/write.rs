//! Writing distributions as IES LM-63-2002 and EULUMDAT files.

use super::opening::OpeningShape;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::{IntensityDistribution, Photometry};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::fmt::Write;

/// Longest line of an IES file of 2002, characters.
const LINE: usize = 120;

/// Facts about a luminaire besides its distribution.
#[derive(Clone, Debug, PartialEq)]
pub struct LuminaireDescription {
    /// Name of the luminaire.
    pub name: String,
    /// Origin of the data, such as the program that computed them.
    pub origin: String,
    /// Luminous opening.
    pub opening: OpeningShape,
    /// Flux of the lamps, lm; `None` for absolute photometry.
    pub lamp_lumens: Option<f64>,
    /// Electric power, W.
    pub watts: f64,
}

/// A text that stays within its line.
fn on_one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(LINE).collect()
}

/// The number of degrees that [`f64::to_radians`] turns into these radians after adding `offset`,
/// if there is one.
fn degrees(radians: f64, offset: f64) -> f64 {
    let near = radians.to_degrees() - offset;
    let rounded = (near * 1e9).round() / 1e9;
    if (rounded + offset).to_radians() == radians { rounded } else { near }
}

/// Appends numbers, wrapped at [`LINE`].
fn numbers(text: &mut String, values: impl Iterator<Item = f64>) {
    let mut length = 0;
    for value in values {
        let word = value.to_string();
        if length > 0 && length + word.len() + 1 > LINE {
            text.push_str("\r\n");
            length = 0;
        } else if length > 0 {
            text.push(' ');
            length += 1;
        }
        text.push_str(&word);
        length += word.len();
    }
    text.push_str("\r\n");
}

/// Returns true if the intensity does not depend on the azimuth, which covers a turn.
fn is_round(own: &IntensityDistribution) -> bool {
    let azimuth = own.azimuth();
    let turn = azimuth[azimuth.len() - 1] - azimuth[0];
    let rows = own.values().chunks(azimuth.len());
    (turn - TAU).abs() < 1e-9 && rows.into_iter().all(|row| row.iter().all(|v| *v == row[0]))
}

/// The text of an IES file of the version LM-63-2002. Its numbers read back as they are.
pub fn write_lm63(own: &IntensityDistribution, about: &LuminaireDescription) -> String {
    let mut text = String::from("IESNA:LM-63-2002\r\n");
    let (name, origin) = (on_one_line(&about.name), on_one_line(&about.origin));
    for (key, value) in [
        ("TEST", "none"),
        ("TESTLAB", &origin[..]),
        ("ISSUEDATE", "none"),
        ("MANUFAC", "none"),
        ("LUMINAIRE", &name),
    ] {
        let _ = write!(text, "[{key}] {value}\r\n");
    }
    text.push_str("TILT=NONE\r\n");
    let is_round = own.photometry() == Photometry::C && is_round(own);
    let azimuth = if is_round { &own.azimuth()[..1] } else { own.azimuth() };
    let columns = own.azimuth().len();
    let (vertical, horizontal): (Vec<f64>, Vec<f64>) = match own.photometry() {
        Photometry::C => (
            own.polar().iter().map(|angle| degrees(*angle, 0.0)).collect(),
            azimuth.iter().map(|angle| degrees(*angle, 0.0)).collect(),
        ),
        Photometry::A => (
            own.polar().iter().map(|angle| degrees(*angle, 90.0)).collect(),
            azimuth.iter().map(|angle| degrees(*angle, 0.0)).collect(),
        ),
        Photometry::B => (
            azimuth.iter().map(|angle| degrees(*angle, 0.0)).collect(),
            own.polar().iter().map(|angle| degrees(*angle, 90.0)).collect(),
        ),
    };
    let kind = match own.photometry() {
        Photometry::C => 1,
        Photometry::B => 2,
        Photometry::A => 3,
    };
    let lumens = about.lamp_lumens.unwrap_or(-1.0);
    let [width, length, height] = about.opening.to_lm63();
    let (rows, planes) = (vertical.len(), horizontal.len());
    let _ = write!(text, "1 {lumens} 1 {rows} {planes} {kind} 2 {width} {length} {height}\r\n");
    let _ = write!(text, "1 1 {}\r\n", about.watts);
    numbers(&mut text, vertical.iter().copied());
    numbers(&mut text, horizontal.iter().copied());
    for plane in 0..planes {
        let value = |row: usize| match own.photometry() {
            Photometry::B => own.values()[plane * columns + row],
            Photometry::A | Photometry::C => own.values()[row * columns + plane],
        };
        numbers(&mut text, (0..rows).map(value));
    }
    text
}

/// The text of an EULUMDAT file. Direct ratios are 0.
///
/// # Errors
/// If the distribution is not of type C with planes from 0 to 360 degrees.
pub fn write_eulumdat(own: &IntensityDistribution, about: &LuminaireDescription) -> Result<String> {
    let azimuth = own.azimuth();
    let turn = azimuth[azimuth.len() - 1];
    if own.photometry() != Photometry::C || azimuth[0] != 0.0 || (turn - TAU).abs() > 1e-9 {
        let problem = "EULUMDAT files contain C planes from 0 to 360 degrees only";
        return Err(Error::new(problem, "write an IES file"));
    }
    let is_round = is_round(own);
    let planes: Vec<f64> =
        azimuth[..azimuth.len() - 1].iter().map(|angle| degrees(*angle, 0.0)).collect();
    let angles: Vec<f64> = own.polar().iter().map(|angle| degrees(*angle, 0.0)).collect();
    // 0 if the steps differ
    let step = |angles: &[f64], whole: f64| match angles {
        [first, second, ..] => {
            let step = second - first;
            let all = angles.windows(2).all(|w| (w[1] - w[0] - step).abs() < 1e-9);
            if all && (whole == 0.0 || (step * angles.len() as f64 - whole).abs() < 1e-9) {
                step
            } else {
                0.0
            }
        }
        _ => whole,
    };
    let flux = own.flux();
    let lumens = about.lamp_lumens.unwrap_or(flux);
    let [x, y, z] = about.opening.size().map(|size| 1000.0 * size);
    let (length, width) = match about.opening {
        OpeningShape::Cylinder(_) | OpeningShape::Ellipsoid(_) => (x, 0.0),
        OpeningShape::Point | OpeningShape::Box(_) => (y, x),
    };
    let mut text = String::new();
    let mut line = |value: &dyn std::fmt::Display| {
        let _ = write!(text, "{value}\r\n");
    };
    line(&on_one_line(&about.origin));
    line(&if is_round { 1 } else { 3 });
    line(&i32::from(is_round));
    line(&planes.len());
    line(&step(&planes, 360.0));
    line(&angles.len());
    line(&step(&angles, 0.0));
    line(&"none");
    line(&on_one_line(&about.name));
    line(&"none");
    line(&"none");
    line(&"none");
    [length, width, z].iter().for_each(|size| line(size));
    [length, width, z, z, z, z].iter().for_each(|size| line(size));
    line(&(100.0 * lower_flux(own) / flux));
    line(&(100.0 * flux / lumens));
    line(&1);
    line(&0);
    line(&1);
    // A negative number of lamps marks absolute photometry.
    line(&if about.lamp_lumens.is_some() { 1 } else { -1 });
    line(&"none");
    line(&lumens);
    line(&"none");
    line(&"none");
    line(&about.watts);
    (0..10).for_each(|_| line(&0));
    planes.iter().for_each(|angle| line(angle));
    angles.iter().for_each(|angle| line(angle));
    let listed = if is_round { 1 } else { planes.len() };
    for plane in 0..listed {
        for row in own.values().chunks(azimuth.len()) {
            line(&(1000.0 / lumens * row[plane]));
        }
    }
    Ok(text)
}

/// Flux into the lower half of the sphere of a distribution of type C, lm, by a cut of its grid at
/// 90 degrees.
fn lower_flux(own: &IntensityDistribution) -> f64 {
    let columns = own.azimuth().len();
    let mut polar: Vec<f64> = own.polar().to_vec();
    let mut values = own.values().to_vec();
    let below = polar.partition_point(|angle| *angle < FRAC_PI_2 - 1e-12);
    if below == 0 {
        return 0.0;
    }
    if below == polar.len() {
        return own.flux();
    }
    let share = (FRAC_PI_2 - polar[below - 1]) / (polar[below] - polar[below - 1]);
    for column in 0..columns {
        let [a, b] = [below - 1, below].map(|row| own.values()[row * columns + column]);
        values[below * columns + column] = a + share * (b - a);
    }
    polar[below] = FRAC_PI_2;
    polar.truncate(below + 1);
    values.truncate((below + 1) * columns);
    let cut = IntensityDistribution::new(Photometry::C, polar, own.azimuth().to_vec(), values);
    cut.map_or(0.0, |cut| cut.flux())
}
