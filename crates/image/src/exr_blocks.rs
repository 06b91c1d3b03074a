//! Blocks of lines of an EXR file: their bytes and their compression.
//!
//! The values of a block are computed, encoded and compressed by one thread, so that an image takes
//! little memory beside its sums while it is written.

use super::Layer;
use super::exr_format::{ExrFormat, half};
use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::writer::{ChunkWriter, ChunksWriter};
use exr::block::{BlockIndex, UncompressedBlock};
use exr::error::{Error, Result};
use exr::meta::attribute::{ChannelDescription, SampleType};
use exr::meta::header::Header;
use exr::prelude::{Compression, Text, Vec2};
use rayon::prelude::*;
use std::io::{Seek, Write};
use std::ops::Range;
use zlib_rs::{DeflateConfig, ReturnCode, Strategy, compress_bound, compress_slice};

/// Compression of large files: Huffman codes and run lengths. Searching for longer repetitions
/// takes several times as long, and finds few of them in the digits of noisy values.
fn fast() -> DeflateConfig {
    DeflateConfig { strategy: Strategy::Rle, ..DeflateConfig::new(1) }
}

/// A channel of a file, and its place among the layers.
pub(super) struct Channel {
    pub name: String,
    layer: usize,
    channel: usize,
    /// 16-bit instead of 32-bit floats.
    half: bool,
}

/// The channels of all layers, sorted by name, as EXR files have them.
pub(super) fn channels(layers: &[Layer], format: &ExrFormat) -> Vec<Channel> {
    let mut all = Vec::new();
    for (index, layer) in layers.iter().enumerate() {
        for (channel, (name, _)) in layer.channels.iter().enumerate() {
            let name = match &layer.name[..] {
                "" => name.clone(),
                layer => format!("{layer}.{name}"),
            };
            all.push(Channel { name, layer: index, channel, half: format.is_half(layer) });
        }
    }
    all.sort_by(|one, other| one.name.cmp(&other.name));
    all
}

impl Channel {
    /// The channel in the header of a file.
    pub fn description(&self, name: Text) -> ChannelDescription {
        let sample_type = if self.half { SampleType::F16 } else { SampleType::F32 };
        ChannelDescription::named(name, sample_type)
    }
}

/// Writes all blocks of a file in order. `layers` returns the layers of some rows.
///
/// # Errors
/// If the file cannot be written.
pub(super) fn write<W: Write + Seek>(
    header: &Header,
    (channels, format): (&[Channel], ExrFormat),
    layers: &(dyn Fn(Range<u32>) -> Vec<Layer> + Sync),
    to: &mut ChunkWriter<W>,
) -> Result<()> {
    let Vec2(width, height) = header.layer_size;
    let lines = header.max_block_pixel_size().1;
    let blocks = height.div_ceil(lines);
    // As many blocks at a time as there are threads: they are the only memory that grows with the
    // width.
    let at_once = rayon::current_num_threads();
    for first in (0..blocks).step_by(at_once) {
        let compressed = (first..(first + at_once).min(blocks)).into_par_iter().map(|block| {
            let rows = block * lines..((block + 1) * lines).min(height);
            let bytes = encode(channels, &layers(rows.start as u32..rows.end as u32), width);
            compress(header, format, rows, bytes)
        });
        for (block, chunk) in (first..).zip(compressed.collect::<Result<Vec<Chunk>>>()?) {
            to.write_chunk(block, chunk)?;
        }
    }
    Ok(())
}

/// Values of a block line by line, and channel by channel in each line.
///
/// # Panics
/// If a channel does not have one value per pixel.
fn encode(channels: &[Channel], layers: &[Layer], width: usize) -> Vec<u8> {
    let values: Vec<&[f32]> =
        channels.iter().map(|own| &layers[own.layer].channels[own.channel].1[..]).collect();
    let lines = values.first().map_or(0, |values| values.len() / width);
    assert!(values.iter().all(|values| values.len() == lines * width), "one value per pixel");
    let mut bytes = Vec::with_capacity(4 * lines * width * channels.len());
    for line in 0..lines {
        for (channel, values) in channels.iter().zip(&values) {
            let values = &values[line * width..(line + 1) * width];
            match channel.half {
                true => bytes.extend(values.iter().flat_map(|value| half(*value).to_ne_bytes())),
                false => bytes.extend(values.iter().flat_map(|value| value.to_ne_bytes())),
            }
        }
    }
    bytes
}

fn compress(
    header: &Header,
    format: ExrFormat,
    rows: Range<usize>,
    bytes: Vec<u8>,
) -> Result<Chunk> {
    if format.fast
        && header.compression == Compression::ZIP16
        && cfg!(target_endian = "little")
        && let Some(compressed_pixels_le) = zip(&bytes)
    {
        let y_coordinate = header.own_attributes.layer_position.1 + rows.start as i32;
        let block = CompressedScanLineBlock { y_coordinate, compressed_pixels_le };
        return Ok(Chunk { layer_index: 0, compressed_block: CompressedBlock::ScanLine(block) });
    }
    let index = BlockIndex {
        layer: 0,
        pixel_position: Vec2(0, rows.start),
        pixel_size: Vec2(header.layer_size.0, rows.len()),
        level: Vec2(0, 0),
    };
    UncompressedBlock { index, data: bytes }.compress_to_chunk(std::slice::from_ref(header))
}

/// ZIP of *Technical Introduction to OpenEXR*: even and odd bytes apart, differences of neighbors,
/// and a zlib stream. `None` if that is not shorter.
fn zip(bytes: &[u8]) -> Option<Vec<u8>> {
    let (even, odd) = (bytes.iter().step_by(2), bytes.iter().skip(1).step_by(2));
    let mut last = 128u8;
    let difference = |byte: &u8| {
        let difference = byte.wrapping_sub(last).wrapping_add(128);
        last = *byte;
        difference
    };
    let differences: Vec<u8> = even.chain(odd).map(difference).collect();
    let mut compressed = vec![0; compress_bound(differences.len())];
    let (stream, code) = compress_slice(&mut compressed, &differences, fast());
    let length = (code == ReturnCode::Ok).then_some(stream.len())?;
    compressed.truncate(length);
    (length < bytes.len()).then_some(compressed)
}

/// Error of a file as one of the standard library.
pub(super) fn io_error(error: Error) -> std::io::Error {
    match error {
        Error::Io(error) => error,
        error => std::io::Error::other(error.to_string()),
    }
}
