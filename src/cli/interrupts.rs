//! Ctrl-C, and requests to terminate.

use super::progress::Progress;
use bdpm::base::error::{Error, Result};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Signals within this time of the first are of the same wish: `timeout` and terminals send one to a
/// program and to its group.
const ONE_WISH: Duration = Duration::from_secs(2);

/// Tells of Ctrl-C (and requests to terminate); a second one later ends the program at once.
pub fn catch_interrupts(progress: Progress) -> Result<&'static AtomicBool> {
    static INTERRUPTED: AtomicBool = AtomicBool::new(false);
    let mut first: Option<Instant> = None;
    ctrlc::set_handler(move || match first {
        None => {
            first = Some(Instant::now());
            INTERRUPTED.store(true, Ordering::Relaxed);
            let after = ONE_WISH.as_secs();
            progress.note(&format!(
                "finishing this iteration; press Ctrl-C again after {after} seconds to abort"
            ));
        }
        Some(first) if first.elapsed() < ONE_WISH => {}
        // The customary status of a program that SIGINT ended.
        Some(_) => std::process::exit(130),
    })
    .map_err(|e| Error::new(format!("cannot catch Ctrl-C: {e}"), "report this as a bug"))?;
    Ok(&INTERRUPTED)
}
