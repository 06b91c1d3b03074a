//! Steps of a job that may fail after its first iteration, when there is an image to keep.

use bdpm_core::base::error::{Error, Result};
use std::any::Any;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// A step of a job between and after its iterations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Prepares an iteration: the choice of path counts, and the promise.
    Preparation,
    /// Renders an iteration, or one round of all processes.
    Iteration,
    /// Estimates noise and bias.
    Estimate,
    /// Compares the image with its audit, and starts it again if that refutes it.
    Audit,
    /// Denoises the image and estimates the error of the result.
    Denoising,
    /// Computes error, bias and plan of the final image.
    Result,
}

impl fmt::Display for Step {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Preparation => "the choice of path counts",
            Self::Iteration => "an iteration",
            Self::Estimate => "the estimate of the noise",
            Self::Audit => "the audit",
            Self::Denoising => "denoising",
            Self::Result => "the error of the result",
        })
    }
}

/// A failure that a test plants: `step` panics once the image has this many iterations.
#[derive(Clone, Copy, Debug)]
pub struct PlantedFailure {
    /// The step that fails.
    pub step: Step,
    /// Iterations of the image before the failure.
    pub iterations: u64,
}

/// Runs a step of an image with this many iterations. A panic is a fault of the program, which must
/// not lose the image: it becomes an error.
pub(super) fn attempt<T>(
    step: Step,
    iterations: u64,
    planted: Option<PlantedFailure>,
    run: impl FnOnce() -> Result<T>,
) -> Result<T> {
    let run = || {
        let fails = planted.is_some_and(|own| own.step == step && iterations >= own.iterations);
        assert!(!fails, "planted by a test");
        run()
    };
    // Nothing but the image is read after a panic.
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|panic| {
        Err(Error::new(
            format!("{step} failed: {}", message(&*panic)),
            "please report this with the scene",
        ))
    })
}

fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("internal error")
}
