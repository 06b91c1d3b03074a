//! Streams of the encoder `meshoptimizer` 1.3.0, and what its decoder makes of them.

use super::super::json::json_records;
use super::*;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use serde::Deserialize;

json_records! {
    /// A stream and its content, in base64.
    struct Case {
        name: String,
        count: u64,
        byte_stride: u64,
        mode: String,
        filter: Option<String>,
        stream: String,
        content: String,
    }
}

fn cases() -> Vec<(Case, Vec<u8>, Vec<u8>)> {
    let cases: Vec<Case> = serde_json::from_str(include_str!("streams.json")).unwrap();
    let bytes = |text: &String| BASE64_STANDARD.decode(text).unwrap();
    cases
        .into_iter()
        .map(|case| {
            let (stream, content) = (bytes(&case.stream), bytes(&case.content));
            (case, stream, content)
        })
        .collect()
}

fn decode(case: &Case, stream: &[u8]) -> std::result::Result<Vec<u8>, Problem> {
    let Case { count, byte_stride, mode, filter, .. } = case.clone();
    let byte_length = count * byte_stride;
    let view = serde_json::json!({ "buffer": 0, "byteLength": byte_length });
    let view: BufferView = serde_json::from_value(view).unwrap();
    let length = stream.len() as u64;
    let own = MeshoptView {
        buffer: 0,
        byte_offset: 0,
        byte_length: length,
        byte_stride,
        count,
        mode,
        filter,
    };
    content(&own, &view, stream)
}

#[test]
fn streams_decode_as_by_their_own_decoder() {
    for (case, stream, expected) in cases() {
        let name = &case.name;
        let content = decode(&case, &stream).unwrap_or_else(|problem| panic!("{name}: {problem}"));
        if case.filter.as_deref().is_none_or(|filter| matches!(filter, "NONE" | "EXPONENTIAL")) {
            assert!(content == expected, "{name}");
            continue;
        }
        // Other filters may round the last digit differently.
        let numbers = |bytes: &[u8]| -> Vec<i32> {
            match case.byte_stride {
                4 => bytes.iter().map(|byte| (*byte).into()).collect(),
                _ => {
                    let words = bytes.as_chunks::<2>().0.iter();
                    words.map(|word| i16::from_le_bytes(*word).into()).collect()
                }
            }
        };
        let off = numbers(&content)
            .into_iter()
            .zip(numbers(&expected))
            .map(|(own, other)| (own - other).abs())
            .max();
        assert!(off.is_some_and(|off| off <= 1), "{name}: {off:?}");
    }
}

#[test]
fn damaged_streams_are_refused_or_decode_to_the_same_size() {
    for (case, stream, expected) in cases() {
        for length in 0..stream.len() {
            assert!(decode(&case, &stream[..length]).is_err(), "{}: {length} bytes", case.name);
        }
        let longer = [&stream[..], &[0]].concat();
        assert!(decode(&case, &longer).is_err(), "{}", case.name);
        for place in 0..stream.len() {
            for change in [1, 0x80, 0xff] {
                let mut damaged = stream.clone();
                damaged[place] ^= change;
                if let Ok(content) = decode(&case, &damaged) {
                    assert_eq!(content.len(), expected.len(), "{}", case.name);
                }
            }
        }
    }
}

#[test]
fn impossible_layouts_are_refused() {
    let (case, stream, _) = cases().swap_remove(0);
    for (count, byte_stride, mode, filter) in [
        (u64::MAX, 16, "ATTRIBUTES", "NONE"),
        (1 << 40, 16, "ATTRIBUTES", "NONE"),
        (300, 18, "ATTRIBUTES", "NONE"),
        (300, 0, "ATTRIBUTES", "NONE"),
        (300, 16, "ATTRIBUTES", "QUATERNION"),
        (300, 16, "ATTRIBUTES", "SHARP"),
        (300, 16, "POINTS", "NONE"),
        (300, 16, "TRIANGLES", "NONE"),
        (301, 4, "TRIANGLES", "NONE"),
        (1 << 40, 4, "INDICES", "NONE"),
        (300, 4, "INDICES", "COLOR"),
    ] {
        let case = Case {
            count: count.min(u64::MAX / 256),
            byte_stride,
            mode: mode.into(),
            filter: Some(filter.into()),
            ..case.clone()
        };
        assert!(decode(&case, &stream).is_err(), "{count} {byte_stride} {mode} {filter}");
    }
}
