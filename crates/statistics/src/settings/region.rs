//! Named regions of the image.

use crate::settings::Settings;
use bdpm_base::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// A named part of the image: the union of rectangles `[x0, x1) x [y0, y1)` in fractions of the
/// image's width and height, origin top left, so that it survives another resolution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Region {
    /// Name on the command line.
    pub name: String,
    /// `[x0, y0, x1, y1]` each.
    pub rectangles: Vec<[f64; 4]>,
}

impl Region {
    /// Returns true if the center of pixel `(x, y)` lies in the region.
    #[inline]
    pub fn contains(&self, x: u32, y: u32, width: u32, height: u32) -> bool {
        let u = (f64::from(x) + 0.5) / f64::from(width);
        let v = (f64::from(y) + 0.5) / f64::from(height);
        self.rectangles.iter().any(|&[x0, y0, x1, y1]| x0 <= u && u < x1 && y0 <= v && v < y1)
    }

    /// The region in fractions of the window that is rendered with these settings; `None` if no
    /// part of it is there.
    pub fn within(&self, settings: &Settings) -> Option<Self> {
        let Some(crop) = settings.crop else { return Some(self.clone()) };
        let along = |fraction: f64, axis: usize, side: u32| {
            let pixels = fraction * f64::from(crop.full[axis]) - f64::from(crop.origin[axis]);
            (pixels / f64::from(side)).clamp(0.0, 1.0)
        };
        let (x, y) = (|x| along(x, 0, settings.width), |y| along(y, 1, settings.height));
        let moved = self.rectangles.iter().map(|&[x0, y0, x1, y1]| [x(x0), y(y0), x(x1), y(y1)]);
        let rectangles: Vec<_> = moved.filter(|[x0, y0, x1, y1]| x0 < x1 && y0 < y1).collect();
        (!rectangles.is_empty()).then(|| Self { name: self.name.clone(), rectangles })
    }
}

/// Refuses invalid rectangles of a region.
///
/// # Errors
/// If there is no rectangle, or one is empty or not within the image.
pub fn check_rectangles(rectangles: &[[f64; 4]]) -> Result<()> {
    let advice = "give [[x0, y0, x1, y1], ...] in fractions of the image with x0 < x1 and \
                  y0 < y1, the origin at the top left";
    if rectangles.is_empty() {
        return Err(Error::new("the region has no rectangle", advice));
    }
    for [x0, y0, x1, y1] in rectangles {
        // Written so that NaN fails.
        if !(0.0 <= *x0 && x0 < x1 && *x1 <= 1.0 && 0.0 <= *y0 && y0 < y1 && *y1 <= 1.0) {
            let problem = format!("the rectangle [{x0}, {y0}, {x1}, {y1}] is not in the image");
            return Err(Error::new(problem, advice));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::PartialSettings;

    #[test]
    fn region_moves_into_the_window() {
        let requested = PartialSettings {
            resolution: Some([40, 20]),
            crop: Some([20, 5, 10, 10]),
            ..Default::default()
        };
        let settings = Settings::resolve(&requested, &Default::default(), 1.0).unwrap();
        let region = |rectangles| Region { name: "a".into(), rectangles };
        let left = region(vec![[0.0, 0.0, 0.5, 1.0]]);
        assert_eq!(left.within(&settings), None);
        let both = region(vec![[0.0, 0.0, 0.5, 1.0], [0.625, 0.0, 1.0, 0.5]]);
        assert_eq!(both.within(&settings), Some(region(vec![[0.5, 0.0, 1.0, 0.5]])));
        let whole = Settings { crop: None, ..settings };
        assert_eq!(both.within(&whole), Some(both));
    }
}
