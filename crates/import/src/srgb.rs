//! Encoding and decoding of colors by the transfer curve of sRGB (IEC 61966-2-1).

use bdpm_core::base::math::Rgb;

/// The linear value of a code in [0, 1].
fn linear(code: f64) -> f64 {
    if code <= 0.04045 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

/// The code of a linear value, with enough digits to decode to the same value.
fn code(linear: f64) -> f64 {
    if linear <= 0.04045 / 12.92 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The linear color of these codes. They are clamped to [0, 1], and NaN becomes 0.
pub fn decode(codes: [f64; 3]) -> Rgb {
    let share = |code: f64| if code.is_nan() { 0.0 } else { code.clamp(0.0, 1.0) };
    Rgb::from_array(codes.map(|code| linear(share(code)) as f32))
}

/// The codes of a linear color.
pub fn encode(color: Rgb) -> [f64; 3] {
    color.to_array().map(|value| code(value.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoded_colors_decode_to_the_same_values() {
        for i in 0..100_000_u32 {
            let bits = i.wrapping_mul(2_654_435_761);
            let value = f32::from_bits(bits % 1.0_f32.to_bits());
            let color = Rgb::new(value, i as f32 / 1e5, 1.0);
            assert_eq!(decode(encode(color)), color);
            let text = encode(color).map(|code| format!("{code}").parse::<f64>().unwrap());
            assert_eq!(decode(text), color);
        }
        assert_eq!(decode([-1.0, 2.0, f64::NAN]), Rgb::new(0.0, 1.0, 0.0));
        assert!((decode([0.5; 3]).x - 0.214_041).abs() < 1e-6);
    }
}
