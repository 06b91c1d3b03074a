//! Names from files: as they are shown, and unique ones that are valid for files, OBJ records and
//! TOML keys.

use std::collections::{HashMap, HashSet};

/// Maximum length of a name, characters. File systems allow 255 bytes.
const MAX_LENGTH: usize = 60;

/// Creates unique names.
#[derive(Default)]
pub struct Names {
    /// In lower case, because some file systems ignore case.
    taken: HashSet<String>,
    /// Next number to try for a name that is taken.
    next: HashMap<String, u32>,
}

impl Names {
    /// A unique name similar to `name`.
    pub fn unique(&mut self, name: String) -> String {
        let key = name.to_lowercase();
        if self.taken.insert(key.clone()) {
            return name;
        }
        let next = self.next.entry(key).or_insert(2);
        loop {
            let numbered = format!("{name}-{next}");
            *next += 1;
            if self.taken.insert(numbered.to_lowercase()) {
                return numbered;
            }
        }
    }
}

/// Returns true for characters that control what shows them: a terminal, the ends of lines, or the
/// direction of text, by which a name can show other text around it in another order
/// (CVE-2021-42574).
pub fn is_control(c: char) -> bool {
    // Marks of directions, separators of lines and paragraphs, embeddings, overrides and isolates
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}')
        || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// The character, or a replacement of one that controls what shows a text of several lines.
pub fn visible(c: char) -> char {
    if is_control(c) && c != '\t' && c != '\n' { '\u{fffd}' } else { c }
}

/// `name` as it can be shown anywhere in a line of text.
pub fn for_display(name: &str) -> String {
    name.chars().map(|c| if is_control(c) { '\u{fffd}' } else { c }).collect()
}

/// `name` as part of a file name: letters, digits, `-` and `_`.
pub fn for_file(name: &str, default: &str) -> String {
    let kept = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' };
    let words: String = name.chars().map(kept).collect();
    let words: Vec<&str> = words.split('-').filter(|word| !word.is_empty()).collect();
    let name: String = words.join("-").chars().take(MAX_LENGTH).collect();
    if name.is_empty() { default.to_owned() } else { name }
}

/// `name` as it is valid in a line of an OBJ file and in quotes.
pub fn for_line(name: &str, default: &str) -> String {
    let kept = |c: char| if is_control(c) || "\\\"'\u{feff}".contains(c) { '_' } else { c };
    let name: String = name.trim().chars().map(kept).take(MAX_LENGTH).collect();
    let name = name.trim();
    if name.is_empty() { default.to_owned() } else { name.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_names_are_numbered() {
        let mut names = Names::default();
        let all = ["a", "A", "a-2", "a", "b"].map(|name| names.unique(name.to_owned()));
        assert_eq!(all, ["a", "A-2", "a-2-2", "a-3", "b"]);
    }

    #[test]
    fn shown_names_control_neither_terminal_nor_direction() {
        for c in "\x1b\x07\x7f\u{9b}\u{61c}\u{200e}\u{200f}\u{2028}\u{202a}\u{202e}\u{2069}".chars()
        {
            assert_eq!(for_display(&format!("a{c}b")), "a\u{fffd}b", "{c:?}");
            assert_eq!(visible(c), '\u{fffd}', "{c:?}");
        }
        assert_eq!(for_display("a\nb\tc"), "a\u{fffd}b\u{fffd}c");
        assert_eq!((visible('\n'), visible('\t')), ('\n', '\t'));
        // Letters of all scripts are kept, and so are joiners within words and pictures.
        for name in ["Küche", "מנורה", "مصباح", "灯", "a\u{200d}b"] {
            assert_eq!(for_display(name), name);
        }
    }

    #[test]
    fn unsafe_characters_are_replaced() {
        for (name, file, line) in [
            ("Red wall", "Red-wall", "Red wall"),
            ("../../etc/passwd", "etc-passwd", "../../etc/passwd"),
            (" .. ", "x", ".."),
            ("a\n[camera]\\", "a-camera", "a_[camera]_"),
            ("Küche", "K-che", "Küche"),
            ("a\u{202e}b\u{2066}", "a-b", "a_b_"),
            ("", "x", "x"),
        ] {
            assert_eq!((&for_file(name, "x")[..], &for_line(name, "x")[..]), (file, line));
        }
        assert_eq!(for_file(&"long".repeat(99), "x").len(), MAX_LENGTH);
    }
}
