//! The triangles of a primitive: indices and attributes as a mesh.

use super::accessor::Reader;
use super::buffers::Buffers;
use super::fault;
use super::json::{Document, Primitive, get};
use super::pose::Pose;
use super::texture::UvSource;
use crate::base::error::Result;
use crate::base::math::Rgb;
use crate::scene::Mesh;
use crate::scene::transform::MAX_COORDINATE;
use glam::{Vec2, Vec3};
use std::fmt::Display;

/// How indices make triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Triangles,
    Strip,
    Fan,
}

impl Mode {
    /// `None` for points and lines.
    fn of(primitive: &Primitive, place: impl Display) -> Result<Option<Self>> {
        Ok(match primitive.mode {
            0..=3 => None,
            4 => Some(Self::Triangles),
            5 => Some(Self::Strip),
            6 => Some(Self::Fan),
            mode => return Err(fault(place, format!("unknown mode {mode}"))),
        })
    }

    /// Triangles of so many indices.
    fn count(self, indices: u64) -> u64 {
        match self {
            Self::Triangles => indices / 3,
            Self::Strip | Self::Fan => indices.saturating_sub(2),
        }
    }

    /// Places of the indices of a triangle; fronts are on the same side all along a strip.
    fn corners(self, triangle: u64) -> [u64; 3] {
        let (i, odd) = (triangle, triangle % 2);
        match self {
            Self::Triangles => [3 * i, 3 * i + 1, 3 * i + 2],
            Self::Strip => [i, i + 1 + odd, i + 2 - odd],
            Self::Fan => [i + 1, i + 2, 0],
        }
    }
}

/// The accessor that counts corners: that of indices, else that of positions.
fn corner_accessor(primitive: &Primitive, place: impl Display) -> Result<usize> {
    let position = primitive.attributes.get("POSITION").copied();
    let position = position.ok_or_else(|| fault(place, "attributes.POSITION is missing"))?;
    Ok(primitive.indices.unwrap_or(position))
}

/// Number of triangles of a primitive; `None` for points and lines.
pub(super) fn triangle_count(
    document: &Document,
    primitive: &Primitive,
    place: &str,
) -> Result<Option<u64>> {
    let Some(mode) = Mode::of(primitive, place)? else { return Ok(None) };
    let index = corner_accessor(primitive, place)?;
    let accessor = get(&document.accessors, "accessors", index, place)?;
    Ok(Some(mode.count(accessor.count)))
}

/// What a material needs of its meshes besides their shape. Nothing else is read: surfaces on which
/// nothing varies are rendered faster.
pub(super) struct Wanted<'a> {
    /// Where texture coordinates come from.
    pub uv_source: Option<&'a UvSource>,
    /// Whether tangents count, if there are any.
    pub tangents: bool,
    /// Whether colors of vertices count.
    pub colors: bool,
    /// What becomes of the shape.
    pub pose: &'a Pose,
}

