//! Where meshes are: those that are seen at several places are held once.

use super::diffuse::TriangleSide;
use super::lights::textured_emitter::TextureEmission;
use super::transform::Transform;
use super::{Corners, Emitter, Material, Mesh, Scene, Triangle};
use crate::accel;
use crate::accel::Geometry;
use crate::base::math::Bounds;
use glam::Vec3;

/// Where a mesh is, and what it is made of there.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    /// Index into [`Scene::meshes`].
    pub mesh: u32,
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// From the mesh's space to the scene's; none for a mesh in the scene's, which has no other
    /// place.
    pub transform: Option<Transform>,
}

/// Meshes with their places.
#[derive(Clone, Debug, Default)]
pub struct Arrangement {
    /// Held once each. What they are made of, their places say.
    pub meshes: Vec<Mesh>,
    /// In the order of their indices in hits.
    pub placements: Vec<Placement>,
}

impl From<Vec<Mesh>> for Arrangement {
    /// Each mesh where it is.
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
    /// A copy at a place, where all points must stay in the range of coordinates. Where corners change their
    /// order, vertices are numbered anew by their first use, so that copies are what readers make of them.
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
            triangles: self.triangles.iter().map(|t| transform.corners(*t)).collect(),
            material: self.material,
        };
        if transform.corners([0, 1, 2]) != [0, 1, 2] {
            moved.renumber();
        }
        moved
    }
}

impl Scene {
    /// The meshes at their places as an intersection backend takes them.
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
    pub(crate) fn placed_triangle(&self, place: u32, triangle: u32) -> Triangle {
        let first = self.first_triangle[place as usize];
        self.placements[place as usize].triangle(&self.triangles[(first + triangle) as usize])
    }

    /// The normal of [`Self::placed_triangle`] alone.
    pub(crate) fn placed_normal(&self, place: u32, triangle: u32) -> Vec3 {
        let first = self.first_triangle[place as usize];
        let stored = self.triangles[(first + triangle) as usize].normal;
        let transform = self.placements[place as usize].transform.as_ref();
        transform.map_or(stored, |transform| transform.normal(stored))
    }

    /// All triangles in the scene's space, placement after placement.
    pub fn triangles(&self) -> Vec<Triangle> {
        let mut triangles = Vec::with_capacity(self.triangle_count());
        for (placement, first) in self.placements.iter().zip(&self.first_triangle) {
            let count = self.mesh(placement).triangles.len();
            let stored = &self.triangles[*first as usize..][..count];
            triangles.extend(stored.iter().map(|triangle| placement.triangle(triangle)));
        }
        triangles
    }

    /// A copy of each mesh at each of its places, of the material that it has there.
    pub fn copies(&self) -> Vec<Mesh> {
        let copy = |placement: &Placement| {
            let mesh = self.mesh(placement);
            let transform = placement.transform.as_ref();
            let moved = transform.map_or_else(|| mesh.clone(), |transform| mesh.moved(transform));
            Mesh { material: placement.material, ..moved }
        };
        self.placements.iter().map(copy).collect()
    }

    /// Number of triangles, counted at each place.
    pub fn triangle_count(&self) -> usize {
        self.placements.iter().map(|placement| self.mesh(placement).triangles.len()).sum()
    }

    /// Number of triangles that are held, those of a mesh at several places once.
    pub fn stored_triangle_count(&self) -> usize {
        self.triangles.len()
    }
}

impl Placement {
    /// A triangle of the mesh in the scene's space.
    pub(crate) fn triangle(&self, stored: &Triangle) -> Triangle {
        let triangle = Triangle { material: self.material, ..*stored };
        self.transform.map_or(triangle, |transform| transform.triangle(&triangle))
    }

    /// The smallest box that also holds the mesh's triangles here.
    pub(crate) fn enclose(&self, bounds: Bounds, mesh: &Mesh) -> Bounds {
        let corners = mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize]);
        match self.transform {
            None => corners.fold(bounds, Bounds::with),
            Some(transform) => {
                corners.filter_map(|p| transform.point(p)).fold(bounds, Bounds::with)
            }
        }
    }

    /// Adds the mesh's triangles, which are `stored`, to the emitters if they emit here, and the side that does to
    /// `facets`; this is the placement of that number.
    pub(crate) fn emit(
        &self,
        mesh: &Mesh,
        stored: &[Triangle],
        materials: &[Material],
        (number, facets): (u32, &mut Vec<TriangleSide>),
        emitters: &mut Vec<Emitter>,
    ) {
        let material = &materials[self.material as usize];
        let radiance = material.emission;
        if radiance.max_element() <= 0.0 {
            return;
        }
        let picture = material.emission_texture.as_ref();
        let glow =
            picture.map(|picture| TextureEmission::new(picture, radiance, mesh.triangles.len()));
        let all = (0..).zip(mesh.triangles.iter().zip(stored));
        emitters.extend(all.filter_map(|(index, (indices, stored))| {
            let shape = self.triangle(stored);
            // Where a mesh is made tiny it may end up with none.
            if shape.area() <= 0.0 {
                return None;
            }
            facets.push(TriangleSide::new(number, index, true));
            Some(match &glow {
                None => Emitter::Triangle { shape, radiance },
                Some(glow) => {
                    let indices = indices.map(|index| index as usize);
                    let Corners { uvs, .. } = mesh.corners(indices, stored.normal);
                    let ordered = |transform: Transform| transform.ordered(uvs);
                    glow.emitter(shape, self.transform.map_or(uvs, ordered))
                }
            })
        }));
    }
}
