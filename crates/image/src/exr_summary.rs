//! Header of an EXR file: what it holds, without its pixels.

use super::{Metadata, Value};
use bdpm_base::error::{Error, Result};
use bdpm_base::input;
use exr::meta::MetaData;
use exr::meta::attribute::SampleType;
use exr::prelude::{AttributeValue, Text, Vec2};
use serde::Serialize;
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;

/// Prefix of the name of every custom attribute.
pub(super) const PREFIX: &str = "bdpm.";

/// First bytes of every EXR file.
const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// Content of an EXR file, by its header. If there are several parts, it describes the first, which
/// [`read_exr`] reads.
///
/// [`read_exr`]: super::read_exr
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExrSummary {
    /// Width and height of the data window: pixels that the file holds.
    pub size: [usize; 2],
    /// Column and row of the data window's first pixel in the display window.
    pub origin: [i64; 2],
    /// Width and height of the display window: the whole image.
    pub display: [usize; 2],
    /// Channels with their full names, such as `R` or `rms.Y`, in the order of the file.
    pub channels: Vec<ExrChannel>,
    /// Compression, such as `zip block`.
    pub compression: String,
    /// Number of parts.
    pub parts: usize,
    /// True if pixels have several samples at different depths. Such files cannot be read.
    pub deep: bool,
    /// Program that wrote the file, if it says so.
    pub software: Option<String>,
    /// Facts that this program wrote.
    #[serde(skip)]
    pub metadata: Metadata,
}

/// A channel of an EXR file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ExrChannel {
    /// Full name.
    pub name: String,
    /// `half` (16-bit float), `float` (32-bit float) or `uint` (32-bit integer).
    #[serde(rename = "type")]
    pub sample_type: &'static str,
}

impl ExrSummary {
    /// True if this program wrote the file.
    pub fn is_ours(&self) -> bool {
        self.metadata.contains_key("version")
    }

    /// Layers in the order of the file, each with the names of its channels. The image itself has
    /// the empty name.
    pub fn layers(&self) -> Vec<(&str, Vec<&str>)> {
        let mut layers: Vec<(&str, Vec<&str>)> = Vec::new();
        for ExrChannel { name, .. } in &self.channels {
            let (layer, channel) = name.rsplit_once('.').unwrap_or(("", name));
            match layers.iter_mut().find(|(known, _)| *known == layer) {
                Some((_, channels)) => channels.push(channel),
                None => layers.push((layer, vec![channel])),
            }
        }
        layers
    }
}

/// Reads the header of any EXR file.
///
/// # Errors
/// If the file cannot be read, or is no EXR file; names it.
pub fn read_exr_summary(path: &Path) -> Result<ExrSummary> {
    let (_, meta) = open(path)?;
    let Some(header) = meta.headers.first() else {
        let advice = "copy it again from where it came, or write it again";
        return Err(Error::new("the EXR image has no part", advice).at(path));
    };
    let (own, shared) = (&header.own_attributes, &header.shared_attributes);
    let (Vec2(x, y), Vec2(left, top)) = (own.layer_position, shared.display_window.position);
    let Vec2(display_width, display_height) = shared.display_window.size;
    let channels = header.channels.list.iter().map(|channel| ExrChannel {
        name: decoded(&channel.name),
        sample_type: match channel.sample_type {
            SampleType::F16 => "half",
            SampleType::F32 => "float",
            SampleType::U32 => "uint",
        },
    });
    Ok(ExrSummary {
        size: [header.layer_size.0, header.layer_size.1],
        origin: [i64::from(x) - i64::from(left), i64::from(y) - i64::from(top)],
        display: [display_width, display_height],
        channels: channels.collect(),
        compression: header.compression.to_string().trim_end_matches(" compression").into(),
        parts: meta.headers.len(),
        deep: header.deep,
        software: own.software_name.as_ref().map(decoded),
        metadata: metadata_of(own.other.iter().chain(&shared.other)),
    })
}

