//! Scenes from meshes in memory.

use bdpm::import::render_settings;
use bdpm::load::{LoadOptions, NamedMesh, load, load_meshes};
use bdpm::scene::Mesh;
use bdpm::settings::Length;
use glam::Vec3;
use std::path::Path;
use std::sync::Arc;
use tempfile::TempDir;

const REST: &str = "
[camera]
position = [0, 0, 2]
target = [0, 0, 0]
fov_y_deg = 40
[materials.chalk]
albedo = 0.5
[[light]]
type = \"point\"
position = [0, 0, 1]
intensity = 1
";

fn square() -> Mesh {
    let positions = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    Mesh {
        name: "square".into(),
        positions: positions.map(|(x, y)| Vec3::new(x, y, 0.0)).into(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    }
}

fn build(mesh: Mesh, material: &str, text: &str) -> bdpm::Result<bdpm::load::Loaded> {
    let mesh = NamedMesh { mesh: Arc::new(mesh), material: material.into() };
    load_meshes(Path::new("folder/name"), text, &[mesh], &LoadOptions::default())
}

#[test]
fn scene_of_meshes_in_memory_has_the_fingerprint_of_its_file() {
    let folder = TempDir::new().unwrap();
    let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n";
    std::fs::write(folder.path().join("a.obj"), obj).unwrap();
    let path = folder.path().join("a.toml");
    let text = format!("[[mesh]]\nfile = \"a.obj\"\nmaterial = \"chalk\"\n{REST}");
    std::fs::write(&path, text).unwrap();
    let loaded = build(square(), "chalk", REST).unwrap();
    assert_eq!(loaded.scene.fingerprint(), load(&path).unwrap().scene.fingerprint());
    assert_eq!(loaded.scene.name, "name");
    assert!(loaded.warnings.is_empty(), "{}", loaded.warnings_text());
}

#[test]
fn bad_meshes_in_memory_are_refused() {
    let refused = |mesh, material, text: &str| build(mesh, material, text).unwrap_err().to_string();
    let broken = Mesh { triangles: vec![[0, 1, 4]], ..square() };
    let shown = refused(broken, "chalk", REST);
    assert!(shown.contains("`square`") && shown.contains("vertex 4 of 4"), "{shown}");
    let few_normals = Mesh { normals: vec![Vec3::Z], ..square() };
    assert!(refused(few_normals, "chalk", REST).contains("1 normals for 4 positions"));
    let infinite = Mesh { positions: vec![Vec3::INFINITY; 4], ..square() };
    assert!(refused(infinite, "chalk", REST).contains("not finite"));
    let far = Mesh { positions: vec![Vec3::splat(1e30); 4], ..square() };
    assert!(refused(far, "chalk", REST).contains("out of the range"));
    let shown = refused(square(), "chlak", REST);
    assert!(shown.starts_with("folder/name: unknown material `chlak`"), "{shown}");
    let shown = refused(square(), "chalk", &format!("{REST}brightness = 1\n"));
    assert!(shown.starts_with("folder/name:12: unknown key `brightness`"), "{shown}");
}

#[test]
fn render_settings_are_read_without_a_file() {
    let origin = Path::new("<settings>");
    let settings = render_settings(origin, "radius = \"1%\"\nseed = 3\n").unwrap();
    assert_eq!((settings.radius, settings.seed), (Some(Length::Share(0.01)), Some(3)));
    let error = render_settings(origin, "seed = 3\nraduis = 1\n").unwrap_err();
    assert_eq!((error.path(), error.line_number()), (Some(origin), Some(2)));
    assert_eq!(error.problem(), "unknown key `raduis`");
}
