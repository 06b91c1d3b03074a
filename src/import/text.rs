//! Reading text files, and words for messages.

use crate::base::error::{Error, Result};
use crate::base::memory::{GIB, available_memory};
use std::borrow::Cow;
use std::io::Read;
use std::path::{Path, PathBuf};

pub(super) use crate::base::input::open;

/// Largest accepted scene file, bytes. Geometry belongs into OBJ files, which have no limit.
const MAX_SCENE_FILE: u64 = 16 << 20;

/// Reads a small text file as a whole, without its byte order mark.
pub(super) fn read(path: &Path) -> Result<String> {
    let mut bytes = Vec::new();
    open(path)?
        .take(MAX_SCENE_FILE + 1)
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io("read the file", path, e))?;
    if bytes.len() as u64 > MAX_SCENE_FILE {
        return Err(Error::new(
            format!("the scene file is larger than {} MiB", MAX_SCENE_FILE >> 20),
            "keep geometry in OBJ files",
        )
        .at(path));
    }
    let text = String::from_utf8(bytes).map_err(|e| {
        let offset = e.utf8_error().valid_up_to();
        // Valid up to the offset, so the lossy text has the same length up to there.
        let text = String::from_utf8_lossy(e.as_bytes());
        Error::new("this is not UTF-8 text", "save the scene file as UTF-8")
            .at(path)
            .at_offset(&text, offset)
    })?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// Peak memory of reading a model over the size of its text: 3.4 to 5.5 for a million triangles.
const TIMES_IN_MEMORY: f64 = 6.0;

/// Reads an OBJ or MTL file of any size that memory has room for, without its byte order mark. Where
/// all line ends are those of old Macs, they become new ones.
pub(super) fn read_lines(path: &Path) -> Result<Vec<u8>> {
    let mut file = open(path)?;
    let needed = TIMES_IN_MEMORY * file.metadata().map_or(0, |metadata| metadata.len()) as f64;
    match available_memory() {
        Some(available) if needed > available => {
            let (needed, available) = (needed / GIB, available / GIB);
            let problem = format!(
                "reading the file takes about {needed:.1} GiB of memory, but {available:.1} GiB are \
                 available"
            );
            return Err(Error::new(problem, "split or simplify the model").at(path));
        }
        _ => {}
    }
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(|e| Error::io("read the file", path, e))?;
    if bytes.starts_with(b"\xef\xbb\xbf") {
        bytes.drain(..3);
    }
    if memchr::memchr(b'\n', &bytes).is_none() {
        bytes.iter_mut().filter(|byte| **byte == b'\r').for_each(|byte| *byte = b'\n');
    }
    Ok(bytes)
}

/// Bytes as text: UTF-8, else Latin-1, in which each byte is a character and no two names become one.
pub(super) fn decoded(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(bytes.iter().map(|byte| char::from(*byte)).collect()),
    }
}

/// The file that a model calls so, as text that was [`decoded`]: perhaps with the separators of another system,
/// and perhaps by bytes that are no UTF-8.
pub(super) fn find(folder: &Path, name: &str) -> Option<PathBuf> {
    let names = [name.to_owned(), name.replace('\\', "/")];
    let as_text = names.iter().map(PathBuf::from);
    let as_bytes = names.iter().filter_map(|name| latin1_path(name));
    as_text.chain(as_bytes).map(|name| folder.join(name)).find(|path| path.exists())
}

/// The name as the bytes of Latin-1, if it has characters that UTF-8 would write otherwise.
#[cfg(unix)]
fn latin1_path(name: &str) -> Option<PathBuf> {
    use std::os::unix::ffi::OsStringExt;
    let bytes: Option<Vec<u8>> = name.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect();
    let bytes = bytes.filter(|bytes| !bytes.is_ascii())?;
    Some(std::ffi::OsString::from_vec(bytes).into())
}

#[cfg(not(unix))]
fn latin1_path(_: &str) -> Option<PathBuf> {
    None
}

/// The first word and what follows it, without white space around either.
pub(super) fn split_keyword(line: &str) -> (&str, &str) {
    let end = line.find(char::is_whitespace).unwrap_or(line.len());
    (&line[..end], line[end..].trim_start())
}

/// A few names for a message, in quotes.
pub(super) fn list<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    const SHOWN: usize = 12;
    let mut names = names.into_iter();
    let mut text = String::new();
    for name in names.by_ref().take(SHOWN) {
        let short: String = name.chars().take(60).collect();
        text.push_str(if text.is_empty() { "`" } else { ", `" });
        text.push_str(&short);
        text.push('`');
    }
    match names.count() {
        0 => text,
        more => format!("{text} and {more} more"),
    }
}

/// A few problems for a message, one after the other.
pub(super) fn problems<'a>(all: impl IntoIterator<Item = &'a str>) -> String {
    const SHOWN: usize = 4;
    let mut all = all.into_iter();
    let short = |text: &str| text.chars().take(200).collect::<String>();
    let shown: Vec<String> = all.by_ref().take(SHOWN).map(short).collect();
    match all.count() {
        0 => shown.join("; "),
        more => format!("{}; and {more} more", shown.join("; ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lists_are_cut() {
        assert_eq!(list(["a", "b"]), "`a`, `b`");
        assert!(list(["x"; 20]).ends_with("and 8 more"));
        assert_eq!(problems(["no a", "no b"]), "no a; no b");
        assert!(problems(["x"; 20]).ends_with("; and 16 more"));
    }
}
