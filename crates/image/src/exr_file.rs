//! OpenEXR: 32-bit floats without loss, one part whose channel names carry the layers.

use super::exr_blocks;
use super::exr_format::{DisplayWindow, ExrFormat};
use super::exr_header::SortedHeader;
use super::exr_summary::{PREFIX, broken, decoded, metadata_of, open};
use super::exr_windows::ExrWindows;
use super::{Image, Layer, Primaries, Value, converted};
use bdpm_base::atomic::write_atomically;
use bdpm_base::error::{Error, Result};
use bdpm_base::memory::{GIB, available_memory};
use exr::image::AnyChannel;
use exr::meta::attribute::Chromaticities;
use exr::meta::header::{Header, ImageAttributes, LayerAttributes};
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{
    AttributeValue, FlatSamples, IntegerBounds, LineOrder, ReadChannels, ReadLayers, Text, Vec2,
};
use std::io::{BufReader, Seek};
use std::ops::Range;
use std::path::Path;

/// Maximum bytes of pixels per byte of a file: ZIP reaches about a thousand, lossy methods a few
/// thousand if all pixels are equal.
const MAX_RATIO: u128 = 100_000;

/// Bytes of memory per number of an image while it is read: as decoded, and as 32-bit float.
const COPIES: f64 = 8.0;

/// Chromaticities of Rec. 709 with its white point D65.
const REC_709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// Writes all layers and metadata to `path`. Equal images give equal files.
///
/// # Errors
/// If the file cannot be written; names it.
///
/// # Panics
/// If a channel does not have one value per pixel.
pub fn write_exr(path: &Path, image: &Image) -> Result<()> {
    write_exr_as(path, image, ExrFormat::default())
}

/// Writes as [`write_exr`] in this format.
///
/// # Errors
/// As [`write_exr`].
///
/// # Panics
/// As [`write_exr`].
pub fn write_exr_as(path: &Path, image: &Image, format: ExrFormat) -> Result<()> {
    write_exr_rows(path, image, &|_| Vec::new(), format)
}

/// Writes an image together with layers that are computed while it is written: `computed` returns
/// those of some rows, with the same channels for all rows. Blocks of rows are computed and
/// compressed on the threads of the current rayon pool.
///
/// # Errors
/// As [`write_exr`].
///
/// # Panics
/// As [`write_exr`].
pub fn write_exr_rows(
    path: &Path,
    image: &Image,
    computed: &(dyn Fn(Range<u32>) -> Vec<Layer> + Sync),
    format: ExrFormat,
) -> Result<()> {
    let size = (image.width as usize, image.height as usize);
    let format = format.for_pixels(size.0 * size.1);
    let layers = |rows: Range<u32>| {
        let complete = image.layers.iter().map(|layer| layer.rows(rows.clone(), image.width));
        complete.chain(computed(rows.clone())).collect::<Vec<_>>()
    };
    let channels = exr_blocks::channels(&layers(0..0), &format);
    let described = channels.iter().map(|own| own.description(text(&own.name))).collect();
    let software_name = Some(text(concat!("bdpm ", env!("CARGO_PKG_VERSION"))));
    let mut attributes = LayerAttributes { software_name, ..LayerAttributes::default() };
    for (name, value) in &image.metadata {
        let value = match value {
            Value::Text(value) => AttributeValue::Text(text(value)),
            Value::Number(value) => AttributeValue::F64(*value),
        };
        attributes.other.insert(text(&format!("{PREFIX}{name}")), value);
    }
    let whole = IntegerBounds::from_dimensions(size);
    let display = match format.window {
        None => whole,
        Some(DisplayWindow { origin: [x, y], size: [width, height] }) => {
            attributes.layer_position = Vec2(x as i32, y as i32);
            IntegerBounds::from_dimensions((width as usize, height as usize))
        }
    };
    let mut shared = ImageAttributes::new(display);
    shared.chromaticities = Some(REC_709);
    // Increasing lines: the bytes then do not depend on the threads that compress them.
    let header = Header::new(Text::from(""), size, described)
        .with_encoding(
            format.compression.method(),
            BlockDescription::ScanLines,
            LineOrder::Increasing,
        )
        .with_attributes(attributes)
        .with_shared_attributes(shared);
    write_atomically(path, |to| {
        let headers = [header.clone()].into_iter().collect();
        exr::block::write(SortedHeader::new(to), headers, true, |_, chunks| {
            exr_blocks::write(&header, (&channels, format), &layers, chunks)
        })
        .map_err(exr_blocks::io_error)
    })
}

