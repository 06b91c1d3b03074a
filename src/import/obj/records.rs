//! The records of a piece of an OBJ file.
//!
//! Pieces are read side by side. What came before one does not matter but for three things: how many
//! vertices there are, so that faces count from the right one; which libraries are named; and the
//! number of the first line, for errors. So a piece is first read as if enough came before it, and
//! notes how much it needs. Where it has less, or has an error, it is read once more, by then with
//! [`Before`] known, and this tells what is wrong.

use super::libraries::Library;
use super::numbers::{integer, numbers, position, shown, split_keyword, words};
use crate::base::error::Result;
use crate::base::math::Rgb;
use crate::import::lines::Lines;
use crate::import::text::decoded;
use glam::{Vec2, Vec3};
use std::path::Path;

/// Most material libraries that one file may name.
const MAX_LIBRARIES: usize = 1000;

/// Most unknown keywords that are told.
pub(super) const MAX_UNKNOWN: usize = 8;

/// Records that say nothing about triangles, besides the frequent ones.
const PASSED_OVER: &str = "vp mg cstype deg bmat step parm trim hole scrv sp end con bevel c_interp \
    d_interp lod usemap maplib shadow_obj trace_obj ctech stech";

/// What the records before a piece say.
#[derive(Clone, Debug, Default)]
pub(super) struct Before {
    pub lines: usize,
    /// Positions, texture coordinates and normals.
    pub defined: [u32; 3],
    pub libraries: Vec<Library>,
}

impl Before {
    /// As much as can be.
    pub fn enough() -> Self {
        Self { defined: [u32::MAX; 3], ..Self::default() }
    }
}

/// What the corners of a face tell besides positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Layout {
    pub uvs: bool,
    pub normals: bool,
}

impl Layout {
    /// Indices that each corner has.
    pub fn stride(self) -> usize {
        1 + usize::from(self.uvs) + usize::from(self.normals)
    }
}

/// Whatever changes the part that faces belong to, and the faces in between.
#[derive(Debug)]
pub(super) enum Item {
    /// Of an object or a group.
    Name(String),
    /// None is the one of what names none.
    Material(Option<String>),
    /// So many faces, with so many indices in all.
    Faces { layout: Layout, faces: usize, indices: usize },
}

/// What a piece of a file holds.
#[derive(Debug, Default)]
pub(super) struct Chunk {
    pub positions: Vec<Vec3>,
    /// Of the first positions; the others are white.
    pub colors: Vec<Rgb>,
    pub uvs: Vec<Vec2>,
    pub normals: Vec<Vec3>,
    pub items: Vec<Item>,
    /// Number of corners of each face.
    pub corners: Vec<u32>,
    /// Of all corners, counted from 0: the position, and what the layout has of the rest.
    pub indices: Vec<u32>,
    /// Which indices count from the first of their kind in this piece, modulo 2^32.
    pub relative: [Vec<u32>; 3],
    /// What must have been defined before this piece.
    pub needed: [u32; 3],
    /// Without those named before; lines count from the piece's first.
    pub libraries: Vec<Library>,
    pub ignored_elements: u64,
    /// References to texture coordinates and normals that do not exist.
    pub lost: u64,
    /// Texture coordinates and normals that are no numbers.
    pub mended: u64,
    /// The first unknown keywords, and the lines where they first appear, counted the same way.
    pub unknown: Vec<(String, usize)>,
    pub lines: usize,
}

impl Chunk {
    /// Whether it is right as it was read, if this came before it.
    pub fn fits(&self, before: &Before) -> bool {
        let is_new = |library: &&Library| before.libraries.iter().all(|l| l.names != library.names);
        self.needed.iter().zip(before.defined).all(|(needed, defined)| *needed <= defined)
            && before.libraries.len() + self.libraries.iter().filter(is_new).count()
                <= MAX_LIBRARIES
    }

    fn defined(&self) -> [usize; 3] {
        [self.positions.len(), self.uvs.len(), self.normals.len()]
    }
}

