//! `bdpm convert SCENE OUT`.

use super::{CameraArgs, LightArgs, json, print_notes};
use bdpm::base::error::Result;
use bdpm::load::{Converted, LoadOptions, convert, counted, load_with};
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

pub fn run(args: &Args) -> Result<String> {
    let options = args.light.options(args.camera.as_deref(), args.strict);
    let camera_change = args.camera_change.change();
    let loaded = load_with(&args.scene, &LoadOptions { camera_change, ..options })?;
    let origin = args.scene.file_name().map(|name| name.to_string_lossy().into_owned());
    let origin = origin.unwrap_or_else(|| loaded.scene.name.clone());
    let converted = convert(loaded, &origin, &args.out, args.force)?;
    print_notes(&converted.warnings);
    if args.json {
        return Ok(json(&converted));
    }
    let Converted { folder, files, fingerprints, read, .. } = &converted;
    let files = counted(*files, "file");
    Ok(format!("{folder}: {read}\n{files}, fingerprint {}\n", fingerprints[1]))
}
