//! Daylight coefficients of all meters, in independent batches of paths.

use super::year::Year;
use bdpm_core::accel::Intersect;
use bdpm_core::base::error::Error;
use bdpm_core::base::error::Result;
use bdpm_core::base::memory::{available_memory, check_memory};
use bdpm_core::base::rng::{Stream, StreamKey};
use bdpm_core::scene::{Meter, Scene};
use bdpm_core::transport::daylight::{DaylightSums, DaylightTargets};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Independent batches of each meter. Their spread tells the uncertainty.
pub const BATCHES: usize = 16;

/// Strata along a side of the directions of the first round, of which a batch has a square.
const FIRST_SIDE: u32 = 4;

/// Strata along a side at most.
const MOST_SIDE: u32 = 32;

/// Share of the time that a round should take at most.
const ROUND: f64 = 0.05;

/// When tracing ends.
#[derive(Clone, Copy, Debug)]
pub enum End {
    /// At this time.
    Time(Instant),
    /// After this number of paths from each meter.
    Paths(u64),
}

/// Strata along a side where the number of paths is given.
const FIXED_SIDE: u32 = 8;

/// Coefficients of all meters.
pub struct Coefficients {
    /// For each meter its batches.
    pub of_meters: Vec<Vec<DaylightSums>>,
    /// Paths of each batch.
    pub paths_of_batch: u64,
    /// Paths of each meter.
    pub paths: u64,
}

impl Coefficients {
    /// Traces paths from all meters to the end, but at least one round.
    ///
    /// # Errors
    /// If the memory does not suffice.
    pub fn trace(
        (scene, accel): (&Scene, &dyn Intersect),
        meters: &[Meter],
        year: &Year,
        (seed, end, interrupt): (u64, End, &AtomicBool),
        mut observer: impl FnMut(u64),
    ) -> Result<Self> {
        let numbers = meters.len() * BATCHES * (year.bins() + year.suns.len());
        check_memory(4.0 * numbers as f64, available_memory()).map_err(|problem| {
            let problem = format!("the coefficients of {} meters take {problem}", meters.len());
            Error::new(problem, "give fewer meters")
        })?;
        let sky = |direction| Some(year.bin(direction));
        let suns_of_bin = |bin| year.suns_of_bin(bin);
        let targets = DaylightTargets { sky: &sky, suns: &year.suns, suns_of_bin: &suns_of_bin };
        let sums = || DaylightSums::new(year.bins(), year.suns.len());
        let mut of_meters: Vec<Vec<DaylightSums>> =
            meters.iter().map(|_| (0..BATCHES).map(|_| sums()).collect()).collect();
        let left = |end: Instant| end.saturating_duration_since(Instant::now()).as_secs_f64();
        let (mut side, whole) = match end {
            End::Time(end) => (FIRST_SIDE, left(end)),
            End::Paths(_) => (FIXED_SIDE, 0.0),
        };
        let mut paths_of_batch = 0;
        for round in 0u64.. {
            let start = Instant::now();
            let key = StreamKey::new(seed, Stream::Daylight, round);
            of_meters.par_iter_mut().enumerate().for_each(|(index, batches)| {
                for (batch, sums) in batches.iter_mut().enumerate() {
                    let mut rng = key.rng((index * BATCHES + batch) as u64);
                    sums.add((scene, accel), &meters[index], &targets, side, &mut rng);
                }
            });
            paths_of_batch += u64::from(side * side);
            observer(BATCHES as u64 * paths_of_batch);
            let took = start.elapsed().as_secs_f64();
            let is_over = match end {
                End::Time(end) => left(end) < 0.5 * took,
                End::Paths(paths) => BATCHES as u64 * paths_of_batch >= paths,
            };
            if is_over || interrupt.load(Ordering::Relaxed) {
                break;
            }
            // Finer strata have less noise. All paths weigh the same.
            if 4.0 * took < ROUND * whole && side < MOST_SIDE {
                side *= 2;
            }
        }
        let paths = BATCHES as u64 * paths_of_batch;
        Ok(Self { of_meters, paths_of_batch, paths })
    }
}
