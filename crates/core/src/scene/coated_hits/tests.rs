use super::*;
use crate::accel::{Hit, HitPacket, Ray};
use crate::base::math::uniform_sphere;
use crate::base::rng::{Stream, StreamKey};
use crate::scene::bsdf::Glossy;
use crate::scene::bsdf::coated_base::CoatedBase;
use crate::scene::bsdf::coats::LobeValues;
use crate::scene::bsdf::{
    Conductor, FacetModel, Facets, LobeValue, Plastic, Reflectance, Transport,
};
use crate::scene::coated_kinds::{coated_base, is_plain};
use crate::scene::diffuse::DiffuseVertices;
use crate::scene::transform::Transform;
use crate::scene::{
    Arrangement, Camera, FieldOfView, HitScratch, Material, Mesh, NormalMap, Surface,
};
use glam::{DAffine3, DMat3, DVec3};
use std::array::from_fn;
use std::sync::Arc;

/// Meshes of two triangles: without normals, with those of an edge, and with those of a smooth
/// surface, each with all materials: with and without textures, coats and bent normals. Then they
/// come once more, placed by transforms. Every other mesh has colors.
fn scene(bsdfs: [Bsdf; 2]) -> Scene {
    let texels = (0..12).map(|i| [20 * i, 255 - 9 * i, 7 * i, 255]).collect();
    let texture = Arc::new(Texture::new(4, 3, texels));
    let materials: Vec<_> = (0..8)
        .map(|i| {
            let textured = |is_so| if is_so { Some(Arc::clone(&texture)) } else { None };
            let is_glossy = matches!(bsdfs[i % 2], Bsdf::Glossy(_));
            let bends = NormalMap { texture: Arc::clone(&texture), scale: 0.7 };
            Material {
                albedo_texture: textured(i & 2 != 0),
                metallic_roughness_texture: textured(is_glossy && i != 0),
                normal_map: (i & 4 != 0).then_some(bends),
                ..Material::new("any", bsdfs[i % 2])
            }
        })
        .collect();
    let mesh = |i: u32| Mesh {
        positions: [[0, 0, 0], [2, 0, 1], [2, 1, 0], [0, 2, 1]]
            .map(|[x, y, z]| Vec3::from([x, y, if i < 16 { z } else { 0 }].map(|c| c as f32)))
            .map(|p| p + Vec3::splat(i as f32))
            .to_vec(),
        normals: match i / 8 {
            0 => vec![],
            1 => (1..5).map(|k| Vec3::new(0.3, -0.9, 0.4 * k as f32).normalize()).collect(),
            _ => (1..5).map(|k| Vec3::new(0.05 * k as f32, -0.1, 1.0).normalize()).collect(),
        },
        uvs: (0..4).map(|k| Vec2::new(0.9 * k as f32, 0.3 * (k * k) as f32)).collect(),
        colors: match i / 4 % 2 {
            0 => vec![],
            _ => (1..5).map(|k| Rgb::new(0.2 * k as f32, 0.7, 1.0 - 0.1 * k as f32)).collect(),
        },
        triangles: vec![[0, 1, 2], [2, 3, 0]],
        material: i % 8,
        ..Mesh::default()
    };
    let mut arrangement = Arrangement::from((0..24).chain(0..24).map(mesh).collect::<Vec<_>>());
    for (i, placement) in arrangement.placements.iter_mut().enumerate().skip(24) {
        let mirror = if i % 2 == 0 { 1.0 } else { -1.0 };
        let turn = DMat3::from_rotation_y(0.1 * i as f64);
        let map = turn * DMat3::from_diagonal(DVec3::new(1.5, 0.7 * mirror, 1.1));
        let to = DAffine3 { matrix3: map, translation: DVec3::splat(0.2) };
        placement.transform = Some(Transform::new(to).unwrap());
        // Stored triangles have the material of the mesh.
        placement.material = (i as u32 + 3) % 8;
    }
    let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
    Scene::new("any".into(), arrangement, materials, vec![], camera, vec![]).unwrap()
}

#[test]
fn surfaces_of_sixteen_are_those_of_one() {
    let albedo = Rgb::new(0.7, 0.2, 0.4);
    let facets = Facets { model: FacetModel::Ggx, alpha: 0.1 };
    let plastic = Bsdf::Plastic(Plastic::new(albedo, 1.5, facets, true));
    compare_surfaces::<false>(&scene([Bsdf::diffuse(Rgb::splat(0.8)), plastic]));
    let metal = Bsdf::Conductor(Conductor::new(Reflectance::Artist { normal: albedo }, 0.2));
    let glossy = Bsdf::Glossy(Glossy::new(albedo, 0.8, 1.5, 0.9));
    compare_surfaces::<true>(&scene([glossy, metal]));
}

fn compare_surfaces<const METAL: bool>(scene: &Scene) {
    let mut rng = StreamKey::new(6, Stream::Test, 0).rng(0);
    let (mut scratch, mut at) = <(CoatedScratch, CoatedVertices<METAL>)>::default();
    let simd = Simd::default();
    for _ in 0..300 {
        let mut hits = HitPacket::default();
        let (origins, mut directions) = <(Vec3s, Vec3s)>::default();
        for lane in 0..LANES {
            let [u, v] = rng.next_2d();
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let (mesh, triangle) = (rng.next_u32() % 48, rng.next_u32() % 2);
            // So far away that the rays do not refine the points.
            hits.set(lane, &Hit { t: 1e3, u, v, mesh, triangle });
            directions.set(lane, uniform_sphere(rng.next_2d()));
        }
        let HitPacket { mesh, triangle, u, v, t } = hits;
        let own = CoatedHits { mesh, triangle, u, v, t };
        let count = 1 + (rng.next_u32() % 16) as usize;
        let (mut seen, mut flat) = <(HitScratch, DiffuseVertices)>::default();
        let rays = [&origins, &directions];
        let rest = scene.lambertian(simd, rays, &hits, LANES, &mut seen, &mut flat);
        let expected = if METAL { [0, rest.others] } else { [rest.others, 0] };
        assert_eq!(scene.coated_lanes(&hits, &rest), expected);
        scene.coated_vertices(simd, [&origins, &directions], &own, count, &mut scratch, &mut at);
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
                assert_surface(scene, &at, lane, surface, wi.get(lane));
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

fn assert_surface<const METAL: bool>(
    scene: &Scene,
    at: &CoatedVertices<METAL>,
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
    let scene = scene([Bsdf::diffuse(Rgb::ONE); 2]);
    let (placement, mesh) = (scene.placements[0], &scene.meshes[0]);
    assert!(is_plain(&placement, mesh));
    assert!(!is_plain(&scene.placements[24], mesh));
    let colored = Mesh { colors: vec![Rgb::ONE; 4], ..mesh.clone() };
    assert!(!is_plain(&placement, &colored));
    let emits = Material { emission: Rgb::ONE, ..scene.materials[0].clone() };
    assert_eq!(coated_base(&emits).flags & CoatedBase::IS_BASE, 0);
    let mirror = Material::new("mirror", Bsdf::Mirror { reflectance: Rgb::ONE });
    assert_eq!(coated_base(&mirror).flags & CoatedBase::IS_BASE, 0);
}
