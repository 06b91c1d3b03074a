//! Our reader beside the crate `tobj`: the same triangles, vertices, names and materials of generated
//! files; and what `tobj` reads in another way, for which it is not our reader.

mod generated;

use super::{ObjMesh, read};
use crate::import::lines::Lines;
use generated::{File, MATERIALS, step};
use glam::{Vec2, Vec3};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use std::cell::Cell;
use std::collections::HashSet;
use std::io::{self, BufReader, Read};
use std::panic::catch_unwind;
use std::path::Path;

/// Of a name that `tobj` gives to faces before any object.
const PATH: &str = "unnamed_object.obj";

/// A triangle's corner: its position and, if all corners of the face have them, the rest.
type Corner = (Vec3, Option<Vec2>, Option<Vec3>);

/// A mesh, without its vertices.
#[derive(Clone, Debug, PartialEq)]
struct Part {
    name: String,
    material: Option<String>,
    triangles: Vec<[Corner; 3]>,
}

impl Part {
    /// What triangles of one mesh have in common.
    fn key(&self) -> (&str, Option<&str>, [bool; 2]) {
        let (_, uv, normal) = self.triangles[0][0];
        (&self.name, self.material.as_deref(), [uv.is_some(), normal.is_some()])
    }

    fn of(ObjMesh { mesh, material }: &ObjMesh) -> Self {
        let corner = |index: u32| {
            let index = index as usize;
            let (uv, normal) = (mesh.uvs.get(index), mesh.normals.get(index));
            (mesh.positions[index], uv.copied(), normal.copied())
        };
        let triangles = mesh.triangles.iter().map(|triangle| triangle.map(corner)).collect();
        Self { name: mesh.name.clone(), material: material.clone(), triangles }
    }

    /// Number of corners that differ in anything.
    fn vertex_count(&self) -> usize {
        let corners = self.triangles.iter().flatten();
        corners.map(|corner| format!("{corner:?}")).collect::<HashSet<_>>().len()
    }
}

/// A part for each model that `tobj` makes of a file, of which [`MATERIALS`] are defined.
fn by_tobj(text: impl Read) -> Result<Vec<Part>, tobj::LoadError> {
    let options = tobj::LoadOptions {
        triangulate: true,
        ignore_points: true,
        ignore_lines: true,
        ..Default::default()
    };
    let library = |_: &Path| {
        let material = |name: &str| tobj::Material { name: name.into(), ..Default::default() };
        let index = MATERIALS.iter().enumerate().map(|(i, name)| ((*name).to_owned(), i));
        Ok((MATERIALS.map(material).to_vec(), index.collect()))
    };
    let (models, _) = tobj::load_obj_buf(&mut BufReader::new(text), &options, library)?;
    let part = |tobj::Model { mesh, name }: tobj::Model| {
        let corner = |i: usize| {
            let three = |all: &[f32], index: u32| Vec3::from_slice(&all[3 * index as usize..]);
            let uv = |index: &u32| Vec2::from_slice(&mesh.texcoords[2 * *index as usize..]);
            let normal = |index: &u32| three(&mesh.normals, *index);
            let (uvs, normals) = (mesh.texcoord_indices.get(i), mesh.normal_indices.get(i));
            (three(&mesh.positions, mesh.indices[i]), uvs.map(uv), normals.map(normal))
        };
        let triangle = |i: usize| [3 * i, 3 * i + 1, 3 * i + 2].map(corner);
        let triangles = (0..mesh.indices.len() / 3).map(triangle).collect();
        Part { name, material: mesh.material_id.map(|id| MATERIALS[id].to_owned()), triangles }
    };
    Ok(models.into_iter().map(part).collect())
}

/// The triangles of models, by what those of one mesh have in common, as each first appears.
fn regrouped(models: Vec<Part>, layouts: &[[bool; 2]]) -> Vec<Part> {
    let mut layouts = layouts.iter();
    let mut parts: Vec<Part> = Vec::new();
    for model in models {
        for mut triangle in model.triangles {
            // Where a corner lacks something, `tobj` takes another's.
            let [uvs, normals] = layouts.next().expect("more triangles than were written");
            for (_, uv, normal) in &mut triangle {
                *uv = uv.filter(|_| *uvs);
                *normal = normal.filter(|_| *normals);
            }
            let (name, material) = (model.name.clone(), model.material.clone());
            let part = Part { name, material, triangles: vec![triangle] };
            match parts.iter_mut().find(|known| known.key() == part.key()) {
                Some(known) => known.triangles.push(triangle),
                None => parts.push(part),
            }
        }
    }
    assert_eq!(layouts.next(), None, "fewer triangles than were written");
    parts
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: std::env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(400),
        rng_seed: RngSeed::Fixed(1),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn generated_files_are_read_alike(
        steps in vec(step(), 0..40), choices in vec(any::<u8>(), 1..50), size in 1..3000_usize,
    ) {
        let file = File::new(&steps, &choices, false);
        let expected = by_tobj(file.text.as_bytes());
        let expected = expected.unwrap_or_else(|error| panic!("{error}:\n{}", file.text));
        let expected = regrouped(expected, &file.layouts);
        for text in [file.text, File::new(&steps, &choices, true).text] {
            let model = read(Path::new(PATH), text.as_bytes(), size);
            let (meshes, _) = model.unwrap_or_else(|error| panic!("{error}:\n{text}")).meshes();
            let parts: Vec<_> = meshes.iter().map(Part::of).collect();
            prop_assert_eq!(&parts, &expected, "{}", text);
            for (part, ObjMesh { mesh, .. }) in parts.iter().zip(&meshes) {
                prop_assert_eq!(mesh.positions.len(), part.vertex_count(), "{}", text);
            }
        }
    }
}

