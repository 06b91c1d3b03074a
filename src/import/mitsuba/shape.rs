//! Shapes: formulas and mesh files, with what they are made of.

use super::Reader;
use super::analytic::Analytic;
use super::bsdf::{Look, Normals, With};
use super::bumps;
use super::color::Meaning;
use super::object::Object;
use super::texture::Paint;
use super::{serialized, smooth};
use crate::base::error::Result;
use crate::base::math::Rgb;
use crate::import::{obj, ply};
use crate::scene::transform::Transform;
use crate::scene::{Material, Mesh, NormalMap, Texture};
use glam::{Affine2, DAffine3, DMat3, DVec3, Vec2};
use std::path::PathBuf;
use std::sync::Arc;

/// What tells meshes apart.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct Key {
    source: Source,
    is_flat: bool,
    /// Of texture coordinates, bit by bit.
    to_uv: [u32; 6],
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Source {
    Formula {
        shape: Analytic,
        is_lamp: bool,
    },
    /// With the index of the shape in it.
    File(PathBuf, usize),
}

/// What a shape is made of, and whether it brings normals of its own.
#[derive(Clone)]
pub(super) struct Meshes {
    all: Vec<Arc<Mesh>>,
    has_normals: bool,
}

/// Meshes of a material each.
pub(super) type Parts = Vec<(Arc<Mesh>, u32)>;

/// A shape at its place.
pub(super) struct Shape {
    pub name: String,
    pub parts: Parts,
    pub map: DAffine3,
    pub is_flipped: bool,
}

