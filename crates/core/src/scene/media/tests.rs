use super::*;
use crate::accel::bvh::Bvh;
use crate::scene::bsdf::{Bsdf, Dielectric, ThinDielectric};
use crate::scene::{Camera, FieldOfView, Material, Mesh};

fn medium(name: &str, priority: i32) -> Arc<Medium> {
    let absorption = Rgb::splat(name.len() as f32);
    let (scattering, asymmetry) = (Rgb::ZERO, 0.0);
    Arc::new(Medium { name: name.into(), absorption, scattering, asymmetry, priority })
}

fn material(boundary: MediumBoundary, bsdf: Bsdf) -> Material {
    Material { boundary: Some(boundary), ..Material::new("some", bsdf) }
}

fn inside(interior: &Arc<Medium>) -> MediumBoundary {
    MediumBoundary { interior: Some(interior.clone()), exterior: None }
}

/// A box with fronts outside.
fn block(low: Vec3, high: Vec3, material: u32) -> Mesh {
    let corner = |i: usize| {
        Vec3::new(
            if i & 1 == 0 { low.x } else { high.x },
            if i & 2 == 0 { low.y } else { high.y },
            if i & 4 == 0 { low.z } else { high.z },
        )
    };
    let sides =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Mesh { positions: (0..8).map(corner).collect(), triangles, material, ..Mesh::default() }
}

fn scene(meshes: Vec<Mesh>, materials: Vec<Material>) -> Scene {
    let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
    Scene::new("test".into(), meshes, materials, vec![], camera, vec![]).unwrap()
}

fn name_at(scene: &Scene, point: Vec3) -> Option<String> {
    let accel = Bvh::new(&scene.geometry()).unwrap();
    let media = scene.media().unwrap();
    media.medium(media.at(scene, &accel, point)).map(|medium| medium.name.clone())
}

/// A medium between all objects does not enter an object that has an exterior only.
#[test]
fn objects_with_an_exterior_only_are_empty() {
    let (smoke, water) = (medium("smoke", 0), medium("water", 0));
    let glass = Bsdf::Dielectric(Dielectric::new(1.5));
    let outside = MediumBoundary { interior: None, exterior: Some(smoke.clone()) };
    let materials = vec![material(outside, glass), material(inside(&water), glass)];
    let meshes = vec![
        block(Vec3::splat(-2.0), Vec3::splat(2.0), 0),
        block(Vec3::splat(-1.0), Vec3::splat(1.0), 1),
    ];
    let scene = scene(meshes, materials).with_filling_medium(Some(smoke)).unwrap();
    for (x, name) in [(0.0, "water"), (1.5, "vacuum"), (2.5, "smoke")] {
        let found = name_at(&scene, Vec3::new(x, 0.1, 0.2));
        assert_eq!(found.as_deref(), Some(name), "{x}");
    }
    let media = scene.media().unwrap();
    let mut state = media.at(&scene, &Bvh::new(&scene.geometry()).unwrap(), 3.0 * Vec3::X);
    for (placement, from_front, name) in
        [(0, true, "vacuum"), (1, true, "water"), (1, false, "vacuum"), (0, false, "smoke")]
    {
        state = media.cross(state, placement, from_front);
        assert_eq!(media.medium(state).unwrap().name, name);
    }
}

