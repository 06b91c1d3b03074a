//! Normal maps.

use super::Texture;
use glam::{Vec2, Vec3};
use serde::Serialize;
use std::sync::Arc;

/// Minimum cosine between a bent normal and that of the triangle.
const LEAST_COSINE: f32 = 1e-2;

/// A map of normals in tangent space: red is along growing `u`, green along growing `v` (up in the
/// texture), blue off the surface.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NormalMap {
    /// The texture whose [`Texture::vector`] are the normals.
    pub texture: Arc<Texture>,
    /// Factor of red and green.
    pub scale: f32,
}

/// Directions along a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tangent {
    /// Along growing `u`, of any length.
    pub along_u: Vec3,
    /// 1 if growing `v` is to the left of it, seen from the front; -1 for a mirrored texture.
    pub turn: f32,
}

impl Tangent {
    /// The tangent of a triangle with these edges and texture coordinates; `None` if the latter lie
    /// on a line.
    pub(super) fn new([edge1, edge2]: [Vec3; 2], [a, b, c]: [Vec2; 3]) -> Option<Self> {
        let (b, c) = (b - a, c - a);
        let area = b.perp_dot(c);
        let turn = if area > 0.0 { 1.0 } else { -1.0 };
        let along_u = turn * (c.y * edge1 - b.y * edge2);
        (area != 0.0).then_some(Self { along_u, turn })
    }
}

impl NormalMap {
    /// The bent unit normal at `uv` of a triangle with the normal `flat` and the interpolated
    /// normal `normal`, all on the front side. `None` if the map does not bend it.
    pub(super) fn bend(
        &self,
        uv: Vec2,
        flat: Vec3,
        normal: Vec3,
        tangent: Tangent,
    ) -> Option<Vec3> {
        self.bend_by(self.texture.vector(uv), flat, normal, tangent)
    }

    /// [`Self::bend`] where the texture has this vector.
    pub(super) fn bend_by(
        &self,
        vector: Vec3,
        flat: Vec3,
        normal: Vec3,
        Tangent { along_u, turn }: Tangent,
    ) -> Option<Vec3> {
        let [right, up] = [vector.x * self.scale, vector.y * self.scale];
        if right == 0.0 && up == 0.0 {
            return None;
        }
        let right_of = along_u.reject_from_normalized(normal).try_normalize()?;
        let up_of = turn * normal.cross(right_of);
        let bent = right * right_of + up * up_of + vector.z.max(0.0) * normal;
        let bent = bent.try_normalize()?;
        // Keep it above the surface.
        Some((bent + (LEAST_COSINE - bent.dot(flat)).max(0.0) * flat).normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The normal of a uniform map `rgb` on the triangle (0, 0), (1, 0), (0, 1) with these
    /// coordinates.
    fn bent(rgb: [u8; 3], scale: f32, uvs: [Vec2; 3]) -> Option<Vec3> {
        let texels = vec![[rgb[0], rgb[1], rgb[2], 255]];
        let map = NormalMap { texture: Arc::new(Texture::new(1, 1, texels)), scale };
        let tangent = Tangent::new([Vec3::X, Vec3::Y], uvs)?;
        map.bend(Vec2::ZERO, Vec3::Z, Vec3::Z, tangent)
    }

    #[test]
    fn red_is_along_u_and_green_along_v() {
        let (o, u, v) = (Vec2::ZERO, Vec2::X, Vec2::Y);
        // Codes are 128 + 127 x; tilted by arctan(1/2) at a scale of 1.
        let (red, green) = ([192, 128, 255], [128, 192, 255]);
        let tilted = |side: Vec3| (side * (64.0 / 127.0) + Vec3::Z).normalize();
        for (rgb, uvs, side) in [
            (red, [o, u, v], Vec3::X),
            (green, [o, u, v], Vec3::Y),
            // A picture turned by a quarter: u runs along y, v along -x.
            (red, [o, -v, u], Vec3::Y),
            (green, [o, -v, u], -Vec3::X),
            // Mirrored: u runs along -x.
            (red, [u, o, u + v], -Vec3::X),
            (green, [u, o, u + v], Vec3::Y),
        ] {
            let normal = bent(rgb, 1.0, uvs).unwrap();
            assert!((normal - tilted(side)).length() < 1e-6, "{rgb:?} {uvs:?}: {normal}");
        }
        let more = bent(red, 2.0, [o, u, v]).unwrap();
        assert!((more - (128.0 / 127.0 * Vec3::X + Vec3::Z).normalize()).length() < 1e-6);
    }

    #[test]
    fn flat_maps_and_degenerate_coordinates_bend_nothing() {
        let (o, u, v) = (Vec2::ZERO, Vec2::X, Vec2::Y);
        assert_eq!(bent([128, 128, 255], 1.0, [o, u, v]), None);
        assert_eq!(bent([255, 128, 255], 0.0, [o, u, v]), None);
        assert_eq!(bent([255, 128, 255], 1.0, [o, u, 2.0 * u]), None);
        // Never below the surface.
        let low = bent([255, 0, 0], 1.0, [o, u, v]).unwrap();
        assert!(low.z > 0.0 && (low.length() - 1.0).abs() < 1e-6, "{low}");
    }
}
