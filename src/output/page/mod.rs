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

/// A table that scrolls by itself where it is wider than the page, its caption not.
pub fn table(class: &str, caption: &Markup, rows: &Markup) -> Markup {
    html! {
        div .table {
            p .caption { (caption) }
            div .scroll { table class=(class) { (rows) } }
        }
    }
}
