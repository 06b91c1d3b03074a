//! Scenes of pbrt-v4: geometry, materials, lights and cameras of known values, and errors.

use bdpm::import::WarningKind;
use bdpm::load::{Loaded, load};
use bdpm::scene::bsdf::Bsdf;
use bdpm::scene::{Emitter, Extent, FieldOfView, Optics, RefractiveIndex};
use glam::{Vec2, Vec3};
use std::path::Path;

const HEAD: &str = "Scale -1 1 1\nLookAt 0 0 5 0 0 0 0 1 0\nCamera \"perspective\" \"float fov\" 40\n\
                    Film \"rgb\" \"integer xresolution\" 40 \"integer yresolution\" 20\nWorldBegin\n";
const LIGHT: &str = "LightSource \"infinite\" \"rgb L\" [ 1 1 1 ]\n";
const BALL: &str = "Shape \"sphere\"\n";

fn try_load(text: &str) -> bdpm::base::error::Result<Loaded> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.pbrt");
    std::fs::write(&path, text).unwrap();
    load(&path)
}

fn read(text: &str) -> Loaded {
    try_load(text).unwrap_or_else(|e| panic!("{e}"))
}

/// A scene with a ball, lit from all around, after these directives.
fn world(text: &str) -> Loaded {
    read(&[HEAD, LIGHT, text, BALL].concat())
}

#[test]
fn example_of_all_elements_is_read() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/pbrt/box.pbrt");
    let loaded = load(data).unwrap_or_else(|e| panic!("{e}"));
    let scene = &loaded.scene;
    assert_eq!(loaded.defaults.resolution, Some([40, 30]));
    assert_eq!(
        scene.camera.optics(),
        Optics::Pinhole(match scene.camera.optics() {
            Optics::Pinhole(FieldOfView::X(degrees)) => {
                // 50 degrees across the shorter side.
                let expected = 2.0 * (4.0 / 3.0 * 25_f32.to_radians().tan()).atan();
                assert!((degrees.to_radians() - expected).abs() < 1e-5, "{degrees}");
                FieldOfView::X(degrees)
            }
            other => panic!("{other:?}"),
        })
    );
    assert!((scene.camera.position() - Vec3::new(0.0, 0.0, 4.0)).length() < 1e-5);
    assert!((scene.camera.direction() + Vec3::Z).length() < 1e-6);
    let skipped = loaded.warnings.iter().filter(|one| one.kind == WarningKind::Skipped);
    let texts: Vec<_> = skipped.map(|one| one.text.clone()).collect();
    // The mixture is approximated, and the subdivided mesh has no texture coordinates.
    assert!(
        texts.iter().all(|text| ["`both`", "one texel"].iter().any(|own| text.contains(own))),
        "{texts:?}"
    );
    let power = scene.lights().power();
    assert!(power.is_finite() && power.min_element() > 0.0);
}

#[test]
fn power_and_scale_of_lights_follow_pbrt() {
    let emitter = |text: &str| {
        let loaded = read(&[HEAD, text, BALL].concat());
        loaded.scene.lights().emitters()[0].clone()
    };
    // phi / (4 pi), times the color.
    let Emitter::Point { position, intensity } = emitter(
        "Translate 1 0 0 LightSource \"point\" \"rgb I\" [2 1 0.5] \"float power\" 12.566371 \
         \"point3 from\" [0 2 0]",
    ) else {
        panic!()
    };
    assert!((position - Vec3::new(1.0, 2.0, 0.0)).length() < 1e-6);
    assert!((intensity - Vec3::new(2.0, 1.0, 0.5)).abs().max_element() < 1e-5, "{intensity}");
    // Spectra have the luminance 1.
    let Emitter::Directional(sun) = emitter(
        "LightSource \"distant\" \"blackbody L\" 3000 \"float scale\" 3 \"point3 to\" [0 0 -1]",
    ) else {
        panic!()
    };
    let luminance = sun.irradiance.dot(Vec3::new(0.2126, 0.7152, 0.0722));
    assert!((luminance - 3.0).abs() < 0.01, "{}", sun.irradiance);
    assert_eq!(sun.direction, -Vec3::Z);
    assert!(sun.irradiance.x > 2.0 * sun.irradiance.z);
}

