//! Pages of formats have what their readers read, and readers read what the pages say.

use super::markdown::{Page, files, root};
use std::collections::BTreeSet;
use std::fs;

/// The text of all files of a reader in `crates/import/src/read`.
fn reader(format: &str) -> String {
    let folder = format!("crates/import/src/read/{format}");
    files(&folder).iter().map(|path| fs::read_to_string(root().join(path)).unwrap()).collect()
}

fn is_name(text: &str) -> bool {
    let has_letter = text.bytes().any(|byte| byte.is_ascii_lowercase());
    has_letter && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
}

/// Names before the arrow of the arms of a `match` of strings, such as `"plastic" | "null" => ...`.
fn arms(source: &str) -> Vec<&str> {
    let patterns = source.lines().filter_map(|line| {
        let pattern = line.trim_start().split_once(" => ")?.0;
        pattern.starts_with('"').then_some(pattern)
    });
    let names = patterns.flat_map(|pattern| pattern.split(" | "));
    names.map(|name| name.trim_matches('"')).filter(|name| is_name(name)).collect()
}

/// Names in inline code of the second column of the rows that begin with one of `kinds`, or
/// continue such a row with an empty first cell.
fn supported<'a>(page: &'a str, kinds: &[&str]) -> Vec<&'a str> {
    let mut names = Vec::new();
    let mut is_of_kind = false;
    for line in page.lines().filter(|line| line.starts_with("| ")) {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        if !cells[1].is_empty() {
            is_of_kind = kinds.contains(&cells[1]);
        }
        if is_of_kind && cells.len() > 3 {
            names.extend(cells[2].split('`').skip(1).step_by(2).filter(|name| is_name(name)));
        }
    }
    names
}

/// Names of plugins that a reader matches, in the files that choose by type, must be on the page.
fn assert_documented(format: &str, sources: &[&str], page: &str) {
    let text = Page::read(page).text;
    for file in sources {
        let path = format!("crates/import/src/read/{format}/{file}");
        let source = fs::read_to_string(root().join(&path)).unwrap();
        let names = arms(&source);
        assert!(!names.is_empty(), "{path}: there is no match of names");
        for name in names {
            let is_on_page = text.contains(&format!("`{name}`"));
            assert!(is_on_page, "{page}: `{name}` of {path} is missing");
        }
    }
}

/// Names that a page calls supported must be strings in the reader.
fn assert_read(format: &str, kinds: &[&str], page: &str) {
    let (text, source) = (Page::read(page).text, reader(format));
    let names = supported(&text, kinds);
    assert!(names.len() > 10, "{page}: there are too few names");
    for name in names {
        // The reader may match a prefix apart from the rest of the name.
        let is_read = source.contains(&format!("{name}\""));
        assert!(is_read, "{page}: the reader does not know `{name}`");
    }
}

#[test]
fn page_of_mitsuba_has_the_plugins_of_the_reader() {
    let page = "docs/reference/mitsuba.md";
    assert_documented("mitsuba", &["bsdf/mod.rs", "analytic.rs", "emitter.rs", "sky.rs"], page);
    assert_read("mitsuba", &["sensors", "shapes", "emitters", "BSDFs", "phase functions"], page);
}

#[test]
fn page_of_pbrt_has_the_plugins_of_the_reader() {
    let page = "docs/reference/pbrt.md";
    assert_documented("pbrt", &["shapes.rs", "lights.rs", "camera.rs", "materials.rs"], page);
    assert_read("pbrt", &["cameras", "shapes", "lights", "materials"], page);
}

