//! Scenes of Mitsuba 3, and of 0.5 and 0.6, as XML.
//!
//! What each plugin becomes, and how far that is from what Mitsuba shows, is told in `docs/mitsuba.md`; whatever is
//! approximated is a note. Errors name file, line and element.

mod analytic;
mod bsdf;
mod bumps;
mod color;
mod document;
mod emitter;
mod maps;
mod metals;
mod names;
mod object;
mod warnings;
mod sensor;
mod serialized;
mod shape;
mod smooth;
mod texture;

use super::builder::{Builder, Rest};
use super::instancing::Part;
use super::load::{LoadOptions, Loaded};
use super::text::list;
use super::warnings::Warning;
use crate::base::error::Result;
use crate::settings::PartialSettings;
use bsdf::Bsdfs;
use document::Document;
use emitter::{MIRROR, Surroundings};
use glam::{DAffine3, DMat3};
use object::Object;
use sensor::Sensor;
use shape::{Key, Meshes, Parts};
use std::collections::HashMap;
use std::path::Path;
use texture::Pictures;
use warnings::Remarks;

/// Loads a scene as seen by the sensor of the id that is asked for, else its first, else one that sees everything.
///
/// # Errors
/// Names the file, line and element that is malformed or not supported.
pub(super) fn load(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    let document = Document::read(path)?;
    let reader = Reader {
        path,
        builder: Builder::new(Vec::new()),
        pictures: Pictures::default(),
        bsdfs: Bsdfs::default(),
        remarks: Remarks::default(),
        meshes: HashMap::new(),
        shared: HashMap::new(),
        groups: HashMap::new(),
    };
    let load = || reader.load(&document, options);
    load().map_err(|error| if error.has_location() { error } else { error.at(path) })
}

/// A scene as it is read.
struct Reader<'a> {
    path: &'a Path,
    builder: Builder,
    pictures: Pictures,
    bsdfs: Bsdfs,
    remarks: Remarks,
    meshes: HashMap<Key, Meshes>,
    /// Materials of BSDFs that several shapes share, by element.
    shared: HashMap<Option<usize>, u32>,
    /// By element.
    groups: HashMap<usize, Parts>,
}

