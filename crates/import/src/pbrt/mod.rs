//! Scenes of pbrt-v4.
//!
//! `docs/reference/pbrt.md` describes the conversion of each directive and its differences from
//! pbrt. Each approximation is a warning. Errors name file and line.

mod camera;
mod directives;
mod image_light;
mod lights;
mod materials;
mod media;
mod params;
mod pfm;
mod shapes;
mod spectra;
mod state;
mod subdivision;
mod textures;
mod tokens;

use super::builder::{Builder, SceneExtras};
use super::curves;
use super::instancing::MaterialMesh;
use super::load::{LoadOptions, Loaded};
use super::text::{list, placed_at};
use super::warnings::replaced_environment;
use crate::paint::Paint;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::transform::Transform;
use bdpm_core::scene::{Emitter, Material, Mesh, NormalMap};
use bdpm_core::settings::PartialSettings;
use camera::{CameraSource, FilmSource};
use glam::{DAffine3, DMat3, DVec3, Vec2};
use lights::back_of;
use materials::{Look, Materials};
use media::Media;
use params::Params;
use spectra::ColorSpace;
use state::GraphicsState;
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;
use textures::{Textures, stored_shares};
use tokens::{Location, SourceFiles};

/// Loads a scene as seen by its camera, else by one that sees everything.
///
/// # Errors
/// Names the file and line of a directive that is malformed or unknown.
pub(super) fn load(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut reader = SceneReader {
        path,
        builder: Builder::new(Vec::new()),
        textures: Textures::new(folder),
        materials: Materials::default(),
        media: Media::default(),
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
    let finished = reader.read(path).and_then(|()| reader.finish(options));
    finished.map_err(|error| placed_at(error, path))
}

/// A shape with its transform to the world.
struct PlacedShape {
    params: Params,
    map: DAffine3,
    state: GraphicsState,
}

/// A scene that is being read.
struct SceneReader<'a> {
    path: &'a Path,
    builder: Builder,
    textures: Textures,
    materials: Materials,
    media: Media,
    /// Name of the medium around the camera; empty for none.
    camera_medium: String,
    /// Index of a material by its look, and the bits of what depends on the shape.
    material_index: HashMap<(usize, u32), u32>,
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
}

/// Swaps left and right.
const MIRROR: DMat3 = DMat3::from_cols(DVec3::NEG_X, DVec3::Y, DVec3::Z);

