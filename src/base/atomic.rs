//! Files that appear complete or not at all.

use super::error::{Error, Result};
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Lets `write` fill a temporary file beside `path`, which takes its place when all is written.
///
/// # Errors
/// Names `path`. Whatever was there before is then still there.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut (dyn WriteSeek + '_)) -> std::io::Result<()>,
) -> Result<()> {
    let file = temporary(path).map_err(|e| Error::io("write", path, e))?;
    let save = || {
        let mut buffered = BufWriter::with_capacity(1 << 18, file);
        write(&mut buffered)?;
        let file = buffered.into_inner()?;
        // Without this, a power failure after the renaming could leave an empty file.
        file.as_file().sync_all()?;
        file.persist(path)?;
        Ok(())
    };
    save().map_err(|e| Error::io("write", path, e))
}

/// What [`write_atomically`] writes to.
pub trait WriteSeek: Write + Seek {}

impl<T: Write + Seek> WriteSeek for T {}

/// Finds out before hours of rendering whether `path` can be written, without touching it.
///
/// # Errors
/// If its extension is not `extension` (if given), its folder is missing or not writable, or it is
/// a folder or a read-only file.
pub fn check_writable(path: &Path, extension: Option<&str>) -> Result<()> {
    let refuse = |problem: &str, advice: String| Err(Error::new(problem, advice).at(path));
    if let Some(wanted) = extension {
        let found = path.extension().is_some_and(|found| found.eq_ignore_ascii_case(wanted));
        if !found {
            let name = path.with_extension(wanted);
            return refuse(
                &format!("cannot write this kind of file: its name does not end in .{wanted}"),
                format!("name it {}", name.display()),
            );
        }
    }
    if let Ok(existing) = path.metadata() {
        if existing.is_dir() {
            return refuse("cannot write: it is a folder", "give the name of a file".into());
        }
        if existing.permissions().readonly() {
            return refuse(
                "cannot write: the file is read-only",
                "give another name, or make it writable".into(),
            );
        }
    }
    match folder(path).metadata() {
        Ok(found) if !found.is_dir() => {
            let advice = format!("{} is no folder; give another path", folder(path).display());
            return refuse("cannot write", advice);
        }
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            let advice = format!("create the folder: mkdir -p {}", folder(path).display());
            return refuse("cannot write: its folder does not exist", advice);
        }
        _ => {}
    }
    temporary(path).map(drop).map_err(|e| Error::io("write", path, e))
}

/// A file in the folder of `path` that vanishes unless it is renamed.
fn temporary(path: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        // Like any new file, less the user's umask; the crate's own default is private.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.prefix(".bdpm-").suffix(".tmp").tempfile_in(folder(path))
}

fn folder(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.into(),
        _ => ".".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        fs::write(&path, "old").unwrap();
        let error = write_atomically(&path, |file| {
            file.write_all(b"half")?;
            Err(std::io::Error::other("disk on fire"))
        });
        let shown = error.unwrap_err().to_string();
        assert!(shown.contains("a.exr") && shown.contains("disk on fire"), "{shown}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        write_atomically(&path, |file| file.write_all(b"new")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(names(folder.path()), ["a.exr"]);
    }

    #[test]
    fn the_check_finds_what_would_fail_and_touches_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("folder.exr")).unwrap();
        fs::write(at("file"), "").unwrap();
        let check = |name: &str| check_writable(&at(name), Some("exr"));
        for (name, expected) in [
            ("a.jpg", "does not end in .exr"),
            ("a", "does not end in .exr"),
            ("folder.exr", "is a folder"),
            ("missing/a.exr", "does not exist"),
            ("file/a.exr", "no folder"),
        ] {
            let shown = check(name).unwrap_err().to_string();
            assert!(shown.contains(expected) && shown.contains("\nhelp: "), "{name}: {shown}");
        }
        fs::write(at("old.exr"), "old").unwrap();
        check("old.exr").unwrap();
        check("new.EXR").unwrap();
        assert_eq!(fs::read(at("old.exr")).unwrap(), b"old");
        let mut permissions = fs::metadata(at("old.exr")).unwrap().permissions();
        permissions.set_readonly(true);
        fs::set_permissions(at("old.exr"), permissions).unwrap();
        assert!(check("old.exr").unwrap_err().to_string().contains("read-only"));
        let mut names = names(folder.path());
        names.sort();
        assert_eq!(names, ["file", "folder.exr", "old.exr"]);
    }
}