/// The mesh of a primitive of triangles, with the vertices that it uses, for many primitives may share
/// the accessors of all vertices; empty for points and lines.
pub(super) fn read(
    document: &Document,
    buffers: &Buffers,
    primitive: &Primitive,
    wanted: &Wanted,
    place: &str,
) -> Result<Mesh> {
    let Some(mode) = Mode::of(primitive, place)? else { return Ok(Mesh::default()) };
    let open = |index, kind, at: &str| Reader::open(document, buffers, index, kind, at);
    let attribute = |name: &str, kind| {
        let at = format!("{place}.attributes.{name}");
        let index = primitive.attributes.get(name);
        let reader = index.map(|index| open(*index, kind, &at)).transpose()?;
        Ok(reader.map(|reader| (reader, at)))
    };
    corner_accessor(primitive, place)?;
    let Some((positions, at)) = attribute("POSITION", "VEC3")? else { return Ok(Mesh::default()) };
    if positions.count > u64::from(u32::MAX) {
        return Err(fault(at, format!("there are more than {} vertices", u32::MAX)));
    }
    let mut triangles = match primitive.indices {
        None => {
            let corners = (0..mode.count(positions.count)).map(|i| mode.corners(i));
            // Less than the count, which fits.
            corners.map(|corners| corners.map(|corner| corner as u32)).collect()
        }
        Some(index) => {
            let at = format!("{place}.indices");
            let indices = open(index, "SCALAR", &at)?;
            if !indices.counts() {
                return Err(fault(at, "indices must be unsigned integers"));
            }
            indexed(mode, &indices, positions.count, &at)?
        }
    };
    let used = compact(&mut triangles);
    let of_vertices = |name: &str, kind| match attribute(name, kind)? {
        Some((reader, at)) if reader.count < positions.count => {
            let (count, vertices) = (reader.count, positions.count);
            Err(fault(at, format!("{count} elements for {vertices} vertices")))
        }
        found => Ok(found),
    };
    let normals = of_vertices("NORMAL", "VEC3")?;
    let uvs = match wanted.uv_source {
        None => None,
        Some(source) => of_vertices(&format!("TEXCOORD_{}", source.set), "VEC2")?
            .map(|(uvs, at)| (uvs, at, source)),
    };
    let tangents = match (wanted.tangents, wanted.uv_source) {
        (true, Some(source)) if source.keeps_tangents() => of_vertices("TANGENT", "VEC4")?,
        _ => None,
    };
    let mut mesh = Mesh { triangles, ..Mesh::default() };
    mesh.positions = finite(&positions, &used, &at)?.map(Vec3::from_array).collect();
    if let Some((normals, _)) = &normals {
        // Those that are not finite become zero when they are turned, and give way to the triangle's.
        let normal = |vertex: &u32| Vec3::from_array(normals.numbers((*vertex).into()));
        mesh.normals = used.iter().map(normal).collect();
    }
    if let Some((uvs, at, source)) = &uvs {
        let uvs = finite(uvs, &used, at)?.map(Vec2::from_array);
        mesh.uvs = uvs.map(|uv| source.apply(uv)).collect();
    }
    if let Some((tangents, _)) = &tangents {
        // As for normals; which way `v` grows, in the fourth number, texture coordinates tell.
        let tangent = |vertex: &u32| {
            let [x, y, z, _] = tangents.numbers((*vertex).into());
            Vec3::new(x, y, z)
        };
        mesh.tangents = used.iter().map(tangent).collect();
    }
    if wanted.colors {
        mesh.colors = colors(document, buffers, primitive, (&used, positions.count), place)?;
    }
    wanted.pose.apply(document, buffers, primitive, (&mut mesh, &used), place)?;
    Ok(mesh)
}

/// Whether the colors of any vertices are translucent.
pub(super) fn has_translucent_colors(
    document: &Document,
    buffers: &Buffers,
    primitive: &Primitive,
    place: &str,
) -> Result<bool> {
    let at = format!("{place}.attributes.COLOR_0");
    let Some(index) = primitive.attributes.get("COLOR_0") else { return Ok(false) };
    if get(&document.accessors, "accessors", *index, &at)?.kind != "VEC4" {
        return Ok(false);
    }
    let colors = Reader::open(document, buffers, *index, "VEC4", &at)?;
    Ok((0..colors.count).any(|vertex| colors.numbers::<4>(vertex)[3] < 1.0))
}

