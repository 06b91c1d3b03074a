//! Reading files, and lists for messages.

use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::memory::available_memory;
use std::io::Read;
use std::path::Path;

pub use super::file_names::find;
use super::gzip;
pub use bdpm_core::base::input::{decoded, open, read_bytes};
pub use bdpm_core::base::memory::check_memory;

/// Largest accepted scene file, bytes. Geometry belongs in OBJ files, which have no limit.
const MAX_SCENE_FILE: u64 = 16 << 20;

/// Names the file, unless the error names one already.
pub fn placed_at(error: Error, path: &Path) -> Error {
    if error.has_location() { error } else { error.at(path) }
}

/// The advice for a file whose name is wrong in a scene file.
pub const RELATIVE_NAME: &str = "check the name; it is relative to the folder of the scene file";

/// Reads a small text file as a whole, without its byte order mark.
pub fn read(path: &Path) -> Result<String> {
    let bytes = read_bytes(path, MAX_SCENE_FILE + 1)?;
    if bytes.len() as u64 > MAX_SCENE_FILE {
        let problem = format!("the scene file is larger than {} MiB", MAX_SCENE_FILE >> 20);
        return Err(Error::new(problem, "keep geometry in OBJ files").at(path));
    }
    let text = String::from_utf8(bytes).map_err(|e| {
        let offset = e.utf8_error().valid_up_to();
        // The lossy text is the same up to the offset, where the bytes are valid.
        let text = String::from_utf8_lossy(e.as_bytes());
        Error::new("this is not UTF-8 text", "save the scene file as UTF-8")
            .at(path)
            .at_offset(&text, offset)
    })?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// Peak memory of reading a model over the size of its text: 3.4 to 5.5 for a million triangles.
const TIMES_IN_MEMORY: f64 = 6.0;

/// Reads an OBJ or MTL file of any size that fits in memory, without its byte order mark. If all
/// line ends are those of old Macs, they become line feeds.
pub fn read_lines(path: &Path) -> Result<Vec<u8>> {
    let mut file = open(path)?;
    let needed = TIMES_IN_MEMORY * file.metadata().map_or(0, |metadata| metadata.len()) as f64;
    check_memory(needed, available_memory()).map_err(|problem| {
        let problem = format!("reading the file takes {problem}");
        Error::new(problem, "split or simplify the model").at(path)
    })?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(|e| Error::io("read the file", path, e))?;
    if bytes.starts_with(b"\xef\xbb\xbf") {
        bytes.drain(..3);
    }
    if !bytes.starts_with(&gzip::MAGIC) {
        unify_line_ends(&mut bytes);
    }
    Ok(bytes)
}

/// Replaces the line ends of old Macs.
pub fn unify_line_ends(text: &mut [u8]) {
    if memchr::memchr(b'\n', text).is_none() {
        text.iter_mut().filter(|byte| **byte == b'\r').for_each(|byte| *byte = b'\n');
    }
}

/// The first word and what follows it, without white space around either.
pub fn split_keyword(line: &str) -> (&str, &str) {
    let end = line.find(char::is_whitespace).unwrap_or(line.len());
    (&line[..end], line[end..].trim_start())
}

/// A few names for a message, in quotes.
pub fn list<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let mut names = names.into_iter();
    let quoted = |name: &str| format!("`{}`", shortened(name, 60));
    let shown: Vec<String> = names.by_ref().take(12).map(quoted).collect();
    match names.count() {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}

/// A few problems for a message, one after the other.
pub fn problems<'a>(all: impl IntoIterator<Item = &'a str>) -> String {
    let mut all = all.into_iter();
    let shown: Vec<String> = all.by_ref().take(4).map(|text| shortened(text, 200)).collect();
    match all.count() {
        0 => shown.join("; "),
        more => format!("{}; and {more} more", shown.join("; ")),
    }
}

fn shortened(text: &str, limit: usize) -> String {
    text.chars().take(limit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lists_are_shortened() {
        assert_eq!(list(["a", "b"]), "`a`, `b`");
        assert!(list(["x"; 20]).ends_with("and 8 more"));
        assert_eq!(problems(["no a", "no b"]), "no a; no b");
        assert!(problems(["x"; 20]).ends_with("; and 16 more"));
    }
}
