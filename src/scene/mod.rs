//! A scene: meshes, materials, lights and a camera, immutable once built.

mod builder;
pub mod camera;
mod camera_table;
pub mod emitter;
pub mod environment;
mod environment_table;
mod fingerprint;
mod framing;
mod gltf;
pub mod light;
mod light_choice;
mod light_cluster;
mod light_table;
mod light_tree;
pub mod load;
pub mod material;
mod material_numbers;
mod material_table;
mod mtl;
mod mtl_material;
mod normal_map;
pub mod notes;
mod obj;
mod obj_records;
mod scene_file;
mod shading;
mod solid_angle;
pub mod summary;
mod surface;
mod text;
mod texture;
mod texture_file;
mod textured_emitter;
mod transform;

pub use camera::{Camera, FieldOfView, Optics, View};
pub use emitter::{Directional, Emitter, Spot};
pub use environment::Environment;
pub use light::{Emission, LightSample, Lights};
pub use load::{LoadOptions, Loaded, load, load_with};
pub use material::Material;
pub use normal_map::NormalMap;
pub use notes::{Note, NoteKind};
pub use summary::Summary;
pub use surface::Surface;
pub use texture::{Sampling, Texture, Wrap};
pub use textured_emitter::TexturedTriangle;

use crate::accel::{Hit, Ray, TriangleMesh};
use crate::bsdf::Bsdf;
use crate::error::{Error, Result};
use crate::math::Bounds;
use glam::{DVec3, Vec2, Vec3};
use normal_map::Tangent;
use serde::{Deserialize, Serialize};
use std::ops::{Add, Mul};
use textured_emitter::Glow;

/// A triangle mesh of one material, in world space.
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
        let own = |index: usize| {
            let given = self.normals.get(index).copied().unwrap_or_default();
            match given.dot(normal) {
                0.0 => normal,
                cos => given * cos.signum(),
            }
        };
        let uv = |index: usize| self.uvs.get(index).copied().unwrap_or_default();
        Corners { normals: indices.map(own), uvs: indices.map(uv) }
    }
}

/// A triangle as shading needs it: one cache line.
#[derive(Clone, Copy, Debug, PartialEq)]
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

    fn new(corners: [Vec3; 3], material: u32) -> Self {
        let [a, b, c] = corners;
        let (edge1, edge2) = (b - a, c - a);
        let normal = long_normal(corners).normalize_or_zero().as_vec3();
        // An interpolated point is off its plane by a few units in the last place of the largest
        // vertex coordinate.
        let largest = a.abs().max(b.abs()).max(c.abs()).max_element();
        let offset = largest * (32.0 * f32::EPSILON) + f32::MIN_POSITIVE;
        let area = triangle_area(corners);
        let corners = Self::FLAT;
        Self { origin: a, edge1, edge2, normal, offset, material, area, corners }
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
    /// All meshes; their order is the mesh index of [`Hit`].
    pub meshes: Vec<Mesh>,
    /// All materials.
    pub materials: Vec<Material>,
    /// All lights, emissive triangles among them.
    pub lights: Lights,
    /// Where the image is taken from.
    pub camera: Camera,
    /// Named parts of the image.
    pub regions: Vec<Region>,
    /// Box around all meshes.
    pub bounds: Bounds,
    /// All triangles, mesh after mesh.
    triangles: Vec<Triangle>,
    /// Of the triangles over which something varies.
    corners: Vec<Corners>,
    /// Index in `triangles` of each mesh's first.
    first_triangle: Vec<u32>,
}

