//! Hits of diffuse bases, with or without a coat, whose normals and colors may vary: sixteen
//! surfaces at a time, as [`Scene::surface`] has one.

use super::bsdf::coat_columns::{CoatedBases, Metals};
use super::bsdf::coated_base::{CoatedBase, MetalRow, with_base_albedo};
use super::bsdf::coats::SeenCoats;
use super::bsdf::{Bsdf, Vertex};
use super::coated_kinds::Kind;
use super::diffuse::TriangleSide;
use super::hit::{NotLambertian, Triangles};
use super::shading::{GRAZING, SMOOTH_COSINE};
use super::triangle::Corners;
use super::{Scene, Texture, Triangle};
use crate::accel::{Hit, HitPacket};
use crate::base::math::Rgb;
use crate::simd::dispatch::{Simd, transpose_rows};
use crate::simd::{LANES, Mask, Vec3s, lanes_of};
use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

/// Up to sixteen hits of triangles.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct CoatedHits {
    /// Indices of the instances.
    pub mesh: [u32; LANES],
    /// Indices of the triangles within their meshes.
    pub triangle: [u32; LANES],
    /// Barycentric weights of the second vertices.
    pub u: [f32; LANES],
    /// Barycentric weights of the third vertices.
    pub v: [f32; LANES],
    /// Distances along the rays, scene units.
    pub t: [f32; LANES],
}

impl CoatedHits {
    fn get(&self, lane: usize) -> Hit {
        let Self { mesh, triangle, u, v, t } = self;
        let [mesh, triangle] = [mesh, triangle].map(|own| own[lane]);
        let [u, v, t] = [u, v, t].map(|own| own[lane]);
        Hit { t, u, v, mesh, triangle }
    }
}

/// Scratch memory for the data of surfaces that are hit.
#[derive(Clone, Copy, Debug, Default)]
pub struct CoatedScratch {
    triangle: Triangles,
    corners: CornerColumns,
    coats: CoatedBases,
    /// Without meaning unless coats may be metal.
    metals: Metals,
    /// Barycentric weights in scene space: those of hits, or of placed triangles.
    weights: [[f32; LANES]; 2],
}

/// Sixteen [`Corners`].
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
struct CornerColumns {
    normal_a: Vec3s,
    normal_b: Vec3s,
    normal_c: Vec3s,
    /// Texture coordinates of each corner.
    a: [[f32; LANES]; 2],
    b: [[f32; LANES]; 2],
    c: [[f32; LANES]; 2],
    unused: [u32; LANES],
}

/// Vertices of sixteen paths at diffuse bases, with or without a coat, which may be metal if
/// `METAL` is true; see [`Surface`](super::Surface).
#[derive(Clone, Copy, Debug, Default)]
pub struct CoatedVertices<const METAL: bool> {
    /// Paths that have a vertex; numbers of the others mean nothing.
    pub active: Mask,
    /// Instances that they are on; see [`TriangleSide`].
    mesh: [u32; LANES],
    /// Sides of triangles that they are on.
    side: [u32; LANES],
    /// Indices of their materials.
    material: [u32; LANES],
    /// The points that were hit.
    pub position: Vec3s,
    /// Unit normals of the triangles on the rays' sides.
    pub normal: Vec3s,
    /// Unit normals by which the surfaces scatter.
    pub shading_normal: Vec3s,
    /// Unit normals between those of the corners.
    interpolated: Vec3s,
    /// Vertices whose `shading_normal` may differ from that of the triangle.
    pub is_bent: Mask,
    /// Start points of new rays.
    pub off_surface: Vec3s,
    /// How the surfaces scatter.
    pub bsdf: SeenCoats<METAL>,
}

impl<const METAL: bool> CoatedVertices<METAL> {
    /// Returns true if `wi` is on one side of both the triangle and the shading normal. See
    /// [`Surface::agrees`](super::Surface::agrees).
    #[inline(always)] // part of the loops over vertices
    pub fn agrees(&self, lane: usize, wi: Vec3) -> bool {
        let sides = self.normal.get(lane).dot(wi) * self.shading_normal.get(lane).dot(wi);
        !self.is_bent[lane] | (sides > 0.0)
    }