#[test]
fn area_lights_emit_their_power_from_the_front_of_normals() {
    // The power of a lamp of area A and radiance L is pi A L; both sides emit with `twosided`.
    for (sides, twosided) in [(1.0, "false"), (2.0, "true")] {
        let text = format!(
            "AreaLightSource \"diffuse\" \"float power\" 7 \"bool twosided\" {twosided}\n\
             Shape \"disk\" \"float radius\" 2\n"
        );
        let loaded = read(&[HEAD, &text].concat());
        let power = loaded.scene.lights().power();
        assert!((power - Vec3::splat(7.0)).abs().max_element() < 1e-3, "{power}");
        let faces = loaded.scene.lights().emitters().iter().filter(|emitter| match emitter {
            Emitter::Triangle { shape, .. } => shape.normal.z > 0.0,
            other => panic!("{other:?}"),
        });
        let share = faces.count() as f32 / loaded.scene.lights().emitters().len() as f32;
        assert_eq!(share, 1.0 / sides);
    }
    let normals = |n: f32, extra: &str| {
        let text = format!(
            "AreaLightSource \"diffuse\"\n{extra}Shape \"trianglemesh\" \"point3 P\" \
             [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 2] \"normal N\" [0 0 {n} 0 0 {n} 0 0 {n}]\n"
        );
        match read(&[HEAD, &text].concat()).scene.lights().emitters()[0] {
            Emitter::Triangle { ref shape, .. } => shape.normal.z,
            ref other => panic!("{other:?}"),
        }
    };
    assert_eq!(normals(1.0, ""), 1.0);
    assert_eq!(normals(-1.0, ""), -1.0);
    assert_eq!(normals(1.0, "ReverseOrientation\n"), -1.0);
    assert_eq!(normals(1.0, "Scale -1 1 1\n"), 1.0);
    assert_eq!(normals(1.0, "Scale 1 1 -1\n"), -1.0);
}

#[test]
fn film_exposure_scales_all_light() {
    let head =
        HEAD.replace("Film \"rgb\"", "Film \"rgb\" \"float iso\" 200 \"float exposuretime\" 3");
    let text = "LightSource \"point\" \"rgb I\" [1 2 3]\n";
    let loaded = read(&[&head, text, BALL].concat());
    let Emitter::Point { intensity, .. } = loaded.scene.lights().emitters()[0] else { panic!() };
    assert_eq!(intensity, 6.0 * Vec3::new(1.0, 2.0, 3.0));
}

#[test]
fn cameras_have_their_projection_crop_and_handedness() {
    let camera = |head: &str| read(&[head, "WorldBegin\n", LIGHT, BALL].concat()).scene.camera;
    let film = "Film \"rgb\" \"integer xresolution\" 40 \"integer yresolution\" 20";
    let flat = camera(&format!("Scale 0.5 0.5 0.5 {film} Camera \"orthographic\"\n"));
    // The screen is 4 wide, its units are 2 long.
    assert_eq!(flat.optics(), Optics::Orthographic(Extent::X(8.0)));
    let lens = "Camera \"perspective\" \"float lensradius\" 0.1 \"float focaldistance\" 3\n";
    let thin = camera(&format!("Scale -1 1 1 Translate 0 0 3 {film} {lens}"));
    let Optics::ThinLens { aperture_radius, focus_distance, .. } = thin.optics() else { panic!() };
    assert_eq!((aperture_radius, focus_distance), (0.1, 3.0));
    // The right half of the image, whose center is off by half its width.
    let crop = format!("{film} \"float cropwindow\" [0.5 1 0 1]\nCamera \"perspective\"\n");
    let part = camera(&format!("Scale -1 1 1 {crop}"));
    assert_eq!(part.shift(), [0.5, 0.0]);
    assert_eq!(part.optics(), Optics::Pinhole(FieldOfView::X(90.0)));
    // A point on the camera's +x is on the right of the image, in left-handed and right-handed
    // worlds.
    for head in ["", "Scale -1 1 1 "] {
        let text = format!(
            "{head}{film}\nCamera \"perspective\" \"float fov\" 90\nCoordinateSystem \"eye\"\nWorldBegin\n\
             {LIGHT}CoordSysTransform \"camera\"\nTranslate 1 0 4\nShape \"sphere\" \"float radius\" 0.1\n"
        );
        let scene = read(&text).scene;
        let center = 0.5 * (scene.bounds().min + scene.bounds().max);
        let view = scene.camera.view(40, 20);
        // At depth 4 the image is 16 wide: one unit are 2.5 pixels.
        let (ray, _) = view.ray(22.5, 10.0, [0.5; 2]);
        let off = (center - ray.origin).normalize() - ray.direction;
        assert!(off.length() < 1e-4, "{head}: {off}");
    }
    let sphere = "Camera \"spherical\" \"string mapping\" \"equirectangular\"\n";
    for head in ["", "Scale -1 1 1 "] {
        let text = format!(
            "{head}{film}\n{sphere}WorldBegin\n{LIGHT}CoordSysTransform \"camera\"\nTranslate 0 0 4\n\
             Shape \"sphere\" \"float radius\" 0.1\n"
        );
        let scene = read(&text).scene;
        let center = 0.5 * (scene.bounds().min + scene.bounds().max);
        // In pbrt, +z is at a quarter of the width.
        let (ray, _) = scene.camera.view(40, 20).ray(10.0, 10.0, [0.5; 2]);
        // The small ball is far from the origin: the scene is relative to it.
        let toward = (center - ray.origin).normalize();
        assert!((toward - ray.direction).length() < 1e-4, "{head}");
    }
}

