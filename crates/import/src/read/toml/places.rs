//! Many transforms of a mesh: matrices in a NumPy file, an array of shape (n, 3, 4).
//!
//! The format: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>

use crate::text::{check_memory, read_bytes};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::memory::available_memory;
use bdpm_core::scene::transform::Transform;
use std::path::Path;

/// Peak memory of placing a mesh over the size of the file: numbers, transforms and placements.
const TIMES_IN_MEMORY: f64 = 20.0;

/// Numbers of a matrix for column vectors, without its last row, `[0, 0, 0, 1]`.
const NUMBERS: usize = 12;

/// Reads all transforms, as `numpy.save("places.npy", matrices)` writes them.
///
/// # Errors
/// If the file holds something else, or a matrix is not invertible: names the file and the matrix.
pub fn read(path: &Path) -> Result<Vec<Transform>> {
    let length = std::fs::metadata(path).map_or(0, |metadata| metadata.len());
    check_memory(length as f64 * TIMES_IN_MEMORY, available_memory()).map_err(|problem| {
        let problem = format!("reading the places takes {problem}");
        Error::new(problem, "leave out some places").at(path)
    })?;
    let bytes = read_bytes(path, u64::MAX)?;
    let wrong = |problem: &str| {
        let advice = "save an array of float32 or float64 of shape (n, 3, 4) by numpy.save";
        Error::new(problem, advice).at(path)
    };
    let (header, data) = split_header(&bytes).ok_or_else(|| wrong("this is not a NumPy file"))?;
    let has = |text: &str| header.contains(text);
    if !has("'fortran_order': False") || !has(", 3, 4)") {
        return Err(wrong("the array's shape is not (n, 3, 4), row by row"));
    }
    let numbers: Vec<f64> = if has("'descr': '<f4'") {
        let number = |four: &[u8; 4]| f64::from(f32::from_le_bytes(*four));
        data.as_chunks().0.iter().map(number).collect()
    } else if has("'descr': '<f8'") {
        data.as_chunks().0.iter().map(|eight| f64::from_le_bytes(*eight)).collect()
    } else {
        return Err(wrong("the array's numbers are neither float32 nor float64"));
    };
    let (matrices, rest) = numbers.as_chunks::<NUMBERS>();
    if !rest.is_empty() || !has(&format!("'shape': ({}, 3, 4)", matrices.len())) {
        return Err(wrong("the file is cut short"));
    }
    let transform = |(index, rows): (usize, &[f64; NUMBERS])| {
        let row = |k: usize| [rows[4 * k], rows[4 * k + 1], rows[4 * k + 2], rows[4 * k + 3]];
        Transform::from_rows([row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]).map_err(|error| {
            let problem = format!("matrix {index}: {}", error.problem());
            Error::new(problem, "remove or correct the matrix").at(path)
        })
    };
    matrices.iter().enumerate().map(transform).collect()
}

/// Header and data of a NumPy file.
fn split_header(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let rest = bytes.strip_prefix(b"\x93NUMPY")?;
    let ([version, _], rest) = rest.split_first_chunk()?;
    let (length, rest) = if *version == 1 {
        let (length, rest) = rest.split_first_chunk()?;
        (usize::from(u16::from_le_bytes(*length)), rest)
    } else {
        let (length, rest) = rest.split_first_chunk()?;
        (u32::from_le_bytes(*length) as usize, rest)
    };
    let (header, data) = rest.split_at_checked(length)?;
    Some((std::str::from_utf8(header).ok()?, data))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The output of `numpy.save`.
    fn npy(kind: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        [&bytes[..], header.as_bytes(), data].concat()
    }

    fn read_array(bytes: &[u8]) -> Result<Vec<Transform>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("places.npy");
        std::fs::write(&path, bytes).unwrap();
        read(&path)
    }

    #[test]
    fn matrices_of_both_precisions_are_read() {
        let rows: Vec<f64> = (0..24).map(|i| f64::from(u8::from(i % 12 % 5 == 0)) + 0.25).collect();
        let single: Vec<u8> = rows.iter().flat_map(|x| (*x as f32).to_le_bytes()).collect();
        let double: Vec<u8> = rows.iter().flat_map(|x| x.to_le_bytes()).collect();
        for bytes in [npy("<f4", "(2, 3, 4)", &single), npy("<f8", "(2, 3, 4)", &double)] {
            let matrices = read_array(&bytes).unwrap();
            assert_eq!(matrices.len(), 2);
            assert_eq!(matrices[0].rows()[0], [1.25, 0.25, 0.25, 0.25]);
            assert_eq!(matrices[0].rows()[3], [0.0, 0.0, 0.0, 1.0]);
        }
    }

    #[test]
    fn other_files_are_refused_with_their_name() {
        let flat = [0; 48];
        for (bytes, word) in [
            (b"PK".to_vec(), "not a NumPy file"),
            (npy("<f4", "(1, 4, 4)", &flat), "shape"),
            (npy("<i4", "(1, 3, 4)", &flat), "neither float32"),
            (npy("<f4", "(2, 3, 4)", &flat), "cut short"),
            (npy("<f4", "(1, 3, 4)", &flat), "matrix 0: the transform flattens"),
        ] {
            let error = read_array(&bytes).unwrap_err().to_string();
            assert!(error.contains(word) && error.contains("places.npy"), "{word}: {error}");
        }
    }
}
