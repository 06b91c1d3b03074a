//! Ctrl-C, requests to terminate, and the limit of the size of files.

use super::progress::Progress;
use bdpm::base::error::{Error, Result};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Signals within this time of the first one belong to the same request: `timeout` and terminals
/// send one to a program and one to its group.
const SAME_REQUEST: Duration = Duration::from_secs(2);

/// Sets the returned flag on Ctrl-C and on requests to terminate. A second, later one ends the
/// program at once. Signals that the program was started to ignore, such as by `nohup`, stay
/// ignored.
pub fn catch_interrupts(progress: Progress) -> Result<Arc<AtomicBool>> {
    let interrupted = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&interrupted);
    let mut first: Option<Instant> = None;
    on_request(move || match first {
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

/// Calls `handler` on a thread of its own for each signal that asks the program to end.
#[cfg(unix)]
fn on_request(mut handler: impl FnMut() + Send + 'static) -> io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    use signal_hook::iterator::Signals;
    let ignored = ignored_signals();
    let is_caught = |signal: &i32| ignored & (1 << (signal - 1)) == 0;
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP].into_iter().filter(is_caught))?;
    let run = move || signals.forever().for_each(|_| handler());
    std::thread::Builder::new().name("signals".into()).spawn(run)?;
    Ok(())
}

#[cfg(not(unix))]
fn on_request(handler: impl FnMut() + Send + 'static) -> io::Result<()> {
    ctrlc::set_handler(handler).map_err(io::Error::other)
}

/// Signals that this process ignores, a bit for each. Linux states them in a file; other systems do
/// not, and only unsafe calls could ask them, so that all signals are caught there.
#[cfg(unix)]
fn ignored_signals() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    ignored_in(&status).unwrap_or(0)
}

/// The mask of ignored signals in the text of `/proc/self/status`.
#[cfg(unix)]
fn ignored_in(status: &str) -> Option<u64> {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"))?;
    u64::from_str_radix(mask.trim(), 16).ok()
}

/// Lets a write fail that exceeds the limit of the size of files (`ulimit -f`). By default the
/// signal SIGXFSZ kills the program, which leaves temporary files.
pub fn survive_file_size_limit() {
    #[cfg(unix)]
    {
        // Any handler replaces the default action. If there can be none, the default remains.
        let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn ignored_signals_are_read_from_the_status_of_the_process() {
        let status = "Name:\tbdpm\nSigBlk:\t0000000000000000\nSigIgn:\t0000000000001001\n";
        assert_eq!(ignored_in(status), Some(0x1001));
        assert_eq!(ignored_in("Name:\tSigIgn: 1\n"), None);
        assert_eq!(ignored_in("SigIgn:\tnone\n"), None);
    }
}
