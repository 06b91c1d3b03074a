//! Files that appear complete or not at all.

use crate::error::{Error, Result};
use crate::file_id::{destination, folder};
use std::fs::{File, TryLockError};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::mpsc;
use std::thread;
use tempfile::NamedTempFile;

/// Prefix and suffix of the names of files that are being written.
const TEMPORARY: [&str; 2] = [".bdpm-", ".tmp"];

/// Lets `write` fill a temporary file beside `path`, then renames it to `path`. A symbolic link
/// stays; the file that it leads to is replaced.
///
/// # Errors
/// Names `path`. A file that was there before is then unchanged.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut (dyn WriteSeek + '_)) -> std::io::Result<()>,
) -> Result<()> {
    let target = destination(path);
    if let Some(error) = missing_folder(path) {
        return Err(error);
    }
    let own = |error| Error::io("write", path, without_path(error));
    let file = temporary(&folder(&target)).map_err(own)?;
    let save = || {
        // Write to the `File` itself: errors then name `path`, not the temporary file.
        let to = file.as_file();
        thread::scope(|scope| {
            let (sender, receiver) = mpsc::channel();
            let syncing = scope.spawn(move || receiver.iter().try_for_each(|()| to.sync_data()));
            let to = Syncing { to, unsynced: 0, sender };
            let mut buffered = BufWriter::with_capacity(1 << 18, to);
            write(&mut buffered)?;
            drop(buffered.into_inner().map_err(io::IntoInnerError::into_error)?);
            syncing.join().expect("syncing does not panic")
        })?;
        // Without `sync_all`, a power failure after the renaming could leave an empty file.
        file.as_file().sync_all()?;
        file.persist(&target)?;
        Ok(())
    };
    save().map_err(own)
}

/// The error of the system without the name of the temporary file, which the crate `tempfile`
/// appends and which means nothing to users.
fn without_path(error: io::Error) -> io::Error {
    match error.to_string().split_once(" at path \"") {
        Some((own, _)) => io::Error::new(error.kind(), own.to_owned()),
        None => error,
    }
}

/// The error of a file whose folder does not exist.
fn missing_folder(path: &Path) -> Option<Error> {
    let folder = folder(&destination(path));
    let error = folder.metadata().err()?;
    (error.kind() == io::ErrorKind::NotFound).then(|| {
        let advice = format!("create the folder: mkdir -p {}", folder.display());
        Error::new("cannot write: its folder does not exist", advice).at(path)
    })
}

/// Bytes after which the system starts to write a large file to the disk, while the rest is still
/// computed.
const SYNC_EVERY: usize = 32 << 20;

/// A file that another thread writes to the disk from time to time.
struct Syncing<'a> {
    to: &'a File,
    /// Bytes since the last request.
    unsynced: usize,
    /// Requests to the other thread. If it has failed, its error is reported at the end.
    sender: mpsc::Sender<()>,
}

impl Write for Syncing<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.to.write(bytes)?;
        self.unsynced += written;
        if self.unsynced >= SYNC_EVERY {
            self.unsynced = 0;
            let _ = self.sender.send(());
        }
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

impl Seek for Syncing<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.to.seek(to)
    }
}

/// A seekable target of [`write_atomically`].
pub trait WriteSeek: Write + Seek {}

impl<T: Write + Seek> WriteSeek for T {}

/// Checks before hours of rendering that `path` can be written, without touching it. Removes
/// temporary files that killed programs left in its folder.
///
/// # Errors
/// If its extension is not `extension` (if given), its folder is missing or not writable, or it is
/// a folder, a device, a pipe or a read-only file.
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
        if !existing.is_file() {
            return refuse(
                "cannot write: it is a device or a pipe, which a file would replace",
                "give the name of a file".into(),
            );
        }
        if existing.permissions().readonly() {
            return refuse(
                "cannot write: the file is read-only",
                "give another name, or make it writable".into(),
            );
        }
    }
    let folder = folder(&destination(path));
    match folder.metadata() {
        Ok(found) if !found.is_dir() => {
            let advice = format!("{} is no folder; give another path", folder.display());
            return refuse("cannot write", advice);
        }
        _ => {}
    }
    if let Some(error) = missing_folder(path) {
        return Err(error);
    }
    sweep(&folder);
    temporary(&folder).map(drop).map_err(|e| Error::io("write", path, without_path(e)))
}

