//! The extension module `bdpm._bdpm`: the library's types as Python classes, pixels as NumPy
//! arrays.
//!
//! `bdpm/__init__.py` exports the public names, `bdpm/_bdpm.pyi` has their types.

mod analyze;
mod arrays;
mod calibrate;
mod convert;
mod daylight;
mod error;
mod estimate;
mod files;
mod glare;
mod job;
mod job_thread;
mod judge;
mod measure;
mod noise;
mod plan;
mod progress;
mod result;
mod scene;
mod settings;
mod tables;

/// Classes and functions of the package `bdpm`.
#[pyo3::pymodule]
mod _bdpm {
    #[pymodule_export]
    use crate::analyze::analyze;
    #[pymodule_export]
    use crate::calibrate::{Timings, calibrate};
    #[pymodule_export]
    use crate::convert::convert;
    #[pymodule_export]
    use crate::daylight::{Daylight, DaylightReadings, daylight};
    #[pymodule_export]
    use crate::estimate::Estimate;
    #[pymodule_export]
    use crate::files::read_exr;
    #[pymodule_export]
    use crate::glare::glare;
    #[pymodule_export]
    use crate::job::{Job, start};
    #[pymodule_export]
    use crate::judge::{Judgment, judge};
    #[pymodule_export]
    use crate::measure::{Measurement, MeterReadings, Reading, measure};
    #[pymodule_export]
    use crate::noise::{BestCounts, Noise, Prediction};
    #[pymodule_export]
    use crate::plan::Plan;
    #[pymodule_export]
    use crate::progress::Progress;
    #[pymodule_export]
    use crate::result::{RelativeError, RenderResult};
    #[pymodule_export]
    use crate::scene::{Mesh, Scene, load};

    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
