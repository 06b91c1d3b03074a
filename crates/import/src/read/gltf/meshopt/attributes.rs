//! Attributes: each byte of an element as its difference to that of the element before, in groups
//! of sixteen. Version 1 of the stream has differences of two and of four bytes as well.

use super::{CUT_OFF, Problem, TOO_LONG, take, take_byte};

/// Elements in a group.
const GROUP: usize = 16;

/// Bits per difference of a group, by the version (or the control mode of version 1) and the mode
/// of the group.
const BITS: [[u8; 4]; 3] = [[0, 2, 4, 8], [0, 1, 2, 4], [1, 2, 4, 8]];

/// Decodes `count` elements of `stride` bytes.
pub(super) fn decode(stream: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, Problem> {
    if !(4..=256).contains(&stride) || !stride.is_multiple_of(4) {
        return Err("byteStride is no multiple of 4 up to 256");
    }
    let (version, data) = match stream {
        [0xa0, data @ ..] => (0, data),
        [0xa1, data @ ..] => (1, data),
        _ => return Err("its compressed data are of an unknown version"),
    };
    // The first element, and the kind of difference of each four bytes, end the stream.
    let (kinds, least) = if version == 0 { (0, 32) } else { (stride / 4, 24) };
    let tail = stride + kinds;
    let begin = data.len().checked_sub(tail.max(least)).ok_or(CUT_OFF)?;
    let (mut data, rest) = data.split_at(begin);
    let rest = &rest[rest.len() - tail..];
    let (mut last, kinds) = (rest[..stride].to_vec(), &rest[stride..]);
    if kinds.iter().any(|kind| kind & 3 == 3) {
        return Err("its compressed data have an unknown kind of difference");
    }
    // Each block takes a header byte at least, so that few bytes cannot ask for much memory.
    let per_block = (8192 / stride / GROUP * GROUP).min(256);
    if count.div_ceil(per_block) > data.len() {
        return Err(CUT_OFF);
    }
    let mut content = Vec::with_capacity(count * stride);
    let mut codes = vec![0; per_block * stride];
    for first in (0..count).step_by(per_block) {
        let size = per_block.min(count - first);
        codes.fill(0);
        block(&mut data, version, stride, size, &mut codes)?;
        for element in 0..size {
            add(&mut last, kinds, |byte| codes[byte * per_block + element]);
            content.extend_from_slice(&last);
        }
    }
    if data.is_empty() { Ok(content) } else { Err(TOO_LONG) }
}

/// Reads the codes of the differences of a block of `size` elements, those of each byte together.
fn block(
    data: &mut &[u8],
    version: usize,
    stride: usize,
    size: usize,
    codes: &mut [u8],
) -> Result<(), Problem> {
    let controls = if version == 0 { &[] } else { take(data, stride / 4)? };
    let rows = codes.chunks_exact_mut(codes.len() / stride);
    for (byte, codes) in rows.enumerate() {
        let control = controls.get(byte / 4).map(|control| control >> (byte % 4 * 2) & 3);
        let bits = match control {
            None => BITS[0],
            Some(0) => BITS[1],
            Some(1) => BITS[2],
            Some(2) => continue,
            Some(_) => {
                codes[..size].copy_from_slice(take(data, size)?);
                continue;
            }
        };
        let groups = size.div_ceil(GROUP);
        let modes = take(data, groups.div_ceil(4))?;
        for (group, codes) in codes.chunks_exact_mut(GROUP).take(groups).enumerate() {
            let mode = modes[group / 4] >> (group % 4 * 2) & 3;
            read_group(data, bits[usize::from(mode)], codes)?;
        }
    }
    Ok(())
}

/// Reads the codes of a group. Those whose bits are all 1 follow as bytes.
fn read_group(data: &mut &[u8], bits: u8, codes: &mut [u8]) -> Result<(), Problem> {
    match bits {
        0 => {}
        8 => codes.copy_from_slice(take(data, GROUP)?),
        bits => {
            let per_byte = usize::from(8 / bits);
            let packed = take(data, GROUP / per_byte)?;
            let largest = (1 << bits) - 1;
            for (index, code) in codes.iter_mut().enumerate() {
                let place = (index % per_byte) as u8;
                // Single bits begin with the lowest one, others with the highest.
                let shift = if bits == 1 { place } else { 8 - bits - bits * place };
                let own = packed[index / per_byte] >> shift & largest;
                *code = if own == largest { take_byte(data)? } else { own };
            }
        }
    }
    Ok(())
}

/// Adds the differences, by the code of each byte, to an element.
fn add(element: &mut [u8], kinds: &[u8], code: impl Fn(usize) -> u8) {
    for (index, own) in element.as_chunks_mut::<4>().0.iter_mut().enumerate() {
        let codes: [u8; 4] = std::array::from_fn(|byte| code(4 * index + byte));
        let kind = kinds.get(index).copied().unwrap_or(0);
        match kind & 3 {
            0 => {
                for (byte, code) in own.iter_mut().zip(codes) {
                    *byte = byte.wrapping_add((code >> 1) ^ (code & 1).wrapping_neg());
                }
            }
            1 => {
                for (pair, code) in own.as_chunks_mut::<2>().0.iter_mut().zip(codes.as_chunks().0) {
                    let code = u16::from_le_bytes(*code);
                    let difference = (code >> 1) ^ (code & 1).wrapping_neg();
                    *pair = u16::from_le_bytes(*pair).wrapping_add(difference).to_le_bytes();
                }
            }
            _ => {
                let difference = u32::from_le_bytes(codes).rotate_right(u32::from(kind >> 4));
                *own = (u32::from_le_bytes(*own) ^ difference).to_le_bytes();
            }
        }
    }
}
