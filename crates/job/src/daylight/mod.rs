//! Daylight of a year: [`DaylightJob`].
//!
//! ```text
//! meters -> coefficients of sky patches and suns, in batches -> light of each hour -> metrics
//! ```
//!
//! The coefficients know neither weather nor time: one run serves all hours. Batches of paths are
//! independent, so that the spread of their illuminances is the uncertainty of each hour.

mod coefficients;
mod metrics;
#[cfg(test)]
mod tests;
mod year;

pub use metrics::{DaylightSet, PointYear, Thresholds};

use crate::measurement::{MeterPlace, check_illuminance, check_meters};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::backend::{self, Backend};
use bdpm_core::scene::{Meter, MeterKind, MeterSet};
use bdpm_light::sky::SkyPatches;
use bdpm_light::weather::Weather;
use bdpm_load::Loaded;
use coefficients::{Coefficients, End};
use rayon::ThreadPool;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};
use year::Year;

/// Divisions of the rows of sky patches, unless one is given: 577 patches.
const DIVISION: usize = 2;

/// Most divisions: 2305 patches.
const MOST_DIVISION: usize = 4;

/// Measures the daylight of a year at meters of illuminance.
#[derive(Clone)]
pub struct DaylightJob {
    loaded: Loaded,
    weather: Weather,
    sets: Vec<MeterSet>,
    thresholds: Thresholds,
    turn_deg: f64,
    ground: f64,
    division: usize,
    time: Duration,
    paths: Option<u64>,
    seed: u64,
    backend: Backend,
    threads: Option<Arc<ThreadPool>>,
    interrupt: Arc<AtomicBool>,
}

/// Daylight of a year.
#[derive(Clone, Debug)]
pub struct DaylightYear {
    /// City and country of the weather.
    pub place: String,
    /// Hours of the year that count.
    pub occupied_hours: usize,
    /// Sets of meters, in the order of the job.
    pub sets: Vec<DaylightSet>,
    /// Paths from each meter.
    pub paths: u64,
    /// Wall-clock time.
    pub time: Duration,
}

/// Progress of a measurement.
#[derive(Clone, Copy, Debug)]
pub struct DaylightProgress {
    /// Paths from each meter so far.
    pub paths: u64,
    /// Time since the start.
    pub elapsed: Duration,
}

impl DaylightJob {
    /// Measures the meters of a scene file under this weather, in about 30 seconds.
    pub fn new(loaded: &Loaded, weather: Weather) -> Self {
        Self {
            sets: loaded.meters.clone(),
            loaded: loaded.clone(),
            weather,
            thresholds: Thresholds::default(),
            turn_deg: 0.0,
            ground: 0.2,
            division: DIVISION,
            time: Duration::from_secs(30),
            paths: None,
            seed: 0,
            backend: Backend::default(),
            threads: None,
            interrupt: Arc::default(),
        }
    }

    /// Measures these meters instead.
    #[must_use]
    pub fn meters(self, sets: Vec<MeterSet>) -> Self {
        Self { sets, ..self }
    }

    /// Counts by these illuminances and hours.
    #[must_use]
    pub fn thresholds(self, thresholds: Thresholds) -> Self {
        Self { thresholds, ..self }
    }

    /// Turns the sky about +y, counterclockwise as seen from +y, degrees [default: 0, -z is north].
    #[must_use]
    pub fn turned(self, turn_deg: f64) -> Self {
        Self { turn_deg, ..self }
    }

    /// Reflectance of the ground below the horizon, where the scene has none [default: 0.2].
    #[must_use]
    pub fn ground(self, reflectance: f64) -> Self {
        Self { ground: reflectance, ..self }
    }

    /// Divides each row of sky patches by 1, 2, 3 or 4: 145, 577, 1297 or 2305 patches
    /// [default: 2]. Light of the sky and reflected light of the sun are even within a patch.
    #[must_use]
    pub fn division(self, division: usize) -> Self {
        Self { division, ..self }
    }

    /// Takes about this time [default: 30 seconds].
    #[must_use]
    pub fn time(self, time: Duration) -> Self {
        Self { time, ..self }
    }

    /// Traces at least this number of paths from each meter, whatever the time: the same seed then
    /// gives the same result.
    #[must_use]
    pub fn paths(self, paths: impl Into<Option<u64>>) -> Self {
        Self { paths: paths.into(), ..self }
    }

