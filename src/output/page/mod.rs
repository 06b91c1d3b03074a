//! What pages have in common that explain themselves in a browser and need nothing else: the frame, pictures of
//! pixels with their scales, plots, tables, numbers.

pub mod axes;
pub mod noise_plot;
pub mod number;
pub mod picture;

use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Styles that all pages share.
const STYLE: &str = include_str!("style.css");

/// A whole page: `style` and `head` come after what all pages have.
pub fn document(title: &str, style: &str, head: &Markup, body: &Markup) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) (PreEscaped(style)) }
                (head)
            }
            body { (body) }
        }
    }
}

/// One row of column names. Names that begin with `*` head columns of text, names that begin with `?` columns of
/// published values.
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

/// A table that scrolls by itself if it is wider than the page; its caption does not scroll.
pub fn table(class: &str, caption: &Markup, rows: &Markup) -> Markup {
    html! {
        div .table {
            p .caption { (caption) }
            div .scroll { table class=(class) { (rows) } }
        }
    }
}
