//! Curves, such as hairs, as tubes of triangles.

use bdpm_core::scene::Mesh;
use glam::{DVec3, DVec4, Vec2, Vec3};
use std::f64::consts::{PI, TAU};

/// Sides of a tube.
const SIDES: u32 = 4;
/// Pieces of each cubic segment.
const STEPS: u32 = 4;

/// Basis of a curve's control points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CurveBasis {
    /// Straight lines between the points.
    Linear,
    /// Bezier segments of this degree, 2 or 3, which share their end points.
    Bezier(usize),
    /// A uniform B-spline of this degree, 2 or 3.
    BSpline(usize),
}

impl CurveBasis {
    /// Number of segments of so many control points; `None` if the number does not fit.
    pub fn segments(self, points: usize) -> Option<usize> {
        let count = match self {
            Self::Linear => points.checked_sub(1)?,
            Self::Bezier(degree) => {
                let steps = points.checked_sub(1)?;
                (steps % degree == 0).then_some(steps / degree)?
            }
            Self::BSpline(degree) => points.checked_sub(degree)?,
        };
        (count > 0).then_some(count)
    }

    /// Position and radius at `t`, in [0, 1], of a segment.
    fn at(self, points: &[DVec4], segment: usize, t: f64) -> DVec4 {
        let s = 1.0 - t;
        match self {
            Self::Linear => s * points[segment] + t * points[segment + 1],
            Self::Bezier(degree) => {
                let p = &points[segment * degree..];
                if degree == 2 {
                    return s * s * p[0] + 2.0 * s * t * p[1] + t * t * p[2];
                }
                s * s * s * p[0]
                    + 3.0 * s * s * t * p[1]
                    + 3.0 * s * t * t * p[2]
                    + t * t * t * p[3]
            }
            Self::BSpline(degree) => {
                let p = &points[segment..];
                if degree == 2 {
                    let middle = 0.5 + t * s;
                    return 0.5 * s * s * p[0] + middle * p[1] + 0.5 * t * t * p[2];
                }
                let second = 4.0 - 6.0 * t * t + 3.0 * t * t * t;
                let third = 1.0 + 3.0 * t + 3.0 * t * t - 3.0 * t * t * t;
                (s * s * s * p[0] + second * p[1] + third * p[2] + t * t * t * p[3]) / 6.0
            }
        }
    }
}

/// Adds the tube of a curve to a mesh that has normals and texture coordinates. A control point is
/// a position and the radius, which `radius` changes by the share of the curve's length in
/// parameters. The tube is open at its ends, its texture coordinate u runs along it. Its mean width
/// in all directions is that of a round tube.
///
/// Does nothing if the number of points does not fit, or a number is not finite.
pub fn add_tube(
    mesh: &mut Mesh,
    points: &[DVec4],
    basis: CurveBasis,
    radius: impl Fn(f64, f64) -> f64,
) {
    let Some(segments) = basis.segments(points.len()) else { return };
    if !points.iter().all(|point| point.is_finite()) {
        return;
    }
    let steps = if basis == CurveBasis::Linear { 1 } else { STEPS };
    let knots = segments as u32 * steps;
    let knot = |index: u32| {
        let (segment, step) = ((index / steps) as usize, index % steps);
        // The last knot is the end of the last segment.
        let (segment, step) =
            if segment == segments { (segment - 1, steps) } else { (segment, step) };
        basis.at(points, segment, f64::from(step) / f64::from(steps))
    };
    // The perimeter of the polygon is that of the circle.
    let scale = PI / (f64::from(SIDES) * (PI / f64::from(SIDES)).sin());
    let first = mesh.positions.len() as u32;
    let mut across = DVec3::ZERO;
    for index in 0..=knots {
        let center = knot(index);
        let along = knot((index + 1).min(knots)) - knot(index.saturating_sub(1));
        let along = along.truncate().try_normalize().unwrap_or(DVec3::Z);
        // The frame turns as little as it can from knot to knot.
        across = (across - across.dot(along) * along)
            .try_normalize()
            .unwrap_or_else(|| along.any_orthonormal_vector());
        let share = f64::from(index) / f64::from(knots);
        let radius = scale * radius(center.w, share);
        for side in 0..SIDES {
            let (sin, cos) = (TAU * f64::from(side) / f64::from(SIDES)).sin_cos();
            let normal = cos * across + sin * along.cross(across);
            mesh.positions.push((center.truncate() + radius * normal).as_vec3());
            mesh.normals.push(normal.as_vec3());
            mesh.uvs.push(Vec2::new(share as f32, side as f32 / SIDES as f32));
        }
    }
    for ring in 0..knots {
        for side in 0..SIDES {
            let corner = |ring: u32, side: u32| first + ring * SIDES + side % SIDES;
            let [a, b] = [corner(ring, side), corner(ring, side + 1)];
            let [c, d] = [corner(ring + 1, side), corner(ring + 1, side + 1)];
            mesh.triangles.extend([[a, b, d], [a, d, c]]);
        }
    }
}

