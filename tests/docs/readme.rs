//! Numbers of the README stand on the pages of measurements that it names.
//!
//! A comment before a paragraph or a table of the README names a page and its numbers:
//! `<!-- numbers of docs/measurements/guides.md: 10.8 %; 7.1 % -->`.

use super::markdown::{Page, files};
use std::collections::BTreeSet;

const START: &str = "<!-- numbers of ";

/// Numbers that a comment of the README names.
#[derive(Debug, PartialEq)]
struct Claim {
    /// Line of the comment, from 1.
    line: usize,
    /// Page that has the numbers.
    page: String,
    /// Numbers as they are written on both pages.
    numbers: Vec<String>,
    /// Paragraph, list or table of the README after the comment.
    text: String,
}

/// A text with each sequence of white space as one space.
fn joined(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// All comments of a page with the text after each.
fn claims(text: &str) -> Vec<Claim> {
    let mut found = Vec::new();
    for (start, _) in text.match_indices(START) {
        let line = text[..start].lines().count() + 1;
        let (comment, rest) = text[start + START.len()..].split_once("-->").expect("it ends");
        let (page, numbers) = comment.split_once(": ").expect("a page and a colon");
        let numbers = numbers.split(';').map(joined).collect();
        let text = rest.trim_start().split("\n\n").next().unwrap();
        found.push(Claim { line, page: page.to_owned(), numbers, text: joined(text) });
    }
    found
}

/// Whether a text has a number, not as a part of a longer one.
fn has_number(text: &str, number: &str) -> bool {
    let is_part = |c: char| c.is_ascii_digit();
    text.match_indices(number).any(|(start, found)| {
        let (before, after) = (&text[..start], &text[start + found.len()..]);
        let mut next = after.chars();
        // A point after a number may end a sentence.
        let goes_on = match next.next() {
            Some('.') => next.next().is_some_and(is_part),
            other => other.is_some_and(is_part),
        };
        !before.ends_with(|c: char| is_part(c) || c == '.') && !goes_on
    })
}

/// Problems of a claim of the README, if `page` is the text of the page that it names.
fn problems(claim: &Claim, page: &str) -> Vec<String> {
    let page = joined(page);
    let mut found = Vec::new();
    for number in &claim.numbers {
        for (place, text) in [("README.md", &claim.text), (&claim.page[..], &page)] {
            if !has_number(text, number) {
                found.push(format!("README.md:{}: {place} does not have {number}", claim.line));
            }
        }
    }
    found
}

#[test]
fn numbers_of_the_readme_stand_on_their_pages() {
    let claims = claims(&Page::read("README.md").text);
    assert!(claims.len() >= 4, "there are too few comments with numbers");
    let check = |claim: &Claim| problems(claim, &Page::read(&claim.page).text);
    let problems: Vec<String> = claims.iter().flat_map(check).collect();
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

/// Percentages and factors are results. Those of the README have a comment.
#[test]
fn percentages_of_the_readme_have_a_comment() {
    let text = Page::read("README.md").text;
    let known: BTreeSet<String> = claims(&text).into_iter().flat_map(|c| c.numbers).collect();
    let text = text.split("<!--").map(|part| part.split_once("-->").map_or(part, |(_, t)| t));
    let text = joined(&text.collect::<String>());
    let words: Vec<&str> = text.split(' ').collect();
    let is_result = |two: &&[&str]| two[1].starts_with('%') || two[1].starts_with("times");
    for two in words.windows(2).filter(is_result) {
        let number = two[0].trim_start_matches(['(', '[', '*']);
        if number.parse::<f64>().is_err() && !two[1].starts_with('%') {
            continue; // three times
        }
        let is_known = known.contains(number) || known.contains(&format!("{number} %"));
        assert!(is_known, "README.md: no comment names the page with {number} {}", two[1]);
    }
}

/// Whoever reads a number can check out the program that was measured.
#[test]
fn pages_of_measurements_name_a_commit() {
    let is_page = |path: &std::path::PathBuf| path.extension().is_some_and(|e| e == "md");
    for path in files("docs/measurements").into_iter().filter(is_page) {
        let page = Page::read(path);
        let has_commit = super::claims::hashes(&page.text).next().is_some();
        assert!(has_commit, "{}: it names no commit", page.path.display());
    }
}

/// A front page that is read to its end.
#[test]
fn the_readme_is_short() {
    let lines = Page::read("README.md").text.lines().count();
    assert!(lines <= 180, "README.md has {lines} lines");
}

#[test]
fn missing_numbers_are_noticed() {
    let text = "# a\n\n<!-- numbers of p.md: 5 %;\n7.1 % -->\nIt is 5 %\nand 7.1 %.\n\nNo.\n";
    let claims = claims(text);
    assert_eq!((claims.len(), claims[0].line, &claims[0].page[..]), (1, 3, "p.md"));
    assert_eq!(claims[0].numbers, ["5 %", "7.1 %"]);
    assert!(problems(&claims[0], "5\n% and 7.1 %").is_empty());
    assert_eq!(problems(&claims[0], "5 %"), ["README.md:3: p.md does not have 7.1 %"]);
    let found = ["14 times", "it is 14.", "0.14", "14.5", "114"].map(|text| has_number(text, "14"));
    assert_eq!(found, [true, true, false, false, false]);
}
