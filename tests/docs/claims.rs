//! Tables and commits in the documentation against the program and the history.

use super::commands::SUBCOMMANDS;
use super::help::{help, subcommands};
use super::markdown::{Page, pages, root};
use std::collections::BTreeSet;
use std::process::Command;

/// Characters of the hashes that pages cite.
const HASH_LENGTH: usize = 7;

/// Subcommands in the first column of the table of the command line reference.
fn tabulated(text: &str) -> BTreeSet<String> {
    let name =
        |line: &str| Some(line.strip_prefix("| [`")?.split_once("`](command-line/")?.0.to_owned());
    text.lines().filter_map(name).collect()
}

#[test]
fn table_of_subcommands_has_those_of_the_program() {
    let program: BTreeSet<String> = subcommands().into_iter().collect();
    assert_eq!(tabulated(&Page::read("docs/reference/command-line.md").text), program);
    assert_eq!(BTreeSet::from(SUBCOMMANDS.map(str::to_owned)), program);
}

#[test]
fn keys_of_every_json_object_are_documented() {
    let text = Page::read("docs/reference/output-files.md").text;
    for name in subcommands().iter().filter(|name| help(name).contains("--json")) {
        let is_documented = text.contains(&format!("\n| `{name}` |"));
        assert!(is_documented || name == "render", "the keys of `{name}` are missing");
    }
}

/// Options whose default is chosen by the pilot, as a help text says.
fn chosen(help: &str) -> Vec<String> {
    let (mut option, mut found) = (None, Vec::new());
    for line in help.lines().map(str::trim_start) {
        if let Some((_, name)) = line.split_once("--").filter(|(before, _)| before.len() <= 4) {
            option = name.split(|c: char| !c.is_ascii_alphanumeric() && c != '-').next();
        }
        if line.contains("[default: chosen]") {
            found.push(format!("--{}", option.expect("an option")));
        }
    }
    found
}

/// Path counts are chosen as well: giving one of them turns all choices off.
#[test]
fn settings_that_the_pilot_chooses_are_documented() {
    let page = Page::read("docs/explanation/automatic/technique.md").text;
    let list = page.split("**Your settings.**").nth(1).expect("a paragraph");
    let list = list.split("\n\n").next().unwrap();
    let chosen = chosen(&help("render"));
    assert!(chosen.len() > 10, "there are too few chosen options: {chosen:?}");
    for option in chosen.iter().filter(|option| !option.ends_with("-paths")) {
        let is_listed = list.contains(&format!("`{option}`"));
        assert!(is_listed, "docs/explanation/automatic/technique.md: {option} is missing");
    }
}

/// Words that look like abbreviated hashes of commits.
pub fn hashes(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| {
        let is_hex = word.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'));
        let has = |of: fn(&u8) -> bool| word.as_bytes().iter().any(of);
        // Numbers and words are no hashes.
        word.len() == HASH_LENGTH
            && is_hex
            && has(u8::is_ascii_digit)
            && has(u8::is_ascii_lowercase)
    })
}

/// Standard output of `git` in the repository, if it runs.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").current_dir(root()).args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Archives, shallow clones and copies in other repositories do not have the history.
#[test]
fn cited_commits_are_in_the_history() {
    let kind = git(&["rev-parse", "--is-shallow-repository", "--show-prefix"]);
    if kind.as_deref() != Some("false\n\n") {
        return;
    }
    let history = git(&["rev-list", "HEAD"]).expect("a history");
    let history: BTreeSet<&str> =
        history.lines().filter_map(|hash| hash.get(..HASH_LENGTH)).collect();
    let mut problems = Vec::new();
    for page in pages() {
        let unknown = hashes(&page.text).filter(|hash| !history.contains(hash));
        problems.extend(unknown.map(|hash| format!("{}: {hash}", page.path.display())));
    }
    assert!(problems.is_empty(), "there is no such commit:\n{}", problems.join("\n"));
}

#[test]
fn hashes_and_table_rows_are_found() {
    let text = "Commits 0f13a71 and a593ce1, 2026-11-26: 1234567 pixels, faceade, x0f13a71";
    assert_eq!(hashes(text).collect::<Vec<_>>(), ["0f13a71", "a593ce1"]);
    let help = "  -o, --output <F>\n      Write --all [default: x]\n  --bias <B>\n      A [default: chosen]";
    assert_eq!(chosen(help), ["--bias"]);
    let table = "| [`man`](command-line/man.md) | writes |\n| `glare` | `dgp` |\n";
    assert_eq!(tabulated(table), BTreeSet::from(["man".to_owned()]));
}
