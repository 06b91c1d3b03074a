//! Textures and cut-outs: what is read is seen, and holes let all light through.

use crate::common::*;
use bdpm::accel::{Coherence, Ray, RayPacket};
use bdpm::base::rng::{Stream, StreamKey};
use bdpm::load::load;
use bdpm::noise::Measure;
use bdpm::scene::backend::{Backend, build};
use bdpm::scene::bsdf::{Bsdf, Glossy};
use bdpm::scene::{Camera, FieldOfView, Material, Mesh, Sampling, Scene, Texture, Wrap};
use bdpm::settings::{Direct, Kernel};
use bdpm::simd::LANES;
use bdpm::{Renderer, Settings};
use glam::{Vec2, Vec3};
use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;

/// A square of corners `(-1, -1)` to `(1, 1)` at height `z` that holds a texture once.
fn textured_square(z: f32, material: u32) -> Mesh {
    let mesh = square(Vec3::new(0.0, 0.0, z), Vec3::Z, 1.0, material);
    let uvs = mesh.positions.iter().map(|p| 0.5 * (p.truncate() + Vec2::ONE)).collect();
    Mesh { uvs, ..mesh }
}

/// A camera straight above that sees the square from -1 to 1 at z = 0 and no more, +y at the top.
fn camera_above() -> Camera {
    let fov = FieldOfView::X(2.0 * (1.0_f32 / 10.0).atan().to_degrees());
    Camera::look(Vec3::new(0.0, 0.0, 10.0), -Vec3::Z, Vec3::Y, fov).unwrap()
}

fn image(scene: &Arc<Scene>, backend: Backend, settings: Settings, iterations: usize) -> Vec<Vec3> {
    let accel = build(backend, scene).unwrap();
    let mut renderer = Renderer::new(scene, &accel, settings).unwrap();
    for _ in 0..iterations {
        renderer.iterate(Measure::Off);
    }
    renderer.film().mean()
}

#[test]
fn each_quarter_has_its_color() {
    // Red, green above blue, white; nearly constant light from far above.
    let colors = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 255]];
    let texels = (0..32 * 32).map(|i| colors[i / 512 * 2 + i % 32 / 16]).collect();
    let mut painted = gray(0.5, 0.0);
    painted.albedo_texture = Some(Arc::new(Texture::new(32, 32, texels)));
    let light = point_light(Vec3::new(0.0, 0.0, 40.0), 1600.0);
    let scene = scene(vec![textured_square(0.0, 0)], vec![painted], vec![light], camera_above());
    let settings = Settings { camera_paths: 16, ..settings(6, 6) };
    let image = image(&scene, Backend::default(), settings, 4);
    let value = 0.5 / PI as f32;
    for (pixel, color) in [(7, Vec3::X), (10, Vec3::Y), (25, Vec3::Z), (28, Vec3::ONE)] {
        assert!((image[pixel] - value * color).length() < 2e-3, "{pixel}: {}", image[pixel]);
    }
}

/// A floor, lit by a lamp above a sheet whose left half is cut out.
fn shaded_floor(sheet: bool, light: bool) -> Arc<Scene> {
    let texels = (0..16).map(|i| if i % 4 < 2 { [0, 0, 0, 255] } else { [255; 4] }).collect();
    let mut cut = gray(0.0, 0.0);
    cut.opacity_texture = Some(Arc::new(Texture::new(4, 4, texels)));
    let mut meshes = vec![square(Vec3::ZERO, Vec3::Z, 5.0, 0)];
    if sheet {
        // Two of them, close together: one hole behind the other.
        meshes.extend([textured_square(0.5, 1), textured_square(0.500_01, 1)]);
    }
    let mut lights = vec![];
    if light {
        lights.push(point_light(Vec3::new(0.0, 0.0, 3.0), 30.0));
    } else {
        meshes.push(square(Vec3::new(0.0, 0.0, 3.0), -Vec3::Z, 0.05, 2));
    }
    let materials = vec![gray(0.5, 0.0), cut, gray(0.0, 1000.0)];
    // Sees the floor under the sheet, +x to the right.
    let (from, to) = (Vec3::new(0.0, -6.0, 0.4), Vec3::new(0.0, -0.3, 0.0));
    let low = Camera::look(from, to - from, Vec3::Z, FieldOfView::X(12.0)).unwrap();
    scene(meshes, materials, lights, low)
}

