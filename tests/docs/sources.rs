//! Sources cite pages, equations and targets that exist.

use super::markdown::{files, pages, root};
use super::theory::equations;
use std::fs;
use std::path::{Path, PathBuf};

/// All text files that may cite the documentation.
fn sources() -> Vec<(PathBuf, String)> {
    let folders =
        ["crates", "src", "tests", "examples", "benches", "scripts", "blender", "python", "sys"];
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

/// Tests that are too long for continuous integration are in `tests/check` and run by their target.
#[test]
fn ignored_tests_name_the_target_that_runs_them() {
    let makefile = fs::read_to_string(root().join("Makefile")).unwrap();
    assert!(makefile.contains("\ncheck-long:") && makefile.contains("--test check -- --ignored"));
    let is_rust = |path: &Path| path.extension().is_some_and(|extension| extension == "rs");
    for (path, text) in sources().into_iter().filter(|(path, _)| is_rust(path)) {
        for rest in text.split("#[ignore").skip(1) {
            let reason = rest.split(']').next().unwrap();
            let is_run = reason.ends_with("make check-long\"") && path.starts_with("tests/check");
            assert!(is_run, "{}: no target runs an ignored test", path.display());
        }
    }
}

#[test]
fn cited_equations_exist() {
    let theory = equations();
    let mut problems = Vec::new();
    for (path, text) in sources() {
        for rest in text.split("theory.md (").skip(1) {
            let number = rest.split(')').next().unwrap();
            if !theory.contains(number) {
                problems.push(format!("{}: theory.md ({number})", path.display()));
            }
        }
    }
    assert!(problems.is_empty(), "there is no such equation:\n{}", problems.join("\n"));
}

/// Whether inline code is the path of a source or of a folder of sources.
fn is_source_path(code: &str) -> bool {
    let folders = ["crates/", "src/", "tests/", "examples/", "benches/", "scripts/", "scenes/"];
    let is_path = |c: char| c.is_ascii_alphanumeric() || "/_.-".contains(c);
    folders.iter().any(|folder| code.starts_with(folder)) && code.chars().all(is_path)
}

/// CONTRIBUTING has paths with the placeholder `NAME`.
#[test]
fn pages_name_sources_that_exist() {
    let mut problems = Vec::new();
    for page in pages() {
        let code = page.inline_code();
        for (line, path) in code.iter().filter(|(_, code)| is_source_path(code)) {
            if !path.contains("NAME") && !root().join(path).exists() {
                problems.push(format!("{}:{line}: {path}", page.path.display()));
            }
        }
    }
    assert!(problems.is_empty(), "there is no such source:\n{}", problems.join("\n"));
    assert!(is_source_path("crates/core/src/lib.rs") && is_source_path("scenes/"));
    assert!(!is_source_path("tests/docs *.rs") && !is_source_path("cornell-box"));
}
