//! Compiled parts of scenes of Radiance, and lamps whose radiance depends on the direction, beside
//! the files that they were made from.

use bdpm::base::math::luminance;
use bdpm::base::photometry::LUMENS_PER_WATT;
use bdpm::import::WarningKind;
use bdpm::light::photometry::LuminaireFile;
use bdpm::load::{Loaded, load};
use bdpm::scene::{Emitter, Scene};
use glam::Vec3;
use std::f32::consts::PI;
use std::path::{Path, PathBuf};

const GROUND: &str = "void plastic ground 0 0 5 .2 .2 .2 0 0\n\
                      ground polygon below 0 0 12 -9 -9 -3 9 -9 -3 9 9 -3 -9 9 -3\n";

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// A scene of this text beside copies of the files of the test data.
fn try_read(text: &str) -> bdpm::base::error::Result<Loaded> {
    let folder = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(data("radiance")).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
    }
    let path = folder.path().join("a.rad");
    std::fs::write(&path, text).unwrap();
    load(&path)
}

#[track_caller]
fn read(text: &str) -> Loaded {
    try_read(text).unwrap_or_else(|e| panic!("{e}"))
}

/// Radiant intensity of all lamps in a unit direction, as candela by 179 lumens for a watt of
/// Radiance.
fn candela(scene: &Scene, direction: Vec3) -> f32 {
    let emitters = scene.lights().emitters();
    let of = |emitter: &Emitter| match emitter {
        Emitter::Opening(own) => luminance(own.opening.aimed().intensity(direction)),
        other => panic!("{other:?}"),
    };
    emitters.iter().map(of).sum::<f32>() * LUMENS_PER_WATT
}

fn skipped(loaded: &Loaded) -> Vec<&str> {
    let skipped = loaded.warnings.iter().filter(|own| own.kind == WarningKind::Skipped);
    skipped.map(|own| &own.text[..]).collect()
}

/// Unit directions all around, none of them in a plane of the axes.
fn directions() -> impl Iterator<Item = Vec3> {
    (0..400).map(|index| {
        let z = 1.0 - (2.0 * index as f32 + 1.0) / 400.0;
        let (sin, cos) = (2.4 * index as f32 + 0.1).sin_cos();
        let across = (1.0 - z * z).sqrt();
        Vec3::new(across * cos, across * sin, z)
    })
}

#[test]
fn luminaires_of_ies2rad_have_the_intensities_of_their_ies_files() {
    // The largest error over the peak. Sizes of steps matter where a cosine times linear data is no
    // grid of the data. Files of type B are left out: Radiance has other angles for them.
    let cases = [
        ("quarter", "photometry/quarter.ies", 2e-5),
        ("tilted", "photometry/tilted.ies", 2e-5),
        ("box", "radiance/box.ies", 3e-3),
        ("drum", "radiance/drum.ies", 3e-3),
        ("globe", "radiance/globe.ies", 3e-3),
    ];
    for (name, ies, tolerance) in cases {
        let loaded = read(&format!("{GROUND}!xform {name}.rad\n"));
        let notes = skipped(&loaded);
        assert_eq!(notes.len(), usize::from(name == "tilted"), "{name}: {notes:?}");
        let file = LuminaireFile::read(&data(ies)).unwrap().distribution;
        let mut worst = 0.0f64;
        for direction in directions() {
            let found = f64::from(candela(&loaded.scene, direction));
            worst = worst.max((found - file.intensity(direction.as_dvec3())).abs() / file.peak());
        }
        assert!(worst < tolerance, "{name}: {worst}");
    }
}

