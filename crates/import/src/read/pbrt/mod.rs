//! Scenes of pbrt-v4.
//!
//! `docs/reference/pbrt.md` describes the conversion of each directive and its differences from
//! pbrt. Each approximation is a warning. Errors name file and line.

mod camera;
mod directives;
mod image_light;
mod lights;
mod materials;
mod named_media;
mod params;
mod shapes;
mod spectra;
mod state;
mod subdivision;
mod textures;
mod tokens;

use super::ImportOptions;
use crate::builder::{Builder, Contents, EnvironmentReader, ReadScene, out_of_range};
use crate::look::{Look, ONE_MAP, Paint, map_uvs};
use crate::sensor::MIRROR;
use crate::shape::curves;
use crate::shape::instancing::MaterialMesh;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::transform::Transform;
use bdpm_core::scene::{Emitter, Environment, Mesh};
use bdpm_core::settings::PartialSettings;
use camera::{CameraSource, FilmSource};
use glam::{DAffine3, DMat3, DVec3};
use lights::AreaLight;
use materials::Materials;
use named_media::NamedMedia;
use params::Params;
use spectra::ColorSpace;
use state::GraphicsState;
use std::collections::HashMap;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;
use textures::Textures;
use tokens::{Location, SourceFiles};

/// Reads a scene as seen by its camera.
///
/// # Errors
/// Names the file and line of a directive that is malformed or unknown.
pub(super) fn read(path: &Path, options: &ImportOptions) -> Result<ReadScene> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut reader = SceneReader {
        builder: Builder::default(),
        textures: Textures::new(folder),
        materials: Materials::default(),
        media: NamedMedia::default(),
        camera_medium: String::new(),
        material_index: HashMap::new(),
        state: GraphicsState::new(),
        saved: Vec::new(),
        files: SourceFiles::default(),
        systems: HashMap::new(),
        objects: HashMap::new(),
        object: None,
        camera: None,
        film: FilmSource::new(),
        in_world: false,
        depth: 0,
        shapes: Vec::new(),
        lights: Vec::new(),
        uses: Vec::new(),
        has_media: false,
    };
    reader.read(path)?;
    reader.finish(path, options)
}

/// A shape with its transform to the world.
struct PlacedShape {
    params: Params,
    map: DAffine3,
    state: GraphicsState,
}

/// A scene that is being read.
struct SceneReader {
    builder: Builder,
    textures: Textures,
    materials: Materials,
    media: NamedMedia,
    /// Name of the medium around the camera; empty for none.
    camera_medium: String,
    /// Index of a material without emission, mask and media by the number of its look.
    material_index: HashMap<usize, u32>,
    state: GraphicsState,
    /// States that `AttributeBegin` and `ObjectBegin` save, and where.
    saved: Vec<(GraphicsState, Location)>,
    files: SourceFiles,
    /// Transforms that `CoordinateSystem` names.
    systems: HashMap<String, DAffine3>,
    /// Shapes of each object.
    objects: HashMap<String, Vec<PlacedShape>>,
    /// The object whose shapes follow.
    object: Option<String>,
    camera: Option<CameraSource>,
    film: FilmSource,
    in_world: bool,
    /// Number of files that include each other.
    depth: usize,
    /// Shapes outside of objects.
    shapes: Vec<PlacedShape>,
    lights: Vec<(Params, DAffine3, ColorSpace)>,
    /// Uses of objects: their name and transform.
    uses: Vec<(String, Params, DAffine3)>,
    /// Whether a shape bounds a medium.
    has_media: bool,
}

/// A mesh in its own space with its material.
struct Part {
    mesh: Mesh,
    material: u32,
    /// Point to which the positions of the mesh are relative.
    origin: DVec3,
}

impl Part {
    /// The same with a shared mesh.
    fn shared(self) -> MaterialMesh {
        let Self { mesh, material, origin } = self;
        MaterialMesh { mesh: Arc::new(mesh), material, origin }
    }
}

