//! `--photometric`: luminance in cd/m^2.

use crate::common::program_output::succeed;
use bdpm::image_io::{Value, read_exr};
use std::process::Command;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");

#[test]
fn photometric_image_has_luminance_and_a_map_in_false_colors() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    let options = ["--iterations", "2", "--resolution", "32x32", "--light-paths", "1000"];
    command.current_dir(folder.path()).args(["render", SCENE, "-o", "a.exr", "--photometric"]);
    succeed(&command.args(options).output().unwrap());
    let image = read_exr(&folder.path().join("a.exr")).unwrap();
    let pixels = image.layer("").unwrap().to_rgb().unwrap();
    let values = image.layer("luminance").unwrap().channel("Y").unwrap();
    for (pixel, value) in pixels.iter().zip(values) {
        let expected = 683.0 * (0.2126 * pixel.x + 0.7152 * pixel.y + 0.0722 * pixel.z);
        assert!((value - expected).abs() <= 1e-5 * expected, "{value} {expected}");
    }
    assert_eq!(image.metadata["luminance unit"], Value::Text("cd/m2".into()));
    assert_eq!(image.metadata["luminance in lumens per watt"], Value::Number(683.0));
    let map = image::open(folder.path().join("a.luminance.png")).unwrap();
    assert!(map.width() > 512 && map.height() >= 512);
    assert!(folder.path().join("a.png").is_file());
}
