//! Conversion of height maps to normal maps.

use bdpm_core::scene::{Mesh, NormalMap, Texture, Wrap};
use glam::{DMat3, Mat3, Vec2, Vec3};
use std::sync::Arc;

/// The normal map of heights, which are `scale` scene units at white, on a mesh that `to_world`
/// transforms. The slopes assume that texture coordinates grow everywhere as fast as in the mean
/// over the area of the mesh. `None` if the mesh has no usable texture coordinates.
pub(super) fn normal_map(
    heights: &Arc<Texture>,
    scale: f32,
    mesh: &Mesh,
    to_world: DMat3,
) -> Option<NormalMap> {
    let lengths = lengths(mesh, to_world.as_mat3())?;
    let [width, height] = heights.size().map(|size| size as usize);
    let wrap = heights.sampling().wrap;
    let index = |wrap: Wrap, i: i64, size: usize| match wrap {
        Wrap::Repeat => i.rem_euclid(size as i64) as usize,
        Wrap::Mirror | Wrap::Clamp => i.clamp(0, size as i64 - 1) as usize,
    };
    let texels = heights.texels();
    let at = |x: i64, y: i64| {
        let texel = texels[index(wrap[1], y, height) * width + index(wrap[0], x, width)];
        (f32::from(texel[0]) + f32::from(texel[1]) + f32::from(texel[2])) * (scale / 765.0)
    };
    let mut slopes = Vec::with_capacity(width * height);
    for y in 0..height as i64 {
        for x in 0..width as i64 {
            // Rows go down, v goes up.
            let along_u = 0.5 * (at(x + 1, y) - at(x - 1, y)) * width as f32;
            let along_v = 0.5 * (at(x, y - 1) - at(x, y + 1)) * height as f32;
            slopes.push(Vec2::new(along_u, along_v) / lengths);
        }
    }
    let code = |x: f32| (128.0 + 127.0 * x).round().clamp(1.0, 255.0) as u8;
    let texels = slopes.iter().map(|slope| {
        let normal = Vec3::new(-slope.x, -slope.y, 1.0).normalize();
        [code(normal.x), code(normal.y), code(normal.z), 255]
    });
    let map = Texture::new(width as u32, height as u32, texels.collect());
    Some(NormalMap { texture: Arc::new(map.sampled(heights.sampling())), scale: 1.0 })
}

/// Mean lengths on the surface of a unit of the texture coordinates, scene units.
fn lengths(mesh: &Mesh, to_world: Mat3) -> Option<Vec2> {
    let (mut sum, mut area) = (Vec2::ZERO, 0.0);
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|i| to_world * mesh.positions[i as usize]);
        let [ua, ub, uc] = corners.map(|i| mesh.uvs.get(i as usize).copied().unwrap_or_default());
        let (e, f, s, t) = (b - a, c - a, ub - ua, uc - ua);
        let turn = s.perp_dot(t);
        let own = e.cross(f).length();
        let along_u = (t.y * e - s.y * f) / turn;
        let along_v = (s.x * f - t.x * e) / turn;
        if along_u.is_finite() && along_v.is_finite() {
            sum += own * Vec2::new(along_u.length(), along_v.length());
            area += own;
        }
    }
    let mean = sum / area;
    (mean.is_finite() && mean.min_element() > 0.0).then_some(mean)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_are_those_of_the_transformed_surface() {
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        let mesh = Mesh {
            positions: corners.map(|(x, y)| Vec3::new(x, y, 0.0)).into(),
            uvs: corners.map(Vec2::from).into(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        };
        // One code per texel along u: over the middle ones the height grows by 4/255.
        let texels = [0, 1, 2, 3].map(|code| [code, code, code, 255]);
        let heights = Arc::new(Texture::new(4, 1, texels.to_vec()));
        let slope = |to_world: DMat3| {
            let map = normal_map(&heights, 100.0, &mesh, to_world).unwrap();
            let normal = map.texture.vector(Vec2::new(0.375, 0.5));
            [-normal.x / normal.z, -normal.y / normal.z]
        };
        let height = 100.0 * 4.0 / 255.0;
        for (stretch, expected) in [(1.0, height), (2.0, height / 2.0), (4.0, height / 4.0)] {
            let [along_u, along_v] =
                slope(DMat3::from_diagonal(glam::DVec3::new(stretch, 3.0, 5.0)));
            assert!((along_u / expected - 1.0).abs() < 0.03, "{stretch}: {along_u}, {expected}");
            assert!(along_v.abs() < 0.02, "{along_v}");
        }
    }
}