impl Scene {
    /// Puts a scene together; `lights` come on top of the emissive triangles.
    ///
    /// Meshes must be valid: finite positions, indices in range, materials in range, no triangle of
    /// zero area, fewer than 2^32 triangles in all ([`load()`] sees to it).
    pub fn new(
        name: String,
        meshes: Vec<Mesh>,
        materials: Vec<Material>,
        lights: Vec<Emitter>,
        camera: Camera,
        regions: Vec<Region>,
    ) -> Self {
        let mut bounds = Bounds::EMPTY;
        let mut triangles = Vec::with_capacity(meshes.iter().map(|m| m.triangles.len()).sum());
        let mut first_triangle = Vec::with_capacity(meshes.len());
        let mut varying = Vec::new();
        let mut emitters = lights;
        for mesh in &meshes {
            first_triangle.push(triangles.len() as u32);
            let material = &materials[mesh.material as usize];
            let radiance = material.emission;
            let emits = radiance.max_element() > 0.0;
            let glow = material.emission_texture.as_ref().filter(|_| emits);
            let glow = glow.map(|picture| Glow::new(picture, radiance, mesh.triangles.len()));
            for indices in &mesh.triangles {
                let indices = indices.map(|index| index as usize);
                let corners = indices.map(|index| mesh.positions[index]);
                bounds = corners.into_iter().fold(bounds, Bounds::with);
                let mut shape = Triangle::new(corners, mesh.material);
                if material.varies() || !mesh.normals.is_empty() {
                    shape.corners = varying.len() as u32;
                    varying.push(mesh.corners(indices, shape.normal));
                }
                if emits {
                    emitters.push(match &glow {
                        None => Emitter::Triangle { shape, radiance },
                        Some(glow) => {
                            let Corners { uvs, .. } = mesh.corners(indices, shape.normal);
                            glow.emitter(shape, uvs)
                        }
                    });
                }
                triangles.push(shape);
            }
        }
        for emitter in &mut emitters {
            if let Emitter::Directional(light) = emitter {
                light.center = bounds.center();
                light.radius = bounds.enclosing_radius();
            }
        }
        let lights = Lights::new(emitters);
        let corners = varying;
        Self {
            name,
            meshes,
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

    /// The meshes as an intersection backend takes them.
    pub fn triangle_meshes(&self) -> Vec<TriangleMesh<'_>> {
        self.meshes.iter().map(Mesh::as_triangles).collect()
    }

    /// All triangles, mesh after mesh.
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// Longest side of the bounding box, scene units.
    pub fn size(&self) -> f32 {
        self.bounds.longest_side()
    }

    /// What `ray`, of a direction of unit length, hit, if it is [`plain`](Self::plain) and scatters as
    /// `bsdf`.
    ///
    /// # Panics
    /// If the ray missed.
    #[inline(always)] // a call costs a tenth of the light phase
    pub fn plain_surface(&self, ray: &Ray, hit: &Hit, bsdf: Bsdf) -> Surface<'_> {
        let triangle = self.triangle(hit);
        let front = triangle.normal.dot(ray.direction) <= 0.0;
        let normal = if front { triangle.normal } else { -triangle.normal };
        let position = triangle.point([hit.u, hit.v]);
        let material = &self.materials[triangle.material as usize];
        let off_surface = position + normal * triangle.offset;
        let wo = -ray.direction;
        let (interpolated, uv) = (None, None);
        Surface { position, normal, interpolated, off_surface, wo, front, material, bsdf, uv }
    }

    /// Whether any surface asks photons where they came from: with a BSDF that varies, or a normal
    /// that is not the triangle's.
    pub fn merges_by_direction(&self) -> bool {
        self.materials.iter().any(Material::merges_by_direction)
            || self.meshes.iter().any(|mesh| !mesh.normals.is_empty())
    }

    /// The BSDF of what was hit if it is plain: Lambertian, and the same all over the triangle. The
    /// compiler sees that it is, and makes a short loop for such surfaces.
    #[inline(always)]
    pub fn plain(&self, hit: &Hit) -> Option<Bsdf> {
        let triangle = self.triangle(hit);
        let material = &self.materials[triangle.material as usize];
        match material.bsdf {
            Bsdf::Lambertian { albedo, two_sided } if triangle.corners == Triangle::FLAT => {
                Some(Bsdf::Lambertian { albedo, two_sided })
            }
            _ => None,
        }
    }

    /// What `ray`, of a direction of unit length, hit.
    ///
    /// # Panics
    /// If the ray missed.
    pub fn surface(&self, ray: &Ray, hit: &Hit) -> Surface<'_> {
        let triangle = self.triangle(hit);
        let own = self.materials[triangle.material as usize].bsdf;
        let plain = self.plain_surface(ray, hit, own);
        let Some(Corners { normals, uvs }) = self.corners.get(triangle.corners as usize) else {
            return plain;
        };
        let at = [hit.u, hit.v];
        let interpolated = (*normals != [triangle.normal; 3])
            .then(|| interpolate(*normals, at).normalize_or(triangle.normal));
        if !plain.material.varies() {
            return Surface { interpolated: interpolated.map(|n| plain.to_side(n)), ..plain };
        }
        let uv = interpolate(*uvs, at);
        let bent = plain.material.normal_map.as_ref().and_then(|map| {
            let tangent = self.tangent(hit, triangle, *uvs)?;
            map.bend(uv, triangle.normal, interpolated.unwrap_or(triangle.normal), tangent)
        });
        let interpolated = bent.or(interpolated).map(|normal| plain.to_side(normal));
        let bsdf = plain.material.bsdf_at(uv).unwrap_or(own);
        Surface { interpolated, bsdf, uv: Some(uv), ..plain }
    }

    /// Where growing texture coordinates lead at a hit: as the mesh says, else as `uvs` do.
    fn tangent(&self, hit: &Hit, triangle: &Triangle, uvs: [Vec2; 3]) -> Option<Tangent> {
        let own = Tangent::new([triangle.edge1, triangle.edge2], uvs)?;
        let mesh = &self.meshes[hit.mesh as usize];
        if mesh.tangents.is_empty() {
            return Some(own);
        }
        let corners = mesh.triangles[hit.triangle as usize];
        let given = interpolate(corners.map(|i| mesh.tangents[i as usize]), [hit.u, hit.v]);
        Some(if given == Vec3::ZERO { own } else { Tangent { along_u: given, ..own } })
    }

    #[inline]
    fn triangle(&self, hit: &Hit) -> &Triangle {
        let index = self.first_triangle[hit.mesh as usize] + hit.triangle;
        &self.triangles[index as usize]
    }
}
