//! Meshes that `obj2mesh` compiled (`.rtm`).
//!
//! Vertices are in patches of up to 256, with positions as fractions of the cube and normals as
//! codes of 32 bits. Triangles are within a patch, or join it to one or two vertices of others.

use super::binary::{Binary, Format, damaged};
use super::tokens::Primitive;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::Mesh;
use glam::{DVec3, Vec3};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::Arc;

/// Triangles of a patch by its own vertices, and those of each kind that joins it to others.
const MAX_TRIANGLES: usize = 512;
const MAX_JOINERS: usize = 256;

/// Bits of the flags of a patch.
const HAS_POSITIONS: i64 = 1;
const HAS_NORMALS: i64 = 2;
const HAS_COORDINATES: i64 = 4;

/// Fractions of 32 bits in a whole.
const FRACTIONS: f64 = 4_294_967_296.0;

/// A compiled mesh.
pub struct CompiledMesh {
    /// Its materials, and what modifies them.
    pub primitives: Vec<Primitive>,
    /// Point to which all positions are relative.
    pub origin: DVec3,
    /// Triangles by the index of their material in `primitives`, if they have one.
    pub parts: Vec<(Option<usize>, Arc<Mesh>)>,
}

impl CompiledMesh {
    /// Reads a file.
    ///
    /// # Errors
    /// Names the file if it cannot be read, or is damaged.
    pub fn read(path: &Path) -> Result<Self> {
        let mut file = Binary::open(path, Format::Mesh)?;
        let placed = |error: Error| error.at(path);
        let primitives = start(&mut file).map_err(placed)?;
        let mut patches = Patches::default();
        patches.read(&mut file, primitives.len()).map_err(placed)?;
        let parts = patches.parts().map_err(placed)?;
        let [x, y, z, _] = file.cube;
        Ok(Self { primitives, origin: DVec3::new(x, y, z), parts })
    }
}

/// What comes before the patches.
fn start(file: &mut Binary) -> Result<Vec<Primitive>> {
    // Limits of the local coordinates, which nothing here uses.
    for _ in 0..4 {
        file.number()?;
    }
    file.skip_tree()?;
    file.primitives()
}

/// A triangle: the patch and index of each vertex, and the index of its material.
type PatchTriangle = ([[usize; 2]; 3], Option<usize>);

/// The vertices and triangles of all patches.
#[derive(Default)]
struct Patches {
    /// Index of the first vertex of each patch.
    starts: Vec<usize>,
    positions: Vec<Vec3>,
    /// Normal of each vertex, or 0.
    normals: Vec<Vec3>,
    triangles: Vec<PatchTriangle>,
}

impl Patches {
    fn read(&mut self, file: &mut Binary, materials: usize) -> Result<()> {
        let count = file.integer(4)?;
        for _ in 0..count {
            self.patch(file, materials)?;
        }
        // One past the last patch.
        self.starts.push(self.positions.len());
        Ok(())
    }

    fn patch(&mut self, file: &mut Binary, materials: usize) -> Result<()> {
        let flags = file.integer(1)?;
        if flags & HAS_POSITIONS == 0 || flags > HAS_POSITIONS + HAS_NORMALS + HAS_COORDINATES {
            return Err(damaged("a patch"));
        }
        let vertices = file.count("a patch", 256)?;
        let size = file.cube[3];
        self.starts.push(self.positions.len());
        for _ in 0..vertices {
            let mut at = [0.0; 3];
            for own in &mut at {
                let fraction = file.integer(4)? as u32;
                *own = (f64::from(fraction) + 0.5) / FRACTIONS;
            }
            self.positions.push((size * DVec3::from_array(at)).as_vec3());
        }
        for _ in 0..vertices {
            let code = if flags & HAS_NORMALS == 0 { 0 } else { file.integer(4)? as u32 };
            self.normals.push(normal(code));
        }
        if flags & HAS_COORDINATES != 0 {
            file.take(8 * vertices)?;
        }
        self.inner_triangles(file, materials)?;
        let patch = self.starts.len() - 1;
        for joined in 1..=2 {
            for _ in 0..file.count("the joining triangles", MAX_JOINERS)? {
                let mut corners = [[patch, 0]; 3];
                for (corner, vertex) in corners.iter_mut().enumerate() {
                    *vertex = if corner < joined {
                        let vertex = file.integer(4)? as u32 as usize;
                        [vertex >> 8, vertex & 0xff]
                    } else {
                        // One of the patch itself comes before the material, or two.
                        [patch, file.take(1)?[0].into()]
                    };
                }
                let material = material(file, materials)?;
                self.triangles.push((corners, material));
            }
        }
        Ok(())
    }

