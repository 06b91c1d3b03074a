//! The reference of the command line has the help texts of the program. Options that a subcommand
//! shares with `render` are described on the page of `render` only.

use super::markdown::{Page, files, root};
use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

/// Folder with a page for each subcommand.
const PAGES: &str = "docs/reference/command-line";
/// Subcommand whose page has all of its options.
const FULL: &str = "render";
const UPDATE: &str = "BDPM_UPDATE_DOCS=1 cargo test --test suite docs";

/// Standard output of `bdpm SUBCOMMAND --help`.
pub fn help(subcommand: &str) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    let output = command.args([subcommand, "--help"]).output().unwrap();
    assert!(output.status.success(), "bdpm {subcommand} --help fails");
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().map(|line| format!("{}\n", line.trim_end())).collect()
}

/// Names of all subcommands but `help`, as `bdpm --help` lists them.
pub fn subcommands() -> Vec<String> {
    let output = Command::new(env!("CARGO_BIN_EXE_bdpm")).arg("--help").output().unwrap();
    let help = String::from_utf8(output.stdout).unwrap();
    let commands = help.split("Commands:\n").nth(1).unwrap().split("\n\n").next().unwrap();
    let names = commands.lines().map(|line| line.split_whitespace().next().unwrap().to_owned());
    names.filter(|name| name != "help").collect()
}

/// Whether a line of a help text, or a piece of one, begins with an option.
fn starts_option(text: &str) -> bool {
    let option = text.trim_start_matches(' ');
    option.starts_with('-') && (2..=6).contains(&(text.len() - option.len()))
}

/// A help text in pieces: each begins with an option, or with a line that is not indented.
fn pieces(text: &str) -> Vec<String> {
    let mut pieces: Vec<String> = Vec::new();
    for line in text.split_inclusive('\n') {
        let is_first = starts_option(line) || !line.starts_with([' ', '\n']);
        match pieces.last_mut() {
            Some(piece) if !is_first => piece.push_str(line),
            _ => pieces.push(line.to_owned()),
        }
    }
    pieces
}

/// The name of the option that a piece describes, such as `--time`.
fn name(piece: &str) -> String {
    let (_, rest) = piece.split_once("--").expect("options have long names");
    let is_end = |c: char| !c.is_ascii_alphanumeric() && c != '-';
    format!("--{}", rest.split(is_end).next().unwrap())
}

/// A help text without the options that `full` describes in the same words, and the names of these
/// options.
fn shortened(text: &str, full: &str) -> (String, Vec<String>) {
    let full = pieces(full);
    let options = full.iter().filter(|piece| starts_option(piece));
    let known: BTreeSet<&str> = options.map(|piece| piece.trim_end()).collect();
    let is_shared = |piece: &String| starts_option(piece) && known.contains(piece.trim_end());
    let (shared, kept): (Vec<_>, Vec<_>) = pieces(text).into_iter().partition(is_shared);
    let is_heading = |piece: &str| piece.trim_end().ends_with(':') && !piece.trim().contains('\n');
    let mut short = String::new();
    for (index, piece) in kept.iter().enumerate() {
        let has_options = kept.get(index + 1).is_some_and(|next| starts_option(next));
        if has_options || !is_heading(piece) {
            short += piece;
        }
    }
    let names = shared.iter().map(|piece| name(piece)).filter(|name| name != "--help");
    (format!("{}\n", short.trim_end()), names.collect())
}

/// The page of a subcommand with the help text of today after the marker.
fn updated(text: &str, subcommand: &str) -> String {
    let marker = format!("<!-- help: {subcommand} -->\n");
    let (before, _) = text.split_once(&marker[..]).expect("a marker");
    let help = help(subcommand);
    if subcommand == FULL {
        return format!("{before}{marker}\n```text\n{}\n```\n", help.trim_end());
    }
    let (short, names) = shortened(&help, &self::help(FULL));
    let mut page = format!("{before}{marker}\n```text\n{short}```\n");
    if !names.is_empty() {
        let names = names.join("`, `");
        page += &format!("\nAs in [`bdpm {FULL}`]({FULL}.md): `{names}`.\n");
    }
    page
}

#[test]
fn command_line_reference_has_the_help_of_the_program() {
    for name in subcommands() {
        let path = format!("{PAGES}/{name}.md");
        let page = Page::read(&path);
        let expected = updated(&page.text, &name);
        if std::env::var_os("BDPM_UPDATE_DOCS").is_some() {
            fs::write(root().join(&path), &expected).unwrap();
        } else if page.text != expected {
            let differs = page.text.lines().zip(expected.lines()).position(|(old, new)| old != new);
            let line = differs.unwrap_or(0) + 1;
            panic!("{path}:{line}: not the help of the program; write it by: {UPDATE}");
        }
    }
}

#[test]
fn command_line_reference_has_a_page_for_each_subcommand() {
    let stem = |path: &PathBuf| path.file_stem().unwrap().to_str().unwrap().to_owned();
    let pages: BTreeSet<String> = files(PAGES).iter().map(stem).collect();
    let program: BTreeSet<String> = subcommands().into_iter().collect();
    assert_eq!(pages, program);
}

#[test]
fn shared_options_are_left_out() {
    let full =
        "Renders\n\nMain options:\n  -h, --help\n      Help\n\n      --time <T>\n      Stop\n";
    let text = "Measures\n\nMain options:\n      --time <T>\n      Stop\n\nOutput:\n      --csv\n      Write\n";
    let (short, names) = shortened(text, full);
    assert_eq!(short, "Measures\n\nOutput:\n      --csv\n      Write\n");
    assert_eq!(names, ["--time"]);
}
