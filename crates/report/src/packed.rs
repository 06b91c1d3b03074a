//! Numbers for the scripts of pages, as text.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// 16-bit words as `base64,` and their bytes, the lower byte first: 8 characters for three words.
pub fn words(words: &[u16]) -> String {
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
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
}
