//! The theory: numbers of equations are unique, and its index leads from each number to its
//! chapter.

use super::markdown::{Page, files};
use std::collections::{BTreeMap, BTreeSet};

/// Page with the table of chapters and their equations: the page that sources cite.
const INDEX: &str = "docs/explanation/theory.md";
/// Folder of the chapters.
const CHAPTERS: &str = "docs/explanation/theory";

/// Numbers of equations by the name of the file that has them, without its extension.
type Numbers = BTreeMap<String, Vec<String>>;

/// Numbers in the tags of a block of formulas.
fn tags(formula: &str) -> impl Iterator<Item = String> {
    formula.split("\\tag{").skip(1).filter_map(|rest| Some(rest.split_once('}')?.0.to_owned()))
}

/// Numbers of the equations of a page in their order.
fn numbers(page: &Page) -> Vec<String> {
    let blocks = page.blocks();
    let formulas = blocks.iter().filter(|block| block.info == "math");
    formulas.flat_map(|block| tags(&block.text)).collect()
}

/// All chapters with the numbers of their equations.
fn chapters() -> Numbers {
    let mut found = Numbers::new();
    for path in files(CHAPTERS) {
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        found.insert(name, numbers(&Page::read(path)));
    }
    found
}

/// The chapter and the numbers of a row of the index, `| [Media](theory/media.md) | 9a | (37a) |`.
fn row(line: &str) -> Option<(String, Vec<String>)> {
    let (_, link) = line.strip_prefix("| [")?.split_once("](theory/")?;
    let (name, _) = link.split_once(".md)")?;
    let cell = line.trim_end().trim_end_matches('|').rsplit('|').next()?;
    let number = |text: &str| text.trim().trim_matches(['(', ')']).to_owned();
    Some((name.to_owned(), cell.split(',').map(number).collect()))
}

/// Numbers of all equations of the theory.
pub fn equations() -> BTreeSet<String> {
    chapters().into_values().flatten().collect()
}

#[test]
fn equation_numbers_are_unique() {
    let all: Vec<String> = chapters().into_values().flatten().collect();
    assert!(all.len() > 150, "there are too few equations: {}", all.len());
    let mut seen = BTreeSet::new();
    let repeated: Vec<_> = all.iter().filter(|number| !seen.insert(*number)).collect();
    assert!(repeated.is_empty(), "several equations have the number {repeated:?}");
}

#[test]
fn index_of_the_theory_leads_from_numbers_to_chapters() {
    let stated: Numbers = Page::read(INDEX).text.lines().filter_map(row).collect();
    let mut actual = chapters();
    // The bibliography has no equations.
    actual.retain(|_, numbers| !numbers.is_empty());
    assert_eq!(stated, actual, "{INDEX} has other numbers than the chapters");
}

/// The site shows the number of a formula beside it: one number for each.
#[test]
fn formulas_have_at_most_one_number() {
    for path in files(CHAPTERS) {
        let page = Page::read(path);
        for block in page.blocks() {
            let place = format!("{}:{}", page.path.display(), block.line);
            assert!(tags(&block.text).count() <= 1, "{place}: give each number a block of its own");
        }
    }
}

#[test]
fn tags_and_rows_are_found() {
    let text = "```math\na \\tag{1}\n```\n```text\nb \\tag{2}\n```\n```math\nc \\tag{93h}\n```\n";
    let page = Page { path: "p.md".into(), text: text.into() };
    assert_eq!(numbers(&page), ["1", "93h"]);
    let (name, numbers) = row("| [Media](theory/media.md) | 9a, 9b | (37a), (37b) |").unwrap();
    assert_eq!((&name[..], numbers), ("media", vec!["37a".to_owned(), "37b".to_owned()]));
    assert_eq!(row("| chapter | sections | equations |"), None);
}
