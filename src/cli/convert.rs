//! `bdpm convert SCENE OUT`.

use super::{CameraArgs, LightArgs, json, print_notes};
use bdpm::base::error::Result;
use bdpm::import::Warning;
use bdpm::load::counted;
use bdpm::load::{LoadOptions, SceneSummary, export, load, load_with};
use serde::Serialize;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Read a .toml, .gltf, .glb, .obj, .xml or .pbrt file, or a folder with scene.toml
    scene: PathBuf,
    /// Write scene.toml, OBJ meshes and PNG textures to this folder
    out: PathBuf,
    /// Keep this camera of a glTF or Mitsuba file [default: the first]
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    #[command(flatten)]
    camera_change: CameraArgs,
    /// Refuse a scene if a part of it would be skipped
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    light: LightArgs,
    /// Replace existing files
    #[arg(long)]
    force: bool,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct ConvertReport<'a> {
    folder: String,
    files: usize,
    /// Fingerprints of the scene, and of the written folder when it is read again.
    fingerprints: [String; 2],
    read: &'a SceneSummary,
    #[serde(rename = "notes")]
    warnings: Vec<Warning>,
}

pub fn run(args: &Args) -> Result<String> {
    let options = args.light.options(args.camera.as_deref(), args.strict);
    let camera_change = args.camera_change.change();
    let loaded = load_with(&args.scene, &LoadOptions { camera_change, ..options })?;
    let origin = args.scene.file_name().map(|name| name.to_string_lossy().into_owned());
    let origin = origin.unwrap_or_else(|| loaded.scene.name.clone());
    let exported = export(&loaded, &origin, &args.out, args.force)?;

    let mut warnings = loaded.warnings;
    warnings.extend(exported.warnings);
    if let [name, others @ ..] = &loaded.summary.cameras[..]
        && !others.is_empty()
    {
        let name = loaded.summary.camera.as_ref().unwrap_or(name);
        warnings.push(Warning::chosen(format!("the folder contains only the camera `{name}`")));
    }
    let fingerprint = loaded.scene.fingerprint();
    drop(loaded.scene);
    let again = load(&args.out)?.scene.fingerprint();
    if again != fingerprint {
        let warning = "the copy is not bit-identical, so its image may differ by rounding";
        warnings.push(Warning::chosen(warning));
    }
    print_notes(&warnings);
    let folder = args.out.display().to_string();
    let fingerprints = [fingerprint, again].map(|bits| format!("{bits:016x}"));
    let read = &loaded.summary;
    if args.json {
        return Ok(json(&ConvertReport {
            folder,
            files: exported.files,
            fingerprints,
            read,
            warnings,
        }));
    }
    let files = counted(exported.files, "file");
    Ok(format!("{folder}: {read}\n{files}, fingerprint {}\n", fingerprints[1]))
}
