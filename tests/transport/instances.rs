//! Scenes that hold meshes once for several places against scenes that hold a copy at each.

use crate::common::shapes::Random;
use crate::common::*;
use bdpm::accel::{Intersect, Ray};
use bdpm::base::math::luminance;
use bdpm::load::load;
use bdpm::noise::Measure;
use bdpm::scene::backend::{Backend, build};
use bdpm::scene::bsdf::{Bsdf, Glossy};
use bdpm::scene::{Arrangement, Material, Mesh, NormalMap, Placement, Scene, Texture, Transform};
use bdpm::{Renderer, Settings};
use glam::{DVec3, Vec3};
use std::fmt::Write;
use std::sync::Arc;

fn transform(translate: [f64; 3], rotate: [f64; 3], scale: [f64; 3]) -> Transform {
    let [translate, rotate, scale] = [translate, rotate, scale].map(DVec3::from);
    Transform::from_parts(translate, rotate, scale).unwrap()
}

/// A ball with normals, texture coordinates and tangents that vary.
fn ball() -> Mesh {
    let ball = sphere(Vec3::ZERO, 0.3, 2, false, 0);
    let normals: Vec<Vec3> = ball.positions.iter().map(|p| p.normalize()).collect();
    let uvs = ball.positions.iter().map(|p| p.truncate() * 2.0).collect();
    let tangents = normals.iter().map(|n| Vec3::Z.cross(*n).normalize_or_zero()).collect();
    Mesh { normals, uvs, tangents, ..ball }
}

/// A room with balls in it, turned, stretched, mirrored and flipped, of all kinds of materials.
fn arrangement() -> Arrangement {
    let mut meshes = furnished_box().meshes().to_vec();
    meshes.retain(|mesh| mesh.material == 0); // two faces of the block lie in one place
    let mut arrangement = Arrangement::from(meshes);
    let plain = sphere(Vec3::new(0.1, 0.0, 0.0), 0.25, 2, false, 0);
    let first = arrangement.meshes.len() as u32;
    arrangement.meshes.extend([plain, ball()]);
    let mut place = |mesh, material, transform| {
        let transform = Some(transform);
        arrangement.placements.push(Placement { mesh: first + mesh, material, transform });
    };
    place(0, 0, transform([0.5, 0.5, 0.0], [0.0, 0.0, 30.0], [1.0; 3]));
    place(0, 2, transform([-0.5, 0.5, 0.8], [20.0, 40.0, 10.0], [0.4, 0.2, 0.3]));
    place(1, 3, transform([0.5, -0.6, 0.3], [70.0, 20.0, 10.0], [1.0, 0.5, 0.8]));
    place(1, 4, transform([-0.2, 0.1, 0.2], [15.0, 0.0, 50.0], [-0.9, 1.1, 0.7]));
    place(1, 0, transform([0.3, 0.6, 0.6], [0.0, 80.0, 0.0], [0.5, -1.0, 0.6]).flipped(true));
    place(0, 1, transform([0.6, 0.0, 0.7], [0.0, 0.0, 0.0], [0.6, -0.6, 0.6]));
    place(1, 5, transform([0.0, 0.7, -0.1], [0.0, 30.0, 0.0], [0.6; 3]));
    arrangement
}

fn materials() -> Vec<Material> {
    let texels = (0..16).map(|i| [250 - 9 * i, 20 + 13 * i, 255, if i % 3 == 0 { 0 } else { 255 }]);
    let texture = Arc::new(Texture::new(4, 4, texels.collect()));
    let glossy = Bsdf::Glossy(Glossy::new(Vec3::splat(0.6), 0.3, 1.5, 0.4));
    let bumpy = NormalMap { texture: texture.clone(), scale: 0.5 };
    vec![
        gray(0.5, 0.0),
        gray(0.7, 0.0),
        gray(0.1, 6.0),
        Material { normal_map: Some(bumpy), ..Material::new("bumpy", glossy) },
        Material { opacity_texture: Some(texture.clone()), ..gray(0.6, 0.0) },
        Material { emission_texture: Some(texture), ..gray(0.2, 3.0) },
    ]
}

fn scene_of(arrangement: impl Into<Arrangement>) -> Arc<Scene> {
    let camera = camera(Vec3::new(-0.9, -0.85, 0.2), Vec3::new(0.3, 0.2, 0.1), 80.0);
    let lights = vec![point_light(Vec3::new(-0.5, 0.4, 0.3), 0.3)];
    Scene::new("test".into(), arrangement, materials(), lights, camera, Vec::new()).unwrap().into()
}

fn both() -> [Arc<Scene>; 2] {
    let shared = scene_of(arrangement());
    let copied = scene_of(shared.copies());
    [shared, copied]
}

fn backends(scene: &Arc<Scene>) -> Vec<Arc<dyn Intersect>> {
    Backend::ALL.into_iter().filter_map(|backend| build(backend, scene).ok()).collect()
}