#[test]
fn light_and_sight_pass_through_holes() {
    for backend in Backend::ALL.into_iter().filter(|b| build(*b, &shaded_floor(true, true)).is_ok())
    {
        for light in [true, false] {
            for direct in [Direct::Connect, Direct::PhotonMap] {
                let settings = Settings {
                    direct,
                    merge_vertex: 2,
                    light_paths: 100_000,
                    camera_paths: 32,
                    radius: 0.1,
                    caustic_radius: 0.1,
                    ..settings(16, 1)
                };
                let render =
                    |sheet| image(&shaded_floor(sheet, light), backend, settings.clone(), 4);
                let (with, without) = (render(true), render(false));

                for x in 0..16 {
                    let (with, without) = (with[x].x, without[x].x);
                    let through = with / without;
                    let what = format!("{backend} {direct:?} {light} {x}: {with} of {without}");
                    match x {
                        0..6 => assert!((through - 1.0).abs() < 0.08, "{what}"),
                        10.. => assert!(through < 0.02, "{what}"),
                        _ => {}
                    }
                }
            }
        }
    }
}

/// A black sheet of this opacity between a floor and its light, or a gray one alone that a camera
/// sees.
fn translucent(opacity: f32, alone: bool) -> Arc<Scene> {
    let sheet = Material { opacity: Some(opacity), ..gray(if alone { 0.5 } else { 0.0 }, 0.0) };
    let floor = square(Vec3::ZERO, Vec3::Z, 5.0, 0);
    let meshes =
        if alone { vec![textured_square(0.5, 1)] } else { vec![floor, textured_square(0.5, 1)] };
    let (from, to) = match alone {
        true => (Vec3::new(0.0, 0.0, 2.0), Vec3::ZERO),
        false => (Vec3::new(0.0, -6.0, 0.4), Vec3::new(0.0, -0.3, 0.0)),
    };
    let up = if alone { Vec3::Y } else { Vec3::Z };
    let angle = if alone { 45.0 } else { 12.0 };
    let camera = Camera::look(from, to - from, up, FieldOfView::X(angle)).unwrap();
    let light = point_light(Vec3::new(0.0, 0.0, 3.0), 30.0);
    scene(meshes, vec![gray(0.5, 0.0), sheet], vec![light], camera)
}

#[test]
fn a_share_of_light_and_sight_passes_where_opacity_is_a_share() {
    for backend in Backend::ALL.into_iter().filter(|b| build(*b, &translucent(0.5, true)).is_ok()) {
        for (alone, direct) in [
            (true, Direct::Connect),
            (true, Direct::PhotonMap),
            (false, Direct::Connect),
            (false, Direct::PhotonMap),
        ] {
            let settings = Settings {
                direct,
                // By discs, photons would count by the share that met the surface once more.
                kernel: Kernel::Area,
                merge_vertex: 2,
                light_paths: 400_000,
                camera_paths: 64,
                radius: 0.1,
                caustic_radius: 0.1,
                ..if alone { settings(4, 4) } else { settings(16, 1) }
            };
            let mean = |opacity| {
                let image = image(&translucent(opacity, alone), backend, settings.clone(), 8);
                image.iter().map(|value| value.x).sum::<f32>() / image.len() as f32
            };
            // From 8192 camera paths a share of 0.3 has a relative error of 1.7 %; some ten
            // thousand photons add less.
            let opacity = 0.3;
            let seen = match alone {
                true => mean(opacity) / mean(1.0) / opacity,
                false => mean(opacity) / mean(0.0) / (1.0 - opacity),
            };
            assert!((seen - 1.0).abs() < 0.06, "{backend} {direct:?} {alone}: {seen}");
        }
    }
}

