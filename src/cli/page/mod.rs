//! `--report FILE.html`: a page about a render for any browser, updated while the render runs.
//!
//! The page is a single file without external resources, which its content policy enforces. It is
//! written atomically, and reloads itself until the render is done. Zoom, slider and scroll
//! position are kept.

mod audit;
mod choice;
mod convergence;
mod maps;
mod sections;

use super::render_report::RenderReport;
use super::scene_input::SceneInput;
use bdpm::base::atomic::write_atomically;
use bdpm::base::error::Result;
use bdpm::job::RenderState;
use bdpm::render::block::CombinedImage;
use bdpm::report::document;
use bdpm::settings::provenance::Provenance;
use maud::{Markup, PreEscaped, html};
use std::path::PathBuf;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Minimum ratio of rendering time to the time for writing the page, which then takes at most 2 %
/// of the time.
const SHARE: u32 = 50;

/// Minimum and maximum time between two pages, as far as [`SHARE`] allows.
const PAUSE: [Duration; 2] = [Duration::from_secs(2), Duration::from_secs(30)];

/// Ratio of the rendering time to the time between two pages, within [`PAUSE`].
const PAUSE_SHARE: u32 = 40;

/// Minimum rendering time before the first page with an image.
const FIRST: Duration = Duration::from_millis(500);
/// Rendering time per pixel before the first page with an image.
const FIRST_PIXEL: Duration = Duration::from_micros(10);

/// Maximum number of pixels of a picture during the render. Larger pictures are shrunk by an
/// integer factor.
const LIVE_PIXELS: u64 = 1 << 20;

/// Style sheet of pages about images.
pub const STYLE: &str = include_str!("style.css");

/// A render at one moment, or at its end.
pub struct Snapshot<'a> {
    pub input: &'a SceneInput,
    pub state: &'a RenderState,
    pub image: &'a CombinedImage<'a>,
    /// The report, once the render has ended.
    pub report: Option<&'a RenderReport<'a>>,
}

/// The page, and the time at which it is written next.
pub struct Page {
    pub path: PathBuf,
    /// The command line.
    command: String,
    next: Duration,
    /// Time that writing it took.
    spent: Duration,
}

impl Page {
    /// A page that is written to `path`.
    pub fn new(path: PathBuf) -> Self {
        Self { path, command: command(), next: Duration::ZERO, spent: Duration::ZERO }
    }

    /// Writes the page before the first image.
    pub fn announce(&mut self, input: &SceneInput, provenance: &Provenance) -> Result<()> {
        self.next = (FIRST_PIXEL * provenance.settings.pixels() as u32).clamp(FIRST, PAUSE[1]);
        let body = html! {
            main {
                (sections::heading(provenance, "starting", "running"))
                p .lead { "The picture will appear here. This page updates itself." }
                (sections::setup(input, provenance, None, &self.command))
            }
        };
        self.save(&provenance.scene, &body, Some(PAUSE[0]))
    }

    /// Returns true if the page should be written after this rendering time.
    pub fn is_due(&self, elapsed: Duration) -> bool {
        elapsed >= self.next
    }

    /// Writes the page.
    pub fn write(&mut self, snapshot: &Snapshot) -> Result<()> {
        let (start, elapsed) = (Instant::now(), snapshot.state.elapsed());
        let body = snapshot.state.threads().install(|| self.body(snapshot));
        // The page contains the time until its reload, so the time for writing to the disk is not
        // yet known.
        let [min, max] = PAUSE;
        let pause = (elapsed / PAUSE_SHARE).clamp(min, max).max(start.elapsed() * SHARE);
        let reload = snapshot.report.is_none().then_some(pause);
        let saved = self.save(&snapshot.state.provenance.scene, &body, reload);
        self.spent += start.elapsed();
        self.next = elapsed + pause.max(start.elapsed() * SHARE);
        saved
    }

    fn body(&self, snapshot: &Snapshot) -> Markup {
        let maps = maps::Maps::new(snapshot, LIVE_PIXELS);
        let cost = self.spent.as_secs_f64() / snapshot.state.elapsed().as_secs_f64().max(1e-9);
        html! {
            main {
                (sections::summary(snapshot))
                (maps.viewer(snapshot.image.resolution()))
                (maps.errors(snapshot))
                (audit::section(snapshot))
                section {
                    h2 { "Convergence" }
                    (convergence::section(snapshot))
                }
                (choice::section(snapshot))
                (maps.sources(snapshot))
                (sections::outcome(snapshot))
                (sections::setup(snapshot.input, &snapshot.state.provenance, Some(&snapshot.state.accel_name), &self.command))
                footer {
                    p {
                        "Written by bdpm " (snapshot.state.provenance.version) " "
                        time data-time=(unix_milliseconds()) {}
                        ". Writing this page took " (format!("{:.2} %", 100.0 * cost)) " of the rendering time."
                    }
                }
            }
        }
    }

    /// Saves the page. It reloads itself after `reload`, if the render is not done.
    fn save(&self, scene: &str, body: &Markup, reload: Option<Duration>) -> Result<()> {
        let seconds = reload.map(|pause| pause.as_secs_f64().ceil());
        let head = html! {
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
        let html = document(&title, STYLE, &head, &body).into_string();
        write_atomically(&self.path, |file| file.write_all(html.as_bytes()))
    }
}

fn unix_milliseconds() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as u64)
}

/// The command line, quoted for a shell.
fn command() -> String {
    let words = std::env::args_os().skip(1).map(|word| quoted(&word.to_string_lossy()));
    ["bdpm".to_owned()].into_iter().chain(words).collect::<Vec<_>>().join(" ")
}

/// A word in the quotes that a shell needs.
pub fn quoted(word: &str) -> String {
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
    fn words_with_special_characters_are_quoted() {
        let words = ["render", "--target-error", "2%", "my scene", "it's", ""].map(quoted);
        assert_eq!(words, ["render", "--target-error", "2%", "'my scene'", r"'it'\''s'", "''"]);
    }
}
