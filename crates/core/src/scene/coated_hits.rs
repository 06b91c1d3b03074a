//! Hits of diffuse bases, with or without a coat, whose normals and colors may vary: sixteen
//! surfaces at a time, as [`Scene::surface`] has one.

use super::bsdf::coated_base::CoatedBase;
use super::bsdf::coats::{CoatedBases, SeenCoats};
use super::bsdf::{Bsdf, Vertex};
use super::diffuse::TriangleSide;
use super::hit::Triangles;
use super::shading::{GRAZING, SMOOTH_COSINE};
use super::triangle::Corners;
use super::{Material, Mesh, Placement, Scene, Texture, Triangle};
use crate::accel::HitPacket;
use crate::base::math::Rgb;
use crate::simd::dispatch::{Simd, transpose_rows};
use crate::simd::{LANES, Mask, Vec3s, lanes_of};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::sync::Arc;

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

/// Scratch memory for the data of surfaces that are hit.
#[derive(Clone, Copy, Debug, Default)]
pub struct CoatedScratch {
    triangle: Triangles,
    corners: CornerColumns,
    coats: CoatedBases,
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

/// Vertices of sixteen paths at diffuse bases, with or without a coat; see
/// [`Surface`](super::Surface).
#[derive(Clone, Copy, Debug, Default)]
pub struct CoatedVertices {
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
    pub bsdf: SeenCoats,
}

impl CoatedVertices {
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
    pub fn seen_by_light(&self, wi: &Vec3s) -> SeenCoats {
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

/// Hits of these materials may be shaded by [`Scene::coated_vertices`]. Those of others emit,
/// bend normals by a map, vary in roughness, disperse, or bound media.
pub(super) fn coated_base(material: &Material) -> CoatedBase {
    let is_plain = material.emission == Rgb::ZERO
        && material.luminous_opening.is_none()
        && material.normal_map.is_none()
        && material.metallic_roughness_texture.is_none()
        && material.dispersion.is_none()
        && material.boundary.is_none();
    if is_plain { CoatedBase::of(&material.bsdf) } else { CoatedBase::default() }
}

/// Tables for [`Scene::coated_vertices`].
#[derive(Clone, Debug)]
pub(super) struct Coated {
    /// For each material its base and coat.
    bases: Arc<[CoatedBase]>,
    /// For each placement whether its hits may be shaded, if its material may.
    is_plain: Arc<[bool]>,
}

impl Coated {
    pub fn new(materials: &[Material], placements: &[Placement], meshes: &[Mesh]) -> Self {
        let plain = |placed: &Placement| is_plain(placed, &meshes[placed.mesh as usize]);
        Self {
            bases: materials.iter().map(coated_base).collect(),
            is_plain: placements.iter().map(plain).collect(),
        }
    }
}

/// A placement has no transform, and its mesh no colors.
fn is_plain(placement: &Placement, mesh: &Mesh) -> bool {
    placement.transform.is_none() && mesh.colors.is_empty()
}

impl Scene {
    /// The BSDF of a vertex.
    pub fn coated_bsdf(&self, at: &CoatedVertices, lane: usize) -> Bsdf {
        let albedo = at.bsdf.albedo.get(lane);
        match self.materials[at.material[lane] as usize].bsdf {
            Bsdf::Lambertian { two_sided, .. } => Bsdf::Lambertian { albedo, two_sided },
            Bsdf::Plastic(plastic) => Bsdf::Plastic(plastic.with_albedo(albedo)),
            Bsdf::Coated(coated) => Bsdf::Coated(coated.with_albedo(albedo)),
            Bsdf::Glossy(glossy) => Bsdf::Glossy(glossy.with_albedo(albedo)),
            other => other,
        }
    }

    /// The hits that [`Self::coated_vertices`] can shade among `lanes`, whose materials
    /// [`Self::lambertian`] found coated.
    #[inline(always)] // part of the loop over vertices
    pub fn plain_placements(&self, hits: &HitPacket, lanes: u32) -> u32 {
        let is_plain = |lane: usize| self.coated.is_plain[hits.mesh[lane] as usize];
        lanes_of(lanes).fold(0, |all, lane| all | u32::from(is_plain(lane)) << lane)
    }

    /// The surfaces of the first `count` hits of [`Self::plain_placements`], by rays of these
    /// origins and unit directions.
    #[inline(always)] // part of the loop over vertices
    pub fn coated_vertices(
        &self,
        simd: Simd,
        [origins, directions]: [&Vec3s; 2],
        hits: &CoatedHits,
        count: usize,
        scratch: &mut CoatedScratch,
        at: &mut CoatedVertices,
    ) {
        self.read_coated(simd, hits, count, scratch);
        let seen = scratch.seen_sides(directions, hits, count, at);
        let places = (&mut at.position, &at.normal, &mut at.off_surface);
        scratch.triangle.refine_wide([origins, directions], &hits.t, places);
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
        let SeenSides { front, wo, .. } = &seen;
        at.bsdf = SeenCoats::new(&scratch.coats, &color, front, &at.shading_normal, wo);
    }

    /// Reads the data of the first `count` hits.
    #[inline(always)]
    fn read_coated(
        &self,
        simd: Simd,
        hits: &CoatedHits,
        count: usize,
        scratch: &mut CoatedScratch,
    ) {
        let no_corners = Corners::default();
        // Lanes without a hit read the first triangle.
        let mut triangles = [&self.triangles[0]; LANES];
        let mut coats = [&self.coated.bases[0]; LANES];
        let mut corners = [&no_corners; LANES];
        for lane in 0..count {
            let first = self.first_triangle[hits.mesh[lane] as usize];
            let triangle = &self.triangles[(first + hits.triangle[lane]) as usize];
            triangles[lane] = triangle;
            coats[lane] = &self.coated.bases[triangle.material as usize];
            if (triangle.corners as usize) < self.corners.len() {
                corners[lane] = &self.corners[triangle.corners as usize];
            }
        }
        transpose_rows(simd, &triangles, &mut scratch.triangle);
        transpose_rows(simd, &corners, &mut scratch.corners);
        transpose_rows(simd, &coats, &mut scratch.coats);
    }
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
    fn seen_sides(
        &self,
        directions: &Vec3s,
        hits: &CoatedHits,
        count: usize,
        at: &mut CoatedVertices,
    ) -> SeenSides {
        let Self { triangle, corners: corner, coats: coat } = self;
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
            let (u, v) = (hits.u[lane], hits.v[lane]);
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
mod tests {
    use super::*;
    use crate::accel::{Hit, Ray};
    use crate::base::math::uniform_sphere;
    use crate::base::rng::{Stream, StreamKey};
    use crate::scene::bsdf::coats::LobeValues;
    use crate::scene::bsdf::{FacetModel, Facets, LobeValue, Plastic, Transport};
    use crate::scene::{Arrangement, Camera, FieldOfView, Surface};
    use std::array::from_fn;

    /// Meshes of two triangles: without normals, with those of an edge, and with those of a smooth
    /// surface, each with and without textures and coats.
    fn scene() -> Scene {
        let texels = (0..12).map(|i| [20 * i, 255 - 9 * i, 7 * i, 255]).collect();
        let texture = Arc::new(Texture::new(4, 3, texels));
        let facets = Facets { model: FacetModel::Ggx, alpha: 0.1 };
        let plastic = Plastic::new(Rgb::new(0.7, 0.2, 0.4), 1.5, facets, true);
        let bsdfs = [Bsdf::diffuse(Rgb::splat(0.8)), Bsdf::Plastic(plastic)];
        let materials = (0..4)
            .map(|i| Material {
                albedo_texture: (i > 1).then(|| Arc::clone(&texture)),
                ..Material::new("any", bsdfs[i % 2])
            })
            .collect();
        let mesh = |i: u32| Mesh {
            positions: [[0, 0, 0], [2, 0, 1], [2, 1, 0], [0, 2, 1]]
                .map(|[x, y, z]| Vec3::from([x, y, if i < 8 { z } else { 0 }].map(|c| c as f32)))
                .map(|p| p + Vec3::splat(i as f32))
                .to_vec(),
            normals: match i / 4 {
                0 => vec![],
                1 => (1..5).map(|k| Vec3::new(0.3, -0.9, 0.4 * k as f32).normalize()).collect(),
                _ => (1..5).map(|k| Vec3::new(0.05 * k as f32, -0.1, 1.0).normalize()).collect(),
            },
            uvs: (0..4).map(|k| glam::Vec2::new(0.9 * k as f32, 0.3 * k as f32)).collect(),
            triangles: vec![[0, 1, 2], [2, 3, 0]],
            material: i % 4,
            ..Mesh::default()
        };
        let arrangement = Arrangement::from((0..12).map(mesh).collect::<Vec<_>>());
        let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
        Scene::new("any".into(), arrangement, materials, vec![], camera, vec![]).unwrap()
    }

    #[test]
    fn surfaces_of_sixteen_are_those_of_one() {
        let scene = scene();
        let mut rng = StreamKey::new(6, Stream::Test, 0).rng(0);
        let (mut scratch, mut at) = <(CoatedScratch, CoatedVertices)>::default();
        let simd = Simd::default();
        for _ in 0..300 {
            let mut hits = HitPacket::default();
            let (origins, mut directions) = <(Vec3s, Vec3s)>::default();
            for lane in 0..LANES {
                let [u, v] = rng.next_2d();
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let (mesh, triangle) = (rng.next_u32() % 12, rng.next_u32() % 2);
                // So far away that the rays do not refine the points.
                hits.set(lane, &Hit { t: 1e3, u, v, mesh, triangle });
                directions.set(lane, uniform_sphere(rng.next_2d()));
            }
            assert_eq!(scene.plain_placements(&hits, 0xffff), 0xffff);
            let HitPacket { mesh, triangle, u, v, t } = hits;
            let own = CoatedHits { mesh, triangle, u, v, t };
            let count = 1 + (rng.next_u32() % 16) as usize;
            scene.coated_vertices(
                simd,
                [&origins, &directions],
                &own,
                count,
                &mut scratch,
                &mut at,
            );
            let mut wi = Vec3s::default();
            let surfaces: [_; LANES] = from_fn(|lane| {
                let ray = Ray::new(Vec3::ZERO, directions.get(lane));
                scene.surface(&ray, &hits.get(lane))
            });
            for (lane, surface) in surfaces.iter().enumerate() {
                wi.set(lane, (surface.normal + 0.8 * uniform_sphere(rng.next_2d())).normalize());
            }
            let (wide, _) = at.bsdf.lobes(&wi);
            let reversed = at.seen_by_light(&wi);
            let (back, _) = reversed.lobes(at.bsdf.wo());
            for (lane, surface) in surfaces.iter().enumerate() {
                assert_eq!(at.active[lane], lane < count);
                if lane < count {
                    assert_surface(&scene, &at, lane, surface, wi.get(lane));
                    let expected =
                        surface.bsdf.lobes(&surface.vertex(Transport::Radiance), wi.get(lane));
                    assert_lobe(&wide, lane, &expected[0]);
                    let from_light = surface.vertex_from(wi.get(lane), Transport::Flux);
                    let expected = surface.bsdf.lobes(&from_light, surface.wo);
                    assert_lobe(&back, lane, &expected[0]);
                    let off = reversed.pass_prob(lane) - surface.bsdf.pass_prob(&from_light);
                    assert!(off.abs() < 1e-4, "{off}");
                }
            }
        }
    }

    fn assert_surface(
        scene: &Scene,
        at: &CoatedVertices,
        lane: usize,
        surface: &Surface,
        wi: Vec3,
    ) {
        let vertex = surface.vertex(Transport::Radiance);
        for (own, expected) in [
            (&at.position, surface.position),
            (&at.normal, surface.normal),
            (&at.off_surface, surface.off_surface),
            (&at.shading_normal, vertex.normal),
        ] {
            let off = (own.get(lane) - expected).length();
            assert!(off < 2e-6 * (1.0 + expected.length()), "{off}");
        }
        assert_eq!(at.is_bent[lane], surface.interpolated.is_some());
        assert_eq!(at.facet(lane), surface.facet);
        assert_eq!(at.vertex(lane).front, vertex.front);
        assert_eq!(at.agrees(lane, wi), surface.agrees(&vertex, wi));
        let bsdf = scene.coated_bsdf(at, lane);
        assert_eq!(bsdf.spread(), surface.bsdf.spread());
        let off = bsdf.color(true) - surface.bsdf.color(true);
        assert!(off.length() < 1e-6, "{off}");
    }

    fn assert_lobe(found: &LobeValues, lane: usize, expected: &LobeValue) {
        let off = (found.value.get(lane) - expected.value).length();
        assert!(off < 1e-4 * expected.value.length() + 1e-6, "{off} {expected:?}");
        let off = (found.pdf_w[lane] - expected.pdf_w).abs();
        assert!(off < 1e-4 * expected.pdf_w + 1e-6, "{off} {expected:?}");
    }

    #[test]
    fn colored_and_moved_meshes_are_not_plain() {
        let scene = scene();
        let [placement, mesh] = [0, 0];
        let (placement, mesh) = (scene.placements[placement], &scene.meshes[mesh]);
        assert!(is_plain(&placement, mesh));
        let colored = Mesh { colors: vec![Rgb::ONE; 4], ..mesh.clone() };
        assert!(!is_plain(&placement, &colored));
        let emits = Material { emission: Rgb::ONE, ..scene.materials[0].clone() };
        assert_eq!(coated_base(&emits).flags & CoatedBase::IS_BASE, 0);
        let mirror = Material::new("mirror", Bsdf::Mirror { reflectance: Rgb::ONE });
        assert_eq!(coated_base(&mirror).flags & CoatedBase::IS_BASE, 0);
    }
}
