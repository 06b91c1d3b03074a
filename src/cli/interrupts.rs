//! Ctrl-C, and requests to terminate.

use super::progress::Progress;
use bdpm::base::error::{Error, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Signals within this time of the first one belong to the same request: `timeout` and terminals
/// send one to a program and one to its group.
const SAME_REQUEST: Duration = Duration::from_secs(2);

/// Sets the returned flag on Ctrl-C and on requests to terminate. A second, later one ends the
/// program at once.
pub fn catch_interrupts(progress: Progress) -> Result<Arc<AtomicBool>> {
    let interrupted = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&interrupted);
    let mut first: Option<Instant> = None;
    ctrlc::set_handler(move || match first {
        None => {
            first = Some(Instant::now());
            flag.store(true, Ordering::Relaxed);
            let after = SAME_REQUEST.as_secs();
            progress.note(&format!(
                "finishing this iteration; press Ctrl-C again after {after} seconds to stop at once"
            ));
        }
        Some(first) if first.elapsed() < SAME_REQUEST => {}
        // The customary status of a program that SIGINT ended.
        Some(_) => std::process::exit(130),
    })
    .map_err(|e| Error::new(format!("cannot catch Ctrl-C: {e}"), "report this as a bug"))?;
    Ok(interrupted)
}
