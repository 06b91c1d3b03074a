//! Scenes of Mitsuba 3, 0.6 and 0.5, as XML.
//!
//! `docs/reference/mitsuba.md` describes the conversion of each plugin and its differences from
//! Mitsuba. Each approximation is a warning. Errors name file, line and element.

mod analytic;
mod bsdf;
mod color;
mod document;
mod emitter;
mod maps;
mod medium;
mod obj_files;
mod object;
mod sensor;
mod serialized;
mod shape;
mod sky;
mod texture;

use super::ImportOptions;
use crate::builder::{Builder, Contents, EnvironmentReader, FileNames, ReadScene};
use crate::sensor::MIRROR;
use crate::shape::instancing::MaterialMesh;
use crate::text::list;
use bdpm_core::base::error::Result;
use bdpm_core::scene::Emitter;
use bdpm_core::settings::PartialSettings;
use bsdf::BsdfCache;
use document::XmlDocument;
use emitter::EnvironmentEmitter;
use glam::{DAffine3, DMat3};
use medium::MediumCache;
use obj_files::ObjFiles;
use object::Object;
use sensor::Sensor;
use shape::{MeshKey, ShapeMeshes};
use std::collections::HashMap;
use std::path::Path;
use texture::Paints;

/// Reads a scene as seen by the sensor of the requested id, else by its first sensor.
///
/// # Errors
/// Names the line and element that is malformed or not supported.
pub(super) fn read(path: &Path, options: &ImportOptions) -> Result<ReadScene> {
    let document = XmlDocument::read(path)?;
    SceneReader::default().read(path, &document, options)
}

/// A scene that is being read.
#[derive(Default)]
struct SceneReader {
    builder: Builder,
    paints: Paints,
    bsdfs: BsdfCache,
    media: MediumCache,
    obj_files: ObjFiles,
    meshes: HashMap<MeshKey, ShapeMeshes>,
    /// Materials that several shapes share, by the elements of their BSDF and of the media on both
    /// sides.
    shared: HashMap<(Option<usize>, [Option<usize>; 2]), u32>,
    /// By element.
    groups: HashMap<usize, Vec<MaterialMesh>>,
}

impl SceneReader {
    fn read(
        mut self,
        path: &Path,
        document: &XmlDocument,
        options: &ImportOptions,
    ) -> Result<ReadScene> {
        let top = |tag: &str| {
            let own = |index: &&usize| document.elements[**index].tag == tag;
            document.top.iter().filter(own).map(|index| Object::new(document, *index)).collect()
        };
        let sensors: Vec<Object> = top("sensor");
        let chosen = sensor::choose(&sensors, options.camera, &mut self.paints)?;
        let sensor = match &chosen {
            Some(object) => Sensor::read(object, &mut self.paints)?.map(|read| (read, *object)),
            None => None,
        };
        self.warn_of_integrators(&top("integrator"))?;
        let lights: Vec<Object> = top("emitter");
        let environment = self.environment(&lights)?;
        let is_mirrored = sensor.as_ref().is_some_and(|(sensor, _)| sensor.is_mirrored());
        let mut world = self.world(environment.as_ref(), is_mirrored);
        world.translation -= options.origin();
        let (emitters, light_names) = self.emitters(&lights, world)?;
        let shapes: Vec<Object> = top("shape");
        self.obj_files = ObjFiles::read(&shapes);
        shapes.iter().try_for_each(|shape| self.place(shape, world))?;
        let around_camera = match &chosen {
            Some(object) => self.media.around(object, &mut self.paints)?,
            None => None,
        };
        self.warn_of_unused(document);
        let builder = self.with_warnings(path, document);
        let resolution = sensor.as_ref().map(|(sensor, _)| sensor.resolution);
        let camera = sensor.as_ref().map(|(sensor, object)| sensor.camera(world, object));
        let environment = environment.map(|own| -> EnvironmentReader {
            let light = lights.iter().find(|light| is_environment(light));
            Box::new(move |_| {
                own.environment(is_mirrored).map_err(|error| match light {
                    Some(light) => light.placed(&error),
                    None => error,
                })
            })
        });
        let names = FileNames {
            cameras: sensors.iter().map(Object::label).collect(),
            camera: sensor.as_ref().map(|(sensor, _)| sensor.name.clone()),
            ..FileNames::default()
        };
        let contents = Contents {
            lights: emitters,
            light_names,
            camera: camera.transpose()?,
            environment,
            defaults: PartialSettings { resolution, ..PartialSettings::default() },
            filling_medium: builder.filling_medium(around_camera),
            names,
            ..Contents::default()
        };
        builder.finish(path, contents, options)
    }

    /// The builder with all warnings.
    fn with_warnings(self, path: &Path, document: &XmlDocument) -> Builder {
        let Self { mut builder, mut paints, .. } = self;
        document.guessed.borrow().iter().for_each(|name| paints.warnings.guessed(name));
        builder.warnings.extend(paints.warnings.into_warnings(&path.display().to_string()));
        builder
    }

