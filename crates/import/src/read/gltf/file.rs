//! The file itself: JSON text, or the binary container (GLB) that holds it with a buffer.

use super::EXPORT_AGAIN;
use super::json::{Asset, GltfDocument};
use crate::text::{list, read_bytes};
use bdpm_core::base::error::{Error, Result};
use serde::Deserialize;
use std::path::Path;

/// Largest accepted file, bytes: the limit of a GLB header.
const MAX_FILE: u64 = 1 << 32;

/// Maximum number of JSON objects. Each takes hundreds of bytes of memory for as little as 3 of
/// text.
const MAX_OBJECTS: usize = 2_000_000;

/// Advice for older versions.
const UPGRADE: &str =
    "export the model as glTF 2.0, or convert it: `npx gltf-pipeline -i OLD -o NEW.gltf`";

/// Advice for compressed meshes.
const DECOMPRESS: &str = "decompress the model: `npx @gltf-transform/cli cp OLD NEW.glb`; or export it \
                          without compression";

/// Advice for the older kind of glossy materials.
const METAL_ROUGH: &str = "convert its materials: `npx @gltf-transform/cli metalrough OLD NEW.glb`; or export it \
                           with metallic-roughness materials";

/// The extensions that `extensionsRequired` may name.
const SUPPORTED: [&str; 18] = [
    "EXT_lights_ies",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_transform",
];

/// Reads the document, and the buffer that comes with it in a GLB file.
///
/// # Errors
/// If it is not a glTF 2 file, or requires an extension that is not supported.
pub(super) fn read(path: &Path) -> Result<(GltfDocument, Option<Vec<u8>>)> {
    let mut bytes = read_bytes(path, MAX_FILE)?;
    let (document, bin) = if bytes.starts_with(b"glTF") {
        let (json, bin) = chunks(&bytes)?;
        let document = parse(&bytes[json], path)?;
        // The buffer may be large: keep it where it is in memory.
        let bin = bin.map(|bin| {
            bytes.truncate(bin.end);
            bytes.drain(..bin.start);
            bytes
        });
        (document, bin)
    } else {
        (parse(&bytes, path)?, None)
    };
    check_version(&document)?;
    check_extensions(&document)?;
    check_compression(&document)?;
    Ok((document, bin))
}

type Range = std::ops::Range<usize>;

/// Where a GLB file has its JSON and its buffer.
fn chunks(bytes: &[u8]) -> Result<(Range, Option<Range>)> {
    let cut_off = || Error::new("the GLB file is cut off", EXPORT_AGAIN);
    let number = |at: usize| {
        let four = bytes.get(at..at + 4).ok_or_else(cut_off)?;
        Ok::<_, Error>(u32::from_le_bytes([four[0], four[1], four[2], four[3]]))
    };
    let version = number(4)?;
    if version != 2 {
        let problem = format!("this is GLB version {version}, but only 2 is supported");
        return Err(Error::new(problem, UPGRADE));
    }
    let end = number(8)? as usize;
    if end > bytes.len() {
        return Err(cut_off());
    }
    // Length and type precede the content.
    let chunk = |begin: usize, kind: &[u8; 4]| {
        let length = number(begin)? as usize;
        let content = begin + 8..begin + 8 + length;
        if content.end > end {
            return Err(cut_off());
        }
        Ok((bytes[begin + 4..begin + 8] == *kind).then_some(content))
    };
    let json = chunk(12, b"JSON")?
        .ok_or_else(|| Error::new("the GLB file does not begin with JSON", EXPORT_AGAIN))?;
    // The file may end here, or continue with chunks of other kinds.
    let bin = if json.end + 8 <= end { chunk(json.end, b"BIN\0")? } else { None };
    Ok((json, bin))
}

fn parse(bytes: &[u8], path: &Path) -> Result<GltfDocument> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    // GLB files are padded to multiples of four, by some exporters with zeros.
    let end = bytes.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    let bytes = &bytes[..end];
    if bytes.iter().filter(|byte| **byte == b'{').count() > MAX_OBJECTS {
        let problem = format!("the file has more than {MAX_OBJECTS} JSON objects");
        return Err(Error::new(problem, "join meshes and nodes, or split the scene"));
    }
    serde_json::from_slice(bytes).map_err(|e| {
        // Lists are maps in glTF 1.0, where some files omit their version.
        let head = serde_json::from_slice::<VersionHead>(bytes);
        if let (true, Ok(head)) = (e.is_data(), head)
            && (head.asset.version.starts_with("1.") || head.meshes.is_object())
        {
            return Error::new("the file is glTF 1.0, but only 2.0 is supported", UPGRADE).at(path);
        }
        let line = bytes.split(|byte| *byte == b'\n').nth(e.line().saturating_sub(1));
        let line = line.unwrap_or_default();
        // A minified file has one line: show the part around the problem.
        let begin = e.column().saturating_sub(60).min(line.len());
        let shown = String::from_utf8_lossy(&line[begin..line.len().min(begin + 120)]);
        Error::new(format!("this is not valid glTF: {e}"), EXPORT_AGAIN)
            .at(path)
            .line(e.line(), shown.trim())
    })
}

/// The members that identify older files.
#[derive(Default, Deserialize)]
#[serde(default)]
struct VersionHead {
    asset: Asset,
    meshes: serde_json::Value,
}

fn check_version(document: &GltfDocument) -> Result<()> {
    let asset = &document.asset;
    let needed = asset.min_version.as_ref().unwrap_or(&asset.version);
    if needed.is_empty() {
        return Err(Error::new("asset.version is missing, so this is not glTF", EXPORT_AGAIN));
    }
    if needed.starts_with("2.") {
        return Ok(());
    }
    let shown: String = needed.chars().take(20).collect();
    let problem = format!("asset.version: the file is glTF {shown}, but only 2.0 is supported");
    Err(Error::new(problem, UPGRADE))
}

fn check_extensions(document: &GltfDocument) -> Result<()> {
    let unknown: Vec<&str> = unsupported(&document.extensions_required).collect();
    if unknown.is_empty() {
        return Ok(());
    }
    let are = if unknown.len() == 1 { "is" } else { "are" };
    let names = list(unknown);
    let problem = format!("extensionsRequired: the file needs {names}, which {are} not supported");
    let advice = match &names {
        names if names.contains("draco") => DECOMPRESS,
        names if names.contains("pbrSpecularGlossiness") => METAL_ROUGH,
        _ => "export the model without these extensions",
    };
    Err(Error::new(problem, advice))
}

/// Refuses meshes that the file holds only in compressed form. They would look empty if the file
/// does not require the extension.
fn check_compression(document: &GltfDocument) -> Result<()> {
    let has_no_view = |accessor: &usize| {
        document.accessors.get(*accessor).is_some_and(|accessor| accessor.buffer_view.is_none())
    };
    for (index, mesh) in document.meshes.iter().enumerate() {
        for (part, primitive) in mesh.primitives.iter().enumerate() {
            let position = primitive.attributes.get("POSITION");
            if primitive.extensions.draco.is_some() && position.is_some_and(has_no_view) {
                let element = format!("meshes[{index}].primitives[{part}]");
                let problem =
                    "it is compressed by KHR_draco_mesh_compression, which is not supported";
                return Err(Error::new(format!("{element}: {problem}"), DECOMPRESS));
            }
        }
    }
    Ok(())
}

/// The names of extensions that are not read.
pub(super) fn unsupported(names: &[String]) -> impl Iterator<Item = &str> {
    names.iter().map(String::as_str).filter(|name| !SUPPORTED.contains(name))
}
