//! Measurements of illuminance and luminance.

use crate::error::{positive, raised, warn};
use crate::scene::Scene;
use crate::settings;
use crate::tables;
use bdpm::MeasureJob;
use bdpm::import::{parse_meters, read_meters};
use bdpm::measurement::{Estimated, Judged, SetReadings};
use bdpm::scene::MeterSet;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// A reading with its uncertainty, all in the unit of the quantity. The true value lies within
/// `value` +- `expanded` with a probability of 95 %. `float()` returns the value. Readings that are
/// unknown are not a number.
#[pyclass(frozen, get_all, module = "bdpm")]
pub struct Reading {
    /// The value.
    value: f64,
    /// Half of the width of the interval with a probability of 95 %.
    expanded: f64,
    /// Standard error.
    noise: f64,
    /// Bound of the bias.
    bias: f64,
    /// Part that arrives straight from lights, or through clear glass and mirrors.
    direct: f64,
    /// The rest.
    indirect: f64,
}

impl From<&bdpm::measurement::Reading> for Reading {
    fn from(reading: &bdpm::measurement::Reading) -> Self {
        let bdpm::measurement::Reading { value, noise, bias, expanded, direct } = *reading;
        Self { value, expanded, noise, bias, direct, indirect: reading.indirect() }
    }
}

#[pymethods]
impl Reading {
    fn __float__(&self) -> f64 {
        self.value
    }

    fn __repr__(&self) -> String {
        format!("{:.4e} +- {:.1e} (95 %)", self.value, self.expanded)
    }
}

/// Readings of a set of meters: a single one or a grid.
///
/// Arrays are float64 of shape (rows, columns), or (rows, columns, 3) for `positions` and
/// `normals`. Readings that are unknown are not a number.
#[pyclass(frozen, module = "bdpm")]
pub struct MeterReadings {
    set: SetReadings,
}

impl MeterReadings {
    fn array<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&bdpm::measurement::Reading) -> f64,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array(py, self.set.grid, self.set.readings.iter().map(of))
    }

    fn vectors<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&bdpm::measurement::MeterPlace) -> [f64; 3],
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        vectors(py, self.set.grid, self.set.places.iter().map(of))
    }
}

/// An array of shape (rows, columns) of values row by row.
pub fn array(
    py: Python<'_>,
    grid: [u32; 2],
    values: impl Iterator<Item = f64>,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let [columns, rows] = grid.map(|count| count as usize);
    PyArray1::from_vec(py, values.collect()).reshape([rows, columns])
}

/// An array of shape (rows, columns, 3) of vectors row by row.
pub fn vectors(
    py: Python<'_>,
    grid: [u32; 2],
    values: impl Iterator<Item = [f64; 3]>,
) -> PyResult<Bound<'_, PyArray3<f64>>> {
    let [columns, rows] = grid.map(|count| count as usize);
    PyArray1::from_vec(py, values.flatten().collect()).reshape([rows, columns, 3])
}

/// A value with half of the width of its interval.
pub fn pair(own: &Estimated) -> (f64, f64) {
    (own.value, own.expanded)
}

#[pymethods]
impl MeterReadings {
    /// Name of the set.
    #[getter]
    fn name(&self) -> &str {
        &self.set.name
    }

    /// "illuminance" or "luminance".
    #[getter]
    fn quantity(&self) -> &'static str {
        self.set.quantity()
    }

    /// "lx" or "cd/m2".
    #[getter]
    fn unit(&self) -> &'static str {
        self.set.unit()
    }

    /// Values.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |reading| reading.value)
    }

    /// Half of the widths of the intervals with a probability of 95 %.
    #[getter]
    fn expanded<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |reading| reading.expanded)
    }

    /// Standard errors.
    #[getter]
    fn noise<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |reading| reading.noise)
    }

    /// Bounds of the bias.
    #[getter]
    fn bias<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |reading| reading.bias)
    }

    /// Parts that arrive straight from lights, or through clear glass and mirrors.
    #[getter]
    fn direct<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, |reading| reading.direct)
    }

    /// Values less `direct`.
    #[getter]
    fn indirect<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.array(py, bdpm::measurement::Reading::indirect)
    }

    /// Positions in the coordinates of the scene's file, scene units.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        self.vectors(py, |place| place.position.to_array())
    }

    /// Unit normals of planes, or unit axes of cones.
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        self.vectors(py, |place| place.normal.as_dvec3().to_array())
    }

    /// Mean over the meters.
    #[getter]
    fn mean(&self) -> Reading {
        (&self.set.mean).into()
    }

    /// Minimum of the true values, and half of the width of its interval.
    #[getter]
    fn minimum(&self) -> (f64, f64) {
        pair(&self.set.extremes()[0])
    }

    /// Maximum of the true values, and half of the width of its interval.
    #[getter]
    fn maximum(&self) -> (f64, f64) {
        pair(&self.set.extremes()[1])
    }

    /// Uniformity U0, the minimum over the mean, and half of the width of its interval.
    #[getter]
    fn uniformity(&self) -> (f64, f64) {
        pair(&self.set.uniformity())
    }

    /// Diversity Ud, the minimum over the maximum, and half of the width of its interval.
    #[getter]
    fn diversity(&self) -> (f64, f64) {
        pair(&self.set.diversity())
    }

    /// What is required of the set by its table: dictionaries with `what`, `unit`, `limit`
    /// ("least" or "most"), `required`, `value`, `expanded` and `verdict` ("met", "not-met" or
    /// "not-decided").
    #[getter]
    fn requirements<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let judged = |own: Judged| {
            let judged = PyDict::new(py);
            judged.set_item("what", own.what)?;
            judged.set_item("unit", own.unit)?;
            judged.set_item("limit", own.limit.name())?;
            judged.set_item("required", own.required)?;
            judged.set_item("value", own.found.value)?;
            judged.set_item("expanded", own.found.expanded)?;
            judged.set_item("verdict", own.verdict.name())?;
            Ok(judged)
        };
        self.set.judged().into_iter().map(judged).collect()
    }

    /// Readings under each group of lights alone, by its name, if lights were measured apart. Their
    /// errors are independent.
    #[getter]
    fn by_light<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for (name, readings, mean) in &self.set.groups {
            let mut set = self.set.clone();
            (set.readings, set.mean, set.groups) = (readings.clone(), *mean, Vec::new());
            all.set_item(name, Self { set }.into_pyobject(py)?)?;
        }
        Ok(all)
    }

    fn __repr__(&self) -> String {
        let ([columns, rows], mean) = (self.set.grid, Reading::from(&self.set.mean).__repr__());
        let (name, unit) = (&self.set.name, self.set.unit());
        format!("<MeterReadings {name}: {columns} by {rows}, mean {mean}, {unit}>")
    }
}