/// The lines of a file for `tobj`, without their dialects: one at a time, and counted.
struct Numbered<'a> {
    lines: Lines<'a>,
    rest: Vec<u8>,
    number: &'a Cell<usize>,
}

impl Read for Numbered<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.rest.is_empty() && self.lines.advance().map_err(io::Error::other)? {
            self.number.set(self.lines.number());
            self.rest = [self.lines.text().as_bytes(), b"\n"].concat();
        }
        let count = self.rest.len().min(buffer.len());
        buffer[..count].copy_from_slice(&self.rest[..count]);
        self.rest.drain(..count);
        Ok(count)
    }
}

/// What a file is read as, or the number of its wrong line.
type Outcome = Result<Vec<Part>, usize>;

fn ours(text: &str) -> Outcome {
    let model = read(Path::new(PATH), text.as_bytes(), usize::MAX).map_err(|error| {
        let text = error.to_string();
        let (line, _) = text[PATH.len() + 1..].split_once(':').unwrap();
        line.parse::<usize>().unwrap()
    })?;
    Ok(model.meshes().0.iter().map(Part::of).collect())
}

/// The same by `tobj` behind lines; panics are no outcome.
fn theirs(text: &str) -> Option<Outcome> {
    catch_unwind(|| {
        let number = Cell::new(0);
        let lines = Lines::new(Path::new(PATH), text.as_bytes(), 0);
        let layered = Numbered { lines, rest: Vec::new(), number: &number };
        by_tobj(layered).map_err(|_| number.get())
    })
    .ok()
}

#[test]
fn what_tobj_reads_in_another_way_even_behind_lines() {
    let head = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n";
    let whole = "f 1/1/1 2/1/1 3/1/1\n";
    // That there is a difference and not only a mistake in this test:
    for text in [format!("{head}{whole}"), format!("{head}{whole}v 1 2 x\n")] {
        assert_eq!(theirs(&text), Some(ours(&text)), "{text}");
    }
    for (lines, line) in [
        // Attributes of some faces or corners only: taken from another one.
        ("f 1 2 3\n", None),
        ("f 1/1/1 2/1/1 3/1\n", None),
        // References to what is undefined yet, or was never: late or not at all. Those to texture coordinates
        // and normals are not errors here.
        ("f 1 2 4\nv 1 1 0\n", Some(7)),
        ("f 1 2 4\no b\n", Some(7)),
        ("f 1 2 0\no b\n", Some(7)),
        ("f 1/0 2/1 3/1\n", None),
        ("f 1/-2 2/1 3/1\n", None),
        ("f 1/-3 2/1 3/1\n", None),
        ("f 1 2 -9\no b\n", Some(7)),
        // Numbers that are not finite: taken.
        ("v 1e400 0 0\nf 1 2 4\n", Some(7)),
        ("v nan 0 0\nf 1 2 4\n", Some(7)),
        ("vn inf 0 0\nf 1//1 2//1 3//2\n", None),
        // Comments after numbers; texture coordinates of one number; colors of some vertices, or
        // of four numbers: refused.
        ("v 0 0 0 # why not\nf 1 2 3 # all\n", None),
        ("vt 0.5\n", None),
        ("v 0 0 0 .1 .2 .3\nf 1/1/1 2/1/1 4/1/1\n", None),
        ("v 0 0 0 .1 .2 .3 1\n", None),
        // A tab before a name: refused, or part of the name.
        ("usemtl\tstone\n", None),
        // Names of materials that are not defined yet: forgotten.
        ("usemtl unknown\nf 1/1/1 2/1/1 3/1/1\n", None),
        // Lines of three points: triangles.
        ("l 1 2 3\n", None),
        // An object without a name: named anew.
        ("o a\ng\nf 1/1/1 2/1/1 3/1/1\n", None),
    ] {
        let text = format!("{head}{lines}{whole}");
        let (ours, theirs) = (ours(&text), theirs(&text));
        assert_eq!(ours.as_ref().err().copied(), line, "{text}");
        assert_ne!(Some(ours), theirs, "{text}");
    }
}
