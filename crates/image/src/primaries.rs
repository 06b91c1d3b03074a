//! Primaries of image files, and their conversion to those of Rec. 709.

use bdpm_base::math::Rgb;
use glam::{DMat3, DVec3};

/// Chromaticities `x`, `y` of the primaries and of white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Primaries {
    /// Red, green, blue and white.
    pub xy: [[f64; 2]; 4],
}

impl Primaries {
    /// Rec. 709 with its white D65.
    pub const REC_709: Self =
        Self { xy: [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06], [0.3127, 0.3290]] };

    /// Files round chromaticities. Radiance's are those of its own white, equal energy, which
    /// programs write for colors of any display.
    const TOLERANCE: f64 = 5e-3;

    /// Primaries that Radiance writes by default and other programs copy without meaning them.
    const RADIANCE: Self =
        Self { xy: [[0.64, 0.33], [0.29, 0.60], [0.15, 0.06], [1.0 / 3.0, 1.0 / 3.0]] };

    /// The map of linear colors to Rec. 709, white to white (Bradford's adaptation); `None` if
    /// these are those of Rec. 709 or Radiance, or make no basis.
    pub fn to_rec_709(self) -> Option<DMat3> {
        let is_near = |other: Self| {
            let pairs = self.xy.as_flattened().iter().zip(other.xy.as_flattened());
            pairs.into_iter().all(|(a, b)| (a - b).abs() < Self::TOLERANCE)
        };
        if is_near(Self::REC_709) || is_near(Self::RADIANCE) {
            return None;
        }
        let target = Self::REC_709;
        let map = target.to_xyz()?.inverse()
            * adaptation(white(self.xy[3])?, white(target.xy[3])?)
            * self.to_xyz()?;
        map.is_finite().then_some(map)
    }

    /// The map of CIE XYZ to Rec. 709.
    ///
    /// # Panics
    /// Never: the primaries of Rec. 709 make a basis.
    pub fn xyz_to_rec_709() -> DMat3 {
        Self::REC_709.to_xyz().expect("they make a basis").inverse()
    }

    /// The map to CIE XYZ, in which white has a luminance of 1.
    pub(super) fn to_xyz(self) -> Option<DMat3> {
        let [red, green, blue, own] = self.xy;
        let column = |[x, y]: [f64; 2]| DVec3::new(x, y, 1.0 - x - y);
        let basis = DMat3::from_cols(column(red), column(green), column(blue));
        let is_basis = basis.is_finite() && basis.determinant().abs() > 1e-6;
        let factors = basis.inverse() * white(own)?;
        is_basis.then(|| basis * DMat3::from_diagonal(factors))
    }
}

/// XYZ of a white of luminance 1.
pub(super) fn white([x, y]: [f64; 2]) -> Option<DVec3> {
    (y > 1e-6 && x.is_finite()).then(|| DVec3::new(x / y, 1.0, (1.0 - x - y) / y))
}

/// Bradford's adaptation from one white to another.
pub(super) fn adaptation(from: DVec3, to: DVec3) -> DMat3 {
    let cones = DMat3::from_cols_array(&[
        0.8951, -0.7502, 0.0389, 0.2664, 1.7135, -0.0685, -0.1614, 0.0367, 1.0296,
    ]);
    cones.inverse() * DMat3::from_diagonal((cones * to) / (cones * from)) * cones
}

/// A color of other primaries. Components outside of the gamut become 0.
#[inline]
pub fn converted(map: DMat3, color: Rgb) -> Rgb {
    // Values that are not finite are reported by the caller.
    if color.is_finite() { (map * color.as_dvec3()).as_vec3().max(Rgb::ZERO) } else { color }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ACES: Primaries =
        Primaries { xy: [[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.077], [0.32168, 0.33767]] };

    #[test]
    fn white_stays_white_and_matrix_of_aces_is_the_published_one() {
        let map = ACES.to_rec_709().unwrap();
        assert!((map * DVec3::ONE).abs_diff_eq(DVec3::ONE, 1e-9), "{map}");
        // ACES2065-1 to linear sRGB with Bradford's adaptation, from the configuration of ACES.
        let red = DVec3::new(2.521_69, -0.276_48, -0.015_38);
        assert!(map.x_axis.abs_diff_eq(red, 1e-3), "{}", map.x_axis);
    }

    #[test]
    fn usual_and_impossible_primaries_change_nothing() {
        assert_eq!(Primaries::REC_709.to_rec_709(), None);
        assert_eq!(Primaries::RADIANCE.to_rec_709(), None);
        for xy in [[[0.3, 0.3]; 4], [[f64::NAN; 2]; 4], [[0.0; 2]; 4]] {
            assert_eq!(Primaries { xy }.to_rec_709(), None);
        }
    }
}
