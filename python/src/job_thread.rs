//! A job on a thread of its own, which never needs the interpreter: other threads of Python run
//! meanwhile.

use crate::arrays::Size;
use crate::error::{raised, warn};
use crate::progress::Progress;
use bdpm::base::math::Rgb;
use bdpm::job::RenderState;
use bdpm::{Event, RenderJob, RenderResult};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use std::ops::ControlFlow;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Time between two checks for Ctrl-C and two calls of the progress callback.
const POLL: Duration = Duration::from_millis(50);

/// The image so far.
#[derive(Clone)]
pub struct Snapshot {
    pub size: Size,
    pub pixels: Vec<Rgb>,
}

/// State of a job.
#[derive(Default)]
struct JobState {
    progress: Progress,
    /// Warnings that were not yet shown.
    warnings: Vec<String>,
    is_snapshot_wanted: bool,
    snapshot: Option<Snapshot>,
    outcome: Option<bdpm::Result<RenderResult>>,
    is_finished: bool,
}

/// State of a job, shared by its thread and the interpreter.
#[derive(Default)]
struct Shared {
    state: Mutex<JobState>,
    /// Notified after a snapshot and at the end.
    changed: Condvar,
    interrupt: Arc<AtomicBool>,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, JobState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reacts to an event of the job.
    fn observe(&self, event: Event) -> ControlFlow<()> {
        match event {
            Event::Warning(warning) => self.lock().warnings.push(warning),
            Event::Iterated(state) => self.iterated(state),
            Event::Choosing(..) | Event::Started(_) | Event::Restarted(_) | Event::Denoised(..) => {
            }
        }
        match self.interrupt.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }

    fn iterated(&self, state: &RenderState) {
        let progress = Progress::of(state);
        let is_snapshot_wanted = {
            let mut shared = self.lock();
            shared.progress = progress;
            std::mem::take(&mut shared.is_snapshot_wanted)
        };
        if is_snapshot_wanted {
            let image = state.image();
            let snapshot = Snapshot { size: image.resolution(), pixels: image.mean() };
            self.lock().snapshot = Some(snapshot);
            self.changed.notify_all();
        }
    }

    /// Waits until `is_over` holds, at most [`POLL`].
    fn wait(&self, is_over: impl Fn(&JobState) -> bool) -> MutexGuard<'_, JobState> {
        let waiting = self.changed.wait_timeout_while(self.lock(), POLL, |state| !is_over(state));
        waiting.unwrap_or_else(PoisonError::into_inner).0
    }
}

/// Reports the end of the job's thread, even if it panics.
struct Finish(Arc<Shared>);

impl Drop for Finish {
    fn drop(&mut self) {
        self.0.lock().is_finished = true;
        self.0.changed.notify_all();
    }
}

/// A running job.
pub struct JobThread {
    shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl JobThread {
    /// Starts the job.
    pub fn start(job: RenderJob) -> Self {
        let shared = Arc::<Shared>::default();
        let finish = Finish(Arc::clone(&shared));
        let thread = std::thread::spawn(move || {
            let shared = &finish.0;
            let job = job.interrupted_by(Arc::clone(&shared.interrupt));
            let outcome = job.run(|event| shared.observe(event));
            shared.lock().outcome = Some(outcome);
        });
        Self { shared, thread: Mutex::new(Some(thread)) }
    }

    /// Asks the job to end after the current iteration.
    pub fn stop(&self) {
        self.shared.interrupt.store(true, Ordering::Relaxed);
    }

    pub fn progress(&self) -> Progress {
        self.shared.lock().progress
    }

    pub fn is_finished(&self) -> bool {
        self.shared.lock().is_finished
    }

    /// Waits for the end of the job. Calls `callback` with the progress, which ends the job by
    /// returning False or raising. Ctrl-C ends the job as well; a second Ctrl-C raises
    /// KeyboardInterrupt at once.
    pub fn wait(&self, py: Python<'_>, callback: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let mut was_interrupted = false;
        loop {
            let (progress, is_finished, warnings) = py.detach(|| {
                let mut state = self.shared.wait(|state| state.is_finished);
                (state.progress, state.is_finished, std::mem::take(&mut state.warnings))
            });
            let reacted =
                py.check_signals().and_then(|()| self.report(py, &warnings, progress, callback));
            if let Err(error) = reacted {
                self.stop();
                let is_interrupt = error.is_instance_of::<PyKeyboardInterrupt>(py);
                if !is_interrupt || std::mem::replace(&mut was_interrupted, true) {
                    return Err(error);
                }
            }
            if is_finished {
                return Ok(());
            }
        }
    }

    fn report(
        &self,
        py: Python<'_>,
        warnings: &[String],
        progress: Progress,
        callback: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        for warning in warnings {
            warn(py, warning)?;
        }
        if let Some(callback) = callback
            && callback.call1((progress,))?.is(pyo3::types::PyBool::new(py, false))
        {
            self.stop();
        }
        Ok(())
    }

    /// The result of a finished job, once.
    ///
    /// # Panics
    /// If the job panicked, with the same message.
    pub fn take_outcome(&self, py: Python<'_>) -> Option<PyResult<RenderResult>> {
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(Err(panic)) = py.detach(|| thread.map(JoinHandle::join)) {
            resume_unwind(panic);
        }
        let outcome = self.shared.lock().outcome.take()?;
        Some(outcome.map_err(raised))
    }

    /// The image after the current iteration; `None` before the first iteration, and after the end.
    pub fn snapshot(&self, py: Python<'_>) -> PyResult<Option<Snapshot>> {
        {
            let mut state = self.shared.lock();
            if state.progress.iterations == 0 || state.is_finished {
                return Ok(None);
            }
            state.is_snapshot_wanted = true;
        }
        loop {
            let (snapshot, is_finished) = py.detach(|| {
                let mut state = self.shared.wait(|s| s.snapshot.is_some() || s.is_finished);
                (state.snapshot.take(), state.is_finished)
            });
            if snapshot.is_some() || is_finished {
                return Ok(snapshot);
            }
            // Another thread of Python may have taken it.
            self.shared.lock().is_snapshot_wanted = true;
            py.check_signals()?;
        }
    }
}

impl Drop for JobThread {
    /// Ends the job. Waits for its thread, since the interpreter may be about to exit.
    fn drop(&mut self) {
        self.stop();
        let thread = self.thread.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(thread) = thread {
            Python::attach(|py| py.detach(|| drop(thread.join())));
        }
    }
}
