//! Progress on stderr: a bar on a terminal, else lines of text or JSON.

use super::{draw, human_time, say};
use bdpm::adaptive::stopping::{Convergence, Forecast, Stop};
use bdpm::film::PhaseTimes;
use bdpm::job::{RenderState, Status, Totals};
use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use std::fmt::Write;
use std::io::{self, IsTerminal, Write as _};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Time between plain lines.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Time between JSON objects.
const OBJECT_EVERY: Duration = Duration::from_millis(500);

/// Format of the progress on stderr.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum ProgressFormat {
    /// A bar on a terminal, else a line every 10 seconds
    #[default]
    Text,
    /// A JSON object per line, every half a second, for programs that run this one
    Json,
    /// No progress
    #[value(skip)]
    Nothing,
}

/// Shows the progress of an image.
#[derive(Clone)]
pub struct Progress {
    shown: Shown,
    last_line: Instant,
    /// Expected end. The bar counts down to it during an iteration.
    end: Arc<Mutex<Option<Instant>>>,
    /// True once the reader of the JSON objects has closed the pipe.
    is_orphan: bool,
    /// Number of lines of the picture above the bar.
    picture: Arc<Mutex<usize>>,
}

#[derive(Clone)]
enum Shown {
    Nothing,
    Lines,
    Json,
    Bar(ProgressBar),
}

impl Progress {
    /// Shows only notes before [`Self::start`].
    pub fn new(format: ProgressFormat) -> Self {
        let end = Arc::new(Mutex::new(None));
        let shown = if format == ProgressFormat::Nothing {
            Shown::Nothing
        } else if format == ProgressFormat::Json {
            Shown::Json
        } else if io::stderr().is_terminal() {
            Shown::Bar(bar(end.clone()))
        } else {
            Shown::Lines
        };
        Self { shown, last_line: Instant::now(), end, is_orphan: false, picture: Arc::default() }
    }

    /// Starts to show the progress.
    pub fn start(&self) {
        if let Shown::Bar(bar) = &self.shown {
            bar.enable_steady_tick(Duration::from_millis(200));
        }
    }

    /// Shows the progress of a render after an iteration.
    pub fn update(&mut self, state: &RenderState) {
        self.show(&state.stop, &state.totals, &state.status, state.elapsed());
    }

    /// Shows the progress toward `stop` after `elapsed` time.
    pub fn show(&mut self, stop: &Stop, totals: &Totals, status: &Status, elapsed: Duration) {
        let (left, fraction) = status.time_left(stop, elapsed.as_secs_f64());
        let left = left.and_then(|left| Duration::try_from_secs_f64(left).ok());
        let state = describe(stop, totals, status);
        match &self.shown {
            Shown::Nothing => {}
            Shown::Lines => {
                if self.last_line.elapsed() >= LINE_EVERY {
                    self.last_line = Instant::now();
                    let left = left.map_or(String::new(), |left| {
                        format!("  {} left", human_time(left.as_secs_f64()))
                    });
                    say(&format!("{state}{left}"));
                }
            }
            Shown::Json => {
                if self.last_line.elapsed() >= OBJECT_EVERY {
                    self.last_line = Instant::now();
                    let object = object(stop, status, left, fraction);
                    self.is_orphan |= writeln!(io::stderr(), "{object}").is_err();
                }
            }
            Shown::Bar(bar) => {
                *self.end.lock().expect("no holder panics") =
                    left.and_then(|left| Instant::now().checked_add(left));
                bar.set_position((1000.0 * fraction.clamp(0.0, 1.0)) as u64);
                bar.set_message(state);
            }
        }
    }

    /// Returns true if the program that read the JSON objects is gone, so the image is no longer
    /// needed.
    pub fn is_orphan(&self) -> bool {
        self.is_orphan
    }

    /// Prints a note for the user.
    pub fn note(&self, text: &str) {
        match &self.shown {
            Shown::Nothing => {}
            Shown::Lines | Shown::Json => say(text),
            Shown::Bar(bar) => {
                let mut picture = self.picture.lock().expect("no holder panics");
                *picture = 0; // the next picture begins below the note
                bar.suspend(|| say(text));
            }
        }
    }

