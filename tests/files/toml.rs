//! The shipped scenes, the documented example and the OBJ features are what they are said to be.

use bdpm::load::load;
use bdpm::scene::bsdf::{
    Bsdf, Coated, Conductor, Dielectric, DiffuseTransmission, FacetModel, Facets, Glossy, Plastic,
    Principled, PrincipledParameters, Reflectance, RoughDielectric, ThinDielectric,
};
use bdpm::scene::{Emitter, RefractiveIndex, Scene};
use bdpm::settings::{PartialSettings, Settings};
use glam::Vec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::TempDir;

fn root(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn write(files: &[(&str, &str)]) -> TempDir {
    let folder = TempDir::new().unwrap();
    for (name, content) in files {
        std::fs::write(folder.path().join(name), content).unwrap();
    }
    folder
}

/// The scene of an OBJ file with this content.
fn obj(content: &str) -> Arc<Scene> {
    let folder = write(&[("a.obj", content)]);
    load(folder.path().join("a.obj")).unwrap_or_else(|e| panic!("{e}")).scene
}

#[test]
fn documented_example_loads() {
    let text = std::fs::read_to_string(root("docs/reference/scene-format.md")).unwrap();
    let example = text.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    let square = "v -1 0 -1\nv -1 0 1\nv 1 0 1\nv 1 0 -1\n";
    let folder = write(&[
        ("scene.toml", example),
        ("floor.obj", &format!("{square}f 1 2 3 4\n")),
        ("block.obj", &format!("{square}usemtl lamp\nf -4 -3 -2 -1\n")),
    ]);
    let loaded = load(folder.path()).unwrap_or_else(|e| panic!("{e}"));
    let scene = &loaded.scene;
    assert_eq!(loaded.warnings_text(), "");
    assert_eq!((scene.triangle_count(), scene.lights().emitters().len()), (4, 3));
    let names: Vec<_> = scene.materials().iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names, ["chalk", "lamp"]);
    assert_eq!(scene.regions[0].name, "lower-half");
    // Corner (-1, 0, -1), halved, turned by 30 degrees about y, moved.
    let (sin, cos) = 30_f32.to_radians().sin_cos();
    let corner = Vec3::new(-0.5 * cos - 0.5 * sin + 0.5, 0.0, 0.5 * sin - 0.5 * cos - 0.5);
    assert!((scene.meshes()[1].positions[0] - corner).length() < 1e-6);
    let settings =
        Settings::resolve(&PartialSettings::default(), &loaded.defaults, scene.size()).unwrap();
    assert_eq!((settings.width, settings.height, settings.light_paths), (640, 480, 50_000));
    // The floor's left side is the scene's, and the turned block's right corner.
    let size = 1.0 + 0.5 + 0.5 * (cos + sin);
    assert!((settings.radius - 0.008 * size).abs() < 1e-6, "{}", settings.radius);
}

#[test]
fn documented_defaults_equal_the_built_in_ones() {
    let text = std::fs::read_to_string(root("docs/reference/scene-format.md")).unwrap();
    let none = PartialSettings::default();
    let settings = Settings::resolve(&none, &none, 100.0).unwrap();
    for (key, value) in [
        ("resolution", format!("[{}, {}]", settings.width, settings.height)),
        ("light_paths", settings.light_paths.to_string()),
        ("camera_paths", settings.camera_paths.to_string()),
        ("radius", format!("\"{}%\"", settings.radius)),
        ("merge_vertex", settings.merge_vertex.to_string()),
        ("seed", settings.seed.to_string()),
    ] {
        let row = text.lines().find(|line| line.starts_with(&format!("| `{key}` |"))).unwrap();
        let last = row.trim_end_matches(" |").rsplit(" | ").next().unwrap().replace('`', "");
        assert_eq!(last, value, "{row}");
    }
}

#[test]
fn obj_polygons_negative_indices_and_continued_lines_load() {
    let pentagon = "v 0 0 0 # a corner\nv 2 0 0\nv 2 1 0 0.1 0.2 0.3\nv 1 2 0\nv 0 4 0 4\n";
    let scene = obj(&format!("{pentagon}vt 0 0\nvn 0 0 1\nf 1/1 2/-1/1 \\\n 3//1 -2 -1\n"));
    assert_eq!(scene.triangle_count(), 3);
    let area: f32 = scene.triangles().iter().map(|t| t.area()).sum();
    assert!((area - 3.0).abs() < 1e-6, "{area}");
    assert!(scene.triangles().iter().all(|t| t.normal == Vec3::Z));
}

