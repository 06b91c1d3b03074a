//! Surfaces at hits, and Lambertian materials in the layout that hits read.

use super::coated_kinds::{Kind, coated_base};
use super::diffuse::{DiffuseVertices, TriangleSide};
use super::normal_map::Tangent;
use super::shading::with_lost_light;
use super::transform::Transform;
use super::triangle::{interpolate, refined, to_front};
use super::{Corners, Material, Placement, Scene, Surface, Triangle};
use crate::accel::{Hit, HitPacket, Ray};
use crate::base::math::Rgb;
use crate::scene::bsdf::Bsdf;
use crate::simd::dispatch::{Simd, transpose_rows};
use crate::simd::{LANES, Mask, Vec3s, any, bits, lanes_of};
use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};
use std::array::from_fn;

/// Rays that hit no uniform Lambertian surface, one bit per ray.
#[derive(Clone, Copy, Debug, Default)]
pub struct NotLambertian {
    /// Rays that hit nothing.
    pub missed: u32,
    /// Rays that hit another surface.
    pub others: u32,
    /// Those of `others` that hit materials of [`Scene::coated_vertices`] whose coats are no metal,
    /// unless a transform places the triangle: see [`Scene::coated_lanes`].
    pub coated: u32,
    /// The same for coats that may be metal.
    pub metals: u32,
}

/// Scratch memory for the data of surfaces that are hit.
#[derive(Clone, Copy, Debug, Default)]
pub struct HitScratch {
    triangle: Triangles,
    material: Lambertians,
}

/// Sixteen [`Triangle`]s.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Triangles {
    pub origin: Vec3s,
    pub edge1: Vec3s,
    pub edge2: Vec3s,
    pub normal: Vec3s,
    pub offset: [f32; LANES],
    pub material: [u32; LANES],
    pub area: [f32; LANES],
    pub corners: [u32; LANES],
}

/// Sixteen [`Lambertian`] materials.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
struct Lambertians {
    albedo: Vec3s,
    flags: [u32; LANES],
}

/// Area of a triangle over the squared distance of a hit from which on rounding errors of its
/// points may show: they are 1e-5 of the distance.
const WIDE: f32 = 1e3;

impl Triangles {
    /// Moves vertices of triangles that are so large that their rounding errors may show to their
    /// rays, of these origins and unit directions.
    #[inline(always)] // part of the loop over vertices
    pub fn refine_wide(
        &self,
        rays: [&Vec3s; 2],
        t: &[f32; LANES],
        vertices: (&mut Vec3s, &Vec3s, &mut Vec3s),
    ) {
        if any(&from_fn(|lane| self.is_wide(lane, t[lane]))) {
            self.refine(rays, t, vertices);
        }
    }

    #[inline(always)]
    fn is_wide(&self, lane: usize, t: f32) -> bool {
        self.area[lane] > WIDE * t * t
    }

    /// Moves vertices along their triangles to their rays.
    #[inline(never)] // keeps the common case short
    fn refine(
        &self,
        [origins, directions]: [&Vec3s; 2],
        t: &[f32; LANES],
        (position, normal, off_surface): (&mut Vec3s, &Vec3s, &mut Vec3s),
    ) {
        // Results do not depend on the other lanes.
        for lane in (0..LANES).filter(|&lane| self.is_wide(lane, t[lane])) {
            let (point, normal) = (position.get(lane), normal.get(lane));
            let [origin, edge1, edge2] =
                [&self.origin, &self.edge1, &self.edge2].map(|part| part.get(lane));
            let reach = (origin.abs() + edge1.abs() + edge2.abs()).max_element();
            let ray = [origins.get(lane), directions.get(lane)];
            let point = refined((point, normal, reach), ray, t[lane]);
            position.set(lane, point);
            off_surface.set(lane, point + normal * self.offset[lane]);
        }
    }
}

