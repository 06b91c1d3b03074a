//! Meshes in Mitsuba's own format: zlib streams, one for each shape, and a table of their offsets.

use crate::far::DBounds;
use crate::text::read_bytes;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::memory::available_memory;
use bdpm_core::scene::Mesh;
use flate2::read::ZlibDecoder;
use glam::{DVec3, Vec2, Vec3};
use std::io::{BufReader, Read};
use std::path::Path;

/// The first two bytes of a shape.
const MAGIC: u16 = 0x041c;
// Flags of a mesh.
const NORMALS: u32 = 1;
const UVS: u32 = 2;
const COLORS: u32 = 8;
/// No smooth normals.
const FLAT: u32 = 16;
/// Numbers of 64 bits.
const DOUBLE: u32 = 0x2000;
/// Maximum length of the name of a shape, bytes.
const MAX_NAME: usize = 1 << 16;
/// Largest accepted file, bytes.
const MAX_FILE: u64 = 1 << 34;

/// A shape of a file.
pub(super) struct SerializedShape {
    /// Texture coordinates have v pointing up.
    pub mesh: Mesh,
    /// Point to which all positions are relative: zero unless they are far from the origin.
    pub origin: DVec3,
    /// Whether the mesh must not get smooth normals.
    pub is_flat: bool,
}

/// Reads the shape of this index.
///
/// # Errors
/// Names the file and its problem.
pub(super) fn read(path: &Path, index: usize) -> Result<SerializedShape> {
    parse(&read_bytes(path, MAX_FILE)?, index).map_err(|problem| {
        let problem = format!("cannot read it as a file of serialized meshes: {problem}");
        Error::new(problem, "export the mesh again, or as .ply").at(path)
    })
}

/// Results whose error is the problem in words.
type Parsed<T> = std::result::Result<T, String>;

fn parse(bytes: &[u8], index: usize) -> Parsed<SerializedShape> {
    let begin = offset(bytes, index)?;
    let head = bytes.get(begin..begin.saturating_add(4)).ok_or("it ends early")?;
    let [magic, version] = [0, 2].map(|at| u16::from_le_bytes([head[at], head[at + 1]]));
    if magic != MAGIC || !matches!(version, 3 | 4) {
        let found = format!("it begins with {magic:#06x}, version {version}");
        return Err(format!("{found}, not 0x041c and 3 or 4"));
    }
    let mut stream = ShapeStream(BufReader::new(ZlibDecoder::new(&bytes[begin + 4..])));
    let flags = u32::from_le_bytes(stream.array()?);
    if version == 4 {
        let mut rest = 0..MAX_NAME;
        while stream.array::<1>()? != [0] {
            rest.next().ok_or("the name of a shape has no end")?;
        }
    }
    let vertices = stream.count()?;
    let triangles = stream.count()?;
    let number = if flags & DOUBLE != 0 { 8 } else { 4 };
    let optional = [(NORMALS, 3), (UVS, 2), (COLORS, 3)].into_iter();
    let numbers: usize = optional.filter(|(flag, _)| flags & flag != 0).map(|(_, n)| n).sum();
    let needed = vertices as f64 * ((3 + numbers) * number) as f64 + triangles as f64 * 12.0;
    if available_memory().is_some_and(|available| 2.0 * needed > available) {
        return Err(format!("{vertices} vertices and {triangles} triangles are too many"));
    }
    let mut list = |size: usize| stream.numbers(vertices, size, flags & DOUBLE != 0);
    let positions = list(3)?;
    let positions = positions.as_chunks::<3>().0.iter().copied().map(DVec3::from_array);
    let bounds = positions.clone().fold(DBounds::EMPTY, DBounds::with);
    let origin = bounds.far_center_of_part().unwrap_or(DVec3::ZERO);
    let positions = positions.map(|point| (point - origin).as_vec3()).collect();
    let mut mesh = Mesh { positions, ..Mesh::default() };
    if flags & NORMALS != 0 {
        let normals = list(3)?;
        let normals = normals.chunks_exact(3).map(|n| DVec3::from_slice(n).as_vec3());
        mesh.normals = normals.map(Vec3::normalize_or_zero).collect();
    }
    if flags & UVS != 0 {
        let uvs = list(2)?;
        let uv = |uv: &[f64]| Vec2::new(uv[0] as f32, 1.0 - uv[1] as f32);
        mesh.uvs = uvs.chunks_exact(2).map(uv).collect();
    }
    if flags & COLORS != 0 {
        list(3)?;
    }
    for triangle in 0..triangles {
        let mut corner = || Ok::<_, String>(u32::from_le_bytes(stream.array()?));
        let corners = [corner()?, corner()?, corner()?];
        if let Some(bad) = corners.iter().find(|corner| **corner as usize >= vertices) {
            return Err(format!("triangle {triangle} uses vertex {bad} of {vertices}"));
        }
        mesh.triangles.push(corners);
    }
    Ok(SerializedShape { mesh, origin, is_flat: flags & FLAT != 0 })
}

