//! Triangle meshes of round shapes.
//!
//! Readers scale them to the area of the shape, which preserves the power of lamps. The mean shadow
//! of a convex body is a quarter of its area (Cauchy), so that the light at large distances is
//! preserved as well.

use bdpm_core::scene::Mesh;
use glam::{Vec2, Vec3};

/// Steps around a round shape. Lamps have fewer, because each of their triangles is a light.
pub fn steps(is_lamp: bool) -> u32 {
    if is_lamp { 32 } else { 128 }
}

/// A grid of points over u and v from 0 to 1. It faces the side from which growing v turns to
/// growing u.
pub fn grid(columns: u32, rows: u32, point: impl Fn(f32, f32) -> Vec3) -> Mesh {
    let mut mesh = Mesh::default();
    for row in 0..=rows {
        for column in 0..=columns {
            let (u, v) = (column as f32 / columns as f32, row as f32 / rows as f32);
            mesh.positions.push(point(u, v));
            mesh.uvs.push(Vec2::new(u, 1.0 - v));
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let a = row * (columns + 1) + column;
            let [b, c, d] = [a + 1, a + columns + 2, a + columns + 1];
            mesh.triangles.extend([[a, d, c], [a, c, b]]);
        }
    }
    // Remove triangles that degenerate at a pole or the center.
    let positions = &mesh.positions;
    mesh.triangles.retain(|corners| {
        let [a, b, c] = corners.map(|i| positions[i as usize]);
        (b - a).cross(c - a).length() > 1e-7
    });
    mesh
}

/// Area of all triangles.
pub fn area(mesh: &Mesh) -> f32 {
    let double = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
        f64::from((b - a).cross(c - a).length())
    };
    (0.5 * mesh.triangles.iter().map(double).sum::<f64>()) as f32
}