/// A file in `folder` that vanishes unless it is renamed. It is locked while it is being written:
/// the lock distinguishes it from a file that a killed program left.
///
/// # Errors
/// If the folder is not writable.
pub fn temporary(folder: &Path) -> std::io::Result<NamedTempFile> {
    let [prefix, suffix] = TEMPORARY;
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        // The permissions of any new file, less the user's umask; the crate's own default is
        // private.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    loop {
        let file = builder.prefix(prefix).suffix(suffix).tempfile_in(folder)?;
        match file.as_file().try_lock() {
            Err(TryLockError::WouldBlock) => {} // another process sweeps it away
            _ if file.path().exists() => return Ok(file),
            _ => {}
        }
    }
}

/// Removes temporary files that no process writes to. A file that cannot be removed does no harm.
pub fn sweep(folder: &Path) {
    let [prefix, suffix] = TEMPORARY;
    let Ok(entries) = folder.read_dir() else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        if is_file && name.starts_with(prefix) && name.ends_with(suffix) {
            // The lock of a dead process is gone, whatever machine it ran on.
            let lock = File::open(entry.path());
            if lock.as_ref().is_ok_and(|file| file.try_lock().is_ok()) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
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
    fn failed_write_leaves_old_file_and_nothing_else() {
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
    fn folders_that_are_missing_or_no_folders_are_named_without_a_temporary_file() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("file"), "").unwrap();
        for (name, problem) in [("none/a.exr", "its folder does not exist"), ("file/a.exr", "")] {
            let path = folder.path().join(name);
            let error = write_atomically(&path, |file| file.write_all(b"new")).unwrap_err();
            let shown = error.to_string();
            assert!(shown.contains(name) && shown.contains(problem), "{shown}");
            assert!(!shown.contains(TEMPORARY[0]), "{shown}");
        }
        assert_eq!(names(folder.path()), ["file"]);
    }

    #[test]
    fn file_that_is_synced_while_it_is_written_is_complete() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        let block: Vec<u8> = (0..1 << 20).map(|i| (i * 7) as u8).collect();
        let blocks = 2 * SYNC_EVERY / block.len() + 1;
        write_atomically(&path, |file| (0..blocks).try_for_each(|_| file.write_all(&block)))
            .unwrap();
        let read = fs::read(&path).unwrap();
        assert_eq!(read.len(), blocks * block.len());
        assert!(read.chunks(block.len()).all(|own| own == block));
    }

    #[test]
    fn check_writable_reports_bad_targets_and_touches_nothing() {
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
        #[cfg(unix)]
        {
            let shown = check_writable(Path::new("/dev/null"), None).unwrap_err().to_string();
            assert!(shown.contains("is a device"), "{shown}");
        }
        assert_eq!(fs::read(at("old.exr")).unwrap(), b"old");
        let mut permissions = fs::metadata(at("old.exr")).unwrap().permissions();
        permissions.set_readonly(true);
        fs::set_permissions(at("old.exr"), permissions).unwrap();
        assert!(check("old.exr").unwrap_err().to_string().contains("read-only"));
        let mut names = names(folder.path());
        names.sort();
        assert_eq!(names, ["file", "folder.exr", "old.exr"]);
    }

    #[test]
    fn stale_temporary_files_are_removed_and_locked_ones_stay() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in [".bdpm-x1Y2z3.tmp", ".bdpm-.exr", "bdpm-a.tmp"] {
            fs::write(at(name), "half").unwrap();
        }
        fs::create_dir(at(".bdpm-folder.tmp")).unwrap();
        let living = temporary(folder.path()).unwrap();
        write_atomically(&at("a.exr"), |file| {
            file.write_all(b"new")?;
            check_writable(&at("b.exr"), Some("exr")).unwrap();
            Ok(())
        })
        .unwrap();
        let own = living.path().file_name().unwrap().to_str().unwrap().to_owned();
        let mut left = names(folder.path());
        left.sort();
        let mut expected = [".bdpm-.exr", "bdpm-a.tmp", ".bdpm-folder.tmp", "a.exr", &own];
        expected.sort_unstable();
        assert_eq!(left, expected);
        drop(living);
    }

    #[cfg(unix)]
    #[test]
    fn symbolic_link_stays_and_its_target_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("disk")).unwrap();
        std::os::unix::fs::symlink("disk/a.exr", at("a.exr")).unwrap();
        for content in [b"1", b"2"] {
            check_writable(&at("a.exr"), Some("exr")).unwrap();
            write_atomically(&at("a.exr"), |file| file.write_all(content)).unwrap();
            assert_eq!(fs::read(at("disk/a.exr")).unwrap(), content);
            assert!(at("a.exr").is_symlink());
        }
        assert_eq!(names(&at("disk")), ["a.exr"]);
    }
}
