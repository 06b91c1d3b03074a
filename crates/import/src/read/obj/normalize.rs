//! Rewrites an OBJ file in the one dialect that `tobj` reads as we mean it.
//!
//! Exporters write continued lines, comments after numbers, texture coordinates of one number,
//! `nan`, references to attributes that do not exist, and faces whose corners have different
//! attributes. `tobj` refuses some of these and makes up attributes for others. It also forgets the
//! names of materials that no library defines, and it accepts faces that come before their
//! vertices.
//!
//! In the rewritten text, all faces of a [`Part`] form one object, so `tobj` returns exactly one
//! mesh per part, and no mesh mixes formats of faces. All indices are valid and count from the
//! first record of the file. This pass reads every number because it must also check vertices that
//! no face uses. So it knows the line of every error, and `tobj` has nothing left to refuse.

mod faces;

pub(super) use faces::Part;

use super::libraries::Library;
use crate::far::DBounds;
use crate::lines::Lines;
use crate::srgb::decode;
use crate::text::decoded;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::transform::MAX_COORDINATE;
use faces::Format;
use glam::DVec3;
use std::collections::{BTreeMap, HashMap};
use std::io::Write;
use std::path::Path;

/// Maximum number of material libraries of one file, far more than any exporter writes. Each new
/// name is compared with all known ones.
const MAX_LIBRARIES: usize = 1000;

/// Minimum number of bytes that are written at once.
const CHUNK: usize = 1 << 16;

/// Maximum number of unknown keywords in the warning.
const MAX_UNKNOWN: usize = 8;

/// Records that do not affect triangles.
const IRRELEVANT: &str = "vp mg cstype deg bmat step parm trim hole scrv sp end con bevel c_interp \
    d_interp lod usemap maplib shadow_obj trace_obj ctech stech";

/// A vector besides positions.
struct Attribute {
    /// Index among the references of a face's corner.
    kind: usize,
    /// Minimum number of components in a file.
    min: usize,
    /// Number of components that `tobj` needs.
    count: usize,
}

const TEXTURE_COORDINATES: Attribute = Attribute { kind: 1, min: 1, count: 2 };
const NORMAL: Attribute = Attribute { kind: 2, min: 3, count: 3 };

/// Content of a file that is not in the rewritten text.
#[derive(Debug, Default)]
pub(super) struct Normalized {
    /// One per object of the text, in the same order.
    pub parts: Vec<Part>,
    pub libraries: Vec<Library>,
    /// Whether any position has a color.
    pub has_colors: bool,
    /// Box around all positions of the file.
    pub bounds: DBounds,
    /// Number of points, lines, curves and surfaces.
    pub ignored_elements: u64,
    /// Number of references to texture coordinates and normals that do not exist.
    pub invalid_references: u64,
    /// Number of texture coordinates and components of normals that were replaced by 0.
    pub invalid_numbers: u64,
    /// Number of faces of a smoothing group without normals.
    pub unsmoothed: u64,
    /// The first unknown keywords, each with the line of its first use.
    pub unknown: BTreeMap<String, usize>,
}

/// How positions are written.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Dialect {
    /// Whether all positions have a color: `tobj` wants colors of all or of none.
    pub is_colored: bool,
    /// Point to which positions are relative.
    pub origin: DVec3,
}

/// Writes `text` to `output` in the dialect of `tobj`.
///
/// # Errors
/// If a line is malformed, or a face refers to a vertex that is not defined before it.
pub(super) fn normalize(
    path: &Path,
    text: &[u8],
    dialect: Dialect,
    mut output: impl Write,
) -> Result<Normalized> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut normalizer = Normalizer { name, dialect, ..Normalizer::default() };
    let mut lines = Lines::new(path, text);
    let mut write = |text: &[u8]| {
        output.write_all(text).map_err(|error| Error::io("pass on the model", path, error))
    };
    while lines.advance()? {
        normalizer.record(&lines)?;
        if normalizer.text.len() > CHUNK {
            write(&normalizer.text)?;
            normalizer.text.clear();
        }
    }
    let Normalizer { result, text, faces, .. } = normalizer;
    write(&text)?;
    for (index, faces) in faces.iter().enumerate().skip(1) {
        write(format!("o {index}\n").as_bytes())?;
        write(faces)?;
    }
    Ok(result)
}

