//! Surfaces that emit and that rays partly pass: their holes are dark for the camera, in
//! connections, in light paths and for meters. Emission of both sides.

use crate::common::gltf::{Files, diffuse, files, square};
use crate::common::{accel, mean_luminance, settings};
use bdpm::accel::Ray;
use bdpm::load::{Loaded, export, load};
use bdpm::scene::{Emitter, Material, Receiver, Scene};
use bdpm::settings::{Direct, Settings, Strategy};
use glam::Vec3;
use serde_json::{Value, json};
use std::sync::Arc;

/// A lamp of 2 by 2 that looks down at a gray floor. The camera sees only the floor, from below the
/// lamp.
const ROOM: &str = "
[camera]
position = [0, -3, -0.4]
target = [0, 0, -1]
fov_x_deg = 30
[[mesh]]
file = 'floor.obj'
material = 'floor'
[[mesh]]
file = 'lamp.obj'
material = 'lamp'
[materials.floor]
albedo = 0.5
[materials.lamp]
albedo = 0
";
const FLOOR: &str = "v -9 -9 -1\nv 9 -9 -1\nv 9 9 -1\nv -9 9 -1\nf 1 2 3 4\n";
const LAMP: &str = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
                    f 4/4 3/3 2/2 1/1\n";
/// The half of the lamp with x > 0.
const HALF: &str = "v 0 -1 0\nv 1 -1 0\nv 1 1 0\nv 0 1 0\nf 4 3 2 1\n";

/// A picture of two texels, the left one clear.
fn half() -> Vec<u8> {
    gray_alpha(&[0, 255])
}

fn gray_alpha(alphas: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, alphas.len() as u32, 1);
    encoder.set_color(png::ColorType::Rgba);
    let texels: Vec<u8> = alphas.iter().flat_map(|alpha| [255, 255, 255, *alpha]).collect();
    encoder.write_header().unwrap().write_image_data(&texels).unwrap();
    bytes
}

fn room(lamp: &str, keys: &str) -> Arc<Scene> {
    let (picture, scene) = (half(), format!("{ROOM}{keys}"));
    let list = [
        ("floor.obj", FLOOR.as_bytes()),
        ("lamp.obj", lamp.as_bytes()),
        ("half.png", &picture),
        ("a.toml", scene.as_bytes()),
    ];
    files(&list).load().scene
}