/// Reads a piece of a file.
pub(super) fn parse(path: &Path, text: &[u8], before: &Before) -> Result<Chunk> {
    let lines = Lines::new(path, text, before.lines);
    let mut parser = Parser { lines, before, chunk: Chunk::default(), face: Vec::new() };
    while parser.lines.advance()? {
        parser.record()?;
    }
    parser.chunk.lines = parser.lines.count() - before.lines;
    Ok(parser.chunk)
}

struct Parser<'a> {
    lines: Lines<'a>,
    before: &'a Before,
    chunk: Chunk,
    /// Corners of the current face.
    face: Vec<[Index; 3]>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Index {
    None,
    /// Counted from the file's first.
    Absolute(u32),
    /// Counted from the piece's first, modulo 2^32.
    Relative(u32),
}

impl Parser<'_> {
    fn record(&mut self) -> Result<()> {
        let Self { lines, chunk, .. } = self;
        let (keyword, rest) = split_keyword(lines.bytes());
        match keyword {
            b"v" => {
                let (position, color) = position(lines, rest)?;
                if let Some(color) = color {
                    chunk.colors.resize(chunk.positions.len(), Rgb::ONE);
                    chunk.colors.push(color);
                }
                chunk.positions.push(position);
            }
            b"vt" => {
                let ([u, v, _], mended) = numbers(lines, rest, 1)?;
                chunk.uvs.push(Vec2::new(u, v));
                chunk.mended += mended;
            }
            b"vn" => {
                let (normal, mended) = numbers(lines, rest, 3)?;
                chunk.normals.push(normal.into());
                chunk.mended += mended;
            }
            b"f" => self.face()?,
            b"o" | b"g" => {
                let name = Item::Name(text(rest));
                match chunk.items.last_mut() {
                    _ if rest.is_empty() => {}
                    // Of several without faces the last counts.
                    Some(last @ Item::Name(_)) => *last = name,
                    _ => chunk.items.push(name),
                }
            }
            b"usemtl" => {
                chunk.items.push(Item::Material((!rest.is_empty()).then(|| text(rest))));
            }
            b"mtllib" => self.library()?,
            b"p" | b"l" | b"curv" | b"curv2" | b"surf" => chunk.ignored_elements += 1,
            b"" | b"s" | [b'#', ..] => {}
            known if PASSED_OVER.split(' ').any(|word| word.as_bytes() == known) => {}
            unknown => {
                let word = text(unknown);
                self.pass_over(&word);
            }
        }
        Ok(())
    }

    /// Takes note of a record that says nothing. A note is for people: the first few will do.
    fn pass_over(&mut self, word: &str) {
        let word: String = word.chars().take(24).collect();
        let unknown = &mut self.chunk.unknown;
        if unknown.len() < MAX_UNKNOWN && unknown.iter().all(|(known, _)| *known != word) {
            unknown.push((word, self.lines.number() - self.before.lines));
        }
    }

    fn library(&mut self) -> Result<()> {
        let Self { lines, chunk, before, .. } = self;
        let names = text(split_keyword(lines.bytes()).1);
        if names.is_empty() {
            self.pass_over("mtllib without a name");
            return Ok(());
        }
        if before.libraries.iter().chain(&chunk.libraries).any(|known| known.names == names) {
            return Ok(());
        }
        // Far more than any exporter writes; each is looked for among those before it.
        if before.libraries.len() + chunk.libraries.len() == MAX_LIBRARIES {
            let problem = format!("more than {MAX_LIBRARIES} material libraries");
            return Err(lines.error(problem, "join them into fewer MTL files"));
        }
        chunk.libraries.push(Library { names, line: lines.number() - before.lines });
        Ok(())
    }

    /// A polygon: at least three corners `position/texture/normal`, of which the last two count if
    /// all corners have them.
    fn face(&mut self) -> Result<()> {
        self.face.clear();
        let Self { lines, before, chunk, face } = self;
        for word in words(split_keyword(lines.bytes()).1) {
            if word.starts_with(b"#") {
                break;
            }
            face.push(corner(lines, word, before, chunk)?);
        }
        if face.is_empty() {
            let advice = "give at least three vertices, such as `f 1 2 3`";
            return Err(lines.error("the face has no vertices", advice));
        }
        if face.len() < 3 {
            chunk.ignored_elements += 1;
            return Ok(());
        }
        let layout = Layout {
            uvs: face.iter().all(|corner| corner[1] != Index::None),
            normals: face.iter().all(|corner| corner[2] != Index::None),
        };
        let counts = [true, layout.uvs, layout.normals];
        for corner in face.iter() {
            for (kind, index) in corner.iter().enumerate().filter(|(kind, _)| counts[*kind]) {
                match *index {
                    Index::None => {}
                    Index::Absolute(index) => chunk.indices.push(index),
                    Index::Relative(index) => {
                        chunk.relative[kind].push(chunk.indices.len() as u32);
                        chunk.indices.push(index);
                    }
                }
            }
        }
        chunk.corners.push(face.len() as u32);
        let added = face.len() * layout.stride();
        match chunk.items.last_mut() {
            Some(Item::Faces { layout: last, faces, indices }) if *last == layout => {
                *faces += 1;
                *indices += added;
            }
            _ => chunk.items.push(Item::Faces { layout, faces: 1, indices: added }),
        }
        Ok(())
    }
}

