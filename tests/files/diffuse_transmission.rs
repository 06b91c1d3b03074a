//! Sheets that reflect and transmit diffusely, in all formats that have them.

use crate::common::gltf::*;
use bdpm::import::WarningKind;
use bdpm::load::{Loaded, export, load};
use bdpm::scene::bsdf::{Bsdf, DiffuseTransmission, Glossy};
use glam::{Vec2, Vec3};
use serde_json::{Value, json};
use tempfile::TempDir;

fn sheet(reflectance: Vec3, transmittance: Vec3) -> Bsdf {
    Bsdf::DiffuseTransmission(DiffuseTransmission::new(reflectance, transmittance))
}

/// Texts of the warnings about parts that are left out or approximated.
fn skipped(loaded: &Loaded) -> String {
    let skipped = loaded.warnings.iter().filter(|one| one.kind == WarningKind::Skipped);
    skipped.map(|one| &one.text[..]).collect::<Vec<_>>().join("\n")
}

#[track_caller]
fn assert_warned(loaded: &Loaded, warning: &str) {
    let found = skipped(loaded);
    assert_eq!(found.is_empty(), warning.is_empty(), "{found}");
    assert!(found.contains(warning), "{found}");
}

/// A picture of 2 by 1 texels.
fn picture(texels: [[u8; 4]; 2]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
    encoder.set_color(png::ColorType::Rgba);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(texels.as_flattened()).unwrap();
    writer.finish().unwrap();
    bytes
}

/// A square whose material, from line 5 on, has the type and these keys. Its picture is `p.png`.
fn scene_file(keys: &str) -> Files {
    let scene = format!(
        "camera = {{ position = [0, 0, 5], target = [0, 0, 0], fov_x_deg = 40 }}\n\
         environment = {{ radiance = 1 }}\nmesh = [{{ file = 'a.obj', material = 'm' }}]\n\
         [materials.m]\ntype = 'diffuse-transmission'\n{keys}\n"
    );
    let png = picture([[255, 200, 128, 255], [10, 60, 250, 255]]);
    let list: [(&str, &[u8]); 3] =
        [("p.png", &png), ("a.obj", SQUARE_OBJ.as_bytes()), ("a.toml", scene.as_bytes())];
    files(&list)
}

#[test]
fn scene_files_of_sheets_are_read_and_exported_without_loss() {
    for keys in [
        "reflectance = [0.3, 0.2, 0.1]\ntransmittance = 0.7",
        "reflectance_texture = 'p.png'\ntransmittance = 0.9",
        "reflectance = 0.6\nreflectance_texture = 'p.png'\ntransmittance_texture = 'p.png'",
    ] {
        let loaded = scene_file(keys).load();
        let folder = TempDir::new().unwrap();
        let exported = export(&loaded, "a", folder.path(), false).unwrap();
        assert!(exported.warnings.is_empty(), "{:?}", exported.warnings);
        let again = load(folder.path()).unwrap();
        assert_eq!(loaded.scene.materials(), again.scene.materials(), "{keys}");
        assert_eq!(loaded.scene.fingerprint(), again.scene.fingerprint(), "{keys}");
    }
    let loaded = scene_file("reflectance_texture = 'p.png'\ntransmittance = 0.9").load();
    let material = &loaded.scene.materials()[0];
    assert_eq!(material.bsdf, sheet(Vec3::ONE, Vec3::splat(0.9)));
    assert!(material.albedo_texture.is_some() && material.transmittance_texture.is_none());
}

#[test]
fn sheets_that_gain_light_or_have_foreign_keys_are_refused() {
    scene_file("reflectance = 0.5\ntransmittance = [0.4, 0.6, 0.5]")
        .refused(&["a.toml:7: reflectance and transmittance add up to 1.1", "at most 1"]);
    scene_file("reflectance = 0.8")
        .refused(&["a.toml:6: reflectance and transmittance add up to 1.05", "0.25"]);
    scene_file("albedo = 0.5").refused(&["a.toml:6: a material of type `diffuse-transmission`"]);
}

/// A pbrt scene with a ball, lit from all around, after these directives.
fn pbrt(text: &str) -> Loaded {
    let head = "Scale -1 1 1\nLookAt 0 0 5 0 0 0 0 1 0\nCamera \"perspective\"\n\
                Film \"rgb\" \"integer xresolution\" 40 \"integer yresolution\" 20\nWorldBegin\n\
                LightSource \"infinite\" \"rgb L\" [ 1 1 1 ]\n";
    let scene = format!("{head}{text}\nShape \"sphere\"\n");
    files(&[("a.pbrt", scene.as_bytes())]).load()
}

#[test]
fn diffusetransmission_of_pbrt_has_the_shares_of_the_file() {
    for (parameters, expected, warning) in [
        ("", sheet(Vec3::splat(0.25), Vec3::splat(0.25)), ""),
        (
            "\"rgb reflectance\" [0.4 0.2 0] \"rgb transmittance\" [0.2 0.4 1] \"float scale\" 0.5",
            sheet(Vec3::new(0.2, 0.1, 0.0), Vec3::new(0.1, 0.2, 0.5)),
            "",
        ),
        (
            "\"rgb reflectance\" [1 0.5 0] \"rgb transmittance\" [1 0.5 0.5]",
            sheet(Vec3::new(0.5, 0.5, 0.0), Vec3::splat(0.5)),
            "scaled reflectance and transmittance",
        ),
    ] {
        let loaded = pbrt(&format!("Material \"diffusetransmission\" {parameters}"));
        assert_eq!(loaded.scene.materials()[0].bsdf, expected, "{parameters}");
        assert_warned(&loaded, warning);
    }
}

