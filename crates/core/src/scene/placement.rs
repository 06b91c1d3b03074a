//! Placements of meshes: a mesh with several placements is stored once.

use super::diffuse::TriangleSide;
use super::lights::luminaire::OpeningEmitter;
use super::lights::textured_emitter::TextureEmission;
use super::transform::Transform;
use super::{Corners, Emitter, Material, Mesh, Scene, Triangle};
use crate::accel;
use crate::accel::Geometry;
use crate::base::math::{Bounds, Rgb};
use glam::Vec3;
use std::sync::Arc;

/// A placed mesh and its material.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    /// Index into [`Scene::meshes`].
    pub mesh: u32,
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// Transform from the mesh's space to the scene's; `None` for a mesh in scene space, which has
    /// no other placement.
    pub transform: Option<Transform>,
}

/// Meshes and their placements.
#[derive(Clone, Debug, Default)]
pub struct Arrangement {
    /// Each mesh once; the materials are those of the placements.
    pub meshes: Vec<Mesh>,
    /// In the order of their indices in hits.
    pub placements: Vec<Placement>,
}

impl From<Vec<Mesh>> for Arrangement {
    /// One placement per mesh, in scene space.
    fn from(meshes: Vec<Mesh>) -> Self {
        let place = |(mesh, Mesh { material, .. }): (u32, &Mesh)| Placement {
            mesh,
            material: *material,
            transform: None,
        };
        Self { placements: (0..).zip(&meshes).map(place).collect(), meshes }
    }
}

impl Mesh {
    /// A transformed copy; all points must stay in the range of coordinates. If corners change
    /// their order, vertices are renumbered by their first use, as readers number them.
    #[must_use]
    pub fn moved(&self, transform: &Transform) -> Self {
        let point = |point: &Vec3| transform.point(*point).unwrap_or_default();
        let mut moved = Self {
            name: self.name.clone(),
            positions: self.positions.iter().map(point).collect(),
            normals: self.normals.iter().map(|normal| transform.normal(*normal)).collect(),
            uvs: self.uvs.clone(),
            colors: self.colors.clone(),
            tangents: self.tangents.iter().map(|t| transform.tangent(*t)).collect(),
            triangles: self.triangles.iter().map(|t| transform.ordered(*t)).collect(),
            material: self.material,
        };
        if transform.ordered([0, 1, 2]) != [0, 1, 2] {
            moved.renumber();
        }
        moved
    }
}

impl Scene {
    /// Boxes around all surfaces that may send light on: that reflect or transmit any.
    pub fn boxes_of_scattering_surfaces(&self) -> Vec<Bounds> {
        let is_black = |placement: &Placement| {
            self.materials[placement.material as usize].bsdf.albedo() == Rgb::ZERO
        };
        let boxes = outer_boxes(&self.meshes, &self.placements).into_iter();
        let all = boxes.zip(self.placements.iter()).filter(|(_, placement)| !is_black(placement));
        all.map(|(own, _)| own).collect()
    }

    /// The meshes and placements as the input of an intersection backend.
    pub fn geometry(&self) -> Geometry<'_> {
        let place = |placement: &Placement| accel::Instance {
            mesh: placement.mesh,
            to_scene: placement.transform.map(|transform| transform.map()),
        };
        Geometry {
            meshes: self.meshes.iter().map(Mesh::as_triangles).collect(),
            instances: self.placements.iter().map(place).collect(),
        }
    }

    /// The mesh of a placement, in its own space.
    pub fn mesh(&self, placement: &Placement) -> &Mesh {
        &self.meshes[placement.mesh as usize]
    }

    /// A triangle of a placement in the scene's space.
    pub fn placed_triangle(&self, place: u32, triangle: u32) -> Triangle {
        let first = self.first_triangle[place as usize];
        let stored = &self.triangles[(first + triangle) as usize];
        self.placements[place as usize].triangle(stored, self.ray_offset)
    }

    /// The normal of [`Self::placed_triangle`] alone.
    pub fn placed_normal(&self, place: u32, triangle: u32) -> Vec3 {
        let first = self.first_triangle[place as usize];
        let stored = self.triangles[(first + triangle) as usize].normal;
        let transform = self.placements[place as usize].transform.as_ref();
        transform.map_or(stored, |transform| transform.normal(stored))
    }

    /// All triangles in the scene's space, placement after placement.
    pub fn triangles(&self) -> Vec<Triangle> {
        let mut triangles = Vec::with_capacity(self.triangle_count());
        for (placement, first) in self.placements.iter().zip(self.first_triangle.iter()) {
            let count = self.mesh(placement).triangles.len();
            let stored = &self.triangles[*first as usize..][..count];
            triangles.extend(stored.iter().map(|one| placement.triangle(one, self.ray_offset)));
        }
        triangles
    }

    /// A copy of each mesh for each of its placements, with its material.
    pub fn copies(&self) -> Vec<Mesh> {
        let copy = |placement: &Placement| {
            let mesh = self.mesh(placement);
            let transform = placement.transform.as_ref();
            let moved = transform.map_or_else(|| mesh.clone(), |transform| mesh.moved(transform));
            Mesh { material: placement.material, ..moved }
        };
        self.placements.iter().map(copy).collect()
    }

    /// Number of triangles, counted for each placement.
    pub fn triangle_count(&self) -> usize {
        self.placements.iter().map(|placement| self.mesh(placement).triangles.len()).sum()
    }

    /// Number of triangles in memory, those of a mesh with several placements once.
    pub fn stored_triangle_count(&self) -> usize {
        self.triangles.len()
    }
}