impl SceneReader {
    fn finish(mut self, path: &Path, options: &ImportOptions) -> Result<ReadScene> {
        let is_mirrored = self.camera.as_ref().is_some_and(CameraSource::is_mirrored);
        let mirror = if is_mirrored { MIRROR } else { DMat3::IDENTITY };
        let world = DAffine3::from_mat3_translation(mirror, -options.origin());
        if is_mirrored {
            let phrase = "mirrored, with its camera (pbrt's spaces are left-handed),";
            self.textures.warnings.chosen(phrase, "the scene");
        }
        let (lights, environment) = self.place_lights(world)?;
        self.place_shapes(world)?;
        self.place_objects(world)?;
        if self.has_media && self.builder.is_empty() {
            let problem = "the scene has only media of types that are not supported";
            return Err(Error::new(problem, "add surfaces"));
        }
        let camera = match &self.camera {
            Some(camera) => Some(camera.camera(world, &self.film, &mut self.textures)?),
            None => None,
        };
        if let Some(params) = self.camera.as_ref().map(|camera| camera.params.clone()) {
            self.warn_of_unused(&params);
        }
        let Self { mut builder, textures, film, media, camera_medium, .. } = self;
        builder.warnings.extend(textures.warnings.into_warnings(&path.display().to_string()));
        builder.warnings.extend(textures.file_warnings);
        let resolution = Some(film.resolution());
        let contents = Contents {
            lights,
            camera,
            environment: environment.map(|own| -> EnvironmentReader { Box::new(|_| Ok(own)) }),
            defaults: PartialSettings { resolution, ..PartialSettings::default() },
            filling_medium: builder.filling_medium(media.named(&camera_medium)),
            ..Contents::default()
        };
        builder.finish(path, contents, options)
    }

    /// The lights at points and far away, and the first infinite light.
    fn place_lights(&mut self, world: DAffine3) -> Result<(Vec<Emitter>, Option<Environment>)> {
        let (mut emitters, mut environment) = (Vec::new(), None);
        let film_scale = self.film.scale;
        for (params, map, space) in std::mem::take(&mut self.lights) {
            let map = world * map;
            let textures = &mut self.textures;
            if params.kind != "infinite" {
                let emitter = lights::emitter(&params, space, map, textures)?;
                emitters.extend(emitter.map(|emitter| scaled(emitter, film_scale)));
            } else if environment.is_some() {
                let phrase = "left out all but the first of";
                textures.warnings.skipped(phrase, "infinite lights");
                continue;
            } else {
                let turn = map.matrix3;
                let made = image_light::environment(&params, space, turn, film_scale, textures)?;
                environment = Some(made);
            }
            self.warn_of_unused(&params);
        }
        Ok((emitters, environment))
    }

    /// Places the shapes outside of objects.
    fn place_shapes(&mut self, world: DAffine3) -> Result<()> {
        let mut hair: Option<(Part, PlacedShape)> = None;
        for shape in std::mem::take(&mut self.shapes) {
            let Some(own) = self.part(&shape, None)? else { continue };
            // Files have a shape for each hair: those of one material become one mesh.
            if shape.params.kind == "curve" {
                match &mut hair {
                    Some((all, first))
                        if all.material == own.material
                            && all.origin == own.origin
                            && first.map == shape.map =>
                    {
                        curves::join(&mut all.mesh, &own.mesh);
                    }
                    _ => self.place_curves(hair.replace((own, shape)), world)?,
                }
                continue;
            }
            let name = own.mesh.name.clone();
            self.place(&name, &[own.shared()], world * shape.map, &shape.params)?;
        }
        self.place_curves(hair, world)
    }

    /// Places the mesh of joined curves, if there is one.
    fn place_curves(&mut self, hair: Option<(Part, PlacedShape)>, world: DAffine3) -> Result<()> {
        let Some((part, shape)) = hair else { return Ok(()) };
        self.place("curves", &[part.shared()], world * shape.map, &shape.params)
    }

    /// Places all uses of objects.
    fn place_objects(&mut self, world: DAffine3) -> Result<()> {
        let mut objects: HashMap<String, Vec<MaterialMesh>> = HashMap::new();
        for (name, params, map) in std::mem::take(&mut self.uses) {
            if !objects.contains_key(&name) {
                let Some(shapes) = self.objects.remove(&name) else {
                    let advice = "define it by ObjectBegin before its first use";
                    return Err(params
                        .location
                        .error(format!("there is no object `{name}`"), advice));
                };
                let mut all = Vec::new();
                for shape in &shapes {
                    let placed = |error: Error| shape.params.placed(&error);
                    let transform = Transform::new(shape.map).map_err(placed)?;
                    let Some(part) = self.part(shape, Some(&name))? else { continue };
                    let transform = transform.relative_from(part.origin);
                    if part.mesh.positions.iter().any(|at| transform.point(*at).is_none()) {
                        return Err(placed(out_of_range()));
                    }
                    let mesh = Arc::new(part.mesh.moved(&transform));
                    all.push(MaterialMesh::new(mesh, part.material));
                }
                objects.insert(name.clone(), all);
            }
            self.place(&name, &objects[&name].clone(), world * map, &params)?;
        }
        Ok(())
    }

