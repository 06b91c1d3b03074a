//! `[[mesh]]` of a scene file: meshes of OBJ and PLY files, and meshes in memory.

use super::SceneReader;
use super::keys::Triple;
use super::places;
use crate::builder::out_of_range;
use crate::read::extension;
use crate::read::obj::{self, ObjFile};
use crate::read::ply::{self, PlyUse, VDirection};
use crate::text::{RELATIVE_NAME, list};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::transform::Transform;
use bdpm_core::scene::{Mesh, check_mesh};
use bdpm_core::settings::FixedArray;
use glam::DVec3;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use toml::Spanned;

/// A mesh in memory, and the name of its material.
#[derive(Clone, Debug)]
pub struct NamedMesh {
    /// The mesh; its index of a material is ignored.
    pub mesh: Arc<Mesh>,
    /// Name of a table `[materials.NAME]`.
    pub material: String,
}

/// `[[mesh]]`
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshTable {
    pub file: Spanned<String>,
    pub material: Option<Spanned<String>>,
    pub translate: Option<Triple>,
    pub rotate_deg: Option<Triple>,
    pub scale: Option<Triple>,
    pub matrix: Option<FixedArray<FixedArray<f64, 4>, 4>>,
    /// NumPy file of transforms.
    pub places: Option<Spanned<String>>,
    #[serde(default)]
    pub flip: bool,
}

/// Formats of mesh files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MeshFileKind {
    Obj,
    Ply,
}

impl MeshTable {
    /// The format of the file, which must exist in the folder of the scene file and have materials.
    fn kind(&self, folder: &Path) -> Result<MeshFileKind> {
        let name = self.file.get_ref();
        let path = folder.join(name);
        let kind = match &extension(&path)[..] {
            "obj" => MeshFileKind::Obj,
            "ply" if self.material.is_some() => MeshFileKind::Ply,
            "ply" => {
                let problem =
                    format!("the mesh `{name}` has no material: PLY files contain no materials");
                return Err(Error::new(problem, "add a line such as `material = \"chalk\"`"));
            }
            _ => {
                let problem = format!("`{name}` is neither an OBJ nor a PLY file");
                return Err(Error::new(problem, "give a file ending in .obj or .ply"));
            }
        };
        std::fs::metadata(&path).map_err(|error| {
            let problem = format!("cannot read the mesh file `{name}`: {error}");
            Error::new(problem, RELATIVE_NAME)
        })?;
        Ok(kind)
    }

    /// The transform from the coordinates of the mesh to those of the scene.
    fn transform(&self) -> Result<Transform> {
        let has_parts =
            [&self.translate, &self.rotate_deg, &self.scale].iter().any(|part| part.is_some());
        if self.places.is_some() && (self.matrix.is_some() || has_parts) {
            let problem = "the mesh has `places` besides another transform";
            return Err(Error::new(problem, "give either the places or the others"));
        }
        let transform = match self.matrix {
            Some(_) if has_parts => {
                let problem =
                    "the mesh has a `matrix` besides `translate`, `rotate_deg` or `scale`";
                return Err(Error::new(problem, "give either the matrix or the others"));
            }
            Some(FixedArray(rows)) => Transform::from_rows(rows.map(|FixedArray(row)| row))?,
            None => {
                let triple = |part: &Option<Triple>, name: &str| match part {
                    None => Ok(DVec3::ZERO),
                    Some(numbers) if !numbers.is_single => Ok(numbers.values),
                    Some(_) => Err(Error::new(
                        format!("`{name}` is a single number"),
                        format!("give three, such as `{name} = [0, 90, 0]`"),
                    )),
                };
                let scale = self.scale.as_ref().map_or(DVec3::ONE, |scale| scale.values);
                let translate = triple(&self.translate, "translate")?;
                Transform::from_parts(translate, triple(&self.rotate_deg, "rotate_deg")?, scale)?
            }
        };
        Ok(transform.flipped(self.flip))
    }
}

