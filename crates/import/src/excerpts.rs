//! Errors and warnings without excerpts of files that the scene has no claim to.
//!
//! A scene names other files. One that a stranger wrote may name any file of the user, such as
//! `Include "/proc/self/environ"`, and users send errors to others. Only files in the folder of the
//! scene, and in folders in it, are quoted.

use super::warnings::Warning;
use bdpm_core::base::error::Error;
use bdpm_core::base::file_id::folder;
use std::path::{Path, PathBuf};

/// Marks of quoted text in errors, also in those of parsers.
const QUOTES: [char; 3] = ['`', '"', '\''];

/// Files whose contents may be shown: those in folders, and single ones.
pub struct ShownFiles(Vec<PathBuf>);

impl ShownFiles {
    /// The files in the folder of a scene file, and a file that the user gave beside it. If the
    /// scene file is a link, the folder of the file that it leads to counts as well.
    pub fn of(scene: &Path, given: Option<&Path>) -> Self {
        let real = scene.canonicalize().ok();
        let folders = [Some(scene), real.as_deref()].into_iter().flatten().map(folder);
        let all = folders.chain(given.map(Path::to_owned));
        Self(all.filter_map(|path| path.canonicalize().ok()).collect())
    }

    /// Returns true if a file is outside. A file that does not exist has no content.
    fn hides(&self, path: &Path) -> bool {
        path.canonicalize().is_ok_and(|path| !self.0.iter().any(|own| path.starts_with(own)))
    }

    /// The error without its excerpt and quotes if they are from a file outside.
    pub fn error(&self, error: Error) -> Error {
        error.replaced(&|error| {
            let path = error.path().filter(|path| self.hides(path))?;
            let quotes = |text: &str| text.contains(QUOTES);
            let line = error.line_number();
            if line.is_none() && !quotes(error.problem()) && !quotes(error.advice()) {
                return None;
            }
            let advice = "correct the file. To see the problem, move the file into the folder of \
                          the scene: contents of other files are not shown";
            let hidden = Error::new("the content of this file is not valid", advice).at(path);
            Some(match line {
                Some(number) => hidden.line(number, ""),
                None => hidden,
            })
        })
    }

    /// The warning without quotes if they are from a file outside.
    pub fn warning(&self, mut warning: Warning) -> Warning {
        let is_hidden = file_of(&warning.text).is_some_and(|path| self.hides(path));
        if let (true, Some(quote)) = (is_hidden, warning.text.find(QUOTES)) {
            warning.text.truncate(quote);
            warning.text += "(not shown, since the file is not in the folder of the scene)";
        }
        warning
    }
}

/// The file that a warning begins with, before a colon.
fn file_of(text: &str) -> Option<&Path> {
    /// Colons in paths and after them that are tried.
    const MAX_COLONS: usize = 20;
    let ends = text.match_indices(':').take(MAX_COLONS);
    ends.map(|(end, _)| Path::new(&text[..end])).find(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn only_files_in_the_folder_of_the_scene_are_quoted() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        fs::create_dir_all(at("scene/parts")).unwrap();
        for name in ["scene/a.pbrt", "scene/parts/b.pbrt", "secret", "sky.hdr"] {
            fs::write(at(name), "TOKEN=1").unwrap();
        }
        let shown = ShownFiles::of(&at("scene/a.pbrt"), Some(&at("sky.hdr")));
        let error = |path: &Path| {
            let error = Error::new("`TOKEN=1` is no directive", "remove it").at(path);
            Error::all([error.line(1, "TOKEN=1"), Error::new("no `TOKEN`", "").at(path)])
        };
        for (name, is_shown) in [
            ("scene/a.pbrt", true),
            ("scene/parts/b.pbrt", true),
            ("sky.hdr", true),
            ("secret", false),
        ] {
            let error = shown.error(error(&at(name)).unwrap_err());
            let text = error.to_string();
            assert_eq!(text.contains("TOKEN"), is_shown, "{text}");
            assert!(text.contains(&format!("{name}:1: ")), "{text}");
            assert_eq!(error.line_number(), Some(1));
            let text = format!("{}:3: ignored `TOKEN`", at(name).display());
            let warning = shown.warning(Warning::skipped(text));
            assert_eq!(warning.text.contains("TOKEN"), is_shown, "{}", warning.text);
        }
        let size = Error::new("reading the file takes 3 GiB", "give a smaller file");
        assert!(shown.error(size.at(at("secret"))).to_string().contains("3 GiB"));
    }

    #[cfg(unix)]
    #[test]
    fn link_out_of_the_folder_is_not_quoted() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        fs::create_dir(at("scene")).unwrap();
        fs::write(at("secret"), "TOKEN=1").unwrap();
        std::os::unix::fs::symlink(at("secret"), at("scene/part.pbrt")).unwrap();
        let shown = ShownFiles::of(&at("scene/a.pbrt"), None);
        let error = Error::new("no directive", "remove it").at(at("scene/part.pbrt"));
        assert!(!shown.error(error.line(1, "TOKEN=1")).to_string().contains("TOKEN"));
    }
}