    /// Returns true if there is a terminal for pictures.
    pub fn has_terminal(&self) -> bool {
        matches!(self.shown, Shown::Bar(_))
    }

    /// Shows a picture above the bar. It replaces the previous picture.
    pub fn picture(&self, lines: &[String]) {
        let Shown::Bar(bar) = &self.shown else { return };
        let mut before = self.picture.lock().expect("no holder panics");
        bar.suspend(|| {
            let up = if *before > 0 { format!("\x1b[{}A", *before) } else { String::new() };
            draw(&(up + &lines.join("\n")));
        });
        *before = lines.len();
    }

    /// Clears the bar.
    pub fn finish(&self) {
        if let Shown::Bar(bar) = &self.shown {
            bar.finish_and_clear();
        }
    }
}

/// Progress as a JSON object: errors as shares, times in seconds, `null` for unknown values.
fn object(stop: &Stop, status: &Status, left: Option<Duration>, done: f64) -> serde_json::Value {
    let convergence = status.convergence.as_ref();
    let error = |left| convergence.and_then(|convergence| convergence.error(stop, left));
    serde_json::json!({
        "iterations": status.iterations,
        "done": done.clamp(0.0, 1.0),
        "seconds_left": left.map(|left| left.as_secs_f64()),
        "error": error(1.0),
        "promised": status.forecast.and_then(|then| error(then.left)),
    })
}

/// Iterations, noise now and at the end, speed, and the shares of the phases in the time.
fn describe(stop: &Stop, totals: &Totals, status: &Status) -> String {
    let mut state = match stop.iterations {
        Some(n) => format!("{}/{n}", status.iterations),
        None => format!("{} done", status.iterations),
    };
    let luminance =
        status.convergence.as_ref().map_or(0.0, |convergence| convergence.mean_luminance);
    let percent = |rms: f64| format!("{:.2}%", 100.0 * rms / luminance);
    if let Some(now) =
        status.convergence.as_ref().and_then(|convergence| convergence.error(stop, 1.0))
    {
        state += &format!("  error {:.2}%", 100.0 * now);
        let forecast = status.convergence.as_ref().zip(status.forecast);
        if let Some(then) = forecast.and_then(|(now, then)| now.error(stop, then.left)) {
            state += &format!(" to {:.2}%", 100.0 * then);
        }
    } else if let Some(rms) = status.convergence.as_ref().and_then(Convergence::rms)
        && luminance > 0.0
    {
        state += &format!("  RMS {}", percent(rms));
        if let Some(Forecast { rms, .. }) = status.forecast {
            state += &format!(" to {}", percent(rms));
        }
    }
    let [light, camera, merge] = phase_shares(totals);
    let speed = totals.rays_per_second() / 1e6;
    state + &format!("  {speed:.1} Mray/s  light {light:.0}% camera {camera:.0}% merge {merge:.0}%")
}

fn bar(end: Arc<Mutex<Option<Instant>>>) -> ProgressBar {
    let left = move |_: &ProgressState, to: &mut dyn Write| {
        if let Some(end) = *end.lock().expect("no holder panics") {
            let left = end.saturating_duration_since(Instant::now());
            // A failed write shows as an incomplete bar and has no other consequence.
            let _ = write!(to, "  {} left", human_time(left.as_secs_f64().round()));
        }
    };
    let style = ProgressStyle::with_template("{wide_bar:.cyan/blue} {msg}{left}")
        .expect("the template is valid")
        .with_key("left", left)
        .progress_chars("━╸─");
    ProgressBar::new(1000).with_style(style).with_message("first iteration")
}

/// Shares of the light, camera and merge phases in the busy time, percent.
fn phase_shares(totals: &Totals) -> [f64; 3] {
    let PhaseTimes { light, camera, merge, .. } = totals.times;
    let all = (light + camera + merge).as_secs_f64().max(1e-9);
    [light, camera, merge].map(|phase| 100.0 * phase.as_secs_f64() / all)
}