#[test]
fn textures_scale_mix_and_map() {
    let loaded = world(
        "Texture \"a\" \"spectrum\" \"checkerboard\" \"rgb tex1\" [0.8 0.4 0.2] \"rgb tex2\" [0 0 0]\n\
         Texture \"b\" \"spectrum\" \"scale\" \"texture tex\" \"a\" \"float scale\" 0.5\n\
         Texture \"c\" \"spectrum\" \"mix\" \"texture tex1\" \"b\" \"rgb tex2\" [1 1 1] \"float amount\" 0.5\n\
         Material \"diffuse\" \"texture reflectance\" \"c\"\n",
    );
    let material = &loaded.scene.materials()[0];
    let Bsdf::Lambertian { albedo, two_sided: true } = material.bsdf else { panic!() };
    let texture = material.albedo_texture.as_ref().unwrap();
    let at = |u: f32, v: f32| albedo * texture.color(Vec2::new(u, v));
    // Squares (0, 0) and (1, 1) of a period have the first color; coordinates are halved on the
    // mesh.
    for (uv, expected) in [
        ([0.25, 0.25], Vec3::new(0.7, 0.6, 0.55)),
        ([0.75, 0.75], Vec3::new(0.7, 0.6, 0.55)),
        ([0.75, 0.25], Vec3::splat(0.5)),
        ([0.25, 0.75], Vec3::splat(0.5)),
    ] {
        let off = (at(uv[0], uv[1]) - expected).abs().max_element();
        assert!(off < 5e-3, "{uv:?}: {}", at(uv[0], uv[1]));
    }
    let uvs = &loaded.scene.meshes()[0].uvs;
    let highest = uvs.iter().fold(Vec2::ZERO, |max, uv| max.max(*uv));
    assert!((highest - Vec2::splat(0.5)).abs().max_element() < 1e-6, "{highest}");
}

#[test]
fn mixed_diffuse_materials_have_the_mean_albedo() {
    let loaded = world(
        "MakeNamedMaterial \"a\" \"string type\" \"diffuse\" \"rgb reflectance\" [0.8 0 0]\n\
         MakeNamedMaterial \"b\" \"string type\" \"diffuse\" \"rgb reflectance\" [0 0.4 0]\n\
         Material \"mix\" \"string materials\" [\"a\" \"b\"] \"float amount\" 0.25\n",
    );
    assert_eq!(loaded.scene.materials()[0].bsdf, Bsdf::diffuse(Vec3::new(0.6, 0.1, 0.0)));
}