#[test]
fn meshes_are_objects_times_materials_in_file_order() {
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
    let faces = "o b\nusemtl x\nf 1 2 3\nusemtl y\nf 1 2 4\nusemtl x\nf 1 3 4\no a\nf 2 3 4\n";
    let scene = obj(&format!("{corners}{faces}"));
    let meshes: Vec<_> =
        scene.meshes().iter().map(|m| (m.name.as_str(), m.material, m.triangles.len())).collect();
    assert_eq!(meshes, [("b", 0, 2), ("b", 1, 1), ("a", 0, 1)]);
    let points = |mesh: usize, triangle: usize| {
        scene.meshes()[mesh].triangles[triangle].map(|i| scene.meshes()[mesh].positions[i as usize])
    };
    assert_eq!(points(0, 1), [Vec3::ZERO, Vec3::Y, Vec3::Z]);
    assert_eq!(points(2, 0), [Vec3::X, Vec3::Y, Vec3::Z]);
}

#[test]
fn materials_of_the_scene_file_precede_those_of_libraries() {
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let scene = r#"
        camera = { position = [0, 0, 5], direction = [0, 0, -1], fov_x_deg = 40 }
        mesh = [{ file = "a.obj" }, { file = "a.obj", material = "n" }, { file = "b.obj" }]
        materials.m = { albedo = [0.1, 0.2, 0.3], emission = 2 }
        materials.spare = {}
    "#;
    let folder = write(&[
        ("a.mtl", "newmtl m\nKd 1 1 1\nnewmtl n\nKd 2 0 0.5\nKe 3\nmap_Kd x.png\n"),
        ("b.mtl", "newmtl n\nKd 0.25\n"),
        ("a.obj", &format!("mtllib a.mtl\nusemtl m\n{triangle}")),
        ("b.obj", &format!("mtllib b.mtl\nusemtl n\n{triangle}")),
        ("scene.toml", scene),
    ]);
    let loaded = load(folder.path()).unwrap_or_else(|e| panic!("{e}"));
    let materials: Vec<_> = loaded
        .scene
        .materials()
        .iter()
        .map(|m| (m.name.as_str(), m.bsdf.albedo().to_array(), m.emission.to_array()))
        .collect();
    assert_eq!(
        materials,
        [
            ("m", [0.1, 0.2, 0.3], [2.0; 3]),
            ("n", [1.0, 0.0, 0.5], [3.0; 3]),
            ("n", [0.25; 3], [0.0; 3]),
        ]
    );
    let warnings = loaded.warnings_text();
    for part in
        ["a.mtl:4: the diffuse color", "ignored some textures", "no mesh uses the material `spare`"]
    {
        assert!(warnings.contains(part), "{warnings}");
    }
}

/// The BSDF of the material `name` of a scene of one triangle, with the warnings of loading it.
fn bsdf(mtl: &str, toml: &str, name: &str) -> (Bsdf, String) {
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let scene = "camera = { position = [0, 0, 5], direction = [0, 0, -1], fov_x_deg = 40 }\n\
                 light = [{ type = \"point\", position = [0, 0, 5], intensity = 1 }]\n\
                 mesh = [{ file = \"a.obj\" }]\n";
    let folder = write(&[
        ("a.mtl", mtl),
        ("a.obj", &format!("mtllib a.mtl\nusemtl {name}\n{triangle}")),
        ("scene.toml", &format!("{scene}{toml}")),
    ]);
    let loaded = load(folder.path()).unwrap_or_else(|e| panic!("{e}"));
    (loaded.scene.materials()[0].bsdf, loaded.warnings_text())
}

fn artist_metal(normal: [f32; 3], alpha: f32) -> Bsdf {
    Bsdf::Conductor(Conductor::new(Reflectance::Artist { normal: normal.into() }, alpha))
}

