//! Unique names that are valid for files, OBJ records and TOML keys.

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
    let kept = |c: char| if c.is_control() || "\\\"'\u{feff}".contains(c) { '_' } else { c };
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
    fn unsafe_characters_are_replaced() {
        for (name, file, line) in [
            ("Red wall", "Red-wall", "Red wall"),
            ("../../etc/passwd", "etc-passwd", "../../etc/passwd"),
            (" .. ", "x", ".."),
            ("a\n[camera]\\", "a-camera", "a_[camera]_"),
            ("Küche", "K-che", "Küche"),
            ("", "x", "x"),
        ] {
            assert_eq!((&for_file(name, "x")[..], &for_line(name, "x")[..]), (file, line));
        }
        assert_eq!(for_file(&"long".repeat(99), "x").len(), MAX_LENGTH);
    }
}