    /// The side of the triangle that was hit.
    pub fn facet(&self, lane: usize) -> TriangleSide {
        TriangleSide { mesh: self.mesh[lane], side: self.side[lane] }
    }

    /// Unit normal between those of the corners, if the surface is bent.
    pub fn interpolated(&self, lane: usize) -> Option<Vec3> {
        self.is_bent[lane].then(|| self.interpolated.get(lane))
    }

    /// The arguments of the BSDF. See [`Surface::vertex`](super::Surface::vertex).
    pub fn vertex(&self, lane: usize) -> Vertex {
        let normal = self.shading_normal.get(lane);
        let front = self.facet(lane).is_front();
        Vertex { normal, wo: self.bsdf.wo().get(lane), front, tangent: None }
    }

    /// The surfaces as light from `wi` sees them, which scatters it back along the paths. See
    /// [`Surface::vertex_from`](super::Surface::vertex_from).
    #[inline(always)]
    pub fn seen_by_light(&self, wi: &Vec3s) -> SeenCoats<METAL> {
        let mut normals = Vec3s::default();
        for lane in 0..LANES {
            let (smooth, wi) = (self.interpolated.get(lane), wi.get(lane));
            // theory.md (33)
            let lifted = smooth + (GRAZING - smooth.dot(wi)).max(0.0) * wi;
            let lifted = lifted * lifted.length_squared().max(1e-30).sqrt().recip();
            let bends = self.is_bent[lane] & (self.bsdf.has_coat(lane) > 0.0);
            normals.set(lane, if bends { lifted } else { self.normal.get(lane) });
        }
        self.bsdf.seen_from(&normals, wi)
    }
}

impl Scene {
    /// Lanes of hits that [`Self::coated_vertices`] shades: whose coats are no metal, and may be.
    #[inline(always)] // part of the loop over vertices
    pub fn coated_lanes(&self, hits: &HitPacket, rest: &NotLambertian) -> [u32; 2] {
        let [mut coated, mut metals] = [rest.coated, rest.metals];
        for lane in lanes_of(rest.others) {
            let Some(kind) = self.coated.placed[hits.mesh[lane] as usize] else { continue };
            let bit = 1 << lane;
            coated = coated & !bit | if kind == Kind::Coated { bit } else { 0 };
            metals = metals & !bit | if kind == Kind::Metal { bit } else { 0 };
        }
        [coated, metals]
    }

    /// The BSDF of a vertex.
    pub fn coated_bsdf<const METAL: bool>(&self, at: &CoatedVertices<METAL>, lane: usize) -> Bsdf {
        if METAL {
            return Bsdf::Glossy(at.bsdf.glossy(lane));
        }
        let albedo = at.bsdf.albedo.get(lane);
        with_base_albedo(&self.materials[at.material[lane] as usize].bsdf, albedo)
    }

    /// The surfaces of the first `count` hits, which [`Self::lambertian`] found to be of this kind,
    /// by rays of these origins and unit directions.
    #[inline(always)] // part of the loop over vertices
    pub fn coated_vertices<const METAL: bool>(
        &self,
        simd: Simd,
        [origins, directions]: [&Vec3s; 2],
        hits: &CoatedHits,
        count: usize,
        scratch: &mut CoatedScratch,
        at: &mut CoatedVertices<METAL>,
    ) {
        let special = self.read_coated(simd, hits, count, scratch);
        let mut seen = scratch.seen_sides(directions, hits, count, at);
        let places = (&mut at.position, &at.normal, &mut at.off_surface);
        scratch.triangle.refine_wide([origins, directions], &hits.t, places);
        if special.bends != 0 {
            self.bend(hits, special.bends, directions, scratch, &mut seen, at);
        }
        let (mut textures, mut color) = ([None; LANES], Vec3s::default());
        for (lane, own) in textures.iter_mut().enumerate().take(count) {
            let material = &self.materials[at.material[lane] as usize];
            if let Some(texture) = &material.albedo_texture {
                *own = Some(&**texture);
            }
        }
        Texture::colors(&textures, &seen.uv, &mut color);
        for (lane, restores) in seen.restores.into_iter().enumerate() {
            color.set(lane, color.get(lane) * restores);
        }
        if special.colored != 0 {
            for lane in lanes_of(special.colored) {
                let own = self.color(&hits.get(lane)).unwrap_or(Rgb::ONE);
                color.set(lane, color.get(lane) * own);
            }
        }
        if METAL {
            self.read_metals(simd, (&color, special.colored), &seen.uv, count, (scratch, at));
        }
        let SeenSides { front, wo, .. } = &seen;
        let coats = (&scratch.coats, &scratch.metals);
        at.bsdf = SeenCoats::new(coats, &color, front, &at.shading_normal, wo);
    }