/// Patterns move with their file, also mirrored and to another size, and a transform of its own
/// turns a pattern.
#[test]
fn distributions_move_with_their_lamps() {
    let at = |text: &str, direction: Vec3| {
        candela(&read(&format!("{GROUND}{text}\n")).scene, direction.normalize())
    };
    let near = |a: f32, b: f32| assert!((a / b - 1.0).abs() < 1e-4, "{a} {b}");
    // Its intensities in C0 and C90 differ.
    let [c0, c90] = [Vec3::new(0.8, 0.0, -0.6), Vec3::new(0.0, 0.8, -0.6)];
    let plain = [c0, c90].map(|to| at("!xform quarter.rad", to));
    assert!((plain[0] / plain[1] - 1.0).abs() > 0.1, "{plain:?}");
    near(at("!xform -rz 90 -t 1 2 3 quarter.rad", c90), plain[0]);
    near(at("!xform -rx 180 quarter.rad", -c0), plain[0]);
    near(at("!xform -mz quarter.rad", Vec3::new(0.8, 0.0, 0.6)), plain[0]);
    // Radiances stay, so that the intensity grows with the area.
    near(at("!xform -s 2 quarter.rad", c0), 4.0 * plain[0]);
    let turned = "void brightdata own 7 flatcorr quarter.dat source.cal src_phi4 src_theta -rz 90 \
                  0 1 9.375\nown light lit 0 0 3 1 1 1\n\
                  lit polygon it 0 0 12 -.6 -.1 0 -.6 .1 0 .6 .1 0 .6 -.1 0";
    near(at(turned, c90), plain[0]);
}

#[test]
fn spotlights_shine_within_their_cone_alone() {
    // A disc of an area that faces along the cone, and one that does not.
    for (normal, cosine) in [("0 0 -1", 1.0), (".6 0 -.8", 0.8)] {
        let loaded = read(&format!(
            "{GROUND}void spotlight spot 0 0 7 100 100 100 40 0 0 -5e-4\n\
             spot ring lamp 0 0 8 0 0 1 {normal} 0 .1\n"
        ));
        assert!(skipped(&loaded).is_empty());
        let scene = &loaded.scene;
        let area = 0.01 * PI;
        let axial = 100.0 * area * cosine * 179.0;
        let found = candela(scene, Vec3::NEG_Z);
        assert!((found / axial - 1.0).abs() < 1e-3, "{found} {axial}");
        let tilted = |degrees: f32| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            Vec3::new(0.0, sin, -cos)
        };
        assert!(candela(scene, tilted(19.9)) > 0.9 * axial);
        assert_eq!(candela(scene, tilted(20.1)), 0.0);
        // The mean cosine in the cone, about its axis.
        let sine = 20f32.to_radians().sin();
        let power = 100.0 * area * cosine * PI * sine * sine * 179.0 / LUMENS_PER_WATT;
        let own = luminance(scene.lights().power());
        assert!((own / power - 1.0).abs() < 1e-3, "{own} {power}");
    }
}

#[test]
fn foci_of_spotlights_are_reported() {
    let loaded = read(&format!(
        "{GROUND}void spotlight spot 0 0 7 1 1 1 40 0 0 -5\nspot ring lamp 0 0 8 0 0 1 0 0 -1 0 .1\n"
    ));
    let notes = skipped(&loaded);
    assert!(notes.len() == 1 && notes[0].contains("length of the direction"), "{notes:?}");
}

#[test]
fn rings_shine_along_their_normal() {
    let loaded = read(&format!(
        "{GROUND}void light bright 0 0 3 1 1 1\nbright ring lamp 0 0 8 0 0 2 0 0 -1 .1 .3\n"
    ));
    for emitter in loaded.scene.lights().emitters() {
        let Emitter::Triangle { shape, .. } = emitter else { panic!("{emitter:?}") };
        assert!(shape.normal.z < -0.999, "{:?}", shape.normal);
    }
}

