//! Elements of HTML pages without external resources: frame, pictures with their scales, plots,
//! tables and numbers.

pub mod axes;
pub mod noise_plot;
pub mod number;
pub mod packed;
pub mod picture;
pub mod picture_scale;

use bdpm_core::base::names::visible;
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Style sheet of all pages.
const STYLE: &str = include_str!("style.css");

/// Content security policy of all pages. It allows only the content of the file: no external
/// script, style, picture or address.
const POLICY: &str =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// A whole page. `style` and `head` follow the shared style and head. Characters that control the
/// direction of text, which names from files may have, are replaced.
pub fn document(title: &str, style: &str, head: &Markup, body: &Markup) -> Markup {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) (PreEscaped(style)) }
                (head)
            }
            body { (body) }
        }
    };
    PreEscaped(page.into_string().chars().map(visible).collect())
}

/// One row of column names. A name with the prefix `*` heads a column of text, one with the prefix
/// `?` a column of published values.
pub fn header(names: &[&str]) -> Markup {
    html! {
        thead {
            tr {
                @for name in names {
                    @let text = name.starts_with('*').then_some("text");
                    @let paper = name.starts_with('?').then_some("paper");
                    th scope="col" class=[text.or(paper)] { (name.trim_start_matches(['*', '?'])) }
                }
            }
        }
    }
}

/// A table that scrolls if it is wider than the page. Its caption does not scroll.
pub fn table(class: &str, caption: &Markup, rows: &Markup) -> Markup {
    html! {
        div .table {
            p .caption { (caption) }
            div .scroll { table class=(class) { (rows) } }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_page_has_the_content_policy_before_any_content() {
        let page = document("a", "", &html! {}, &html! { p { "b" } }).into_string();
        let policy = page.find("http-equiv=\"Content-Security-Policy\"").expect("a policy");
        assert!(page.contains("default-src 'none'; img-src data:"), "{page}");
        let hostile = html! { p { "a\u{202e}b\x1b" } };
        let page_of_hostile = document("\u{2066}", "", &html! {}, &hostile).into_string();
        assert!(page_of_hostile.contains("a\u{fffd}b\u{fffd}"), "{page_of_hostile}");
        assert!(page_of_hostile.contains("<title>\u{fffd}</title>"), "{page_of_hostile}");
        assert!(["<title>", "<style>", "<body>"].iter().all(|tag| page.find(tag) > Some(policy)));
    }
}
