//! Checks of shared libraries before they are loaded.
//!
//! The loader maps a library by the sizes that its header states. If the file is shorter, such as
//! after a download that was cut off, the first access past its end kills the program by SIGBUS.

use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// Start of a file in the Executable and Linkable Format.
const MAGIC: &[u8] = b"\x7fELF";

/// Size of the header of a 64-bit file, bytes.
const HEADER: usize = 64;

/// Size of the description of a segment in a 64-bit file, bytes.
const SEGMENT: usize = 56;

/// Checks that the file of a library is complete, and that libraries beside it are, whose names
/// start with one of `companions`: those that it loads. Files of other systems are not checked.
///
/// # Errors
/// Says which file is incomplete. The text does not name `library`.
pub fn check(library: &Path, companions: &[&str]) -> Result<(), String> {
    check_file(library)?;
    let folder = library.parent().into_iter().filter_map(|folder| fs::read_dir(folder).ok());
    for entry in folder.flatten().flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        let is_companion = companions.iter().any(|start| name.starts_with(start));
        if is_companion && name.contains(".so") && entry.path().is_file() {
            check_file(&entry.path()).map_err(|problem| format!("{name} beside it: {problem}"))?;
        }
    }
    Ok(())
}

fn check_file(path: &Path) -> Result<(), String> {
    let metadata = fs::metadata(path).map_err(|error| error.to_string())?;
    if !metadata.is_file() {
        return Err("it is no regular file".into());
    }
    let needed = File::open(path).and_then(|mut file| stated_size(&mut file));
    match needed.map_err(|error| error.to_string())? {
        Some(needed) if needed > u128::from(metadata.len()) => Err(format!(
            "the file is incomplete: it has {} bytes, but its header states {needed} or more; \
             install it again",
            metadata.len()
        )),
        _ => Ok(()),
    }
}

/// Minimum size of a file by its header: up to the end of its segments and of the tables of
/// segments and sections. `None` unless it is a 64-bit ELF file.
fn stated_size(file: &mut (impl Read + Seek)) -> io::Result<Option<u128>> {
    let mut header = Vec::new();
    file.by_ref().take(HEADER as u64).read_to_end(&mut header)?;
    if !header.starts_with(MAGIC) || header.get(4).is_some_and(|class| *class != 2) {
        return Ok(None);
    }
    if header.len() < HEADER {
        return Ok(Some(HEADER as u128));
    }
    let is_little = header[5] == 1;
    let number = |bytes: &[u8], from: usize, size: usize| -> u64 {
        let bytes = bytes[from..from + size].iter();
        let add = |sum: u64, byte: &u8| (sum << 8) | u64::from(*byte);
        if is_little { bytes.rev().fold(0, add) } else { bytes.fold(0, add) }
    };
    // Offset of a table, and size and number of its entries
    let table = |offset: usize, size: usize| {
        let [size, count] = [size, size + 2].map(|from| number(&header, from, 2));
        (number(&header, offset, 8), size, count)
    };
    let end = |(offset, size, count): (u64, u64, u64)| {
        if offset == 0 { 0 } else { u128::from(offset) + u128::from(size * count) }
    };
    let (segments, sections) = (table(32, 54), table(40, 58));
    let mut needed = end(segments).max(end(sections)).max(HEADER as u128);
    let (offset, size, count) = segments;
    for index in 0..count {
        let mut segment = Vec::new();
        let Some(from) = offset.checked_add(index * size) else { break };
        file.seek(SeekFrom::Start(from))?;
        file.by_ref().take(SEGMENT as u64).read_to_end(&mut segment)?;
        if segment.len() < SEGMENT {
            break; // The table itself ends after the file.
        }
        let [from, size] = [8, 32].map(|at| number(&segment, at, 8));
        needed = needed.max(u128::from(from) + u128::from(size));
    }
    Ok(Some(needed))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    /// A file with one segment of `size` bytes after the header and the table of segments.
    fn library(size: u64) -> Vec<u8> {
        let mut bytes = vec![0; HEADER + SEGMENT];
        bytes[..6].copy_from_slice(b"\x7fELF\x02\x01");
        bytes[32..40].copy_from_slice(&(HEADER as u64).to_le_bytes());
        bytes[54..56].copy_from_slice(&(SEGMENT as u16).to_le_bytes());
        bytes[56..58].copy_from_slice(&1u16.to_le_bytes());
        let start = (HEADER + SEGMENT) as u64;
        bytes[HEADER + 8..HEADER + 16].copy_from_slice(&start.to_le_bytes());
        bytes[HEADER + 32..HEADER + 40].copy_from_slice(&size.to_le_bytes());
        bytes
    }

    fn needed(bytes: &[u8]) -> Option<u128> {
        stated_size(&mut Cursor::new(bytes)).unwrap()
    }

    #[test]
    fn stated_size_is_the_end_of_segments_and_tables() {
        assert_eq!(needed(&library(1000)), Some(1120));
        assert_eq!(needed(&library(u64::MAX)), Some(u128::from(u64::MAX) + 120));
        let mut with_sections = library(1000);
        with_sections[40..48].copy_from_slice(&5000u64.to_le_bytes());
        with_sections[58..60].copy_from_slice(&64u16.to_le_bytes());
        with_sections[60..62].copy_from_slice(&2u16.to_le_bytes());
        assert_eq!(needed(&with_sections), Some(5128));
        for (bytes, size) in [(&b"no library"[..], None), (b"", None), (b"\x7fELF\x02", Some(64))] {
            assert_eq!(needed(bytes), size);
        }
        // Any header is read without a panic.
        for byte in 6..HEADER + SEGMENT {
            let mut damaged = library(1000);
            damaged[byte] = 0xff;
            needed(&damaged);
            needed(&damaged[..byte]);
        }
    }

    #[test]
    fn incomplete_library_and_companion_are_refused() {
        let folder = std::env::temp_dir().join(format!("bdpm-library-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let (own, other) = (folder.join("libown.so.4"), folder.join("libother.so"));
        let mut whole = library(1000);
        whole.resize(1120, 0);
        fs::write(&own, &whole).unwrap();
        fs::write(&other, &whole[..1119]).unwrap();
        check(&own, &["libtbb"]).unwrap();
        let problem = check(&own, &["libother"]).unwrap_err();
        assert!(problem.starts_with("libother.so beside it: the file is incomplete"), "{problem}");
        let problem = check(&other, &[]).unwrap_err();
        assert!(problem.contains("it has 1119 bytes, but its header states 1120"), "{problem}");
        assert!(check(&folder, &[]).unwrap_err().contains("no regular file"));
        fs::remove_dir_all(&folder).unwrap();
    }
}