/// Ice in water: the smaller object counts. A bubble in the ice has an exterior, the ice.
#[test]
fn smallest_object_fills_the_space() {
    let (water, ice, air) = (medium("water", 0), medium("ice", 0), medium("a", 0));
    let glass = Bsdf::Dielectric(Dielectric::new(1.3));
    let bubble = MediumBoundary { interior: Some(air), exterior: Some(ice.clone()) };
    let materials = vec![
        material(inside(&water), glass),
        material(inside(&ice), glass),
        material(bubble, glass),
    ];
    let cube = |half: f32, material| block(Vec3::splat(-half), Vec3::splat(half), material);
    let scene = scene(vec![cube(3.0, 0), cube(2.0, 1), cube(1.0, 2)], materials);
    for (x, name) in [(0.0, Some("a")), (1.5, Some("ice")), (2.5, Some("water")), (4.0, None)] {
        let found = name_at(&scene, Vec3::new(x, 0.1, 0.2));
        assert_eq!(found.as_deref(), name, "{x}");
    }
    // A path through all of them, and back
    let media = scene.media().unwrap();
    let mut state = MediumState::default();
    let mut names = Vec::new();
    for (placement, from_front) in
        [(0, true), (1, true), (2, true), (2, false), (1, false), (0, false)]
    {
        state = media.cross(state, placement, from_front);
        names.push(media.medium(state).map_or("none", |medium| &medium.name));
    }
    assert_eq!(names, ["water", "ice", "a", "ice", "water", "none"]);
    assert_eq!(state, MediumState::default());
}

#[test]
fn priority_comes_before_size() {
    let (large, small) = (medium("large", 1), medium("small", 0));
    let glass = Bsdf::Dielectric(Dielectric::new(1.3));
    let materials = vec![material(inside(&large), glass), material(inside(&small), glass)];
    let meshes = vec![
        block(Vec3::splat(-2.0), Vec3::splat(2.0), 0),
        block(Vec3::new(1.0, -1.0, -1.0), Vec3::new(3.0, 1.0, 1.0), 1),
    ];
    let scene = scene(meshes, materials);
    for (x, name) in [(0.5, "large"), (1.5, "large"), (2.5, "small")] {
        assert_eq!(name_at(&scene, Vec3::new(x, 0.1, 0.2)).as_deref(), Some(name), "{x}");
    }
}

#[test]
fn segments_lose_light_in_all_media_that_they_cross() {
    let (one, other) = (medium("one", 0), medium("others", 0));
    let clear = Bsdf::ThinDielectric(ThinDielectric::new(1.0));
    let materials = vec![material(inside(&one), clear), material(inside(&other), clear)];
    let meshes = vec![
        block(Vec3::splat(-2.0), Vec3::splat(2.0), 0),
        block(Vec3::splat(-0.5), Vec3::splat(0.5), 1),
    ];
    let scene = scene(meshes, materials);
    let accel = Bvh::new(&scene.geometry()).unwrap();
    let (from, to) = (Vec3::new(-3.0, 0.1, 0.2), Vec3::new(3.0, 0.1, 0.2));
    let found =
        scene.media().unwrap().transmittance(&scene, &accel, MediumState::default(), [from, to]);
    let expected = (-3.0f32 * 3.0 - 6.0).exp();
    assert!((found.x / expected - 1.0).abs() < 1e-4, "{found} {expected}");
}

#[test]
fn media_apart_from_each_other_have_no_common_state() {
    let media: Vec<_> = (0..40).map(|i| medium(&"m".repeat(i + 1), 0)).collect();
    let glass = Bsdf::Dielectric(Dielectric::new(1.3));
    let materials = media.iter().map(|own| material(inside(own), glass)).collect();
    let at = |i: usize| Vec3::X * 2.0 * i as f32;
    let blocks = (0..40).map(|i| block(at(i), at(i) + Vec3::ONE, i as u32)).collect();
    let scene = scene(blocks, materials);
    assert_eq!(scene.media().unwrap().states.len(), 41);
}

#[test]
fn too_many_ways_to_overlap_are_refused() {
    let media: Vec<_> = (0..7).map(|i| medium(&"m".repeat(i + 1), 0)).collect();
    let glass = Bsdf::Dielectric(Dielectric::new(1.3));
    let materials = media.iter().map(|own| material(inside(own), glass)).collect();
    let blocks = (0..7).map(|i| block(-Vec3::ONE, Vec3::ONE, i)).collect::<Vec<_>>();
    let camera = Camera::look(Vec3::Z, -Vec3::Z, Vec3::Y, FieldOfView::X(60.0)).unwrap();
    let refused = Scene::new("test".into(), blocks, materials, vec![], camera, vec![]);
    assert!(refused.unwrap_err().to_string().contains("in more than 64 ways"));
}