    /// Reads the data of the first `count` hits.
    #[inline(always)]
    fn read_coated(
        &self,
        simd: Simd,
        hits: &CoatedHits,
        count: usize,
        scratch: &mut CoatedScratch,
    ) -> Special {
        let no_corners = Corners::default();
        // Lanes without a hit read the first triangle.
        let mut triangles = [&self.triangles[0]; LANES];
        let mut coats = [&self.coated.bases[0]; LANES];
        let mut corners = [&no_corners; LANES];
        let mut special = Special::default();
        scratch.weights = [hits.u, hits.v];
        for lane in 0..count {
            let mesh = hits.mesh[lane] as usize;
            let first = self.first_triangle[mesh];
            let triangle = &self.triangles[(first + hits.triangle[lane]) as usize];
            let material = triangle.material as usize;
            triangles[lane] = triangle;
            coats[lane] = &self.coated.bases[material];
            if (triangle.corners as usize) < self.corners.len() {
                corners[lane] = &self.corners[triangle.corners as usize];
            }
            let is_plain = self.coated.is_plain[mesh];
            special.placed |= u32::from(!is_plain) << lane;
            special.bends |= u32::from(self.materials[material].normal_map.is_some()) << lane;
        }
        if special.placed == 0 {
            transpose_rows(simd, &coats, &mut scratch.coats);
            transpose_rows(simd, &triangles, &mut scratch.triangle);
            transpose_rows(simd, &corners, &mut scratch.corners);
        } else {
            let stored = (triangles, corners, coats);
            self.read_placed(simd, hits, stored, scratch, &mut special);
        }
        special
    }

    /// Moves the triangles of placements that have transforms, and finds meshes with colors.
    #[inline(never)] // keeps the common case short
    fn read_placed(
        &self,
        simd: Simd,
        hits: &CoatedHits,
        (stored, corners, mut coats): ([&Triangle; LANES], [&Corners; LANES], [&CoatedBase; LANES]),
        scratch: &mut CoatedScratch,
        special: &mut Special,
    ) {
        let (mut triangles, mut moved) = (stored.map(|own| *own), corners.map(|own| *own));
        for lane in lanes_of(special.placed) {
            let placement = &self.placements[hits.mesh[lane] as usize];
            let has_colors = !self.mesh(placement).colors.is_empty();
            special.colored |= u32::from(has_colors) << lane;
            let Some(transform) = &placement.transform else { continue };
            triangles[lane] = placement.triangle(stored[lane], self.ray_offset);
            let material = placement.material as usize;
            coats[lane] = &self.coated.bases[material];
            special.bends &= !(1 << lane);
            special.bends |= u32::from(self.materials[material].normal_map.is_some()) << lane;
            moved[lane] = corners[lane].moved(transform, triangles[lane].normal);
            let weights = transform.weights([hits.u[lane], hits.v[lane]]);
            for (own, weight) in scratch.weights.iter_mut().zip(weights) {
                own[lane] = weight;
            }
        }
        transpose_rows(simd, &coats, &mut scratch.coats);
        transpose_rows(simd, &triangles.each_ref(), &mut scratch.triangle);
        transpose_rows(simd, &moved.each_ref(), &mut scratch.corners);
    }