#[test]
fn page_of_gltf_has_the_extensions_of_the_reader() {
    let (page, source) = (Page::read("docs/reference/gltf.md").text, reader("gltf"));
    let list = page.split("Supported extensions:").nth(1).expect("a list");
    let list = list.split("\n- ").next().unwrap();
    let mut count = 0;
    for name in list.split('`').skip(1).step_by(2) {
        // `_volume` stands for `KHR_materials_volume`.
        let is_part = name.starts_with('_');
        let name = if is_part { format!("KHR_materials{name}") } else { name.to_owned() };
        if name == "KHR_materials" {
            continue;
        }
        count += 1;
        assert!(source.contains(&name), "the reader does not know {name}");
    }
    assert!(count > 12, "there are too few extensions");
    for prefix in ["KHR_", "EXT_"] {
        for rest in source.split(&format!("\"{prefix}")).skip(1) {
            let name = format!("{prefix}{}", rest.split('"').next().unwrap());
            let part = name.replace("KHR_materials_", "_");
            let compressed = ["KHR_draco_mesh_compression", "EXT_meshopt_compression"];
            let is_listed = list.contains(&format!("`{part}`"));
            assert!(is_listed || compressed.contains(&&name[..]), "{name} is not on the page");
        }
    }
}

/// Media are of no struct of the readers, so that the tests above do not ask for them.
#[test]
fn tables_of_other_formats_have_media() {
    for page in ["docs/reference/mitsuba.md", "docs/reference/pbrt.md"] {
        let text = Page::read(page).text;
        let has_row = text.lines().any(|line| line.starts_with("| media |"));
        assert!(has_row, "{page}: its table has no row of media");
    }
}

/// Pages that list the formats of scenes name each extension that the program reads.
#[test]
fn lists_of_formats_have_every_extension() {
    let lists = ["README.md", "docs/how-to/import.md", "docs/reference/scene-format.md"];
    for path in lists {
        let text = Page::read(path).text;
        for extension in bdpm::import::SCENE_EXTENSIONS {
            let is_named = text.contains(&format!(".{extension}`"));
            assert!(is_named, "{path}: scenes of the type .{extension} are missing");
        }
    }
}

/// Fields of the structs of a reader that stand for tables of a scene file.
fn fields(source: &str) -> Vec<&str> {
    let (mut names, mut is_table) = (Vec::new(), false);
    for line in source.lines() {
        if line.ends_with('{') && line.contains("struct ") {
            is_table = line.contains("Table {");
        }
        is_table &= line != "}";
        let name = line.trim_start().trim_start_matches("pub ").split_once(": ");
        names.extend(name.map(|(name, _)| name).filter(|name| is_table && is_name(name)));
    }
    names
}

#[test]
fn keys_of_scene_files_are_documented() {
    let page = Page::read("docs/reference/scene-format.md");
    let blocks = page.blocks();
    let code = page.inline_code().into_iter().map(|(_, code)| code);
    let code = code.chain(blocks.iter().map(|block| &block.text[..]));
    let is_separator = |c: char| !c.is_ascii_alphanumeric() && c != '_';
    let words: BTreeSet<&str> = code.flat_map(|code| code.split(is_separator)).collect();
    let source = reader("toml");
    let keys = fields(&source);
    assert!(keys.len() > 80, "there are too few keys: {}", keys.len());
    // `type` is a word of Rust.
    let keys = keys.iter().map(|key| if *key == "kind" { "type" } else { *key });
    let settings = bdpm::Settings::NAMES.iter().copied();
    // Files have `resolution` instead, and no window of the image.
    let settings = settings.filter(|name| !["width", "height", "crop"].contains(name));
    let missing: Vec<&str> = keys.chain(settings).filter(|key| !words.contains(key)).collect();
    assert!(missing.is_empty(), "docs/reference/scene-format.md: {missing:?} are missing");
}

#[test]
fn arms_and_rows_are_found() {
    let source = "    \"plastic\" | \"null\" => a,\n    other => b,\n    \"x y\" => c,\n";
    assert_eq!(arms(source), ["plastic", "null"]);
    let page = "| BSDFs | `a`, `b` | `c` |\n| | `d` | e |\n| media | `f` | g |\n";
    assert_eq!(supported(page, &["BSDFs"]), ["a", "b", "d"]);
    let source = "pub struct A {\n    x: u8,\n}\npub struct BTable {\n    /// Is: a.\n    pub c: f32,\n    \
                  d: Vec<u8>,\n}\nfn f() {\n    let e: u8 = 1;\n}\n";
    assert_eq!(fields(source), ["c", "d"]);
}