/// More rays than are traced together, and a last packet that is not full.
#[test]
fn packets_of_shadow_rays_pass_a_mask_as_single_rays_do() {
    let scene = translucent(0.5, false);
    let accel = accel(&scene);
    let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
    let light = Vec3::new(0.0, 0.0, 3.0);
    let rays: Vec<Ray> = (0..16 * LANES * 2 + 5)
        .map(|_| {
            let [x, y] = rng.next_2d().map(|u| 6.0 * u - 3.0);
            Ray::segment(light, Vec3::new(x, y, 0.01))
        })
        .collect();
    let packets: Vec<RayPacket> = rays.chunks(LANES).map(RayPacket::of).collect();
    let mut answers = vec![[false; LANES]; packets.len()];
    accel.occlude(&packets, rays.len(), &mut answers, Coherence::Incoherent);
    let occluded: Vec<bool> = answers.concat()[..rays.len()].to_vec();
    let alone: Vec<bool> = rays.iter().map(|ray| accel.is_occluded(ray)).collect();
    assert_eq!(occluded, alone);
    // Some rays pass beside the sheet, half of the others through it.
    let count = alone.iter().filter(|occluded| **occluded).count();
    assert!((20..rays.len() / 2).contains(&count), "{count} of {}", rays.len());
}

#[test]
fn lights_are_cut_like_other_surfaces() {
    for (code, expected) in [(0, 0.0), (255, 3.0)] {
        let mut lamp = gray(0.5, 3.0);
        lamp.opacity_texture = Some(Arc::new(Texture::new(1, 1, vec![[code, code, code, 255]])));
        let scene = scene(vec![textured_square(0.0, 0)], vec![lamp], vec![], camera_above());
        let image = image(&scene, Backend::default(), settings(4, 4), 1);
        assert!(image.iter().all(|value| value.x == expected), "{image:?}");
    }
}

const MODEL: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0.25 0.75\n\
                     vn 0 0 1\nvn 0 0.6 0.8\nvn 0 0 0\nmtllib a.mtl\nusemtl m\n";

fn model(faces: &str, mtl: &str, picture: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let write =
        |name: &str, content: &[u8]| std::fs::write(folder.path().join(name), content).unwrap();
    write("a.mtl", format!("newmtl m\nKe 0\n{mtl}\nnewmtl lamp\nKe 1\n").as_bytes());
    write("a.obj", format!("{MODEL}{faces}\nusemtl lamp\nf 2 3 4\n").as_bytes());
    write("p.png", picture);
    let path = folder.path().join("a.obj");
    (folder, path)
}

fn png_of(colors: png::ColorType, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
    encoder.set_color(colors);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(data).unwrap();
    bytes
}

#[test]
fn texture_coordinates_and_normals_of_models_are_kept() {
    let (_folder, path) = model("f 1/1/1 2/2/2 3/3/3\nf 1 2 4", "", b"");
    let scene = load(&path).unwrap_or_else(|e| panic!("{e}")).scene;
    let [full, bare, _lamp] = scene.meshes() else { panic!("{:?}", scene.meshes()) };
    assert_eq!(full.uvs, [Vec2::ZERO, Vec2::X, Vec2::new(0.25, 0.75)]);
    assert_eq!(full.normals, [Vec3::Z, Vec3::new(0.0, 0.6, 0.8), Vec3::ZERO]);
    assert!(bare.uvs.is_empty() && bare.normals.is_empty());
}

