//! Scenes of strangers: they may name any file of the user, but no error or warning shows what is
//! in a file outside of the folder of the scene, and nothing waits for a pipe.

use crate::common::gltf::square;
use bdpm::load::load;
use serde_json::json;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
const CAMERA: &str = "[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\nfov_y_deg = 40\n";
const LIGHT: &str = "[[light]]\ntype = 'point'\nposition = [0, 0, 5]\nintensity = 10\n";

/// All that is shown of a scene: its error, or its warnings.
fn shown(scene: &Path) -> String {
    load(scene).map_or_else(|error| error.to_string(), |loaded| loaded.warnings_text())
}

/// A folder with the folder `scene`, in which the scene is, and a file beside that folder.
fn beside(secret: (&str, &str), scene: (&str, &str)) -> TempDir {
    let root = TempDir::new().unwrap();
    fs::create_dir(root.path().join("scene")).unwrap();
    fs::write(root.path().join(secret.0), secret.1).unwrap();
    fs::write(root.path().join("scene").join(scene.0), scene.1).unwrap();
    root
}

#[test]
fn contents_of_files_outside_of_the_folder_are_not_shown() {
    let toml = format!("{CAMERA}{LIGHT}[[mesh]]\nfile = '../secret.obj'\n");
    let library = format!("mtllib ../secret.mtl\n{TRIANGLE}f 1 2 3\n");
    let spectrum = "<scene version='3.0.0'><shape type='rectangle'><bsdf type='diffuse'>\
                    <spectrum name='reflectance' filename='../secret.spd'/></bsdf></shape></scene>";
    let include = "<scene version='3.0.0'><include filename='../secret.xml'/></scene>";
    for (secret, content, scene, text) in [
        ("secret", "TOKEN=1 PATH=/bin", "a.pbrt", "Include \"../secret\"\n"),
        ("secret.mtl", "Kd TOKEN\n", "a.obj", &library[..]),
        ("secret.mtl", "TOKEN:x:0:0:TOKEN:/bin/sh\n", "a.obj", &library),
        ("secret.obj", "v 0 0 0\nf TOKEN\n", "a.toml", &toml),
        ("secret.xml", "TOKEN=1\n", "a.xml", include),
        ("secret.spd", "TOKEN 1\n", "a.xml", spectrum),
    ] {
        let root = beside((secret, content), (scene, text));
        let shown = shown(&root.path().join("scene").join(scene));
        assert!(!shown.contains("TOKEN"), "{scene} and {secret}:\n{shown}");
        assert!(shown.contains(secret), "{scene} does not name {secret}:\n{shown}");
        // In the folder of the scene, both are shown.
        let root = beside((&format!("scene/{secret}"), content), (scene, &text.replace("../", "")));
        let shown = self::shown(&root.path().join("scene").join(scene));
        assert!(shown.contains(secret), "{shown}");
        assert!(shown.contains("TOKEN") || secret.ends_with(".spd"), "{shown}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn environment_of_the_process_is_not_shown() {
    let library = format!("mtllib /proc/self/environ\n{TRIANGLE}f 1 2 3\n");
    for (name, text) in [("a.pbrt", "Include \"/proc/self/environ\"\n"), ("a.obj", &library[..])] {
        let root = TempDir::new().unwrap();
        fs::write(root.path().join(name), text).unwrap();
        let shown = shown(&root.path().join(name));
        assert!(shown.contains("/proc/self/environ"), "{shown}");
        // Cargo sets this variable for tests.
        assert!(!shown.contains("CARGO") && !shown.contains("PATH="), "{shown}");
    }
}

#[test]
fn gltf_files_outside_of_the_folder_are_refused() {
    let secret = [0u8; 1000];
    for uri in ["../secret.bin", "tex/../../secret.bin", "%2e%2e/secret.bin", "..\\secret.bin"] {
        let root = beside(("secret.bin", ""), ("a.gltf", &square().text_with(json!(uri))));
        fs::write(root.path().join("secret.bin"), secret).unwrap();
        fs::create_dir(root.path().join("scene/tex")).unwrap();
        let shown = shown(&root.path().join("scene/a.gltf"));
        assert!(shown.contains("buffers[0].uri: `") && shown.contains("leads out of"), "{shown}");
        assert!(shown.contains("put the file into the folder of the scene"), "{shown}");
    }
    // An absolute path is not read either: only its end counts, in the folder of the scene.
    let root = beside(("secret.bin", ""), ("a.gltf", ""));
    let (outside, scene) = (root.path().join("secret.bin"), root.path().join("scene/a.gltf"));
    fs::write(&outside, secret).unwrap();
    fs::write(&scene, square().text_with(json!(outside.to_str().unwrap()))).unwrap();
    assert!(shown(&scene).contains("buffers[0].uri: there is no file"), "{}", shown(&scene));
    // Pictures, which are warnings if they are missing
    let mut model = square();
    model.json["images"] = json!([{ "uri": "../secret.png" }]);
    fs::write(&scene, model.text()).unwrap();
    let shown = shown(&scene);
    assert!(shown.contains("images[0].uri: `../secret.png` leads out of"), "{shown}");
}

#[cfg(unix)]
#[test]
fn pipes_in_scenes_are_refused_without_waiting() {
    let mesh = format!("{CAMERA}{LIGHT}[[mesh]]\nfile = 'pipe.obj'\n");
    let environment = |file: &str| {
        format!("{CAMERA}[environment]\nfile = '{file}'\n[[mesh]]\nfile = 'triangle.obj'\n")
    };
    let [exr, hdr] = ["pipe.exr", "pipe.hdr"].map(environment);
    let texture = format!(
        "{CAMERA}{LIGHT}[materials.m]\nalbedo_texture = 'pipe.png'\n\
         [[mesh]]\nfile = 'triangle.obj'\nmaterial = 'm'\n"
    );
    let luminaire = format!(
        "{CAMERA}[[light]]\ntype = 'luminaire'\nfile = 'pipe.ies'\nposition = [0, 0, 5]\n\
         [[mesh]]\nfile = 'triangle.obj'\n"
    );
    let library = format!("mtllib pipe.mtl\n{TRIANGLE}f 1 2 3\n");
    let buffer = square().text_with(json!("pipe.bin"));
    let include = "<scene version='3.0.0'><include filename='pipe.xml'/></scene>";
    let refused = "neither a regular file nor a folder";
    for (pipe, scene, text, problem) in [
        ("pipe.obj", "a.toml", &mesh[..], refused),
        ("pipe.exr", "a.toml", &exr, refused),
        ("pipe.hdr", "a.toml", &hdr, refused),
        ("pipe.png", "a.toml", &texture, "there is no texture `pipe.png`"),
        ("pipe.ies", "a.toml", &luminaire, "there is no file `pipe.ies`"),
        ("pipe.mtl", "a.obj", &library, refused),
        ("pipe.bin", "a.gltf", &buffer, "pipe.bin"),
        ("pipe.pbrt", "a.pbrt", "Include \"pipe.pbrt\"\n", refused),
        ("pipe.xml", "a.xml", include, "pipe.xml"),
    ] {
        let root = TempDir::new().unwrap();
        let at = |name: &str| root.path().join(name);
        fs::write(at("triangle.obj"), format!("{TRIANGLE}f 1 2 3\n")).unwrap();
        let made = std::process::Command::new("mkfifo").arg(at(pipe)).status();
        assert!(made.unwrap().success());
        fs::write(at(scene), text).unwrap();
        let shown = shown(&at(scene));
        assert!(shown.contains(problem), "{scene} with {pipe}:\n{shown}");
    }
}
