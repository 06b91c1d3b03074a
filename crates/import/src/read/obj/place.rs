//! Placement of the meshes of OBJ and PLY files, with the materials of the scene file or of the
//! libraries.

use super::{ObjFile, ObjMesh};
use crate::builder::Builder;
use crate::look::{DEFAULT_ALBEDO, Look, map_uvs};
use crate::shape::instancing::MaterialMesh;
use crate::text::list;
use crate::warnings::Warning;
use bdpm_core::scene::Mesh;
use bdpm_core::scene::transform::Transform;
use glam::Affine2;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Address of a mesh, and bits of a map of texture coordinates.
type MappedKey = (*const Mesh, [u32; 6]);

/// Looks by their names.
pub type Looks = BTreeMap<String, Look>;

/// Places meshes. Each material is added to the scene with its first use.
#[derive(Default)]
pub struct ObjPlacer {
    /// Index of each material in the scene, by the OBJ file of the material (`None` for the scene
    /// file) and its name.
    materials: HashMap<(Option<PathBuf>, String), u32>,
    /// Meshes whose texture coordinates a look maps, by the address of the original, which stays
    /// alive beside its copy, and the bits of the map. All placements of a mesh share one copy.
    mapped: HashMap<MappedKey, [Arc<Mesh>; 2]>,
    /// Names of materials that the OBJ file uses without defining them.
    undefined: BTreeSet<String>,
    /// Whether meshes of the OBJ file have no material.
    unnamed: bool,
}

impl ObjPlacer {
    /// Adds the meshes of a file with the material `name`, else with their own ones. Materials are
    /// from the scene file, which has the looks `own`, else from the libraries of the OBJ file,
    /// else gray. `None` if a point moves out of range.
    pub fn place(
        &mut self,
        builder: &mut Builder,
        (path, obj): (&Path, &ObjFile),
        transform: &Transform,
        (name, own): (Option<&str>, &Looks),
    ) -> Option<()> {
        let mut parts = Vec::with_capacity(obj.meshes.len());
        for ObjMesh { mesh, material } in &obj.meshes {
            let name = name.or(material.as_deref());
            let known = name.unwrap_or("default");
            let look = own.get(known).or_else(|| obj.looks.get(known));
            let mesh = self.mapped(mesh, look.map_or(Affine2::IDENTITY, Look::to_uv));
            let file = (!own.contains_key(known)).then(|| path.to_owned());
            let key = (file, known.to_owned());
            let material = match self.materials.get(&key) {
                Some(known) => *known,
                None => {
                    let look = look.cloned().unwrap_or_else(|| self.gray(name));
                    let material = builder.add_material(look.named(&key.1));
                    self.materials.insert(key, material);
                    material
                }
            };
            parts.push(MaterialMesh { mesh, material, origin: obj.origin });
        }
        builder.place(None, &parts, transform)?;
        self.warn(builder, path);
        Some(())
    }

    /// Gray in place of the missing material `name`.
    fn gray(&mut self, name: Option<&str>) -> Look {
        self.undefined.extend(name.map(str::to_owned));
        self.unnamed |= name.is_none();
        Look::gray()
    }

    /// The mesh with mapped texture coordinates.
    fn mapped(&mut self, mesh: &Arc<Mesh>, to_uv: Affine2) -> Arc<Mesh> {
        if to_uv == Affine2::IDENTITY {
            return Arc::clone(mesh);
        }
        let key = (Arc::as_ptr(mesh), to_uv.to_cols_array().map(f32::to_bits));
        let [_, copy] = self.mapped.entry(key).or_insert_with(|| {
            let mut copy = Mesh::clone(mesh);
            map_uvs(&mut copy, to_uv);
            [Arc::clone(mesh), Arc::new(copy)]
        });
        Arc::clone(copy)
    }

    fn warn(&mut self, builder: &mut Builder, path: &Path) {
        let (gray, path) = (format!("used gray of albedo {DEFAULT_ALBEDO}"), path.display());
        let undefined = std::mem::take(&mut self.undefined);
        if !undefined.is_empty() {
            let names = list(undefined.iter().map(String::as_str));
            let text = format!("{path}: {names} undefined; {gray}");
            builder.warnings.push(Warning::skipped(text));
        }
        if std::mem::take(&mut self.unnamed) {
            let text = format!("{path}: faces without material; {gray}");
            builder.warnings.push(Warning::chosen(text));
        }
    }
}
