//! No stage of the library names a later one. The stages are the modules of `src/lib.rs` in its
//! order; the program, `src/main.rs` and `src/cli`, comes after them all.

use proc_macro2::{Delimiter, Ident, TokenStream, TokenTree};
use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

/// A name that a path begins with at the root of the library.
#[derive(Debug, PartialEq)]
struct Named {
    what: String,
    line: usize,
}

/// Every path of `code` that begins at the root: by `crate`, or by as many `super` as it takes from
/// `depth` modules below.
fn named(code: TokenStream, depth: usize) -> Vec<Named> {
    let trees: Vec<TokenTree> = code.into_iter().collect();
    let mut found = Vec::new();
    for (i, tree) in trees.iter().enumerate() {
        match tree {
            TokenTree::Group(group) => {
                let is_module = group.delimiter() == Delimiter::Brace
                    && i >= 2
                    && trees[i - 2].to_string() == "mod";
                found.extend(named(group.stream(), depth + usize::from(is_module)));
            }
            TokenTree::Ident(first) if i == 0 || !is_colon(&trees[i - 1]) => {
                found.extend(at_root(first, &trees[i + 1..], depth));
            }
            _ => {}
        }
    }
    found
}

/// Names at the root of the path that begins with `first`, `depth` modules below the root, and goes
/// on as `rest`.
fn at_root(first: &Ident, mut rest: &[TokenTree], depth: usize) -> Vec<Named> {
    let mut above = match first.to_string().as_str() {
        "crate" => depth,
        "super" => 1,
        "self" => 0,
        _ => return Vec::new(),
    };
    while let [a, b, next, after @ ..] = rest
        && is_colon(a)
        && is_colon(b)
    {
        match next {
            TokenTree::Ident(ident) if ident == "super" => above += 1,
            TokenTree::Group(group) if above == depth => return firsts(group.stream()),
            _ if above == depth => return vec![name(next)],
            _ => break,
        }
        rest = after;
    }
    Vec::new()
}

/// The first names of each branch of a tree of imports.
fn firsts(branches: TokenStream) -> Vec<Named> {
    let trees: Vec<TokenTree> = branches.into_iter().collect();
    let is_comma = |tree: &TokenTree| tree.to_string() == ",";
    trees.split(is_comma).filter_map(|branch| branch.first().map(name)).collect()
}

fn name(tree: &TokenTree) -> Named {
    Named { what: tree.to_string(), line: tree.span().start().line }
}

fn is_colon(tree: &TokenTree) -> bool {
    matches!(tree, TokenTree::Punct(mark) if mark.as_char() == ':')
}

/// The stages in order, and for each name at the root the stage where it comes from.
struct Stages {
    order: Vec<String>,
    origin: HashMap<String, usize>,
}

impl Stages {
    /// From the modules and the re-exports of `src/lib.rs`.
    fn new(root: TokenStream) -> Self {
        let words: Vec<String> = flat(root);
        let mut stages = Self { order: Vec::new(), origin: HashMap::new() };
        for three in words.windows(3) {
            if let [keyword, module, end] = three
                && keyword == "mod"
                && end == ";"
            {
                stages.origin.insert(module.clone(), stages.order.len());
                stages.order.push(module.clone());
            }
        }
        for statement in words.split(|word| word == ";") {
            let Some(at) = statement.iter().position(|word| word == "use") else { continue };
            let from = stages.origin[&statement[at + 1]];
            // The last word of each branch; what comes before it is followed by `::` or `as`.
            for (i, word) in statement.iter().enumerate().skip(at + 2) {
                if matches!(statement.get(i + 1).map(String::as_str), None | Some("," | "}")) {
                    stages.origin.insert(word.clone(), from);
                }
            }
        }
        stages
    }

