//! A scene: meshes, materials, lights and a camera, immutable once built.

pub mod backend;
pub mod camera;
mod cut_out;
pub mod diffuse;
mod fingerprint;
mod hit;
pub mod lights;
pub mod material;
mod normal_map;
mod placement;
mod shading;
mod surface;
mod texture;
pub(crate) mod transform;

pub use camera::{Camera, FieldOfView, Optics, View};
pub use hit::Seen;
pub use lights::emitter::{Directional, Emitter, Spot};
pub use lights::environment::Environment;
pub use lights::lanes::{Emissions, LightSamples};
pub use lights::textured_emitter::TexturedTriangle;
pub use lights::{Emission, LightSample, Lights};
pub use material::Material;
pub use normal_map::NormalMap;
pub use placement::{Arrangement, Placement};
pub use surface::Surface;
pub use texture::{Sampling, Texture, Wrap};
pub use transform::Transform;

use crate::accel::TriangleMesh;
use crate::base::error::{Error, Result};
use crate::base::math::{Bounds, Rgb};
use crate::bsdf::Bsdf;
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec2, Vec3};
use serde::{Deserialize, Serialize};
use std::ops::{Add, Mul};

/// A triangle mesh of one material: in the scene's space or, if it has several places, its own.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Name as in its file.
    pub name: String,
    /// Vertex positions, scene units.
    pub positions: Vec<Vec3>,
    /// Unit normals to interpolate, one per position, or none. They are turned to the front of their
    /// triangle; those of length zero, and those in its plane, are replaced by its own.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one per position, or none; `v` points up in the picture.
    pub uvs: Vec<Vec2>,
    /// Directions of growing `u` for maps of normals, one per position, or none: then those of each
    /// triangle's texture coordinates. Which way `v` grows, these tell.
    pub tangents: Vec<Vec3>,
    /// Three vertex indices per triangle, counterclockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// Index into [`Scene::materials`].
    pub material: u32,
}

impl Mesh {
    /// The geometry alone.
    pub fn as_triangles(&self) -> TriangleMesh<'_> {
        TriangleMesh { positions: &self.positions, triangles: &self.triangles }
    }

    /// What varies over the triangle of these corners and this normal.
    fn corners(&self, indices: [usize; 3], normal: Vec3) -> Corners {
        let own =
            |index: usize| to_front(self.normals.get(index).copied().unwrap_or_default(), normal);
        let uv = |index: usize| self.uvs.get(index).copied().unwrap_or_default();
        Corners { normals: indices.map(own), uvs: indices.map(uv) }
    }
}

/// A triangle as shading needs it: one cache line.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Triangle {
    /// First vertex.
    pub origin: Vec3,
    /// From the first vertex to the second.
    pub edge1: Vec3,
    /// From the first vertex to the third.
    pub edge2: Vec3,
    /// Unit normal of the front side.
    pub normal: Vec3,
    /// Distance off the surface at which rays start, past the rounding of points on it.
    pub offset: f32,
    /// Index into [`Scene::materials`].
    pub material: u32,
    area: f32,
    /// Index into [`Scene::corners`], or [`Triangle::FLAT`].
    corners: u32,
}

/// What varies over a triangle.
#[derive(Clone, Copy, Debug, Default)]
struct Corners {
    /// Unit normals on the front side.
    normals: [Vec3; 3],
    uvs: [Vec2; 3],
}

/// A vertex's normal, turned to the front of its triangle of this `normal`, and never in its plane.
fn to_front(given: Vec3, normal: Vec3) -> Vec3 {
    match given.dot(normal) {
        0.0 => normal,
        cos => given * cos.signum(),
    }
}

/// The mean of the corners' values with barycentric weights `u`, `v` of the second and third.
#[inline]
fn interpolate<T: Copy + Add<Output = T> + Mul<f32, Output = T>>(
    [a, b, c]: [T; 3],
    [u, v]: [f32; 2],
) -> T {
    a * (1.0 - u - v) + b * u + c * v
}

/// Normal of a triangle, twice its area long. In f64 neither overflow nor underflow is possible for
/// f32 corners of up to 1e15.
fn long_normal([a, b, c]: [Vec3; 3]) -> DVec3 {
    (b - a).as_dvec3().cross((c - a).as_dvec3())
}

