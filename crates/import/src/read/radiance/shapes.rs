//! Surfaces as triangle meshes.

use super::mesh_of;
use super::tokens::Primitive;
use crate::shape::polygon::Cutter;
use crate::shape::round::{area, grid};
use bdpm_core::base::error::Result;
use bdpm_core::scene::Mesh;
use glam::{DVec3, Vec3};
use std::f32::consts::{PI, TAU};

/// The mesh of a surface in the coordinates of its file. Round shapes have so many steps around.
///
/// # Errors
/// If its numbers are not those of its kind.
pub fn mesh(own: &Primitive, around: u32, cutter: &mut Cutter) -> Result<Mesh> {
    Ok(match &own.kind[..] {
        "polygon" => polygon(own, cutter)?,
        "sphere" | "bubble" => sphere(own, around)?,
        "cylinder" | "tube" => {
            let [x0, y0, z0, x1, y1, z1, radius] = own.exactly()?;
            let ends = [DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)];
            cone(own, (ends, [radius; 2]), around)?
        }
        "cone" | "cup" => {
            let [x0, y0, z0, x1, y1, z1, first, second] = own.exactly()?;
            let ends = [DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)];
            cone(own, (ends, [first, second]), around)?
        }
        "ring" => ring(own, around)?,
        _ => {
            let advice = "Radiance knows polygon, sphere, bubble, cylinder, tube, cone, cup, ring, mesh, \
                          instance and source, and materials and patterns";
            return Err(own.error("is of no known type", advice));
        }
    })
}

fn polygon(own: &Primitive, cutter: &mut Cutter) -> Result<Mesh> {
    let numbers = &own.numbers;
    if numbers.len() < 9 || !numbers.len().is_multiple_of(3) {
        let problem = format!("has {} numbers", numbers.len());
        return Err(own.error(&problem, "give three for each corner, at least 9"));
    }
    let mut corners: Vec<DVec3> =
        numbers.chunks_exact(3).map(|at| DVec3::new(at[0], at[1], at[2])).collect();
    turn_holes(&mut corners);
    let positions: Vec<Vec3> = corners.iter().map(|own| own.as_vec3()).collect();
    let mut triangles = Vec::new();
    cutter.cut(positions.iter().copied(), |corners| {
        triangles.push(corners.map(|corner| corner as u32));
    });
    Ok(mesh_of(positions, triangles))
}

/// Corners of a polygon whose holes are looked for, at most: the time grows with the square.
const MAX_HOLED: usize = 1024;

/// Turns holes that go around as the outline does. A bridge leads to each hole and back. Radiance
/// counts crossings, for which the sense of a hole does not matter, and public scenes have both.
fn turn_holes(corners: &mut [DVec3]) {
    if corners.len() > MAX_HOLED {
        return;
    }
    let area = |points: &[DVec3]| -> DVec3 {
        let first = points[0];
        points.windows(2).map(|pair| (pair[0] - first).cross(pair[1] - first)).sum()
    };
    // Once more if the polygon begins at a hole, from which the outline looks like a hole.
    for _ in 0..2 {
        let holes = holes(corners);
        let areas: Vec<DVec3> =
            holes.iter().map(|[start, end]| area(&corners[*start..=*end])).collect();
        let outline = area(corners) - areas.iter().sum::<DVec3>();
        let larger = areas.iter().position(|own| own.length() > outline.length());
        if let Some(larger) = larger {
            corners.rotate_left(holes[larger][0]);
            continue;
        }
        for ([start, end], own) in holes.into_iter().zip(areas) {
            if own.dot(outline) > 0.0 {
                corners[start..=end].reverse();
            }
        }
        return;
    }
}

/// First and last corner of each loop that a bridge leads to.
fn holes(corners: &[DVec3]) -> Vec<[usize; 2]> {
    let (mut all, mut at) = (Vec::new(), 1);
    while at < corners.len() {
        let is_end = |end: &usize| {
            corners[*end] == corners[at] && corners[(*end + 1) % corners.len()] == corners[at - 1]
        };
        match (at + 3..corners.len()).find(is_end) {
            Some(end) => {
                all.push([at, end]);
                at = end + 1;
            }
            None => at += 1,
        }
    }
    all
}

fn sphere(own: &Primitive, around: u32) -> Result<Mesh> {
    let [x, y, z, radius] = own.exactly()?;
    let center = DVec3::new(x, y, z).as_vec3();
    if radius == 0.0 {
        return Err(own.error("has the radius 0", "give another"));
    }
    let mut mesh = grid(around, around / 2, |u, v| {
        let (sin, cos) = (PI * v).sin_cos();
        let (y, x) = (TAU * u).sin_cos();
        Vec3::new(sin * x, sin * y, cos)
    });
    mesh.normals = mesh.positions.clone();
    // A negative radius turns it inside out, as a bubble is.
    let is_inside = (own.kind == "bubble") != (radius < 0.0);
    let scale = radius.abs() as f32 * (4.0 * PI / area(&mesh)).sqrt();
    mesh.positions.iter_mut().for_each(|position| *position = center + scale * *position);
    turn(&mut mesh, is_inside);
    Ok(mesh)
}

