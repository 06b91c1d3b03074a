//! glTF 2.0, as `.gltf` with its buffers and pictures, or as `.glb`.
//!
//! Whatever is wrong with a file, the error names the JSON element, such as `nodes[3].mesh`.

mod accessor;
mod buffers;
mod camera;
mod file;
mod geometry;
mod instances;
mod json;
mod json_material;
mod light;
mod luminaire;
mod material;
mod meshes;
mod meshopt;
mod nodes;
mod pose;
mod texture;

use super::ImportOptions;
use crate::builder::{Builder, Contents, FileNames, ReadScene, out_of_range};
use crate::text::list;
use crate::warnings::Warning;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::names::for_display;
use bdpm_core::scene::transform::Transform;
use bdpm_core::settings::PartialSettings;
use buffers::Buffers;
use glam::DAffine3;
use json::GltfDocument;
use luminaire::IesProfiles;
use meshes::{MeshReader, triangle_counts};
use nodes::SceneNode;
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

/// Reads a glTF file as seen by the camera of the requested name, else by its first camera.
///
/// # Errors
/// Names the element that is malformed or not supported.
pub(super) fn read(path: &Path, options: &ImportOptions) -> Result<ReadScene> {
    let (document, bin) = file::read(path)?;
    let shown = path.display().to_string();
    let (mut nodes, has_repeats) = nodes::scene_nodes(&document)?;
    nodes.iter_mut().for_each(|node| node.map.translation -= options.origin());
    let mut warnings = document_warnings(&document, &shown);
    if has_repeats {
        let problem = "the scene lists nodes below others, or twice; each is shown once";
        warnings.push(Warning::chosen(format!("{shown}: {problem}")));
    }
    let mut builder = Builder::new(warnings);
    let cameras = camera::cameras(&document, &nodes)?;
    let chosen = camera::choose(&cameras, options.camera)?;
    let (camera, resolution) = match chosen.map(|chosen| chosen.camera()).transpose()? {
        Some((camera, resolution)) => (Some(camera), resolution),
        None => (None, None),
    };
    let mut lights = Vec::new();
    let visible = || nodes.iter().filter(|node| !node.is_hidden);
    for node in visible() {
        lights.extend(light::light(&document, node)?);
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let counts = triangle_counts(&document, &nodes)?;
    builder.count(counts.placed, counts.stored)?;
    let buffers = Buffers::load(&document, bin, folder)?;
    let mut profiles = IesProfiles::new(&buffers, path);
    for node in visible() {
        lights.extend(profiles.luminaire(node)?);
    }
    builder.warnings.extend(profiles.warnings());
    place_meshes(&buffers, &nodes, folder, &shown, &mut builder)?;
    let (light_names, lights) = lights.into_iter().map(|own| (Some(own.name), own.emitter)).unzip();
    let names = FileNames {
        cameras: cameras.iter().map(|camera| camera.name.clone()).collect(),
        camera: chosen.map(|camera| camera.name.clone()),
        ..FileNames::default()
    };
    let defaults = PartialSettings { resolution, ..PartialSettings::default() };
    let contents = Contents {
        lights,
        light_names,
        camera,
        defaults,
        names,
        may_lack_light: true,
        ..Contents::default()
    };
    builder.finish(path, contents, options)
}

/// Places the meshes of all nodes.
fn place_meshes(
    buffers: &Buffers,
    nodes: &[SceneNode],
    folder: &Path,
    shown: &str,
    builder: &mut Builder,
) -> Result<()> {
    let document = buffers.document;
    let mut meshes = MeshReader::new(buffers, GltfTextures::new(buffers, folder));
    for name in &buffers::guessed(document, folder) {
        meshes.textures.warnings.guessed(name);
    }
    let all_maps = nodes.iter().map(|node| (node.index, node.map)).collect();
    for node in nodes.iter().filter(|node| !node.is_hidden) {
        let Some(index) = node.json.mesh else { continue };
        let at_node = |error: Error| {
            let problem = format!("nodes[{}]: {}", node.index, error.problem());
            Error::new(problem, error.advice())
        };
        let name = document.meshes.get(index).map_or("", |mesh| &mesh.name);
        let name = first_name([&node.json.name, name], || format!("nodes[{}]", node.index));
        let pose = Pose::new(buffers, node, index, &all_maps)?;
        // The joints of a skin place its mesh, whatever the transform of its node is.
        let instances = if pose.is_placed() { 1 } else { instances::count(document, node)? };
        builder.count_placements(instances).map_err(at_node)?;
        let maps = match pose.is_placed() {
            true => vec![DAffine3::IDENTITY],
            false => instances::maps(buffers, node)?,
        };
        let parts = meshes.get(index, node, &pose, &mut builder.materials)?.to_vec();
        for map in maps {
            let Ok(transform) = Transform::new(map) else {
                // The map is finite.
                let phrase = "left out meshes that their transform flattens:";
                meshes.textures.warnings.chosen(phrase, &name);
                continue;
            };
            let placed = builder.place(Some(&name), &parts, &transform);
            placed.ok_or_else(|| at_node(out_of_range()))?;
        }
    }
    if builder.is_empty() && !meshes.invisible.is_empty() {
        let names = list(meshes.invisible.iter().map(String::as_str));
        let problem =
            format!("nothing is visible: the opacity is below the cutoff all over {names}");
        let advice = "lower their alphaCutoff, raise the alpha of their base color, or set \
                      alphaMode to OPAQUE";
        return Err(Error::new(problem, advice));
    }
    builder.warnings.extend(meshes.textures.warnings.into_warnings(shown));
    Ok(())
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
    named.map_or_else(default, for_display)
}
