//! The tables of a scene file besides meshes and materials.

use super::numbers::{color, inverse, number, point, position, unnormalized};
use crate::warnings::Warning;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::names::for_line;
use bdpm_core::scene::transform::MAX_COORDINATE;
use bdpm_core::scene::{
    Emitter, Environment, Extent, Falloff, FieldOfView, MeterKind, MeterSet, Optics, Region,
    Requirement, Scene, Spot,
};
use bdpm_core::settings::PartialSettings;
use glam::Vec3;
use std::fmt::Write;

/// File of the environment.
pub(super) const ENVIRONMENT: &str = "environment.exr";

/// File of its inset.
pub(super) const INSET: &str = "environment-inset.exr";

/// A comment about the source of the scene.
pub(super) fn head(origin: &str) -> String {
    let version = env!("CARGO_PKG_VERSION");
    format!("# Converted from `{}` by bdpm {version}.\n", for_line(origin, "a scene"))
}

pub(super) fn camera(scene: &Scene) -> String {
    let camera = &scene.camera;
    let [direction, up] = camera.aim().map(within_bounds);
    let (kind, optics) = match camera.optics() {
        Optics::Pinhole(angle) => ("pinhole", field_of_view(angle)),
        Optics::ThinLens { field_of_view: angle, aperture_radius, focus_distance } => {
            let (radius, distance) = (number(aperture_radius), number(focus_distance));
            let angle = field_of_view(angle);
            let lens = format!("aperture_radius = {radius}\nfocus_distance = {distance}\n");
            ("thin-lens", angle + &lens)
        }
        Optics::Sensor { width, disc_distance, disc_radius, exposure } => {
            let [width, distance] = [width, disc_distance].map(number);
            let [radius, exposure] = [disc_radius, exposure].map(number);
            let sensor = format!(
                "sensor_width = {width}\ndisc_distance = {distance}\ndisc_radius = {radius}\n\
                 exposure = {exposure}\n"
            );
            ("sensor", sensor)
        }
        Optics::Orthographic(Extent::X(across)) => {
            ("orthographic", format!("width = {}\n", number(across)))
        }
        Optics::Orthographic(Extent::Y(across)) => {
            ("orthographic", format!("height = {}\n", number(across)))
        }
        Optics::Panorama => ("panorama", String::new()),
        Optics::Fisheye { projection, field_of_view } => {
            let (projection, angle) = (projection.name(), number(field_of_view));
            ("fisheye", format!("projection = \"{projection}\"\nfov_deg = {angle}\n"))
        }
    };
    let shift = match camera.shift() {
        [0.0, 0.0] => String::new(),
        [right, up] => format!("shift = [{}, {}]\n", number(right), number(up)),
    };
    format!(
        "\n[camera]\ntype = \"{kind}\"\nposition = {}\ndirection = {}\nup = {}\n{optics}{shift}",
        position(camera.position(), scene),
        point(direction),
        point(up)
    )
}

fn field_of_view(angle: FieldOfView) -> String {
    match angle {
        FieldOfView::X(degrees) => format!("fov_x_deg = {}\n", number(degrees)),
        FieldOfView::Y(degrees) => format!("fov_y_deg = {}\n", number(degrees)),
    }
}

/// The vector, halved until its coordinates are valid in a file. Halving is exact.
fn within_bounds(mut vector: Vec3) -> Vec3 {
    while vector.abs().max_element() > MAX_COORDINATE {
        vector *= 0.5;
    }
    vector
}

pub(super) fn ray_offset(distance: Option<f32>) -> String {
    distance.map_or_else(String::new, |distance| format!("ray_offset = {}\n", number(distance)))
}

pub(super) fn render(defaults: &PartialSettings) -> Result<String> {
    let text = toml::to_string(defaults).map_err(|e| {
        let problem = format!("the settings of rendering cannot be written: {e}");
        Error::new(problem, "use a seed below 2^63")
    })?;
    Ok(if text.is_empty() { text } else { format!("\n[render]\n{text}") })
}