impl Scene {
    /// Sets `at` to the vertices where the first `count` rays hit surfaces that are Lambertian and
    /// uniform over the triangle. Returns the other rays.
    #[inline(always)] // a call costs a tenth of the light phase
    pub fn lambertian(
        &self,
        simd: Simd,
        rays: [&Vec3s; 2],
        hits: &HitPacket,
        count: usize,
        seen: &mut HitScratch,
        at: &mut DiffuseVertices,
    ) -> NotLambertian {
        at.clear();
        let (Some(first_of_all), Some(last_mesh)) =
            (self.triangles.first(), self.first_triangle.len().checked_sub(1))
        else {
            return NotLambertian { missed: (1 << count) - 1, ..NotLambertian::default() };
        };
        let is_hit: Mask = from_fn(|lane| (lane < count) & (hits.mesh[lane] as usize <= last_mesh));
        // Hits are unpredictable: to avoid branches, rays that miss read the first triangle.
        let (mut triangles, mut materials) = ([first_of_all; LANES], [&self.lambertian[0]; LANES]);
        for lane in 0..LANES {
            let first = self.first_triangle[(hits.mesh[lane] as usize).min(last_mesh)];
            let index = first.wrapping_add(hits.triangle[lane]) * u32::from(is_hit[lane]);
            triangles[lane] = &self.triangles[index as usize];
            materials[lane] = &self.lambertian[triangles[lane].material as usize];
        }
        let HitScratch { triangle, material } = seen;
        transpose_rows(simd, &triangles, triangle);
        transpose_rows(simd, &materials, material);
        at.mesh = hits.mesh;
        let [mut emits, mut is_coated, mut is_metal] = [Mask::default(); 3];
        for lane in 0..LANES {
            let is_flat = triangle.corners[lane] == Triangle::FLAT;
            let flags = material.flags[lane];
            let is_lambertian = is_hit[lane] & is_flat & (flags & Lambertian::IS_LAMBERTIAN != 0);
            at.active[lane] = is_lambertian;
            let of_others = if is_hit[lane] & !is_lambertian { flags } else { 0 };
            is_coated[lane] = of_others & Lambertian::IS_COATED_BASE != 0;
            is_metal[lane] = of_others & Lambertian::IS_METAL != 0;
            emits[lane] = is_lambertian & (flags & Lambertian::EMITS != 0);
            // The arithmetic of `Triangle::point` and `shade`.
            let front = triangle.normal.get(lane).dot(rays[1].get(lane)) <= 0.0;
            let normal = triangle.normal.get(lane) * if front { 1.0 } else { -1.0 };
            let [edge1, edge2] = [&triangle.edge1, &triangle.edge2].map(|edge| edge.get(lane));
            let position = triangle.origin.get(lane) + hits.u[lane] * edge1 + hits.v[lane] * edge2;
            at.front[lane] = front;
            at.side[lane] = TriangleSide::new(0, hits.triangle[lane], front).side;
            at.position.set(lane, position);
            at.normal.set(lane, normal);
            at.off_surface.set(lane, position + normal * triangle.offset[lane]);
            let reflects = if front | (flags & Lambertian::TWO_SIDED != 0) { 1.0 } else { 0.0 };
            at.albedo.set(lane, material.albedo.get(lane) * reflects);
        }
        triangle.refine_wide(rays, &hits.t, (&mut at.position, &at.normal, &mut at.off_surface));
        if any(&emits) {
            self.set_emission(&triangles, &emits, at);
        }
        let [is_hit, lambertian, coated, metals] =
            [&is_hit, &at.active, &is_coated, &is_metal].map(bits);
        let missed = !is_hit & ((1 << count) - 1);
        NotLambertian { missed, others: is_hit & !lambertian, coated, metals }
    }

    /// Sets the emission of the lanes of `emits`.
    #[inline(never)] // keeps the common case short
    fn set_emission(&self, triangles: &[&Triangle; LANES], emits: &Mask, at: &mut DiffuseVertices) {
        at.any_emits = true;
        for lane in (0..LANES).filter(|&lane| emits[lane]) {
            let material = &self.materials[triangles[lane].material as usize];
            let emits = at.front[lane] || material.two_sided_emission;
            at.emission.set(lane, if emits { material.emission } else { Rgb::ZERO });
        }
    }