#[test]
fn scene_facts_ignore_sharing_of_meshes() {
    let [shared, copied] = both();
    assert_eq!(shared.fingerprint(), copied.fingerprint());
    assert_eq!(shared.triangle_count(), copied.triangle_count());
    assert_eq!(shared.bounds(), copied.bounds());
    assert_eq!(shared.lights().emitters().len(), copied.lights().emitters().len());
    let power = shared.lights().power() / copied.lights().power();
    assert!((power - 1.0).abs().max_element() < 1e-5, "{power}");
    assert_eq!(shared.stored_triangle_count(), copied.triangle_count() - 5 * 320);
    let close = |a: Vec3, b: Vec3| (a - b).length() < 1e-5;
    for (a, b) in shared.triangles().iter().zip(copied.triangles()) {
        assert!(close(a.origin, b.origin) && close(a.normal, b.normal), "{a:?} {b:?}");
        assert!(close(a.edge1, b.edge1) && close(a.edge2, b.edge2), "{a:?} {b:?}");
        assert!((a.area() / b.area() - 1.0).abs() < 1e-4 && a.material == b.material);
    }
}

#[test]
fn surfaces_are_the_same() {
    const RAYS: usize = 100_000;
    let [shared, copied] = both();
    let reference = build(Backend::Bvh, &copied).unwrap();
    for accel in backends(&shared) {
        let mut random = Random(3);
        let (mut differ, mut interpolated) = (0, 0);
        for _ in 0..RAYS {
            let ray = Ray::new(0.95 * random.point(), random.direction());
            let (hit, expected) = (accel.closest_hit(&ray), reference.closest_hit(&ray));
            // Near edges of triangles and of holes.
            if (hit.mesh, hit.triangle) != (expected.mesh, expected.triangle) {
                differ += 1;
                continue;
            }
            let (a, b) = (shared.surface(&ray, &hit), copied.surface(&ray, &expected));
            let close = |a: Vec3, b: Vec3, most: f32| (a - b).length() < most;
            // Rays that graze magnify rounding.
            let most = 1e-5 / b.normal.dot(ray.direction).abs();
            let context = || format!("{a:?}\n{b:?}");
            assert!(close(a.position, b.position, most), "{}", context());
            assert!(close(a.off_surface, b.off_surface, most + 1e-4), "{}", context());
            assert!(close(a.normal, b.normal, 1e-5) && a.front == b.front, "{}", context());
            assert_eq!(a.material.name, b.material.name);
            assert_eq!(a.plain_or_not(), b.plain_or_not(), "{}", context());
            if let (Some(a_uv), Some(b_uv)) = (a.uv, b.uv) {
                assert!((a_uv - b_uv).length() < 10.0 * most, "{}", context());
            }
            if let (Some(one), Some(other)) = (a.interpolated, b.interpolated) {
                interpolated += 1;
                assert!(close(one, other, 100.0 * most), "{}", context());
            }
        }
        println!("{}: {differ} differ, {interpolated} interpolated", accel.describe().name);
        assert!(differ < RAYS / 2000 && interpolated > 1000, "{differ} {interpolated}");
    }
}

trait Kind {
    fn plain_or_not(&self) -> (bool, bool);
}

impl Kind for bdpm::scene::Surface<'_> {
    fn plain_or_not(&self) -> (bool, bool) {
        (self.uv.is_some(), self.interpolated.is_some())
    }
}

#[test]
fn images_are_nearly_the_same() {
    let scenes = both();
    let settings = Settings { light_paths: 5000, merge_vertex: 2, ..settings(48, 48) };
    let image = |scene: &Arc<Scene>, accel: &Arc<dyn Intersect>| {
        let mut renderer = Renderer::new(scene, accel, settings.clone()).unwrap();
        for _ in 0..4 {
            renderer.iterate(Measure::Off);
        }
        renderer.film().mean()
    };
    let expected = image(&scenes[1], &build(Backend::Bvh, &scenes[1]).unwrap());
    for accel in backends(&scenes[0]) {
        let image = image(&scenes[0], &accel);
        let close = |(a, b): &(&Vec3, &Vec3)| {
            let (a, b) = (luminance(**a), luminance(**b));
            (a - b).abs() <= 1e-3 * a.abs().max(b.abs())
        };
        let agree = image.iter().zip(&expected).filter(close).count();
        let sum = |image: &[Vec3]| image.iter().map(|p| f64::from(luminance(*p))).sum::<f64>();
        let ratio = sum(&image) / sum(&expected);
        println!("{}: {agree} of {}, mean {ratio}", accel.describe().name, expected.len());
        // One light path that goes another way changes all pixels around it.
        assert!(agree * 100 > expected.len() * 75 && (ratio - 1.0).abs() < 1e-3);
    }
}

