//! Bytes: buffers, and the content of URIs (a file or the URI itself).

use super::json::{GltfDocument, get};
use super::meshopt::{self, is_placeholder};
use super::{EXPORT_AGAIN, malformed};
use crate::file_names::{find_inside, is_guess, leaves};
use crate::text::read_bytes;
use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use bdpm_core::base::error::{Error, Result};
use std::collections::{BTreeSet, HashMap};
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Largest accepted file, bytes.
const MAX_FILE: u64 = 1 << 32;

/// Decodes base64 with or without padding.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// All buffers of a file.
pub(super) struct Buffers<'a> {
    pub document: &'a GltfDocument,
    data: Vec<Arc<Vec<u8>>>,
    /// Content of compressed views by their index.
    decoded: HashMap<usize, Vec<u8>>,
}

/// The bytes of a buffer view.
#[derive(Clone, Copy)]
pub(super) struct ViewBytes<'a> {
    pub bytes: &'a [u8],
    /// Bytes from one element to the next, if that is not the size of one element.
    pub stride: Option<u64>,
}

impl<'a> Buffers<'a> {
    /// Reads all buffers; `bin` is the one in a GLB file.
    pub fn load(document: &'a GltfDocument, bin: Option<Vec<u8>>, folder: &Path) -> Result<Self> {
        check_uris(document)?;
        let bin = bin.map(Arc::new);
        // Many buffers may be in one file, which is read once.
        let mut longest: HashMap<&str, u64> = HashMap::new();
        for buffer in &document.buffers {
            let own = longest.entry(buffer.uri.as_deref().unwrap_or_default()).or_default();
            *own = buffer.byte_length.max(*own);
        }
        let mut files: HashMap<&str, Arc<Vec<u8>>> = HashMap::new();
        let mut data = Vec::with_capacity(document.buffers.len());
        for (index, buffer) in document.buffers.iter().enumerate() {
            let element = format!("buffers[{index}]");
            if is_placeholder(document, index) {
                data.push(Arc::default());
                continue;
            }
            let bytes = match (buffer.uri.as_deref(), &bin) {
                (Some(uri), _) => match files.get(uri) {
                    Some(bytes) => bytes.clone(),
                    None => {
                        let read = read(uri, folder, longest[uri], &format!("{element}.uri"))?;
                        files.entry(uri).or_insert(Arc::new(read)).clone()
                    }
                },
                (None, Some(bin)) if index == 0 => bin.clone(),
                (None, _) => return Err(malformed(element, "it has no uri, and so no content")),
            };
            let (length, held) = (buffer.byte_length, bytes.len());
            if length > held as u64 {
                let problem = format!("byteLength is {length}, but it has {held} bytes");
                return Err(malformed(element, problem));
            }
            data.push(bytes);
        }
        let decoded = meshopt::decoded(document, &data)?;
        Ok(Self { document, data, decoded })
    }

    /// The view that `element` refers to.
    pub fn view(&self, index: usize, element: impl Display) -> Result<ViewBytes<'_>> {
        let view = get(&self.document.buffer_views, "bufferViews", index, element)?;
        let own = format!("bufferViews[{index}]");
        if let Some(bytes) = self.decoded.get(&index) {
            return Ok(ViewBytes { bytes, stride: view.byte_stride });
        }
        let bytes = get(&self.data, "buffers", view.buffer, format!("{own}.buffer"))?;
        let held = bytes_of(bytes, view.byte_offset, view.byte_length);
        let bytes = held.ok_or_else(|| {
            let (offset, length) = (view.byte_offset, view.byte_length);
            let (buffer, size) = (view.buffer, bytes.len());
            let problem = format!(
                "byteOffset {offset} and byteLength {length} exceed the {size} bytes of buffers[{buffer}]"
            );
            malformed(own, problem)
        })?;
        Ok(ViewBytes { bytes, stride: view.byte_stride })
    }
}

/// `length` bytes from `offset` on; `None` if there are fewer.
pub(super) fn bytes_of(bytes: &[u8], offset: u64, length: u64) -> Option<&[u8]> {
    let end = usize::try_from(offset.checked_add(length)?).ok()?;
    bytes.get(usize::try_from(offset).ok()?..end)
}