/// Area of a triangle, scene units squared; 0 where it is too small for a normal number.
pub(crate) fn triangle_area(corners: [Vec3; 3]) -> f32 {
    let area = (0.5 * long_normal(corners).length()) as f32;
    if area < f32::MIN_POSITIVE { 0.0 } else { area }
}

impl Triangle {
    /// Nothing varies over it.
    const FLAT: u32 = u32::MAX;
    /// The same, but it has several places.
    const PLACED: u32 = u32::MAX - 1;

    fn new(corners: [Vec3; 3], material: u32) -> Self {
        let [a, b, c] = corners;
        let (edge1, edge2) = (b - a, c - a);
        let normal = long_normal(corners).normalize_or_zero().as_vec3();
        let offset = Self::offset(Self::largest(corners));
        let area = triangle_area(corners);
        let corners = Self::FLAT;
        Self { origin: a, edge1, edge2, normal, offset, material, area, corners }
    }

    /// The largest coordinate of its corners.
    fn largest([a, b, c]: [Vec3; 3]) -> f32 {
        a.abs().max(b.abs()).max(c.abs()).max_element()
    }

    /// An interpolated point is off its plane by a few units in the last place of the largest vertex
    /// coordinate.
    fn offset(largest: f32) -> f32 {
        largest * (32.0 * f32::EPSILON) + f32::MIN_POSITIVE
    }

    /// Area, scene units squared.
    pub fn area(&self) -> f32 {
        self.area
    }

    /// The point with barycentric weights `u`, `v` of the second and third vertex.
    #[inline]
    pub fn point(&self, [u, v]: [f32; 2]) -> Vec3 {
        self.origin + u * self.edge1 + v * self.edge2
    }
}

/// A named part of the image: the union of rectangles `[x0, x1) x [y0, y1)` in fractions of the
/// image's width and height, origin top left, so that it survives another resolution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Region {
    /// Name on the command line.
    pub name: String,
    /// `[x0, y0, x1, y1]` each.
    pub rectangles: Vec<[f64; 4]>,
}

impl Region {
    /// Whether the center of pixel `(x, y)` lies in it.
    pub fn contains(&self, x: u32, y: u32, width: u32, height: u32) -> bool {
        let u = (f64::from(x) + 0.5) / f64::from(width);
        let v = (f64::from(y) + 0.5) / f64::from(height);
        self.rectangles.iter().any(|&[x0, y0, x1, y1]| x0 <= u && u < x1 && y0 <= v && v < y1)
    }
}

/// Refuses rectangles that no region can have.
///
/// # Errors
/// If there is none, or one is empty or not within the image.
pub fn check_rectangles(rectangles: &[[f64; 4]]) -> Result<()> {
    let advice = "give [[x0, y0, x1, y1], ...] in fractions of the image with x0 < x1 and \
                  y0 < y1, the origin at the top left";
    if rectangles.is_empty() {
        return Err(Error::new("the region has no rectangle", advice));
    }
    for [x0, y0, x1, y1] in rectangles {
        // Written so that NaN fails.
        if !(0.0 <= *x0 && x0 < x1 && *x1 <= 1.0 && 0.0 <= *y0 && y0 < y1 && *y1 <= 1.0) {
            let problem = format!("the rectangle [{x0}, {y0}, {x1}, {y1}] is not in the image");
            return Err(Error::new(problem, advice));
        }
    }
    Ok(())
}

/// Everything that light meets.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name of the scene file or folder.
    pub name: String,
    /// All meshes.
    pub meshes: Vec<Mesh>,
    /// Where they are; the order is the mesh index of [`Hit`](crate::accel::Hit).
    pub placements: Vec<Placement>,
    /// All materials. What depends on them is computed when the scene is put together: to change one, make
    /// another scene.
    pub materials: Vec<Material>,
    /// All lights, emissive triangles among them.
    pub lights: Lights,
    /// Where the image is taken from.
    pub camera: Camera,
    /// Named parts of the image.
    pub regions: Vec<Region>,
    /// Box around all meshes.
    pub bounds: Bounds,
    /// All triangles, mesh after mesh, in their mesh's space.
    triangles: Vec<Triangle>,
    /// Of the triangles over which something varies.
    corners: Vec<Corners>,
    /// Index in `triangles` of the first of each placement's mesh.
    first_triangle: Vec<u32>,
    /// Of each material.
    lambertian: Vec<Lambertian>,
}

