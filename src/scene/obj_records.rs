//! The records of an OBJ file, checked one by one on their way to `tobj`.

use super::obj::Library;
use crate::error::{Error, Result};
use crate::scene::text::{Lines, split_keyword};
use crate::scene::transform::MAX_COORDINATE;
use glam::Vec3;
use std::collections::BTreeMap;
use std::io::{Read, Write};

/// Most material libraries that one file may name.
const MAX_LIBRARIES: usize = 1000;

/// What faces of one mesh have in common, besides what their corners tell.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct Part {
    pub name: String,
    pub material: Option<String>,
    layout: Layout,
}

/// What the corners of a face tell besides positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Layout {
    uvs: bool,
    normals: bool,
}

/// Checks an OBJ file line by line, and is read by `tobj` as the plainest file of the same content:
/// positions, texture coordinates, normals, faces by index, and an object number per part.
pub(super) struct Records {
    lines: Lines,
    /// Of the current face.
    corners: Vec<Corner>,
    /// What is to be read next.
    ready: Vec<u8>,
    taken: usize,
    /// Why reading stopped, if it did before the end.
    pub error: Option<Error>,
    defined: Defined,
    triangles: u32,
    name: String,
    material: Option<String>,
    /// Each announced object.
    pub parts: Vec<Part>,
    pub libraries: Vec<Library>,
    pub ignored_elements: u64,
    /// Unknown keywords and where they first appeared.
    pub unknown: BTreeMap<String, usize>,
}

impl Records {
    pub fn new(lines: Lines, name: String) -> Self {
        Self {
            lines,
            corners: Vec::new(),
            ready: Vec::new(),
            taken: 0,
            error: None,
            defined: Defined::default(),
            triangles: 0,
            name,
            material: None,
            parts: Vec::new(),
            libraries: Vec::new(),
            ignored_elements: 0,
            unknown: BTreeMap::new(),
        }
    }

    /// Checks the current line and adds to `ready` what `tobj` needs of it.
    fn record(&mut self) -> Result<()> {
        let (keyword, rest) = split_keyword(self.lines.line());
        match keyword {
            "v" => {
                let words = position(&self.lines, rest)?;
                count(&self.lines, &mut self.defined.positions, "vertices")?;
                write_record(&mut self.ready, "v", words);
            }
            "vt" => {
                let [u, v, _] = numbers(&self.lines, rest, 1)?;
                count(&self.lines, &mut self.defined.uvs, "texture coordinates")?;
                write_record(&mut self.ready, "vt", &format!("{u:?} {v:?}"));
            }
            "vn" => {
                let [x, y, z] = numbers(&self.lines, rest, 3)?;
                count(&self.lines, &mut self.defined.normals, "normals")?;
                write_record(&mut self.ready, "vn", &format!("{x:?} {y:?} {z:?}"));
            }
            "f" => self.face()?,
            "o" | "g" => {
                let name = rest.to_owned();
                if !name.is_empty() && name != self.name {
                    self.name = name;
                }
            }
            "usemtl" => {
                if rest.is_empty() {
                    let advice = "write the name of a material after `usemtl`";
                    return Err(self.lines.error("the material has no name", advice));
                }
                if self.material.as_deref() != Some(rest) {
                    self.material = Some(rest.to_owned());
                }
            }
            "mtllib" => {
                if rest.is_empty() {
                    let advice = "write the name of an MTL file after `mtllib`";
                    return Err(self.lines.error("the material library has no name", advice));
                }
                // Far more than any exporter writes; each is looked for among those before it.
                if self.libraries.len() == MAX_LIBRARIES {
                    let problem = format!("more than {MAX_LIBRARIES} material libraries");
                    return Err(self.lines.error(problem, "join them into fewer MTL files"));
                }
                if self.libraries.iter().all(|library| library.names != rest) {
                    let line = self.lines.number();
                    self.libraries.push(Library { names: rest.to_owned(), line });
                }
            }
            "p" | "l" | "curv" | "curv2" | "surf" => self.ignored_elements += 1,
            "" | "vp" | "s" | "mg" | "cstype" | "deg" | "bmat" | "step" | "parm" | "trim"
            | "hole" | "scrv" | "sp" | "end" | "con" | "bevel" | "c_interp" | "d_interp"
            | "lod" | "usemap" | "maplib" | "shadow_obj" | "trace_obj" | "ctech" | "stech" => {}
            comment if comment.starts_with('#') => {}
            unknown => {
                // A note is for people: the first few will do.
                if self.unknown.len() < 8 && !self.unknown.contains_key(unknown) {
                    let word = unknown.chars().take(20).collect();
                    self.unknown.entry(word).or_insert(self.lines.number());
                }
            }
        }
        Ok(())
    }

