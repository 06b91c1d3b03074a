//! Pages that the program wrote: whether they are whole, and what is in them.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;

/// Elements that have no end.
const VOID: [&str; 6] = ["meta", "link", "img", "input", "br", "hr"];

/// Panics unless every element ends where it should and nothing outside of the file is asked for.
#[track_caller]
pub fn assert_whole(html: &str) {
    assert!(html.starts_with("<!DOCTYPE html>") && html.ends_with("</html>"), "cut off");
    let mut open: Vec<&str> = Vec::new();
    let mut rest = &html["<!DOCTYPE html>".len()..];
    while let Some(begin) = rest.find('<') {
        let tag = &rest[begin + 1..];
        let end = tag.find('>').expect("a tag ends");
        let (inside, after) = (&tag[..end], &tag[end + 1..]);
        assert!(inside.matches('"').count().is_multiple_of(2), "<{inside}>");
        assert!(inside.matches(" class=\"").count() <= 1, "<{inside}>");
        let name = inside.trim_start_matches('/').split_whitespace().next().unwrap();
        if inside.starts_with('/') {
            assert_eq!(open.pop(), Some(name), "{open:?}");
        } else if !VOID.contains(&name) && !inside.ends_with('/') {
            open.push(name);
        }
        for attribute in [" src=\"", " href=\"", " action=\""] {
            for value in inside.split(attribute).skip(1) {
                assert!(value.starts_with("data:"), "{value:.80}");
            }
        }
        // Neither scripts nor styles are elements.
        rest = match (name, inside.starts_with('/')) {
            ("script" | "style", false) => &after[after.find(&format!("</{name}>")).unwrap()..],
            _ => after,
        };
    }
    assert!(open.is_empty(), "{open:?} never end");
    let words = html.split("base64,").map(|part| match part.split_once('"') {
        Some((_, text)) => text,
        None => part,
    });
    let words: String = words.collect();
    for word in ["http:", "https:", "//www", "url(", "@import", "NaN", ">inf", "-inf", "\u{fffd}"] {
        assert!(!words.contains(word), "{word}");
    }
}

/// The PNG files inside, by their alternative text.
pub fn pictures(html: &str) -> Vec<(String, Vec<u8>)> {
    let picture = |part: &str| {
        let tag = part.split('>').next().unwrap();
        let attribute = |name: &str| {
            let value = tag.split(&format!("{name}=\"")).nth(1).expect(name);
            value.split('"').next().unwrap().to_owned()
        };
        let data = attribute("src");
        let data = data.strip_prefix("data:image/png;base64,").unwrap();
        (attribute("alt"), STANDARD.decode(data).unwrap())
    };
    html.split("<img ").skip(1).map(picture).collect()
}

/// A share in percent as pages show it.
pub fn percent(share: &Value) -> String {
    format!("{}\u{202f}%", bdpm::image_io::number(100.0 * share.as_f64().unwrap()))
}
