//! Faces of an OBJ file in the dialect of `tobj`: all indices are valid and count from the first
//! record.

use super::{Normalizer, shown, words};
use crate::lines::Lines;
use bdpm_core::base::error::Result;
use std::io::Write;

/// Attributes that all corners of a face have besides positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Format {
    pub uvs: bool,
    pub normals: bool,
}

/// Common properties of all faces of one mesh.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Part {
    /// Name of the object or group.
    pub name: String,
    /// Name that `usemtl` gives.
    pub material: Option<String>,
    pub(super) format: Format,
}

impl Normalizer {
    /// A polygon. Texture coordinates or normals count only if all its corners have them.
    pub(super) fn face(&mut self, lines: &Lines<'_>, rest: &[u8]) -> Result<()> {
        self.face.clear();
        let mut is_verbatim = true;
        for word in words(rest) {
            let numbers = corner(word).ok_or_else(|| {
                lines.error(
                    format!("`{}` is not a face's vertex", shown(word)),
                    "give vertex numbers, such as `f 1 2 3` or `f 1/1/1 2/2/1 3/3/1`",
                )
            })?;
            let (indices, is_plain) = self.indices(lines, numbers)?;
            is_verbatim &= is_plain;
            self.face.push(indices);
        }
        if self.face.is_empty() {
            let advice = "give at least three vertices, such as `f 1 2 3`";
            return Err(lines.error("the face has no vertices", advice));
        }
        if self.face.len() < 3 {
            self.result.ignored_elements += 1;
            return Ok(());
        }
        self.corner_count += self.face.len();
        if u32::try_from(self.corner_count).is_err() {
            let problem = format!("the faces have more than {} corners", u32::MAX);
            return Err(lines.error(problem, "split the model into several files"));
        }
        let count = self.face.len();
        let [uvs, normals] =
            [1, 2].map(|kind| self.face.iter().filter(|corner| corner[kind] > 0).count());
        let format = Format { uvs: uvs == count, normals: normals == count };
        self.result.unsmoothed += u64::from(self.is_smooth && !format.normals);
        is_verbatim &= (uvs == 0 || format.uvs) && (normals == 0 || format.normals);
        self.write_face(format, is_verbatim.then_some(rest));
        Ok(())
    }

    /// The valid indices of a corner, and whether its numbers are these indices. Missing attributes
    /// have the index 0.
    fn indices(
        &mut self,
        lines: &Lines<'_>,
        numbers: [Option<i64>; 3],
    ) -> Result<([i64; 3], bool)> {
        let (mut indices, mut is_plain) = ([0; 3], true);
        for (kind, number) in numbers.into_iter().enumerate() {
            let Some(number) = number else { continue };
            is_plain &= number > 0;
            let defined = self.defined[kind];
            let index = if number < 0 { defined + 1 + number } else { number };
            if (1..=defined).contains(&index) {
                indices[kind] = index;
            } else if kind > 0 {
                // Other programs ignore the reference, too.
                self.result.invalid_references += 1;
                is_plain = false;
            } else {
                let problem = format!("the face refers to vertex {number}, but {defined}");
                let advice = "number vertices from 1 (or from -1 backwards), and define them \
                              before their faces";
                return Err(lines.error(problem + " are defined up to here", advice));
            }
        }
        Ok((indices, is_plain))
    }

    /// Writes the current face, which may be as it is in the file.
    fn write_face(&mut self, format: Format, verbatim: Option<&[u8]>) {
        let index = self.part(format);
        let Self { face, text, faces, .. } = self;
        let faces = if index == 0 { text } else { &mut faces[index] };
        faces.push(b'f');
        if let Some(verbatim) = verbatim {
            faces.push(b' ');
            faces.extend_from_slice(verbatim);
        } else {
            for &[position, uv, normal] in &*face {
                let _ = match (format.uvs, format.normals) {
                    (false, false) => write!(faces, " {position}"),
                    (true, false) => write!(faces, " {position}/{uv}"),
                    (false, true) => write!(faces, " {position}//{normal}"),
                    (true, true) => write!(faces, " {position}/{uv}/{normal}"),
                };
            }
        }
        faces.push(b'\n');
    }

    /// Index of the part that the next face of this format belongs to.
    fn part(&mut self, format: Format) -> usize {
        if let Some((last, index)) = self.current
            && last == format
        {
            return index;
        }
        let part = Part { name: self.name.clone(), material: self.material.clone(), format };
        let index = *self.part_index.entry(part).or_insert_with_key(|part| {
            self.result.parts.push(part.clone());
            self.faces.push(Vec::new());
            self.faces.len() - 1
        });
        self.current = Some((format, index));
        index
    }
}

/// The numbers of a face's corner: position, texture coordinates and normal.
fn corner(word: &[u8]) -> Option<[Option<i64>; 3]> {
    let mut numbers = [None; 3];
    for (kind, part) in word.split(|byte| *byte == b'/').enumerate() {
        let number = numbers.get_mut(kind)?;
        if !part.is_empty() {
            *number = Some(std::str::from_utf8(part).ok()?.parse().ok()?);
        }
    }
    numbers[0].map(|_| numbers)
}