impl Reader<'_> {
    /// The parts of a shape, and its map; `None` if it is of a kind that is left out.
    pub fn shape(&mut self, object: &Object) -> Result<Option<Shape>> {
        let name = object.label();
        for (tag, what) in [("subsurface", "subsurface scattering"), ("medium", "media")] {
            if !object.all(tag)?.is_empty() {
                self.remarks.skipped(format!("left out {what} of"), &name);
            }
        }
        let (mut emission, mut is_lamp) = (None, false);
        for emitter in object.all("emitter")? {
            if emitter.kind() == "area" {
                is_lamp = true;
                let paint = self.pictures.paint(
                    &emitter,
                    "radiance",
                    Meaning::Light,
                    Rgb::ONE,
                    &mut self.remarks,
                )?;
                emission = Some(paint).filter(|paint| paint.color != Rgb::ZERO);
            } else {
                self.remarks.skipped("left out an emitter that is none of surfaces, of", &name);
            }
        }
        let formula = Analytic::named(object.kind());
        let (source, inner) = match (formula, object.kind()) {
            (Some(shape), _) => {
                let is_lamp = emission.is_some();
                (Source::Formula { shape, is_lamp }, inner_map(shape, object)?)
            }
            (None, "obj" | "ply") => (Source::File(object.file()?, 0), DAffine3::IDENTITY),
            (None, "serialized") => {
                let index = object.float_in("shape_index", 0.0, [0.0, 1e9])? as usize;
                (Source::File(object.file()?, index), DAffine3::IDENTITY)
            }
            (None, other) => {
                let phrase = format!("left out shapes of type `{other}`:");
                self.remarks.skipped(phrase, &name);
                return Ok(None);
            }
        };
        let own = object.all("bsdf")?.into_iter().next();
        let look = match &own {
            Some(bsdf) => {
                let mut with = With { pictures: &mut self.pictures, remarks: &mut self.remarks };
                self.bsdfs.look(bsdf, &mut with, 0)?
            }
            None => Look::unsaid(is_lamp),
        };
        if look.is_black_behind && !formula.is_some_and(Analytic::is_closed) {
            let phrase = "shows from behind what Mitsuba shows black there (without `twosided`):";
            self.remarks.skipped(phrase, &own.map_or_else(|| name.clone(), |bsdf| bsdf.label()));
        }
        let to_uv = match &emission {
            Some(paint) if look.albedo.is_none() && paint.texture.is_some() => paint.to_uv,
            _ => look.to_uv,
        };
        let is_flat = object.boolean("face_normals")?.unwrap_or(false);
        let flips = object.boolean("flip_tex_coords")?;
        let key = Key { source, is_flat, to_uv: to_uv.to_cols_array().map(f32::to_bits) };
        let meshes = self.meshes(object, key, (to_uv, flips))?;
        let is_smooth = formula.is_none() && meshes.all.iter().any(|mesh| !mesh.normals.is_empty());
        if emission.is_some() && is_smooth {
            let phrase =
                "took the triangles' fronts and cosines, not the normals', for the light of";
            self.remarks.skipped(phrase, &name);
        }
        let map = object.map("to_world")? * inner;
        let mut parts = Parts::new();
        for mesh in meshes.all {
            let looks = (&look, &emission, is_lamp);
            let material = self.material(object, own.as_ref(), looks, (&mesh, map.matrix3));
            parts.push((mesh, material));
        }
        // As in Mitsuba, the order of corners tells where the front of a mirrored mesh is, unless its normals do.
        let by_corners = match formula {
            Some(shape) => shape == Analytic::Sphere,
            None => !meshes.has_normals,
        };
        let is_mirrored = by_corners && map.matrix3.determinant() < 0.0;
        let is_flipped = object.boolean("flip_normals")?.unwrap_or(false) != is_mirrored;
        Ok(Some(Shape { name, parts, map, is_flipped }))
    }

    /// The meshes of a shape, which several shapes may share.
    fn meshes(
        &mut self,
        object: &Object,
        key: Key,
        (to_uv, flips): (Affine2, Option<bool>),
    ) -> Result<Meshes> {
        // Few say so; those have their own.
        if flips.is_none()
            && let Some(known) = self.meshes.get(&key)
        {
            return Ok(known.clone());
        }
        let (mut meshes, has_normals) = read(object, &key)?;
        for mesh in &mut meshes {
            if key.is_flat {
                mesh.normals.clear();
            }
            mesh.colors.clear();
            // What files say of v: up in OBJ files, down in others, unless they are told to say the other.
            let upside_down = flips.is_some_and(|flip| flip != (object.kind() == "obj"));
            for uv in &mut mesh.uvs {
                let down = if upside_down { uv.y } else { 1.0 - uv.y };
                let own = to_uv.transform_point2(Vec2::new(uv.x, down));
                let own = if own.is_finite() { own } else { Vec2::ZERO };
                *uv = Vec2::new(own.x, 1.0 - own.y);
            }
        }
        let all = meshes.into_iter().map(Arc::new).collect();
        let meshes = Meshes { all, has_normals };
        if flips.is_none() {
            self.meshes.insert(key, meshes.clone());
        }
        Ok(meshes)
    }

    /// Index of the material of a shape's mesh at its place.
    fn material(
        &mut self,
        object: &Object,
        own: Option<&Object>,
        (look, emission, is_lamp): (&Look, &Option<Paint>, bool),
        (mesh, to_world): (&Mesh, DMat3),
    ) -> u32 {
        let is_shared =
            !is_lamp && emission.is_none() && !matches!(look.normals, Some(Normals::Bumps(..)));
        let index = own.map(|bsdf| bsdf.index);
        if is_shared && let Some(known) = self.shared.get(&index) {
            return *known;
        }
        let name = match own {
            Some(bsdf) if is_shared => bsdf.label(),
            _ => object.label(),
        };
        let normal_map = match &look.normals {
            None => None,
            Some(Normals::Map(texture)) => Some(NormalMap { texture: texture.clone(), scale: 1.0 }),
            Some(Normals::Bumps(heights, scale)) => {
                bumps::normal_map(heights, *scale, mesh, to_world)
            }
        };
        let (opacity, opacity_texture): (Option<f32>, Option<Arc<Texture>>) = match &look.opacity {
            Some((share, texture)) => (Some(*share), texture.clone()),
            None => (None, None),
        };
        let material = Material {
            albedo_texture: look.albedo.clone(),
            opacity,
            opacity_texture,
            normal_map,
            emission: emission.as_ref().map_or(Rgb::ZERO, |paint| paint.color),
            emission_texture: emission.as_ref().and_then(|paint| paint.texture.clone()),
            ..Material::new(&name, look.bsdf)
        };
        self.builder.materials.push(material);
        let made = self.builder.materials.len() as u32 - 1;
        if is_shared {
            self.shared.insert(index, made);
        }
        made
    }

    /// The parts of a group, each moved by its own map.
    pub fn group(&mut self, object: &Object) -> Result<Parts> {
        if let Some(known) = self.groups.get(&object.index) {
            return Ok(known.clone());
        }
        let mut parts = Parts::new();
        for child in object.all("shape")? {
            let Some(shape) = self.shape(&child)? else { continue };
            let transform = self.transform(&child, shape.map, shape.is_flipped)?;
            for (mesh, material) in shape.parts {
                if mesh.positions.iter().any(|point| transform.point(*point).is_none()) {
                    let problem = "its transform moves it out of the range of coordinates";
                    return Err(child.error(problem, "scale or move it less"));
                }
                parts.push((Arc::new(mesh.moved(&transform)), material));
            }
        }
        self.groups.insert(object.index, parts.clone());
        Ok(parts)
    }

    /// A map that can be undone.
    pub fn transform(&self, object: &Object, map: DAffine3, flip: bool) -> Result<Transform> {
        let transform = Transform::new(map).map(|transform| transform.flipped(flip));
        transform.map_err(|error| object.error(error.problem(), error.advice()))
    }
}