/// Rays that start at a convex closed body leave it outward, and meet it inward, wherever it is and
/// however it is scaled.
#[test]
fn no_ray_starts_on_the_wrong_side() {
    let body = sphere(Vec3::new(0.7, -0.2, 0.1), 1.0, 3, false, 0);
    let cases = [
        transform([0.0; 3], [0.0; 3], [1.0; 3]),
        transform([1e5, -3e4, 2e5], [10.0, 200.0, 70.0], [1.0; 3]),
        transform([1e3, 0.0, -500.0], [33.0, 44.0, 55.0], [1.0, 20.0, 0.1]),
        transform([0.0, 1e-3, 0.0], [80.0, 0.0, 10.0], [1e-6, 2e-6, 3e-6]),
        transform([1e7, 0.0, 0.0], [1.0, 2.0, 3.0], [1e6, -1e6, 2e6]),
        transform([5.0, 6.0, 7.0], [45.0, 45.0, 45.0], [-30.0, 1.0, 1.0]),
    ];
    for (case, transform) in cases.into_iter().enumerate() {
        let placements = vec![Placement { mesh: 0, material: 0, transform: Some(transform) }];
        let scene = scene_of(Arrangement { meshes: vec![body.clone()], placements });
        let (center, reach) = (scene.bounds().center(), scene.bounds().enclosing_radius());
        for accel in backends(&scene) {
            let (mut random, mut wrong, mut count) = (Random(5), [0; 2], 0);
            for _ in 0..20_000 {
                let from = center + 1.5 * reach * random.direction();
                let ray =
                    Ray::new(from, (center + 0.3 * reach * random.point() - from).normalize());
                let hit = accel.closest_hit(&ray);
                if hit.is_miss() {
                    continue;
                }
                count += 1;
                let surface = scene.surface(&ray, &hit);
                assert!(surface.front, "{case}");
                let direction = random.direction();
                let direction = direction * direction.dot(surface.normal).signum();
                let out = Ray::new(surface.start(direction), direction);
                wrong[0] += usize::from(accel.is_occluded(&out));
                let inward = Ray::new(surface.start(-direction), -direction);
                let met = accel.closest_hit(&inward);
                wrong[1] += usize::from(met.is_miss() || scene.surface(&inward, &met).front);
            }
            println!("{case}, {}: {wrong:?} of {count}", accel.describe().name);
            // Beside an edge the offset may reach beyond the neighbor's plane.
            assert!(count > 1000 && wrong[0] * 500 <= count && wrong[1] * 500 <= count);
        }
    }
}

/// Files that are large enough are held once, by another path through the loader.
#[test]
fn files_that_are_used_often_are_held_once() {
    let ball = ball();
    let mut obj = String::from("o ball\n");
    ball.positions.iter().for_each(|p| writeln!(obj, "v {} {} {}", p.x, p.y, p.z).unwrap());
    let normals = ball.normals.iter().map(|n| 1.7 * n);
    normals.for_each(|n| writeln!(obj, "vn {} {} {}", n.x, n.y, n.z).unwrap());
    for corners in &ball.triangles {
        let [a, b, c] = corners.map(|i| i + 1);
        writeln!(obj, "f {a}//{a} {b}//{b} {c}//{c}").unwrap();
    }
    // An object of its own, without area.
    obj += "o line\nv 0 0 0\nv 1 0 0\nv 2 0 0\nf -3 -2 -1\n";
    let count = 40_u32;
    let mut toml = String::from(
        "[camera]\nposition = [0, 0, 9]\ntarget = [0, 0, 0]\nfov_y_deg = 40\n\
         [[light]]\ntype = \"point\"\nposition = [0, 5, 9]\nintensity = [9, 9, 9]\n\
         [materials.red]\nalbedo = [0.8, 0.1, 0.1]\n",
    );
    for i in 0..count {
        let look = if i % 2 == 0 { "material = \"red\"\n" } else { "" };
        let scale = if i == 7 { [1e-11; 3] } else { [1.0, -0.1 * f64::from(i + 1), 0.7] };
        write!(toml, "[[mesh]]\nfile = \"ball.obj\"\n{look}translate = [{i}, 0, 1]\n").unwrap();
        writeln!(toml, "rotate_deg = [{i}, 20, 3]\nscale = {scale:?}").unwrap();
    }
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("ball.obj"), obj).unwrap();
    std::fs::write(folder.path().join("scene.toml"), toml).unwrap();
    let loaded = load(folder.path()).unwrap_or_else(|e| panic!("{e}"));
    let scene = &loaded.scene;
    assert!(loaded.warnings_text().contains("dropped"), "{}", loaded.warnings_text());
    // The tiny one is no instance, and vanishes in rounding.
    assert_eq!(scene.placements().len(), count as usize - 1);
    assert_eq!(scene.triangle_count(), (count as usize - 1) * 320);
    assert_eq!(scene.stored_triangle_count(), 320);
    let copies = Scene::new(
        String::new(),
        scene.copies(),
        scene.materials().to_vec(),
        scene.lights().emitters().to_vec(),
        scene.camera,
        Vec::new(),
    )
    .unwrap();
    assert_eq!(scene.fingerprint(), copies.fingerprint());
    assert_eq!(scene.bounds(), copies.bounds());
}