    /// The emitters at points and far away, and their ids.
    fn emitters(
        &mut self,
        lights: &[Object],
        world: DAffine3,
    ) -> Result<(Vec<Emitter>, Vec<Option<String>>)> {
        let (mut emitters, mut names) = (Vec::new(), Vec::new());
        for light in lights.iter().filter(|light| !is_environment(light)) {
            let emitter = emitter::emitter(light, world, &mut self.paints)?;
            names.extend(emitter.as_ref().map(|_| light.id().map(str::to_owned)));
            emitters.extend(emitter);
        }
        Ok((emitters, names))
    }

    /// Warns that the integrators of the file have no effect.
    fn warn_of_integrators(&mut self, integrators: &[Object]) -> Result<()> {
        for integrator in integrators {
            let depth = integrator.float("max_depth")?.filter(|depth| *depth >= 0.0);
            let phrase = match depth {
                Some(depth) => format!("ignored the path length limit of {depth} segments of"),
                None => "ignored the integrator".to_owned(),
            };
            self.paints.chosen(phrase, integrator);
        }
        Ok(())
    }

    /// The first environment of the emitters; `sky` and `sun` of 0.6 together are one.
    fn environment(&mut self, lights: &[Object]) -> Result<Option<EnvironmentEmitter>> {
        let mut found: Option<EnvironmentEmitter> = None;
        for light in lights.iter().filter(|light| is_environment(light)) {
            let own = EnvironmentEmitter::read(light, &mut self.paints)?;
            let Some(first) = &mut found else {
                found = own;
                continue;
            };
            if !own.is_some_and(|own| first.complete(&own)) {
                self.paints.skipped("left out further environments:", light);
            }
        }
        Ok(found)
    }

    /// The transform of the scene. Our environment maps are upright, and our images are not
    /// mirrored.
    fn world(&mut self, environment: Option<&EnvironmentEmitter>, is_mirrored: bool) -> DAffine3 {
        let turn = environment.map_or(DMat3::IDENTITY, EnvironmentEmitter::upright);
        let mirror = if is_mirrored { MIRROR } else { DMat3::IDENTITY };
        let world = mirror * turn;
        if world != DMat3::IDENTITY {
            let phrase = "turned or mirrored, with camera and environment,";
            self.paints.warnings.chosen(phrase, "the scene");
        }
        DAffine3::from_mat3(world)
    }

    /// Adds a shape, or an instance of a group.
    fn place(&mut self, object: &Object, world: DAffine3) -> Result<()> {
        let (name, parts, map, flip) = match object.kind() {
            "shapegroup" => return Ok(()), // its instances show it
            "instance" => {
                let group = object.all("shape")?.into_iter().find(|g| g.kind() == "shapegroup");
                let group = group.ok_or_else(|| {
                    object.error("it refers to no shapegroup", "add a <ref> to one")
                })?;
                (object.label(), self.group(&group)?, object.map("to_world")?, false)
            }
            _ => {
                let Some(shape) = self.shape(object)? else { return Ok(()) };
                (shape.name, shape.parts, shape.map, shape.is_flipped)
            }
        };
        let placed = self.builder.place_by(&name, &parts, world * map, flip);
        placed.map_err(|error| object.placed(&error))
    }

    /// Warns of properties without effect, of elements that were read.
    fn warn_of_unused(&mut self, document: &XmlDocument) {
        let is_used = |index: usize| document.elements[index].used.get();
        for (index, element) in document.elements.iter().enumerate() {
            let is_known = matches!(
                &element.tag[..],
                "sensor" | "film" | "emitter" | "shape" | "bsdf" | "texture"
            );
            if !is_known || !is_used(index) {
                continue;
            }
            let child = |index: &&usize| {
                let tag = &document.elements[**index].tag;
                !is_used(**index) && !matches!(&tag[..], "sampler" | "rfilter" | "bsdf" | "shape")
            };
            let names: Vec<&str> = element
                .children
                .iter()
                .filter(child)
                .map(|index| &document.elements[*index])
                .map(|one| one.attribute("name").unwrap_or(&one.tag))
                .filter(|name| IRRELEVANT.split(' ').all(|word| word != *name))
                .collect();
            if !names.is_empty() {
                let owner = Object { document, index };
                self.paints.skipped(format!("ignored {} of", list(names)), &owner);
            }
        }
    }
}

/// Properties that do not change the content of the image.
const IRRELEVANT: &str = "accel attach_log banner cache component_format compress exposure file_format filter_type \
                          format fov_axis gamma high_quality_edges max_smooth_angle mis_compensation pixel_format \
                          sample_border sample_visible sampling_weight shutter_close shutter_open \
                          silhouette_sampling_weight specular_sampling_weight tonemap_method";

fn is_environment(light: &Object) -> bool {
    matches!(light.kind(), "constant" | "envmap") || sky::is_sky(light)
}
