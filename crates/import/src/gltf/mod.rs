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
mod luminaire;
mod material;
mod meshes;
mod nodes;
mod pose;
mod texture;

use super::builder::{Builder, SceneExtras};
use super::load::{LoadOptions, Loaded};
use super::text::{list, placed_at};
use super::warnings::Warning;
use bdpm_core::base::error::{Error, Result, visible};
use bdpm_core::scene::transform::Transform;
use bdpm_core::settings::PartialSettings;
use buffers::Buffers;
use glam::DAffine3;
use json::GltfDocument;
use luminaire::IesProfiles;
use meshes::{MeshReader, triangle_counts};
use pose::Pose;
use std::collections::BTreeSet;
use std::fmt::Display;
use std::path::Path;
use texture::GltfTextures;

/// Advice for a malformed file.
const EXPORT_AGAIN: &str = "export the model again; a glTF validator may report details";

/// A malformed element of the file.
fn malformed(element: impl Display, problem: impl Display) -> Error {
    Error::new(format!("{element}: {problem}"), EXPORT_AGAIN)
}

/// Loads a glTF file as seen by the camera of the requested name, else by its first camera, else by
/// one that sees everything.
///
/// # Errors
/// Names the file, and the element that is malformed or not supported.
pub(super) fn load(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    read(path, options).map_err(|error| placed_at(error, path))
}

fn read(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    let (document, bin) = file::read(path)?;
    let shown = path.display().to_string();
    let mut builder = Builder::new(document_warnings(&document, &shown));
    let (nodes, has_repeats) = nodes::scene_nodes(&document)?;
    if has_repeats {
        let problem = "the scene lists nodes below others, or twice; each is shown once";
        builder.warnings.push(Warning::chosen(format!("{shown}: {problem}")));
    }
    let cameras = camera::cameras(&document, &nodes)?;
    let chosen = camera::choose(&cameras, options.camera)?;
    let view = chosen.map(|chosen| chosen.camera()).transpose()?;
    let mut lights = Vec::new();
    let mut light_names = Vec::new();
    for node in &nodes {
        if let Some(light) = light::light(&document, node)? {
            light_names.push(light.name);
            lights.push(light.emitter);
        }
    }

    let folder = path.parent().unwrap_or(Path::new(""));
    let counts = triangle_counts(&document, &nodes)?;
    builder.count(counts.placed, counts.stored, path)?;
    let buffers = Buffers::load(&document, bin, folder)?;
    let mut profiles = IesProfiles::new(&buffers, path);
    for node in &nodes {
        if let Some(luminaire) = profiles.luminaire(node)? {
            light_names.push(luminaire.name);
            lights.push(luminaire.emitter);
        }
    }
    builder.warnings.extend(profiles.warnings());
    let guessed = buffers::guessed(&document, folder);
    if !guessed.is_empty() {
        let names = list(guessed.iter().map(String::as_str));
        let note = format!("{shown}: found under other names the files {names}");
        builder.warnings.push(Warning::chosen(note));
    }
    let mut meshes = MeshReader::new(&buffers, GltfTextures::new(&buffers, folder));
    let all_maps = nodes.iter().map(|node| (node.index, node.map)).collect();
    // Place each mesh.
    for node in &nodes {
        let Some(index) = node.json.mesh else { continue };
        let name = document.meshes.get(index).map_or("", |mesh| &mesh.name);
        let name = first_name([&node.json.name, name], || format!("nodes[{}]", node.index));
        let pose = Pose::new(&buffers, node, index, &all_maps)?;
        // The joints of a skin place its mesh, whatever the transform of its node is.
        let instances = if pose.is_placed() { 1 } else { instances::count(&document, node)? };
        builder.count_placements(instances, path).map_err(|error| {
            let problem = format!("nodes[{}]: {}", node.index, error.problem());
            Error::new(problem, error.advice())
        })?;
        let maps = match pose.is_placed() {
            true => vec![DAffine3::IDENTITY],
            false => instances::maps(&buffers, node)?,
        };
        let parts = meshes.get(index, node, &pose, &mut builder.materials)?.to_vec();
        for map in maps {
            let Ok(transform) = Transform::new(map) else {
                // The map is finite.
                meshes.warnings.chosen("left out meshes that their transform flattens:", &name);
                continue;
            };
            builder.place(Some(&name), &parts, &transform).ok_or_else(|| {
                let problem = "its transform moves the mesh out of the range of coordinates";
                let problem = format!("nodes[{}]: {problem}", node.index);
                Error::new(problem, "reduce its scale or translation")
            })?;
        }
    }
    if builder.is_empty() && !meshes.invisible.is_empty() {
        let names = list(meshes.invisible.iter().map(String::as_str));
        let problem =
            format!("nothing is visible: the opacity is below the cutoff all over {names}");
        let advice = "lower their alphaCutoff, raise the alpha of their base color, or set alphaMode to OPAQUE";
        return Err(Error::new(problem, advice));
    }
    builder.warnings.extend(meshes.warnings.into_warnings(&shown));
    builder.warnings.extend(meshes.textures.warning(&shown));
    builder.arrange(path)?;

    let (camera, resolution) = match view {
        Some(view) => view,
        None => (builder.default_camera(path, options.camera_change)?, None),
    };
    let defaults = PartialSettings { resolution, ..PartialSettings::default() };
    let extras = SceneExtras { defaults, ..options.extras(&mut builder.warnings)? };
    let mut loaded = builder.finish(path, lights, camera, extras)?;
    loaded.summary.light_names = light_names;
    loaded.summary.cameras = cameras.iter().map(|camera| camera.name.clone()).collect();
    loaded.summary.camera = chosen.map(|camera| camera.name.clone());
    Ok(loaded)
}

/// Warnings about the contents of the file that no image shows.
fn document_warnings(document: &GltfDocument, shown: &str) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let unsupported: BTreeSet<&str> = file::unsupported(&document.extensions_used).collect();
    if !unsupported.is_empty() {
        let names = list(unsupported);
        warnings.push(Warning::skipped(format!("{shown}: ignored the extensions {names}")));
    }
    if !document.animations.is_empty() {
        let text = "animations are not played; the nodes keep their own transforms";
        warnings.push(Warning::chosen(format!("{shown}: {text}")));
    }
    warnings
}

/// The first name that is not empty, without characters that would control a terminal.
fn first_name<const N: usize>(names: [&str; N], default: impl Fn() -> String) -> String {
    let named = names.into_iter().find(|name| !name.is_empty());
    named.map_or_else(default, |name| name.chars().map(visible).collect())
}