#[derive(Default)]
struct Normalizer {
    result: Normalized,
    /// Records to write next: vertices, and the faces of the first part.
    text: Vec<u8>,
    dialect: Dialect,
    /// Numbers of positions, texture coordinates and normals so far.
    defined: [i64; 3],
    /// Name and material of the next face.
    name: String,
    material: Option<String>,
    /// Whether the next face belongs to a smoothing group.
    is_smooth: bool,
    /// Faces by part, except for those of the first one.
    faces: Vec<Vec<u8>>,
    part_index: HashMap<Part, usize>,
    /// Format and part of the last face, unless its name or material has changed since.
    current: Option<(Format, usize)>,
    /// Corners of the current face: one-based indices, 0 for none.
    face: Vec<[i64; 3]>,
    /// Number of all corners so far.
    corner_count: usize,
}

impl Normalizer {
    fn record(&mut self, lines: &Lines<'_>) -> Result<()> {
        let (keyword, rest) = split_keyword(lines.bytes());
        match keyword {
            b"v" => self.position(lines, without_comment(rest))?,
            b"vt" => self.attribute(lines, TEXTURE_COORDINATES)?,
            b"vn" => self.attribute(lines, NORMAL)?,
            b"f" => self.face(lines, without_comment(rest))?,
            b"o" | b"g" if rest.is_empty() => {}
            b"o" | b"g" => {
                self.name = decoded(rest).into_owned();
                self.current = None;
            }
            b"usemtl" => {
                self.material = (!rest.is_empty()).then(|| decoded(rest).into_owned());
                self.current = None;
            }
            b"mtllib" => self.library(lines, rest)?,
            b"s" => {
                self.is_smooth = !matches!(without_comment(rest).trim_ascii(), b"off" | b"0" | b"")
            }
            b"p" | b"l" | b"curv" | b"curv2" | b"surf" => self.result.ignored_elements += 1,
            b"" | [b'#', ..] => {}
            known if IRRELEVANT.split(' ').any(|word| word.as_bytes() == known) => {}
            unknown => self.add_unknown(lines, &decoded(unknown)),
        }
        Ok(())
    }

    /// Three coordinates, then either a fourth that divides them or the three components of a
    /// color.
    fn position(&mut self, lines: &Lines<'_>, rest: &[u8]) -> Result<()> {
        let advice = "give three numbers, such as `v 0.5 1 -2`";
        let mut numbers = [0.0_f64; 4];
        let mut count = 0;
        for word in words(rest) {
            let number = float(word)
                .ok_or_else(|| lines.error(format!("`{}` is not a number", shown(word)), advice))?;
            if let Some(place) = numbers.get_mut(count) {
                *place = number;
            }
            count += 1;
        }
        if count < 3 {
            return Err(lines.error(format!("the vertex has {count} coordinates"), advice));
        }
        let weight = if count == 4 { numbers[3] } else { 1.0 };
        let point = DVec3::from_slice(&numbers) / weight;
        if !point.as_vec3().is_finite() || !weight.is_finite() {
            return Err(lines.error(
                "the vertex has a coordinate that is not finite",
                "export the model again, or remove the vertex and its faces",
            ));
        }
        if point.as_vec3().abs().max_element() > MAX_COORDINATE {
            return Err(lines.error(
                format!("the vertex has a coordinate beyond {MAX_COORDINATE:e}"),
                "scale the model down",
            ));
        }
        self.defined[0] += 1;
        self.result.has_colors |= count >= 6;
        self.result.bounds = self.result.bounds.with(point);
        let Dialect { is_colored, origin } = self.dialect;
        let text = &mut self.text;
        text.extend_from_slice(b"v ");
        if count <= 4 && !is_colored && origin == DVec3::ZERO {
            text.extend_from_slice(rest);
            text.push(b'\n');
            return Ok(());
        }
        // Display writes as many digits as it takes to read the same number again.
        let moved = (point - origin).as_vec3();
        let _ = write!(text, "{} {} {}", moved.x, moved.y, moved.z);
        if is_colored {
            let Rgb { x, y, z } = if count >= 6 { color(rest) } else { Rgb::ONE };
            let _ = write!(text, " {x} {y} {z}");
        }
        text.push(b'\n');
        Ok(())
    }

    /// Texture coordinates or a normal. Some programs write `-nan(ind)`; it becomes 0, as do
    /// numbers that are too large.
    fn attribute(&mut self, lines: &Lines<'_>, attribute: Attribute) -> Result<()> {
        let Attribute { kind, min, count } = attribute;
        let (keyword, rest) = split_keyword(lines.bytes());
        self.text.extend_from_slice(keyword);
        let mut given = 0;
        for word in words(without_comment(rest)).take(3) {
            let is_valid = float(word).is_some_and(|n| n.abs() <= f64::from(MAX_COORDINATE));
            self.result.invalid_numbers += u64::from(!is_valid);
            if given < count {
                self.text.push(b' ');
                self.text.extend_from_slice(if is_valid { word } else { b"0" });
            }
            given += 1;
        }
        if given < min {
            let keyword = shown(keyword);
            return Err(lines.error(
                format!("`{keyword}` needs {min} or more numbers"),
                format!("write them, such as `{keyword}{}`", &" 0.5 0.5 0.5"[..4 * min]),
            ));
        }
        self.text.extend_from_slice(if given < count { b" 0\n" } else { b"\n" });
        self.defined[kind] += 1;
        Ok(())
    }