    /// Reads the corners and texels of the hits of `lanes`, so that [`Self::surface`] waits for all
    /// of them together instead of one after the other: scenes are larger than the caches.
    pub fn read_ahead(&self, hits: &HitPacket, lanes: u32) {
        let mut textured = [None; LANES];
        let mut count = 0;
        for lane in lanes_of(lanes) {
            let hit = hits.get(lane);
            let triangle = self.triangle(hit.mesh, hit.triangle).expect("a hit");
            let texture = self.materials[triangle.material as usize].albedo_texture.as_deref();
            let own = self.corners.get(triangle.corners as usize).zip(texture);
            textured[count] = own.map(|(own, texture)| (own.uvs, [hit.u, hit.v], texture));
            count += usize::from(own.is_some());
        }
        let mut texels = [None; LANES];
        for (texels, textured) in texels.iter_mut().zip(&textured[..count]) {
            *texels = textured.map(|(uvs, at, texture)| texture.rows_around(interpolate(uvs, at)));
        }
        let read = texels[..count].iter().flatten().flatten();
        std::hint::black_box(read.fold(0, |all, texel| all ^ texel[0]));
    }

    /// The surface that `ray`, of unit direction, hit.
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
                let triangle = placement.triangle(triangle, self.ray_offset);
                let at = [hit.u, hit.v];
                let corners = corners.map(|corners| corners.moved(transform, triangle.normal));
                self.shade(ray, hit, transform.weights(at), &triangle, corners.as_ref())
            }
        }
    }

    /// The surface of a triangle in scene space, at these barycentric weights.
    fn shade(
        &self,
        ray: &Ray,
        hit: &Hit,
        at: [f32; 2],
        triangle: &Triangle,
        corners: Option<&Corners>,
    ) -> Surface<'_> {
        let material = &self.materials[triangle.material as usize];
        let front = triangle.normal.dot(ray.direction) <= 0.0;
        let normal = if front { triangle.normal } else { -triangle.normal };
        let rounded = triangle.point(at);
        let own = [ray.origin, ray.direction];
        let position = refined((rounded, triangle.normal, triangle.reach()), own, hit.t);
        let flat = Surface {
            position,
            facet: TriangleSide::new(hit.mesh, hit.triangle, front),
            normal,
            interpolated: None,
            off_surface: position + normal * triangle.offset,
            wo: -ray.direction,
            front,
            material,
            bsdf: material.bsdf,
            uv: None,
            tangent: None,
        };
        let Some(Corners { normals, uvs, .. }) = corners else {
            return flat;
        };
        let interpolated = (*normals != [triangle.normal; 3])
            .then(|| interpolate(*normals, at).normalize_or(triangle.normal));
        let color = self.color(hit);
        if !material.varies() && color.is_none() {
            let bsdf = with_lost_light(material.bsdf, normals, triangle.normal, interpolated);
            return Surface { interpolated: interpolated.map(|n| flat.to_side(n)), bsdf, ..flat };
        }
        let uv = interpolate(*uvs, at);
        let is_anisotropic = material.bsdf.is_anisotropic();
        let has_tangent = is_anisotropic || material.normal_map.is_some();
        let edges = [triangle.edge1, triangle.edge2];
        let tangent = has_tangent.then(|| self.tangent(hit, edges, *uvs)).flatten();
        let bent = material.normal_map.as_ref().and_then(|map| {
            map.bend(uv, triangle.normal, interpolated.unwrap_or(triangle.normal), tangent?)
        });
        let bsdf = material.bsdf_at(uv, color).unwrap_or(material.bsdf);
        let smooth = interpolated.filter(|_| bent.is_none());
        let bsdf = with_lost_light(bsdf, normals, triangle.normal, smooth);
        let interpolated = bent.or(interpolated).map(|normal| flat.to_side(normal));
        let tangent = tangent.filter(|_| is_anisotropic).map(|tangent| tangent.along_u);
        Surface { interpolated, bsdf, uv: Some(uv), tangent, ..flat }
    }

    /// Direction of growing texture coordinates at a hit of a triangle with these edges: that of
    /// the mesh if it has tangents, else that of `uvs`.
    pub(super) fn tangent(&self, hit: &Hit, edges: [Vec3; 2], uvs: [Vec2; 3]) -> Option<Tangent> {
        let own = Tangent::new(edges, uvs)?;
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

    /// Factor of the albedo from the mesh's vertex colors at a hit.
    pub(super) fn color(&self, hit: &Hit) -> Option<Rgb> {
        let mesh = self.mesh(&self.placements[hit.mesh as usize]);
        (!mesh.colors.is_empty()).then(|| {
            let corners = mesh.triangles[hit.triangle as usize].map(|i| mesh.colors[i as usize]);
            // Rounding may leave the range.
            interpolate(corners, [hit.u, hit.v]).clamp(Rgb::ZERO, Rgb::ONE)
        })
    }

    /// The stored triangle of a hit, in its mesh's space; `None` for a miss.
    #[inline]
    fn triangle(&self, mesh: u32, triangle: u32) -> Option<&Triangle> {
        let first = self.first_triangle.get(mesh as usize)?;
        Some(&self.triangles[(first + triangle) as usize])
    }
}

