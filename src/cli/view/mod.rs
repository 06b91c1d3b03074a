//! `--view`: the image while it renders, in tev or as a small picture in the terminal.
//!
//! A slow or missing viewer neither delays the render nor makes it fail.

mod terminal;
mod tev;

use super::progress::Progress;
use bdpm::base::error::{Error, Result};
use bdpm::output::denoise::Denoised;
use bdpm::render::block::CombinedImage;
use std::str::FromStr;
use std::time::{Duration, Instant};

/// Minimum ratio of rendering time to the time for preparing pictures.
const SHARE: u32 = 100;

/// Minimum time between two pictures.
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
                format!("`{text}` is neither an address nor `terminal`"),
                "give tev's address such as 127.0.0.1:14158, or terminal",
            )),
        }
    }
}

/// Shows the image at intervals.
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
                    progress.note(
                        "note: --view=terminal shows nothing: standard error is not a terminal",
                    );
                }
                Screen::Terminal(progress.clone())
            }
        };
        Self { screen, next: Duration::ZERO }
    }

    /// Returns true if a picture should be shown after this rendering time.
    pub fn is_due(&mut self, elapsed: Duration) -> bool {
        elapsed >= self.next
            && match &mut self.screen {
                Screen::Tev(tev) => tev.is_idle(),
                Screen::Terminal(progress) => progress.has_terminal(),
            }
    }

    /// Shows the image after this rendering time.
    pub fn show(&mut self, image: &CombinedImage, denoised: Option<&Denoised>, elapsed: Duration) {
        let start = Instant::now();
        match &mut self.screen {
            Screen::Tev(tev) => tev.send(tev::Frame::new(image, denoised)),
            Screen::Terminal(progress) => terminal::show(progress, image, denoised),
        }
        self.next = elapsed + PAUSE.max(start.elapsed() * SHARE);
    }

    /// Shows the final image, and waits a moment until it was sent.
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
    fn view_target_is_an_address_or_the_terminal() {
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
