//! Daylight of a year at meters.

use crate::error::raised;
use crate::measure::{array, meter_sets, pair, vectors};
use crate::scene::Scene;
use crate::settings;
use bdpm::daylight::{DaylightJob, DaylightSet, PointYear, Thresholds};
use bdpm::light::weather::Weather;
use bdpm::measurement::Estimated;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Daylight of a year at a set of meters: a single one or a grid.
///
/// Arrays are float64 of shape (rows, columns); those that end in `_expanded` are half of the
/// widths of intervals. Shares are percent.
#[pyclass(frozen, module = "bdpm")]
pub struct DaylightReadings {
    set: DaylightSet,
}

impl DaylightReadings {
    fn array<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&PointYear) -> f64,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array(py, self.set.grid, self.set.points.iter().map(of))
    }

    /// Four shares of each meter.
    fn shares<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&Estimated) -> f64,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let values = self.set.points.iter().flat_map(|point| point.useful.each_ref().map(&of));
        let [columns, rows] = self.set.grid.map(|count| count as usize);
        PyArray1::from_iter(py, values).reshape([rows, columns, 4])
    }
}

#[pymethods]
impl DaylightReadings {
    /// Name of the set.
    #[getter]
    fn name(&self) -> &str {
        &self.set.name
    }

    /// Daylight autonomy: hours with at least the illuminance asked for.
    #[getter]
    fn autonomy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |point| point.autonomy.value)
    }

    /// Half of the widths of the intervals of `autonomy`.
    #[getter]
    fn autonomy_expanded<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |point| point.autonomy.expanded)
    }

    /// Useful daylight, of shape (rows, columns, 4): hours below 100 lx, from 100 to 300 lx, from
    /// 300 to 3000 lx, and above.
    #[getter]
    fn useful<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        self.shares(py, |own| own.value)
    }

    /// Half of the widths of the intervals of `useful`.
    #[getter]
    fn useful_expanded<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        self.shares(py, |own| own.expanded)
    }

    /// Mean illuminance, lx.
    #[getter]
    fn illuminance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |point| point.mean.value)
    }

    /// Half of the widths of the intervals of `illuminance`, lx.
    #[getter]
    fn illuminance_expanded<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |point| point.mean.expanded)
    }

    /// Hours with over 1000 lx of direct sun.
    #[getter]
    fn sun_hours<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |point| point.sun_hours)
    }

    /// Irradiation in all hours of the file, kWh/m2.
    #[getter]
    fn irradiation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |point| point.irradiation.value)
    }

    /// Half of the widths of the intervals of `irradiation`, kWh/m2.
    #[getter]
    fn irradiation_expanded<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |point| point.irradiation.expanded)
    }

    /// Mean illuminance over all meters by month and hour of the clock, lx, of shape (12, 24).
    #[getter]
    fn by_month<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array(py, [24, 12], self.set.by_month().into_iter().flatten())
    }

    /// Positions in the coordinates of the scene's file, scene units.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        vectors(py, self.set.grid, self.set.places.iter().map(|place| place.position.to_array()))
    }

    /// Spatial daylight autonomy: meters with autonomy in half of the hours, and half of the width
    /// of its interval.
    #[getter]
    fn spatial_autonomy(&self) -> (f64, f64) {
        pair(&self.set.spatial_autonomy)
    }

    /// Annual sunlight exposure: meters with over 250 hours of direct sun.
    #[getter]
    fn sunlight_exposure(&self) -> f64 {
        self.set.sunlight_exposure
    }

    /// Mean illuminance over the meters, lx, and half of the width of its interval.
    #[getter]
    fn mean(&self) -> (f64, f64) {
        pair(&self.set.mean)
    }

    fn __repr__(&self) -> String {
        let ([columns, rows], [value, expanded]) = (self.set.grid, self.mean().into());
        let name = &self.set.name;
        format!("<DaylightReadings {name}: {columns} by {rows}, {value:.0} lx +- {expanded:.0}>")
    }
}

/// Daylight of a year at all meters.
#[pyclass(frozen, get_all, module = "bdpm")]
pub struct Daylight {
    /// City and country of the weather.
    place: String,
    /// Hours of the year that count.
    occupied_hours: usize,
    /// Paths from each meter.
    paths: u64,
    /// Wall-clock time, seconds.
    seconds: f64,
    /// Sets of meters, in the order of their tables.
    meters: Vec<Py<DaylightReadings>>,
}

#[pymethods]
impl Daylight {
    fn __repr__(&self) -> String {
        let count = self.meters.len();
        format!("<Daylight in {}: {count} sets of meters, {:.1} s>", self.place, self.seconds)
    }
}

/// Measures the daylight of a year at meters of illuminance, and returns a `Daylight`.
///
/// - `weather`: an .epw file.
/// - `meters`: as for `bdpm.measure`.
/// - `time`: time, seconds or text such as "2m" [default: 30].
/// - `paths`: number of paths from each meter instead.
/// - `turn`: angle of the sky about +y, counterclockwise from above, degrees; at 0 north is -z.
/// - `ground`: reflectance of the ground below the horizon, where the scene has none.
/// - `division`: divisions of the rows of sky patches: 1, 2, 3 or 4 for 145, 577, 1297 or 2305
///   patches.
/// - `autonomy`: illuminance of daylight autonomy, lx.
/// - `occupied`: hours of the clock between which all days count.
/// - `seed`, `threads`, `accel`: as for `bdpm.render`.
#[pyfunction]
#[pyo3(signature = (
    scene, weather, *, meters=None, time=None, paths=None, turn=0.0, ground=0.2, division=2,
    autonomy=300.0, occupied=(8.0, 18.0), seed=0, threads=None, accel=None
))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments")]
pub fn daylight(
    py: Python<'_>,
    scene: &Scene,
    weather: PathBuf,
    meters: Option<&Bound<'_, PyAny>>,
    time: Option<&Bound<'_, PyAny>>,
    paths: Option<u64>,
    turn: f64,
    ground: f64,
    division: usize,
    autonomy: f64,
    occupied: (f64, f64),
    seed: u64,
    threads: Option<u16>,
    accel: Option<&str>,
) -> PyResult<Daylight> {
    let weather = Weather::read(&weather).map_err(raised)?;
    let time = time.map(|time| settings::time("time", time)).transpose()?;
    let interrupt = Arc::new(AtomicBool::new(false));
    let job = DaylightJob::new(&scene.loaded, weather)
        .thresholds(Thresholds { autonomy, occupied: occupied.into() })
        .turned(turn)
        .ground(ground)
        .division(division)
        .paths(paths)
        .seed(seed)
        .backend(settings::backend(accel)?.unwrap_or_default())
        .threads(settings::threads(threads)?)
        .interrupted_by(Arc::clone(&interrupt));
    let job = time.into_iter().fold(job, DaylightJob::time);
    let job = match meters {
        Some(meters) => job.meters(meter_sets(meters, scene)?),
        None => job,
    };
    let mut stopped = None;
    let year = py.detach(|| {
        job.run(|_| {
            if let Err(error) = Python::attach(|py| py.check_signals()) {
                stopped = Some(error);
                interrupt.store(true, Ordering::Relaxed);
            }
        })
    });
    if let Some(error) = stopped {
        return Err(error);
    }
    let year = year.map_err(raised)?;
    let meters = year.sets.into_iter().map(|set| Py::new(py, DaylightReadings { set }));
    Ok(Daylight {
        place: year.place,
        occupied_hours: year.occupied_hours,
        paths: year.paths,
        seconds: year.time.as_secs_f64(),
        meters: meters.collect::<PyResult<_>>()?,
    })
}
