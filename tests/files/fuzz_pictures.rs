//! No picture makes the loader panic or take much memory: textures (PNG, JPEG and other kinds) and
//! maps of the environment (EXR, HDR) with bytes replaced, deleted and doubled.
//! `PROPTEST_CASES=100000` tries far more.

use crate::common::mutate::{apply, change, fuzz_config, load_and_check};
use crate::common::own_process::{self, peak_memory};
use bdpm::image_io::{Image, Layer, write_exr};
use bdpm::load::load;
use glam::Vec3;
use proptest::collection::vec;
use proptest::prelude::*;
use std::sync::LazyLock;
use tempfile::TempDir;

const JPEG: &[u8] = include_bytes!("../data/quarters.jpg");
const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
const SIZE: [u32; 2] = [16, 8];

static PNG: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, SIZE[0], SIZE[1]);
    encoder.set_color(png::ColorType::Rgba);
    let data: Vec<u8> = (0..4 * SIZE[0] * SIZE[1]).map(|i| (i * i / 7) as u8).collect();
    encoder.write_header().unwrap().write_image_data(&data).unwrap();
    bytes
});

/// Textures of other kinds, by file name.
static OTHERS: LazyLock<[(&str, Vec<u8>); 4]> = LazyLock::new(|| {
    use image::ImageFormat::{Bmp, Tga, Tiff, WebP};
    [("a.tga", Tga), ("a.bmp", Bmp), ("a.tif", Tiff), ("a.webp", WebP)].map(|(name, format)| {
        let data = (0..3 * SIZE[0] * SIZE[1]).map(|i| (i * i / 7) as u8).collect();
        let mut bytes = std::io::Cursor::new(Vec::new());
        let picture = image::RgbImage::from_raw(SIZE[0], SIZE[1], data).unwrap();
        picture.write_to(&mut bytes, format).unwrap();
        (name, bytes.into_inner())
    })
});

static EXR: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let pixel = |i: u32| Vec3::new(i as f32, 0.5, 1.0 / (1.0 + i as f32));
    let pixels: Vec<Vec3> = (0..SIZE[0] * SIZE[1]).map(pixel).collect();
    let [width, height] = SIZE;
    let layers = vec![Layer::rgb("", &pixels)];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    write_exr(&path, &Image { width, height, layers, metadata: Default::default() }).unwrap();
    std::fs::read(path).unwrap()
});

/// Rows of one run per channel.
static HDR: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let [width, height] = SIZE;
    let head = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n");
    let row = |row: u32| {
        let run = |value: u8| [128 + width as u8, value];
        let channels = [run(row as u8), run(128), run(200), run(130)];
        [&[2, 2, 0, width as u8], channels.as_flattened()].concat()
    };
    head.into_bytes().into_iter().chain((0..height).flat_map(row)).collect()
});

/// A folder of a scene that has this picture as a texture or around it.
fn scene(name: &str, picture: &[u8]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    let used = match name {
        "a.exr" | "a.hdr" => format!("materials.m = {{}}\nenvironment = {{ file = '{name}' }}\n"),
        _ => format!(
            "materials.m = {{ albedo_texture = '{name}', opacity_texture = '{name}' }}\n\
             materials.lamp = {{ emission_texture = '{name}' }}\n"
        ),
    };
    let lamp = if used.contains("lamp") { ", { file = 'a.obj', material = 'lamp' }" } else { "" };
    let scene = format!(
        "camera = {{ position = [0, 0, 5], direction = [0, 0, -1], fov_x_deg = 40 }}\n\
         light = [{{ type = 'point', position = [0, 0, 5], intensity = 1 }}]\n\
         mesh = [{{ file = 'a.obj', material = 'm' }}{lamp}]\n{used}"
    );
    write("scene.toml", scene.as_bytes());
    write("a.obj", OBJ.as_bytes());
    write(name, picture);
    folder
}

fn check(name: &str, picture: &[u8]) {
    load_and_check(scene(name, picture).path());
    assert!(peak_memory().is_none_or(|peak| peak < 2 << 30), "took {:?} bytes", peak_memory());
}

/// Bytes replaced anywhere, mostly in the head, where sizes are.
fn bytes() -> impl Strategy<Value = Vec<(f64, u8)>> {
    let place = prop_oneof![0.0..1.0, 0.0..0.2_f64];
    vec((place, prop_oneof![any::<u8>(), Just(0), Just(255), Just(127)]), 1..20)
}

fn replaced(picture: &[u8], bytes: &[(f64, u8)]) -> Vec<u8> {
    let mut picture = picture.to_vec();
    for (place, byte) in bytes {
        let place = (place * picture.len() as f64) as usize;
        picture[place] = *byte;
    }
    picture
}