    fn library(&mut self, lines: &Lines<'_>, rest: &[u8]) -> Result<()> {
        let names = decoded(rest).into_owned();
        if names.is_empty() {
            self.add_unknown(lines, "mtllib without a name");
            return Ok(());
        }
        let libraries = &mut self.result.libraries;
        if libraries.iter().any(|known| known.names == names) {
            return Ok(());
        }
        if libraries.len() == MAX_LIBRARIES {
            let problem = format!("more than {MAX_LIBRARIES} material libraries");
            return Err(lines.error(problem, "join them into fewer MTL files"));
        }
        libraries.push(Library { names, line: lines.number() });
        Ok(())
    }

    fn add_unknown(&mut self, lines: &Lines<'_>, keyword: &str) {
        let unknown = &mut self.result.unknown;
        if unknown.len() < MAX_UNKNOWN {
            let keyword = keyword.chars().take(24).collect();
            unknown.entry(keyword).or_insert(lines.number());
        }
    }
}

/// The linear color of a `v` record of six or more numbers. Its codes need the digits of `f64` to
/// lead back to the color that `convert` wrote.
fn color(rest: &[u8]) -> Rgb {
    let mut codes = words(rest).skip(3).map(|word| std::str::from_utf8(word).ok()?.parse().ok());
    decode(std::array::from_fn(|_| codes.next().flatten().unwrap_or(1.0)))
}

