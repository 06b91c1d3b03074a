//! Which file a path stands for, however it is spelled.

use std::ffi::OsString;
use std::fs::Metadata;
use std::path::{Path, PathBuf};

/// A file, or the place where there is none yet. Equal for all paths to the same: relative or absolute,
/// through symbolic links or hard ones.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FileId {
    /// What is there.
    Existing(FileKey),
    /// A name in a folder.
    Missing(FileKey, OsString),
}

/// Device and number of a file.
#[cfg(unix)]
pub type FileKey = (u64, u64);

/// The one path of a file without links.
#[cfg(not(unix))]
pub type FileKey = PathBuf;

impl FileId {
    /// Of what writing to `path` would replace; `None` if its folder cannot be found.
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

/// Links that are followed at most, as Linux does.
const MOST_LINKS: usize = 40;

/// Where symbolic links lead that the last part of `path` may be, whether or not a file is there.
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
pub(crate) fn folder(path: &Path) -> PathBuf {
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
    fn all_ways_to_a_file_are_one_file() {
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
    fn links_that_lead_nowhere_end() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("loop");
        symlink("loop", &path).unwrap();
        assert!(matches!(FileId::of(&path), Some(FileId::Missing(..))));
    }
}