/// Adds the vertices and triangles of another tube to a mesh.
pub fn join(mesh: &mut Mesh, other: &Mesh) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(&other.positions);
    mesh.normals.extend(&other.normals);
    mesh.uvs.extend(&other.uvs);
    mesh.triangles.extend(other.triangles.iter().map(|corners| corners.map(|i| first + i)));
}

/// Removes triangles without an area, which tubes have where their width is 0.
pub fn remove_empty(mesh: &mut Mesh) {
    let Mesh { positions, triangles, .. } = mesh;
    triangles.retain(|corners| {
        let [a, b, c]: [Vec3; 3] = corners.map(|i| positions[i as usize]);
        (b - a).cross(c - a) != Vec3::ZERO
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::scene::triangle_area;

    fn area(mesh: &Mesh) -> f64 {
        let corners = |t: &[u32; 3]| t.map(|i| mesh.positions[i as usize]);
        mesh.triangles.iter().map(|t| f64::from(triangle_area(corners(t)))).sum()
    }

    #[test]
    fn straight_curves_have_the_area_of_a_cylinder_in_every_basis() {
        // B-splines end between their control points: from 1 to 2 of 0, 1, 2, 3.
        let line = |count: usize| -> Vec<DVec4> {
            (0..count).map(|i| DVec4::new(0.0, i as f64, 0.0, 0.25)).collect()
        };
        for (basis, points, length) in [
            (CurveBasis::Linear, 3, 2.0),
            (CurveBasis::Bezier(2), 5, 4.0),
            (CurveBasis::Bezier(3), 4, 3.0),
            (CurveBasis::BSpline(2), 4, 2.0),
            (CurveBasis::BSpline(3), 6, 3.0),
        ] {
            let mut mesh = Mesh::default();
            add_tube(&mut mesh, &line(points), basis, |radius, _| radius);
            let expected = TAU * 0.25 * length;
            assert!((area(&mesh) / expected - 1.0).abs() < 1e-5, "{basis:?}: {}", area(&mesh));
            // Fronts look outward, as normals do.
            for corners in &mesh.triangles {
                let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
                let normal: Vec3 = corners.iter().map(|i| mesh.normals[*i as usize]).sum();
                assert!((b - a).cross(c - a).dot(normal) > 0.0);
            }
        }
    }

    #[test]
    fn curves_of_points_that_do_not_fit_add_nothing() {
        let mut mesh = Mesh::default();
        let points = [DVec4::ONE; 5];
        add_tube(&mut mesh, &points, CurveBasis::Bezier(3), |radius, _| radius);
        add_tube(&mut mesh, &points[..3], CurveBasis::BSpline(3), |radius, _| radius);
        add_tube(&mut mesh, &[DVec4::NAN; 4], CurveBasis::Bezier(3), |radius, _| radius);
        assert!(mesh.positions.is_empty() && mesh.triangles.is_empty());
    }
}