    /// The triangles between vertices of the last patch.
    fn inner_triangles(&mut self, file: &mut Binary, materials: usize) -> Result<()> {
        let patch = self.starts.len() - 1;
        let count = file.count("the triangles of a patch", MAX_TRIANGLES)?;
        let first = self.triangles.len();
        for _ in 0..count {
            let bytes = file.take(3)?;
            let corners = [0, 1, 2].map(|corner| [patch, usize::from(bytes[corner])]);
            self.triangles.push((corners, None));
        }
        // A material for each triangle, or one for all.
        if file.integer(2)? > 1 {
            for index in first..first + count {
                self.triangles[index].1 = material(file, materials)?;
            }
        } else {
            let sole = material(file, materials)?;
            self.triangles[first..].iter_mut().for_each(|own| own.1 = sole);
        }
        Ok(())
    }

    /// A mesh for each material, apart for triangles with normals at all corners and for others.
    fn parts(&self) -> Result<Vec<(Option<usize>, Arc<Mesh>)>> {
        let mut groups: BTreeMap<(Option<usize>, bool), Vec<[usize; 3]>> = BTreeMap::new();
        for (corners, material) in &self.triangles {
            let mut vertices = [0; 3];
            for (vertex, [patch, index]) in vertices.iter_mut().zip(corners) {
                let limits = self.starts.get(*patch).zip(self.starts.get(patch + 1));
                let own = limits.map(|(start, end)| (start + index, end));
                let own = own.filter(|(own, end)| own < end);
                *vertex = own.ok_or_else(|| damaged("a triangle"))?.0;
            }
            let is_smooth = vertices.iter().all(|vertex| self.normals[*vertex] != Vec3::ZERO);
            groups.entry((*material, is_smooth)).or_default().push(vertices);
        }
        let part = |((material, is_smooth), triangles): (_, Vec<[usize; 3]>)| {
            (material, Arc::new(self.mesh(&triangles, is_smooth)))
        };
        Ok(groups.into_iter().map(part).collect())
    }

    /// The mesh of these triangles, with the vertices that they use.
    fn mesh(&self, triangles: &[[usize; 3]], is_smooth: bool) -> Mesh {
        let (mut mesh, mut indices) = (Mesh::default(), HashMap::new());
        for corners in triangles {
            let corners = corners.map(|vertex| {
                *indices.entry(vertex).or_insert_with(|| {
                    mesh.positions.push(self.positions[vertex]);
                    if is_smooth {
                        mesh.normals.push(self.normals[vertex]);
                    }
                    mesh.positions.len() as u32 - 1
                })
            });
            mesh.triangles.push(corners);
        }
        mesh
    }
}

/// The index of a material; `None` for `void`.
fn material(file: &mut Binary, materials: usize) -> Result<Option<usize>> {
    match file.integer(2)? {
        -1 => Ok(None),
        index => {
            let index = usize::try_from(index).ok().filter(|index| *index < materials);
            index.map(Some).ok_or_else(|| damaged("the material of a triangle"))
        }
    }
}

/// The unit vector of a code: signs, which coordinate is the largest, and the two smaller ones in
/// 13 bits each. 0 has none.
fn normal(code: u32) -> Vec3 {
    /// What a coordinate of 1 would be.
    const SCALE: f64 = 11584.5;
    if code == 0 {
        return Vec3::ZERO;
    }
    let [first, second] = [5, 18].map(|bit| f64::from(code >> bit & 0x1fff) / SCALE);
    let largest = (1.0 - first * first - second * second).max(0.0).sqrt();
    let [x, y, z] = match (code >> 3 & 1, code >> 4 & 1) {
        (1, 1) => [first, largest, second],
        (1, _) => [first, second, largest],
        (_, 1) => [largest, first, second],
        (..) => [second, first, largest],
    };
    let sign = |bit: u32| if code >> bit & 1 == 1 { -1.0 } else { 1.0 };
    DVec3::new(sign(0) * x, sign(1) * y, sign(2) * z).normalize_or_zero().as_vec3()
}
