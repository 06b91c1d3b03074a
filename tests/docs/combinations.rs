//! The reference has the table of combinations of the library.

use super::markdown::{Page, root};
use bdpm::settings::combinations::{COMBINATIONS, Combination, Outcome};
use std::fs;

const PAGE: &str = "docs/reference/combinations.md";
const MARKER: &str = "<!-- combinations -->\n";
const UPDATE: &str = "BDPM_UPDATE_DOCS=1 cargo test --test suite docs";

/// A side of a combination with its options as code, such as "`--strategy mis` or `cut-mis`".
fn side(text: &str) -> String {
    let alternatives: Vec<_> = text.split('|').collect();
    if !text.starts_with("--") {
        return text.to_owned();
    }
    alternatives.iter().map(|words| format!("`{words}`")).collect::<Vec<_>>().join(" or ")
}

fn table() -> String {
    let row = |row: &Combination| {
        let [first, second] = row.options.map(side);
        let outcome = match row.outcome {
            Outcome::Refused(_) | Outcome::Usage(_) => "refused",
            Outcome::Weakened => "does less",
        };
        format!("| {first} | {second} | {outcome} | {} |\n", row.why)
    };
    let rows: String = COMBINATIONS.iter().map(row).collect();
    format!("\n| option | with | outcome | what happens, and why |\n|---|---|---|---|\n{rows}")
}

#[test]
fn reference_has_every_combination() {
    let page = Page::read(PAGE);
    let (text, _) = page.text.split_once(MARKER).expect("a marker");
    let expected = format!("{text}{MARKER}{}", table());
    if std::env::var_os("BDPM_UPDATE_DOCS").is_some() {
        fs::write(root().join(PAGE), &expected).unwrap();
    } else {
        assert!(page.text == expected, "{PAGE}: not the table; write it by: {UPDATE}");
    }
}
