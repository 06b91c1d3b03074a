//! Pages of the documentation: code blocks, headings, links.

use std::fs;
use std::path::{Path, PathBuf};

/// A page in Markdown.
pub struct Page {
    /// Path from the root of the repository.
    pub path: PathBuf,
    /// The whole text.
    pub text: String,
}

/// A fenced code block.
pub struct Block {
    /// Words after the opening fence, such as `sh not-run`.
    pub info: String,
    /// Content without the fences.
    pub text: String,
    /// Line of the opening fence, from 1.
    pub line: usize,
}

/// A link or picture.
#[derive(Debug)]
pub struct Link {
    /// Target as written.
    pub target: String,
    /// Line, from 1.
    pub line: usize,
}

/// Root of the repository.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All files below `folder` of the repository, as paths from its root.
pub fn files(folder: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![PathBuf::from(folder)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(root().join(&folder)).unwrap() {
            let entry = entry.unwrap();
            let path = folder.join(entry.file_name());
            match entry.file_type().unwrap().is_dir() {
                true => folders.push(path),
                false => found.push(path),
            }
        }
    }
    found.sort();
    found
}

impl Page {
    /// Reads a page by its path from the root.
    pub fn read(path: impl Into<PathBuf>) -> Self {
        let path = path.into();
        let text = fs::read_to_string(root().join(&path))
            .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        Self { path, text }
    }

    /// The fenced code blocks in order.
    pub fn blocks(&self) -> Vec<Block> {
        let mut blocks = Vec::new();
        let mut open: Option<Block> = None;
        for (index, line) in self.text.lines().enumerate() {
            let fence = line.trim_start().strip_prefix("```");
            match (&mut open, fence) {
                (Some(_), Some(_)) => blocks.extend(open.take()),
                (Some(block), None) => block.text += &format!("{line}\n"),
                (None, Some(info)) => {
                    let info = info.to_owned();
                    open = Some(Block { info, text: String::new(), line: index + 1 });
                }
                (None, None) => {}
            }
        }
        assert!(open.is_none(), "{}: a code block does not end", self.path.display());
        blocks
    }

    /// The lines outside of code blocks with their numbers.
    fn prose(&self) -> impl Iterator<Item = (usize, &str)> {
        let mut is_code = false;
        self.text.lines().enumerate().filter_map(move |(index, line)| {
            let is_fence = line.trim_start().starts_with("```");
            is_code ^= is_fence;
            (!is_code && !is_fence).then_some((index + 1, line))
        })
    }

    /// Targets of all links and pictures.
    pub fn links(&self) -> Vec<Link> {
        let mut links = Vec::new();
        for (line, text) in self.prose() {
            let text = without_code(text);
            for rest in text.split("](").skip(1) {
                let target = rest.split(')').next().unwrap().to_owned();
                links.push(Link { target, line });
            }
        }
        links
    }

    /// Contents of inline code.
    pub fn inline_code(&self) -> Vec<(usize, &str)> {
        self.prose()
            .flat_map(|(line, text)| text.split('`').skip(1).step_by(2).map(move |s| (line, s)))
            .collect()
    }

    /// Anchors of all headings, as GitHub makes them.
    pub fn anchors(&self) -> Vec<String> {
        let mut anchors: Vec<String> = Vec::new();
        for (_, line) in self.prose() {
            let Some((marks, title)) = line.split_once(' ') else { continue };
            if marks.is_empty() || marks.chars().any(|c| c != '#') {
                continue;
            }
            let anchor = anchor(title);
            let repeated = anchors.iter().filter(|a| **a == anchor).count();
            anchors.push(if repeated > 0 { format!("{anchor}-{repeated}") } else { anchor });
        }
        anchors
    }
}

fn anchor(title: &str) -> String {
    let kept = title.trim().chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.map(|c| if c == ' ' { '-' } else { c.to_ascii_lowercase() }).collect()
}

/// The text with inline code removed.
fn without_code(text: &str) -> String {
    text.split('`').step_by(2).collect()
}

/// All pages that are checked.
pub fn pages() -> Vec<Page> {
    let markdown = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "md");
    let top = [
        "README.md",
        "CONTRIBUTING.md",
        "CHANGELOG.md",
        "blender/README.md",
        "python/README.md",
        "sys/README.md",
    ];
    let docs = files("docs").into_iter().filter(markdown);
    top.into_iter().map(PathBuf::from).chain(docs).map(Page::read).collect()
}

#[test]
fn markdown_of_a_page_is_parsed() {
    let text = "# A `b` c, d\n\n[x](y.md#z) and `[no](link)`\n\n  ```sh not-run\n  bdpm\n  ```\n## A\n## A\n";
    let page = Page { path: "p.md".into(), text: text.into() };
    assert_eq!(page.anchors(), ["a-b-c-d", "a", "a-1"]);
    let links = page.links();
    assert_eq!((links.len(), &links[0].target[..], links[0].line), (1, "y.md#z", 3));
    let blocks = page.blocks();
    assert_eq!((blocks.len(), &blocks[0].info[..], blocks[0].line), (1, "sh not-run", 5));
    assert_eq!(blocks[0].text.trim(), "bdpm");
    assert_eq!(page.inline_code(), [(1, "b"), (3, "[no](link)")]);
}
