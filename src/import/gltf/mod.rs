//! glTF 2.0, as `.gltf` with its buffers and pictures, or as `.glb`.
//!
//! Whatever is wrong with a file, the error names the JSON element, such as `nodes[3].mesh`.

mod accessor;
mod buffers;
mod camera;
mod factors;
mod file;
mod geometry;
mod instances;
mod json;
mod json_material;
mod light;
mod material;
mod meshes;
mod nodes;
mod pose;
mod warnings;
mod texture;

use super::builder::{Builder, Rest};
use super::instancing::Part;
use super::load::{LoadOptions, Loaded};
use super::text::list;
use super::warnings::Warning;
use crate::base::error::{Error, Result, visible};
use crate::scene::transform::Transform;
use crate::settings::PartialSettings;
use buffers::Buffers;
use glam::DAffine3;
use json::Document;
use meshes::Meshes;
use nodes::Placed;
use pose::Pose;
use std::collections::BTreeSet;
use std::fmt::Display;
use std::path::Path;
use texture::Pictures;

/// What to do about a malformed file.
const AGAIN: &str = "export the model again; a glTF validator may tell more";

/// A malformed element of the file.
fn fault(place: impl Display, problem: impl Display) -> Error {
    Error::new(format!("{place}: {problem}"), AGAIN)
}

/// Loads a glTF file as seen by the camera of the name that is asked for, else its first, else one that sees
/// everything.
///
/// # Errors
/// Names the file, and the element that is malformed or not supported.
pub(super) fn load(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    read(path, options).map_err(|error| if error.has_location() { error } else { error.at(path) })
}

fn read(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    let (document, bin) = file::read(path)?;
    let shown = path.display().to_string();
    let mut builder = Builder::new(notes(&document, &shown));
    let (nodes, is_odd) = nodes::placed(&document)?;
    if is_odd {
        let note = "the scene lists nodes below others, or twice; each is shown once";
        builder.notes.push(Warning::chosen(format!("{shown}: {note}")));
    }
    let cameras = camera::candidates(&document, &nodes)?;
    let chosen = camera::choose(&cameras, options.camera, &mut builder.notes)?;
    let view = chosen.map(|chosen| chosen.camera()).transpose()?;
    let mut lights = Vec::new();
    let mut light_names = Vec::new();
    for placed in &nodes {
        if let Some(light) = light::light(&document, placed)? {
            light_names.push(light.name);
            lights.push(light.emitter);
        }
    }

    let folder = path.parent().unwrap_or(Path::new(""));
    let mut meshes = Meshes::new(&document);
    let [placed, new] = meshes.triangle_counts(&nodes)?;
    builder.count(placed, new, path)?;
    let buffers = Buffers::load(&document, bin, folder)?;
    let mut pictures = Pictures::new(&document, &buffers, folder);
    let all_maps = nodes.iter().map(|placed| (placed.index, placed.map)).collect();
    // Each mesh with each of its places.
    for placed in &nodes {
        let Some(index) = placed.node.mesh else { continue };
        let name = mesh_name(&document, placed, index);
        let pose = Pose::new(&document, &buffers, placed, index, &all_maps)?;
        // A skin's joints say where its mesh is, whatever its node does.
        let maps = match pose.has_location() {
            true => vec![DAffine3::IDENTITY],
            false => instances::maps(&document, &buffers, placed)?,
        };
        let materials = &mut builder.materials;
        let parts = meshes.get((index, placed), &pose, &buffers, &mut pictures, materials)?;
        let parts: Vec<_> = parts.to_vec();
        let parts: Vec<_> = parts
            .iter()
            .map(|(mesh, material)| Part { name: &name, mesh, material: *material })
            .collect();
        for map in maps {
            let Ok(transform) = Transform::new(map) else {
                // The map is finite.
                meshes.remarks.chosen("left out what its transform flattens:", &name);
                continue;
            };
            builder.place(&parts, &transform).ok_or_else(|| {
                let problem = "its transform moves the mesh out of the range of coordinates";
                let place = format!("nodes[{}]", placed.index);
                Error::new(format!("{place}: {problem}"), "scale or move it less")
            })?;
        }
    }
    if builder.is_empty() && !meshes.hidden.is_empty() {
        let names = list(meshes.hidden.iter().map(String::as_str));
        let problem =
            format!("nothing is to be seen: the opacity is below the cutoff all over {names}");
        let advice = "lower their alphaCutoff, raise the alpha of their base color, or set alphaMode to OPAQUE";
        return Err(Error::new(problem, advice));
    }
    builder.notes.extend(meshes.remarks.notes(&shown));
    builder.notes.extend(pictures.notes(&shown));
    builder.arrange(path)?;

    let (camera, resolution) = match view {
        Some(view) => view,
        None => (builder.place_camera(path)?, None),
    };
    let defaults = PartialSettings { resolution, ..PartialSettings::default() };
    let rest = Rest { defaults, ..options.rest(&mut builder.notes)? };
    let mut loaded = builder.finish(path, lights, camera, rest)?;
    loaded.summary.light_names = light_names;
    loaded.summary.cameras = cameras.iter().map(|camera| camera.name.clone()).collect();
    loaded.summary.camera = chosen.map(|camera| camera.name.clone());
    Ok(loaded)
}

/// What the file holds and no image shows.
fn notes(document: &Document, shown: &str) -> Vec<Warning> {
    let mut notes = Vec::new();
    let unsupported: BTreeSet<&str> = file::unsupported(&document.extensions_used).collect();
    if !unsupported.is_empty() {
        let names = list(unsupported);
        notes.push(Warning::skipped(format!("{shown}: ignored the extensions {names}")));
    }
    if !document.animations.is_empty() {
        let note = "animations are not played: all is where the nodes have it";
        notes.push(Warning::chosen(format!("{shown}: {note}")));
    }
    notes
}

/// The node's name, else the mesh's, else the node's place in the file.
fn mesh_name(document: &Document, placed: &Placed, mesh: usize) -> String {
    let own = document.meshes.get(mesh).map_or("", |mesh| &mesh.name);
    first_name([&placed.node.name, own], || format!("nodes[{}]", placed.index))
}

/// The first name that is not empty, without characters that would do something to a terminal.
fn first_name<const N: usize>(names: [&str; N], otherwise: impl Fn() -> String) -> String {
    let named = names.into_iter().find(|name| !name.is_empty());
    named.map_or_else(otherwise, |name| name.chars().map(visible).collect())
}