#[test]
fn textures_and_mixtures_of_pbrt_are_kept() {
    let loaded = pbrt(
        "Texture \"a\" \"spectrum\" \"checkerboard\" \"rgb tex1\" [0.8 0.4 0.2] \"rgb tex2\" [0 0 0]\n\
         Material \"diffusetransmission\" \"rgb reflectance\" [0.1 0.1 0.1] \
         \"texture transmittance\" \"a\"",
    );
    let material = &loaded.scene.materials()[0];
    let Bsdf::DiffuseTransmission(own) = material.bsdf else { panic!("{:?}", material.bsdf) };
    let texture = material.transmittance_texture.as_ref().expect("a texture");
    let at = own.transmittance() * texture.color(Vec2::new(0.25, 0.25));
    assert!((at - Vec3::new(0.8, 0.4, 0.2)).abs().max_element() < 5e-3, "{at}");
    assert_eq!((own.reflectance(), &material.albedo_texture), (Vec3::splat(0.1), &None));
    let loaded = pbrt(
        "MakeNamedMaterial \"a\" \"string type\" \"diffuse\" \"rgb reflectance\" [0.8 0 0]\n\
         MakeNamedMaterial \"b\" \"string type\" \"diffusetransmission\" \
         \"rgb reflectance\" [0 0.4 0] \"rgb transmittance\" [0 0 0.4]\n\
         Material \"mix\" \"string materials\" [\"a\" \"b\"] \"float amount\" 0.25",
    );
    let mixed = sheet(Vec3::new(0.6, 0.1, 0.0), Vec3::new(0.0, 0.0, 0.1));
    assert_eq!(loaded.scene.materials()[0].bsdf, mixed);
}

/// A glTF material of this metalness and index of refraction that transmits diffusely.
fn gltf(metalness: f32, ior: f32, extension: &Value, texels: [[u8; 4]; 2]) -> Loaded {
    let mut model = square();
    let uvs = model.uvs(&[[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]);
    model.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(uvs);
    model.json["materials"][0] = json!({
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.8, 0.4, 0.2, 1],
            "metallicFactor": metalness,
            "roughnessFactor": 0.5,
        },
        "doubleSided": true,
        "extensions": {
            "KHR_materials_ior": { "ior": ior },
            "KHR_materials_diffuse_transmission": extension,
        },
    });
    let view = model.view(&picture(texels));
    model.push("images", json!({ "bufferView": view }));
    model.push("textures", json!({ "source": 0 }));
    model.load()
}

const WHITE: [[u8; 4]; 2] = [[255; 4]; 2];
const BASE: Vec3 = Vec3::new(0.8, 0.4, 0.2);

#[test]
fn gltf_divides_the_base_between_reflection_and_transmission() {
    let thin = json!({
        "diffuseTransmissionFactor": 0.25, "diffuseTransmissionColorFactor": [0.4, 0.8, 1]
    });
    let own = sheet(0.75 * BASE, 0.25 * Vec3::new(0.4, 0.8, 1.0));
    let metal = Bsdf::Glossy(Glossy::new(BASE, 0.75, 1.5, 0.25));
    let none = Bsdf::Glossy(Glossy::new(BASE, 0.0, 1.5, 0.25));
    for (metalness, ior, extension, expected, warning) in [
        (0.0, 1.5, &thin, own, "ignored the highlights"),
        (0.0, 1.0, &thin, own, ""),
        (0.25, 1.0, &thin, own, "ignored the metal in"),
        (0.75, 1.5, &thin, metal, "ignored the diffuse transmission"),
        (0.0, 1.5, &json!({}), none, ""),
    ] {
        let loaded = gltf(metalness, ior, extension, WHITE);
        assert_eq!(loaded.scene.materials()[0].bsdf, expected, "{metalness} {ior}");
        assert_warned(&loaded, warning);
    }
}

/// The alpha of one texture divides the base, another texture colors what is transmitted.
#[test]
fn textures_of_gltf_divide_and_color_diffuse_transmission() {
    let texels = [[255, 255, 255, 255], [255, 255, 255, 51]];
    let loaded = gltf(
        0.0,
        1.0,
        &json!({
            "diffuseTransmissionFactor": 0.5, "diffuseTransmissionTexture": { "index": 0 },
            "diffuseTransmissionColorFactor": [0.5, 1, 0]
        }),
        texels,
    );
    assert_warned(&loaded, "");
    let material = &loaded.scene.materials()[0];
    let Bsdf::DiffuseTransmission(own) = material.bsdf else { panic!("{:?}", material.bsdf) };
    let [reflected, transmitted] = [&material.albedo_texture, &material.transmittance_texture]
        .map(|texture| texture.clone().expect("a texture"));
    for (u, share) in [(0.25, 0.5), (0.75, 0.1)] {
        let at = Vec2::new(u, 0.5);
        let found =
            [own.reflectance() * reflected.color(at), own.transmittance() * transmitted.color(at)];
        let expected = [(1.0 - share) * BASE, share * Vec3::new(0.5, 1.0, 0.0)];
        for (found, expected) in found.into_iter().zip(expected) {
            let off = (found - expected).abs().max_element();
            assert!(off < 5e-3, "{u}: {found}, not {expected}");
        }
    }
    let colored = json!({
        "diffuseTransmissionFactor": 0.5, "diffuseTransmissionColorTexture": { "index": 0 }
    });
    let loaded = gltf(0.0, 1.0, &colored, texels);
    let material = &loaded.scene.materials()[0];
    let texture = material.transmittance_texture.as_ref().expect("a texture");
    assert_eq!(texture.color(Vec2::new(0.25, 0.5)), Vec3::ONE);
    assert_eq!(material.albedo_texture, None);
}
