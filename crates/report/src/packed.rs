//! Numbers for the scripts of pages, as text.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// 16-bit words as `base64,` and their bytes, the lower byte first: 8 characters for three words.
pub fn words(words: &[u16]) -> String {
    bytes(&words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>())
}

/// Numbers as `base64,` and the bytes of 32-bit floats, the lowest byte first: 16 characters for
/// three numbers of 24 bits of precision.
pub fn singles(numbers: &[f64]) -> String {
    bytes(&numbers.iter().flat_map(|own| (*own as f32).to_le_bytes()).collect::<Vec<u8>>())
}

/// Numbers as `base64,` and the bytes of 64-bit floats, the lowest byte first: 32 characters for
/// three numbers.
pub fn doubles(numbers: &[f64]) -> String {
    bytes(&numbers.iter().flat_map(|own| own.to_le_bytes()).collect::<Vec<u8>>())
}

/// Bytes as `base64,` and their text.
pub fn bytes(bytes: &[u8]) -> String {
    format!("base64,{}", STANDARD.encode(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_have_the_lower_byte_first() {
        assert_eq!(words(&[]), "base64,");
        let text = words(&[0x1234, 0xff00]);
        let bytes = STANDARD.decode(text.strip_prefix("base64,").unwrap());
        assert_eq!(bytes.unwrap(), [0x34, 0x12, 0x00, 0xff]);
    }

    #[test]
    fn floats_have_the_lowest_byte_first() {
        let decoded =
            |text: String| STANDARD.decode(text.strip_prefix("base64,").unwrap()).unwrap();
        assert_eq!(decoded(singles(&[1.5, f64::INFINITY])), [0, 0, 0xc0, 0x3f, 0, 0, 0x80, 0x7f]);
        assert_eq!(decoded(doubles(&[-2.0])), [0, 0, 0, 0, 0, 0, 0, 0xc0]);
    }
}
