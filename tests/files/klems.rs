//! BSDF files of WINDOW and genBSDF: matrices of scattering.

use bdpm::import::WarningKind;
use bdpm::load::{Loaded, export, load};
use bdpm::scene::bsdf::{AngleBasis, Bsdf, Vertex};
use glam::Vec3;
use std::fmt::Write;
use std::path::Path;
use tempfile::TempDir;

const NAME: &str = "LBNL/Klems Quarter";

/// A block of values by the column of arriving and the row of leaving light.
pub(super) fn block(direction: &str, value: impl Fn(usize, usize) -> f64) -> String {
    let n = 41;
    let mut text = format!(
        "<WavelengthDataBlock><WavelengthDataDirection>{direction}</WavelengthDataDirection>\
         <ColumnAngleBasis>{NAME}</ColumnAngleBasis><RowAngleBasis>{NAME}</RowAngleBasis>\n\
         <ScatteringDataType>BTDF</ScatteringDataType><ScatteringData>\n"
    );
    for index in 0..n * n {
        let _ = write!(text, "{:.6},{}", value(index % n, index / n), ["\t", "\n"][index % 2]);
    }
    text + "</ScatteringData></WavelengthDataBlock>\n"
}

pub(super) fn xml(structure: &str, part: &str, blocks: &[String]) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<WindowElement xmlns=\"http://windows.lbl.gov\"><Optical><Layer>\n\
         <Material><Name>blind</Name></Material>\n<DataDefinition>\n\
         <IncidentDataStructure>{structure}</IncidentDataStructure>\n</DataDefinition>\n\
         <WavelengthData><Wavelength unit=\"Integral\">{part}</Wavelength>\n{}</WavelengthData>\n\
         </Layer></Optical></WindowElement>\n",
        blocks.concat()
    )
}

/// A folder with a square that has the sheet of a file.
fn folder(bsdf: &str, keys: &str) -> TempDir {
    let folder = TempDir::new().unwrap();
    let scene = format!(
        "camera = {{ position = [0, 0, 5], target = [0, 0, 0], fov_x_deg = 40 }}\n\
         environment = {{ radiance = 1 }}\nmesh = [{{ file = 'a.obj', material = 'm' }}]\n\
         [materials.m]\ntype = 'klems'\n{keys}\n"
    );
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put("scene.toml", &scene);
    put("b.xml", bsdf);
    put("a.obj", crate::common::gltf::SQUARE_OBJ);
    folder
}

fn loaded(folder: &Path) -> Loaded {
    load(folder.join("scene.toml")).unwrap()
}

fn refusal(bsdf: &str, keys: &str) -> String {
    let folder = folder(bsdf, keys);
    load(folder.path().join("scene.toml")).unwrap_err().to_string()
}

fn sheet(loaded: &Loaded) -> Bsdf {
    loaded.scene.materials().iter().find(|own| own.name == "m").unwrap().bsdf
}

fn seen(front: bool) -> Vertex {
    let normal = if front { Vec3::Z } else { -Vec3::Z };
    Vertex { normal, wo: normal, front, tangent: None }
}

/// "Front" of a file is outside, which is the back of a sheet that faces the room.
#[test]
fn fronts_of_files_face_outside() {
    let sides = [("Front", true), ("Back", false)];
    for (name, is_outside) in sides {
        let blocks = [
            block(&format!("Transmission {name}"), |_, _| 0.1),
            block(&format!("Reflection {name}"), |_, _| 0.05),
            block(&format!("Absorptance {name}"), |_, _| 0.7),
        ];
        for structure in ["Columns", "Rows"] {
            let folder = folder(&xml(structure, "Visible", &blocks), "file = 'b.xml'");
            let own = sheet(&loaded(folder.path()));
            // The missing transmission is the same in reverse.
            for front in [true, false] {
                let at = seen(front);
                assert_eq!(own.eval(&at, -at.wo), Vec3::splat(0.1));
                let reflected = if front == is_outside { 0.0 } else { 0.05 };
                assert_eq!(own.eval(&at, at.wo), Vec3::splat(reflected), "{name} {front}");
            }
        }
    }
}

