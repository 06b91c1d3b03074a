//! From a hit to the surface there.

use super::normal_map::Tangent;
use super::transform::Transform;
use super::{Corners, Material, Placement, Scene, Surface, Triangle, interpolate, to_front};
use crate::accel::{Hit, HitPacket, Ray};
use crate::bsdf::Bsdf;
use crate::diffuse::DiffuseVertices;
use crate::lanes::{LANES, Mask, Vec3s};
use glam::{Vec2, Vec3};

/// Rays that hit no plain surface, a bit for each.
#[derive(Clone, Copy, Debug, Default)]
pub struct Elsewhere {
    /// Those that hit nothing.
    pub missed: u32,
    /// Those that hit something else.
    pub others: u32,
}

impl Scene {
    /// Sets `at` to where the first `count` rays of these directions hit surfaces that are Lambertian
    /// and the same all over the triangle, and tells which rays hit nothing or something else.
    #[inline(always)] // a call costs a tenth of the light phase
    pub fn plain(
        &self,
        directions: &Vec3s,
        hits: &HitPacket,
        count: usize,
        at: &mut DiffuseVertices,
    ) -> Elsewhere {
        let mut elsewhere = Elsewhere::default();
        let (mut origin, mut edge1, mut edge2) = <(Vec3s, Vec3s, Vec3s)>::default();
        let mut offset = [0.0; LANES];
        let mut two_sided = Mask::default();
        at.clear();
        for lane in 0..count {
            let Some(triangle) = self.triangle(hits.mesh[lane], hits.triangle[lane]) else {
                elsewhere.missed |= 1 << lane;
                continue;
            };
            let plain = self.plain.get(triangle.material as usize).and_then(Option::as_ref);
            let Some(plain) = plain.filter(|_| triangle.corners == Triangle::FLAT) else {
                elsewhere.others |= 1 << lane;
                continue;
            };
            at.active[lane] = true;
            origin.set(lane, triangle.origin);
            edge1.set(lane, triangle.edge1);
            edge2.set(lane, triangle.edge2);
            offset[lane] = triangle.offset;
            at.normal.set(lane, triangle.normal);
            at.albedo.set(lane, plain.albedo);
            two_sided[lane] = plain.two_sided;
            if plain.emits {
                at.emission.set(lane, self.materials[triangle.material as usize].emission);
                at.any_emits = true;
            }
        }
        for lane in 0..LANES {
            // As `Triangle::point` and `Side::new`.
            let front = at.normal.get(lane).dot(directions.get(lane)) <= 0.0;
            let normal = at.normal.get(lane) * if front { 1.0 } else { -1.0 };
            let (u, v) = (hits.u[lane], hits.v[lane]);
            let position = origin.get(lane) + u * edge1.get(lane) + v * edge2.get(lane);
            at.front[lane] = front;
            at.position.set(lane, position);
            at.normal.set(lane, normal);
            at.off_surface.set(lane, position + normal * offset[lane]);
            let reflects = if front | two_sided[lane] { 1.0 } else { 0.0 };
            at.albedo.set(lane, at.albedo.get(lane) * reflects);
        }
        elsewhere
    }