#[test]
fn glasses_and_spectra_of_dielectrics_disperse() {
    for (eta, expected) in [
        ("\"spectrum eta\" \"glass-BK7\"", RefractiveIndex::named("N-BK7")),
        (
            "\"spectrum eta\" [ 400 1.6 700 1.5 ]",
            Some(RefractiveIndex::Table(vec![[400.0, 1.6], [700.0, 1.5]])),
        ),
        ("\"float eta\" 1.5", None),
    ] {
        let loaded = world(&format!("Material \"dielectric\" {eta}\n"));
        let dispersion = &loaded.scene.materials()[0].dispersion;
        let inside = dispersion.as_ref().map(|dispersion| dispersion.inside().clone());
        assert_eq!(inside, expected, "{eta}");
    }
}

#[test]
fn conductors_by_reflectance_have_it_at_normal_incidence() {
    let loaded = world("Material \"conductor\" \"rgb reflectance\" [0.9 0.5 0.1]\n");
    let Bsdf::Conductor(metal) = loaded.scene.materials()[0].bsdf else { panic!() };
    let off = metal.normal_reflectance() - Vec3::new(0.9, 0.5, 0.1);
    assert!(off.abs().max_element() < 1e-4, "{off}");
    assert_eq!(metal.alpha(), 0.0);
    let rough = world("Material \"conductor\" \"float roughness\" 0.09\n");
    let Bsdf::Conductor(metal) = rough.scene.materials()[0].bsdf else { panic!() };
    assert!((metal.alpha() - 0.3).abs() < 1e-6, "the root of the roughness");
}

#[test]
fn shapes_have_their_area() {
    use std::f32::consts::{PI, TAU};
    for (shape, area) in [
        ("sphere\" \"float radius\" 2", 16.0 * PI),
        ("sphere\" \"float zmin\" 0 \"float phimax\" 180", PI),
        ("disk\" \"float innerradius\" 0.5", 0.75 * PI),
        ("cylinder\" \"float radius\" 2 \"float zmax\" 3", 4.0 * PI * 4.0),
        ("cylinder\" \"float phimax\" 90", TAU / 4.0 * 2.0),
        ("bilinearmesh\" \"point3 P\" [0 0 0 2 0 0 0 3 0 2 3 0]", 6.0),
    ] {
        let loaded = read(&format!("{HEAD}{LIGHT}Shape \"{shape}\n"));
        let found: f32 = loaded.scene.triangles().iter().map(bdpm::scene::Triangle::area).sum();
        assert!((found / area - 1.0).abs() < 1e-4, "{shape}: {found}, {area}");
    }
}

#[test]
fn errors_name_the_line_and_a_remedy() {
    for (text, parts) in [
        ("Foo\n", ["the directive `Foo` is unknown", "pbrt-v4"]),
        ("Material \"plastic\"\nShape \"sphere\"\n", ["type `plastic` are unknown", "--upgrade"]),
        ("Shape \"cube\"\n", ["type `cube` are unknown", "use sphere"]),
        ("NamedMaterial \"x\"\nShape \"sphere\"\n", ["no material `x`", "MakeNamedMaterial"]),
        ("Shape \"sphere\" \"float radius\" [1 2]\n", ["`radius` is not one number", "give one"]),
        ("Shape \"sphere\" \"float radius\" -1\n", ["`radius` is -1", "give a number from"]),
        (
            "Shape \"trianglemesh\" \"point3 P\" [0 0 0] \"integer indices\" [0 1 2]\n",
            ["has the index 1, but there are 1 vertices", "correct the list"],
        ),
        ("Include \"none.pbrt\"\n", ["there is no file `none.pbrt`", "check the name"]),
        ("Scale 0 1 1\nShape \"sphere\"\n", ["has no inverse", "use scales other than 0"]),
        (
            "Material \"diffuse\" \"texture reflectance\" \"t\"\nShape \"sphere\"\n",
            ["no texture `t` of type spectrum", "define it before"],
        ),
        ("AttributeEnd\n", ["AttributeEnd has no beginning", "AttributeBegin"]),
        (
            "LightSource \"point\" \"spectrum I\" [400 1 300 2]\nShape \"sphere\"\n",
            ["the wavelengths do not grow", "sort the samples"],
        ),
        ("Translate 1 2\n", ["it does not have 3 numbers", "give 3"]),
    ] {
        let error = try_load(&[HEAD, LIGHT, text].concat()).unwrap_err();
        let shown = error.to_string();
        assert!(parts.iter().all(|part| shown.contains(part)), "{shown}");
        assert!(error.line_number().is_some_and(|line| line > 5), "{shown}");
    }
}