/// What is read of a material that is Lambertian, wherever nothing varies: 16 bytes.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
struct Lambertian {
    albedo: Rgb,
    /// What holds for it, bit by bit; without [`Self::IS_LAMBERTIAN`] the rest means nothing.
    flags: u32,
}

impl Lambertian {
    const IS_LAMBERTIAN: u32 = 1;
    const TWO_SIDED: u32 = 2;
    const EMITS: u32 = 4;

    fn of(material: &Material) -> Self {
        let Bsdf::Lambertian { albedo, two_sided } = material.bsdf else { return Self::default() };
        let emits = material.emission != Rgb::ZERO;
        let flag = |flag: u32, is_set: bool| flag * u32::from(is_set);
        let flags = flag(Self::TWO_SIDED, two_sided) | flag(Self::EMITS, emits);
        Self { albedo, flags: flags | Self::IS_LAMBERTIAN }
    }
}

impl Scene {
    /// Puts a scene together; `lights` come on top of the emissive triangles.
    ///
    /// Meshes must be valid: finite positions, indices in range, materials in range, no triangle of
    /// zero area, fewer than 2^32 triangles in all; and so at each place ([`load()`] sees to it).
    pub fn new(
        name: String,
        arrangement: impl Into<Arrangement>,
        materials: Vec<Material>,
        lights: Vec<Emitter>,
        camera: Camera,
        regions: Vec<Region>,
    ) -> Self {
        let Arrangement { meshes, placements } = arrangement.into();
        let mut varies: Vec<_> = meshes.iter().map(|mesh| !mesh.normals.is_empty()).collect();
        // What to put into stored triangles: of shared meshes, any of their materials.
        let mut looks = vec![(Triangle::FLAT, 0); meshes.len()];
        for Placement { mesh, material, transform } in &placements {
            varies[*mesh as usize] |= materials[*material as usize].varies();
            let flat = if transform.is_some() { Triangle::PLACED } else { Triangle::FLAT };
            looks[*mesh as usize] = (flat, *material);
        }
        let mut triangles = Vec::with_capacity(meshes.iter().map(|m| m.triangles.len()).sum());
        let mut first_of_mesh = Vec::with_capacity(meshes.len());
        let mut corners = Vec::new();
        for ((mesh, varies), (flat, material)) in meshes.iter().zip(varies).zip(looks) {
            first_of_mesh.push(triangles.len() as u32);
            for indices in &mesh.triangles {
                let indices = indices.map(|index| index as usize);
                let points = indices.map(|index| mesh.positions[index]);
                let mut shape = Triangle { corners: flat, ..Triangle::new(points, material) };
                if varies {
                    shape.corners = corners.len() as u32;
                    corners.push(mesh.corners(indices, shape.normal));
                }
                triangles.push(shape);
            }
        }

        let mut bounds = Bounds::EMPTY;
        let mut first_triangle = Vec::with_capacity(placements.len());
        let mut emitters = lights;
        for placement in &placements {
            let mesh = &meshes[placement.mesh as usize];
            let first = first_of_mesh[placement.mesh as usize];
            let stored = &triangles[first as usize..][..mesh.triangles.len()];
            first_triangle.push(first);
            bounds = placement.enclose(bounds, mesh);
            placement.emit(mesh, stored, &materials, &mut emitters);
        }
        for emitter in &mut emitters {
            if let Emitter::Directional(light) = emitter {
                light.center = bounds.center();
                light.radius = bounds.enclosing_radius();
            }
        }
        let lights = Lights::new(emitters);
        Self {
            name,
            meshes,
            placements,
            lambertian: materials.iter().map(Lambertian::of).collect(),
            materials,
            lights,
            camera,
            regions,
            bounds,
            triangles,
            corners,
            first_triangle,
        }
    }

    /// The scene with light from all around.
    #[must_use]
    pub fn with_environment(mut self, mut environment: Environment) -> Self {
        environment.enclose(&self.bounds);
        self.lights.set_environment(environment);
        self
    }

    /// Longest side of the bounding box, scene units.
    pub fn size(&self) -> f32 {
        self.bounds.longest_side()
    }

    /// Whether any surface asks photons where they came from: with a BSDF that varies, or a normal
    /// that is not the triangle's.
    pub fn merges_by_direction(&self) -> bool {
        self.materials.iter().any(Material::merges_by_direction)
            || self.meshes.iter().any(|mesh| !mesh.normals.is_empty())
    }
}