/// A cone, or a cylinder if both radii are equal. Those of `cup` and `tube` are seen from inside.
fn cone(
    own: &Primitive,
    ([start, end], radii): ([DVec3; 2], [f64; 2]),
    around: u32,
) -> Result<Mesh> {
    let axis = end - start;
    if axis.length() == 0.0 || radii.iter().all(|radius| *radius == 0.0) {
        return Err(own.error("has no length or no radius", "give other numbers"));
    }
    let [across, up] = frame(axis);
    // Flat sides of the same area as the round ones.
    let half_step = std::f64::consts::PI / f64::from(around);
    let wide = half_step / half_step.sin();
    let mut mesh = grid(around, 1, |u, v| {
        let (sin, cos) = (f64::from(u) * f64::from(TAU)).sin_cos();
        let v = 1.0 - f64::from(v);
        let radius = wide * (radii[0] + v * (radii[1] - radii[0])).abs();
        (start + v * axis + radius * (cos * across + sin * up)).as_vec3()
    });
    let slope = (radii[0] - radii[1]) / axis.length();
    let normal = |position: &Vec3| {
        let from_start = position.as_dvec3() - start;
        let along = axis.normalize();
        let out = (from_start - from_start.dot(along) * along).normalize_or_zero();
        (out + slope * along).normalize_or_zero().as_vec3()
    };
    mesh.normals = mesh.positions.iter().map(normal).collect();
    turn(&mut mesh, matches!(&own.kind[..], "tube" | "cup"));
    Ok(mesh)
}

fn ring(own: &Primitive, around: u32) -> Result<Mesh> {
    let [x, y, z, nx, ny, nz, one, other] = own.exactly()?;
    let (center, normal) = (DVec3::new(x, y, z), DVec3::new(nx, ny, nz));
    if normal.length() == 0.0 || one == other {
        return Err(own.error("has no direction or no width", "give other numbers"));
    }
    let [across, up] = frame(normal);
    let (inner, outer) = (one.min(other), one.max(other));
    let step = f64::from(TAU) / f64::from(around);
    let wide = (step / step.sin()).sqrt();
    Ok(grid(around, 1, |u, v| {
        let (sin, cos) = (f64::from(u) * f64::from(TAU)).sin_cos();
        // Outward as v grows, from which the front is along the normal.
        let radius = wide * (inner + f64::from(v) * (outer - inner));
        (center + radius * (cos * across + sin * up)).as_vec3()
    }))
}

/// Two unit vectors across an axis, with which it is right-handed.
fn frame(axis: DVec3) -> [DVec3; 2] {
    let (across, up) = axis.normalize().any_orthonormal_pair();
    [across, up]
}

/// Turns a mesh inside out.
fn turn(mesh: &mut Mesh, is_inside: bool) {
    if is_inside {
        mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
        mesh.normals.iter_mut().for_each(|normal| *normal = -*normal);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(kind: &str, numbers: &[f64]) -> Mesh {
        let own = Primitive {
            kind: kind.into(),
            name: "it".into(),
            numbers: numbers.to_vec(),
            ..Primitive::default()
        };
        mesh(&own, 128, &mut Cutter::default()).unwrap()
    }

    /// Flux of the position through the surface, a third of which is the volume of a closed shape.
    fn volume(mesh: &Mesh) -> f32 {
        let of = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
            a.dot(b.cross(c)) / 6.0
        };
        mesh.triangles.iter().map(of).sum()
    }

    #[test]
    fn round_shapes_have_their_areas_and_face_outside() {
        let ball = read("sphere", &[0.0, 0.0, 0.0, 2.0]);
        assert!((area(&ball) / (16.0 * PI) - 1.0).abs() < 1e-3);
        assert!(volume(&ball) > 33.0 && volume(&read("bubble", &[0.0, 0.0, 0.0, 2.0])) < -33.0);
        // The side of a cylinder about the z axis has two thirds of the flux of a closed one.
        let side = read("cylinder", &[0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.5]);
        assert!((area(&side) / (2.0 * PI) - 1.0).abs() < 1e-5, "{}", area(&side));
        assert!(volume(&side) > 0.9, "{}", volume(&side));
        assert!(volume(&read("tube", &[0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.5])) < -0.9);
        let cone = read("cone", &[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0]);
        assert!((area(&cone) / (PI * 2f32.sqrt()) - 1.0).abs() < 2e-3, "{}", area(&cone));
        let ring = read("ring", &[0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.5, 1.0]);
        assert!((area(&ring) / (0.75 * PI) - 1.0).abs() < 2e-3, "{}", area(&ring));
        // It faces along its normal.
        assert!(volume(&ring) > 0.0);
    }

    /// A square of 3 by 3 with a hole of 1, whose bridge begins at the first corner.
    #[test]
    fn holes_are_holes_in_either_sense() {
        let outer = [[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [0.0, 3.0], [0.0, 0.0]];
        let mut hole = [[1.0, 1.0], [1.0, 2.0], [2.0, 2.0], [2.0, 1.0], [1.0, 1.0]];
        for _ in 0..2 {
            for turned in 0..10 {
                let mut all: Vec<[f64; 2]> = outer.iter().chain(&hole).copied().collect();
                all.rotate_left(turned);
                let numbers: Vec<f64> = all.iter().flat_map(|[x, y]| [*x, *y, 0.0]).collect();
                let mesh = read("polygon", &numbers);
                assert!((area(&mesh) - 8.0).abs() < 1e-5, "{turned} {}", area(&mesh));
            }
            hole.reverse();
        }
    }

    #[test]
    fn polygons_need_three_corners() {
        let square = read("polygon", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
        assert_eq!((square.triangles.len(), area(&square)), (2, 1.0));
        let own =
            Primitive { kind: "polygon".into(), numbers: vec![0.0; 8], ..Primitive::default() };
        assert!(mesh(&own, 128, &mut Cutter::default()).is_err());
    }
}