    /// Bends the normals of `lanes` by the maps of their materials, as [`Self::surface`] does.
    #[inline(never)] // keeps the common case short
    fn bend<const METAL: bool>(
        &self,
        hits: &CoatedHits,
        lanes: u32,
        directions: &Vec3s,
        scratch: &CoatedScratch,
        seen: &mut SeenSides,
        at: &mut CoatedVertices<METAL>,
    ) {
        let (mut textures, mut data) = ([None; LANES], Vec3s::default());
        for lane in lanes_of(lanes) {
            let map = &self.materials[at.material[lane] as usize].normal_map;
            textures[lane] = map.as_ref().map(|map| &*map.texture);
        }
        Texture::data_of(&textures, &seen.uv, &mut data);
        for lane in lanes_of(lanes) {
            let material = &self.materials[at.material[lane] as usize];
            let Some(map) = &material.normal_map else { continue };
            let triangle = &scratch.triangle;
            if triangle.corners[lane] >= Triangle::PLACED {
                continue;
            }
            let to_front = |normal: Vec3| if seen.front[lane] { normal } else { -normal };
            let own = triangle.normal.get(lane);
            let edges = [triangle.edge1.get(lane), triangle.edge2.get(lane)];
            let corners = &scratch.corners;
            let uvs = [corners.a, corners.b, corners.c].map(|[u, v]| Vec2::new(u[lane], v[lane]));
            let Some(tangent) = self.tangent(&hits.get(lane), edges, uvs) else { continue };
            let smooth = if at.is_bent[lane] { to_front(at.interpolated.get(lane)) } else { own };
            let vector = Texture::vector_of(data.get(lane));
            let Some(bent) = map.bend_by(vector, own, smooth, tangent) else { continue };
            let bent = to_front(bent);
            let direction = directions.get(lane);
            // theory.md (33)
            let lift = (GRAZING + bent.dot(direction)).max(0.0) * scratch.coats.has_coat(lane);
            at.shading_normal.set(lane, (bent - lift * direction).normalize());
            at.interpolated.set(lane, bent);
            at.is_bent[lane] = true;
            seen.restores[lane] = 1.0;
        }
    }

    /// Replaces the parameters of surfaces whose coats may be metal by those at these texture
    /// coordinates, where pictures and meshes have these colors.
    #[inline(always)]
    fn read_metals<const METAL: bool>(
        &self,
        simd: Simd,
        (color, colored): (&Vec3s, u32),
        uv: &[[f32; LANES]; 2],
        count: usize,
        (scratch, at): (&mut CoatedScratch, &CoatedVertices<METAL>),
    ) {
        let (mut textures, mut data) = ([None; LANES], Vec3s::splat(Vec3::ONE));
        for (lane, own) in textures.iter_mut().enumerate().take(count) {
            let material = &self.materials[at.material[lane] as usize];
            if let Some(texture) = &material.metallic_roughness_texture {
                *own = Some(&**texture);
            }
        }
        if textures.iter().any(Option::is_some) {
            Texture::data_of(&textures, uv, &mut data);
        }
        let mut metals = [self.coated.metals[0].1; LANES];
        let mut coats = [CoatedBase::default(); LANES];
        for lane in 0..count {
            let number = at.material[lane] as usize;
            let (glossy, row) = &self.coated.metals[number];
            if !self.coated.varies[number] && colored >> lane & 1 == 0 {
                (metals[lane], coats[lane]) = (*row, self.coated.bases[number]);
                continue;
            }
            let data = data.get(lane);
            let is_conductor = !matches!(self.materials[number].bsdf, Bsdf::Glossy(_));
            // Pictures do not change conductors.
            let scaled = glossy.scaled(color.get(lane), data.z, data.y);
            let own = if is_conductor { *glossy } else { scaled };
            (metals[lane], coats[lane]) = (MetalRow::of(&own), CoatedBase::of_facets(&own));
        }
        transpose_rows(simd, &metals.each_ref(), &mut scratch.metals);
        transpose_rows(simd, &coats.each_ref(), &mut scratch.coats);
    }
}

