//! Normals of vertices for meshes that bring none, as Mitsuba makes them.

use crate::scene::Mesh;
use glam::Vec3;

/// Sets each vertex's normal to the mean of its triangles', by their angles there (Thürmer and Wüthrich 1998).
pub(super) fn normals(mesh: &mut Mesh) {
    let mut normals = vec![Vec3::ZERO; mesh.positions.len()];
    for corners in &mesh.triangles {
        let points = corners.map(|i| mesh.positions[i as usize]);
        let normal = (points[1] - points[0]).cross(points[2] - points[0]).normalize_or_zero();
        for i in 0..3 {
            let [a, b, c] = [i, (i + 1) % 3, (i + 2) % 3].map(|i| points[i]);
            let (e, f) = ((b - a).normalize_or_zero(), (c - a).normalize_or_zero());
            let angle = e.dot(f).clamp(-1.0, 1.0).acos();
            normals[corners[i] as usize] += angle * normal;
        }
    }
    mesh.normals = normals.into_iter().map(Vec3::normalize_or_zero).collect();
}