#[test]
fn unsupported_parts_are_named() {
    let text = "MakeNamedMedium \"fog\" \"string type\" \"uniformgrid\"\nMediumInterface \"fog\" \"\"\n\
                LightSource \"goniometric\"\nMaterial \"measured\" \"string filename\" \"x.bsdf\"\n";
    let loaded = world(text);
    let shown = loaded.warnings_text();
    for part in ["media of other types", "`goniometric`", "the measured material"] {
        assert!(shown.contains(part), "{shown}");
    }
}

#[test]
fn scenes_of_media_alone_are_refused_if_none_is_supported() {
    let scene = |kind: &str| {
        let fog = format!(
            "MakeNamedMedium \"fog\" \"string type\" \"{kind}\" \"rgb sigma_a\" [1 2 3]\n\
             MediumInterface \"fog\" \"\"\nMaterial \"interface\"\nShape \"sphere\"\n"
        );
        try_load(&[HEAD, LIGHT, &fog].concat())
    };
    let error = scene("uniformgrid").unwrap_err().to_string();
    assert!(error.contains("only media of types"), "{error}");
    let media = scene("homogeneous").unwrap();
    let [medium] = media.scene.media().unwrap().media() else { panic!("one medium") };
    assert_eq!(medium.absorption, Vec3::new(1.0, 2.0, 3.0));
    assert_eq!(medium.scattering, Vec3::new(2.55, 3.21, 3.77));
}

#[test]
fn media_are_those_of_their_interfaces() {
    let text = "MakeNamedMedium \"a\" \"string type\" \"homogeneous\" \"rgb sigma_a\" [0 0 0] \"rgb sigma_s\" [1 1 1] \
                \"float scale\" 2 \"float g\" 0.5\nMediumInterface \"a\" \"\"\nMaterial \"dielectric\"\nShape \"sphere\"\n\
                MediumInterface \"\"\nShape \"sphere\"\n";
    let scene = world(text).scene;
    let [medium] = scene.media().unwrap().media() else { panic!("one medium") };
    assert_eq!((medium.scattering, medium.asymmetry), (Vec3::splat(2.0), 0.5));
    let bounded = scene.materials().iter().filter(|own| own.boundary.is_some()).count();
    assert_eq!(bounded, 1);
    let error = try_load(&[HEAD, LIGHT, "MediumInterface \"b\" \"\"\nShape \"sphere\"\n"].concat());
    assert!(error.unwrap_err().to_string().contains("there is no medium `b`"));
}

#[test]
fn curves_of_one_material_become_one_mesh_of_tubes() {
    let curve = "Shape \"curve\" \"float width\" 0.2 \"point3 P\" [0 0 0 1 0 0 2 0 0 3 0 0]\n";
    let text = format!("Material \"diffuse\"\n{curve}Shape \"sphere\"\n{curve}{curve}");
    let placements = |text: &str| world(text).scene.placements().len();
    let without = placements("Material \"diffuse\"\nShape \"sphere\"\n");
    assert_eq!(placements(&text), without + 1);
    let bad = "Shape \"curve\" \"point3 P\" [0 0 0 1 0 0 2 0 0 3 0 0 4 0 0]\n";
    let error = try_load(&[HEAD, LIGHT, bad].concat()).unwrap_err().to_string();
    assert!(error.contains("5 control points do not fit"), "{error}");
}

#[test]
fn attributes_and_imports_end_with_their_block() {
    let loaded = read(
        &[
            HEAD,
            LIGHT,
            "AttributeBegin Attribute \"shape\" \"float radius\" 2 Shape \"sphere\" AttributeEnd\n\
         Translate 10 0 0 Shape \"sphere\"\n",
        ]
        .concat(),
    );
    let bounds = loaded.scene.bounds();
    assert!((bounds.min.x + 2.0).abs() < 1e-2 && (bounds.max.x - 11.0).abs() < 1e-2, "{bounds:?}");
}