/// Reads the first part of any EXR file, and those of its attributes that [`write_exr`] wrote. The
/// image is the data window: pixels that the file holds.
///
/// # Errors
/// If the file cannot be read, or is no EXR file with flat channels; names it.
pub fn read_exr(path: &Path) -> Result<Image> {
    read_windows(path).map(|(image, _)| image)
}

/// Reads as [`read_exr`], but the image is the display window, in the primaries of Rec. 709. Pixels
/// that the file does not hold are 0.
///
/// # Errors
/// As [`read_exr`], or if memory does not suffice for the display window.
pub fn read_exr_display(path: &Path) -> Result<Image> {
    let (image, windows) = read_windows(path)?;
    let primaries = windows.primaries;
    let mut image = windows.displayed(image).map_err(|error| error.at(path))?;
    if let Some(map) = primaries.and_then(Primaries::to_rec_709)
        && let Some(layer) = image.layers.iter_mut().find(|layer| layer.name.is_empty())
        && let Some(colors) = layer.to_rgb()
    {
        let colors: Vec<_> = colors.into_iter().map(|color| converted(map, color)).collect();
        let Layer { channels: own, .. } = Layer::rgb("", &colors);
        layer.channels.retain(|(name, _)| !matches!(&name[..], "R" | "G" | "B"));
        layer.channels.extend(own);
    }
    Ok(image)
}

/// Reads the data window, and how it lies in the display window.
fn read_windows(path: &Path) -> Result<(Image, ExrWindows)> {
    let (file, meta) = open(path)?;
    let length = file.metadata().and_then(|metadata| (&file).rewind().map(|()| metadata.len()));
    let length = length.map_err(|e| Error::io("read", path, e))?;
    check_size(&meta, length, available_memory()).map_err(|e| e.at(path))?;
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(BufReader::new(&file))
        .map_err(|error| broken(path, error))?;
    let part = image.layer_data;
    let attributes = part.attributes.other.iter().chain(&image.attributes.other);
    let metadata = metadata_of(attributes);
    let layers = layers_of(part.channel_data.list);
    // Files written elsewhere may be larger than any image of ours.
    let side = |pixels: usize| {
        u32::try_from(pixels).map_err(|_| {
            Error::new(format!("{pixels} pixels along a side"), "give a smaller image").at(path)
        })
    };
    let (width, height) = (side(part.size.0)?, side(part.size.1)?);
    let display = image.attributes.display_window;
    let (Vec2(x, y), Vec2(left, top)) = (part.attributes.layer_position, display.position);
    let primaries = image.attributes.chromaticities.map(|own| Primaries {
        xy: [own.red, own.green, own.blue, own.white].map(|Vec2(x, y)| [x, y].map(f64::from)),
    });
    let windows = ExrWindows {
        primaries,
        origin: [i64::from(x) - i64::from(left), i64::from(y) - i64::from(top)],
        size: [side(display.size.0)?, side(display.size.1)?],
    };
    Ok((Image { width, height, layers, metadata }, windows))
}

/// Layers of channels whose names begin with that of their layer.
fn layers_of(channels: impl IntoIterator<Item = AnyChannel<FlatSamples>>) -> Vec<Layer> {
    let mut layers: Vec<Layer> = Vec::new();
    for channel in channels {
        let values = match channel.sample_data {
            FlatSamples::F32(values) => values,
            FlatSamples::F16(values) => values.iter().map(|v| v.to_f32()).collect(),
            FlatSamples::U32(values) => values.iter().map(|&v| v as f32).collect(),
        };
        let full = decoded(&channel.name);
        let (layer, name) = full.rsplit_once('.').unwrap_or(("", &full));
        let channel = (name.to_owned(), values);
        match layers.iter_mut().find(|known| known.name == layer) {
            Some(known) => known.channels.push(channel),
            None => layers.push(Layer { name: layer.to_owned(), channels: vec![channel] }),
        }
    }
    layers
}

/// Refuses more pixels than `length` bytes of a file or the memory can hold, before they are read.
fn check_size(meta: &MetaData, length: u64, available: Option<f64>) -> Result<()> {
    for header in &meta.headers {
        let area = |size: Vec2<usize>| size.width() as u128 * size.height() as u128;
        let block = match header.blocks {
            BlockDescription::ScanLines => 0,
            BlockDescription::Tiles(tiles) => area(tiles.tile_size),
        };
        let Vec2(width, height) = header.layer_size;
        let pixels = area(header.layer_size).max(block);
        if pixels * header.channels.bytes_per_pixel as u128 > u128::from(length) * MAX_RATIO {
            let problem = format!(
                "the EXR image is cut off or damaged: the file is too small for {width}x{height} pixels"
            );
            return Err(Error::new(problem, "copy it again from where it came"));
        }
        let needed = COPIES * (pixels as f64) * header.channels.list.len() as f64;
        if let Some(available) = available.filter(|available| needed > *available) {
            let problem = format!(
                "{width}x{height} pixels take about {:.1} GiB of memory, but {:.1} GiB are available",
                needed / GIB,
                available / GIB
            );
            return Err(Error::new(problem, "give a smaller image"));
        }
    }
    Ok(())
}

