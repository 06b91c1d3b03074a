//! `bdpm tone`.

use crate::common::program_output::{assert_refused, json, succeed, text};
use bdpm::base::math::Rgb;
use bdpm::image_io::{
    Image, Layer, Metadata, ToneCurve, ToneMapping, Value, write_exr, write_png_as,
};
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn tone(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.arg("tone").args(arguments).current_dir(folder).stdin(Stdio::null()).output().unwrap()
}

/// A reddish image with a brighter half and a layer of one channel.
fn write_image(path: &Path, metadata: Metadata) -> Vec<Rgb> {
    let pixels: Vec<Rgb> = (0..48).map(|i| (1 + i / 24) as f32 * Rgb::new(0.8, 0.4, 0.2)).collect();
    let depth = Layer { name: "depth".into(), channels: vec![("Z".into(), vec![2.0; 48])] };
    let layers = vec![Layer::rgb("", &pixels), depth];
    write_exr(path, &Image { width: 8, height: 6, layers, metadata }).unwrap();
    pixels
}

fn rgb(path: &Path) -> Vec<[u8; 3]> {
    image::open(path).unwrap().to_rgb8().pixels().map(|pixel| pixel.0).collect()
}

#[test]
fn picture_is_that_of_the_preview_with_the_same_options() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let pixels = write_image(&at("a.exr"), Metadata::new());
    let report = json(&tone(folder.path(), &["a.exr", "b.png", "--json"]));
    let mapping = ToneMapping::default();
    let exposure = write_png_as(&at("c.png"), (8, 6), &pixels, mapping).unwrap();
    assert_eq!(fs::read(at("b.png")).unwrap(), fs::read(at("c.png")).unwrap());
    assert_eq!(report["exposure"].as_f64().unwrap() as f32, exposure);
    assert!(report["white_balance"].is_null() && report["layer"] == "image", "{report}");

    let own = ["a.exr", "b.png", "--tonemap", "agx", "--exposure", "-1"];
    succeed(&tone(folder.path(), &own));
    let mapping = ToneMapping { curve: ToneCurve::Agx, stops: -1.0 };
    write_png_as(&at("c.png"), (8, 6), &pixels, mapping).unwrap();
    assert_eq!(fs::read(at("b.png")).unwrap(), fs::read(at("c.png")).unwrap());

    // A radiance as display white, whatever the image shows.
    let report = json(&tone(folder.path(), &["a.exr", "b.png", "--white", "4", "--json"]));
    assert_eq!(report["exposure"], 0.25);
    let depth = ["a.exr", "b.png", "--layer", "depth", "--white", "2"];
    assert!(succeed(&tone(folder.path(), &depth)).contains("of the layer depth"));
    let shown = rgb(&at("b.png"));
    assert!(shown.iter().all(|[r, g, b]| r == g && g == b && *r > 200), "{shown:?}");
}

#[test]
fn white_balance_makes_a_color_gray() {
    let folder = tempfile::tempdir().unwrap();
    write_image(&folder.path().join("a.exr"), Metadata::new());
    for balance in ["auto", "0.8,0.4,0.2", "3,2"] {
        let own = ["a.exr", "b.png", "--white-balance", balance, "--json"];
        let report = json(&tone(folder.path(), &own));
        let kelvin = report["white_balance"]["kelvin"].as_f64().unwrap();
        assert!((2000.0..4000.0).contains(&kelvin), "{balance}: {report}");
        for [r, g, b] in rgb(&folder.path().join("b.png")) {
            assert!(r.abs_diff(g) <= 1 && g.abs_diff(b) <= 1, "{balance}: {r} {g} {b}");
        }
    }
    let shown =
        succeed(&tone(folder.path(), &["a.exr", "b.png", "--white-balance", "3000"])).to_owned();
    assert!(shown.contains("about 30") && shown.contains("K became gray"), "{shown}");
}

#[test]
fn hdr_images_are_read_and_other_files_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // Two flat pixels of Radiance: mantissas 128 at the exponent of 1.
    let header = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n";
    fs::write(at("a.hdr"), [&header[..], &[128, 128, 128, 129].repeat(2)].concat()).unwrap();
    succeed(&tone(folder.path(), &["a.hdr", "a.png", "--white", "1"]));
    assert_eq!(rgb(&at("a.png")).len(), 2);
    let refused = tone(folder.path(), &["a.hdr", "a.png", "--layer", "depth"]);
    assert_refused(&refused, "only .exr files have layers", "leave out --layer");
    let refused = tone(folder.path(), &["a.png", "b.png"]);
    assert_refused(&refused, "a.png: the image is neither an .exr nor an .hdr file", "convert");
    let metadata = Metadata::from([("version".into(), Value::Text("1".into()))]);
    write_image(&at("a.exr"), metadata);
    let refused = tone(folder.path(), &["a.exr", "b.jpg"]);
    assert_refused(&refused, "does not end in .png", "b.png");
    let refused = tone(folder.path(), &["a.exr", "b.png", "--layer", "albdo"]);
    assert_refused(&refused, "no layer albdo", "--layer with one of image, depth");
    let refused = tone(folder.path(), &["a.exr", "b.png", "--white-balance", "8,0"]);
    assert_refused(&refused, "a.exr: the pixel 8,0 is not within 8x6 pixels", "column and row");
    let usage = tone(folder.path(), &["a.exr", "b.png", "--white-balance", "warm"]);
    assert!(text(&usage.stderr).contains("`warm` is no white balance"), "{usage:?}");
    assert!(!at("b.png").exists());
}
