//! An 8-bit canvas for numbers and captions.

use super::write_png_bytes;
use bdpm_base::error::Result;
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
use std::path::Path;

const WEIGHT: FontWeight = FontWeight::Regular;
const HEIGHT: RasterHeight = RasterHeight::Size16;

/// Pixels with the origin at the top left; drawing is clipped to them.
#[derive(Clone, Debug)]
pub struct Canvas {
    width: u32,
    height: u32,
    bytes: Vec<u8>,
}

impl Canvas {
    /// Height of a line of text, pixels.
    pub const LINE: u32 = 20;
    /// Width of a character, pixels.
    pub const CHARACTER: u32 = get_raster_width(WEIGHT, HEIGHT) as u32;

    /// A canvas of one color.
    pub fn new(width: u32, height: u32, color: [u8; 3]) -> Self {
        Self { width, height, bytes: color.repeat(width as usize * height as usize) }
    }

    /// Sets a pixel.
    #[inline]
    pub fn set(&mut self, x: u32, y: u32, color: [u8; 3]) {
        if x < self.width && y < self.height {
            let index = 3 * (y as usize * self.width as usize + x as usize);
            self.bytes[index..index + 3].copy_from_slice(&color);
        }
    }

    /// Fills a rectangle.
    pub fn fill(&mut self, (x, y): (u32, u32), (width, height): (u32, u32), color: [u8; 3]) {
        for row in y..(y + height).min(self.height) {
            for column in x..(x + width).min(self.width) {
                self.set(column, row, color);
            }
        }
    }

    /// Writes black text whose first line begins at the top left corner `(x, y)`; characters that
    /// the font does not have become question marks.
    pub fn text(&mut self, (x, y): (u32, u32), text: &str) {
        for (index, character) in text.chars().enumerate() {
            let raster = |c| get_raster(c, WEIGHT, HEIGHT);
            let Some(glyph) = raster(character).or_else(|| raster('?')) else { continue };
            let left = x + index as u32 * Self::CHARACTER;
            for (row, line) in (y..).zip(glyph.rows()) {
                for (column, &ink) in (left..).zip(line) {
                    if ink > 0 {
                        self.set(column, row, [255 - ink; 3]);
                    }
                }
            }
        }
    }

    /// Writes the canvas as PNG.
    ///
    /// # Errors
    /// If the file cannot be written; names it.
    pub fn write_png(&self, path: &Path) -> Result<()> {
        write_png_bytes(path, self.width, self.height, &self.bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_outside_is_not_drawn() {
        let mut canvas = Canvas::new(20, 10, [255; 3]);
        canvas.fill((15, 5), (100, 100), [1, 2, 3]);
        canvas.text((5, 2), "m² \u{1f600} sr");
        assert_eq!(canvas.bytes.len(), 600);
        assert_eq!(canvas.bytes[597..], [1, 2, 3]);
        assert!(canvas.bytes.contains(&0), "some ink");
    }
}
