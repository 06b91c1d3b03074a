//! Files, functions and comments keep the limits of the house, but for a list of older ones that
//! may only shrink.

use super::markdown::{files, root};
use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

/// Lines of a file.
const FILE: usize = 500;
/// Lines of a function of the library or the program.
const FUNCTION: usize = 60;
/// Columns of a line with a comment.
const COLUMNS: usize = 100;

/// Longer files and functions: tables, parsers, and those that nobody has split yet. `FILE LINES`
/// or `FILE NAME LINES`.
const LONGER: &str = include_str!("longer.txt");

fn sources() -> Vec<(PathBuf, String)> {
    let folders = ["crates", "src", "sys", "python", "tests", "benches", "examples"];
    let mut paths: Vec<PathBuf> = folders.into_iter().flat_map(files).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "rs"));
    let read = |path: PathBuf| (path.clone(), fs::read_to_string(root().join(path)).unwrap());
    paths.into_iter().map(read).collect()
}

/// Name and number of lines of each function, by the indentation that `rustfmt` leaves.
fn functions(text: &str) -> Vec<(String, usize)> {
    let lines: Vec<&str> = text.lines().collect();
    let starts = lines.iter().enumerate().filter_map(|(start, line)| {
        let code = line.trim_start();
        let (before, after) = code.split_once("fn ")?;
        let is_definition = before.split(' ').all(|word| {
            matches!(word, "" | "const" | "unsafe" | "extern" | "\"C\"" | "async" | "fn")
                || word.starts_with("pub")
        });
        let name = after.split(|c: char| !c.is_alphanumeric() && c != '_').next()?;
        let is_open = !line.ends_with(['}', ';']) && !name.is_empty();
        (is_definition && is_open).then_some((start, line.len() - code.len(), name))
    });
    let length = |(start, indent, name): (usize, usize, &str)| {
        let ends =
            |line: &&str| line.get(indent..) == Some("}") && line[..indent].trim().is_empty();
        let end = lines[start..].iter().position(ends)?;
        Some((name.to_owned(), end + 1))
    };
    starts.filter_map(length).collect()
}

/// What is longer than its limit, with its length: files by path, functions by path and name.
fn longer() -> BTreeMap<String, usize> {
    let mut found = BTreeMap::new();
    for (path, text) in sources() {
        let path = path.display().to_string();
        let lines = text.lines().count();
        if lines > FILE {
            found.insert(path.clone(), lines);
        }
        let is_tested = path.starts_with("crates") || path.starts_with("src");
        for (name, lines) in functions(&text).into_iter().filter(|_| is_tested) {
            if lines > FUNCTION {
                found.insert(format!("{path} {name}"), lines);
            }
        }
    }
    found
}

#[test]
fn files_and_functions_are_short() {
    let found = longer();
    if std::env::var_os("BDPM_UPDATE_DOCS").is_some() {
        let lines = found.iter().map(|(what, lines)| format!("{what} {lines}\n"));
        fs::write(root().join("tests/docs/longer.txt"), lines.collect::<String>()).unwrap();
        return;
    }
    let listed: BTreeMap<String, usize> = LONGER
        .lines()
        .map(|line| line.rsplit_once(' ').unwrap())
        .map(|(what, lines)| (what.to_owned(), lines.parse().unwrap()))
        .collect();
    let mut problems = Vec::new();
    for (what, lines) in &found {
        let most = listed.get(what).copied();
        if most.is_none_or(|most| *lines > most) {
            let limit = if what.contains(' ') { FUNCTION } else { FILE };
            let limit = most.unwrap_or(limit);
            problems.push(format!("{what}: {lines} lines, at most {limit} are allowed"));
        }
    }
    let gone = listed.keys().filter(|what| !found.contains_key(*what));
    problems.extend(gone.map(|what| format!("{what}: short now; remove it from longer.txt")));
    assert!(problems.is_empty(), "split these:\n{}", problems.join("\n"));
}

/// Numbers of the lines whose comments are too wide. Tables, blocks of code and single words, such
/// as addresses, are not broken.
fn wide_comments(text: &str) -> Vec<usize> {
    let (mut found, mut is_code) = (Vec::new(), false);
    for (line, number) in text.lines().zip(1..) {
        let content = line
            .trim_start()
            .strip_prefix("//")
            .map(|rest| rest.trim_start_matches(['/', '!']).trim_start());
        match content {
            None => is_code = false,
            Some(content) if content.starts_with("```") => is_code = !is_code,
            Some(content) => {
                let can_wrap = !is_code && !content.starts_with('|') && content.contains(' ');
                if can_wrap && line.chars().count() > COLUMNS {
                    found.push(number);
                }
            }
        }
    }
    found
}

#[test]
fn comments_are_at_most_100_columns_wide() {
    let mut problems = Vec::new();
    for (path, text) in sources() {
        let lines = wide_comments(&text);
        problems.extend(lines.iter().map(|line| format!("{}:{line}", path.display())));
    }
    let problems = problems.join("\n");
    assert!(problems.is_empty(), "wrap these by scripts/wrap_comments.py:\n{problems}");
    let wide = format!("/// {}", "word ".repeat(20));
    let text = format!("{wide}\n/// ```\n{wide}\n/// ```\nlet x; {wide}\n  //! | {wide}\n{wide}");
    assert_eq!(wide_comments(&text), [1, 7]);
}

#[test]
fn functions_are_found_with_their_lengths() {
    let text = "fn a() {\n    x();\n}\n\nimpl B {\n    pub(crate) const fn c(\n        d: u8,\n    ) {\n    }\n}\n\
                // the fn of\ntype F = fn(u8);\nfn one() {}\n";
    let found = functions(text);
    assert_eq!(found, [("a".to_owned(), 3), ("c".to_owned(), 4)]);
}