    /// A polygon: at least three corners `position/texture/normal`, of which the last two count if
    /// all corners have them.
    fn face(&mut self) -> Result<()> {
        let rest = split_keyword(self.lines.line()).1;
        let begin = self.ready.len();
        let mut corners = 0_u32;
        self.corners.clear();
        for word in rest.split_whitespace() {
            if word.starts_with('#') {
                break;
            }
            self.corners.push(corner(&self.lines, word, self.defined)?);
            corners += 1;
        }
        if corners == 0 {
            let advice = "give at least three vertices, such as `f 1 2 3`";
            return Err(self.lines.error("the face has no vertices", advice));
        }
        if corners < 3 {
            self.ignored_elements += 1;
            return Ok(());
        }
        self.triangles = self.triangles.checked_add(corners - 2).ok_or_else(|| {
            let problem = "the file has more than 4294967295 triangles";
            self.lines.error(problem, "split the model into several files")
        })?;
        let layout = Layout {
            uvs: self.corners.iter().all(|corner| corner.uv.is_some()),
            normals: self.corners.iter().all(|corner| corner.normal.is_some()),
        };
        self.ready.extend_from_slice(b"f");
        for corner in &self.corners {
            let or_none = |index: Option<u32>| index.map_or(String::new(), |i| i.to_string());
            let uv = or_none(corner.uv.filter(|_| layout.uvs));
            let normal = or_none(corner.normal.filter(|_| layout.normals));
            // Writing to memory cannot fail.
            let _ = match layout {
                Layout { normals: true, .. } => {
                    write!(self.ready, " {}/{uv}/{normal}", corner.position)
                }
                Layout { uvs: true, .. } => write!(self.ready, " {}/{uv}", corner.position),
                _ => write!(self.ready, " {}", corner.position),
            };
        }
        self.ready.push(b'\n');
        let (name, material) = (&self.name, &self.material);
        let same =
            |part: &Part| (&part.name, &part.material, part.layout) == (name, material, layout);
        if !self.parts.last().is_some_and(same) {
            let (name, material) = (name.clone(), material.clone());
            self.parts.push(Part { name, material, layout });
            // Objects are announced with their first face, so that none is empty.
            let announcement = format!("o {}\n", self.parts.len() - 1);
            self.ready.splice(begin..begin, announcement.into_bytes());
        }
        Ok(())
    }
}

impl Read for Records {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        while self.taken == self.ready.len() {
            self.ready.clear();
            self.taken = 0;
            if self.error.is_some() {
                return Ok(0);
            }
            let more = self.lines.advance();
            match more.and_then(|more| if more { self.record().map(|()| true) } else { Ok(false) })
            {
                Ok(true) => {}
                Ok(false) => return Ok(0),
                Err(error) => {
                    // End the file here: `load` looks for the error first.
                    self.error = Some(error);
                    self.ready.clear();
                    return Ok(0);
                }
            }
        }
        let count = buffer.len().min(self.ready.len() - self.taken);
        buffer[..count].copy_from_slice(&self.ready[self.taken..self.taken + count]);
        self.taken += count;
        Ok(count)
    }
}

/// Checks a position, and returns the numbers that count: three, or four with a weight.
fn position<'a>(lines: &Lines, text: &'a str) -> Result<&'a str> {
    let text = text.split('#').next().unwrap_or_default().trim_end();
    let mut numbers = [0.0_f32; 4];
    let mut count = 0;
    let mut xyz_end = 0;
    for word in text.split_whitespace() {
        let number = word.parse::<f32>().map_err(|_| {
            let short: String = word.chars().take(40).collect();
            let advice = "give three numbers, such as `v 0.5 1 -2`";
            lines.error(format!("`{short}` is not a number"), advice)
        })?;
        if count < 4 {
            numbers[count] = number;
        }
        count += 1;
        if count == 3 {
            xyz_end = word.as_ptr() as usize - text.as_ptr() as usize + word.len();
        }
    }
    if count < 3 {
        return Err(lines.error(
            format!("the vertex has {count} coordinates"),
            "give three numbers, such as `v 0.5 1 -2`",
        ));
    }
    // A fourth number alone is a weight; three or more are a color.
    let weight = if count == 4 { numbers[3] } else { 1.0 };
    let point = Vec3::from_slice(&numbers) / weight;
    if !point.is_finite() || !weight.is_finite() {
        return Err(lines.error(
            "the vertex has a coordinate that is not finite",
            "export the model again, or remove the vertex and its faces",
        ));
    }
    if point.abs().max_element() > MAX_COORDINATE {
        return Err(lines.error(
            format!("the vertex has a coordinate beyond {MAX_COORDINATE:e}"),
            "scale the model down",
        ));
    }
    Ok(if count == 4 { text } else { &text[..xyz_end] })
}