impl Reader<'_> {
    fn load(mut self, document: &Document, options: &LoadOptions) -> Result<Loaded> {
        let shown = self.path.display().to_string();
        let top = |tag: &str| {
            let own = |index: &&usize| document.elements[**index].tag == tag;
            document.top.iter().filter(own).map(|index| Object::new(document, *index)).collect()
        };
        let sensors: Vec<Object> = top("sensor");
        let chosen = sensor::choose(&sensors, options.camera, &mut self.remarks)?;
        let sensor = chosen.map(|object| Sensor::read(&object, &mut self.remarks)).transpose()?;
        self.ignored(&top("integrator"))?;
        let lights: Vec<Object> = top("emitter");
        let surroundings = self.surroundings(&lights)?;
        let is_mirrored = sensor.as_ref().is_some_and(Sensor::is_mirrored);
        let world = self.world(surroundings.as_ref(), is_mirrored);

        let mut emitters = Vec::new();
        for light in lights.iter().filter(|light| !is_surrounding(light)) {
            let emitter = emitter::emitter(light, world, &mut self.pictures, &mut self.remarks)?;
            emitters.extend(emitter);
        }
        for shape in &top("shape") {
            self.place(shape, world)?;
        }
        self.unused(document);
        let Self { mut builder, remarks, path, .. } = self;
        builder.notes.extend(remarks.notes(&shown));
        builder.arrange(path)?;
        let (camera, resolution) = match (&sensor, &chosen) {
            (Some(sensor), Some(object)) => {
                (sensor.camera(world, object)?, Some(sensor.resolution))
            }
            _ => (builder.place_camera(path)?, None),
        };
        let defaults = PartialSettings { resolution, ..PartialSettings::default() };
        let mut rest = Rest { defaults, ..options.rest(&mut builder.notes)? };
        match (surroundings, &rest.environment) {
            (Some(_), Some(_)) => {
                let note = format!("{shown}: --environment takes the place of its own");
                builder.notes.push(Warning::chosen(note));
            }
            (own, None) => rest.environment = own.map(|own| own.environment(is_mirrored)),
            (None, Some(_)) => {}
        }
        rest.fallback = false;
        let names = sensors.iter().map(Object::label).collect();
        let mut loaded = builder.finish(path, emitters, camera, rest)?;
        loaded.summary.cameras = names;
        loaded.summary.camera = sensor.map(|sensor| sensor.name);
        Ok(loaded)
    }

    /// Tells of blocks that say how to render rather than what.
    fn ignored(&mut self, integrators: &[Object]) -> Result<()> {
        for integrator in integrators {
            let depth = integrator.float("max_depth")?.filter(|depth| *depth >= 0.0);
            let phrase = match depth {
                Some(depth) => {
                    format!("paths go on where the file ends them after {depth} segments:")
                }
                None => "rendered in its own way, whatever the integrator is:".to_owned(),
            };
            self.remarks.chosen(phrase, &integrator.label());
        }
        Ok(())
    }

    /// Light from all around; of several the first.
    fn surroundings(&mut self, lights: &[Object]) -> Result<Option<Surroundings>> {
        let mut found = None;
        for light in lights.iter().filter(|light| is_surrounding(light)) {
            if found.is_some() {
                self.remarks.skipped("left out more light from all around:", &light.label());
                continue;
            }
            found = Surroundings::read(light, &mut self.pictures, &mut self.remarks)?;
        }
        Ok(found)
    }

    /// What moves the scene: a map of surroundings is upright in ours, and no image is mirrored.
    fn world(&mut self, surroundings: Option<&Surroundings>, is_mirrored: bool) -> DAffine3 {
        let turn = surroundings.map_or(DMat3::IDENTITY, Surroundings::upright);
        let mirror = if is_mirrored { MIRROR } else { DMat3::IDENTITY };
        let world = mirror * turn;
        if world != DMat3::IDENTITY {
            let all = "the scene";
            self.remarks.chosen("turned or mirrored, with its camera and surroundings, was", all);
        }
        DAffine3::from_mat3(world)
    }

    /// Adds a shape, or an instance of a group.
    fn place(&mut self, object: &Object, world: DAffine3) -> Result<()> {
        let (name, parts, map, flip) = match object.kind() {
            "shapegroup" => return Ok(()), // shown by its instances
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
        let count = parts.iter().map(|(mesh, _)| mesh.triangles.len() as u64).sum();
        self.builder.count(count, 0, self.path)?;
        let transform = self.transform(object, world * map, flip)?;
        let parts: Vec<Part> = parts
            .iter()
            .map(|(mesh, material)| Part { name: &name, mesh, material: *material })
            .collect();
        self.builder.place(&parts, &transform).ok_or_else(|| {
            let problem = "its transform moves it out of the range of coordinates";
            object.error(problem, "scale or move it less")
        })
    }

    /// Tells of values that nobody asked for, of elements that somebody did.
    fn unused(&mut self, document: &Document) {
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
                .filter(|name| !IRRELEVANT.contains(name))
                .collect();
            if !names.is_empty() {
                let owner = Object { document, index };
                self.remarks.skipped(format!("ignored {} of", list(names)), &owner.label());
            }
        }
    }
}

/// What says nothing about the image's content.
const IRRELEVANT: &[&str] = &[
    "file_format",
    "pixel_format",
    "component_format",
    "banner",
    "high_quality_edges",
    "sample_border",
    "gamma",
    "exposure",
    "tonemap_method",
    "shutter_open",
    "shutter_close",
    "sampling_weight",
    "format",
    "max_smooth_angle",
    "silhouette_sampling_weight",
    "specular_sampling_weight",
    "accel",
    "compress",
    "mis_compensation",
    "filter_type",
    "cache",
    "attach_log",
    "fov_axis",
    "sample_visible",
];

fn is_surrounding(light: &Object) -> bool {
    matches!(light.kind(), "constant" | "envmap")
}