impl SceneReader<'_> {
    /// Adds all placements of a mesh file.
    pub(super) fn mesh(&mut self, table: &Spanned<MeshTable>) -> Result<()> {
        let mesh = table.get_ref();
        let start = table.span().start;
        let transform = mesh.transform().map_err(|error| self.at(error, start))?;
        let path = self.folder.join(mesh.file.get_ref());
        let (obj, is_new) = self.mesh_file(mesh, &path)?;
        let transforms = match &mesh.places {
            None => vec![transform],
            Some(name) => self.places(name, mesh.flip)?,
        };
        let count = obj.triangle_count();
        let placed = count.saturating_mul(transforms.len() as u64);
        let counted = self.builder.count(placed, if is_new { count } else { 0 });
        let parts = obj.meshes.len().saturating_mul(transforms.len()) as u64;
        let counted = counted.and_then(|()| self.builder.count_placements(parts));
        counted.map_err(|error| self.at(error, start))?;
        if let Some(name) = &mesh.material {
            let known = self.check_material(name.get_ref(), &obj);
            known.map_err(|error| self.at(error, name.span().start))?;
        }
        let material = mesh.material.as_ref().map(|name| name.get_ref().as_str());
        for transform in &transforms {
            let placed = self.placer.place(
                &mut self.builder,
                (&path, &obj),
                &transform.relative_to(self.origin),
                (material, &self.looks),
            );
            placed.ok_or_else(|| self.at(out_of_range(), start))?;
        }
        Ok(())
    }

    /// The content of a mesh file, and whether this is its first use.
    fn mesh_file(&mut self, mesh: &MeshTable, path: &Path) -> Result<(Rc<ObjFile>, bool)> {
        let kind = mesh.kind(self.folder);
        let kind = kind.map_err(|error| self.at(error, mesh.file.span().start))?;
        if let Some(known) = self.files.get(path) {
            return Ok((Rc::clone(known), false));
        }
        let read = match kind {
            MeshFileKind::Ply => {
                let wanted = PlyUse { v_direction: VDirection::Up, has_colors: true };
                ObjFile::of(ply::read(path, wanted)?, path)
            }
            MeshFileKind::Obj => obj::load(path)?,
        };
        self.builder.warnings.extend(read.notes.iter().cloned());
        let read = Rc::new(read);
        self.files.insert(path.to_owned(), Rc::clone(&read));
        Ok((read, true))
    }

    /// The transforms of a NumPy file.
    fn places(&self, name: &Spanned<String>, is_flipped: bool) -> Result<Vec<Transform>> {
        let file: PathBuf = self.folder.join(name.get_ref());
        if !file.is_file() {
            let problem = format!("there is no file `{}`", name.get_ref());
            return Err(self.at(Error::new(problem, RELATIVE_NAME), name.span().start));
        }
        let transforms = places::read(&file)?.into_iter();
        Ok(transforms.map(|transform| transform.flipped(is_flipped)).collect())
    }

    /// Adds a mesh in memory.
    pub(super) fn named_mesh(&mut self, NamedMesh { mesh, material }: &NamedMesh) -> Result<()> {
        check_mesh(mesh)?;
        let obj = ObjFile::in_memory(mesh);
        self.builder.count(obj.triangle_count(), 0)?;
        self.check_material(material, &obj)?;
        let moved = Transform::IDENTITY.relative_to(self.origin);
        let look = (Some(&material[..]), &self.looks);
        let placed = self.placer.place(&mut self.builder, (self.path, &obj), &moved, look);
        placed.ok_or_else(|| {
            let problem = format!("the mesh `{}` is out of the range of coordinates", mesh.name);
            Error::new(problem, "scale the scene down")
        })
    }

    /// Refuses names of materials that neither the scene file nor the OBJ file defines.
    fn check_material(&self, name: &str, obj: &ObjFile) -> Result<()> {
        if self.looks.contains_key(name) || obj.looks.contains_key(name) {
            return Ok(());
        }
        let known: BTreeSet<&str> =
            self.looks.keys().chain(obj.looks.keys()).map(String::as_str).collect();
        let advice = match known.len() {
            0 => format!("define it in a table [materials.{name}]"),
            _ => format!("use one of {}, or define it in a table [materials.{name}]", list(known)),
        };
        Err(Error::new(format!("unknown material `{name}`"), advice))
    }
}
