//! Links, anchors and pictures exist; every page and picture can be reached.

use super::markdown::{Link, Page, files, pages, root};
use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

/// The path from the root that a relative link of `page` means, and its anchor.
fn resolve(page: &Path, target: &str) -> (PathBuf, Option<String>) {
    let (path, anchor) = target.split_once('#').map_or((target, None), |(p, a)| (p, Some(a)));
    let mut resolved = match path {
        "" => page.to_owned(),
        _ => page.parent().unwrap().join(path),
    };
    let mut parts: Vec<Component> = Vec::new();
    for part in resolved.components() {
        match part {
            Component::ParentDir if !parts.is_empty() => drop(parts.pop()),
            part => parts.push(part),
        }
    }
    resolved = parts.iter().collect();
    (resolved, anchor.map(str::to_owned))
}

fn is_external(link: &Link) -> bool {
    ["http://", "https://", "mailto:"].iter().any(|scheme| link.target.starts_with(scheme))
}

/// What is wrong with a link of `page`.
fn problem(page: &Page, link: &Link, all: &[Page]) -> Option<String> {
    let (path, anchor) = resolve(&page.path, &link.target);
    let place = format!("{}:{}: {}", page.path.display(), link.line, link.target);
    if !root().join(&path).exists() {
        return Some(format!("{place}: there is no {}", path.display()));
    }
    let anchor = anchor?;
    let exists = match all.iter().find(|page| page.path == path) {
        Some(target) => target.anchors().contains(&anchor),
        None => Page::read(path).anchors().contains(&anchor),
    };
    (!exists).then(|| format!("{place}: there is no such heading"))
}

#[test]
fn relative_links_lead_to_files_and_headings() {
    let all = pages();
    let problems: Vec<String> = all
        .iter()
        .flat_map(|page| page.links().into_iter().map(move |link| (page, link)))
        .filter(|(_, link)| !is_external(link))
        .filter_map(|(page, link)| problem(page, &link, &all))
        .collect();
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

#[test]
fn broken_links_are_noticed() {
    let text = "# Title\n[a](nowhere.md) [b](README.md#title) [c](README.md#nothing)";
    let page = Page { path: "docs/x.md".into(), text: text.into() };
    let links = page.links();
    let all = [Page { path: "docs/README.md".into(), text: "# Title".into() }];
    let problems: Vec<_> = links.iter().map(|link| problem(&page, link, &all)).collect();
    assert!(problems[0].as_ref().is_some_and(|p| p.ends_with("there is no docs/nowhere.md")));
    assert_eq!(problems[1], None);
    assert!(problems[2].as_ref().is_some_and(|p| p.ends_with("there is no such heading")));
}

#[test]
fn index_leads_to_every_page_and_picture() {
    let all = pages();
    let mut reached = BTreeSet::from([PathBuf::from("docs/README.md"), "README.md".into()]);
    let mut to_do: Vec<PathBuf> = reached.iter().cloned().collect();
    while let Some(path) = to_do.pop() {
        let Some(page) = all.iter().find(|page| page.path == path) else { continue };
        for link in page.links().iter().filter(|link| !is_external(link)) {
            let (target, _) = resolve(&path, &link.target);
            if reached.insert(target.clone()) {
                to_do.push(target);
            }
        }
    }
    let lost: Vec<_> = files("docs").into_iter().filter(|file| !reached.contains(file)).collect();
    assert!(lost.is_empty(), "no page links to {lost:?}");
}
