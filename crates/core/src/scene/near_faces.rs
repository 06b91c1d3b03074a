//! Faces of two transparent bodies that are closer to each other than rays start off surfaces: a
//! ray that leaves one of them misses the other.

use super::Scene;
use super::bsdf::Bsdf;
use crate::accel::{Intersect, Ray, next_after};
use std::collections::BTreeMap;

/// Maximum number of triangles that are examined, evenly among all of a scene.
const TRIANGLES: usize = 20_000;

/// Barycentric weights of the examined points of a triangle: inside, and off the symmetry of
/// neighbors.
const POINTS: [[f32; 2]; 3] = [[0.31, 0.36], [0.11, 0.17], [0.13, 0.71]];

/// Offsets of rays within which another face may be missed: the offset of the ray, and rounding of
/// both faces.
const REACH: f32 = 2.0;

/// Maximum number of hits around a point.
const HITS: u32 = 8;

/// Two bodies with faces that rays may miss.
#[derive(Clone, Debug, PartialEq)]
pub struct NearFaces {
    /// Names of their meshes, or of their materials.
    pub names: [String; 2],
    /// Distance from which on no face is missed, scene units.
    pub distance: f32,
}

impl NearFaces {
    /// What is wrong, and what to do.
    pub fn describe(&self) -> String {
        let Self { names: [one, other], distance } = self;
        format!(
            "faces of `{one}` and `{other}` touch or are closer than {distance:.1e}: rays that leave one of them miss \
             the other, and light there may be wrong\nhelp: move them apart by more than that, or let one body reach \
             into the other"
        )
    }
}

impl Scene {
    /// Pairs of transparent bodies with faces so close to each other that rays miss one of them,
    /// each pair once.
    pub fn near_faces(&self, accel: &dyn Intersect) -> Vec<NearFaces> {
        let is_clear: Vec<bool> =
            (0..self.placements().len() as u32).map(|place| self.is_clear(place)).collect();
        if is_clear.iter().filter(|is_clear| **is_clear).count() < 2 {
            return Vec::new();
        }
        let counts = self.placements().iter().map(|placement| self.mesh(placement).triangles.len());
        let places = (0..).zip(counts).flat_map(|(place, count)| std::iter::repeat_n(place, count));
        let mut clear: Vec<_> = places.zip(self.triangles()).collect();
        clear.retain(|(place, triangle)| is_clear[*place as usize] && triangle.area() > 0.0);
        let mut found: BTreeMap<[u32; 2], f32> = BTreeMap::new();
        for (place, triangle) in clear.iter().step_by(clear.len().div_ceil(TRIANGLES).max(1)) {
            for at in POINTS {
                let reach = REACH * triangle.offset;
                let start = triangle.point(at) + reach * triangle.normal;
                let ray = Ray { t_far: 2.0 * reach, ..Ray::new(start, -triangle.normal) };
                let (mut hit, mut step) = (accel.closest_hit(&ray), f32::EPSILON);
                for _ in 0..HITS {
                    if hit.is_miss() {
                        break;
                    }
                    if hit.mesh != *place && is_clear[hit.mesh as usize] {
                        let pair = [hit.mesh.min(*place), hit.mesh.max(*place)];
                        let most = found.entry(pair).or_insert(0.0);
                        *most = most.max(reach);
                    }
                    (hit, step) = next_after(accel, &ray, &hit, step);
                }
            }
        }
        let named = |(pair, distance): ([u32; 2], f32)| NearFaces {
            names: pair.map(|place| self.name_of(place)),
            distance,
        };
        found.into_iter().map(named).collect()
    }

    /// Light enters the body of a placement.
    fn is_clear(&self, place: u32) -> bool {
        let placement = &self.placements()[place as usize];
        let material = &self.materials()[placement.material as usize];
        let has_body = self.media().is_some_and(|media| media.bounds_medium(place));
        let is_sheet = matches!(material.bsdf, Bsdf::ThinDielectric(_));
        has_body || (material.bsdf.transmits() && !material.bsdf.transmits_diffusely() && !is_sheet)
    }

    fn name_of(&self, place: u32) -> String {
        let placement = &self.placements()[place as usize];
        let name = &self.mesh(placement).name;
        if name.is_empty() {
            self.materials()[placement.material as usize].name.clone()
        } else {
            name.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::backend::{self, Backend};
    use crate::scene::bsdf::Dielectric;
    use crate::scene::{Camera, FieldOfView, Material, Mesh};
    use glam::Vec3;

    /// A triangle of a material in the plane z = `height`.
    fn face(height: f32, material: u32) -> Mesh {
        let corners = [[-1.0, -1.0], [3.0, -1.0], [-1.0, 3.0]];
        let positions = corners.map(|[x, y]| Vec3::new(x, y, height)).into();
        Mesh { positions, triangles: vec![[0, 1, 2]], material, ..Mesh::default() }
    }

    #[test]
    fn faces_closer_than_the_offset_of_rays_are_named_and_others_not() {
        let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
        let pairs = |gap: f32, bsdf: Bsdf| {
            let glass = Material::new("glass", Bsdf::Dielectric(Dielectric::new(1.5)));
            let materials = vec![glass, Material::new("other", bsdf)];
            let meshes = vec![face(1.0, 0), face(1.0 + gap, 1)];
            let own = Scene::new("two".into(), meshes, materials, vec![], camera, vec![]);
            let own = own.unwrap();
            let accel = backend::build(Backend::Bvh, &own).unwrap();
            own.near_faces(&*accel)
        };
        let water = Bsdf::Dielectric(Dielectric::new(1.33));
        for (gap, is_near) in
            [(0.0, true), (1e-7, true), (-1e-7, true), (1e-6, true), (2e-5, false), (1e-3, false)]
        {
            let found = pairs(gap, water);
            assert_eq!(!found.is_empty(), is_near, "{gap}: {found:?}");
            for pair in found {
                assert!(pair.distance > gap.abs() && pair.distance < 2e-5, "{pair:?}");
                assert_eq!(pair.names, ["glass".to_owned(), "other".to_owned()]);
            }
        }
        assert_eq!(pairs(0.0, Bsdf::diffuse(Vec3::ONE)), [], "rays end at opaque faces");
    }
}