/// Readings of all meters.
#[pyclass(frozen, module = "bdpm")]
pub struct Measurement {
    measurement: bdpm::Measurement,
}

#[pymethods]
impl Measurement {
    /// Sets of meters, in the order of their tables.
    #[getter]
    fn meters(&self) -> Vec<MeterReadings> {
        self.measurement.sets.iter().map(|set| MeterReadings { set: set.clone() }).collect()
    }

    /// Whether all uncertainties reached the target, and no reading is unknown.
    #[getter]
    fn reached(&self) -> bool {
        self.measurement.reached
    }

    /// Wall-clock time, seconds.
    #[getter]
    fn seconds(&self) -> f64 {
        self.measurement.time.as_secs_f64()
    }

    /// Group of lights, quantity, technique and counts of each render job.
    #[getter]
    fn techniques(&self) -> Vec<String> {
        self.measurement.techniques.clone()
    }

    /// Sentences about light that is missing or was hardly seen.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.measurement.warnings.clone()
    }

    fn __repr__(&self) -> String {
        let count = self.measurement.sets.len();
        format!("<Measurement: {count} sets of meters, {:.1} s>", self.seconds())
    }
}

/// Keywords of [`measure`] beside the settings, for errors.
const KEYWORDS: &[&str] =
    &["meters", "time", "target_error", "mean", "by_light", "threads", "accel"];

/// Measures illuminance and luminance at meters, and returns a `Measurement`.
///
/// - `meters`: a .csv, .toml or .pts file, or a list of dictionaries with the keys of `[[meter]]`
///   tables [default: the meters of the scene file].
/// - `time`: time, seconds or text such as "2m".
/// - `target_error`: expanded uncertainty over the value, 0.02 for 2 %
///   [default: 0.02, none with `time`].
/// - `mean`: apply the target to the mean over each set instead of to every meter.
/// - `by_light`: measure each light apart.
/// - `threads`, `accel` and the settings: as for `bdpm.render`.
#[pyfunction]
#[pyo3(signature = (
    scene, *, meters=None, time=None, target_error=None, mean=false, by_light=false, threads=None, accel=None,
    **settings
))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments")]
pub fn measure(
    py: Python<'_>,
    scene: &Scene,
    meters: Option<&Bound<'_, PyAny>>,
    time: Option<&Bound<'_, PyAny>>,
    target_error: Option<f64>,
    mean: bool,
    by_light: bool,
    threads: Option<u16>,
    accel: Option<&str>,
    settings: Option<&Bound<'_, PyDict>>,
) -> PyResult<Measurement> {
    let time = time.map(|time| settings::time("time", time)).transpose()?;
    let target = target_error.map(|error| positive("target_error", error, "0.02 for 2 %"));
    let job = MeasureJob::new(&scene.loaded)
        .settings(settings::settings(settings, KEYWORDS)?)
        .target(target.transpose()?)
        .time(time)
        .means_only(mean)
        .by_light(by_light)
        .backend(settings::backend(accel)?.unwrap_or_default())
        .threads(settings::threads(threads)?);
    let job = match meters {
        Some(meters) => job.meters(meter_sets(meters, scene)?),
        None => job,
    };
    let mut stopped = None;
    let measured = py.detach(|| {
        job.run(|_| match Python::attach(|py| py.check_signals()) {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                stopped = Some(error);
                ControlFlow::Break(())
            }
        })
    });
    if let Some(error) = stopped {
        return Err(error);
    }
    let measurement = measured.map_err(raised)?;
    let unknown: Vec<&str> = measurement.unknown().into_iter().map(|(name, _)| name).collect();
    if !unknown.is_empty() {
        let names = unknown.join(", ");
        warn(py, &format!("readings or their uncertainties are unknown, too few paths: {names}"))?;
    }
    Ok(Measurement { measurement })
}

/// The meters of a file, or of a list of dictionaries.
pub fn meter_sets(meters: &Bound<'_, PyAny>, scene: &Scene) -> PyResult<Vec<MeterSet>> {
    let scene = &scene.loaded.scene;
    if meters.is_instance_of::<PyString>() || meters.hasattr("__fspath__")? {
        return read_meters(&meters.extract::<PathBuf>()?, scene).map_err(raised);
    }
    let list = meters.try_iter()?.map(|meter| Ok(Value::Table(tables::table(&meter?)?)));
    let list = list.collect::<PyResult<Vec<_>>>()?;
    let text = tables::text(&Table::from_iter([("meter".to_owned(), Value::Array(list))]));
    parse_meters(Path::new("<meters>"), &text, scene).map_err(raised)
}
