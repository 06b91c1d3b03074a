//! No stage names a later one: the stages of a crate are the modules of its `lib.rs`, in that
//! order. Between crates, the compiler sees to it.

use std::fs;
use std::path::{Path, PathBuf};

/// Crates whose modules are stages.
const CRATES: [&str; 5] = ["base", "statistics", "core", "auto", "job"];

/// The public modules of a `lib.rs`, in its order.
fn stages(lib: &str) -> Vec<&str> {
    lib.lines().filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';')).collect()
}

/// Numbers of the lines with a path from the root to one of the modules, outside of comments.
fn naming(code: &str, modules: &[&str]) -> Vec<usize> {
    let names = |path: &str| {
        let word = path.split(|c: char| !c.is_alphanumeric() && c != '_').next();
        word.is_some_and(|word| modules.contains(&word))
    };
    let named = |line: &str| {
        !line.trim_start().starts_with("//") && line.split("crate::").skip(1).any(names)
    };
    (1..).zip(code.lines()).filter(|(_, line)| named(line)).map(|(number, _)| number).collect()
}

/// All sources below a folder, or the file of that name.
fn sources(path: PathBuf) -> Vec<PathBuf> {
    match fs::read_dir(&path) {
        Ok(entries) => entries.flat_map(|entry| sources(entry.unwrap().path())).collect(),
        Err(_) => vec![path.with_extension("rs")],
    }
}

#[test]
fn no_stage_names_a_later_one() {
    let mut problems = Vec::new();
    for name in CRATES {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates").join(name).join("src");
        let lib = fs::read_to_string(root.join("lib.rs")).unwrap();
        let stages = stages(&lib);
        assert!(stages.len() > 1, "{name}: {stages:?}");
        for (i, stage) in stages.iter().enumerate() {
            for path in sources(root.join(stage)) {
                let Ok(code) = fs::read_to_string(&path) else { continue }; // tables and licenses
                let lines = naming(&code, &stages[i + 1..]);
                problems.extend(lines.iter().map(|line| format!("{}:{line}", path.display())));
            }
        }
    }
    assert!(problems.is_empty(), "the order is that of lib.rs\n{}", problems.join("\n"));
}

#[test]
fn a_later_stage_is_found_in_code_only() {
    let code = "use crate::late::x;\n// crate::late\nlet y = (crate::early::a, crate::late::b);\n\
                use crate::later;\nuse other::late;";
    assert_eq!(naming(code, &["late", "last"]), [1, 3]);
    assert_eq!(stages("//! a\npub mod a;\n#[x]\npub mod b;\nmod c;\npub use d;"), ["a", "b"]);
}
