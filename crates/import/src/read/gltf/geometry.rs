//! The triangles of a primitive: indices and attributes as a mesh.

use super::accessor::AccessorReader;
use super::buffers::Buffers;
use super::json::{GltfDocument, Primitive, get};
use super::malformed;
use super::pose::Pose;
use super::texture::UvSource;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::Mesh;
use bdpm_core::scene::transform::MAX_COORDINATE;
use glam::{Vec2, Vec3};

/// How indices make triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Topology {
    Triangles,
    Strip,
    Fan,
}

impl Topology {
    /// The topology of a primitive; `None` for points and lines.
    fn of(primitive: &Primitive, element: &str) -> Result<Option<Self>> {
        Ok(match primitive.mode {
            0..=3 => None,
            4 => Some(Self::Triangles),
            5 => Some(Self::Strip),
            6 => Some(Self::Fan),
            mode => return Err(malformed(element, format!("unknown mode {mode}"))),
        })
    }

    /// Number of triangles of this many indices.
    fn count(self, indices: u64) -> u64 {
        match self {
            Self::Triangles => indices / 3,
            Self::Strip | Self::Fan => indices.saturating_sub(2),
        }
    }

    /// Ranks of the indices of a triangle. Fronts are on the same side all along a strip.
    fn corners(self, triangle: u64) -> [u64; 3] {
        let (i, odd) = (triangle, triangle % 2);
        match self {
            Self::Triangles => [3 * i, 3 * i + 1, 3 * i + 2],
            Self::Strip => [i, i + 1 + odd, i + 2 - odd],
            Self::Fan => [i + 1, i + 2, 0],
        }
    }
}

/// The accessor that counts corners: that of the indices, else that of the positions.
fn corner_accessor(primitive: &Primitive, element: &str) -> Result<usize> {
    let position = primitive.attributes.get("POSITION").copied();
    let position = position.ok_or_else(|| malformed(element, "attributes.POSITION is missing"))?;
    Ok(primitive.indices.unwrap_or(position))
}

/// Number of triangles of a primitive; `None` for points and lines.
pub(super) fn triangle_count(
    document: &GltfDocument,
    primitive: &Primitive,
    element: &str,
) -> Result<Option<u64>> {
    let Some(topology) = Topology::of(primitive, element)? else { return Ok(None) };
    let index = corner_accessor(primitive, element)?;
    let accessor = get(&document.accessors, "accessors", index, element)?;
    Ok(Some(topology.count(accessor.count)))
}

/// The properties that a material needs of its meshes besides their shape. Nothing else is read,
/// because surfaces on which nothing varies are rendered faster.
pub(super) struct MeshRequest<'a> {
    /// Source of the texture coordinates.
    pub uv_source: Option<&'a UvSource>,
    /// Whether tangents are used, if there are any.
    pub tangents: bool,
    /// Whether colors of vertices are used.
    pub colors: bool,
    /// The pose that moves the vertices.
    pub pose: &'a Pose,
}

/// A primitive with the buffers of its accessors.
pub(super) struct PrimitiveReader<'a> {
    pub buffers: &'a Buffers<'a>,
    pub primitive: &'a Primitive,
    /// The JSON element, such as `meshes[0].primitives[1]`.
    pub element: &'a str,
}