    /// What `ray`, of a direction of unit length, hit.
    ///
    /// # Panics
    /// If the ray missed.
    pub fn surface(&self, ray: &Ray, hit: &Hit) -> Surface<'_> {
        let triangle = self.triangle(hit.mesh, hit.triangle).expect("a hit");
        let corners = self.corners.get(triangle.corners as usize);
        match &self.placements[hit.mesh as usize] {
            Placement { transform: None, .. } => {
                self.shade(ray, hit, [hit.u, hit.v], triangle, corners)
            }
            placement @ Placement { transform: Some(transform), .. } => {
                let (triangle, at) = (placement.triangle(triangle), [hit.u, hit.v]);
                let corners = corners.map(|corners| corners.moved(transform, triangle.normal));
                self.shade(ray, hit, transform.weights(at), &triangle, corners.as_ref())
            }
        }
    }

    /// The surface of a triangle in the scene's space, at these barycentric weights.
    fn shade(
        &self,
        ray: &Ray,
        hit: &Hit,
        at: [f32; 2],
        triangle: &Triangle,
        corners: Option<&Corners>,
    ) -> Surface<'_> {
        let material = &self.materials[triangle.material as usize];
        let own = material.bsdf;
        let plain = Surface::flat(ray, triangle, at, material, own);
        let Some(Corners { normals, uvs }) = corners else {
            return plain;
        };
        let interpolated = (*normals != [triangle.normal; 3])
            .then(|| interpolate(*normals, at).normalize_or(triangle.normal));
        if !material.varies() {
            return Surface { interpolated: interpolated.map(|n| plain.to_side(n)), ..plain };
        }
        let uv = interpolate(*uvs, at);
        let bent = material.normal_map.as_ref().and_then(|map| {
            let tangent = self.tangent(hit, triangle, *uvs)?;
            map.bend(uv, triangle.normal, interpolated.unwrap_or(triangle.normal), tangent)
        });
        let interpolated = bent.or(interpolated).map(|normal| plain.to_side(normal));
        let bsdf = material.bsdf_at(uv).unwrap_or(own);
        Surface { interpolated, bsdf, uv: Some(uv), ..plain }
    }

    /// Where growing texture coordinates lead at a hit: as the mesh says, else as `uvs` do.
    fn tangent(&self, hit: &Hit, triangle: &Triangle, uvs: [Vec2; 3]) -> Option<Tangent> {
        let own = Tangent::new([triangle.edge1, triangle.edge2], uvs)?;
        let placement = &self.placements[hit.mesh as usize];
        let mesh = self.mesh(placement);
        if mesh.tangents.is_empty() {
            return Some(own);
        }
        let corners = mesh.triangles[hit.triangle as usize].map(|i| mesh.tangents[i as usize]);
        let corners = match &placement.transform {
            None => corners,
            Some(transform) => corners.map(|tangent| transform.tangent(tangent)),
        };
        let given = interpolate(corners, [hit.u, hit.v]);
        Some(if given == Vec3::ZERO { own } else { Tangent { along_u: given, ..own } })
    }

    /// What a ray hit, in its mesh's space; `None` if that is nothing.
    #[inline]
    fn triangle(&self, mesh: u32, triangle: u32) -> Option<&Triangle> {
        let first = self.first_triangle.get(mesh as usize)?;
        Some(&self.triangles[(first + triangle) as usize])
    }
}

impl Corners {
    /// In another space, where the triangle has this normal.
    fn moved(&self, transform: &Transform, normal: Vec3) -> Self {
        let normals = self.normals.map(|own| to_front(transform.normal(own), normal));
        Self { normals: transform.ordered(normals), uvs: transform.ordered(self.uvs) }
    }
}

impl<'a> Surface<'a> {
    /// A triangle at these barycentric weights, if nothing varies over it.
    fn flat(
        ray: &Ray,
        triangle: &Triangle,
        at: [f32; 2],
        material: &'a Material,
        bsdf: Bsdf,
    ) -> Self {
        let Side { front, position, normal, off_surface } = Side::new(ray, triangle, at);
        let wo = -ray.direction;
        let (interpolated, uv) = (None, None);
        Surface { position, normal, interpolated, off_surface, wo, front, material, bsdf, uv }
    }
}

/// The side of a triangle that a ray comes from.
struct Side {
    front: bool,
    position: Vec3,
    normal: Vec3,
    off_surface: Vec3,
}

impl Side {
    /// At these barycentric weights.
    fn new(ray: &Ray, triangle: &Triangle, at: [f32; 2]) -> Self {
        let front = triangle.normal.dot(ray.direction) <= 0.0;
        let normal = if front { triangle.normal } else { -triangle.normal };
        let position = triangle.point(at);
        let off_surface = position + normal * triangle.offset;
        Self { front, position, normal, off_surface }
    }
}
