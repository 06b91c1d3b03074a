//! `--view`: the image while it renders, in tev or as a small picture in the terminal.
//!
//! Neither holds up the render nor makes it fail.

mod terminal;
mod tev;

use super::progress::Progress;
use bdpm::base::error::{Error, Result};
use bdpm::output::denoise::Denoised;
use bdpm::render::block::CombinedImage;
use std::str::FromStr;
use std::time::{Duration, Instant};

/// Rendering time per time of preparing what is shown, at least.
const SHARE: u32 = 100;

/// Time between two pictures, at least.
const PAUSE: Duration = Duration::from_secs(1);

/// Target that shows the image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ViewTarget {
    /// The image viewer tev, at an address such as `127.0.0.1:14158`.
    Tev(String),
    /// The terminal of standard error.
    Terminal,
}

impl FromStr for ViewTarget {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let port = text.rsplit_once(':').filter(|(host, _)| !host.is_empty());
        match (text, port.and_then(|(_, port)| port.parse::<u16>().ok())) {
            ("terminal", _) => Ok(Self::Terminal),
            (address, Some(port)) if port > 0 => Ok(Self::Tev(address.to_owned())),
            _ => Err(Error::new(
                format!("`{text}` is not a target to show the image in"),
                "give tev's address such as 127.0.0.1:14158, or terminal",
            )),
        }
    }
}

/// Shows the image now and then.
pub struct View {
    screen: Screen,
    next: Duration,
}

enum Screen {
    Tev(tev::Tev),
    Terminal(Progress),
}

impl View {
    /// Shows an image of this name in `target`.
    pub fn new(target: &ViewTarget, name: &str, progress: &Progress) -> Self {
        let screen = match target {
            ViewTarget::Tev(address) => Screen::Tev(tev::Tev::new(address, name, progress)),
            ViewTarget::Terminal => {
                if !progress.has_terminal() {
                    progress.note("note: --view=terminal shows nothing: standard error is none");
                }
                Screen::Terminal(progress.clone())
            }
        };
        Self { screen, next: Duration::ZERO }
    }

    /// Whether a picture is to be shown, after so much time of rendering.
    pub fn is_due(&mut self, elapsed: Duration) -> bool {
        elapsed >= self.next
            && match &mut self.screen {
                Screen::Tev(tev) => tev.is_idle(),
                Screen::Terminal(progress) => progress.has_terminal(),
            }
    }

    /// Shows what there is after so much time of rendering.
    pub fn show(&mut self, image: &CombinedImage, denoised: Option<&Denoised>, elapsed: Duration) {
        let start = Instant::now();
        match &mut self.screen {
            Screen::Tev(tev) => tev.send(tev::Frame::new(image, denoised)),
            Screen::Terminal(progress) => terminal::show(progress, image, denoised),
        }
        self.next = elapsed + PAUSE.max(start.elapsed() * SHARE);
    }

    /// Shows the last one; waits a moment until it has come through.
    pub fn finish(mut self, image: &CombinedImage, denoised: Option<&Denoised>, elapsed: Duration) {
        if let Screen::Tev(tev) = &mut self.screen {
            tev.wait();
        }
        if self.is_due(elapsed.max(self.next)) {
            self.show(image, denoised, elapsed);
        }
        if let Screen::Tev(tev) = &mut self.screen {
            tev.wait();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_addresses_or_the_terminal() {
        let tev = |address: &str| ViewTarget::Tev(address.into());
        for text in ["127.0.0.1:14158", "[::1]:80", "desk.local:14158"] {
            assert_eq!(text.parse::<ViewTarget>().unwrap(), tev(text));
        }
        assert_eq!("terminal".parse::<ViewTarget>().unwrap(), ViewTarget::Terminal);
        for bad in ["", "desk", ":14158", "desk:", "desk:0", "desk:99999", "out.exr"] {
            let shown = bad.parse::<ViewTarget>().unwrap_err().to_string();
            assert!(shown.contains("help: give tev's address"), "{bad}: {shown}");
        }
    }
}