    /// Violations in a file of a stage: `file:line` and the reason.
    fn problems(&self, stage: usize, file: &str, depth: usize, code: TokenStream) -> Vec<String> {
        let name = &self.order[stage];
        let problem = |Named { what, line }| match self.origin.get(&what) {
            None => Some(format!("{file}:{line}: `crate::{what}` is neither a stage nor of one")),
            Some(&other) if other > stage => {
                let other = &self.order[other];
                Some(format!("{file}:{line}: `{name}` names `{what}` of the later stage `{other}`"))
            }
            Some(_) => None,
        };
        named(code, depth).into_iter().filter_map(problem).collect()
    }
}

/// The words and marks, those within braces too, which are kept.
fn flat(code: TokenStream) -> Vec<String> {
    let mut words = Vec::new();
    for tree in code {
        match tree {
            TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => {
                words.extend(flat(group.stream()));
                words.push("}".into());
            }
            tree => words.push(tree.to_string()),
        }
    }
    words
}

fn parse(path: &Path) -> TokenStream {
    let text = fs::read_to_string(path).unwrap();
    text.parse().unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// All sources below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
    found.sort();
    found
}

#[test]
fn no_stage_names_a_later_one() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let stages = Stages::new(parse(&root.join("lib.rs")));
    let mut problems = Vec::new();
    let mut seen = vec![0; stages.order.len()];
    for path in sources(&root) {
        // The modules from the root to the file's own.
        let inside = path.strip_prefix(&root).unwrap().with_extension("");
        let mut modules: Vec<_> = inside.iter().map(|part| part.to_str().unwrap()).collect();
        modules.pop_if(|last| *last == "mod");
        if matches!(modules[0], "lib" | "main" | "cli") {
            continue;
        }
        let file = format!("src/{}", path.strip_prefix(&root).unwrap().display());
        match stages.order.iter().position(|stage| stage == modules[0]) {
            None => problems.push(format!("{file}: `{}` is not in src/lib.rs", modules[0])),
            Some(stage) => {
                seen[stage] += 1;
                problems.extend(stages.problems(stage, &file, modules.len(), parse(&path)));
            }
        }
    }
    assert!(seen.iter().all(|&files| files > 0), "{:?} {seen:?}", stages.order);
    assert!(problems.is_empty(), "the order is that of src/lib.rs\n{}", problems.join("\n"));
}

#[test]
fn a_later_stage_is_found_wherever_it_is_named() {
    let root = "pub mod early; #[cfg(a)] pub mod late; mod last; pub use late::{a::Thing, B as C};
                pub use early::Good; pub use last::other as another;";
    let stages = Stages::new(root.parse().unwrap());
    let lines = |code: &str, depth| {
        let problems = stages.problems(0, "f.rs", depth, code.parse().unwrap());
        problems.iter().map(|p| p.split(':').nth(1).unwrap().parse().unwrap()).collect()
    };
    let found = |code: &str, depth| -> Vec<usize> { lines(code, depth) };
    // Not in comments, strings, local paths, or paths of other crates.
    let harmless = r##"
        //! crate::late
        /* crate::late */ use crate::early::{late, Good}; use crate::Good;
        pub(crate) fn f<'a>(x: &'a str) { "crate::late"; r#"crate::late"#; std::late::x(); }
        use self::late::x; use super::early::late; mod late { use super::late; }
    "##;
    assert_eq!(found(harmless, 1), [0; 0]);
    assert_eq!(
        found("use crate::late::x;\nfn f() -> crate::Thing { crate::C::new() }", 1),
        [1, 2, 2]
    );
    assert_eq!(
        found("use crate::{\n  early::x,\n  late::{self, y},\n};\nuse crate::*;", 1),
        [3, 5]
    );
    assert_eq!(found("use super::late;\nmod tests {\n  use super::super::another; }", 1), [1, 3]);
    assert_eq!(found("use super::late;\nuse super::super::late;", 2), [2]);
    assert_eq!(found("m!($crate::late::X);\nlet x = [crate::missing()];", 3), [1, 2]);
    assert_eq!(stages.problems(1, "f.rs", 1, "use crate::Thing;".parse().unwrap()), [""; 0]);
}
