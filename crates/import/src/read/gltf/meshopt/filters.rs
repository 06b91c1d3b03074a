//! Filters of attributes: unit vectors, quaternions, numbers of few digits and colors, each with a
//! number of bits of its own.

use super::Problem;
use std::f32::consts::FRAC_1_SQRT_2;

/// Decodes the elements of `stride` bytes in place.
pub(super) fn apply(filter: &str, content: &mut [u8], stride: usize) -> Result<(), Problem> {
    match (filter, stride) {
        ("NONE", _) => {}
        ("OCTAHEDRAL", 4) => {
            bytes(content, |code| octahedral(code.map(|x| x as i8).map(f32::from), 127.0))
        }
        ("OCTAHEDRAL", 8) => {
            words(content, |code| octahedral(code.map(|x| x as i16).map(f32::from), 32_767.0))
        }
        ("QUATERNION", 8) => words(content, |code| quaternion(code.map(|x| x as i16))),
        ("EXPONENTIAL", _) => {
            for code in content.as_chunks_mut::<4>().0 {
                *code = exponential(i32::from_le_bytes(*code)).to_le_bytes();
            }
        }
        ("COLOR", 4) => bytes(content, |[y, co, cg, alpha]| {
            color([y.into(), (co as i8).into(), (cg as i8).into(), alpha.into()], 255.0)
        }),
        ("COLOR", 8) => words(content, |[y, co, cg, alpha]| {
            color([y.into(), (co as i16).into(), (cg as i16).into(), alpha.into()], 65_535.0)
        }),
        ("OCTAHEDRAL" | "QUATERNION" | "COLOR", _) => {
            return Err("its filter does not fit its byteStride");
        }
        _ => return Err("its filter is unknown"),
    }
    Ok(())
}

/// Maps elements of four bytes. Results that are not finite become 0.
fn bytes(content: &mut [u8], map: impl Fn([u8; 4]) -> [f32; 4]) {
    for element in content.as_chunks_mut::<4>().0 {
        *element = map(*element).map(|value| value.round() as i32 as u8);
    }
}

/// Maps elements of four numbers of 16 bits. Results that are not finite become 0.
fn words(content: &mut [u8], map: impl Fn([u16; 4]) -> [f32; 4]) {
    for element in content.as_chunks_mut::<8>().0 {
        let code =
            std::array::from_fn(|i| u16::from_le_bytes([element[2 * i], element[2 * i + 1]]));
        let numbers = map(code).map(|value| (value.round() as i32 as u16).to_le_bytes());
        element.copy_from_slice(numbers.as_flattened());
    }
}

/// A unit vector by its octahedral coordinates; the third number stands for 1, and the fourth is
/// kept.
fn octahedral([x, y, one, last]: [f32; 4], largest: f32) -> [f32; 4] {
    let [x, y] = [x / one, y / one];
    let z = 1.0 - x.abs() - y.abs();
    // The lower half is folded over the edges of the upper one.
    let fold = (-z).max(0.0);
    let [x, y] = [x, y].map(|own| own - fold.copysign(own));
    let scale = largest / (x * x + y * y + z * z).sqrt();
    [x * scale, y * scale, z * scale, last]
}

/// A unit quaternion by three of its numbers. The fourth code stands for 1, and its lowest two bits
/// are the place of the number that is left out.
fn quaternion(code: [i16; 4]) -> [f32; 4] {
    let scale = FRAC_1_SQRT_2 / f32::from(code[3] | 3);
    let [x, y, z] = [code[0], code[1], code[2]].map(|number| f32::from(number) * scale);
    let left_out = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    let mut quaternion = [0.0; 4];
    for (step, number) in [left_out, x, y, z].into_iter().enumerate() {
        quaternion[((code[3] & 3) as usize + step) % 4] = number * 32_767.0;
    }
    quaternion
}

/// A number by an exponent of 8 bits and a mantissa of 24.
fn exponential(code: i32) -> f32 {
    let (exponent, mantissa) = (code >> 24, code << 8 >> 8);
    (f64::from(exponent).exp2() * f64::from(mantissa)) as f32
}

/// A color by luma, two differences of chroma and alpha, whose highest bit tells the number of
/// bits.
fn color([y, orange, green, alpha]: [i32; 4], largest: f32) -> [f32; 4] {
    let bits = 32 - alpha.leading_zeros();
    let one = (1 << bits) - 1;
    let own = alpha & (one >> 1);
    let alpha = own << 1 | own & 1;
    let scale = largest / one as f32;
    let [r, g, b] = [y + orange - green, y + green, y - orange - green];
    [r, g, b, alpha].map(|value| value as f32 * scale)
}