#[test]
fn refractive_indices_are_numbers_media_or_tables() {
    let read = |text: &str| {
        let folder = write(&[
            ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3"),
            (
                "scene.toml",
                &format!(
                    "mesh = [{{ file = 'a.obj', material = 'm' }}]\nlight = [{{ type = 'point', \
                     position = [0, 0, 1], power = 1 }}]\n[camera]\nposition = [0, 0, 9]\n\
                     target = [0, 0, 0]\nfov_x_deg = 40\n[materials.m]\ntype = 'dielectric'\n{text}"
                ),
            ),
        ]);
        load(folder.path()).unwrap_or_else(|e| panic!("{e}")).scene.materials()[0].clone()
    };
    let named = |name| RefractiveIndex::named(name).unwrap();
    let one = RefractiveIndex::Constant(1.0);
    for (text, inside, outside) in [
        ("ior = 'n-bk7'", named("N-BK7"), one.clone()),
        ("ior = 1.5\noutside_ior = 'water'", RefractiveIndex::Constant(1.5), named("water")),
        (
            "ior = { d = 1.5, abbe = 30 }",
            RefractiveIndex::Abbe { index: 1.5, abbe: 30.0 },
            one.clone(),
        ),
        (
            "ior = { cauchy = [1.5, 0.004] }",
            RefractiveIndex::Cauchy([1.5, 0.004, 0.0]),
            one.clone(),
        ),
        (
            "ior = { sellmeier = [[1, 0.01], [0.5, 100]] }",
            RefractiveIndex::Sellmeier(vec![[1.0, 0.01], [0.5, 100.0]]),
            one.clone(),
        ),
        (
            "ior = { nanometers = [400, 700], values = [1.6, 1.5] }",
            RefractiveIndex::Table(vec![[400.0, 1.6], [700.0, 1.5]]),
            one,
        ),
    ] {
        let material = read(text);
        let Bsdf::Dielectric(glass) = material.bsdf else { panic!("{text}") };
        assert_eq!(glass.eta, inside.at_d() as f32 / outside.at_d() as f32, "{text}");
        let dispersion = material.dispersion.expect(text);
        assert_eq!((dispersion.inside(), dispersion.outside()), (&inside, &outside), "{text}");
    }
    assert!(read("ior = 1.5").dispersion.is_none());
    assert!(read("ior = { d = 1.5, abbe = 1e300 }").dispersion.is_none());
}

fn sheet(reflectance: Vec3, transmittance: Vec3) -> Bsdf {
    Bsdf::DiffuseTransmission(DiffuseTransmission::new(reflectance, transmittance))
}