    /// Starts the random numbers [default: 0].
    #[must_use]
    pub fn seed(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// Finds intersections with this backend.
    #[must_use]
    pub fn backend(self, backend: Backend) -> Self {
        Self { backend, ..self }
    }

    /// Runs on these threads [default: one per processor].
    #[must_use]
    pub fn threads(self, threads: Arc<ThreadPool>) -> Self {
        Self { threads: Some(threads), ..self }
    }

    /// Stops tracing after the round in which this flag is set.
    #[must_use]
    pub fn interrupted_by(self, interrupt: Arc<AtomicBool>) -> Self {
        Self { interrupt, ..self }
    }

    /// Measures, and reports progress to `observer`.
    ///
    /// # Errors
    /// If there are no meters, one measures luminance, the scene has media, or a number is not one
    /// that it can be.
    pub fn run(self, observer: impl FnMut(DaylightProgress) + Send) -> Result<DaylightYear> {
        self.check()?;
        match self.threads.clone() {
            Some(threads) => threads.install(|| self.measure(observer)),
            None => self.measure(observer),
        }
    }

    fn check(&self) -> Result<()> {
        check_meters(&self.sets)?;
        check_illuminance(&self.sets)?;
        if self.loaded.scene.media().is_some() {
            let advice = "remove `interior` and `exterior` of its materials: coefficients of the sky know surfaces alone";
            return Err(Error::new("the scene has a medium", advice));
        }
        if !(0.0..=1.0).contains(&self.ground) {
            let problem = format!("the ground reflects {}", self.ground);
            return Err(Error::new(problem, "give a reflectance from 0 to 1"));
        }
        if !(1..=MOST_DIVISION).contains(&self.division) {
            let problem = format!("the rows of sky patches are divided by {}", self.division);
            return Err(Error::new(problem, "give 1, 2, 3 or 4: 145, 577, 1297 or 2305 patches"));
        }
        if !self.turn_deg.is_finite() {
            return Err(Error::new(
                "the turn of the sky is not finite",
                "give an angle in degrees",
            ));
        }
        self.thresholds.check()
    }

    fn measure(self, mut observer: impl FnMut(DaylightProgress)) -> Result<DaylightYear> {
        let start = Instant::now();
        let scene = &self.loaded.scene;
        let accel = backend::build(self.backend, scene)?;
        let patches = SkyPatches::new(self.division);
        let year = Year::new(&self.weather, &patches, self.turn_deg, self.ground)?;
        let all: Vec<Meter> = self.sets.iter().flat_map(|set| set.meters.clone()).collect();
        let moved = scene.with_meters(MeterKind::Irradiance, all);
        let meters = &moved.meters().expect("there are meters").list;
        let end = match self.paths {
            Some(paths) => End::Paths(paths),
            None => {
                let count = self.sets.iter().map(|set| set.meters.len()).sum();
                let after = metrics::seconds(count, &year, rayon::current_num_threads());
                let after = Duration::from_secs_f64(after).min(self.time / 2);
                // Nobody sees the end of a time that no clock reaches.
                start.checked_add(self.time - after).map_or(End::Paths(u64::MAX), End::Time)
            }
        };
        let traced = Coefficients::trace(
            (scene, &*accel),
            meters,
            &year,
            (self.seed, end, &self.interrupt),
            |paths| observer(DaylightProgress { paths, elapsed: start.elapsed() }),
        )?;
        let mut first = 0;
        let mut sets = Vec::new();
        for set in &self.sets {
            let own = first..first + set.meters.len();
            first = own.end;
            let places = set.meters.iter().map(|meter| MeterPlace {
                position: scene.in_file(meter.position),
                normal: meter.normal,
            });
            let lights = (&**scene, &*accel, &meters[own.clone()]);
            let of_set = &traced.of_meters[own];
            let points = metrics::of_meters(lights, of_set, &traced, &year, &self.thresholds);
            sets.push(DaylightSet::new(set, places.collect(), points));
        }
        Ok(DaylightYear {
            place: self.weather.place.clone(),
            occupied_hours: year.hours.iter().filter(|hour| self.thresholds.counts(hour)).count(),
            sets,
            paths: traced.paths,
            time: start.elapsed(),
        })
    }
}
