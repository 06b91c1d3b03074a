//! The programs on the page for Rust programmers are the examples, which the compiler checks.

use super::markdown::{Page, root};
use std::fs;

/// Examples in the order of the page.
const EXAMPLES: [&str; 2] = ["examples/first_render.rs", "crates/accel/examples/first_ray.rs"];

#[test]
fn programs_of_the_library_page_are_the_examples() {
    let page = Page::read("docs/how-to/library.md");
    let blocks: Vec<_> = page.blocks().into_iter().filter(|block| block.info == "rust").collect();
    assert_eq!(blocks.len(), EXAMPLES.len());
    for (block, path) in blocks.iter().zip(EXAMPLES) {
        let example = fs::read_to_string(root().join(path)).unwrap();
        let (_, program) = example.split_once("\n\n").expect("a comment above the program");
        assert_eq!(block.text.trim_end(), program.trim_end(), "line {}: {path}", block.line);
        assert!(page.text.contains(path), "{path} is not named");
        assert!(program.lines().count() <= 20, "{path} is long");
    }
}