/// Opens an EXR file and reads its headers.
pub(super) fn open(path: &Path) -> Result<(File, MetaData)> {
    let file = input::open(path)?;
    check_magic(&file).map_err(|e| Error::io("read", path, e))?.map_err(|e| e.at(path))?;
    let meta = MetaData::read_from_unbuffered(&file, false).map_err(|e| broken(path, e))?;
    Ok((file, meta))
}

/// The error of a file that the crate `exr` refuses.
pub(super) fn broken(path: &Path, error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::Io(e) => Error::io("read", path, e),
        exr::error::Error::NotSupported(what) => Error::new(
            format!("this kind of EXR image cannot be read: {what}"),
            "save it again, with flat channels",
        )
        .at(path),
        e => Error::new(
            format!("the EXR image is cut off or damaged: {e}"),
            "copy it again from where it came, or write it again",
        )
        .at(path),
    }
}

/// A text in UTF-8, as the format wants it.
pub(super) fn decoded(text: &Text) -> String {
    String::from_utf8_lossy(text.as_slice()).into_owned()
}

/// Texts and numbers of this program.
pub(super) fn metadata_of<'a>(
    attributes: impl Iterator<Item = (&'a Text, &'a AttributeValue)>,
) -> Metadata {
    let mut metadata = Metadata::new();
    for (name, value) in attributes {
        let value = match value {
            AttributeValue::Text(value) => Value::Text(decoded(value)),
            AttributeValue::F64(value) => Value::Number(*value),
            _ => continue,
        };
        if let Some(name) = decoded(name).strip_prefix(PREFIX) {
            metadata.insert(name.to_owned(), value);
        }
    }
    metadata
}

/// Refuses files that are no EXR files; rewinds the others.
fn check_magic(mut file: &File) -> std::io::Result<Result<()>> {
    let mut begin = Vec::new();
    file.take(MAGIC.len() as u64).read_to_end(&mut begin)?;
    file.rewind()?;
    let problem = match &begin[..] {
        [] => "the file is empty",
        begin if MAGIC.starts_with(begin) => return Ok(Ok(())),
        _ => "this is no EXR image",
    };
    Ok(Err(Error::new(problem, "give an .exr file")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DisplayWindow, ExrFormat, Image, Layer, write_exr_as};
    use bdpm_base::math::Rgb;

    #[test]
    fn header_has_windows_layers_and_facts() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let noise = Layer { name: "rms".into(), channels: vec![("Y".into(), vec![1.0; 6])] };
        let layers = vec![Layer::rgb("", &[Rgb::ONE; 6]), noise];
        let metadata = Metadata::from([("radius".into(), Value::Number(0.5))]);
        let mut image = Image { width: 3, height: 2, layers, metadata };
        let window = Some(DisplayWindow { origin: [7, 5], size: [20, 10] });
        let format = ExrFormat { window, half: true, ..ExrFormat::default() };
        write_exr_as(&path, &image, format).unwrap();
        let found = read_exr_summary(&path).unwrap();
        assert_eq!((found.size, found.origin, found.display), ([3, 2], [7, 5], [20, 10]));
        assert_eq!(found.metadata, image.metadata);
        assert!(!found.is_ours() && !found.deep && found.parts == 1);
        assert!(found.software.as_ref().unwrap().starts_with("bdpm "), "{found:?}");
        assert_eq!(found.layers(), [("", vec!["B", "G", "R"]), ("rms", vec!["Y"])]);
        let types = found.channels.iter().map(|channel| channel.sample_type);
        assert_eq!(types.collect::<Vec<_>>(), ["half", "half", "half", "float"]);
        assert_eq!(found.compression, "zip block");
        image.metadata.insert("version".into(), Value::Text("1".into()));
        write_exr_as(&path, &image, format).unwrap();
        assert!(read_exr_summary(&path).unwrap().is_ours());
        std::fs::write(&path, "text").unwrap();
        let shown = read_exr_summary(&path).unwrap_err().to_string();
        assert!(shown.contains("a.exr: this is no EXR image"), "{shown}");
    }
}