/// UTF-8, the encoding that readers expect; a NUL would end the text, so none is let through.
fn text(value: &str) -> Text {
    Text::from_slice_unchecked(value.replace('\0', " ").as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Metadata;
    use bdpm_base::math::Rgb;
    use std::fs;

    fn image(width: u32, height: u32) -> Image {
        let values = |seed: u32| -> Vec<f32> {
            // Every exponent, both signs, subnormal numbers and infinities; no NaN, which is
            // equal to nothing.
            let bits = (0..width * height).map(|i| (i + seed).wrapping_mul(0x9e37_79b9));
            bits.map(f32::from_bits).map(|v| if v.is_nan() { -0.0 } else { v }).collect()
        };
        let pixels: Vec<Rgb> = values(1).iter().map(|&v| Rgb::new(v, 2.0, -v)).collect();
        let single =
            |name: &str| Layer { name: name.into(), channels: vec![("Y".into(), values(2))] };
        let (rms, light) = (single("rms"), single("light.lampe é 箱"));
        let metadata = Metadata::from([
            ("scene".into(), Value::Text("boîte 箱".into())),
            ("radius".into(), Value::Number(f64::from(0.1f32))),
            ("a name longer than the thirty-one bytes of old".into(), Value::Number(1e300)),
        ]);
        Image { width, height, layers: vec![Layer::rgb("", &pixels), light, rms], metadata }
    }

    #[test]
    fn a_round_trip_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        for (width, height) in [(1, 1), (5, 40), (67, 33)] {
            let path = folder.path().join("a.exr");
            let written = image(width, height);
            write_exr(&path, &written).unwrap();
            let read = read_exr(&path).unwrap();
            assert_eq!((read.width, read.height), (width, height));
            assert_eq!(read.metadata, written.metadata);
            let (a, b) = (read.layer("").unwrap(), written.layer("").unwrap());
            assert_eq!(a.to_rgb().unwrap(), b.to_rgb().unwrap());
            for name in ["rms", "light.lampe é 箱"] {
                assert_eq!(read.layer(name), written.layer(name));
            }
            let bits = |layer: &Layer| -> Vec<u32> {
                layer.channel("R").unwrap().iter().map(|v| v.to_bits()).collect()
            };
            assert_eq!(bits(a), bits(b), "signs of zeros too");
        }
    }

    #[test]
    fn images_that_memory_cannot_hold_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write_exr(&path, &image(64, 32)).unwrap();
        let meta = MetaData::read_from_file(&path, false).unwrap();
        let needed = 64.0 * 32.0 * 5.0 * COPIES;
        check_size(&meta, 5000, Some(needed)).unwrap();
        let shown = check_size(&meta, 5000, Some(needed - 1.0)).unwrap_err().to_string();
        assert!(shown.contains("64x32 pixels take about"), "{shown}");
        let shown = check_size(&meta, 0, None).unwrap_err().to_string();
        assert!(shown.contains("too small for 64x32 pixels"), "{shown}");
    }

    #[test]
    fn every_compression_is_lossless() {
        use crate::ExrCompression::{None, Piz, Rle, Zip, Zips};
        let folder = tempfile::tempdir().unwrap();
        let written = image(67, 33);
        for compression in [None, Rle, Zips, Zip, Piz] {
            let path = folder.path().join("a.exr");
            write_exr_as(&path, &written, ExrFormat { compression, ..Default::default() }).unwrap();
            let meta = MetaData::read_from_file(&path, false).unwrap();
            assert_eq!(meta.headers[0].compression, compression.method());
            assert_eq!(read_exr(&path).unwrap().layer("rms"), written.layer("rms"));
        }
    }

    #[test]
    fn large_image_is_lossless_and_its_files_are_equal_for_any_number_of_threads() {
        let folder = tempfile::tempdir().unwrap();
        let (width, height) = (1031, 1019);
        // Runs of equal values, smooth ones, and noise in the lower digits.
        let value = |i: u32| match i / width % 3 {
            0 => 1.0,
            1 => i as f32 * 1e-3,
            _ => 1.0 + (i.wrapping_mul(0x9e37_79b9) >> 9) as f32 * 1e-9,
        };
        let layer = |rows: Range<u32>| {
            let values = (rows.start * width..rows.end * width).map(value).collect();
            vec![Layer { name: String::new(), channels: vec![("Y".into(), values)] }]
        };
        let image = Image { width, height, layers: Vec::new(), metadata: Metadata::new() };
        let files = [1, 3].map(|threads| {
            let path = folder.path().join(format!("{threads}.exr"));
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let write = || write_exr_rows(&path, &image, &layer, ExrFormat::default());
            pool.install(write).unwrap();
            let read = read_exr(&path).unwrap();
            assert_eq!(read.layers, layer(0..height));
            fs::read(&path).unwrap()
        });
        assert!(files[0] == files[1]);
        let raw = 4 * (width * height) as usize;
        assert!(files[0].len() < raw * 3 / 4, "{} of {raw}", files[0].len());
    }

    #[test]
    fn half_precision_rounds_colors_only_and_keeps_them_finite() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let values = [0.1f32, -3.7, 1e30, 70_000.0, 65_504.0, 0.0];
        let pixels: Vec<Rgb> = values.iter().map(|&value| Rgb::splat(value)).collect();
        let rms = Layer { name: "rms".into(), channels: vec![("Y".into(), values.to_vec())] };
        let layers = vec![Layer::rgb("", &pixels), rms];
        let written = Image { width: 3, height: 2, layers, metadata: Metadata::new() };
        write_exr_as(&path, &written, ExrFormat { half: true, ..Default::default() }).unwrap();
        let read = read_exr(&path).unwrap();
        assert_eq!(read.layer("rms"), written.layer("rms"));
        let colors = read.layer("").unwrap().channel("R").unwrap();
        for (&read, value) in colors.iter().zip(values.map(|value| value.min(65_504.0))) {
            assert!((read - value).abs() <= value.abs() / 2048.0, "{read} is not {value}");
        }
    }

    #[test]
    fn window_is_placed_in_the_display_window() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let window = Some(DisplayWindow { origin: [7, 5], size: [20, 10] });
        let written = image(3, 2);
        write_exr_as(&path, &written, ExrFormat { window, ..Default::default() }).unwrap();
        let meta = MetaData::read_from_file(&path, false).unwrap();
        let header = &meta.headers[0];
        assert_eq!(header.own_attributes.layer_position, Vec2(7, 5));
        assert_eq!(header.shared_attributes.display_window.size, Vec2(20, 10));
        let read = read_exr(&path).unwrap();
        assert_eq!((read.width, read.height), (3, 2));
        assert_eq!(read.layer("rms"), written.layer("rms"));
    }

    #[test]
    fn equal_images_are_equal_files() {
        let folder = tempfile::tempdir().unwrap();
        let bytes = |name: &str| {
            let path = folder.path().join(name);
            let mut image = image(20, 40);
            for i in 0..30 {
                image.metadata.insert(format!("fact {i}"), Value::Number(f64::from(i)));
            }
            write_exr(&path, &image).unwrap();
            assert_eq!(read_exr(&path).unwrap().metadata, image.metadata);
            fs::read(&path).unwrap()
        };
        // By chance two orders of 30 are the same once in 10^32 times.
        assert_eq!(bytes("a.exr"), bytes("b.exr"));
    }

    #[test]
    fn the_file_says_what_its_colors_mean_and_who_wrote_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write_exr(&path, &image(3, 2)).unwrap();
        let meta = exr::meta::MetaData::read_from_file(&path, false).unwrap();
        let header = &meta.headers[0];
        assert_eq!(header.shared_attributes.chromaticities, Some(REC_709));
        let software = header.own_attributes.software_name.as_ref().unwrap().to_string();
        assert!(software.starts_with("bdpm "), "{software}");
    }

    #[test]
    fn broken_files_are_errors_that_name_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write_exr(&path, &image(20, 20)).unwrap();
        let whole = fs::read(&path).unwrap();
        for length in (0..whole.len()).step_by(37) {
            fs::write(&path, &whole[..length]).unwrap();
            let shown = read_exr(&path).unwrap_err().to_string();
            let problem = if length == 0 { "the file is empty" } else { "cut off or damaged" };
            assert!(shown.contains(problem) && shown.contains("\nhelp: "), "{length}: {shown}");
        }
        fs::write(&path, b"v/1 is no magic number").unwrap();
        let shown = read_exr(&path).unwrap_err().to_string();
        assert!(shown.contains("a.exr: this is no EXR image\nhelp: give an .exr file"), "{shown}");
        let missing = read_exr(&folder.path().join("none.exr")).unwrap_err().to_string();
        assert!(missing.contains("none.exr"), "{missing}");
    }
}
