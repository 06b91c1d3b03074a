//! Identity of a file, whatever path it is named by.

use std::ffi::OsString;
use std::fs::Metadata;
use std::path::{Path, PathBuf};

/// A file, or a name that no file has yet. Equal for all paths to one file: relative or absolute,
/// through symbolic links or hard ones.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FileId {
    /// An existing file.
    Existing(FileKey),
    /// An unused name in a folder.
    Missing(FileKey, OsString),
}

/// Device and number of a file.
#[cfg(unix)]
pub type FileKey = (u64, u64);

/// The one path of a file without links.
#[cfg(not(unix))]
pub type FileKey = PathBuf;

impl FileId {
    /// The file that writing to `path` would replace; `None` if its folder cannot be found.
    pub fn of(path: &Path) -> Option<Self> {
        let path = destination(path);
        if let Ok(metadata) = path.metadata() {
            return Some(Self::Existing(key(&path, &metadata)?));
        }
        let folder = folder(&path);
        let metadata = folder.metadata().ok()?;
        Some(Self::Missing(key(&folder, &metadata)?, path.file_name()?.to_owned()))
    }
}

#[cfg(unix)]
fn key(_: &Path, metadata: &Metadata) -> Option<FileKey> {
    use std::os::unix::fs::MetadataExt;
    Some((metadata.dev(), metadata.ino()))
}

#[cfg(not(unix))]
fn key(path: &Path, _: &Metadata) -> Option<FileKey> {
    path.canonicalize().ok()
}

/// Maximum number of links that are followed, the limit of Linux.
const MOST_LINKS: usize = 40;

/// Follows the symbolic links of the last component of `path`, also to a file that does not exist.
pub fn destination(path: &Path) -> PathBuf {
    let mut path = path.to_owned();
    for _ in 0..MOST_LINKS {
        match path.read_link() {
            Ok(to) => path = folder(&path).join(to),
            Err(_) => break,
        }
    }
    path
}

/// The folder of a file.
pub fn folder(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.into(),
        _ => ".".into(),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::symlink;

    #[test]
    fn all_paths_to_one_file_have_one_id() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        fs::create_dir(at("a")).unwrap();
        fs::write(at("a/file"), "").unwrap();
        fs::hard_link(at("a/file"), at("hard")).unwrap();
        symlink("a/file", at("soft")).unwrap();
        symlink("soft", at("softer")).unwrap();
        symlink("a", at("b")).unwrap();
        let file = FileId::of(&at("a/file"));
        assert!(matches!(file, Some(FileId::Existing(_))));
        for same in ["a/./file", "a/../a/file", "hard", "soft", "softer", "b/file"] {
            assert_eq!(FileId::of(&at(same)), file, "{same}");
        }
        let new = FileId::of(&at("a/new"));
        assert!(matches!(new, Some(FileId::Missing(..))) && new != file);
        symlink("a/new", at("to-come")).unwrap();
        for same in ["b/new", "a/../b/new", "to-come"] {
            assert_eq!(FileId::of(&at(same)), new, "{same}");
        }
        assert_ne!(FileId::of(&at("a/other")), new);
        assert_ne!(FileId::of(&at("new")), new);
        assert_eq!(FileId::of(&at("no/folder")), None);
    }

    #[test]
    fn circular_links_terminate() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("loop");
        symlink("loop", &path).unwrap();
        assert!(matches!(FileId::of(&path), Some(FileId::Missing(..))));
    }
}