fn text(bytes: &[u8]) -> String {
    decoded(bytes).into_owned()
}

/// A face's corner.
fn corner(
    lines: &Lines<'_>,
    word: &[u8],
    before: &Before,
    chunk: &mut Chunk,
) -> Result<[Index; 3]> {
    let mut parts = word.split(|byte| *byte == b'/');
    let mut numbers = [Some(None); 3];
    for (number, part) in numbers.iter_mut().zip(&mut parts) {
        *number = if part.is_empty() { Some(None) } else { integer(part).map(Some) };
    }
    let ([Some(Some(position)), Some(uv), Some(normal)], None) = (numbers, parts.next()) else {
        return Err(lines.error(
            format!("`{}` is not a face's vertex", shown(word)),
            "give vertex numbers, such as `f 1 2 3` or `f 1/1/1 2/2/1 3/3/1`",
        ));
    };
    let mut corner = [Index::None; 3];
    for (kind, number) in [Some(position), uv, normal].into_iter().enumerate() {
        if let Some(number) = number {
            corner[kind] = index(lines, number, kind, before, chunk)?;
        }
    }
    Ok(corner)
}

/// A one-based number among what was defined so far; negative ones count from its end. Kinds are positions,
/// texture coordinates and normals; of the last two it is none where there is no such one.
fn index(
    lines: &Lines<'_>,
    number: i64,
    kind: usize,
    before: &Before,
    chunk: &mut Chunk,
) -> Result<Index> {
    let here = chunk.defined()[kind] as i64;
    let needed = match number {
        0 => i64::MAX,
        1.. => number - here,
        _ => 0_i64.saturating_sub(here + number),
    };
    let available = i64::from(before.defined[kind]);
    if needed > available && kind > 0 {
        // The face goes without, as other programs have it.
        chunk.lost += 1;
        return Ok(Index::None);
    }
    if needed > available {
        let defined = available + here;
        return Err(lines.error(
            format!("the face refers to vertex {number}, but {defined} are defined up to here"),
            "number vertices from 1 (or from -1 backwards), and define them before their faces",
        ));
    }
    chunk.needed[kind] = chunk.needed[kind].max(needed.max(0) as u32);
    Ok(match number {
        1.. => Index::Absolute((number - 1) as u32),
        _ => Index::Relative((here + number) as u32),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_unknown_words_few_are_kept() {
        let words: String = (0..1000).map(|i| format!("x{i} 1\n")).collect();
        let unknown =
            parse(Path::new("a.obj"), words.as_bytes(), &Before::enough()).unwrap().unknown;
        let first = (0..MAX_UNKNOWN).map(|i| (format!("x{i}"), i + 1));
        assert!(unknown.iter().cloned().eq(first), "{unknown:?}");
    }
}
