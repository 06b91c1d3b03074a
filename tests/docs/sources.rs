//! Sources cite pages and equations that exist.

use super::markdown::{Page, files, root};
use std::fs;
use std::path::{Path, PathBuf};

/// All text files that may cite the documentation.
fn sources() -> Vec<(PathBuf, String)> {
    let folders = ["src", "tests", "examples", "benches", "scripts", "blender", "python", "sys"];
    let kinds = ["rs", "py", "sh", "md"];
    let is_text =
        |path: &Path| path.extension().is_some_and(|e| kinds.iter().any(|kind| e == *kind));
    let mut paths: Vec<PathBuf> = folders.into_iter().flat_map(files).collect();
    // The tests of the documentation have broken examples.
    paths.retain(|path| is_text(path) && !path.starts_with("tests/docs"));
    paths.push("Makefile".into());
    let read = |path: PathBuf| (path.clone(), fs::read_to_string(root().join(path)).unwrap());
    paths.into_iter().map(read).collect()
}

/// The longest path at the beginning of `text`.
fn leading_path(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_ascii_alphanumeric() && !"/_.-".contains(c));
    text[..end.unwrap_or(text.len())].trim_end_matches(['.', '-', '/'])
}

#[test]
fn cited_pages_exist() {
    let mut problems = Vec::new();
    for (path, text) in sources() {
        for (start, _) in text.match_indices("docs/") {
            let before = text[..start].chars().next_back();
            let cited = leading_path(&text[start..]);
            let is_own = before.is_none_or(|c| !c.is_ascii_alphanumeric() && c != '-');
            if is_own && cited.contains('.') && !root().join(cited).exists() {
                problems.push(format!("{}: {cited}", path.display()));
            }
        }
    }
    assert!(problems.is_empty(), "there is no such page:\n{}", problems.join("\n"));
}

#[test]
fn cited_equations_exist() {
    let theory = Page::read("docs/explanation/theory.md").text;
    let mut problems = Vec::new();
    for (path, text) in sources() {
        for rest in text.split("theory.md (").skip(1) {
            let number = rest.split(')').next().unwrap();
            if !theory.contains(&format!("({number})")) {
                problems.push(format!("{}: theory.md ({number})", path.display()));
            }
        }
    }
    assert!(problems.is_empty(), "there is no such equation:\n{}", problems.join("\n"));
}