impl Corners {
    /// The corners in another space, where the triangle has this normal.
    pub(super) fn moved(&self, transform: &Transform, normal: Vec3) -> Self {
        let normals = self.normals.map(|own| to_front(transform.normal(own), normal));
        Self::new(transform.ordered(normals), transform.ordered(self.uvs))
    }
}

/// A material that is uniform and Lambertian, in 16 bytes: a fourth of a cache line.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Lambertian {
    albedo: Rgb,
    /// Properties of the material, one bit each; without [`Self::IS_LAMBERTIAN`], all but
    /// [`Self::IS_COATED_BASE`] and [`Self::IS_METAL`] mean nothing.
    flags: u32,
}

impl Lambertian {
    const IS_LAMBERTIAN: u32 = 1;
    const TWO_SIDED: u32 = 2;
    const EMITS: u32 = 4;
    /// The material is of [`Kind::Coated`], whether it is Lambertian or not.
    const IS_COATED_BASE: u32 = 8;
    /// The material is of [`Kind::Metal`].
    const IS_METAL: u32 = 16;

    pub fn of(material: &Material) -> Self {
        let flags = match Kind::of(&coated_base(material)) {
            Kind::Alone => 0,
            Kind::Coated => Self::IS_COATED_BASE,
            Kind::Metal => Self::IS_METAL,
        };
        let base = Self { flags, ..Self::default() };
        let Bsdf::Lambertian { albedo, two_sided } = material.bsdf else { return base };
        // Its emission depends on the direction.
        if material.luminous_opening.is_some() {
            return base;
        }
        let emits = material.emission != Rgb::ZERO;
        let flag = |flag: u32, is_set: bool| flag * u32::from(is_set);
        let flags = flag(Self::TWO_SIDED, two_sided) | flag(Self::EMITS, emits);
        Self { albedo, flags: flags | base.flags | Self::IS_LAMBERTIAN }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Arrangement, Camera, FieldOfView, Mesh};

    #[test]
    fn all_rays_miss_scenes_without_placements() {
        let triangle = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let material = Material::new("white", Bsdf::diffuse(Vec3::ONE));
        for meshes in [vec![], vec![triangle]] {
            let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
            let arrangement = Arrangement { meshes, placements: vec![] };
            let materials = vec![material.clone()];
            let scene =
                Scene::new("none".into(), arrangement, materials, vec![], camera, vec![]).unwrap();
            let (mut seen, mut at) = <(HitScratch, DiffuseVertices)>::default();
            let (directions, hits) = (Vec3s::splat(-Vec3::Z), HitPacket::default());
            let simd = Simd::default();
            let rest = scene.lambertian(simd, [&directions; 2], &hits, 5, &mut seen, &mut at);
            assert_eq!((rest.missed, rest.others), (0b1_1111, 0));
            assert!(!any(&at.active));
        }
    }
}
