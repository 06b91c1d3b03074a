//! Words of OBJ records, and the numbers among them.

use crate::base::error::Result;
use crate::base::math::Rgb;
use crate::import::lines::Lines;
use crate::import::srgb::decode;
use crate::scene::transform::MAX_COORDINATE;
use glam::Vec3;

/// The first word and what follows it, without white space around either.
pub(super) fn split_keyword(line: &[u8]) -> (&[u8], &[u8]) {
    let end = line.iter().position(is_space).unwrap_or(line.len());
    (&line[..end], line[end..].trim_ascii_start())
}

/// What white space separates.
pub(super) fn words(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(is_space).filter(|word| !word.is_empty())
}

fn is_space(byte: &u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r')
}

/// The beginning of a word, for a message.
pub(super) fn shown(word: &[u8]) -> String {
    String::from_utf8_lossy(word).chars().take(40).collect()
}

/// A whole number that is not absurdly large.
pub(super) fn integer(word: &[u8]) -> Option<i64> {
    let (is_negative, digits) = match word {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] => (false, digits),
        digits => (false, digits),
    };
    let mut number = if digits.is_empty() { None } else { Some(0_i64) };
    for digit in digits {
        let digit = if digit.is_ascii_digit() { i64::from(digit - b'0') } else { return None };
        // Negative numbers reach one further.
        number = number.and_then(|number| number.checked_mul(10)?.checked_sub(digit));
    }
    if is_negative { number } else { number?.checked_neg() }
}

fn float(word: &[u8]) -> Option<f32> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

fn without_comment(text: &[u8]) -> &[u8] {
    memchr::memchr(b'#', text).map_or(text, |at| &text[..at])
}

/// The position of a `v` record: three numbers, a fourth that divides them, or three more of a color.
pub(super) fn position(lines: &Lines<'_>, text: &[u8]) -> Result<(Vec3, Option<Rgb>)> {
    let advice = "give three numbers, such as `v 0.5 1 -2`";
    let mut numbers = [0.0; 4];
    let mut count = 0;
    for word in words(without_comment(text)) {
        let number = float(word)
            .ok_or_else(|| lines.error(format!("`{}` is not a number", shown(word)), advice))?;
        if let Some(place) = numbers.get_mut(count) {
            *place = number;
        }
        count += 1;
    }
    if count < 3 {
        return Err(lines.error(format!("the vertex has {count} coordinates"), advice));
    }
    let weight = if count == 4 { numbers[3] } else { 1.0 };
    let point = Vec3::from_slice(&numbers) / weight;
    if !point.is_finite() || !weight.is_finite() {
        return Err(lines.error(
            "the vertex has a coordinate that is not finite",
            "export the model again, or remove the vertex and its faces",
        ));
    }
    if point.abs().max_element() > MAX_COORDINATE {
        return Err(lines.error(
            format!("the vertex has a coordinate beyond {MAX_COORDINATE:e}"),
            "scale the model down",
        ));
    }
    // Read once more, with all digits that lead back to a linear color.
    let color = (count >= 6).then(|| {
        let mut codes = words(without_comment(text)).skip(3).map(|word| {
            std::str::from_utf8(word).ok().and_then(|word| word.parse().ok()).unwrap_or(1.0)
        });
        decode(std::array::from_fn(|_| codes.next().unwrap_or(1.0)))
    });
    Ok((point, color))
}

/// At least so many numbers of up to three; the rest are 0. With how many are no numbers, such as the `-nan(ind)`
/// of some programs, or too large ones: these become 0 as well.
pub(super) fn numbers(lines: &Lines<'_>, text: &[u8], least: usize) -> Result<([f32; 3], u64)> {
    let mut numbers = [0.0; 3];
    let (mut count, mut mended) = (0, 0);
    for (number, word) in numbers.iter_mut().zip(words(without_comment(text))) {
        let read = float(word).filter(|number| number.abs() <= MAX_COORDINATE);
        mended += u64::from(read.is_none());
        *number = read.unwrap_or(0.0);
        count += 1;
    }
    if count < least {
        let keyword = shown(split_keyword(lines.bytes()).0);
        return Err(lines.error(
            format!("`{keyword}` needs {least} or more numbers"),
            format!("write them, such as `{keyword}{}`", &" 0.5 0.5 0.5"[..4 * least]),
        ));
    }
    Ok((numbers, mended))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_are_those_of_the_standard_library() {
        for text in [
            "0",
            "-0",
            "+7",
            "-12",
            "007",
            "",
            "-",
            "+",
            "1.",
            "1e3",
            "0x1",
            "--1",
            "+-1",
            " 1",
            "1 ",
            "9223372036854775807",
            "9223372036854775808",
            "-9223372036854775808",
            "-9223372036854775809",
            "99999999999999999999999",
            "9999999999999999999x",
            "½",
        ] {
            assert_eq!(integer(text.as_bytes()), text.parse().ok(), "{text}");
        }
    }
}
