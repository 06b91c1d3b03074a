//! The end of a run of the denoiser by an interrupt.

use std::ffi::c_void;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// When a run is canceled: once the interrupt is set, but not before a given time.
#[derive(Debug, Default)]
pub struct Cancellation {
    interrupt: Arc<AtomicBool>,
    ignored_until: Mutex<Option<Instant>>,
}

impl Cancellation {
    /// Cancels by this flag.
    pub fn new(interrupt: Arc<AtomicBool>) -> Self {
        Self { interrupt, ignored_until: Mutex::default() }
    }

    /// Ignores the interrupt until this time; `None` for not at all.
    pub fn ignore_until(&self, time: Option<Instant>) {
        *self.ignored_until.lock().unwrap_or_else(PoisonError::into_inner) = time;
    }

    /// Returns true if a run has to end. Cannot panic.
    pub fn is_canceled(&self) -> bool {
        let is_over = || {
            let time = *self.ignored_until.lock().unwrap_or_else(PoisonError::into_inner);
            time.is_none_or(|time| Instant::now() >= time)
        };
        self.interrupt.load(Ordering::Relaxed) && is_over()
    }
}

/// The progress monitor of a filter, whose pointer is that of a [`Cancellation`].
pub unsafe extern "C" fn goes_on(cancellation: *mut c_void, _done: f64) -> bool {
    // SAFETY: the pointer is that which was given with this function: of a `Cancellation` that
    // lives as long as the filter. It is used through `&` only, from any thread, as it is `Sync`.
    let cancellation = unsafe { &*cancellation.cast::<Cancellation>() };
    !cancellation.is_canceled()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn run_goes_on_until_interrupt_and_given_time() {
        let interrupt = Arc::new(AtomicBool::new(false));
        let cancellation = Cancellation::new(Arc::clone(&interrupt));
        assert!(!cancellation.is_canceled());
        interrupt.store(true, Ordering::Relaxed);
        assert!(cancellation.is_canceled());
        cancellation.ignore_until(Some(Instant::now() + Duration::from_secs(3600)));
        assert!(!cancellation.is_canceled());
        let pointer = (&raw const cancellation).cast_mut().cast();
        // SAFETY: the pointer is that of a living `Cancellation`.
        assert!(unsafe { goes_on(pointer, 0.5) });
        cancellation.ignore_until(Some(Instant::now()));
        assert!(cancellation.is_canceled());
    }
}