#[test]
fn every_type_of_material_is_parsed() {
    let gold = Reflectance::named("gold").unwrap();
    let (eta, k) = (Vec3::splat(0.5), Vec3::new(1.0, 2.0, 3.0));
    for (text, expected) in [
        ("albedo = 0.2", Bsdf::diffuse(Vec3::splat(0.2))),
        ("two_sided = false", Bsdf::Lambertian { albedo: Vec3::splat(0.5), two_sided: false }),
        ("type = 'mirror'", Bsdf::Mirror { reflectance: Vec3::ONE }),
        ("type = 'dielectric'", Bsdf::Dielectric(Dielectric::new(1.5))),
        (
            "type = 'dielectric'\nior = 1.2\noutside_ior = 1.6",
            Bsdf::Dielectric(Dielectric::new(1.2 / 1.6)),
        ),
        (
            "type = 'dielectric'\nroughness = 0.5",
            Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.25)),
        ),
        ("type = 'dielectric'\nalpha = 0.3", Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.3))),
        ("type = 'thin-dielectric'\nior = 2", Bsdf::ThinDielectric(ThinDielectric::new(2.0))),
        (
            "type = 'metal'\nmetal = 'gold'\nroughness = 0.5",
            Bsdf::Conductor(Conductor::new(gold, 0.25)),
        ),
        (
            "type = 'metal'\neta = 0.5\nk = [1, 2, 3]",
            Bsdf::Conductor(Conductor::new(Reflectance::Measured { eta, k }, 0.0)),
        ),
        ("type = 'metal'\nreflectance = [0.9, 0.8, 0.7]", artist_metal([0.9, 0.8, 0.7], 0.0)),
        (
            "type = 'coated'\nalbedo = 0.3\nior = 1.4",
            Bsdf::Coated(Coated::new(Vec3::splat(0.3), 1.4)),
        ),
        (
            "type = 'glossy'\nalbedo = 0.3\nior = 1.4\nmetallic = 0.25\nroughness = 0.5",
            Bsdf::Glossy(Glossy::new(Vec3::splat(0.3), 0.25, 1.4, 0.25)),
        ),
        (
            "type = 'plastic'\nalbedo = 0.3\nior = 1.4\nroughness = 0.5\nfacets = 'beckmann'\n\
             nonlinear = true\ntint = 0.5",
            Bsdf::Plastic(
                Plastic::new(
                    Vec3::splat(0.3),
                    1.4,
                    Facets { model: FacetModel::Beckmann, alpha: 0.25 },
                    true,
                )
                .tinted(Vec3::splat(0.5)),
            ),
        ),
        (
            "type = 'principled'\nalbedo = 0.3\nroughness = 0.25\nclearcoat = 0.5\nior = 1.4\n\
             transmission = 0.1\nsheen = 0.2\ntwo_sided = false",
            Bsdf::Principled(Principled::new(PrincipledParameters {
                base_color: Vec3::splat(0.3),
                roughness: 0.25,
                clearcoat: 0.5,
                eta: 1.4,
                spec_trans: 0.1,
                sheen: 0.2,
                two_sided: false,
                ..PrincipledParameters::default()
            })),
        ),
        ("type = 'glossy'", Bsdf::Glossy(Glossy::new(Vec3::splat(0.5), 0.0, 1.5, 0.0))),
        ("type = 'diffuse-transmission'", sheet(Vec3::splat(0.25), Vec3::splat(0.25))),
        (
            "type = 'diffuse-transmission'\nreflectance = 0.3\ntransmittance = [0.7, 0.5, 0]",
            sheet(Vec3::splat(0.3), Vec3::new(0.7, 0.5, 0.0)),
        ),
    ] {
        let (read, warnings) = bsdf("", &format!("[materials.m]\n{text}\n"), "m");
        assert_eq!((read, warnings), (expected, String::new()), "{text}");
    }
}