pub(super) fn regions(regions: &[Region]) -> String {
    let mut text = String::new();
    for Region { name, rectangles } in regions {
        let sides = |[x0, y0, x1, y1]: &[f64; 4]| format!("[{x0:?}, {y0:?}, {x1:?}, {y1:?}]");
        let rectangles: Vec<_> = rectangles.iter().map(sides).collect();
        let name = toml::Value::String(name.clone());
        let _ = writeln!(text, "{name} = [{}]", rectangles.join(", "));
    }
    if text.is_empty() { text } else { format!("\n[regions]\n{text}") }
}

/// The keys of a requirement.
fn required(requirement: &Requirement) -> String {
    let Requirement { mean, minimum, uniformity, diversity, ugr, daylight_factor, maintenance } =
        *requirement;
    let maintenance = (maintenance != 1.0).then_some(maintenance);
    let keys = [
        ("required_mean", mean),
        ("required_minimum", minimum),
        ("required_uniformity", uniformity),
        ("required_diversity", diversity),
        ("required_ugr", ugr),
        ("maintenance_factor", maintenance),
    ];
    let given = keys.into_iter().filter_map(|(key, value)| Some(format!("{key} = {:?}\n", value?)));
    let daylight = daylight_factor
        .map(|[target, least]| format!("required_daylight_factor = [{target:?}, {least:?}]\n"));
    given.chain(daylight).collect()
}

/// `[[meter]]` tables of meters of a scene.
pub(super) fn meters(sets: &[MeterSet], scene: &Scene) -> String {
    let mut text = String::new();
    for MeterSet { name, kind, grid, frame, meters, requirement } in sets {
        let Some(meter) = meters.first() else { continue };
        let axis = point(unnormalized(meter.normal));
        let name = toml::Value::String(name.clone());
        let keys = match (frame, kind) {
            (Some([corner, first, second]), _) => format!(
                "corner = {}\nedges = [{}, {}]\ncolumns = {}\nrows = {}\nnormal = {axis}\n",
                position(*corner, scene),
                point(*first),
                point(*second),
                grid[0],
                grid[1]
            ),
            (None, MeterKind::Irradiance) => {
                format!("position = {}\nnormal = {axis}\n", position(meter.position, scene))
            }
            (None, MeterKind::Radiance) => {
                let half = meter.half_angle;
                let guess = 2.0 * half.to_degrees();
                let opening = inverse(half, guess, |degrees| (0.5 * degrees).to_radians());
                format!(
                    "position = {}\ndirection = {axis}\nopening_deg = {}\n",
                    position(meter.position, scene),
                    number(opening.unwrap_or(guess))
                )
            }
        };
        let _ = write!(text, "\n[[meter]]\nname = {name}\n{keys}{}", required(requirement));
    }
    text
}

/// Whether the environment is constant, so that it needs no file.
pub(super) fn is_plain(environment: &Environment) -> bool {
    environment.size() == [1, 1] && environment.turn() == 0.0
}

pub(super) fn environment(environment: &Environment) -> String {
    if let (true, Some(radiance)) = (is_plain(environment), environment.pixels().next()) {
        return format!("\n[environment]\nradiance = {}\n", color(radiance));
    }
    let turn = environment.turn();
    let degrees = inverse(turn, turn * 360.0, |degrees| degrees / 360.0).unwrap_or(turn * 360.0);
    let mut text =
        format!("\n[environment]\nfile = \"{ENVIRONMENT}\"\nturn_deg = {}\n", number(degrees));
    if let Some((grid, _)) = environment.inset() {
        let ([column, row], [columns, rows]) = (grid.first, grid.replaced);
        let _ = writeln!(text, "inset_file = \"{INSET}\"");
        let _ = writeln!(text, "inset = [{column}, {row}, {columns}, {rows}]");
    }
    text
}