/// Lanes of hits that need more than their triangle, one bit each.
#[derive(Clone, Copy, Debug, Default)]
struct Special {
    /// Their placement has a transform, or their mesh colors.
    placed: u32,
    /// Their mesh has colors.
    colored: u32,
    /// Their material has a normal map.
    bends: u32,
}

/// Sides that are seen, as textures and BSDFs need them.
#[derive(Clone, Copy, Debug)]
struct SeenSides {
    front: Mask,
    /// Unit vectors back along the rays.
    wo: Vec3s,
    /// Texture coordinates.
    uv: [[f32; LANES]; 2],
    /// Factors that restore the light that smooth normals lose.
    restores: [f32; LANES],
}

impl Default for SeenSides {
    #[inline(always)]
    fn default() -> Self {
        let (front, wo) = (Mask::default(), Vec3s::default());
        Self { front, wo, uv: [[0.0; LANES]; 2], restores: [1.0; LANES] }
    }
}

impl CoatedScratch {
    /// Sets positions and normals of `at`.
    #[inline(always)]
    fn seen_sides<const METAL: bool>(
        &self,
        directions: &Vec3s,
        hits: &CoatedHits,
        count: usize,
        at: &mut CoatedVertices<METAL>,
    ) -> SeenSides {
        let Self { triangle, corners: corner, coats: coat, weights, .. } = self;
        let mut seen = SeenSides::default();
        for lane in 0..LANES {
            at.active[lane] = lane < count;
            let direction = directions.get(lane);
            let own = triangle.normal.get(lane);
            seen.front[lane] = own.dot(direction) <= 0.0;
            at.mesh[lane] = hits.mesh[lane];
            at.side[lane] = TriangleSide::new(0, hits.triangle[lane], seen.front[lane]).side;
            at.material[lane] = triangle.material[lane];
            let side = if seen.front[lane] { 1.0 } else { -1.0 };
            let normal = own * side;
            let (u, v) = (weights[0][lane], weights[1][lane]);
            let (edge1, edge2) = (triangle.edge1.get(lane), triangle.edge2.get(lane));
            let position = triangle.origin.get(lane) + u * edge1 + v * edge2;
            at.position.set(lane, position);
            at.normal.set(lane, normal);
            at.off_surface.set(lane, position + normal * triangle.offset[lane]);
            seen.wo.set(lane, -direction);
            let w = 1.0 - u - v;
            for (axis, uv) in seen.uv.iter_mut().enumerate() {
                let (a, b) = (corner.a[axis][lane], corner.b[axis][lane]);
                uv[lane] = w * a + u * b + v * corner.c[axis][lane];
            }
            let (a, b) = (corner.normal_a.get(lane), corner.normal_b.get(lane));
            let c = corner.normal_c.get(lane);
            let off = (a - own).abs().max((b - own).abs()).max((c - own).abs());
            let has_corners = triangle.corners[lane] < Triangle::PLACED;
            let smooth = w * a + u * b + v * c;
            let length2 = smooth.length_squared();
            let smooth = smooth * (side * length2.max(1e-30).sqrt().recip());
            // theory.md (33)
            let lift = (GRAZING + smooth.dot(direction)).max(0.0) * coat.has_coat(lane);
            let lifted = smooth - lift * direction;
            let lifted = lifted * lifted.length_squared().max(1e-30).sqrt().recip();
            let is_bent = has_corners & (off.max_element() > 0.0);
            let is_smooth = is_bent & (length2 > 1e-30);
            at.shading_normal.set(lane, if is_smooth { lifted } else { normal });
            at.interpolated.set(lane, if is_smooth { smooth } else { normal });
            at.is_bent[lane] = is_bent;
            // theory.md (33a)
            let least = a.dot(own).min(b.dot(own)).min(c.dot(own));
            let is_restored = is_smooth & (coat.has_coat(lane) == 0.0) & (least >= SMOOTH_COSINE);
            let restored = 2.0 / (1.0 + smooth.dot(normal));
            seen.restores[lane] = if is_restored { restored } else { 1.0 };
        }
        seen
    }
}

#[cfg(test)]
mod tests;
