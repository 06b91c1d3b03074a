//! Triangle meshes of Mitsuba's analytic shapes.
//!
//! Round meshes are scaled to the area of their shape (`shape/round.rs`).

use crate::shape::round::{area, grid, steps};
use bdpm_core::scene::Mesh;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// A shape in its own space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Analytic {
    /// From -1 to 1 in x and y, facing +z.
    Rectangle,
    /// From -1 to 1.
    Cube,
    /// Radius 1.
    Sphere,
    /// Radius 1, facing +z.
    Disk,
    /// Radius 1, along z from 0 to 1, open.
    Cylinder,
}

impl Analytic {
    /// The shape of this type in Mitsuba.
    pub fn named(kind: &str) -> Option<Self> {
        Some(match kind {
            "rectangle" => Self::Rectangle,
            "cube" => Self::Cube,
            "sphere" => Self::Sphere,
            "disk" => Self::Disk,
            "cylinder" => Self::Cylinder,
            _ => return None,
        })
    }

    /// Whether its back is invisible from outside.
    pub fn is_closed(self) -> bool {
        matches!(self, Self::Cube | Self::Sphere)
    }

    /// The triangles, with texture coordinates whose v points up in the picture.
    pub fn mesh(self, is_lamp: bool) -> Mesh {
        let around = steps(is_lamp);
        match self {
            Self::Rectangle => {
                let mut mesh = Mesh::default();
                for [u, v] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
                    mesh.positions.push(Vec3::new(2.0 * u - 1.0, 2.0 * v - 1.0, 0.0));
                    mesh.uvs.push(Vec2::new(u, 1.0 - v));
                }
                mesh.triangles = vec![[0, 1, 2], [0, 2, 3]];
                mesh
            }
            Self::Cube => cube(),
            Self::Sphere => {
                let mut mesh = grid(around, around / 2, |u, v| {
                    let ((sin, cos), (across, z)) = ((TAU * u).sin_cos(), (PI * v).sin_cos());
                    Vec3::new(across * cos, across * sin, z)
                });
                mesh.normals.clone_from(&mesh.positions);
                let scale = (4.0 * PI / area(&mesh)).sqrt();
                mesh.positions.iter_mut().for_each(|point| *point *= scale);
                mesh
            }
            Self::Disk => {
                // Along u from the center, along v around it.
                let mut mesh = grid(1, around, |u, v| {
                    let (sin, cos) = (TAU * v).sin_cos();
                    u * Vec3::new(cos, sin, 0.0)
                });
                mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
                let scale = (PI / area(&mesh)).sqrt();
                mesh.positions.iter_mut().for_each(|point| *point *= scale);
                mesh
            }
            Self::Cylinder => {
                let point = |u: f32, v: f32| {
                    let (sin, cos) = (TAU * u).sin_cos();
                    Vec3::new(cos, sin, v)
                };
                let mut mesh = grid(around, 1, point);
                mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
                mesh.normals =
                    mesh.positions.iter().map(|point| point.with_z(0.0).normalize()).collect();
                let scale = TAU / area(&mesh);
                let stretch = Vec3::new(scale, scale, 1.0);
                mesh.positions.iter_mut().for_each(|point| *point *= stretch);
                mesh
            }
        }
    }
}

fn cube() -> Mesh {
    let mut mesh = Mesh::default();
    // Outward, and the directions of growing u and v.
    for (outward, u, v) in [
        (Vec3::Z, Vec3::Y, Vec3::X),
        (-Vec3::Z, -Vec3::Y, Vec3::X),
        (Vec3::X, Vec3::Y, -Vec3::Z),
        (-Vec3::X, Vec3::Y, Vec3::Z),
        (Vec3::Y, -Vec3::X, -Vec3::Z),
        (-Vec3::Y, Vec3::Z, Vec3::X),
    ] {
        let first = mesh.positions.len() as u32;
        for [x, y] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
            mesh.positions.push(outward + x * u + y * v);
            mesh.uvs.push(Vec2::new(0.5 + 0.5 * x, 0.5 - 0.5 * y));
        }
        let [a, b, c, d] = [first, first + 1, first + 2, first + 3];
        let is_left = u.cross(v).dot(outward) > 0.0;
        mesh.triangles.extend(if is_left {
            [[a, b, c], [a, c, d]]
        } else {
            [[a, c, b], [a, d, c]]
        });
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [(Analytic, f32); 5] = [
        (Analytic::Rectangle, 4.0),
        (Analytic::Cube, 24.0),
        (Analytic::Sphere, 4.0 * PI),
        (Analytic::Disk, PI),
        (Analytic::Cylinder, TAU),
    ];

    #[test]
    fn meshes_have_the_area_of_their_shape_and_face_outward() {
        for (shape, expected) in ALL {
            for is_lamp in [false, true] {
                let mesh = shape.mesh(is_lamp);
                let off = area(&mesh) / expected - 1.0;
                assert!(off.abs() < 1e-5, "{shape:?}: {off}");
                for corners in &mesh.triangles {
                    let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
                    let outward = match shape {
                        Analytic::Rectangle | Analytic::Disk => Vec3::Z,
                        Analytic::Cylinder => (a + b + c).with_z(0.0),
                        _ => a + b + c,
                    };
                    assert!((b - a).cross(c - a).dot(outward) > 0.0, "{shape:?} {corners:?}");
                }
            }
        }
    }

    #[test]
    fn texture_coordinates_are_those_of_mitsuba() {
        // Values of `si.uv` in mitsuba 3.9.1 at these points. Its v points down.
        for (shape, point, uv) in [
            (Analytic::Rectangle, [0.5, -0.2, 0.0], [0.75, 0.4]),
            (Analytic::Disk, [0.5, 0.2, 0.0], [0.539, 0.061]),
            (Analytic::Sphere, [0.3, 0.4, 0.866], [0.148, 0.167]),
            (Analytic::Cylinder, [0.917, 0.4, 0.3], [0.065, 0.3]),
            (Analytic::Cube, [0.5, -0.2, 1.0], [0.4, 0.75]),
            (Analytic::Cube, [0.5, 0.2, -1.0], [0.4, 0.75]),
            (Analytic::Cube, [1.0, 0.2, 0.6], [0.6, 0.2]),
            (Analytic::Cube, [-1.0, 0.2, 0.6], [0.6, 0.8]),
            (Analytic::Cube, [0.2, 1.0, 0.6], [0.4, 0.2]),
            (Analytic::Cube, [0.2, -1.0, 0.6], [0.8, 0.6]),
        ] {
            let (mesh, point) = (shape.mesh(false), Vec3::from_array(point));
            let mut best = (f32::MAX, Vec2::ZERO);
            for corners in &mesh.triangles {
                let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
                let [ua, ub, uc] = corners.map(|i| mesh.uvs[i as usize]);
                let (e, f, p) = (b - a, c - a, point - a);
                let (ee, ef, ff) = (e.dot(e), e.dot(f), f.dot(f));
                let determinant = ee * ff - ef * ef;
                let s = (p.dot(e) * ff - p.dot(f) * ef) / determinant;
                let t = (p.dot(f) * ee - p.dot(e) * ef) / determinant;
                if s > -1e-3 && t > -1e-3 && s + t < 1.001 {
                    let off = (s * e + t * f - p).length();
                    if off < best.0 {
                        best = (off, ua + s * (ub - ua) + t * (uc - ua));
                    }
                }
            }
            let off = best.1 - Vec2::new(uv[0], 1.0 - uv[1]);
            assert!(off.length() < 4e-3, "{shape:?} {point}: {}", best.1);
        }
    }
}