/// All `[[light]]` tables. Emissive triangles are meshes.
pub(super) fn lights(scene: &Scene, warnings: &mut Vec<Warning>) -> String {
    let mut text = String::new();
    let (mut rounded, mut luminaires) = (0, 0);
    let along = |unit| point(unnormalized(unit));
    let names = scene.light_names().iter().map(Option::as_ref).chain(std::iter::repeat(None));
    let named = scene.lights().emitters().iter().zip(names);
    let head = |kind: &str, name: Option<&String>| {
        let name = name.map(|name| format!("name = {}\n", toml::Value::String(name.clone())));
        format!("\n[[light]]\ntype = \"{kind}\"\n{}", name.unwrap_or_default())
    };
    let _ = named.into_iter().try_for_each(|(emitter, name)| match emitter {
        Emitter::Point { position: place, intensity } => {
            let (place, intensity) = (position(*place, scene), color(*intensity));
            writeln!(text, "{}position = {place}", head("point", name))?;
            writeln!(text, "intensity = {intensity}")
        }
        Emitter::Spot(spot) => {
            let ([inner, outer], exact) = cones(spot);
            rounded += usize::from(!exact);
            let (place, direction) = (position(spot.position, scene), along(spot.direction));
            writeln!(text, "{}position = {place}", head("spot", name))?;
            writeln!(text, "direction = {direction}\ninner_deg = {inner:?}")?;
            writeln!(text, "outer_deg = {outer:?}")?;
            match spot.falloff {
                Falloff::Quadratic => {}
                Falloff::Smoothstep => writeln!(text, "falloff = \"smoothstep\"")?,
                Falloff::LinearInAngle => writeln!(text, "falloff = \"linear\"")?,
            }
            writeln!(text, "intensity = {}", color(spot.intensity))
        }
        Emitter::Directional(sun) => {
            let (direction, irradiance) = (along(sun.direction), color(sun.irradiance));
            writeln!(text, "{}direction = {direction}", head("sun", name))?;
            writeln!(text, "irradiance = {irradiance}")
        }
        Emitter::Luminaire(_) | Emitter::Opening(_) => {
            luminaires += 1;
            Ok(())
        }
        Emitter::Triangle { .. } | Emitter::Textured(_) => Ok(()),
    });
    if luminaires > 0 {
        let text = format!("left out the light of {luminaires} luminaires: copy their files");
        warnings.push(Warning::skipped(text));
    }
    if rounded > 0 {
        let text = format!("rounded the angles of {rounded} spots in the last digit");
        warnings.push(Warning::chosen(text));
    }
    text
}

/// The angles of a spot's cones, degrees, and whether they reproduce the cosines exactly.
fn cones(spot: &Spot) -> ([f64; 2], bool) {
    let cosines = [spot.cos_inner, spot.cos_outer];
    let exact = cosines.map(degrees_of);
    let nearest = |i: usize| exact[i].unwrap_or(cosines[i].acos().to_degrees());
    // A rounded right angle may exceed 90 degrees.
    ([nearest(0), nearest(1).min(90.0)], exact.iter().all(Option::is_some))
}

/// The shortest number of degrees near the arc cosine that has exactly this cosine.
fn degrees_of(cosine: f64) -> Option<f64> {
    let guess = cosine.acos().to_degrees();
    let has_it = |degrees: &f64| degrees.to_radians().cos() == cosine;
    // Angles that were written with few digits
    let rounded =
        (3..17).map(|digits| format!("{guess:.digits$}").parse().expect("it is a number"));
    let near = (-64_i64..=64).map(|step| f64::from_bits((guess.to_bits() as i64 + step) as u64));
    rounded.chain(near).find(has_it)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_tables_are_omitted() {
        assert_eq!(render(&PartialSettings::default()).unwrap(), "");
        assert_eq!(regions(&[]), "");
    }
}
