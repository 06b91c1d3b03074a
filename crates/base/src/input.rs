//! Opens input files and remembers them, so that no output replaces one.

use crate::error::{Error, Result};
use crate::file_id::FileId;
use crate::memory::{GIB, available_memory, check_memory};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Maximum size of a text, bytes: settings, times and lists are far smaller.
pub const MAX_TEXT: u64 = 16 << 20;

/// Files that this process has read, each with the path last used for it.
static READ: Mutex<BTreeMap<FileId, PathBuf>> = Mutex::new(BTreeMap::new());

/// Opens a regular file for reading. Folders get a clearer error than the system's; devices and
/// pipes are refused because they may never end.
///
/// # Errors
/// Names `path`.
pub fn open(path: &Path) -> Result<File> {
    // Check before opening: opening a pipe waits for its writer.
    let metadata = std::fs::metadata(path).map_err(|e| Error::io("read the file", path, e))?;
    if metadata.is_dir() {
        return Err(Error::new("this is a folder, not a file", "name a file in it").at(path));
    }
    if !metadata.is_file() {
        return Err(Error::new(
            "this is neither a regular file nor a folder",
            "copy its content to a file",
        )
        .at(path));
    }
    open_any(path)
}

/// Opens a file, device or pipe; its content may have no end.
fn open_any(path: &Path) -> Result<File> {
    let file = File::open(path).map_err(|e| Error::io("read", path, e))?;
    if let Some(identity) = FileId::of(path) {
        let mut read = READ.lock().unwrap_or_else(PoisonError::into_inner);
        read.insert(identity, path.to_owned());
    }
    Ok(file)
}

/// The path by which this process has read the file that writing to `path` would replace, if it
/// has.
pub fn read_as(path: &Path) -> Option<PathBuf> {
    let identity = FileId::of(path)?;
    let read = READ.lock().unwrap_or_else(PoisonError::into_inner);
    let name = read.get(&identity)?;
    // Systems reuse the numbers of deleted files.
    (FileId::of(name)? == identity).then(|| name.clone())
}

/// All files that this process has read, in the order of their paths.
pub fn files_read() -> Vec<PathBuf> {
    let read = READ.lock().unwrap_or_else(PoisonError::into_inner);
    let mut paths: Vec<PathBuf> = read.values().cloned().collect();
    paths.sort();
    paths
}

/// Takes files off the list of those that this process has read: copies that it read only to check
/// them.
pub fn forget(paths: &[PathBuf]) {
    let mut read = READ.lock().unwrap_or_else(PoisonError::into_inner);
    paths.iter().filter_map(|path| FileId::of(path)).for_each(|identity| {
        read.remove(&identity);
    });
}

/// Refuses to write `what` to `path` if this process has read that file.
///
/// # Errors
/// Names `path`.
pub fn check_not_read(path: &Path, what: &str) -> Result<()> {
    let Some(name) = read_as(path) else { return Ok(()) };
    let spelled = if name == path { String::new() } else { format!(", as {}", name.display()) };
    let problem = format!("{what} would replace a file that was read{spelled}");
    Err(Error::new(problem, "give another name").at(path))
}

/// Reads a small text, also from a pipe.
///
/// # Errors
/// If it cannot be read, is no UTF-8, or exceeds [`MAX_TEXT`]; names `path`.
pub fn read_text(path: &Path) -> Result<String> {
    let bytes = read_at_most(&mut open_any(path)?, path, MAX_TEXT)?;
    String::from_utf8(bytes)
        .map_err(|_| Error::new("this is no UTF-8 text", "check the path").at(path))
}

/// Reads a file, cut off at `limit` bytes.
///
/// # Errors
/// If it cannot be read or memory does not suffice; names `path`.
pub fn read_bytes(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let file = open(path)?;
    // Files may have holes, which take no space.
    let length = file.metadata().map_or(0, |metadata| metadata.len()).min(limit);
    check_memory(length as f64, available_memory()).map_err(|problem| {
        let problem = format!("reading the file takes {problem}");
        Error::new(problem, "give a smaller file").at(path)
    })?;
    let read = file.take(limit).read_to_end(&mut bytes);
    read.map_err(|e| Error::io("read the file", path, e))?;
    Ok(bytes)
}

/// Bytes as text: UTF-8, else Latin-1, in which each byte is a character and different names stay
/// different.
pub fn decoded(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(bytes.iter().map(|byte| char::from(*byte)).collect()),
    }
}

/// The extension of a file name in lower case.
pub fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// Reads a file or pipe that begins with `magic`, up to half the available memory; of others at
/// most the beginning.
///
/// # Errors
/// If it cannot be read or memory does not suffice; names `path`.
pub fn read_if_begins(path: &Path, magic: &[u8]) -> Result<Vec<u8>> {
    let mut file = open_any(path)?;
    let mut bytes = read_at_most(&mut (&mut file).take(magic.len() as u64), path, u64::MAX)?;
    if bytes == magic {
        // Decoding takes as much memory again.
        let most = available_memory().map_or(u64::MAX >> 1, |bytes| (0.5 * bytes) as u64);
        bytes.extend(read_at_most(&mut file, path, most)?);
    }
    Ok(bytes)
}

fn read_at_most(from: &mut impl Read, path: &Path, most: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let read = from.take(most.saturating_add(1)).read_to_end(&mut bytes);
    read.map_err(|e| Error::io("read", path, e))?;
    if bytes.len() as u64 > most {
        let problem = match most {
            MAX_TEXT => format!("it is larger than the {} MiB of any such file", MAX_TEXT >> 20),
            most => {
                format!("it is larger than the {:.1} GiB that memory allows", most as f64 / GIB)
            }
        };
        return Err(Error::new(problem, "check the path").at(path));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn what_was_read_is_known_by_all_its_names() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        fs::write(at("a"), "text").unwrap();
        fs::write(at("b"), "text").unwrap();
        fs::hard_link(at("a"), at("c")).unwrap();
        assert_eq!(read_as(&at("a")), None, "it was only written");
        assert_eq!(read_text(&at("a")).unwrap(), "text");
        assert_eq!(read_as(&at("./c")), Some(at("a")));
        assert_eq!(read_as(&at("b")), None);
        assert_eq!(read_as(&at("new")), None);
        let shown = check_not_read(&at("c"), "--output").unwrap_err().to_string();
        assert!(shown.contains("--output would replace a file that was read, as "), "{shown}");
        check_not_read(&at("b"), "--output").unwrap();
        // A file in its place is another one.
        fs::write(at("d"), "").unwrap();
        fs::rename(at("d"), at("a")).unwrap();
        assert_eq!(read_as(&at("a")), None);
        assert!(open(&at("b")).is_ok() && read_as(&at("b")).is_some());
        forget(&[at("b"), at("new")]);
        assert_eq!(read_as(&at("b")), None);
    }

    #[cfg(unix)]
    #[test]
    fn what_has_no_end_is_not_read_to_it() {
        let zero = Path::new("/dev/zero");
        assert!(open(zero).unwrap_err().to_string().contains("neither a regular file"));
        assert!(read_text(zero).unwrap_err().to_string().contains("larger than the 16 MiB"));
        assert_eq!(read_if_begins(zero, b"bdpm").unwrap(), [0; 4]);
    }

    #[test]
    fn what_begins_otherwise_is_not_read() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("a");
        for (content, read) in [("bdpm and more", "bdpm and more"), ("other", "othe"), ("b", "b")] {
            fs::write(&path, content).unwrap();
            assert_eq!(read_if_begins(&path, b"bdpm").unwrap(), read.as_bytes());
        }
    }
}
