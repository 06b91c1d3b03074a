//! The site has every page of the documentation.

use super::markdown::{Page, files};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

const CONTENTS: &str = "docs/SUMMARY.md";

#[test]
fn contents_of_the_site_have_every_page_once() {
    let page = Page::read(CONTENTS);
    let links: Vec<PathBuf> =
        page.links().iter().map(|link| Path::new("docs").join(&link.target)).collect();
    let listed: BTreeSet<&PathBuf> = links.iter().collect();
    assert_eq!(listed.len(), links.len(), "{CONTENTS} has a page twice");
    for path in files("docs").iter().filter(|path| path.extension().is_some_and(|e| e == "md")) {
        let is_contents = path.to_str() == Some(CONTENTS);
        assert!(is_contents || listed.contains(path), "{CONTENTS}: {} is missing", path.display());
    }
}

/// The search of the site and the history of a browser show the name of the entry.
#[test]
fn names_in_the_contents_are_unique() {
    let page = Page::read(CONTENTS);
    let entries = page.text.lines().filter_map(|line| line.split_once('[')?.1.split_once("]("));
    let names: Vec<&str> = entries.map(|(name, _)| name).collect();
    let unique: BTreeSet<&&str> = names.iter().collect();
    assert_eq!(unique.len(), names.len(), "{CONTENTS}: two entries have one name");
}
