//! `--report FILE.html`: one page that tells of a render in any browser, renewed while it runs.
//!
//! The page is a single file that asks for nothing else, which its own content policy enforces. It appears whole or
//! not at all, and loads itself again until the render is done; zoom, slider and place stay as they were.

mod choice;
mod convergence;
mod maps;
mod sections;

use super::render_report::Report;
use super::scene_input::SceneInput;
use bdpm::base::atomic::write_atomically;
use bdpm::base::error::Result;
use bdpm::job::RenderState;
use bdpm::output::page::document;
use bdpm::render::block::CombinedImage;
use bdpm::settings::provenance::Provenance;
use maud::{Markup, PreEscaped, html};
use std::path::PathBuf;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Nothing but what is in the file: no script, style, picture or address of anywhere else.
const POLICY: &str =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// Rendering time per time of writing the page, at least: it takes at most 2 % of the time.
const SHARE: u32 = 50;

/// Time between two pages at the least and at the most, as far as [`SHARE`] allows.
const PAUSE: [Duration; 2] = [Duration::from_secs(2), Duration::from_secs(30)];

/// Part of the time so far that passes between two, within [`PAUSE`].
const PAUSE_SHARE: u32 = 40;

/// When the page is written with an image for the first time at the earliest, and per pixel.
const FIRST: Duration = Duration::from_millis(500);
/// See [`FIRST`].
const FIRST_PIXEL: Duration = Duration::from_micros(10);

/// Pixels of a picture at the most while rendering goes on; larger ones are shown at a whole part of their size.
const LIVE_PIXELS: u64 = 1 << 20;

/// A render under way, or one that has ended.
pub struct Snapshot<'a> {
    pub input: &'a SceneInput,
    pub state: &'a RenderState,
    pub image: &'a CombinedImage<'a>,
    /// The report, once the render has ended.
    pub report: Option<&'a Report<'a>>,
}

/// The page and when it is written.
pub struct Page {
    pub path: PathBuf,
    /// What was typed.
    command: String,
    next: Duration,
    /// Time that writing it took.
    spent: Duration,
}

impl Page {
    /// To be written to `path`.
    pub fn new(path: PathBuf) -> Self {
        Self { path, command: command(), next: Duration::ZERO, spent: Duration::ZERO }
    }

    /// Writes it before there is anything to see.
    pub fn announce(&mut self, input: &SceneInput, provenance: &Provenance) -> Result<()> {
        self.next = (FIRST_PIXEL * provenance.settings.pixels() as u32).clamp(FIRST, PAUSE[1]);
        let body = html! {
            main {
                (sections::heading(provenance, "starting", "running"))
                p .lead { "The picture will appear here. This page renews itself." }
                (sections::setup(input, provenance, None, &self.command))
            }
        };
        self.save(&provenance.scene, &body, Some(PAUSE[0]))
    }

    /// Whether it is to be written anew, after so much time of rendering.
    pub fn is_due(&self, elapsed: Duration) -> bool {
        elapsed >= self.next
    }

    /// Writes it.
    pub fn write(&mut self, moment: &Snapshot) -> Result<()> {
        let (start, elapsed) = (Instant::now(), moment.state.elapsed());
        let body = moment.state.threads().install(|| self.body(moment));
        // Known before it is written, but for the time that the disk takes.
        let [least, most] = PAUSE;
        let pause = (elapsed / PAUSE_SHARE).clamp(least, most).max(start.elapsed() * SHARE);
        let reload = moment.report.is_none().then_some(pause);
        let saved = self.save(&moment.state.provenance.scene, &body, reload);
        self.spent += start.elapsed();
        self.next = elapsed + pause.max(start.elapsed() * SHARE);
        saved
    }

    fn body(&self, moment: &Snapshot) -> Markup {
        let maps = maps::Maps::new(moment, LIVE_PIXELS);
        let cost = self.spent.as_secs_f64() / moment.state.elapsed().as_secs_f64().max(1e-9);
        html! {
            main {
                (sections::summary(moment))
                (maps.viewer(moment.image.resolution()))
                (maps.errors(moment))
                section {
                    h2 { "How the error falls" }
                    (convergence::section(moment))
                }
                (choice::section(moment))
                (maps.sources(moment))
                (sections::outcome(moment))
                (sections::setup(moment.input, &moment.state.provenance, Some(&moment.state.accel_name), &self.command))
                footer {
                    p {
                        "Written by bdpm " (moment.state.provenance.version) " "
                        time data-time=(unix_milliseconds()) {}
                        ". Writing this page took " (format!("{:.2} %", 100.0 * cost)) " of the time so far."
                    }
                }
            }
        }
    }

    /// `reload` tells when there may be a newer one, if there will be.
    fn save(&self, scene: &str, body: &Markup, reload: Option<Duration>) -> Result<()> {
        let seconds = reload.map(|pause| pause.as_secs_f64().ceil());
        let head = html! {
            meta http-equiv="Content-Security-Policy" content=(POLICY);
            meta name="color-scheme" content="light dark";
            link rel="icon" href="data:,";
            @if let Some(seconds) = seconds {
                noscript { meta http-equiv="refresh" content=(seconds); }
            }
        };
        let script = PreEscaped(include_str!("script.js"));
        let body = html! {
            (body)
            script data-reload=[seconds] data-time=(unix_milliseconds()) { (script) }
        };
        let title = match reload {
            Some(_) => format!("{scene}: rendering"),
            None => format!("{scene}: done"),
        };
        let html = document(&title, include_str!("style.css"), &head, &body).into_string();
        write_atomically(&self.path, |file| file.write_all(html.as_bytes()))
    }
}

fn unix_milliseconds() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as u64)
}

/// What was typed, to be typed again.
fn command() -> String {
    let words = std::env::args_os().skip(1).map(|word| quoted(&word.to_string_lossy()));
    ["bdpm".to_owned()].into_iter().chain(words).collect::<Vec<_>>().join(" ")
}

/// A word as shells take it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./:=,%+@".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_where_shells_need_it() {
        let words = ["render", "--target-error", "2%", "my scene", "it's", ""].map(quoted);
        assert_eq!(words, ["render", "--target-error", "2%", "'my scene'", r"'it'\''s'", "''"]);
    }
}