/// The colors of the vertices `used`, with or without opacity; none where all are white.
fn colors(
    document: &Document,
    buffers: &Buffers,
    primitive: &Primitive,
    (used, vertices): (&[u32], u64),
    place: &str,
) -> Result<Vec<Rgb>> {
    let at = format!("{place}.attributes.COLOR_0");
    let Some(index) = primitive.attributes.get("COLOR_0") else { return Ok(Vec::new()) };
    let with_opacity = get(&document.accessors, "accessors", *index, &at)?.kind == "VEC4";
    let kind = if with_opacity { "VEC4" } else { "VEC3" };
    let colors = Reader::open(document, buffers, *index, kind, &at)?;
    if colors.count < vertices {
        return Err(fault(at, format!("{} elements for {vertices} vertices", colors.count)));
    }
    let color = |vertex: &u32| {
        let [r, g, b] = match with_opacity {
            true => {
                colors.numbers::<4>((*vertex).into()).first_chunk().copied().unwrap_or_default()
            }
            false => colors.numbers::<3>((*vertex).into()),
        };
        let share = |value: f32| if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) };
        Rgb::from_array([r, g, b].map(share))
    };
    let colors: Vec<Rgb> = used.iter().map(color).collect();
    Ok(if colors.iter().all(|color| *color == Rgb::ONE) { Vec::new() } else { colors })
}

/// The triangles of a primitive with indices, all less than `vertices`.
fn indexed(mode: Mode, indices: &Reader, vertices: u64, place: &str) -> Result<Vec<[u32; 3]>> {
    let check = |at: u64| {
        let index = indices.index(at);
        if u64::from(index) < vertices {
            return Ok(index);
        }
        Err(fault(place, format!("index {index} at place {at}, but there are {vertices} vertices")))
    };
    let triangle = |i: u64| {
        let [a, b, c] = mode.corners(i);
        Ok([check(a)?, check(b)?, check(c)?])
    };
    (0..mode.count(indices.count)).map(triangle).collect()
}

/// Numbers the vertices anew by their first use, without those that are not used; returns their former
/// indices.
fn compact(triangles: &mut [[u32; 3]]) -> Vec<u32> {
    let mut used = triangles.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    // They ascend without a gap if the last has its own number.
    let dense = used.last().is_none_or(|last| *last as usize + 1 == used.len());
    let mut numbers = vec![u32::MAX; used.len()];
    let mut order = Vec::with_capacity(used.len());
    for corner in triangles.as_flattened_mut() {
        let vertex = *corner;
        let rank = if dense { vertex as usize } else { used.partition_point(|v| *v < vertex) };
        if numbers[rank] == u32::MAX {
            numbers[rank] = order.len() as u32;
            order.push(vertex);
        }
        *corner = numbers[rank];
    }
    order
}

/// The elements of `used`, of numbers up to [`MAX_COORDINATE`].
fn finite<const N: usize>(
    reader: &Reader,
    used: &[u32],
    place: &str,
) -> Result<impl Iterator<Item = [f32; N]>> {
    let numbers = |vertex: &u32| {
        let numbers: [f32; N] = reader.numbers((*vertex).into());
        if numbers.iter().all(|number| number.abs() <= MAX_COORDINATE) {
            return Ok(numbers);
        }
        let problem = format!("element {vertex} is not finite or beyond {MAX_COORDINATE:e}");
        Err(fault(place, problem))
    };
    Ok(used.iter().map(numbers).collect::<Result<Vec<_>>>()?.into_iter())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_their_fronts() {
        let all = |mode: Mode, indices| -> Vec<[u64; 3]> {
            (0..mode.count(indices)).map(|i| mode.corners(i)).collect()
        };
        assert_eq!(all(Mode::Triangles, 7), [[0, 1, 2], [3, 4, 5]]);
        assert_eq!(all(Mode::Strip, 5), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
        assert_eq!(all(Mode::Fan, 5), [[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
        for mode in [Mode::Triangles, Mode::Strip, Mode::Fan] {
            assert_eq!((mode.count(0), mode.count(2), mode.count(3)), (0, 0, 1));
        }
    }

    #[test]
    fn vertices_are_numbered_by_their_first_use() {
        let mut triangles = [[7, 3, 9], [9, 3, 4]];
        assert_eq!(compact(&mut triangles), [7, 3, 9, 4]);
        assert_eq!(triangles, [[0, 1, 2], [2, 1, 3]]);
        let mut all = [[0, 2, 1]];
        assert_eq!((compact(&mut all), all), (vec![0, 2, 1], [[0, 1, 2]]));
        assert!(compact(&mut []).is_empty());
    }
}