/// Light of the patch around the normal leaves into the second band toward x, which is to the right
/// of those who look at the front with `up` on top.
#[test]
fn columns_are_the_directions_of_arriving_light() {
    let patches = AngleBasis::named(NAME).unwrap();
    let value = 0.5 / f64::from(patches.projected(1));
    let one = |from: usize, to: usize| if (from, to) == (0, 1) { value } else { 0.0 };
    let other = |from: usize, to: usize| one(to, from);
    let right = Vec3::new(0.4, 0.0, 0.9).normalize();
    let upward = Vec3::new(0.0, 0.4, 0.9).normalize();
    let text = |structure: &str| {
        let value = if structure == "Rows" { &other as &dyn Fn(_, _) -> _ } else { &one };
        xml(structure, "Visible", &[block("Transmission Front", value)])
    };
    for (keys, toward) in [("", right), ("up = [-1, 0, 0]", upward)] {
        for structure in ["Columns", "Rows"] {
            let folder = folder(&text(structure), &format!("file = 'b.xml'\n{keys}"));
            let own = sheet(&loaded(folder.path()));
            let at = Vertex { wo: toward, ..seen(true) };
            let found = own.eval(&at, -Vec3::Z).x;
            assert!((f64::from(found) / value - 1.0).abs() < 1e-4, "{keys} {structure}: {found}");
        }
    }
}

#[test]
fn scenes_with_bsdf_files_are_written_without_loss() {
    let spot = |from: usize, to: usize| 0.2 + 0.001 * (from + to) as f64;
    let blocks = [block("Transmission Front", spot), block("Reflection Back", |_, _| 0.02)];
    let folder = folder(&xml("Columns", "Visible", &blocks), "file = 'b.xml'\nup = [0, 2, 1]");
    let first = loaded(folder.path());
    let copy = TempDir::new().unwrap();
    export(&first, "a", copy.path(), true).unwrap();
    let second = loaded(copy.path());
    assert_eq!(sheet(&first), sheet(&second));
    assert_eq!(first.scene.fingerprint(), second.scene.fingerprint());
    assert!(second.warnings.iter().all(|one| one.kind != WarningKind::Skipped));
}

#[test]
fn wrong_bsdf_files_are_refused_with_a_reason() {
    let even = |value: f64| vec![block("Transmission Front", move |_, _| value)];
    let good = xml("Columns", "Visible", &even(0.1));
    let short = good.replacen("0.100000,\t", "", 1);
    for (text, expected) in [
        ("<WindowElement", "it is not valid XML"),
        ("<a/>", "it has no <Layer>"),
        (&xml("TensorTree4", "Visible", &even(0.1)), "`TensorTree4`, not a matrix"),
        (&xml("Columns", "Solar", &even(0.1)), "it has data for `Solar`, and none for `Visible`"),
        (&xml("Columns", "Visible", &[]), "it has no scattering data"),
        (&xml("Columns", "Visible", &even(0.4)), "scatters 1.25"),
        (&good.replace(NAME, "mine"), "the angle basis `mine` is not defined"),
        (&short, "a matrix has 1680 values, not 41 x 41"),
        (&good.replacen("0.100000", "nan", 1), "`nan` stands for a value"),
        (&good.replacen(NAME, "LBNL/Klems Full", 1), "several angle bases"),
    ] {
        let refusal = refusal(text, "file = 'b.xml'");
        assert!(refusal.contains(expected) && refusal.contains("b.xml"), "{refusal}");
    }
    for (keys, expected) in [
        ("", "scene.toml:5: a material of type `klems` has no `file`"),
        ("file = 'c.xml'", "scene.toml:6: there is no file `c.xml`"),
        ("file = 'b.xml'\nup = [0, 0, 0]", "`up` is 0"),
        ("file = 'b.xml'\nalbedo = 1", "a material of type `klems` has no `albedo`"),
    ] {
        let refusal = refusal(&good, keys);
        assert!(refusal.contains(expected), "{refusal}");
    }
}