/// The content of a URI, cut off at `limit` bytes.
pub(super) fn read(uri: &str, folder: &Path, limit: u64, element: &str) -> Result<Vec<u8>> {
    if let Some(data) = uri.strip_prefix("data:") {
        let base64 = data.split_once(";base64,").map(|(_, base64)| base64.trim());
        let base64 = base64.ok_or_else(|| malformed(element, "the data URI is not in base64"))?;
        return BASE64
            .decode(base64)
            .map_err(|e| malformed(element, format!("the data URI is not valid base64: {e}")));
    }
    read_bytes(&file_of(uri, folder, element)?, limit.min(MAX_FILE))
}

/// The file that a URI names, relative to `folder`.
fn file_of(uri: &str, folder: &Path, element: &str) -> Result<PathBuf> {
    let shown: String = uri.chars().take(120).collect();
    if uri.contains("://") {
        let problem = format!("`{shown}` is not a file in the folder of the scene");
        return Err(Error::new(
            format!("{element}: {problem}"),
            "name a file in the scene's folder",
        ));
    }
    // In the standard percent signs are escapes, but not all exporters comply.
    let names = [percent_decoded(uri), Some(uri.to_owned())];
    names.into_iter().flatten().find_map(|name| find_inside(folder, &name)).ok_or_else(|| {
        let advice = format!("put the file into the folder of the scene, or {EXPORT_AGAIN}");
        Error::new(format!("{element}: there is no file `{shown}`"), advice)
    })
}

/// URIs of files, each with its element.
fn files(document: &GltfDocument) -> impl Iterator<Item = (String, &String)> {
    let buffers = document.buffers.iter().map(|own| &own.uri).enumerate();
    let images = document.images.iter().map(|own| &own.uri).enumerate();
    let profiles = document.extensions.ies.lights.iter().map(|own| &own.uri).enumerate();
    let buffers = buffers.map(|(index, uri)| (format!("buffers[{index}].uri"), uri));
    let images = images.map(|(index, uri)| (format!("images[{index}].uri"), uri));
    let profiles = profiles
        .map(|(index, uri)| (format!("extensions.EXT_lights_ies.lights[{index}].uri"), uri));
    let uris = buffers.chain(images).chain(profiles);
    let uris = uris.filter_map(|(element, uri)| Some((element, uri.as_ref()?)));
    uris.filter(|(_, uri)| !uri.starts_with("data:") && !uri.contains("://"))
}

/// Refuses files above the folder of the scene, which a stranger's file has no claim to.
fn check_uris(document: &GltfDocument) -> Result<()> {
    for (element, uri) in files(document) {
        if leaves(uri) || percent_decoded(uri).is_some_and(|name| leaves(&name)) {
            let shown: String = uri.chars().take(120).collect();
            let problem = format!("{element}: `{shown}` leads out of the folder of the scene");
            let advice = "put the file into the folder of the scene and name it there, or export a \
                          .glb file, which holds its buffers and pictures";
            return Err(Error::new(problem, advice));
        }
    }
    Ok(())
}

/// Names of files of the document that were found under other names.
pub(super) fn guessed(document: &GltfDocument, folder: &Path) -> BTreeSet<String> {
    let files = files(document).map(|(_, uri)| uri);
    let is_other = |uri: &&String| {
        let names = [percent_decoded(uri), Some((*uri).clone())];
        let found =
            names.into_iter().flatten().find_map(|name| Some((find_inside(folder, &name)?, name)));
        found.is_some_and(|(path, name)| is_guess(folder, &name, &path))
    };
    files.filter(is_other).cloned().collect()
}

/// Replaces escapes such as `%20` by their characters; `None` if the result is not text.
fn percent_decoded(uri: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, more @ ..] = rest {
        rest = more;
        bytes.push(match (first, more) {
            (b'%', [high, low, after @ ..]) => {
                let digit = |byte: u8| char::from(byte).to_digit(16);
                rest = after;
                (16 * digit(*high)? + digit(*low)?) as u8
            }
            _ => *first,
        });
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percent_signs_decode_as_escapes_when_valid() {
        assert_eq!(percent_decoded("a%20b%C3%a9").as_deref(), Some("a bé"));
        assert_eq!(percent_decoded("50%"), Some("50%".to_owned()));
        for bad in ["%zz", "%ff", "%2"] {
            assert_ne!(percent_decoded(bad).as_deref(), Some("\u{ff}"), "{bad}");
        }
    }
}
