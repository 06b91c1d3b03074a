//! Scenes far from the origin: they are read again relative to a point near their center, in double
//! precision.
//!
//! Single precision rounds positions to 6e-8 of their distance from the origin. A lamp 2 m above a
//! desk, 1000 km from the origin, is off by up to 6 cm, and rays start 4 m off surfaces.

use super::warnings::Warning;
use glam::DVec3;

/// Distance of the center of a box from the origin, over its size, from which on it is far. At this
/// distance a ray starts 6e-5 of the size off a surface.
const FAR: f64 = 16.0;

/// Distance from which on the file of a part of a scene is far: parts may be small beside the
/// scene. At this distance positions in single precision have steps of 2e-4 of its size.
const FAR_PART: f64 = 4096.0;

/// A box in double precision.
#[derive(Clone, Copy, Debug)]
pub struct DBounds {
    low: DVec3,
    high: DVec3,
}

impl Default for DBounds {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl DBounds {
    pub const EMPTY: Self = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    /// The box around this one and a point.
    #[must_use]
    pub fn with(self, point: DVec3) -> Self {
        Self { low: self.low.min(point), high: self.high.max(point) }
    }

    /// The eight corners; arbitrary points if the box is empty.
    pub fn corners(self) -> impl Iterator<Item = DVec3> {
        let sides = [self.low, self.high];
        (0..8).map(move |corner| {
            DVec3::from_array([0, 1, 2].map(|axis| sides[corner >> axis & 1][axis]))
        })
    }

    /// A point near the center if the box is far from the origin, else `None`. Its coordinates are
    /// multiples of a power of two that is at least the size of the box, so that positions relative
    /// to it keep all digits of those in the file.
    pub fn far_center(self) -> Option<DVec3> {
        self.center_beyond(FAR)
    }

    /// A point near the center as [`Self::far_center`], for the file of a part of a scene.
    pub fn far_center_of_part(self) -> Option<DVec3> {
        self.center_beyond(FAR_PART)
    }

    fn center_beyond(self, far: f64) -> Option<DVec3> {
        let center = 0.5 * (self.low + self.high);
        let away = center.abs().max_element();
        let size = (self.high - self.low).max_element();
        if !(size >= 0.0 && away.is_finite() && away > far * size) {
            return None;
        }
        let step = size.max(1e-9 * away).log2().ceil().exp2();
        let rounded = (center / step).round() * step;
        (rounded.is_finite() && rounded != DVec3::ZERO).then_some(rounded)
    }
}

/// A note that a scene was moved.
pub fn note(origin: DVec3) -> Warning {
    let [x, y, z] = origin.to_array();
    Warning::chosen(format!(
        "the scene is far from the origin: positions are kept relative to ({x}, {y}, {z}); files \
         and options use the coordinates of the scene file"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_far_boxes_have_a_center_and_it_is_round() {
        let bounds = |low: [f64; 3], high: [f64; 3]| {
            DBounds::EMPTY.with(low.into()).with(high.into()).far_center()
        };
        let at = |x: f64| bounds([x, 0.0, 0.0], [x + 3.0, 2.0, 1.0]);
        assert_eq!(at(40.0), None);
        let part = DBounds::EMPTY.with(DVec3::splat(1e3)).with(DVec3::splat(1001.0));
        assert!(part.far_center().is_some() && part.far_center_of_part().is_none());
        assert_eq!(at(1e6 - 1.25), Some(DVec3::new(1e6, 0.0, 0.0)));
        let tiny = bounds([1e3, 0.0, 0.0], [1e3 + 1e-3, 1e-3, 0.0]).unwrap();
        assert!((tiny - DVec3::new(1e3, 0.0, 0.0)).abs().max_element() < 1e-3, "{tiny}");
        assert!(bounds([5.0; 3], [5.0; 3]).unwrap().distance(DVec3::splat(5.0)) < 1e-7);
        assert_eq!(bounds([0.0; 3], [0.0; 3]), None);
        assert_eq!(DBounds::EMPTY.far_center(), None);
    }
}
