//! `bdpm convert SCENE OUT`.

use super::{LightArgs, json, say};
use bdpm::base::error::Result;
use bdpm::import::counted;
use bdpm::import::{SceneSummary, Warning, export, load, load_with};
use serde::Serialize;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Scene: a .toml, .gltf, .glb, .obj or Mitsuba's .xml file, or a folder that holds scene.toml
    scene: PathBuf,
    /// Folder to write: scene.toml, meshes as OBJ and textures as PNG
    out: PathBuf,
    /// The camera of a glTF file to keep [default: its first]
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Refuse scenes of which anything is skipped
    #[arg(long)]
    strict: bool,
    #[command(flatten)]
    light: LightArgs,
    /// Replace files that are there
    #[arg(long)]
    force: bool,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report<'a> {
    folder: String,
    files: usize,
    /// Of the scene, and of what was written as it is read again.
    fingerprints: [String; 2],
    read: &'a SceneSummary,
    notes: Vec<Warning>,
}

pub fn run(args: &Args) -> Result<String> {
    let options = args.light.options(args.camera.as_deref(), args.strict);
    let loaded = load_with(&args.scene, &options)?;
    let origin = args.scene.file_name().map(|name| name.to_string_lossy().into_owned());
    let origin = origin.unwrap_or_else(|| loaded.scene.name.clone());
    let exported = export(&loaded, &origin, &args.out, args.force)?;

    let mut notes = loaded.warnings;
    notes.extend(exported.warnings);
    if let [name, others @ ..] = &loaded.summary.cameras[..]
        && !others.is_empty()
    {
        let name = loaded.summary.camera.as_ref().unwrap_or(name);
        notes.push(Warning::chosen(format!("of all cameras only `{name}` is in the folder")));
    }
    let fingerprint = loaded.scene.fingerprint();
    drop(loaded.scene);
    let again = load(&args.out)?.scene.fingerprint();
    if again != fingerprint {
        let note = "the copy is not the same bit by bit, and its image may differ by rounding";
        notes.push(Warning::chosen(note));
    }
    notes.iter().for_each(|note| say(&format!("note: {note}")));
    let folder = args.out.display().to_string();
    let fingerprints = [fingerprint, again].map(|bits| format!("{bits:016x}"));
    let read = &loaded.summary;
    if args.json {
        return Ok(json(&Report { folder, files: exported.files, fingerprints, read, notes }));
    }
    let files = counted(exported.files, "file");
    Ok(format!("{folder}: {read}\n{files}, fingerprint {}\n", fingerprints[1]))
}
