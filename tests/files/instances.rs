//! Meshes in binary PLY files at many places, as other programs write them for this one.

use bdpm::load::load;
use bdpm::scene::Scene;
use glam::{Vec2, Vec3};
use std::fs;
use std::sync::Arc;
use tempfile::TempDir;

/// Two triangles with normals, texture coordinates and colors.
fn ply() -> Vec<u8> {
    let names = ["x", "y", "z", "nx", "ny", "nz", "u", "v", "r", "g", "b"];
    let properties: String = names.iter().map(|name| format!("property float {name}\n")).collect();
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex 4\n{properties}element face 2\n\
         property list uchar uint vertex_indices\nend_header\n"
    );
    let mut bytes = header.into_bytes();
    for (x, y) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0_f32)] {
        let vertex = [x, y, 0.0, 0.0, 0.0, 1.0, x, 0.25 * y, 0.5, x, 2.0];
        vertex.iter().for_each(|number: &f32| bytes.extend(number.to_le_bytes()));
    }
    for corners in [[0, 1, 2], [0, 2, 3_u32]] {
        bytes.push(3);
        corners.iter().for_each(|corner| bytes.extend(corner.to_le_bytes()));
    }
    bytes
}

fn npy(places: &[[f32; 12]]) -> Vec<u8> {
    let count = places.len();
    let header =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({count}, 3, 4), }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    places.as_flattened().iter().for_each(|number| bytes.extend(number.to_le_bytes()));
    bytes
}

const HEAD: &str =
    "camera = { position = [0, 0, 9], target = [0, 0, 0], fov_y_deg = 40, shift = [0.25, -0.5] }
    environment = { radiance = 1 }
    [materials.chalk]
    [materials.lamp]
    emission = 1
    hidden = true
    [[mesh]]
    file = 'a.ply'\n";

fn scene(mesh: &str) -> Result<Arc<Scene>, String> {
    let folder = TempDir::new().unwrap();
    let moved = |x: f32| [1.0, 0.0, 0.0, x, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    fs::write(folder.path().join("a.ply"), ply()).unwrap();
    fs::write(folder.path().join("places.npy"), npy(&[moved(0.0), moved(3.0)])).unwrap();
    fs::write(folder.path().join("a.toml"), format!("{HEAD}{mesh}")).unwrap();
    load(folder.path().join("a.toml")).map(|loaded| loaded.scene).map_err(|e| e.to_string())
}

#[test]
fn ply_meshes_are_placed_by_each_matrix_of_an_array() {
    let scene = scene("material = 'lamp'\nplaces = 'places.npy'").unwrap();
    let meshes = scene.copies();
    assert_eq!(meshes.len(), 2);
    assert_eq!(meshes[1].positions[2], Vec3::new(4.0, 2.0, 0.0));
    assert_eq!(meshes[1].normals[2], Vec3::Z);
    assert_eq!(meshes[1].uvs[2], Vec2::new(1.0, 0.25), "v points up");
    assert_eq!(meshes[1].colors[2], Vec3::new(0.5, 1.0, 1.0), "clamped");
    assert!(scene.materials()[0].hidden_from_camera);
    assert_eq!(scene.camera.shift(), [0.25, -0.5]);
    let twice = "material = 'lamp'\n[[mesh]]\nfile = 'a.ply'\nmaterial = 'lamp'\n";
    let by_hand =
        self::scene(&format!("{twice}matrix = [[1,0,0,3],[0,2,0,0],[0,0,1,0],[0,0,0,1]]"));
    assert_eq!(by_hand.unwrap().copies()[1].positions, meshes[1].positions);
}

#[test]
fn invalid_ply_meshes_and_arrays_are_refused() {
    for (mesh, word) in [
        ("places = 'places.npy'", "a.toml:8: the mesh `a.ply` has no material"),
        ("material = 'chalk'\nplaces = 'none.npy'", "a.toml:10: there is no file `none.npy`"),
        ("material = 'chalk'\nplaces = 'a.ply'", "a.ply: this is not a NumPy file"),
        ("material = 'chalk'\nscale = 2\nplaces = 'places.npy'", "`places` besides another"),
    ] {
        let error = scene(mesh).unwrap_err();
        assert!(error.contains(word), "{word}: {error}");
    }
}
