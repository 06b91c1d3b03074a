//! Published tone curves for previews.

use bdpm_base::math::Rgb;

/// Filmic curve of John Hable, "Filmic Tonemapping Operators" (2010), as in "Uncharted 2: HDR
/// Lighting" (GDC 2010). Maps a linear channel to a linear display value in [0, 1]. The white point
/// is 11.2 after a factor of 2.
#[inline]
pub(super) fn filmic(value: f32) -> f32 {
    const FACTOR: f32 = 2.0;
    const WHITE: f32 = 11.2;
    // Values above the white point have the same result, and their squares could exceed the range
    // of numbers
    (hable((FACTOR * value).min(WHITE)) / hable(WHITE)).clamp(0.0, 1.0)
}

/// Hable's curve with his constants: shoulder strength, linear strength and angle, toe strength,
/// numerator and denominator.
#[inline]
fn hable(x: f32) -> f32 {
    let [a, b, c, d, e, f] = [0.15, 0.50, 0.10, 0.20, 0.02, 0.30];
    (x * (a * x + c * b) + d * e) / (x * (a * x + b) + d * f) - e / f
}

/// Range of AgX around middle gray 0.18, base-2 logarithms of linear values.
const AGX_RANGE: [f32; 2] = [-12.473_93, 4.026_069];

/// Columns of the matrix that desaturates linear Rec. 709 before the curve.
const AGX_INSET: [[f32; 3]; 3] = [
    [0.842_479_1, 0.042_328_24, 0.042_375_65],
    [0.078_433_6, 0.878_468_6, 0.078_433_6],
    [0.079_223_745, 0.079_166_13, 0.879_143],
];

/// Columns of the inverse of [`AGX_INSET`].
const AGX_OUTSET: [[f32; 3]; 3] = [
    [1.196_879, -0.052_896_85, -0.052_971_635],
    [-0.098_020_88, 1.151_903_1, -0.098_043_45],
    [-0.099_029_74, -0.098_961_18, 1.151_073_7],
];

/// AgX of Troy Sobotka (2022) in the approximation of Benjamin Wrensch, "Minimal AgX
/// Implementation" (2023): a matrix, logarithms over 16.5 stops, a polynomial for the curve, and
/// the inverse matrix. Maps linear Rec. 709 to display values in [0, 1], which include the transfer
/// function of the display.
#[inline]
pub(super) fn agx(color: Rgb) -> Rgb {
    let [min, max] = AGX_RANGE;
    let log = transformed(&AGX_INSET, color).to_array().map(|value| {
        let value = value.clamp(min.exp2(), max.exp2());
        agx_curve((value.log2() - min) / (max - min))
    });
    transformed(&AGX_OUTSET, Rgb::from_array(log)).clamp(Rgb::ZERO, Rgb::ONE)
}

/// Wrensch's fit of the AgX curve on [0, 1].
#[inline]
fn agx_curve(x: f32) -> f32 {
    // Coefficients of x^0 to x^6
    const FIT: [f32; 7] = [-0.002_32, 0.119_1, 0.429_8, -6.868, 31.96, -40.14, 15.5];
    FIT.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// The product of a matrix, given by its columns, and a color.
#[inline]
fn transformed(columns: &[[f32; 3]; 3], color: Rgb) -> Rgb {
    let [r, g, b] = columns.map(Rgb::from_array);
    color.x * r + color.y * g + color.z * b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filmic_curve_has_the_published_values() {
        // By hand: black maps to 0, the white point to 1, and 1 to 0.204/0.71 - 1/15 before scaling
        assert!(filmic(0.0).abs() < 1e-6);
        assert!((hable(1.0) - (0.204 / 0.71 - 1.0 / 15.0)).abs() < 1e-6);
        assert!((filmic(5.6) - 1.0).abs() < 1e-6 && filmic(1e30) == 1.0);
        let expected = (0.204 / 0.71 - 1.0 / 15.0) / (19.380 / 24.476 - 1.0 / 15.0);
        assert!((filmic(0.5) - expected).abs() < 1e-4, "{}", filmic(0.5));
    }

    #[test]
    fn agx_maps_middle_gray_to_one_half_and_its_range_to_black_and_white() {
        let gray = |value: f32| agx(Rgb::splat(value)).to_array();
        // The pivot of AgX is 0.18 to 0.5; the error of the fit is below 0.01.
        for value in gray(0.18) {
            assert!((value - 0.5).abs() < 0.01, "{value}");
        }
        assert!(gray(1e-5).iter().all(|value| *value < 0.01));
        assert!(gray(17.0).iter().all(|value| *value > 0.995));
    }

    #[test]
    fn agx_desaturates_bright_colors() {
        let [r, g, b] = agx(Rgb::new(50.0, 0.5, 0.5)).to_array();
        assert!(r > 0.95 && g > 0.4 && b > 0.4, "{r} {g} {b}");
        let [r, g, b] = agx(Rgb::new(0.2, 0.002, 0.002)).to_array();
        assert!(r > 3.0 * g && r > 3.0 * b, "{r} {g} {b}");
    }

    #[test]
    fn agx_matrices_are_inverse() {
        for color in [Rgb::X, Rgb::Y, Rgb::Z] {
            let back = transformed(&AGX_OUTSET, transformed(&AGX_INSET, color));
            assert!((back - color).length() < 1e-3, "{back}");
        }
    }
}