    fn place(
        &mut self,
        name: &str,
        parts: &[MaterialMesh],
        map: DAffine3,
        params: &Params,
    ) -> Result<()> {
        let placed = self.builder.place_by(name, parts, map, false);
        placed.map_err(|error| params.placed(&error))
    }

    /// The mesh of a shape in its own space, with its material; `None` if it is invisible. As in
    /// pbrt, shapes of objects do not emit.
    fn part(&mut self, shape: &PlacedShape, object: Option<&str>) -> Result<Option<Part>> {
        let PlacedShape { params, map, state } = shape;
        let boundary = self.media.boundary(&state.media, params)?;
        self.has_media |= state.media.iter().any(|name| !name.is_empty());
        let lamp = state.area_light.clone().filter(|_| object.is_none());
        if let (Some(object), true) = (object, state.area_light.is_some()) {
            let phrase = "left out, as pbrt does, the emission of shapes of objects:";
            self.textures.warnings.skipped(phrase, object);
        }
        let made = shapes::mesh(params, lamp.is_some(), &mut self.textures)?;
        let Some((mut mesh, origin)) = made else { return Ok(None) };
        let stored = self.builder.count(0, mesh.triangles.len() as u64);
        stored.map_err(|error| params.placed(&error))?;
        let (mut look, number) =
            self.materials.look(&state.material, params, &mut self.textures)?;
        let alpha = self.textures.varying(params, "alpha")?;
        let _ = params.get("shadowalpha");
        self.warn_of_unused(params);
        let paint = |lamp: &Rc<AreaLight>| lamp.paint(&mesh, *map, &mut self.textures);
        let emission =
            lamp.as_ref().map(paint).transpose()?.filter(|paint| paint.color != Rgb::ZERO);
        look.bound(boundary);
        if look.is_interface && emission.is_none() {
            return Ok(None);
        }
        let alpha = alpha.filter(|alpha| alpha.texture.is_some() || alpha.color.x < 1.0);
        let is_plain = emission.is_none() && alpha.is_none() && look.material.boundary.is_none();
        if let (Some(paint), Some(lamp)) = (emission, &lamp) {
            self.emit(&mut look, paint, lamp, params)?;
        }
        self.mask(&mut look, alpha, params);
        map_uvs(&mut mesh, look.to_uv());
        if state.reverse_orientation {
            mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
            mesh.normals.iter_mut().for_each(|normal| *normal = -*normal);
        }
        let material = match self.material_index.get(&number).filter(|_| is_plain) {
            Some(known) => *known,
            None => self.builder.add_material(look.material),
        };
        if is_plain {
            self.material_index.insert(number, material);
        }
        Ok(Some(Part { mesh, material, origin }))
    }

    /// Lets a shape emit by its area light.
    fn emit(
        &mut self,
        look: &mut Look,
        mut paint: Paint,
        lamp: &AreaLight,
        params: &Params,
    ) -> Result<()> {
        paint.color *= self.film.scale;
        let shares_map = look.emit(paint);
        self.textures.warnings.skipped_if([(!shares_map, ONE_MAP)], &params.kind);
        look.material.two_sided_emission = lamp.is_two_sided()?;
        Ok(())
    }

    /// Lets a share of the rays pass a shape. A constant alpha of 0 makes lamps invisible in pbrt,
    /// which still shine.
    fn mask(&mut self, look: &mut Look, alpha: Option<Paint>, params: &Params) {
        let Some(alpha) = alpha else { return };
        let emits = look.material.emission != Rgb::ZERO;
        if emits && alpha.texture.is_none() && alpha.color.x <= 0.0 {
            let phrase = "hid from the camera only the lamps that are invisible, of type";
            self.textures.warnings.skipped(phrase, &params.kind);
            look.material.hidden_from_camera = true;
            return;
        }
        let shares_map = look.mask(&alpha);
        self.textures.warnings.skipped_if([(!shares_map, ONE_MAP)], &params.kind);
    }

    fn warn_of_unused(&mut self, params: &Params) {
        self.textures.warn_of_unused(params, |_| true, &params.kind);
    }
}

fn scaled(emitter: Emitter, scale: f32) -> Emitter {
    match emitter {
        Emitter::Point { position, intensity } => {
            Emitter::Point { position, intensity: scale * intensity }
        }
        Emitter::Spot(mut spot) => {
            spot.intensity *= scale;
            Emitter::Spot(spot)
        }
        Emitter::Directional(mut light) => {
            light.irradiance *= scale;
            Emitter::Directional(light)
        }
        other => other,
    }
}
