//! Pictures are small, and have the size at which `scripts/pictures.sh` renders them.

use super::markdown::{files, root};
use std::fs;
use std::path::Path;

/// Bytes of a picture.
const MOST_BYTES: u64 = 400 * 1024;

/// Pictures of one image in the script, with the size of the image. Strips of several images are
/// left out.
fn sizes(script: &str) -> Vec<(String, (u32, u32))> {
    let size = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        // `hall) denoised hall hall 600 --resolution 1620x1080 ;;`
        let name = words.first()?.strip_suffix(')')?;
        let is_single = ["single", "denoised"].contains(words.get(1)?);
        let at = words.iter().position(|word| *word == "--resolution")?;
        let (width, height) = words.get(at + 1)?.split_once('x')?;
        let size = (width.parse().ok()?, height.parse().ok()?);
        is_single.then(|| (name.to_owned(), size))
    };
    script.lines().filter_map(size).collect()
}

#[test]
fn pictures_have_the_size_of_the_script() {
    let script = fs::read_to_string(root().join("scripts/pictures.sh")).unwrap();
    let sizes = sizes(&script);
    assert!(sizes.len() > 5, "there are too few pictures in the script");
    for (name, expected) in sizes {
        let path = format!("docs/pictures/{name}.jpg");
        if !root().join(&path).exists() {
            continue; // Not each picture of the script is in the documentation.
        }
        let size = image::image_dimensions(root().join(&path)).unwrap();
        assert_eq!(size, expected, "{path}: its size, and that in the script");
    }
}

#[test]
fn pictures_are_small() {
    for path in files("docs/pictures") {
        let bytes = fs::metadata(root().join(&path)).unwrap().len();
        assert!(bytes <= MOST_BYTES, "{}: {bytes} bytes", path.display());
    }
}

/// Pictures that the script does not make, by the table of CONTRIBUTING.
#[test]
fn every_picture_has_an_origin() {
    let read = |path: &str| fs::read_to_string(root().join(path)).unwrap();
    let (script, contributing) = (read("scripts/pictures.sh"), read("CONTRIBUTING.md"));
    for path in files("docs/pictures") {
        let name = Path::new(&path).file_name().unwrap().to_str().unwrap();
        let stem = name.split('.').next().unwrap();
        // The script names pictures of media by their scene.
        let scene = stem.strip_suffix("-volpath").unwrap_or(stem);
        let is_made = script.contains(&format!("$out/{stem}.jpg"))
            || script.contains(&format!("\n        {stem})"))
            || (scene != stem && script.contains(&format!(" {scene}")));
        let is_listed = contributing.contains(&format!("| `{name}` |"));
        assert!(is_made || is_listed, "{}: nothing says how it is made", path.display());
    }
}

#[test]
fn sizes_in_the_script_are_found() {
    let script = "  a) single a b 5 --resolution 32x16 ;;\n  c) render c d 5 --resolution 8x8\n";
    assert_eq!(sizes(script), [("a".to_owned(), (32, 16))]);
}