/// How many of each were defined so far.
#[derive(Clone, Copy, Debug, Default)]
struct Defined {
    positions: u32,
    uvs: u32,
    normals: u32,
}

/// One-based indices of a face's corner.
#[derive(Clone, Copy, Debug)]
struct Corner {
    position: u32,
    uv: Option<u32>,
    normal: Option<u32>,
}

/// Checks a face's corner.
fn corner(lines: &Lines, word: &str, defined: Defined) -> Result<Corner> {
    let mut parts = word.split('/');
    let position = parts.next().unwrap_or_default().parse::<i64>().ok();
    let mut index = || match parts.next() {
        None | Some("") => Some(None),
        Some(part) => part.parse::<i64>().ok().map(Some),
    };
    let (uv, normal) = (index(), index());
    let (Some(position), Some(uv), Some(normal), None) = (position, uv, normal, parts.next())
    else {
        let short: String = word.chars().take(40).collect();
        return Err(lines.error(
            format!("`{short}` is not a face's vertex"),
            "give vertex numbers, such as `f 1 2 3` or `f 1/1/1 2/2/1 3/3/1`",
        ));
    };
    Ok(Corner {
        position: absolute(lines, position, defined.positions, "vertex")?,
        uv: uv.map(|i| absolute(lines, i, defined.uvs, "texture coordinate")).transpose()?,
        normal: normal.map(|i| absolute(lines, i, defined.normals, "normal")).transpose()?,
    })
}

/// A one-based index into what was defined so far; negative ones count from its end.
fn absolute(lines: &Lines, index: i64, defined: u32, what: &str) -> Result<u32> {
    let absolute = if index < 0 { i64::from(defined).saturating_add(index) + 1 } else { index };
    if absolute < 1 || absolute > i64::from(defined) {
        let plural = if what == "vertex" { "vertices".to_owned() } else { format!("{what}s") };
        return Err(lines.error(
            format!("the face refers to {what} {index}, but {defined} are defined up to here"),
            format!(
                "number {plural} from 1 (or from -1 backwards), and define them before their faces"
            ),
        ));
    }
    Ok(absolute as u32)
}

/// Counts one more of `what`.
fn count(lines: &Lines, counter: &mut u32, what: &str) -> Result<()> {
    *counter = counter.checked_add(1).ok_or_else(|| {
        let problem = format!("the file has more than 4294967295 {what}");
        lines.error(problem, "split the model into several files")
    })?;
    Ok(())
}

/// At least so many finite numbers of up to three; the rest are 0.
fn numbers(lines: &Lines, text: &str, least: usize) -> Result<[f32; 3]> {
    let keyword = split_keyword(lines.line()).0;
    let text = text.split('#').next().unwrap_or_default();
    let mut numbers = [0.0; 3];
    let mut count = 0;
    for (number, word) in numbers.iter_mut().zip(text.split_whitespace()) {
        *number = word.parse().unwrap_or(f32::NAN);
        count += 1;
    }
    if count < least || !numbers.iter().all(|number| number.abs() <= MAX_COORDINATE) {
        return Err(lines.error(
            format!("`{keyword}` needs {least} or more finite numbers"),
            format!("write them, such as `{keyword}{}`", &" 0.5 0.5 0.5"[..4 * least]),
        ));
    }
    Ok(numbers)
}

fn write_record(out: &mut Vec<u8>, keyword: &str, words: &str) {
    out.extend_from_slice(keyword.as_bytes());
    out.push(b' ');
    out.extend_from_slice(words.as_bytes());
    out.push(b'\n');
}