/// Emitters of a scene that is being built.
pub(super) struct Emitting<'a> {
    /// Distance off surfaces at which rays start, besides rounding errors, scene units.
    pub ray_offset: f32,
    /// Sides that emit, and the indices of their emitters.
    pub facets: &'a mut Vec<(TriangleSide, usize)>,
    pub emitters: &'a mut Vec<Emitter>,
}

/// A box around each placement. It may be larger than the smallest one.
fn outer_boxes(meshes: &[Mesh], placements: &[Placement]) -> Vec<Bounds> {
    let of_mesh = |mesh: &Mesh| {
        Placement { mesh: 0, material: 0, transform: None }.enclose(Bounds::EMPTY, mesh)
    };
    let of_meshes: Vec<Bounds> = meshes.iter().map(of_mesh).collect();
    placements.iter().map(|own| own.outer_box(&of_meshes[own.mesh as usize])).collect()
}

impl Arrangement {
    /// The smallest box that contains all placed triangles. Of many instances only those are
    /// visited whose own box may reach beyond the others.
    pub fn bounds(&self) -> Bounds {
        let boxes = outer_boxes(&self.meshes, &self.placements);
        let mut bounds = Bounds::EMPTY;
        for axis in 0..3 {
            for is_upper in [false, true] {
                let reach = |own: &Bounds| if is_upper { own.max[axis] } else { -own.min[axis] };
                let mut order: Vec<usize> = (0..boxes.len()).collect();
                order.sort_unstable_by(|a, b| reach(&boxes[*b]).total_cmp(&reach(&boxes[*a])));
                for index in order {
                    if reach(&boxes[index]) <= reach(&bounds) {
                        break;
                    }
                    let own = &self.placements[index];
                    bounds = own.enclose(bounds, &self.meshes[own.mesh as usize]);
                }
            }
        }
        bounds
    }
}

impl Placement {
    /// A box that contains the placed triangles of a mesh, which are in the box `own`. It may be
    /// larger.
    fn outer_box(&self, own: &Bounds) -> Bounds {
        let Some(transform) = self.transform else { return *own };
        if own.min.cmpgt(own.max).any() {
            return Bounds::EMPTY;
        }
        let corner = |i: u32| {
            let is_upper = glam::BVec3::new(i & 1 != 0, i & 2 != 0, i & 4 != 0);
            transform.point(Vec3::select(is_upper, own.max, own.min))
        };
        let corners: Option<Vec<Vec3>> = (0..8).map(corner).collect();
        // Corners of the box may be out of the range of coordinates where triangles are not.
        let Some(corners) = corners else {
            return Bounds { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY };
        };
        let outer = corners.into_iter().fold(Bounds::EMPTY, Bounds::with);
        // Points are rounded.
        let largest = outer.min.abs().max(outer.max.abs()).max_element();
        let margin = Vec3::splat(1e-5 * largest + f32::MIN_POSITIVE);
        Bounds { min: outer.min - margin, max: outer.max + margin }
    }

    /// A triangle of the mesh in the scene's space. Rays start at `ray_offset` off it, besides
    /// rounding errors.
    pub(crate) fn triangle(&self, stored: &Triangle, ray_offset: f32) -> Triangle {
        let triangle = Triangle { material: self.material, ..*stored };
        let Some(transform) = self.transform else { return triangle };
        let triangle = transform.triangle(&triangle);
        Triangle { offset: triangle.offset + ray_offset, ..triangle }
    }