#[test]
fn pictures_of_all_kinds_are_read() {
    for (kind, data) in [
        (png::ColorType::Grayscale, &[0, 255][..]),
        (png::ColorType::GrayscaleAlpha, &[0, 255, 255, 255]),
        (png::ColorType::Rgb, &[0, 0, 0, 255, 255, 255]),
        (png::ColorType::Rgba, &[0, 0, 0, 255, 255, 255, 255, 255]),
    ] {
        let (_folder, path) =
            model("f 1/1 2/2 3/3", "map_Kd p.png\nmap_d p.png", &png_of(kind, data));
        let loaded = load(&path).unwrap_or_else(|e| panic!("{e}"));
        let Material { albedo_texture, opacity_texture, bsdf, .. } = &loaded.scene.materials()[0];
        let texture = albedo_texture.as_ref().unwrap();
        assert_eq!(texture.size(), [2, 1]);
        assert_eq!(texture.color(Vec2::new(0.25, 0.5)), Vec3::ZERO, "{kind:?}");
        assert_eq!(texture.color(Vec2::new(0.75, 0.5)), Vec3::ONE, "{kind:?}");
        assert_eq!(bsdf.albedo(), Vec3::ONE, "without Kd the picture tells all");
        assert!(opacity_texture.is_some());
        assert!(
            loaded.warnings.iter().all(|note| !note.text.contains("texture")),
            "{:?}",
            loaded.warnings
        );
    }
}

#[test]
fn broken_and_missing_pictures_are_reported() {
    let told = |mtl: &str, picture: &[u8], parts: &[&str]| {
        let (_folder, path) = model("f 1/1 2/2 3/3", mtl, picture);
        let loaded = load(&path).unwrap_or_else(|e| panic!("{e}"));
        let notes = loaded.warnings_text();
        for part in
            parts.iter().chain(&["ignored textures that cannot be read: p.png: the texture"])
        {
            assert!(notes.contains(part), "no {part:?} in {notes}");
        }
        let Material { albedo_texture, opacity_texture, .. } = &loaded.scene.materials()[0];
        assert!(albedo_texture.is_none() && opacity_texture.is_none());
    };
    let good = png_of(png::ColorType::Rgb, &[0; 6]);
    for length in 8..good.len() - 12 {
        told("map_Kd p.png", &good[..length], &["cannot be read"]);
    }
    told("map_Kd p.png", b"GIF89a", &["not a PNG, JPEG, WebP"]);
    told("map_d p.png", b"\xff\xd8\xff\xe0 no jpeg", &["cannot be read"]);
    let huge = {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 100_000, 1);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.write_header().unwrap().write_image_data(&vec![0; 100_000]).unwrap();
        bytes
    };
    told("map_Kd p.png", &huge, &["cannot be read"]);
    for mtl in ["map_Kd none.png", "map_Ks p.png", "norm none.png"] {
        let (_folder, path) = model("f 1/1 2/2 3/3", mtl, &good);
        let notes = load(&path).unwrap_or_else(|e| panic!("{e}")).warnings_text();
        assert!(notes.contains("ignored some textures"), "{notes}");
    }
    let (_folder, path) = model("f 1 2 3", "map_Kd p.png", &good);
    let notes = load(&path).unwrap_or_else(|e| panic!("{e}")).warnings_text();
    assert!(notes.contains("without texture coordinates"), "{notes}");
}

