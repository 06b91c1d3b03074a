//! Buffer views compressed by `EXT_meshopt_compression` or `KHR_meshopt_compression`, by the
//! bitstreams of these specifications. No crate is used: the maintained one binds a library of C++.

mod attributes;
mod filters;
mod indices;

use super::buffers::bytes_of;
use super::json::{BufferView, GltfDocument, MeshoptView, get};
use super::{EXPORT_AGAIN, malformed};
use crate::text::check_memory;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::memory::available_memory;
use std::collections::HashMap;
use std::sync::Arc;

/// A problem with a stream.
type Problem = &'static str;

/// The stream ends too early.
const CUT_OFF: Problem = "its compressed data are cut off";

/// The stream is longer than its content.
const TOO_LONG: Problem = "its compressed data have bytes that belong to nothing";

/// Splits off the first `count` bytes of `data`.
fn take<'a>(data: &mut &'a [u8], count: usize) -> std::result::Result<&'a [u8], Problem> {
    let (first, rest) = data.split_at_checked(count).ok_or(CUT_OFF)?;
    *data = rest;
    Ok(first)
}

/// Splits off the first byte of `data`.
fn take_byte(data: &mut &[u8]) -> std::result::Result<u8, Problem> {
    Ok(take(data, 1)?[0])
}

/// The number whose zigzag code this is, modulo 2^32.
fn unzigzag(code: u32) -> u32 {
    (code >> 1) ^ (code & 1).wrapping_neg()
}

/// Whether the content of a buffer is never read: all its views are compressed, and their streams
/// are in other buffers.
pub(super) fn is_placeholder(document: &GltfDocument, buffer: usize) -> bool {
    let own = &document.buffers[buffer];
    if own.extensions.all().any(|extension| extension.fallback) {
        return true;
    }
    let mut views = document.buffer_views.iter().filter(|view| view.buffer == buffer).peekable();
    let is_stream =
        |view: &BufferView| view.extensions.meshopt().is_some_and(|stream| stream.buffer == buffer);
    own.uri.is_none()
        && views.peek().is_some()
        && views.all(|view| view.extensions.meshopt().is_some())
        && !document.buffer_views.iter().any(is_stream)
}

/// The content of all compressed views, by their index. `data` are those of all buffers.
///
/// # Errors
/// If a stream is malformed, or its content does not fit in memory.
pub(super) fn decoded(
    document: &GltfDocument,
    data: &[Arc<Vec<u8>>],
) -> Result<HashMap<usize, Vec<u8>>> {
    let mut all = HashMap::new();
    let mut total = 0.0;
    for (index, view) in document.buffer_views.iter().enumerate() {
        let Some(stream) = view.extensions.meshopt() else { continue };
        let element = format!("bufferViews[{index}].extensions.{}", view.extensions.meshopt_name());
        total += view.byte_length as f64;
        check_memory(2.0 * total, available_memory()).map_err(|problem| {
            Error::new(format!("{element}: the compressed views take {problem}"), EXPORT_AGAIN)
        })?;
        let buffer = get(data, "buffers", stream.buffer, &element)?;
        let bytes = bytes_of(buffer, stream.byte_offset, stream.byte_length).ok_or_else(|| {
            malformed(&element, format!("it exceeds the {} bytes of its buffer", buffer.len()))
        })?;
        let content =
            content(stream, view, bytes).map_err(|problem| malformed(&element, problem))?;
        all.insert(index, content);
    }
    Ok(all)
}

/// The content of a stream.
fn content(
    stream: &MeshoptView,
    view: &BufferView,
    bytes: &[u8],
) -> std::result::Result<Vec<u8>, Problem> {
    let MeshoptView { count, byte_stride, .. } = *stream;
    if count.checked_mul(byte_stride) != Some(view.byte_length) {
        return Err("byteStride times count is not the byteLength of its view");
    }
    let (Ok(count), Ok(stride)) = (usize::try_from(count), usize::try_from(byte_stride)) else {
        return Err("count is too large");
    };
    let filter = stream.filter.as_deref().unwrap_or("NONE");
    match &stream.mode[..] {
        "ATTRIBUTES" => {
            let mut content = attributes::decode(bytes, count, stride)?;
            filters::apply(filter, &mut content, stride)?;
            Ok(content)
        }
        _ if filter != "NONE" => Err("only attributes have a filter"),
        "TRIANGLES" => indices::triangles(bytes, count, stride),
        "INDICES" => indices::sequence(bytes, count, stride),
        _ => Err("its mode is none of ATTRIBUTES, TRIANGLES and INDICES"),
    }
}

#[cfg(test)]
mod tests;
