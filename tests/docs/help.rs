//! The reference of the command line has the help texts of the program.

use super::markdown::{Page, root};
use std::fs;
use std::process::Command;

const PAGE: &str = "docs/reference/command-line.md";
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

/// The page with the help texts of today after each marker.
fn updated(text: &str) -> String {
    let mut parts = text.split("<!-- help: ");
    let mut page = parts.next().unwrap().to_owned();
    for part in parts {
        let (subcommand, rest) = part.split_once(" -->\n").expect("a marker ends");
        // The old text, if there is one, is the block right after the marker.
        let rest = rest.trim_start_matches('\n');
        let rest = match rest.strip_prefix("```text\n") {
            Some(block) => block.split_once("```\n").expect("a block ends").1,
            None => rest,
        };
        let help = help(subcommand);
        page += &format!("<!-- help: {subcommand} -->\n\n```text\n{help}```\n\n");
        page += rest.trim_start_matches('\n');
    }
    format!("{}\n", page.trim_end())
}

#[test]
fn command_line_reference_has_the_help_of_the_program() {
    let page = Page::read(PAGE);
    let expected = updated(&page.text);
    if std::env::var_os("BDPM_UPDATE_DOCS").is_some() {
        fs::write(root().join(PAGE), &expected).unwrap();
    } else if page.text != expected {
        let differs = page.text.lines().zip(expected.lines()).position(|(old, new)| old != new);
        let line = differs.unwrap_or(0) + 1;
        panic!("{PAGE}:{line}: not the help of the program; write it by: {UPDATE}");
    }
}

#[test]
fn command_line_reference_has_every_subcommand() {
    let text = Page::read(PAGE).text;
    for name in subcommands() {
        let is_documented = text.contains(&format!("<!-- help: {name} -->"));
        assert!(is_documented, "{PAGE}: `{name}` is missing");
    }
}