proptest! {
    // The peak stays: smaller cases would fail as well.
    #![proptest_config(ProptestConfig { max_shrink_iters: 0, ..fuzz_config(700) })]

    fn changed_png(changes in vec(change(), 0..4), bytes in bytes()) {
        let mut picture = replaced(&PNG, &bytes);
        changes.iter().for_each(|change| apply(&mut picture, change));
        check("a.png", &picture);
    }

    fn changed_jpeg(changes in vec(change(), 0..4), bytes in bytes()) {
        let mut picture = replaced(JPEG, &bytes);
        changes.iter().for_each(|change| apply(&mut picture, change));
        check("a.jpg", &picture);
    }

    fn changed_others(changes in vec(change(), 0..4), bytes in bytes(), kind in 0..OTHERS.len()) {
        let (name, picture) = &OTHERS[kind];
        let mut picture = replaced(picture, &bytes);
        changes.iter().for_each(|change| apply(&mut picture, change));
        check(name, &picture);
    }

    fn changed_exr(changes in vec(change(), 0..4), bytes in bytes()) {
        let mut picture = replaced(&EXR, &bytes);
        changes.iter().for_each(|change| apply(&mut picture, change));
        check("a.exr", &picture);
    }

    fn changed_hdr(changes in vec(change(), 0..4), bytes in bytes()) {
        let mut picture = replaced(&HDR, &bytes);
        changes.iter().for_each(|change| apply(&mut picture, change));
        check("a.hdr", &picture);
    }
}

/// Defines tests that [`own_process::run`] these functions.
macro_rules! in_own_process {
    ($($test:ident: $function:ident;)*) => {$(
        #[test]
        fn $test() {
            let path = concat!(module_path!(), "::", stringify!($test));
            own_process::run(path, $function);
        }
    )*};
}

in_own_process! {
    changed_png_loads_or_is_refused: changed_png;
    changed_jpeg_loads_or_is_refused: changed_jpeg;
    other_changed_pictures_load_or_are_refused: changed_others;
    changed_exr_loads_or_is_refused: changed_exr;
    changed_hdr_loads_or_is_refused: changed_hdr;
    impossible_picture_sizes_are_refused: impossible_sizes;
    large_display_windows_are_refused: large_display_windows;
}

/// Found by the changes above: a display window that one byte made larger took 4 GB.
fn large_display_windows() {
    let mut picture = EXR.clone();
    let name = b"displayWindow\0box2i\0";
    let window = picture.windows(name.len()).position(|bytes| bytes == name).unwrap();
    let last = window + name.len() + 4 + 8;
    for (width, height) in [(1 << 24, 8), (0x7f10, 1 << 13), (1 << 20, 1 << 8)] {
        let corner = [width - 1, height - 1_i32].map(i32::to_le_bytes);
        picture[last..last + 8].copy_from_slice(corner.as_flattened());
        let error = load(scene("a.exr", &picture).path()).unwrap_err().to_string();
        assert!(error.contains("is far larger than the data window of 16x8"), "{error}");
        check("a.exr", &picture);
    }
}

/// Found by the changes above: memory was taken for what the head says.
fn impossible_sizes() {
    let mut picture = EXR.clone();
    let name = b"dataWindow\0box2i\0";
    let window = picture.windows(name.len()).position(|bytes| bytes == name).unwrap();
    // After the attribute's size: x and y of the first corner, then of the last.
    let last = window + name.len() + 4 + 8;
    for (width, height) in [(1 << 24, 1 << 24), (1 << 30, 8), (16, 1 << 30), (60_000, 1000)] {
        let corner = [width - 1, height - 1_i32].map(i32::to_le_bytes);
        picture[last..last + 8].copy_from_slice(corner.as_flattened());
        let error = load(scene("a.exr", &picture).path()).unwrap_err().to_string();
        assert!(error.contains("a.exr: the EXR image is cut off or damaged: "), "{error}");
    }
    check("a.exr", &picture);
}

/// The changes above start from files that load; otherwise they would test nothing but refusal.
#[test]
fn unmodified_files_load() {
    let named = [("a.png", &PNG[..]), ("a.jpg", JPEG), ("a.exr", &EXR[..]), ("a.hdr", &HDR[..])];
    let others = OTHERS.iter().map(|(name, picture)| (*name, &picture[..]));
    for (name, picture) in named.into_iter().chain(others) {
        let folder = scene(name, picture);
        let loaded = load(folder.path()).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(loaded.warnings_text(), "", "{name}");
    }
}
