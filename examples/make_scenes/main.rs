//! Makes the scenes that are made by programs: meshes and scene files of `scenes/`.
//!
//! ```sh
//! cargo run --release --example make_scenes           # rewrites the folders under scenes/
//! cargo run --release --example make_scenes -- DIR    # writes them elsewhere
//! ```
//!
//! One file per scene says what is in it; `mesh`, `shapes` and `profile` build, `obj` and
//! `scene_text` write. `tests` checks that the committed files are those that are made;
//! `tests/suite.rs` includes this program and runs them.

mod caustic_sphere;
mod chessmen;
mod hall;
pub(crate) mod lens;
pub(crate) mod mesh;
mod obj;
mod objective;
mod point_caustic;
mod profile;
mod random;
mod room;
mod scene_text;
mod shapes;
#[cfg(test)]
mod tests;

use scene_text::Folder;
use std::path::{Path, PathBuf};

/// All scenes that this program makes.
fn folders() -> Vec<Folder> {
    vec![caustic_sphere::folder(), point_caustic::folder(), objective::folder(), hall::folder()]
}

/// The repository's folder of scenes.
fn scenes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes")
}

fn main() -> std::io::Result<()> {
    let target = std::env::args_os().nth(1).map_or_else(scenes, PathBuf::from);
    for folder in folders() {
        let path = target.join(folder.name);
        std::fs::create_dir_all(&path)?;
        let mut bytes = 0;
        for (name, text) in &folder.files {
            std::fs::write(path.join(name), text)?;
            bytes += text.len();
        }
        println!("{}: {} files, {} kB", path.display(), folder.files.len(), bytes.div_ceil(1000));
    }
    Ok(())
}