/// Offset of the shape of this index, bytes. The file ends with a table of offsets and the number
/// of shapes.
fn offset(bytes: &[u8], index: usize) -> Parsed<usize> {
    if index == 0 {
        return Ok(0);
    }
    let (_, tail) = bytes.split_last_chunk::<4>().ok_or("it ends early")?;
    let count = u32::from_le_bytes(*tail) as usize;
    if index >= count {
        return Err(format!("there is no shape {index} of {count}"));
    }
    let is_wide = bytes.get(2..4) == Some(&[4, 0]);
    let size = if is_wide { 8 } else { 4 };
    let at = (bytes.len() - 4).checked_sub(size * (count - index)).ok_or("it ends early")?;
    let mut number = [0; 8];
    number[..size].copy_from_slice(&bytes[at..at + size]);
    usize::try_from(u64::from_le_bytes(number)).map_err(|e| e.to_string())
}

/// The numbers in a compressed stream.
struct ShapeStream<'a>(BufReader<ZlibDecoder<&'a [u8]>>);

impl ShapeStream<'_> {
    fn array<const N: usize>(&mut self) -> Parsed<[u8; N]> {
        let mut bytes = [0; N];
        self.0.read_exact(&mut bytes).map_err(|e| e.to_string())?;
        Ok(bytes)
    }

    fn count(&mut self) -> Parsed<usize> {
        let count = u64::from_le_bytes(self.array()?);
        let fits = u32::try_from(count).map(|count| count as usize);
        fits.map_err(|_| format!("{count} are too many"))
    }

    /// Reads `count` groups of `size` numbers. Memory grows with the content of the stream only.
    fn numbers(&mut self, count: usize, size: usize, is_double: bool) -> Parsed<Vec<f64>> {
        let mut numbers = Vec::new();
        for _ in 0..count * size {
            numbers.push(match is_double {
                true => f64::from_le_bytes(self.array()?),
                false => f64::from(f32::from_le_bytes(self.array()?)),
            });
        }
        Ok(numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::ZlibEncoder;
    use std::io::Write;

    /// A file of triangles, each with its own name, of version 3 or 4.
    fn file(version: u16, heights: &[f32]) -> Vec<u8> {
        let (mut bytes, mut offsets) = (Vec::new(), Vec::new());
        for height in heights {
            offsets.push(bytes.len() as u64);
            bytes.extend(MAGIC.to_le_bytes());
            bytes.extend(version.to_le_bytes());
            let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
            let mut put = |bytes: &[u8]| encoder.write_all(bytes).unwrap();
            put(&(UVS | FLAT | 0x1000).to_le_bytes());
            if version == 4 {
                put(b"a name\0");
            }
            put(&3_u64.to_le_bytes());
            put(&1_u64.to_le_bytes());
            for number in [0.0, 0.0, *height, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
                put(&f32::to_le_bytes(number));
            }
            [0.0_f32, 0.25, 1.0, 0.0, 0.0, 1.0].iter().for_each(|uv| put(&uv.to_le_bytes()));
            [0_u32, 1, 2].iter().for_each(|corner| put(&corner.to_le_bytes()));
            bytes.extend(encoder.finish().unwrap());
        }
        for offset in &offsets {
            let size = if version == 4 { 8 } else { 4 };
            bytes.extend(&offset.to_le_bytes()[..size]);
        }
        bytes.extend((offsets.len() as u32).to_le_bytes());
        bytes
    }

    #[test]
    fn shapes_are_found_by_their_index() {
        for version in [3, 4] {
            let bytes = file(version, &[0.0, 5.0, 7.0]);
            for (index, height) in [0.0, 5.0, 7.0].into_iter().enumerate() {
                let SerializedShape { mesh, is_flat, .. } = parse(&bytes, index).unwrap();
                assert_eq!(mesh.positions, [Vec3::new(0.0, 0.0, height), Vec3::X, Vec3::Y]);
                assert_eq!(mesh.uvs[0], Vec2::new(0.0, 0.75));
                assert_eq!(mesh.triangles, [[0, 1, 2]]);
                assert!(is_flat && mesh.normals.is_empty());
            }
            assert!(parse(&bytes, 3).err().unwrap().contains("no shape 3 of 3"));
        }
    }

    #[test]
    fn truncated_or_foreign_files_are_refused() {
        let bytes = file(4, &[1.0]);
        for length in 0..bytes.len() - 20 {
            assert!(parse(&bytes[..length], 0).is_err(), "{length}");
        }
        assert!(parse(b"PK\x03\x04", 0).is_err());
    }
}
