//! Textures and records of MTL files as programs write them.

use crate::common::gltf::*;
use bdpm::import::WarningKind;
use bdpm::load::Loaded;
use bdpm::scene::{Material, Wrap};
use glam::{Vec2, Vec3};
use std::io::Cursor;

/// A picture of one red texel.
fn picture() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let picture = image::RgbImage::from_raw(1, 1, vec![255, 0, 0]).unwrap();
    picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// A square of this material, beside the pictures `wood.png` and `wood tile.png`.
fn square_of(mtl: &str) -> Loaded {
    let obj = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n\
               vt 0 1\nf 1/1 2/2 3/3 4/4\n";
    let picture = picture();
    let list = [
        ("wood.png", &picture[..]),
        ("wood tile.png", &picture[..]),
        ("a.mtl", mtl.as_bytes()),
        ("a.obj", obj.as_bytes()),
    ];
    files(&list).load()
}

fn only_material(loaded: &Loaded) -> &Material {
    &loaded.scene.materials()[0]
}

#[test]
fn options_of_textures_scale_move_and_clamp_them() {
    let loaded = square_of("newmtl m\nmap_Kd -s 4 2 1 -o .5 .25 0 -clamp on wood tile.png\n");
    let texture = only_material(&loaded).albedo_texture.as_ref();
    let texture = texture.unwrap_or_else(|| panic!("{}", loaded.warnings_text()));
    assert_eq!(texture.sampling().wrap, [Wrap::Clamp; 2]);
    let mesh = &loaded.scene.meshes()[0];
    for (position, uv) in mesh.positions.iter().zip(&mesh.uvs) {
        let expected = Vec2::new(4.0, 2.0) * position.truncate() + Vec2::new(0.5, 0.25);
        assert_eq!(*uv, expected);
    }
    let skipped = loaded.warnings.iter().find(|own| own.kind == WarningKind::Skipped);
    assert!(skipped.is_none(), "{}", loaded.warnings_text());
}

#[test]
fn options_that_are_ignored_are_reported() {
    let mtl = "newmtl m\nmap_Kd -mm 0.2 2 wood.png\nmap_Ke -s 2 2 wood.png\nbump -bm 1 wood.png\n\
               aniso 0.5\nPs 1\n";
    let loaded = square_of(mtl);
    let text = loaded.warnings_text();
    for part in [
        "ignored some options of textures: `map_Kd -mm of m`",
        "used the texture coordinates of the first texture for all of `m`",
        "ignored some textures (of another use) of `m`",
        "ignored the records `Ps`, `aniso`",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(only_material(&loaded).albedo_texture.is_some());
}

#[test]
fn pictures_are_found_by_names_of_other_systems() {
    for (name, is_reported) in [
        ("wood.png", false),
        ("\"wood tile.png\"", false),
        (".\\wood.png", false),
        ("Wood.PNG", true),
        ("C:\\tex\\wood.png", true),
        ("/home/somebody/Wood Tile.png", true),
    ] {
        let loaded = square_of(&format!("newmtl m\nmap_Kd -bm 1 {name}\n"));
        let text = loaded.warnings_text();
        assert!(only_material(&loaded).albedo_texture.is_some(), "{name}: {text}");
        assert_eq!(text.contains("found textures under other names"), is_reported, "{text}");
    }
    let text = square_of("newmtl m\nmap_Kd tex\\wood.png\n").warnings_text();
    assert!(text.contains("there are no files `tex\\wood.png`"), "{text}");
}

#[test]
fn transmission_filters_tint_glass() {
    use bdpm::scene::bsdf::Bsdf;
    let glass = |filter: &str| {
        let loaded = square_of(&format!("newmtl m\nillum 7\nNi 1.5\n{filter}\n"));
        let Bsdf::Dielectric(glass) = only_material(&loaded).bsdf else { panic!() };
        (glass.transmittance, loaded.warnings_text())
    };
    assert_eq!(glass("Tf 0.5 1 0.25").0, Vec3::new(0.5, 1.0, 0.25));
    assert_eq!(glass("Tf 1 1 1").0, Vec3::ONE);
    let (clear, text) = glass("Tf 0 0 0");
    assert_eq!(clear, Vec3::ONE);
    assert!(text.contains("ignored the transmission filter `Tf` of `m`"), "{text}");
}

/// A PNG file of one gray texel whose code is `value` of 65,535, with this gamma in 1/100,000.
fn png_of(value: u16, gamma: Option<u32>, has_profile: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 1, 1);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Sixteen);
    if let Some(gamma) = gamma {
        encoder.set_source_gamma(png::ScaledFloat::from_scaled(gamma));
    }
    if has_profile {
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    }
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&value.to_be_bytes().repeat(3)).unwrap();
    writer.finish().unwrap();
    bytes
}

#[test]
fn gamma_of_png_files_applies_to_colors_and_not_to_numbers() {
    let obj = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n\
               f 1/1 2/2 3/3\n";
    let mtl = "newmtl m\nmap_Kd a.png\nmap_d a.png\n";
    for (gamma, has_profile, expected) in [
        (None, false, 0.214),
        (Some(45_455), false, 0.214),
        (Some(100_000), false, 0.5),
        (Some(100_000), true, 0.214),
        (Some(50_000), false, 0.25),
    ] {
        let picture = png_of(32_768, gamma, has_profile);
        let list = [("a.png", &picture[..]), ("a.mtl", mtl.as_bytes()), ("a.obj", obj.as_bytes())];
        let loaded = files(&list).load();
        let material = only_material(&loaded);
        let albedo = material.albedo_texture.as_ref().unwrap().color(Vec2::splat(0.5));
        assert!((albedo.x - expected).abs() < 5e-3, "{gamma:?}: {albedo}");
        let opacity = material.opacity_texture.as_ref().unwrap().opacity(Vec2::splat(0.5));
        assert!((opacity - 0.5).abs() < 3e-3, "{gamma:?}: {opacity}");
    }
}

#[test]
fn smoothing_groups_without_normals_are_reported() {
    let faces = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\ns 1\nf 1 2 3\nf 1//1 2//1 3//1\ns off\nf 1 2 3\n\
                 s 0\nf 1 2 3\n";
    let text = files(&[("a.obj", faces.as_bytes())]).load().warnings_text();
    assert!(text.contains("1 faces of smoothing groups (`s`) are flat without normals"), "{text}");
}
