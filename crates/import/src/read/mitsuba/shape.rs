//! Shapes: analytic ones and mesh files, with their materials.

use super::SceneReader;
use super::analytic::Analytic;
use super::bsdf::without_bsdf;
use super::obj_files::ObjFiles;
use super::object::Object;
use super::serialized;
use crate::builder::out_of_range;
use crate::far::DBounds;
use crate::look::{Look, ONE_MAP, Paint, map_uvs};
use crate::read::ply::{self, PlyUse, VDirection};
use crate::shape::curves::{CurveBasis, add_tube, remove_empty};
use crate::shape::instancing::MaterialMesh;
use crate::spectrum::ColorUse;
use crate::text;
use crate::warnings::Warning;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::Mesh;
use bdpm_core::scene::transform::Transform;
use glam::{Affine2, DAffine3, DMat3, DVec3, DVec4, Vec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Identifies the meshes of a shape.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct MeshKey {
    source: ShapeSource,
    is_flat: bool,
    /// Bits of the map of texture coordinates.
    to_uv: [u32; 6],
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum ShapeSource {
    Formula {
        shape: Analytic,
        is_lamp: bool,
    },
    /// A file, and the index of the shape in it.
    File(PathBuf, usize),
    /// A file of curves, and the bits of the factor of their radii.
    Curves(PathBuf, CurveBasis, u64),
}

/// The meshes of a shape, and whether its file has normals.
#[derive(Clone)]
pub(super) struct ShapeMeshes {
    all: Vec<Arc<Mesh>>,
    /// Point to which their positions are relative.
    origin: DVec3,
    has_normals: bool,
}

/// A shape with its transform.
pub(super) struct Shape {
    pub name: String,
    pub parts: Vec<MaterialMesh>,
    pub map: DAffine3,
    pub is_flipped: bool,
}

/// The emission of a shape.
struct Emission {
    /// `None` for black lamps.
    paint: Option<Paint>,
    is_lamp: bool,
}

impl SceneReader {
    /// Reads a shape; `None` if its type is not supported.
    pub fn shape(&mut self, object: &Object) -> Result<Option<Shape>> {
        if !object.all("subsurface")?.is_empty() {
            self.paints.skipped("left out subsurface scattering of", object);
        }
        let boundary = self.media.boundary(object, &mut self.paints)?;
        let emission = self.emission(object)?;
        let formula = Analytic::named(object.kind());
        let Some((source, inner)) = self.source(object, formula, emission.paint.is_some())? else {
            return Ok(None);
        };
        let own = object.all("bsdf")?.into_iter().next();
        let mut look = match &own {
            Some(bsdf) => self.bsdfs.look(bsdf, &mut self.paints, 0)?,
            None => without_bsdf(emission.is_lamp),
        };
        look.bound(boundary);
        if look.is_black_behind && !formula.is_some_and(Analytic::is_closed) {
            let phrase = "shows both sides of a surface whose back is black in Mitsuba (without `twosided`):";
            self.paints.skipped(phrase, own.as_ref().unwrap_or(object));
        }
        let is_shared = !emission.is_lamp;
        if let Some(paint) = emission.paint.clone()
            && !look.emit(paint)
        {
            self.paints.skipped(ONE_MAP, object);
        }
        if emission.paint.is_some() && look.material.alpha_mask().is_some() {
            let phrase = "multiplied the emission, which is whole in Mitsuba, by the opacity of";
            self.paints.skipped(phrase, object);
        }
        let is_flat = object.boolean("face_normals")?.unwrap_or(false);
        let to_uv = look.to_uv();
        let key = MeshKey { source, is_flat, to_uv: to_uv.to_cols_array().map(f32::to_bits) };
        let meshes = self.meshes(object, key, to_uv)?;
        let is_smooth = formula.is_none() && meshes.all.iter().any(|mesh| !mesh.normals.is_empty());
        if emission.paint.is_some() && is_smooth {
            let phrase =
                "used the fronts and cosines of triangles instead of normals for the light of";
            self.paints.skipped(phrase, object);
        }
        let map = object.map("to_world")? * inner;
        let mut parts = Vec::new();
        for mesh in meshes.all {
            let material = self.material(object, own, (&look, is_shared), (&mesh, map.matrix3));
            parts.push(MaterialMesh { mesh, material, origin: meshes.origin });
        }
        // As in Mitsuba, the order of corners decides the front of a mirrored mesh, unless normals
        // do.
        let by_corners = match formula {
            Some(shape) => shape == Analytic::Sphere,
            None => !meshes.has_normals,
        };
        let is_mirrored = by_corners && map.matrix3.determinant() < 0.0;
        let is_flipped = object.boolean("flip_normals")?.unwrap_or(false) != is_mirrored;
        Ok(Some(Shape { name: object.label(), parts, map, is_flipped }))
    }

    fn emission(&mut self, object: &Object) -> Result<Emission> {
        let mut emission = Emission { paint: None, is_lamp: false };
        for emitter in object.all("emitter")? {
            if emitter.kind() == "area" {
                let paint = self.paints.paint(&emitter, "radiance", ColorUse::Light, Rgb::ONE)?;
                let paint = Some(paint).filter(|paint| paint.color != Rgb::ZERO);
                emission = Emission { paint, is_lamp: true };
            } else {
                self.paints.skipped("left out an emitter that is not an area light of", object);
            }
        }
        Ok(emission)
    }

    /// The source of the meshes of a shape, and the map from their space to that of the shape;
    /// `None` if its type is not supported.
    fn source(
        &mut self,
        object: &Object,
        formula: Option<Analytic>,
        is_lamp: bool,
    ) -> Result<Option<(ShapeSource, DAffine3)>> {
        if let Some(shape) = formula {
            let source = ShapeSource::Formula { shape, is_lamp };
            return Ok(Some((source, inner_map(shape, object)?)));
        }
        let source = match object.kind() {
            "obj" | "ply" => ShapeSource::File(object.file()?, 0),
            "serialized" => {
                let index = object.float_in("shape_index", 0.0, [0.0, 1e9])? as usize;
                ShapeSource::File(object.file()?, index)
            }
            "bsplinecurve" | "linearcurve" => {
                let is_linear = object.kind() == "linearcurve";
                let basis = if is_linear { CurveBasis::Linear } else { CurveBasis::BSpline(3) };
                // The transform of the shape does not apply to radii.
                let scale = object.map("to_world")?.matrix3.determinant().abs().cbrt().recip();
                ShapeSource::Curves(object.file()?, basis, scale.to_bits())
            }
            other => {
                self.paints.skipped(format!("left out shapes of type `{other}`:"), object);
                return Ok(None);
            }
        };
        Ok(Some((source, DAffine3::IDENTITY)))
    }

    /// The meshes of a shape, which several shapes may share.
    fn meshes(&mut self, object: &Object, key: MeshKey, to_uv: Affine2) -> Result<ShapeMeshes> {
        let flips = object.boolean("flip_tex_coords")?;
        // Few shapes have this property. Their meshes are not shared.
        if flips.is_none()
            && let Some(known) = self.meshes.get(&key)
        {
            return Ok(known.clone());
        }
        let ReadMeshes { mut meshes, origin, has_normals } =
            read(object, &key, &mut self.obj_files, &mut self.builder.warnings)?;
        for mesh in &mut meshes {
            if key.is_flat {
                mesh.normals.clear();
            }
            mesh.colors.clear();
            // By default v points up in OBJ files, and down in others.
            let upside_down = flips.is_some_and(|flip| flip != (object.kind() == "obj"));
            if upside_down {
                mesh.uvs.iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
            }
            map_uvs(mesh, to_uv);
        }
        let stored = meshes.iter().map(|mesh| mesh.triangles.len() as u64).sum();
        let stored = self.builder.count(0, stored);
        stored.map_err(|error| object.placed(&error))?;
        let all = meshes.into_iter().map(Arc::new).collect();
        let meshes = ShapeMeshes { all, origin, has_normals };
        if flips.is_none() {
            self.meshes.insert(key, meshes.clone());
        }
        Ok(meshes)
    }

    /// Index of the material of a shape's mesh, which several shapes may share. It depends on the
    /// mesh if it has bumps.
    fn material(
        &mut self,
        object: &Object,
        bsdf: Option<Object>,
        (look, is_shared): (&Look, bool),
        (mesh, to_world): (&Mesh, DMat3),
    ) -> u32 {
        let is_shared = is_shared && look.bumps.is_none();
        let media = ["interior", "exterior"].map(|side| object.get(side).ok().flatten());
        let index = (bsdf.map(|bsdf| bsdf.index), media.map(|own| own.map(|own| own.index)));
        if is_shared && let Some(known) = self.shared.get(&index) {
            return *known;
        }
        let name = match bsdf {
            Some(bsdf) if is_shared => bsdf.label(),
            _ => object.label(),
        };
        let made = self.builder.add_material(look.material(&name, mesh, to_world));
        if is_shared {
            self.shared.insert(index, made);
        }
        made
    }

    /// The meshes of a group, each transformed by its own map.
    pub fn group(&mut self, object: &Object) -> Result<Vec<MaterialMesh>> {
        if let Some(known) = self.groups.get(&object.index) {
            return Ok(known.clone());
        }
        let mut parts = Vec::new();
        for child in object.all("shape")? {
            let Some(shape) = self.shape(&child)? else { continue };
            let transform = Transform::new(shape.map).map_err(|error| child.placed(&error))?;
            let transform = transform.flipped(shape.is_flipped);
            for MaterialMesh { mesh, material, origin } in shape.parts {
                let transform = transform.relative_from(origin);
                if mesh.positions.iter().any(|point| transform.point(*point).is_none()) {
                    return Err(child.placed(&out_of_range()));
                }
                parts.push(MaterialMesh::new(Arc::new(mesh.moved(&transform)), material));
            }
        }
        self.groups.insert(object.index, parts.clone());
        Ok(parts)
    }
}

/// Meshes of a file or a formula.
struct ReadMeshes {
    meshes: Vec<Mesh>,
    /// Point to which their positions are relative.
    origin: DVec3,
    /// Whether the file has normals.
    has_normals: bool,
}

/// Reads meshes, with smooth normals if they have none.
fn read(
    object: &Object,
    key: &MeshKey,
    obj_files: &mut ObjFiles,
    warnings: &mut Vec<Warning>,
) -> Result<ReadMeshes> {
    let complete = |mesh, origin| ReadMeshes { meshes: vec![mesh], origin, has_normals: true };
    let (path, index) = match &key.source {
        ShapeSource::Formula { shape, is_lamp } => {
            return Ok(complete(shape.mesh(*is_lamp), DVec3::ZERO));
        }
        ShapeSource::File(path, index) => (path, *index),
        ShapeSource::Curves(path, basis, scale) => {
            let (mesh, origin) = curves(path, *basis, f64::from_bits(*scale))?;
            return Ok(complete(mesh, origin));
        }
    };
    let (mut meshes, mut is_flat) = (Vec::new(), key.is_flat);
    let origin = match object.kind() {
        "obj" => {
            // The materials of the file have no effect.
            let file = obj_files.take(path)?;
            meshes.extend(file.meshes.into_iter().map(|part| Arc::unwrap_or_clone(part.mesh)));
            file.origin
        }
        "ply" => {
            let wanted = PlyUse { v_direction: VDirection::Down, has_colors: false };
            let file = ply::read(path, wanted)?;
            warnings.extend(file.warnings);
            meshes.push(file.mesh);
            file.origin
        }
        _ => {
            let shape = serialized::read(path, index)?;
            is_flat |= shape.is_flat;
            meshes.push(shape.mesh);
            shape.origin
        }
    };
    let has_normals = !is_flat && meshes.iter().all(|mesh| !mesh.normals.is_empty());
    for mesh in &mut meshes {
        if let Some(vertex) = mesh.positions.iter().position(|point| !point.is_finite()) {
            let problem = format!("vertex {vertex} of its file is not finite");
            return Err(object.error(problem, "correct the mesh"));
        }
        if is_flat {
            mesh.normals.clear();
        } else if mesh.normals.is_empty() {
            smooth_normals(mesh);
        }
    }
    Ok(ReadMeshes { meshes, origin, has_normals })
}

/// The curves of a file, which has a line of a position and a radius for each control point, and
/// empty lines between curves, and the point to which their positions are relative.
fn curves(path: &Path, basis: CurveBasis, scale: f64) -> Result<(Mesh, DVec3)> {
    let bytes = text::read_lines(path)?;
    let text = text::decoded(&bytes);
    let mut curves: Vec<Vec<DVec4>> = Vec::new();
    let mut points: Vec<DVec4> = Vec::new();
    for (number, line) in text.lines().chain([""]).enumerate() {
        if !line.trim().is_empty() {
            let numbers: Vec<f64> = line.split_whitespace().map_while(|w| w.parse().ok()).collect();
            let [x, y, z, radius] = numbers[..] else {
                let error = Error::new("this is not four numbers", "give a position and a radius");
                return Err(error.at(path).line(number + 1, line));
            };
            points.push(DVec4::new(x, y, z, radius));
            continue;
        }
        curves.push(std::mem::take(&mut points));
    }
    let all = curves.iter().flatten().map(|point| point.truncate());
    let center = all.fold(DBounds::EMPTY, DBounds::with).far_center_of_part();
    let origin = center.unwrap_or(DVec3::ZERO);
    let mut mesh = Mesh::default();
    for mut points in curves {
        points.iter_mut().for_each(|point| *point -= origin.extend(0.0));
        add_tube(&mut mesh, &points, basis, |radius, _| radius * scale);
    }
    remove_empty(&mut mesh);
    Ok((mesh, origin))
}

/// Sets each vertex's normal to the mean of those of its triangles, weighted by their angles at the
/// vertex as in Mitsuba (Thürmer and Wüthrich 1998).
fn smooth_normals(mesh: &mut Mesh) {
    let mut normals = vec![Vec3::ZERO; mesh.positions.len()];
    for corners in &mesh.triangles {
        let points = corners.map(|i| mesh.positions[i as usize]);
        let normal = (points[1] - points[0]).cross(points[2] - points[0]).normalize_or_zero();
        for i in 0..3 {
            let [a, b, c] = [i, (i + 1) % 3, (i + 2) % 3].map(|i| points[i]);
            let (e, f) = ((b - a).normalize_or_zero(), (c - a).normalize_or_zero());
            let angle = e.dot(f).clamp(-1.0, 1.0).acos();
            normals[corners[i] as usize] += angle * normal;
        }
    }
    mesh.normals = normals.into_iter().map(Vec3::normalize_or_zero).collect();
}

/// Map from the space of [`Analytic`] to that of the shape.
fn inner_map(shape: Analytic, object: &Object) -> Result<DAffine3> {
    let radius = || object.float_in("radius", 1.0, [1e-30, 1e30]);
    match shape {
        Analytic::Sphere => {
            let center = object.point("center")?.unwrap_or_default();
            Ok(DAffine3::from_translation(center) * DAffine3::from_scale(DVec3::splat(radius()?)))
        }
        Analytic::Cylinder => {
            let from = object.point("p0")?.unwrap_or_default();
            let along = object.point("p1")?.unwrap_or(DVec3::Z) - from;
            let Some(axis) = along.try_normalize() else {
                return Err(object.error("`p0` and `p1` are equal", "give two different points"));
            };
            let radius = radius()?;
            // The rotation about the axis is that of Mitsuba (Duff et al. 2017), because textures
            // show it.
            let (x, y) = axis.any_orthonormal_pair();
            let matrix = DMat3::from_cols(radius * x, radius * y, along);
            Ok(DAffine3 { matrix3: matrix, translation: from })
        }
        _ => Ok(DAffine3::IDENTITY),
    }
}