#[test]
fn decoded_jpeg_matches_its_source() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/quarters.jpg");
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(path, folder.path().join("q.jpg")).unwrap();
    std::fs::write(folder.path().join("a.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let scene = "camera = { position = [0, 0, 5], direction = [0, 0, -1], fov_x_deg = 40 }\n\
                 light = [{ type = 'point', position = [0, 0, 5], intensity = 1 }]\n\
                 mesh = [{ file = 'a.obj', material = 'm' }]\n\
                 materials.m = { albedo_texture = 'q.jpg' }\n";
    std::fs::write(folder.path().join("scene.toml"), scene).unwrap();
    let loaded = load(folder.path()).unwrap_or_else(|e| panic!("{e}"));
    let texture = loaded.scene.materials()[0].albedo_texture.as_ref().unwrap();
    for (u, v, color) in [
        (0.25, 0.75, Vec3::X),
        (0.75, 0.75, Vec3::Y),
        (0.25, 0.25, Vec3::Z),
        (0.75, 0.25, Vec3::ONE),
    ] {
        let off = (texture.color(Vec2::new(u, v)) - color).abs().max_element();
        assert!(off < 0.03, "{u} {v}: {}", texture.color(Vec2::new(u, v)));
    }
    let missing = scene.replace("q.jpg", "none.jpg");
    std::fs::write(folder.path().join("scene.toml"), missing).unwrap();
    let error = load(folder.path()).unwrap_err().to_string();
    assert!(error.contains("scene.toml:4: there is no texture `none.jpg`"), "{error}");
}

#[test]
fn every_texture_of_a_scene_file_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, content: &[u8]| {
        std::fs::write(folder.path().join(name), content).unwrap();
    };
    write("p.png", &png_of(png::ColorType::Rgb, &[0, 51, 255, 255, 128, 0]));
    write("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n");
    let load = |material: &str| {
        let scene = format!(
            "camera = {{ position = [0, 0, 5], direction = [0, 0, -1], fov_x_deg = 40 }}\n\
             light = [{{ type = 'point', position = [0, 0, 5], intensity = 1 }}]\n\
             mesh = [{{ file = 'a.obj', material = 'm' }}]\n[materials.m]\n{material}\n"
        );
        write("scene.toml", scene.as_bytes());
        let loaded = load(folder.path()).unwrap_or_else(|e| panic!("{e}"));
        assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
        loaded.scene.materials()[0].clone()
    };
    let glossy = load(
        "type = 'glossy'\nmetallic_roughness_texture = 'p.png'\nnormal_texture = 'p.png'\n\
         normal_scale = 0.5\ntexture_wrap = 'mirror'\ntexture_filter = 'nearest'",
    );
    let expected = Glossy::new(Vec3::splat(0.5), 1.0, 1.5, 1.0);
    assert_eq!(glossy.bsdf, Bsdf::Glossy(expected), "the picture tells all");
    let sampling = Sampling { wrap: [Wrap::Mirror; 2], nearest: true };
    let data = glossy.metallic_roughness_texture.unwrap();
    assert_eq!(data.sampling(), sampling);
    assert!((data.data(Vec2::new(0.1, 0.5)) - Vec3::new(0.0, 0.2, 1.0)).length() < 1e-6);
    let normals = glossy.normal_map.unwrap();
    assert_eq!((normals.scale, normals.texture.sampling()), (0.5, sampling));

    // Each may have its own way; they share the file.
    let both = load(
        "type = 'glossy'\ntexture_wrap = 'clamp'\nalbedo_texture = 'p.png'\n\
         normal_texture = { file = 'p.png', wrap = ['repeat', 'mirror'], filter = 'nearest' }",
    );
    let own = both.normal_map.unwrap().texture.sampling();
    assert_eq!(own, Sampling { wrap: [Wrap::Repeat, Wrap::Mirror], nearest: true });
    let others = Sampling { wrap: [Wrap::Clamp; 2], nearest: false };
    assert_eq!(both.albedo_texture.unwrap().sampling(), others);

    let lamp = load("emission_texture = 'p.png'");
    assert_eq!((lamp.emission, lamp.emission_at(Vec2::new(0.25, 0.5)).z), (Vec3::ONE, 1.0));
    let lamp = load("emission_texture = 'p.png'\nemission = [4, 0, 2]\ntexture_wrap = 'clamp'");
    assert_eq!(lamp.emission_at(Vec2::new(9.0, 0.5)), Vec3::new(4.0, 0.0, 0.0));
    assert_eq!(lamp.emission_texture.unwrap().sampling().wrap, [Wrap::Clamp; 2]);
}

#[test]
fn lights_and_normals_of_mtl_files_are_read() {
    let picture = png_of(png::ColorType::Rgb, &[255; 6]);
    let (_folder, path) = model("f 1/1 2/2 3/3", "map_Ke p.png\nnorm p.png", &picture);
    let loaded = load(&path).unwrap_or_else(|e| panic!("{e}"));
    let material = &loaded.scene.materials()[0];
    assert!(material.emission_texture.is_some() && material.normal_map.is_some());
    assert_eq!(material.emission, Vec3::ZERO, "as the file says");
}
