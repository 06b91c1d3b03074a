//! Light that shading normals lose: theory.md, section 9.

use super::bsdf::Bsdf;
use super::shading::is_smooth;
use super::{Corners, Material, NormalMap, Scene};
use glam::{Vec2, Vec3};
use std::collections::BTreeMap;

/// Largest number of texels of a normal map along each axis that are looked at.
const MAP_SIDE: u32 = 128;

/// Light that the normals of a material lose.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalLoss {
    /// Name of the material.
    pub material: String,
    /// Share of uniform light that is lost at each reflection, mean over the area of the material.
    /// Exact for Lambertian surfaces, of which it is the share between both horizons, and a bound
    /// for others.
    pub share: f64,
}

impl Scene {
    /// Materials whose normals lose light, in the order of the materials. Lambertian surfaces with
    /// smooth normals lose none: theory.md (33a).
    pub fn light_lost_by_normals(&self) -> Vec<NormalLoss> {
        // Area and lost area of each material
        let mut sums: BTreeMap<u32, [f64; 2]> = BTreeMap::new();
        for (placement, first) in self.placements.iter().zip(self.first_triangle.iter()) {
            let (mesh, material) =
                (self.mesh(placement), &self.materials[placement.material as usize]);
            let map = material.normal_map.as_ref();
            let is_bent = !mesh.normals.is_empty() || map.is_some();
            let by_map = map.map_or(0.0, |map| lost_by_map(material, map));
            let [area, lost] = sums.entry(placement.material).or_default();
            for stored in &self.triangles[*first as usize..][..mesh.triangles.len()] {
                let triangle = placement.triangle(stored, self.ray_offset);
                *area += f64::from(triangle.area());
                let corners = self.corners.get(stored.corners as usize).filter(|_| is_bent);
                let Some(corners) = corners else { continue };
                let corners = placement
                    .transform
                    .map_or(*corners, |transform| corners.moved(&transform, triangle.normal));
                let share = lost_between_corners(material, &corners, triangle.normal) + by_map;
                *lost += f64::from(triangle.area()) * share;
            }
        }
        let scatters = |material: &Material| {
            !material.is_index_matched_boundary() && material.bsdf.albedo() != Vec3::ZERO
        };
        sums.into_iter()
            .map(|(index, sums)| (&self.materials[index as usize], sums))
            .filter(|(material, [area, lost])| scatters(material) && *lost > 0.0 && *area > 0.0)
            .map(|(material, [area, lost])| NormalLoss {
                material: material.name.clone(),
                share: (lost / area).min(1.0),
            })
            .collect()
    }
}

/// Share of uniform light that a surface loses where its normal and that of its triangle have this
/// cosine: the directions between both horizons for Lambertian surfaces. A mirror turns directions
/// by twice the angle, and other lobes lie between both.
fn lost(material: &Material, cosine: f32) -> f64 {
    let cosine = f64::from(cosine.clamp(0.0, 1.0));
    match material.bsdf {
        Bsdf::Lambertian { .. } => 0.5 * (1.0 - cosine),
        _ => 1.0 - cosine * cosine,
    }
}

/// Mean over a triangle of the share that interpolated normals lose. The mean over the middles of
/// its edges is exact for squares of small angles, which are polynomials of the second degree.
fn lost_between_corners(material: &Material, corners: &Corners, triangle: Vec3) -> f64 {
    let [a, b, c] = corners.normals;
    let is_lambertian = matches!(material.bsdf, Bsdf::Lambertian { .. });
    if is_lambertian && material.normal_map.is_none() && is_smooth(&corners.normals, triangle) {
        return 0.0;
    }
    let middle = |(a, b): (Vec3, Vec3)| (a + b).normalize_or(triangle).dot(triangle);
    let shares = [(a, b), (b, c), (c, a)].map(|edge| lost(material, middle(edge)));
    shares.iter().sum::<f64>() / 3.0
}

/// Mean over a map of the share that its normals lose on a flat surface.
fn lost_by_map(material: &Material, map: &NormalMap) -> f64 {
    let [width, height] = map.texture.size().map(|side| side.min(MAP_SIDE));
    let cosine = |(x, y): (u32, u32)| {
        let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) / Vec2::new(width as f32, height as f32);
        let vector = map.texture.vector(at);
        let bent = Vec3::new(vector.x * map.scale, vector.y * map.scale, vector.z.max(0.0));
        if bent.x == 0.0 && bent.y == 0.0 { 1.0 } else { bent.normalize_or(Vec3::Z).z }
    };
    let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let sum: f64 = texels.map(|texel| lost(material, cosine(texel))).sum();
    sum / f64::from((width * height).max(1))
}

#[cfg(test)]
mod tests {
    use super::super::bsdf::{Coated, Dielectric};
    use super::super::{Camera, FieldOfView, Mesh, Texture};
    use super::*;
    use std::sync::Arc;

    /// A square of each material; `normals` are those of all its corners.
    fn normal_loss(squares: &[(Material, Vec<Vec3>)]) -> Vec<NormalLoss> {
        let mesh = |(material, (_, normals)): (u32, &(Material, Vec<Vec3>))| Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y],
            uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
            normals: normals.clone(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            material,
            ..Mesh::default()
        };
        let meshes: Vec<Mesh> = (0..).zip(squares).map(mesh).collect();
        let materials = squares.iter().map(|(material, _)| material.clone()).collect();
        let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
        let scene = Scene::new("one".into(), meshes, materials, vec![], camera, vec![]).unwrap();
        scene.light_lost_by_normals()
    }

    #[test]
    fn shares_are_those_between_the_horizons() {
        let tilted = |degrees: f32| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            vec![Vec3::new(sin, 0.0, cos); 4]
        };
        let white = |name: &str| Material::new(name, Bsdf::diffuse(Vec3::ONE));
        let coated = |name: &str| Material::new(name, Bsdf::Coated(Coated::new(Vec3::ONE, 1.5)));
        let matched = Bsdf::Dielectric(Dielectric::new(1.0));
        // Codes 223 and 128: a slope of 95/127 over half of the area
        let texels = vec![[223, 128, 255, 255], [128, 128, 255, 255]];
        let texture = Arc::new(Texture::new(2, 1, texels));
        let map = Some(NormalMap { texture, scale: 1.0 });
        let found = normal_loss(&[
            (white("flat"), vec![]),
            (white("smooth"), tilted(10.0)),
            (white("coarse"), tilted(30.0)),
            (coated("coated"), tilted(10.0)),
            (Material::new("black", Bsdf::diffuse(Vec3::ZERO)), tilted(30.0)),
            (Material { normal_map: map, ..white("bumps") }, vec![]),
            (Material::new("air", matched), tilted(0.0)),
        ]);
        let cos = |degrees: f64| degrees.to_radians().cos();
        let bump = (1.0 + (95.0f64 / 127.0).powi(2)).sqrt().recip();
        let expected = [
            ("coarse", 0.5 * (1.0 - cos(30.0))),
            ("coated", 1.0 - cos(10.0).powi(2)),
            ("bumps", 0.25 * (1.0 - bump)),
        ];
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (own, (name, share)) in found.iter().zip(expected) {
            assert_eq!(own.material, name);
            assert!((own.share / share - 1.0).abs() < 1e-3, "{own:?} {share}");
        }
    }
}
