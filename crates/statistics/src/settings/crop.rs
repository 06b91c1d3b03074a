//! A window of an image that is rendered alone.

use bdpm_base::error::{Error, Result};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use std::fmt;

/// Position of a rendered window in its full image. [`Settings`](super::Settings) has the size of
/// the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    /// Column and row of the window's top left pixel.
    pub origin: [u32; 2],
    /// Width and height of the full image, pixels.
    pub full: [u32; 2],
}

/// Text of the setting without a window.
const NONE: &str = "none";

impl Crop {
    /// Resolves the window `[x, y, width, height]` of an image. Returns the crop, `None` for the
    /// whole image, and the size of the rendered image.
    ///
    /// # Errors
    /// If the window is empty or not within the image.
    pub(super) fn resolve(
        window: Option<[u32; 4]>,
        full: [u32; 2],
    ) -> Result<(Option<Self>, [u32; 2])> {
        let Some([x, y, width, height]) = window else { return Ok((None, full)) };
        let crop = Self { origin: [x, y], full };
        crop.check([width, height])?;
        let is_whole = [width, height] == full;
        Ok(((!is_whole).then_some(crop), [width, height]))
    }

    /// Reads the text that a crop is displayed as.
    pub fn from_text(text: &str) -> Option<Self> {
        let (origin, full) = text.strip_prefix("at ")?.split_once(" of ")?;
        let pair = |text: &str, separator| {
            let (a, b) = text.split_once(separator)?;
            Some([a.parse().ok()?, b.parse().ok()?])
        };
        Some(Self { origin: pair(origin, ',')?, full: pair(full, 'x')? })
    }

    /// Refuses a window of this size that is empty or not within the image.
    pub(super) fn check(&self, size: [u32; 2]) -> Result<()> {
        let ends = |axis: usize| u64::from(self.origin[axis]) + u64::from(size[axis]);
        if size.iter().all(|&side| side > 0) && (0..2).all(|i| ends(i) <= self.full[i].into()) {
            return Ok(());
        }
        let ([x, y], [width, height], [w, h]) = (self.origin, size, self.full);
        Err(Error::new(
            format!("the crop {x},{y},{width},{height} is empty or not within {w}x{h} pixels"),
            "give the left column, the top row, and a width and height above 0 as a crop within the resolution",
        ))
    }
}

impl fmt::Display for Crop {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let ([x, y], [width, height]) = (self.origin, self.full);
        write!(f, "at {x},{y} of {width}x{height}")
    }
}

/// Writes a crop as a text, which metadata of image files can hold.
pub(super) fn serialize<S: Serializer>(
    crop: &Option<Crop>,
    to: S,
) -> std::result::Result<S::Ok, S::Error> {
    crop.map_or_else(|| NONE.to_owned(), |crop| crop.to_string()).serialize(to)
}

/// Reads the text that [`serialize`] wrote.
pub(super) fn deserialize<'de, D: Deserializer<'de>>(
    from: D,
) -> std::result::Result<Option<Crop>, D::Error> {
    let text = String::deserialize(from)?;
    if text == NONE {
        return Ok(None);
    }
    let crop = Crop::from_text(&text);
    crop.map(Some).ok_or_else(|| de::Error::custom(format!("`{text}` is no crop")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_within_the_image_are_accepted() {
        let full = [20, 10];
        assert_eq!(Crop::resolve(None, full).unwrap(), (None, full));
        assert_eq!(Crop::resolve(Some([0, 0, 20, 10]), full).unwrap(), (None, full));
        let (crop, size) = Crop::resolve(Some([15, 2, 5, 8]), full).unwrap();
        assert_eq!((crop, size), (Some(Crop { origin: [15, 2], full }), [5, 8]));
        for bad in [[0, 0, 0, 5], [0, 0, 5, 0], [16, 2, 5, 8], [15, 3, 5, 8], [u32::MAX, 0, 5, 5]] {
            let shown = Crop::resolve(Some(bad), full).unwrap_err().to_string();
            assert!(shown.contains("not within 20x10 pixels"), "{shown}");
        }
    }

    #[test]
    fn text_of_a_crop_is_read_again() {
        let crop = Crop { origin: [3, 4], full: [20, 10] };
        assert_eq!(Crop::from_text(&crop.to_string()), Some(crop));
        for bad in ["", "at 3,4", "at 3,4 of 20", "at 3 of 20x10", "at -3,4 of 20x10"] {
            assert_eq!(Crop::from_text(bad), None, "{bad}");
        }
    }
}