/// Meshes with normals where there are any, and whether these are the file's own.
fn read(object: &Object, key: &Key) -> Result<(Vec<Mesh>, bool)> {
    let (path, index) = match &key.source {
        Source::Formula { shape, is_lamp } => return Ok((vec![shape.mesh(*is_lamp)], true)),
        Source::File(path, index) => (path, *index),
    };
    let (mut meshes, mut is_flat) = (Vec::new(), key.is_flat);
    match object.kind() {
        "obj" => {
            // Their materials do not count.
            let file = obj::load(path)?;
            meshes.extend(file.meshes.iter().map(|part| (*part.mesh).clone()));
        }
        "ply" => meshes.push(ply::read(path, ply::Rows::Down)?),
        _ => {
            let shape = serialized::read(path, index)?;
            is_flat |= shape.is_flat;
            meshes.push(shape.mesh);
        }
    }
    let has_normals = !is_flat && meshes.iter().all(|mesh| !mesh.normals.is_empty());
    for mesh in &mut meshes {
        if let Some(vertex) = mesh.positions.iter().position(|point| !point.is_finite()) {
            let problem = format!("vertex {vertex} of its file is not finite");
            return Err(object.error(problem, "mend the mesh"));
        }
        if is_flat {
            mesh.normals.clear();
        } else if mesh.normals.is_empty() {
            smooth::normals(mesh);
        }
    }
    Ok((meshes, has_normals))
}

/// From the space of [`Analytic`] to that of the shape.
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
                return Err(object.error("`p0` and `p1` are the same", "give two points"));
            };
            let radius = radius()?;
            // As Mitsuba turns it, which textures show.
            let (x, y) = coordinate_system(axis);
            let matrix = DMat3::from_cols(radius * x, radius * y, along);
            Ok(DAffine3 { matrix3: matrix, translation: from })
        }
        _ => Ok(DAffine3::IDENTITY),
    }
}

/// Two axes that make a right-handed frame with a unit vector (Duff et al. 2017).
fn coordinate_system(n: DVec3) -> (DVec3, DVec3) {
    let sign = 1.0_f64.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (
        DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        DVec3::new(b, sign + n.y * n.y * a, -n.y),
    )
}