/// Settings that find the light by connections and hits, by light paths, and by both.
fn techniques() -> [(&'static str, Settings); 3] {
    let of = |settings: Settings| Settings { light_paths: 4000, camera_paths: 16, ..settings };
    let plain = || Settings { radius: 0.15, caustic_radius: 0.15, ..settings(12, 8) };
    [
        ("path", of(Settings { strategy: Strategy::Path, ..plain() })),
        ("photons", of(Settings { direct: Direct::PhotonMap, ..plain() })),
        (
            "mis",
            of(crate::common::by_way(Settings { merge_vertex: crate::common::MIS, ..plain() })),
        ),
    ]
}

/// Luminance of the image, by path tracing of this scene.
fn reference(scene: &Arc<Scene>) -> f64 {
    let [(_, settings), ..] = techniques();
    mean_luminance(scene, &accel(scene), settings, 200).mean
}

/// Holes by a picture: the lamp is the half that is left. A share of the rays everywhere: the lamp
/// is opaque and as much darker, because nothing else is behind it.
#[test]
fn every_technique_sees_the_same_light_of_a_masked_lamp() {
    let mask = "opacity_texture = { file = 'half.png', filter = 'nearest' }\nemission = 2\n";
    for (name, masked, plain) in [
        ("mask", room(LAMP, mask), room(HALF, "emission = 2\n")),
        ("share", room(LAMP, "opacity = 0.25\nemission = 8\n"), room(LAMP, "emission = 2\n")),
    ] {
        let expected = reference(&plain);
        for (technique, settings) in techniques() {
            let mean = mean_luminance(&masked, &accel(&masked), settings, 100);
            println!("{name} by {technique}: {mean:?}, {expected}");
            // The radius blurs the light at the edges of the lamp's shadow.
            mean.assert_is(expected, 0.02);
        }
    }
}

/// Mean irradiance, by connections, of a point before the lamp that faces it.
fn irradiance(scene: &Scene, from: Vec3) -> f64 {
    use bdpm::base::rng::{Stream, StreamKey};
    let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
    let (n, normal) = (40_000, -from.normalize());
    let at = Receiver { position: from, normal: Some(normal) };
    let one = |_| {
        let sample = scene.lights().connect(at, &mut rng);
        sample.map_or(0.0, |sample| f64::from(sample.irradiance.x * sample.wi.dot(normal).max(0.0)))
    };
    (0..n).map(one).sum::<f64>() / f64::from(n)
}

/// A square with this material, and a picture of white texels of these alphas.
fn lamp(material: Value, alphas: &[u8]) -> Loaded {
    let mut model = square();
    let uvs = model.uvs(&[[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]);
    model.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(uvs);
    model.json["materials"][0] = material;
    let view = model.view(&gray_alpha(alphas));
    model.push("images", json!({ "bufferView": view }));
    model.json["samplers"] = json!([{ "magFilter": 9728 }]);
    model.push("textures", json!({ "source": 0, "sampler": 0 }));
    model.load()
}

fn emissive(mode: &str, is_double_sided: bool) -> Value {
    json!({
        "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "metallicFactor": 0 },
        "emissiveFactor": [1, 1, 1], "alphaMode": mode, "doubleSided": is_double_sided,
        "extensions": diffuse(),
    })
}

/// Share of the rays straight at the square, spread over it, that meet it.
fn met(scene: &Arc<Scene>) -> f64 {
    let accel = accel(scene);
    let n = 64;
    let place = |i: u32| 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
    let rays = (0..n * n).map(|i| Vec3::new(place(i % n), place(i / n), 3.0));
    let hits = rays.filter(|from| {
        let (t_near, t_far) = (0.0, f32::INFINITY);
        let ray = Ray { origin: *from, t_near, direction: -Vec3::Z, t_far };
        !accel.closest_hit(&ray).is_miss()
    });
    hits.count() as f64 / f64::from(n * n)
}

#[test]
fn gltf_lamps_are_dark_where_their_alpha_is_low() {
    let front = Vec3::new(0.0, 0.0, 2.0);
    let full = lamp(emissive("OPAQUE", false), &[255, 255]);
    let whole = irradiance(&full.scene, front);
    for (mode, alphas, share) in [
        ("OPAQUE", [0, 255], 1.0),
        ("MASK", [0, 255], 0.5),
        ("BLEND", [0, 255], 0.5),
        ("BLEND", [51, 51], 0.2),
        ("MASK", [100, 200], 0.5),
    ] {
        let loaded = lamp(emissive(mode, false), &alphas);
        let [seen, relative] = [met(&loaded.scene), irradiance(&loaded.scene, front) / whole];
        assert!((seen - share).abs() < 0.03, "{mode} {alphas:?}: {seen} of the rays");
        assert!((relative - share).abs() < 0.02, "{mode} {alphas:?}: {relative} of the light");
        assert!(!loaded.warnings_text().contains("opacity"), "{}", loaded.warnings_text());
    }
}

#[test]
fn gltf_lamps_of_two_sides_shine_on_both() {
    for (mode, alphas, share) in [("OPAQUE", [255, 255], 1.0), ("BLEND", [51, 51], 0.2)] {
        let one = lamp(emissive(mode, false), &alphas);
        let both = lamp(emissive(mode, true), &alphas);
        assert!(!both.warnings_text().contains("front"), "{}", both.warnings_text());
        let [front, back] = [1.0, -1.0].map(|z| Vec3::new(0.0, 0.0, 2.0 * z));
        let whole = irradiance(&one.scene, front) / share;
        assert_eq!(irradiance(&one.scene, back), 0.0);
        for from in [front, back] {
            let relative = irradiance(&both.scene, from) / whole;
            assert!((relative - share).abs() < 0.02, "{mode}: {relative}");
        }
        let [one, both] = [one, both].map(|loaded| loaded.scene.lights().power().x);
        assert!((both / one - 2.0).abs() < 1e-5, "{one} {both}");
    }
}

/// Both sides, seen by the camera, by connections and by light paths.
#[test]
fn every_technique_sees_both_sides_of_a_lamp() {
    let upside_down = LAMP.replace("f 4/4 3/3 2/2 1/1", "f 1/1 2/2 3/3 4/4");
    let expected = reference(&room(LAMP, "emission = 2\n"));
    let turned = room(&upside_down, "emission = 2\ntwo_sided_emission = true\n");
    for (technique, settings) in techniques() {
        let mean = mean_luminance(&turned, &accel(&turned), settings, 100);
        println!("{technique}: {mean:?}, {expected}");
        mean.assert_is(expected, 0.02);
    }
    let facing_up = room(&upside_down, "emission = 2\n");
    assert_eq!(irradiance(&facing_up, Vec3::new(0.0, 0.0, -1.0)), 0.0);
}

/// The light and the opacity of the lamp in files of other formats, whose left half is clear.
#[test]
fn masked_lamps_of_other_formats_are_dark_in_their_holes() {
    let picture = half();
    // The same holes, black on white.
    let mut gray = Vec::new();
    let mut encoder = png::Encoder::new(&mut gray, 2, 1);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().unwrap().write_image_data(&[0, 255]).unwrap();
    let pictures = [("half.png", &picture[..]), ("gray.png", &gray[..])];
    let load = |list: &[(&str, &[u8])]| files(&[&pictures[..], list].concat()).load();
    let front = Vec3::new(0.0, 0.0, 2.0);
    let whole = irradiance(&lamp(emissive("OPAQUE", false), &[255, 255]).scene, front);
    let lamp = LAMP.replace("f 4/4 3/3 2/2 1/1", "usemtl m\nf 1/1 2/2 3/3 4/4");
    let obj = format!("mtllib a.mtl\n{lamp}");
    let mtl = load(&[
        ("a.mtl", b"newmtl m\nKd 0 0 0\nKe 1 1 1\nmap_d half.png\n"),
        ("a.obj", obj.as_bytes()),
    ]);
    let mitsuba = load(&[(
        "a.xml",
        b"<scene version='3.0.0'><shape type='rectangle'>
          <emitter type='area'><rgb name='radiance' value='1'/></emitter>
          <bsdf type='mask'><texture type='bitmap' name='opacity'>
          <string name='filename' value='gray.png'/><boolean name='raw' value='true'/>
          <string name='filter_type' value='nearest'/></texture>
          <bsdf type='diffuse'/></bsdf></shape></scene>",
    )]);
    let pbrt = load(&[(
        "a.pbrt",
        b"WorldBegin\nTexture \"holes\" \"float\" \"checkerboard\" \"float tex1\" 1 \"float tex2\" 0 \
          \"float uscale\" 2 \"float vscale\" 2\n\
          AreaLightSource \"diffuse\" \"rgb L\" [1 1 1]\n\
          Shape \"trianglemesh\" \"texture alpha\" \"holes\" \"point3 P\" [-1 -1 0 1 -1 0 1 1 0 -1 1 0] \
          \"point2 uv\" [0 0 1 0 1 1 0 1] \"integer indices\" [0 1 2 0 2 3]\n",
    )]);
    for (name, loaded) in [("mtl", &mtl), ("mitsuba", &mitsuba), ("pbrt", &pbrt)] {
        let [seen, relative] = [met(&loaded.scene), irradiance(&loaded.scene, front) / whole];
        assert!((seen - 0.5).abs() < 0.03, "{name}: {seen} of the rays");
        assert!((relative - 0.5).abs() < 0.02, "{name}: {relative} of the light");
    }
    let text = mitsuba.warnings_text();
    assert!(text.contains("multiplied the emission, which is whole in Mitsuba"), "{text}");
}

/// A constant alpha of 0 makes lamps of pbrt invisible. They still shine.
#[test]
fn invisible_lamps_of_pbrt_shine() {
    let shape = "Shape \"trianglemesh\" \"float alpha\" 0 \"point3 P\" \
                 [-1 -1 0 1 -1 0 1 1 0 -1 1 0] \"integer indices\" [0 1 2 0 2 3]\n";
    let text = format!("WorldBegin\nAreaLightSource \"diffuse\" \"rgb L\" [1 1 1]\n{shape}");
    let loaded = files(&[("a.pbrt", text.as_bytes())]).load();
    let is_hidden = |material: &Material| material.hidden_from_camera;
    assert!(loaded.scene.materials().iter().any(is_hidden));
    assert!(loaded.warnings_text().contains("hid from the camera"), "{}", loaded.warnings_text());
    assert!(
        loaded.scene.lights().emitters().iter().all(|own| matches!(own, Emitter::Triangle { .. }))
    );
    assert!(irradiance(&loaded.scene, Vec3::new(0.0, 0.0, 2.0)) > 0.1);
}

/// A folder of a scene file, written again as the copy of itself.
#[test]
fn copies_keep_both_sides_and_the_share_of_lamps() {
    let list: &[(&str, &[u8])] = &[
        ("floor.obj", FLOOR.as_bytes()),
        ("lamp.obj", LAMP.as_bytes()),
        ("half.png", &half()),
        (
            "a.toml",
            &[ROOM, "opacity = 0.25\nemission = 8\ntwo_sided_emission = true\n"]
                .concat()
                .into_bytes(),
        ),
    ];
    let Files(folder, path) = files(list);
    let loaded = load(&path).unwrap();
    let copy = folder.path().join("copy");
    export(&loaded, "a lamp", &copy, false).unwrap();
    let again = load(&copy).unwrap();
    assert_eq!(loaded.scene.fingerprint(), again.scene.fingerprint());
}