#[test]
fn compiled_meshes_have_the_triangles_and_materials_of_their_source() {
    let lamp = "void light bright 0 0 3 1 1 1\nbright sphere lamp 0 0 4 0 3 9 .5\n";
    let own = read(&format!("{lamp}void mesh ball 1 ball.rtm 0 0\n")).scene;
    let bounds = own.bounds();
    // The ball has the radius 1 on a square of 4 by 4.
    let near = |a: Vec3, b: Vec3| assert!((a - b).length() < 1e-4, "{a} {b}");
    near(bounds.min, Vec3::new(-2.0, -2.0, -1.0));
    let of = |scene: &Scene, name: &str, center: Vec3| -> (usize, f32, bool) {
        let index = scene.materials().iter().position(|own| own.name == name).unwrap();
        let meshes = scene.placements().iter().map(|own| (&scene.meshes()[own.mesh as usize], own));
        let own = meshes.filter(|(_, placement)| placement.material as usize == index);
        let mut all = (0, 0.0, false);
        for (mesh, _) in own {
            all.0 += mesh.triangles.len();
            all.2 |= !mesh.normals.is_empty();
            for corners in &mesh.triangles {
                let [a, b, c] = corners.map(|corner| mesh.positions[corner as usize]);
                all.1 += 0.5 * (b - a).cross(c - a).length();
            }
            // Those of a ball of radius 1 about the origin of the mesh.
            for (normal, position) in mesh.normals.iter().zip(&mesh.positions) {
                near(*position - center, *normal);
            }
        }
        all
    };
    let (count, area, is_smooth) = of(&own, "red", Vec3::ZERO);
    assert!(
        (count, is_smooth) == (24 * 30, true) && (area / (4.0 * PI) - 1.0).abs() < 0.02,
        "{area}"
    );
    let (count, area, is_smooth) = of(&own, "green", Vec3::ZERO);
    assert!((count, is_smooth) == (2, false) && (area / 16.0 - 1.0).abs() < 1e-5, "{area}");
    // A modifier replaces both, and names of the file do not leave it.
    let moved = "void plastic blue 0 0 5 .1 .1 .6 0 0\nblue mesh ball 5 ball.rtm -t 1 2 3 0 0\n";
    let own = read(&format!("{lamp}{moved}")).scene;
    let center = Vec3::new(1.0, 2.0, 3.0);
    near(own.bounds().min, Vec3::new(-1.0, 0.0, 2.0));
    assert_eq!((of(&own, "red", center).0, of(&own, "blue", center).0), (0, 24 * 30 + 2));
    let leak =
        try_read(&format!("{lamp}void mesh ball 1 ball.rtm 0 0\nred sphere s 0 0 4 0 0 5 1\n"));
    assert!(leak.unwrap_err().to_string().contains("`red` is not defined"));
}

#[test]
fn octrees_stand_for_their_scenes() {
    let [plain, frozen] = ["part.oct", "frozen.oct"]
        .map(|name| read(&format!("{GROUND}void instance it 7 {name} -t 0 0 1 -s 2 0 0\n")).scene);
    for scene in [&plain, &frozen] {
        assert!((scene.bounds().max.z - 6.0).abs() < 1e-4, "{:?}", scene.bounds());
        let power = 2.0 * PI * 4.0 * 0.09 * PI * 179.0 / LUMENS_PER_WATT;
        let own = luminance(scene.lights().power());
        assert!((own / power - 1.0).abs() < 2e-3, "{own} {power}");
    }
    let own = read(&format!("{GROUND}ground instance it 1 frozen.oct 0 0\n"));
    // A modifier replaces all materials, so that the lamp does not shine.
    let emitters = own.scene.lights().emitters();
    assert!(!emitters.iter().any(|own| matches!(own, Emitter::Triangle { .. })), "{emitters:?}");
}

#[test]
fn bad_compiled_files_are_refused_with_advice() {
    let cases = [
        ("void mesh it 0 0 0", "names no file"),
        ("void mesh it 1 absent.rtm 0 0", "no file `absent.rtm`"),
        ("void mesh it 1 part.oct 0 0", "is not Radiance_tmesh"),
        ("void mesh it 1 part.rad 0 0", "no header"),
        ("void mesh it 3 ball.rtm -a 2 0 0", "has an array"),
        ("void mesh it 2 ball.rtm left 0 0", "the word `left`"),
        ("void instance it 1 ball.rtm 0 0", "is not Radiance_octree"),
        ("void spotlight s 0 0 7 1 1 1 0 0 0 1\ns sphere it 0 0 4 0 0 0 1", "no angle"),
        (
            "void brightdata d 4 corr absent.dat source.cal src_theta 0 0\nd light s 0 0 3 1 1 1\n\
             s sphere it 0 0 4 0 0 0 1",
            "no file `absent.dat`",
        ),
        (
            "void brightdata d 4 corr quarter.dat source.cal src_theta 0 0\nd light s 0 0 3 1 1 1\n\
             s sphere it 0 0 4 0 0 0 1",
            "other coordinates than its data",
        ),
        (
            "void brightdata d 4 corr part.rad source.cal src_theta 0 0\nd light s 0 0 3 1 1 1\n\
             s sphere it 0 0 4 0 0 0 1",
            "stands for the number of dimensions",
        ),
    ];
    for (text, problem) in cases {
        let Err(error) = try_read(&format!("{GROUND}{text}\n")) else { panic!("{text} is read") };
        assert!(error.to_string().contains(problem), "{text}: {error}");
    }
}
