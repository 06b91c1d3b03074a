//! Data and display windows of an EXR file: pixels that it holds, and their place in the image.

use super::{Image, Layer, Primaries};
use bdpm_base::error::{Error, Result};
use bdpm_base::memory::{GIB, available_memory};

/// How the pixels of a file lie in the image to show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ExrWindows {
    /// Primaries of the colors, if the file names them.
    pub primaries: Option<Primaries>,
    /// Column and row of the data window's first pixel in the display window.
    pub origin: [i64; 2],
    /// Width and height of the display window, pixels.
    pub size: [u32; 2],
}

/// Number of pixels that a display window may have, whatever the data window is.
const PIXELS: f64 = (1_u32 << 24) as f64;

/// Number of pixels of a larger display window per pixel of the data window: a small file must not
/// take much memory.
const PIXELS_PER_DATUM: f64 = 256.0;

impl ExrWindows {
    /// The display window of an image that is the data window. Pixels without data are 0.
    pub fn displayed(self, image: Image) -> Result<Image> {
        let Self { origin: [left, top], size: [width, height], .. } = self;
        if [left, top] == [0, 0] && [width, height] == [image.width, image.height] {
            return Ok(image);
        }
        let channels: usize = image.layers.iter().map(|layer| layer.channels.len()).sum();
        let pixels = f64::from(width) * f64::from(height);
        let data = f64::from(image.width) * f64::from(image.height);
        if pixels > PIXELS.max(PIXELS_PER_DATUM * data) {
            let (own_width, own_height) = (image.width, image.height);
            let problem = format!(
                "the display window of {width}x{height} pixels is far larger than the data window \
                 of {own_width}x{own_height}"
            );
            return Err(Error::new(problem, "crop the image to its data window"));
        }
        let needed = pixels * channels as f64 * size_of::<f32>() as f64;
        if let Some(available) = available_memory().filter(|available| needed > *available) {
            let problem = format!(
                "the display window of {width}x{height} pixels takes {:.1} GiB of memory, but \
                 {:.1} GiB are available",
                needed / GIB,
                available / GIB
            );
            return Err(Error::new(problem, "crop the image"));
        }
        // Columns and rows of the data window that the display window shows.
        let shown = |origin: i64, data: u32, display: u32| {
            let first = (-origin).clamp(0, i64::from(data));
            let end = (i64::from(display) - origin).clamp(first, i64::from(data));
            first as usize..end as usize
        };
        let (columns, rows) = (shown(left, image.width, width), shown(top, image.height, height));
        let (own, display) = (image.width as usize, width as usize);
        let place = |values: &Vec<f32>| {
            let mut all = vec![0.0; display * height as usize];
            if columns.is_empty() {
                return all; // the windows do not meet
            }
            for row in rows.clone() {
                let from = &values[row * own..][columns.clone()];
                // The display window holds both, by the definition of the ranges.
                let column = (columns.start as i64 + left) as usize;
                let start = (row as i64 + top) as usize * display + column;
                all[start..start + from.len()].copy_from_slice(from);
            }
            all
        };
        let layer = |Layer { name, channels }: &Layer| Layer {
            name: name.clone(),
            channels: channels.iter().map(|(name, values)| (name.clone(), place(values))).collect(),
        };
        Ok(Image { width, height, layers: image.layers.iter().map(layer).collect(), ..image })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Metadata;

    #[test]
    fn pixels_keep_their_place_in_the_display_window() {
        let values: Vec<f32> = (1_u8..=6).map(f32::from).collect();
        let layers = vec![Layer { name: String::new(), channels: vec![("Y".into(), values)] }];
        let data = Image { width: 3, height: 2, layers, metadata: Metadata::new() };
        for (origin, size, expected) in [
            ([0, 0], [3, 2], "123456"),
            ([1, 1], [5, 3], "000000123004560"),
            ([-1, 0], [3, 2], "230560"),
            ([-1, -1], [1, 1], "5"),
            ([2, -1], [3, 3], "004000000"),
            ([9, 0], [2, 1], "00"),
            ([-9, -9], [2, 1], "00"),
            ([i64::from(i32::MIN), i64::from(i32::MAX)], [1, 1], "0"),
        ] {
            let shown =
                ExrWindows { primaries: None, origin, size }.displayed(data.clone()).unwrap();
            assert_eq!([shown.width, shown.height], size);
            let text: String =
                shown.layers[0].channels[0].1.iter().map(|value| value.to_string()).collect();
            assert_eq!(text, expected, "{origin:?} {size:?}");
        }
    }

    #[test]
    fn display_windows_far_larger_than_their_data_are_refused() {
        let channel = |name: &str| (name.to_owned(), vec![1.0]);
        let channels = vec![channel("R"), channel("G"), channel("B")];
        let layers = vec![Layer { name: String::new(), channels }];
        let data = Image { width: 1, height: 1, layers, metadata: Metadata::new() };
        for size in [[1 << 31; 2], [4097, 4096]] {
            let windows = ExrWindows { primaries: None, origin: [0, 0], size };
            let shown = windows.displayed(data.clone()).unwrap_err().to_string();
            let [width, height] = size;
            assert!(shown.contains(&format!("the display window of {width}x{height}")), "{shown}");
        }
        let windows = ExrWindows { primaries: None, origin: [0, 0], size: [4096; 2] };
        assert_eq!(windows.displayed(data).unwrap().width, 4096);
    }
}