impl SceneReader<'_> {
    fn finish(mut self, options: &LoadOptions) -> Result<Loaded> {
        let is_mirrored = self.camera.as_ref().is_some_and(CameraSource::is_mirrored);
        let world = DAffine3::from_mat3(if is_mirrored { MIRROR } else { DMat3::IDENTITY });
        if is_mirrored {
            let phrase = "mirrored, with its camera (pbrt's spaces are left-handed),";
            self.textures.warnings.chosen(phrase, "the scene");
        }
        let mut emitters = Vec::new();
        let mut environment = None;
        for (params, map, space) in std::mem::take(&mut self.lights) {
            let map = world * map;
            if params.kind == "infinite" {
                if environment.is_some() {
                    self.textures
                        .warnings
                        .skipped("left out all but the first of", "infinite lights");
                    continue;
                }
                let made = image_light::environment(
                    &params,
                    space,
                    map.matrix3,
                    self.film.scale,
                    &mut self.textures,
                )?;
                environment = Some(made);
            } else if let Some(emitter) = lights::emitter(&params, space, map, &mut self.textures)?
            {
                emitters.push(scaled(emitter, self.film.scale));
            }
            self.warn_of_unused(&params);
        }
        let mut hair: Option<(Part, PlacedShape)> = None;
        for shape in std::mem::take(&mut self.shapes) {
            let mut parts = self.parts(&shape, true)?;
            // Files have a shape for each hair: those of one material become one mesh.
            if shape.params.kind == "curve" && parts.len() == 1 {
                let own = parts.remove(0);
                match &mut hair {
                    Some((all, first))
                        if all.material == own.material && first.map == shape.map =>
                    {
                        curves::join(&mut all.mesh, &own.mesh);
                    }
                    _ => self.place_curves(hair.replace((own, shape)), world)?,
                }
                continue;
            }
            for Part { mesh, material } in parts {
                let name = mesh.name.clone();
                let part = MaterialMesh { mesh: Arc::new(mesh), material };
                self.place(&name, &[part], world * shape.map, &shape.params)?;
            }
        }
        self.place_curves(hair, world)?;
        self.place_objects(world)?;
        if self.has_media && self.builder.is_empty() {
            let problem = "the scene has only media of types that are not supported";
            return Err(Error::new(problem, "add surfaces").at(self.path));
        }
        self.build(options, world, emitters, environment)
    }

    /// Places the mesh of joined curves, if there is one.
    fn place_curves(&mut self, hair: Option<(Part, PlacedShape)>, world: DAffine3) -> Result<()> {
        let Some((Part { mesh, material }, shape)) = hair else { return Ok(()) };
        let parts = [MaterialMesh { mesh: Arc::new(mesh), material }];
        self.place("curves", &parts, world * shape.map, &shape.params)
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
                    let transform = invertible(shape.map, &shape.params)?;
                    for Part { mesh, material } in self.parts(shape, false)? {
                        if mesh.positions.iter().any(|point| transform.point(*point).is_none()) {
                            return Err(out_of_range(&shape.params));
                        }
                        let mesh = Arc::new(mesh.moved(&transform));
                        all.push(MaterialMesh { mesh, material });
                    }
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
        let count = parts.iter().map(|part| part.mesh.triangles.len() as u64).sum();
        let placed = self.builder.count(count, 0, self.path);
        let placed =
            placed.and_then(|()| self.builder.count_placements(parts.len() as u64, self.path));
        placed.map_err(|error| params.error(error.problem(), error.advice()))?;
        let transform = invertible(map, params)?;
        let placed = self.builder.place(Some(name), parts, &transform);
        placed.ok_or_else(|| out_of_range(params))
    }

    /// The meshes of a shape in its own space, with their materials: none if it is invisible, two
    /// if it emits on both sides.
    fn parts(&mut self, shape: &PlacedShape, may_emit: bool) -> Result<Vec<Part>> {
        let PlacedShape { params, map, state } = shape;
        let boundary = self.media.boundary(&state.media, params)?;
        self.has_media |= state.media.iter().any(|name| !name.is_empty());
        let lamp = state.area_light.clone().filter(|_| may_emit);
        if state.area_light.is_some() && !may_emit {
            self.textures.warnings.skipped("left out the emission of shapes of", "objects");
        }
        let Some(mut mesh) = shapes::mesh(params, lamp.is_some(), &mut self.textures)? else {
            return Ok(Vec::new());
        };
        let stored = self.builder.count(0, mesh.triangles.len() as u64, self.path);
        stored.map_err(|error| params.error(error.problem(), error.advice()))?;
        let (look, number) = self.materials.look(&state.material, params, &mut self.textures)?;
        let alpha = self.textures.varying(params, "alpha")?;
        let _ = params.get("shadowalpha");
        self.warn_of_unused(params);
        let emission = match &lamp {
            Some(lamp) => Some(lamp.paint(&mesh, *map, &mut self.textures)?),
            None => None,
        };
        let emission = emission.filter(|paint| paint.color != Rgb::ZERO);
        let boundary = boundary.filter(|_| look.is_interface || look.bsdf.transmits());
        let look =
            if look.is_interface && boundary.is_some() { look.index_matched() } else { look };
        if look.is_interface && emission.is_none() && boundary.is_none() {
            return Ok(Vec::new());
        }
        let alpha = alpha.filter(|alpha| alpha.texture.is_some() || alpha.color.x < 1.0);
        if alpha.is_some() && emission.is_some() {
            self.textures.warnings.skipped("left out the transparency of", "shapes that emit");
        }
        let to_uv = match (&look.albedo, &look.normal_map, &emission, &alpha) {
            (None, None, Some(paint), _) => paint.to_uv,
            (None, None, None, Some(alpha)) => alpha.to_uv,
            _ => look.to_uv,
        };
        for uv in &mut mesh.uvs {
            let own = to_uv.transform_point2(*uv);
            *uv = if own.is_finite() { own } else { Vec2::ZERO };
        }
        if state.reverse_orientation {
            mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
            mesh.normals.iter_mut().for_each(|normal| *normal = -*normal);
        }
        let plain = emission.is_none() && alpha.is_none() && boundary.is_none();
        let material = match self.material_index.get(&(number, 0)).filter(|_| plain) {
            Some(known) => *known,
            None => {
                let material = Material { boundary, ..self.material(&look, emission, alpha) };
                self.builder.materials.push(material);
                let made = self.builder.materials.len() as u32 - 1;
                if plain {
                    self.material_index.insert((number, 0), made);
                }
                made
            }
        };
        let is_two_sided = match &lamp {
            Some(lamp) => {
                lamp.is_two_sided()?
                    && self.builder.materials[material as usize].emission != Rgb::ZERO
            }
            None => false,
        };
        if is_two_sided {
            let back = back_of(&mesh);
            return Ok(vec![Part { mesh, material }, Part { mesh: back, material }]);
        }
        Ok(vec![Part { mesh, material }])
    }

    fn material(&self, look: &Look, emission: Option<Paint>, alpha: Option<Paint>) -> Material {
        let scale = self.film.scale;
        let opacity_texture = alpha.as_ref().and_then(stored_shares);
        let opacity = alpha.map(|alpha| match opacity_texture {
            Some(_) => 1.0,
            None => alpha.color.x.clamp(0.0, 1.0),
        });
        Material {
            dispersion: look.dispersion.clone(),
            albedo_texture: look.albedo.clone(),
            opacity,
            opacity_texture,
            normal_map: look
                .normal_map
                .as_ref()
                .map(|texture| NormalMap { texture: texture.clone(), scale: 1.0 }),
            emission: emission.as_ref().map_or(Rgb::ZERO, |paint| paint.color * scale),
            emission_texture: emission.and_then(|paint| paint.texture),
            ..Material::new(&look.name, look.bsdf)
        }
    }

    fn warn_of_unused(&mut self, params: &Params) {
        let unused: Vec<&str> = params.unused().collect();
        if !unused.is_empty() {
            let phrase = format!("ignored {} of", list(unused));
            self.textures.warnings.skipped(phrase, &params.kind);
        }
    }

    fn build(
        mut self,
        options: &LoadOptions,
        world: DAffine3,
        emitters: Vec<Emitter>,
        environment: Option<bdpm_core::scene::Environment>,
    ) -> Result<Loaded> {
        let path = self.path;
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
        builder.arrange(path)?;
        let camera = match camera {
            Some(camera) => camera,
            None => builder.default_camera(path, options.camera_change)?,
        };
        let defaults =
            PartialSettings { resolution: Some(film.resolution()), ..PartialSettings::default() };
        let extras = options.extras(&mut builder.warnings)?;
        let filling_medium = builder.filling_medium(media.named(&camera_medium));
        let mut extras = SceneExtras { defaults, default_light: false, filling_medium, ..extras };
        match (environment, &extras.environment) {
            (Some(_), Some(_)) => builder.warnings.push(replaced_environment(path)),
            (own, None) => extras.environment = own,
            (None, Some(_)) => {}
        }
        builder.finish(path, emitters, camera, extras)
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

fn invertible(map: DAffine3, params: &Params) -> Result<Transform> {
    Transform::new(map).map_err(|error| params.location.place(error))
}

fn out_of_range(params: &Params) -> Error {
    let problem = "the current transform moves it out of the range of coordinates";
    params.error(problem, "reduce its scale or translation")
}