/// Clear glass of the index 1.5 transmits .96/1.04 at normal incidence, with all its reflections.
#[test]
fn glazing_transmits_what_its_data_say() {
    let keys = "[materials.m]\ntype = 'thin-dielectric'\nvisible_transmittance =";
    let (read, warnings) = bsdf("", &format!("{keys} 0.6\n"), "m");
    let Bsdf::ThinDielectric(sheet) = read else { panic!("{read:?}") };
    assert!(warnings.is_empty() && (sheet.shares(1.0)[0] - 0.6).abs().max_element() < 1e-6);
    for (more, problem) in [
        ("0.95", "transmits 0.923"),
        ("0.6\ntransmittance = 1", "described twice"),
        ("0.6\ninternal_transmittance = 0.9", "described twice"),
    ] {
        let camera = "[camera]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\nfov_x_deg = 60\n";
        let scene = format!("{camera}[[mesh]]\nfile = 'a.obj'\nmaterial = 'm'\n{keys} {more}\n");
        let folder =
            write(&[("scene.toml", &scene[..]), ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")]);
        let error = load(folder.path()).unwrap_err().to_string();
        assert!(error.contains(problem) && error.contains("scene.toml:"), "{error}");
    }
}

#[test]
fn mtl_records_convert_as_documented() {
    let half = Vec3::splat(0.5);
    let coat = |ior| Bsdf::Coated(Coated::new(half, ior));
    let glossy = |metallic, ior, alpha| Bsdf::Glossy(Glossy::new(half, metallic, ior, alpha));
    for (records, expected, warning) in [
        ("illum 2\nKd .5\nKs 0\nNs 10", Bsdf::diffuse(half), ""),
        ("illum 2\nKd .5\nKs .5\nNs 198", glossy(0.0, 1.5, 0.1), ""),
        ("illum 2\nKd .5\nKs .5\nNs 198\nNi 1", Bsdf::diffuse(half), "ignored the highlights"),
        ("illum 2\nKd .5\nKs .5", Bsdf::diffuse(half), "ignored the highlights"),
        ("Kd .5\nd 0.5", Bsdf::diffuse(half), ""),
        ("Kd .5\nd 0", Bsdf::diffuse(half), "ignored the opacity of 0 of `m`"),
        ("Kd 0\nKs .9 .8 .7\nNs 198", artist_metal([0.9, 0.8, 0.7], 0.1), ""),
        ("Kd 1 .7 .3\nPm 1\nPr .5", artist_metal([1.0, 0.7, 0.3], 0.25), ""),
        ("Kd .5\nPr .1\nNi 1.6", coat(1.6), ""),
        ("Kd .5\nPr .5\nNi 1.6", glossy(0.0, 1.6, 0.25), ""),
        ("Kd .5\nPr .5\nPm .25", glossy(0.25, 1.5, 0.25), ""),
        ("illum 3\nKd 0\nKs 1\nNs 5", Bsdf::Mirror { reflectance: Vec3::ONE }, ""),
        ("illum 5\nKd .5\nKs 1", coat(1.5), ""),
        ("illum 7\nd 0.1\nNi 1.3", Bsdf::Dielectric(Dielectric::new(1.3)), ""),
        ("illum 4\nNi 1.3\nPr .5", Bsdf::RoughDielectric(RoughDielectric::new(1.3, 0.25)), ""),
    ] {
        let (read, warnings) = bsdf(&format!("newmtl m\n{records}\n"), "", "m");
        assert_eq!(read, expected, "{records}");
        assert!(
            if warning.is_empty() { warnings.is_empty() } else { warnings.contains(warning) },
            "{warnings}"
        );
    }
}

#[test]
fn obj_files_get_a_camera_and_light() {
    let offset = 1000.0;
    let content = format!("v {offset} 0 0\nv {} 0 0\nv {offset} 3 0\nf 1 2 3\n", offset + 2.0);
    let folder = write(&[("a.obj", content.as_str())]);
    let loaded = load(folder.path().join("a.obj")).unwrap();
    let scene = &loaded.scene;
    let center = scene.bounds().center();
    let camera = &scene.camera;
    // The bounding sphere fills the image's height of 40 degrees.
    let distance = (camera.position() - center).length();
    let sphere = 0.5 * 13_f32.sqrt();
    assert!((sphere / distance - 20_f32.to_radians().sin()).abs() < 1e-3);
    assert!(camera.direction().dot(center - camera.position()) > 0.9999 * distance);
    assert!(camera.direction().z < 0.0 && camera.direction().y < 0.0);
    // A white surface that faces up has radiance 1 in it: see `load::default_light`.
    let light = scene.lights();
    assert!(light.emitters().is_empty());
    assert!(
        light.environment_radiance(Vec3::Y).x > 1.19
            && light.environment_radiance(-Vec3::Y).x < 0.01
    );
    let warnings = loaded.warnings_text();
    assert!(warnings.contains("no camera") && warnings.contains("nothing emits"), "{warnings}");

    let lamp = format!("mtllib a.mtl\nusemtl m\n{content}");
    let folder = write(&[("a.mtl", "newmtl m\nKe 1 1 1\n"), ("a.obj", lamp.as_str())]);
    let loaded = load(folder.path().join("a.obj")).unwrap();
    assert!(matches!(loaded.scene.lights().emitters(), [Emitter::Triangle { .. }]));
}

#[test]
fn tiny_and_huge_lamps_keep_their_power() {
    // In f32, the square of the doubled area would vanish or overflow.
    for scale in [1e-12_f32, 1.0, 1e12] {
        let content = format!("v 0 0 0\nv {scale:e} 0 0\nv 0 {scale:e} 0\nusemtl m\nf 1 2 3\n");
        let folder =
            write(&[("a.mtl", "newmtl m\nKe 1\n"), ("a.obj", &format!("mtllib a.mtl\n{content}"))]);
        let scene = load(folder.path().join("a.obj")).unwrap_or_else(|e| panic!("{e}")).scene;
        let expected = 0.5 * std::f32::consts::PI * scale * scale;
        assert!((scene.lights().power().x / expected - 1.0).abs() < 1e-5, "{scale}");
    }
}
