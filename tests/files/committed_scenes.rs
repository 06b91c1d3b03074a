//! Scenes of this repository: their dimensions, materials and lights.

use bdpm::accel::Ray;
use bdpm::load::load;
use bdpm::scene::backend::{Backend, build};
use bdpm::scene::bsdf::Bsdf;
use bdpm::scene::{Emitter, FieldOfView, Optics, Scene};
use bdpm::settings::{Direct, Length, PartialSettings, Settings};
use glam::Vec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn root(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Area of each mesh by name, and whether all its normals are turned toward a point.
fn part(scene: &Arc<Scene>, name: &str, point: Vec3) -> (f64, bool) {
    let mut first = 0;
    for mesh in scene.meshes() {
        let triangles = &scene.triangles()[first..first + mesh.triangles.len()];
        if mesh.name == name {
            let area = triangles.iter().map(|t| f64::from(t.area())).sum();
            return (area, triangles.iter().all(|t| t.normal.dot(point - t.origin) > 0.0));
        }
        first += triangles.len();
    }
    panic!("no mesh {name}");
}

fn check_box(scene: &Arc<Scene>) {
    assert_eq!(scene.bounds().min, Vec3::ZERO);
    assert_eq!(scene.bounds().max, Vec3::new(556.0, 548.8, 559.2));
    let middle = Vec3::new(278.0, 274.4, 279.6);
    // Areas of the measured quads, by hand: trapezoids and rectangles.
    for (name, area) in [
        ("floor", 0.5 * (552.8 + 549.6) * 559.2),
        ("ceiling", 556.0 * 559.2),
        ("back-wall", 0.5 * (549.6 + 556.0) * 548.8),
        ("right-wall", 559.2 * 548.8),
    ] {
        let (measured, inside) = part(scene, name, middle);
        assert!((measured / area - 1.0).abs() < 1e-5, "{name}: {measured}, not {area}");
        assert!(inside, "the front of {name} is outside");
    }
    assert!(part(scene, "left-wall", middle).1);
    for (name, center) in [
        ("short-block", Vec3::new(185.5, 82.5, 169.0)),
        ("tall-block", Vec3::new(368.5, 165.0, 351.25)),
    ] {
        // The normals of the top and four sides look away from the center, and with the missing
        // bottom the area vectors sum to zero: the block is closed but for its bottom.
        let mut sum = glam::DVec3::ZERO;
        let mesh = scene.meshes().iter().position(|m| m.name == name).unwrap();
        assert_eq!(scene.meshes()[mesh].triangles.len(), 10);
        let first: usize = scene.meshes()[..mesh].iter().map(|m| m.triangles.len()).sum();
        let mut top = 0.0;
        for t in &scene.triangles()[first..first + 10] {
            assert!(t.normal.dot(center - t.origin) < 0.0, "{name} is inside out");
            sum += t.normal.as_dvec3() * f64::from(t.area());
            top += if t.normal.y > 0.99 { f64::from(t.area()) } else { 0.0 };
        }
        assert!((sum - glam::DVec3::new(0.0, top, 0.0)).length() < 1e-3 * top, "{name}: {sum}");
    }
}

#[test]
fn cornell_box_has_the_dimensions_of_the_paper() {
    let loaded = load(root("scenes/cornell-box")).unwrap();
    let scene = &loaded.scene;
    assert_eq!(loaded.warnings_text(), "");
    assert_eq!((scene.name.as_str(), scene.triangle_count()), ("cornell-box", 30));
    check_box(scene);
    assert!(scene.materials().iter().all(|m| m.bsdf.albedo() == Vec3::splat(0.5)));
    assert_eq!(
        scene.lights().emitters(),
        [Emitter::Point { position: Vec3::new(278.0, 534.3, 279.6), intensity: Vec3::splat(1e6) }]
    );
    assert_eq!(scene.camera.position(), Vec3::new(278.0, 273.0, -800.0));
    assert_eq!(scene.camera.direction(), Vec3::Z);
    assert_eq!(scene.camera.optics(), Optics::Pinhole(FieldOfView::X(39.3077)));
    let expected = PartialSettings {
        resolution: Some([512, 512]),
        crop: None,
        light_paths: Some(1000),
        camera_paths: Some(25),
        radius: Some(Length::Units(4.633_333)),
        caustic_radius: None,
        medium_scale: None,
        medium_share: None,
        medium_query: None,
        wavelength_width: None,
        bias: None,
        kernel: None,
        merge_vertex: Some(2),
        strategy: None,
        guide: None,
        sobol_set: None,
        splitting: None,
        light_visibility: None,
        direct: Some(Direct::Connect),
        seed: None,
    };
    assert_eq!(loaded.defaults, expected);
    // In 8 by 8 pixels the region is rows 2 to 4 of the outermost columns.
    let region = &scene.regions[0];
    assert_eq!((region.name.as_str(), scene.regions.len()), ("side-walls", 1));
    for y in 0..8 {
        for x in 0..8 {
            let inside = (2..5).contains(&y) && (x == 0 || x == 7);
            assert_eq!(region.contains(x, y, 8, 8), inside, "{x} {y}");
        }
    }
}

#[test]
fn classic_cornell_box_has_its_lamp_and_colors() {
    let loaded = load(root("scenes/cornell-box-classic")).unwrap();
    let scene = &loaded.scene;
    assert_eq!(loaded.warnings_text(), "");
    assert_eq!((scene.name.as_str(), scene.triangle_count()), ("cornell-box-classic", 32));
    check_box(scene);
    assert_eq!(scene.lights().emitters().len(), 2);
    let (area, inside) = part(scene, "light", Vec3::new(278.0, 0.0, 279.6));
    assert!((area - 130.0 * 105.0).abs() < 0.01 && inside, "{area}");
    let color = |name: &str| {
        let mesh = scene.meshes().iter().find(|m| m.name == name).unwrap();
        scene.materials()[mesh.material as usize].bsdf.albedo()
    };
    // In the photographs red is on the left, and the camera has +x on its left.
    assert_eq!(color("left-wall"), Vec3::new(0.63, 0.065, 0.05));
    assert_eq!(color("right-wall"), Vec3::new(0.14, 0.45, 0.091));
    Settings::resolve(&PartialSettings::default(), &loaded.defaults, scene.size()).unwrap();
}

#[test]
fn materials_scene_has_every_material() {
    let loaded = load(root("scenes/materials")).unwrap();
    assert_eq!(loaded.warnings_text(), "");
    let materials = &loaded.scene.materials();
    let has = |wanted: fn(&Bsdf) -> bool| materials.iter().any(|m| wanted(&m.bsdf));
    assert!(
        has(|b| matches!(b, Bsdf::Lambertian { .. })) && has(|b| matches!(b, Bsdf::Mirror { .. }))
    );
    assert!(
        has(|b| matches!(b, Bsdf::Dielectric(_))) && has(|b| matches!(b, Bsdf::ThinDielectric(_)))
    );
    assert!(
        has(|b| matches!(b, Bsdf::RoughDielectric(_))) && has(|b| matches!(b, Bsdf::Coated(_)))
    );
    assert!(has(|b| matches!(b, Bsdf::Conductor(metal) if metal.alpha() == 0.0)));
    assert!(has(|b| matches!(b, Bsdf::Conductor(metal) if metal.alpha() > 0.4)));
    assert!(materials.iter().any(|m| m.albedo_texture.is_some()));
    assert!(materials.iter().any(|m| m.alpha_mask().is_some()));
    assert!(has(|b| matches!(b, Bsdf::Glossy(_))));
    assert!(materials.iter().any(|m| m.metallic_roughness_texture.is_some()));
    assert!(materials.iter().any(|m| m.normal_map.is_some()));
    assert!(materials.iter().any(|m| m.emission_texture.is_some()));
    assert!(loaded.scene.meshes().iter().any(|mesh| !mesh.normals.is_empty()));
}

#[test]
fn keyhole_scene_has_no_direct_light_behind_the_keyhole() {
    let loaded = load(root("scenes/keyhole")).unwrap();
    let scene = &loaded.scene;
    assert_eq!(loaded.warnings_text(), "");
    assert_eq!((scene.name.as_str(), scene.triangle_count()), ("keyhole", 64));
    let [Emitter::Point { position, .. }] = scene.lights().emitters() else { panic!("one lamp") };
    let accel = build(Backend::Bvh, scene).unwrap();
    // The opening on the lamp's side; rays through it end before the camera's room at x = 0, those
    // straight ahead do not.
    for i in 0..400 {
        let share = |k: i32| 0.4 * (k as f32 + 0.5) / 20.0;
        let entry = Vec3::new(-0.2, 1.0 + share(i % 20), 1.8 + share(i / 20));
        let end = |direction| entry.x + accel.closest_hit(&Ray::new(entry, direction)).t;
        let direction = entry - *position;
        assert!(end(direction / direction.x) < 0.0, "{entry}");
        assert!(end(Vec3::X) > 0.0, "{entry}");
    }
    Settings::resolve(&PartialSettings::default(), &loaded.defaults, scene.size()).unwrap();
}
