//! Pictures of Radiance in all their layouts and encodings: each is the same sky.

use crate::common::gltf::{Files, SQUARE_OBJ, files};
use bdpm::load::load;
use glam::Vec3;

const SIZE: [usize; 2] = [16, 8];

/// Mantissas and exponent of a pixel: no symmetry of the map keeps all of them.
fn code(x: usize, y: usize) -> [u8; 4] {
    let bright = if x > 9 { 200 } else { 40 };
    [bright, 30 + 20 * (y / 3) as u8, 9, if y > 4 { 131 } else { 128 }]
}

fn scene(hdr: &[u8]) -> Files {
    let scene = "mesh = [{ file = 'a.obj' }]\nenvironment = { file = 'a.hdr' }\n\
                 camera = { position = [0, 0, 5], direction = [0, 0, -1], fov_x_deg = 40 }\n";
    files(&[("a.obj", SQUARE_OBJ.as_bytes()), ("a.hdr", hdr), ("a.toml", scene.as_bytes())])
}

/// The pixels of the environment, row by row.
#[track_caller]
fn pixels(hdr: &[u8]) -> Vec<Vec3> {
    let scene = scene(hdr).load().scene;
    let environment = scene.lights().environment().unwrap();
    let size = environment.size().map(|size| size as usize);
    assert_eq!(size, SIZE);
    environment.pixels().collect()
}

/// A file of these lines before its size, whose pixels are the codes at these places.
fn file(lines: &str, size: &str, places: impl Iterator<Item = (usize, usize)>) -> Vec<u8> {
    let head = format!("#?RADIANCE\n{lines}\n{size}\n");
    head.into_bytes().into_iter().chain(places.flat_map(|(x, y)| code(x, y))).collect()
}

fn rows() -> impl Iterator<Item = (usize, usize)> {
    (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y)))
}

const RGBE: &str = "FORMAT=32-bit_rle_rgbe\n";

/// The sky of a file in the usual layout.
fn sky() -> Vec<Vec3> {
    let pixels = pixels(&file(RGBE, "-Y 8 +X 16", rows()));
    let expected = rows().map(|(x, y)| {
        let [r, g, b, exponent] = code(x, y);
        Vec3::new(r.into(), g.into(), b.into()) * (f32::from(exponent) - 136.0).exp2()
    });
    assert!(pixels == expected.collect::<Vec<_>>(), "{pixels:?}");
    pixels
}

#[test]
fn all_orientations_are_the_same_sky() {
    let sky = sky();
    let [width, height] = SIZE;
    let across = |sign: &str, i: usize| if sign == "+" { i } else { width - 1 - i };
    let down = |sign: &str, i: usize| if sign == "-" { i } else { height - 1 - i };
    for (y, x) in [("-", "+"), ("-", "-"), ("+", "+"), ("+", "-")] {
        let by_rows = (0..height)
            .flat_map(|j| (0..width).map(move |i| (i, j)))
            .map(|(i, j)| (across(x, i), down(y, j)));
        let by_columns = (0..width)
            .flat_map(|i| (0..height).map(move |j| (i, j)))
            .map(|(i, j)| (across(x, i), down(y, j)));
        for (size, places) in [
            (format!("{y}Y 8 {x}X 16"), by_rows.collect::<Vec<_>>()),
            (format!("{x}X 16 {y}Y 8"), by_columns.collect()),
        ] {
            assert!(pixels(&file(RGBE, &size, places.into_iter())) == sky, "{size}");
        }
    }
}

/// Three mantissas of 1 repeat the pixel before, as often as their exponent says.
#[test]
fn older_runs_are_the_same_sky() {
    let mut file = format!("#?RGBE\n{RGBE}\n-Y 8 +X 16\n").into_bytes();
    for y in 0..SIZE[1] {
        file.extend(code(0, y));
        file.extend([1, 1, 1, 9]);
        file.extend(code(10, y));
        file.extend([1, 1, 1, 5]);
    }
    assert!(pixels(&file) == sky());
}

#[test]
fn runs_of_channels_are_the_same_sky() {
    let mut file = b"#?RADIANCE\r\nFORMAT=32-bit_rle_rgbe\r\n\r\n-Y 8 +X 16\r\n".to_vec();
    for y in 0..SIZE[1] {
        file.extend([2, 2, 0, 16]);
        for channel in 0..4 {
            file.extend([128 + 9, code(0, y)[channel], 1, code(9, y)[channel]]);
            file.extend([128 + 6, code(15, y)[channel]]);
        }
    }
    assert!(pixels(&file) == sky());
}

/// CIE XYZ of Rec. 709 with the white D65 (IEC 61966-2-1).
#[test]
fn colors_of_cie_xyz_are_converted() {
    let xyze = "FORMAT=32-bit_rle_xyze\n";
    let head = format!("#?RADIANCE\n{xyze}\n-Y 1 +X 3\n").into_bytes();
    // White, red of Rec. 709 and black.
    let codes: [[u8; 4]; 3] = [[122, 128, 139, 129], [211, 109, 10, 129], [0, 0, 0, 0]];
    let scene = scene(&[&head[..], codes.as_flattened()].concat()).load().scene;
    let pixels: Vec<Vec3> = scene.lights().environment().unwrap().pixels().collect();
    for (pixel, expected) in pixels.iter().zip([Vec3::ONE, Vec3::new(4.0, 0.0, 0.0), Vec3::ZERO]) {
        assert!((pixel - expected).abs().max_element() < 0.03, "{pixel}, not {expected}");
    }
}

#[test]
fn damaged_files_are_refused_with_the_scanline() {
    let good = file(RGBE, "-Y 8 +X 16", rows());
    let refused = |bytes: &[u8], part: &str| scene(bytes).refused(&["a.hdr", "HDR image: ", part]);
    refused(&good[..good.len() - 70], "scanline 7 of 8 is cut off");
    refused(b"P6 3 3", "it does not begin with `#?`");
    refused(b"#?RADIANCE\nFORMAT=8-bit\n\n-Y 1 +X 1\n", "the format `8-bit` is unknown");
    refused(b"#?RADIANCE\n\n-Y 1 -Y 1\n", "`-Y 1 -Y 1` is not a size");
    refused(b"#?RADIANCE\n\n-Y 99999 +X 1\n", "at most 65536 pixels");
    refused(b"#?RADIANCE\n\n-Y 1 +X 4\n\x01\x01\x01\x04", "scanline 1 of 1 begins with a run");
    refused(b"#?RADIANCE\n", "its header has no end");
}

/// Exponents below and above those of single precision's whole numbers.
#[test]
fn small_and_large_exponents_keep_their_values() {
    let radiance = |exponent: u8| {
        let file = [&b"#?RADIANCE\n\n-Y 1 +X 1\n"[..], &[128, 0, 0, exponent]].concat();
        let files = scene(&file);
        let loaded = load(&files.1).unwrap();
        loaded.scene.lights().environment().unwrap().pixels().next().unwrap().x
    };
    for exponent in [90, 129, 170] {
        let expected = (f64::from(exponent) - 129.0).exp2();
        assert_eq!(f64::from(radiance(exponent)), expected, "{exponent}");
    }
}