fn float(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// The first word and the rest, without white space around either.
fn split_keyword(line: &[u8]) -> (&[u8], &[u8]) {
    let end = line.iter().position(is_space).unwrap_or(line.len());
    (&line[..end], line[end..].trim_ascii_start())
}

fn words(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(is_space).filter(|word| !word.is_empty())
}

fn is_space(byte: &u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r')
}

fn without_comment(text: &[u8]) -> &[u8] {
    memchr::memchr(b'#', text).map_or(text, |at| &text[..at])
}

/// The beginning of a word, for a message.
fn shown(word: &[u8]) -> String {
    String::from_utf8_lossy(word).chars().take(40).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn normalized(text: &str, is_colored: bool) -> Result<(Normalized, String)> {
        relative(text, Dialect { is_colored, ..Dialect::default() })
    }

    fn relative(text: &str, dialect: Dialect) -> Result<(Normalized, String)> {
        let mut output = Vec::new();
        let result = normalize(Path::new("a.obj"), text.as_bytes(), dialect, &mut output)?;
        Ok((result, String::from_utf8(output).unwrap()))
    }

    #[test]
    fn dialects_are_rewritten() {
        let text = "v 0 0 0 # why\nv 1 \\\n 0 0 2\r\nv 1 1 0 .1 .2\nvt .5\nvt nan 1 2\nvn 0 0 1\n\
            f 1 2 3\no b\nf -3/-2/1 2/2/1 3/1/1\nf 1 2 3/1\nusemtl m\nf 1// 2 3\nl 1 2\n\
            o b\nusemtl\nf 1/9/1 2/2/1 3/1/1 # all\nf 3/1/1 2/1/1 1/1/1\n";
        let (result, output) = normalized(text, false).unwrap();
        let expected = "v 0 0 0 \nv 1   0 0 2\nv 1 1 0\nvt .5 0\nvt 0 1\nvn 0 0 1\nf 1 2 3\n\
            o 1\nf 1/1/1 2/2/1 3/1/1\nf 3/1/1 2/1/1 1/1/1\no 2\nf 1 2 3\no 3\nf 1// 2 3\n\
            o 4\nf 1//1 2//1 3//1\n";
        assert_eq!(output, expected);
        let parts = result.parts.iter().map(|part| (&part.name[..], part.material.as_deref()));
        let parts: Vec<_> = parts.collect();
        assert_eq!(parts, [("a", None), ("b", None), ("b", None), ("b", Some("m")), ("b", None)]);
        let counts = [result.ignored_elements, result.invalid_references, result.invalid_numbers];
        assert_eq!(counts, [1, 1, 1]);
    }

    #[test]
    fn colors_become_linear_and_are_white_where_missing() {
        let text = "v 1 2 3\nv 1 2 3 2\nv 1 2 3 0 1 0.5\n";
        assert!(normalized(text, false).unwrap().0.has_colors);
        let (_, output) = normalized(text, true).unwrap();
        let expected = "v 1 2 3 1 1 1\nv 0.5 1 1.5 1 1 1\nv 1 2 3 0 1 0.21404114\n";
        assert_eq!(output, expected);
    }

    #[test]
    fn far_positions_keep_their_digits_relative_to_their_center() {
        let text = "v 1000000.125 0 5 # why\nv 1000002.5 2 5 0 1 0\nvn 0 0 1\nf 1 2 1\n";
        let origin = normalized(text, false).unwrap().0.bounds.far_center().unwrap();
        let (_, output) = relative(text, Dialect { is_colored: false, origin }).unwrap();
        let lines: Vec<&str> = output.lines().collect();
        let numbers = |line: &str| -> Vec<f64> {
            line.split(' ').skip(1).map(|word| word.parse().unwrap()).collect()
        };
        let [a, b] = [numbers(lines[0]), numbers(lines[1])];
        assert_eq!([a[0] + origin.x, a[1] + origin.y, a[2] + origin.z], [1_000_000.125, 0.0, 5.0]);
        assert_eq!((b[0] - a[0], b[1] - a[1], b.len()), (2.375, 2.0, 3));
        assert_eq!(lines[2..], ["vn 0 0 1", "f 1 2 1"]);
    }

    #[test]
    fn only_first_unknown_keywords_are_kept() {
        let text: String = (0..1000).map(|i| format!("x{i} 1\n")).collect();
        let (result, _) = normalized(&text, false).unwrap();
        let first = (0..MAX_UNKNOWN).map(|i| (format!("x{i}"), i + 1));
        assert!(result.unknown.iter().map(|(word, line)| (word.clone(), *line)).eq(first));
    }

    #[test]
    fn first_error_is_reported_with_its_line() {
        let good = "v 0 0 0\nf 1 1 1\n".repeat(20);
        for (bad, problem) in [
            ("f -22 1 1\nv x", "vertex -22, but 20 are defined"),
            ("v y 1 1\nf 0 0 0\nv x", "`y` is not a number"),
            ("f 22 1 1\nv 1 1 1", "vertex 22, but 20 are defined"),
        ] {
            let error = normalized(&format!("{good}{bad}\n{good}"), false).unwrap_err().to_string();
            assert!(error.contains("a.obj:41: ") && error.contains(problem), "{error}");
        }
    }

    proptest! {
        #[test]
        fn tobj_reads_one_mesh_per_part(lines in proptest::collection::vec(0..RECORDS.len(), 0..60)) {
            let lines = lines.into_iter().map(|i| RECORDS[i]);
            let text: Vec<&str> = RECORDS[..6].iter().copied().chain(lines).collect();
            let text = text.join("\n");
            let (result, output) = normalized(&text, false).unwrap();
            let options = tobj::LoadOptions { single_index: true, ..Default::default() };
            let read = tobj::load_obj_buf(&mut output.as_bytes(), &options, |_| Ok(Default::default()));
            let meshes: Vec<_> = read.unwrap().0.into_iter().map(|model| model.mesh).collect();
            // Without any face `tobj` returns one empty mesh.
            prop_assert_eq!(meshes.len(), result.parts.len().max(1), "{}", text);
            for (mesh, Part { format, .. }) in meshes.iter().zip(&result.parts) {
                let count = mesh.positions.len() / 3;
                prop_assert_eq!(mesh.texcoords.len(), if format.uvs { 2 * count } else { 0 });
                prop_assert_eq!(mesh.normals.len(), if format.normals { 3 * count } else { 0 });
            }
        }
    }

    /// Any sequence of these records that begins with the first six is valid.
    const RECORDS: [&str; 24] = [
        "v 0 0 0",
        "v 1 0 0",
        "v 0 1 0",
        "v 1 1 0 0.5",
        "vt 0 1",
        "vn 0 0 1",
        "vt 0.5",
        "vt nan 1e30",
        "f 1 2 3",
        "f -1 -2 -3",
        "f 1/1 2/2 3/1",
        "f 1//1 -1//-1 2//1",
        "f 1/1/1 2/-1/1 3/1/-1 -1/-1/-1",
        "f 1 \\\n 2 3 # why",
        "f 1/5/7 2/-4/1 3/1/0",
        "f 1/ 2// 3 4",
        "o a",
        "g b",
        "usemtl m",
        "usemtl n",
        "usemtl",
        "mtllib a.mtl",
        "l 1 2",
        "what 1",
    ];
}