    /// The smallest box that contains `bounds` and the placed triangles of the mesh.
    pub(crate) fn enclose(&self, bounds: Bounds, mesh: &Mesh) -> Bounds {
        let corners = mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize]);
        match self.transform {
            None => corners.fold(bounds, Bounds::with),
            Some(transform) => {
                corners.filter_map(|p| transform.point(p)).fold(bounds, Bounds::with)
            }
        }
    }

    /// Adds the mesh's triangles, which are `stored`, to the emitters if this placement emits, and
    /// their sides that emit to the facets; this is placement `number`.
    pub(super) fn emit(
        &self,
        mesh: &Mesh,
        stored: &[Triangle],
        materials: &[Material],
        number: u32,
        Emitting { ray_offset, facets, emitters }: &mut Emitting,
    ) {
        let material = &materials[self.material as usize];
        if let Some(opening) = &material.luminous_opening {
            let triangles = stored.iter().map(|one| self.triangle(one, *ray_offset)).collect();
            let sides = if opening.is_flat() { &[true, false][..] } else { &[true] };
            for front in sides {
                let own = (0..mesh.triangles.len() as u32)
                    .map(|index| (TriangleSide::new(number, index, *front), emitters.len()));
                facets.extend(own);
            }
            let emitter = OpeningEmitter::new(Arc::clone(opening), triangles);
            emitters.push(Emitter::Opening(Box::new(emitter)));
            return;
        }
        let radiance = material.emission;
        if radiance.max_element() <= 0.0 {
            return;
        }
        let glow = TextureEmission::of(material, mesh.triangles.len());
        let sides = if material.two_sided_emission { &[true, false][..] } else { &[true] };
        for (index, (indices, stored)) in (0..).zip(mesh.triangles.iter().zip(stored)) {
            let shape = self.triangle(stored, *ray_offset);
            // A very small scale may leave no area.
            if shape.area() <= 0.0 {
                continue;
            }
            let emitter = match &glow {
                None => Emitter::Triangle { shape, radiance },
                Some(glow) => {
                    let indices = indices.map(|index| index as usize);
                    let Corners { uvs, .. } = mesh.corners(indices, stored.normal);
                    let ordered = |transform: Transform| transform.ordered(uvs);
                    glow.emitter(shape, self.transform.map_or(uvs, ordered))
                }
            };
            for front in sides {
                facets.push((TriangleSide::new(number, index, *front), emitters.len()));
                emitters.push(if *front { emitter.clone() } else { emitter.flipped() });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Stream, StreamKey};
    use glam::{DAffine3, DQuat, DVec3};

    #[test]
    fn bounds_of_many_placements_are_those_of_all_their_triangles() {
        let mut rng = StreamKey::new(5, Stream::Test, 0).rng(0);
        let mut random = move || f64::from(rng.next_2d()[0]) - 0.5;
        let mut mesh = || {
            let points = 12;
            let positions = (0..points).map(|_| {
                DVec3::new(random(), random(), 3.0 * random()).as_vec3() + Vec3::splat(1.0)
            });
            let triangles = (0..points - 2).map(|i| [i, i + 1, i + 2]).collect();
            Mesh { positions: positions.collect(), triangles, ..Mesh::default() }
        };
        let meshes = vec![mesh(), mesh(), mesh()];
        let mut rng = StreamKey::new(6, Stream::Test, 0).rng(0);
        let mut random = move || f64::from(rng.next_2d()[0]) - 0.5;
        for round in 0..50 {
            let mut placements = vec![Placement { mesh: 2, material: 0, transform: None }];
            for index in 0..40 {
                let scale = DVec3::splat(1.0 + 3.0 * random());
                let turn =
                    DQuat::from_rotation_y(7.0 * random()) * DQuat::from_rotation_x(random());
                let offset = 0.2 * f64::from(round) * DVec3::new(random(), random(), random());
                let map = DAffine3::from_scale_rotation_translation(scale, turn, offset);
                let transform = Some(Transform::new(map).unwrap());
                placements.push(Placement { mesh: index % 2, material: 0, transform });
            }
            let one_by_one = placements
                .iter()
                .fold(Bounds::EMPTY, |bounds, one| one.enclose(bounds, &meshes[one.mesh as usize]));
            let all = Arrangement { meshes: meshes.clone(), placements }.bounds();
            assert_eq!([all.min, all.max], [one_by_one.min, one_by_one.max]);
        }
    }
}