impl PrimitiveReader<'_> {
    /// Opens the accessor of an attribute, if the primitive has the attribute.
    pub fn attribute(&self, name: &str, kind: &str) -> Result<Option<AccessorReader<'_>>> {
        let open = |index: &usize| {
            let element = format!("{}.attributes.{name}", self.element);
            AccessorReader::open(self.buffers, *index, kind, element)
        };
        self.primitive.attributes.get(name).map(open).transpose()
    }

    /// Opens the accessor of an attribute that must have an item for each vertex.
    fn of_vertices(
        &self,
        name: &str,
        kind: &str,
        vertices: u64,
    ) -> Result<Option<AccessorReader<'_>>> {
        match self.attribute(name, kind)? {
            Some(reader) if reader.count < vertices => {
                Err(reader.error(format!("{} elements for {vertices} vertices", reader.count)))
            }
            found => Ok(found),
        }
    }

    /// The mesh of a primitive of triangles, empty for points and lines. It has only the vertices
    /// that the primitive uses, because many primitives may share the accessors of all vertices.
    pub fn mesh(&self, request: &MeshRequest) -> Result<Mesh> {
        let topology = Topology::of(self.primitive, self.element)?;
        let Some(topology) = topology else { return Ok(Mesh::default()) };
        corner_accessor(self.primitive, self.element)?;
        let Some(positions) = self.attribute("POSITION", "VEC3")? else {
            return Ok(Mesh::default());
        };
        let vertices = positions.count;
        if vertices > u64::from(u32::MAX) {
            return Err(positions.error(format!("there are more than {} vertices", u32::MAX)));
        }
        let mut triangles = self.triangles(topology, vertices)?;
        let used = compact(&mut triangles);
        let normals = self.of_vertices("NORMAL", "VEC3", vertices)?;
        let uvs = request.uv_source.map(|source| {
            let uvs = self.of_vertices(&format!("TEXCOORD_{}", source.set), "VEC2", vertices)?;
            Ok(uvs.map(|uvs| (uvs, source)))
        });
        let uvs = uvs.transpose()?.flatten();
        let keeps_tangents = request.uv_source.is_some_and(UvSource::keeps_tangents);
        let tangents = match request.tangents && keeps_tangents {
            true => self.of_vertices("TANGENT", "VEC4", vertices)?,
            false => None,
        };
        let mut mesh = Mesh { triangles, ..Mesh::default() };
        mesh.positions = finite(&positions, &used)?.map(Vec3::from_array).collect();
        if let Some(normals) = &normals {
            // Normals that are not finite become zero when they are turned, which selects the
            // triangle's normal.
            mesh.normals = used.iter().map(|vertex| normals.numbers(*vertex).into()).collect();
        }
        if let Some((uvs, source)) = &uvs {
            let uvs = finite(uvs, &used)?.map(Vec2::from_array);
            mesh.uvs = uvs.map(|uv| source.apply(uv)).collect();
        }
        if let Some(tangents) = &tangents {
            // As for normals. The direction of growing `v`, in the fourth number, follows from
            // texture coordinates.
            let tangent = |vertex: &u32| {
                let [x, y, z, _] = tangents.numbers(*vertex);
                Vec3::new(x, y, z)
            };
            mesh.tangents = used.iter().map(tangent).collect();
        }
        if request.colors {
            mesh.colors = self.colors(&used, vertices)?;
        }
        request.pose.apply(self, &mut mesh, &used)?;
        Ok(mesh)
    }

    /// The corners of all triangles, of a primitive with this number of vertices.
    fn triangles(&self, topology: Topology, vertices: u64) -> Result<Vec<[u32; 3]>> {
        let Some(index) = self.primitive.indices else {
            let corners = (0..topology.count(vertices)).map(|i| topology.corners(i));
            // Less than the number of vertices, which fits.
            return Ok(corners.map(|corners| corners.map(|corner| corner as u32)).collect());
        };
        let element = format!("{}.indices", self.element);
        let indices = AccessorReader::open(self.buffers, index, "SCALAR", element)?;
        indices.check_index()?;
        indexed(topology, &indices, vertices)
    }

    /// Whether the accessor of colors has an opacity; `None` if there are no colors.
    fn colors_have_opacity(&self) -> Result<Option<bool>> {
        let Some(index) = self.primitive.attributes.get("COLOR_0") else { return Ok(None) };
        let element = format!("{}.attributes.COLOR_0", self.element);
        let accessor = get(&self.buffers.document.accessors, "accessors", *index, element)?;
        Ok(Some(accessor.kind == "VEC4"))
    }

    /// Whether the colors of any vertices are translucent.
    pub fn has_translucent_colors(&self) -> Result<bool> {
        if self.colors_have_opacity()? != Some(true) {
            return Ok(false);
        }
        let colors = self.attribute("COLOR_0", "VEC4")?;
        Ok(colors.is_some_and(|colors| (0..colors.count).any(|i| colors.numbers::<4>(i)[3] < 1.0)))
    }

    /// Colors of the vertices `used`, with or without opacity; empty if all are white.
    fn colors(&self, used: &[u32], vertices: u64) -> Result<Vec<Rgb>> {
        let has_opacity = self.colors_have_opacity()? == Some(true);
        let kind = if has_opacity { "VEC4" } else { "VEC3" };
        let Some(colors) = self.of_vertices("COLOR_0", kind, vertices)? else {
            return Ok(Vec::new());
        };
        let color = |vertex: &u32| {
            let [r, g, b] = match has_opacity {
                true => colors.numbers::<4>(*vertex).first_chunk().copied().unwrap_or_default(),
                false => colors.numbers::<3>(*vertex),
            };
            let share = |value: f32| if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) };
            Rgb::from_array([r, g, b].map(share))
        };
        let colors: Vec<Rgb> = used.iter().map(color).collect();
        Ok(if colors.iter().all(|color| *color == Rgb::ONE) { Vec::new() } else { colors })
    }
}

/// The triangles of a primitive with indices, all less than `vertices`.
fn indexed(topology: Topology, indices: &AccessorReader, vertices: u64) -> Result<Vec<[u32; 3]>> {
    let check = |rank: u64| {
        let index = indices.index(rank);
        if u64::from(index) < vertices {
            return Ok(index);
        }
        let problem = format!("index {index} at place {rank}, but there are {vertices} vertices");
        Err(indices.error(problem))
    };
    let triangle = |i: u64| {
        let [a, b, c] = topology.corners(i);
        Ok([check(a)?, check(b)?, check(c)?])
    };
    (0..topology.count(indices.count)).map(triangle).collect()
}

/// Renumbers the vertices by their first use, without unused ones, and returns their former
/// indices.
fn compact(triangles: &mut [[u32; 3]]) -> Vec<u32> {
    let mut used = triangles.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    // Indices ascend without a gap if the last one equals its rank.
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

/// The items `used` of an accessor, with numbers up to [`MAX_COORDINATE`].
fn finite<const N: usize>(
    reader: &AccessorReader,
    used: &[u32],
) -> Result<impl Iterator<Item = [f32; N]>> {
    let numbers = |vertex: &u32| {
        let numbers: [f32; N] = reader.numbers(*vertex);
        if numbers.iter().all(|number| number.abs() <= MAX_COORDINATE) {
            return Ok(numbers);
        }
        let problem = format!("element {vertex} is not finite or beyond {MAX_COORDINATE:e}");
        Err(reader.error(problem))
    };
    Ok(used.iter().map(numbers).collect::<Result<Vec<_>>>()?.into_iter())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_their_fronts() {
        let all = |topology: Topology, indices| -> Vec<[u64; 3]> {
            (0..topology.count(indices)).map(|i| topology.corners(i)).collect()
        };
        assert_eq!(all(Topology::Triangles, 7), [[0, 1, 2], [3, 4, 5]]);
        assert_eq!(all(Topology::Strip, 5), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
        assert_eq!(all(Topology::Fan, 5), [[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
        for topology in [Topology::Triangles, Topology::Strip, Topology::Fan] {
            assert_eq!((topology.count(0), topology.count(2), topology.count(3)), (0, 0, 1));
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
