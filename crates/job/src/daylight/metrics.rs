//! Metrics of a year of daylight, each with an interval.
//!
//! An hour counts toward a share of hours if its whole interval of 95 % does, and may count if a
//! part of it does. The interval of the share reaches from the former to the latter.

use super::coefficients::{BATCHES, Coefficients};
use super::year::{HourLight, Year};
use crate::measurement::{Estimated, MeterPlace};
use bdpm_core::accel::Intersect;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::quantiles::student_95;
use bdpm_core::scene::{Meter, MeterSet, Scene};
use bdpm_core::transport::daylight::{DaylightSums, straight_sun};
use rayon::prelude::*;
use serde::Serialize;

/// Sunlight from which on an hour counts as one of direct sun, lx: `ASE_1000,250` of IES LM-83.
const SUNLIT: f64 = 1000.0;

/// Hours of direct sun that a point may have: IES LM-83.
const SUNLIT_HOURS: f64 = 250.0;

/// Share of the hours from which on a point counts as daylit, percent: `sDA_300,50%` of IES LM-83.
const DAYLIT: f64 = 50.0;

/// Bounds of useful daylight, lx (Nabil and Mardaljevic 2005, Mardaljevic et al. 2012).
const USEFUL: [f64; 3] = [100.0, 300.0, 3000.0];

/// What counts in a year.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds {
    /// Illuminance of daylight autonomy, lx.
    pub autonomy: f64,
    /// Hours of the clock between which a room is used, every day.
    pub occupied: [f64; 2],
}

impl Default for Thresholds {
    /// 300 lx from 8:00 to 18:00, as in IES LM-83.
    fn default() -> Self {
        Self { autonomy: 300.0, occupied: [8.0, 18.0] }
    }
}

impl Thresholds {
    pub(super) fn check(&self) -> Result<()> {
        let Self { autonomy, occupied: [from, to] } = *self;
        if !(autonomy > 0.0 && autonomy.is_finite()) {
            let problem = format!("daylight autonomy is asked for {autonomy} lx");
            return Err(Error::new(problem, "give a positive illuminance"));
        }
        if !(0.0 <= from && from < to && to <= 24.0) {
            let problem = format!("the room is used from {from} to {to} o'clock");
            return Err(Error::new(problem, "give two hours of a day in order, such as 8-18"));
        }
        Ok(())
    }

    /// Whether an hour counts.
    pub(super) fn counts(&self, hour: &HourLight) -> bool {
        let [from, to] = self.occupied;
        (from..to).contains(&hour.middle)
    }
}

/// Daylight of a year at one meter. Shares are percent of the hours that count.
#[derive(Clone, Debug, Serialize)]
pub struct PointYear {
    /// Mean illuminance over the hours that count, lx.
    pub mean: Estimated,
    /// Daylight autonomy: hours with at least the illuminance asked for.
    pub autonomy: Estimated,
    /// Useful daylight illuminance: hours below 100 lx, from 100 to 300 lx, from 300 to 3000 lx,
    /// and above.
    pub useful: [Estimated; 4],
    /// Hours with over 1000 lx of direct sun.
    pub sun_hours: f64,
    /// Irradiation over the whole solar spectrum in all hours of the file, kWh/m^2, as if surfaces
    /// reflected all of it like light.
    pub irradiation: Estimated,
    /// Mean illuminance by month and hour of the clock, lx; 0 for hours that the file does not
    /// have.
    #[serde(skip)]
    pub by_month: [[f64; 24]; 12],
}

/// Daylight of a year at a set of meters.
#[derive(Clone, Debug)]
pub struct DaylightSet {
    /// Name of the set.
    pub name: String,
    /// Columns and rows.
    pub grid: [u32; 2],
    /// Places of all meters, row by row.
    pub places: Vec<MeterPlace>,
    /// All meters, row by row.
    pub points: Vec<PointYear>,
    /// Spatial daylight autonomy: points with autonomy in half of the hours, percent.
    pub spatial_autonomy: Estimated,
    /// Annual sunlight exposure: points with over 250 hours of direct sun, percent.
    pub sunlight_exposure: f64,
    /// Mean illuminance over all points, lx.
    pub mean: Estimated,
}

impl DaylightSet {
    pub(super) fn new(set: &MeterSet, places: Vec<MeterPlace>, points: Vec<PointYear>) -> Self {
        let count = points.len() as f64;
        let share = |has: &dyn Fn(&PointYear) -> bool| {
            100.0 * points.iter().filter(|point| has(point)).count() as f64 / count
        };
        let value = share(&|own| own.autonomy.value >= DAYLIT);
        let certain = share(&|own| own.autonomy.value - own.autonomy.expanded >= DAYLIT);
        let possible = share(&|own| own.autonomy.value + own.autonomy.expanded >= DAYLIT);
        let mean = points.iter().map(|own| own.mean.value).sum::<f64>() / count;
        // Paths of different meters are independent.
        let squares = points.iter().map(|own| own.mean.expanded.powi(2)).sum::<f64>();
        Self {
            name: set.name.clone(),
            grid: set.grid,
            spatial_autonomy: between(value, certain, possible),
            sunlight_exposure: share(&|own| own.sun_hours > SUNLIT_HOURS),
            mean: Estimated { value: mean, expanded: squares.sqrt() / count },
            places,
            points,
        }
    }

    /// Mean illuminance over all points by month and hour, lx.
    pub fn by_month(&self) -> [[f64; 24]; 12] {
        let mut sums = [[0.0; 24]; 12];
        for (month, hour) in (0..12).flat_map(|month| (0..24).map(move |hour| (month, hour))) {
            let all = self.points.iter().map(|own| own.by_month[month][hour]);
            sums[month][hour] = all.sum::<f64>() / self.points.len() as f64;
        }
        sums
    }
}

/// An estimate in an interval of these ends.
fn between(value: f64, low: f64, high: f64) -> Estimated {
    Estimated { value, expanded: (value - low).max(high - value) }
}

/// Illuminance of an hour at a meter, lx.
struct HourReading {
    value: f64,
    expanded: f64,
}

/// The year of all meters of a set.
pub(super) fn of_meters(
    (scene, accel, meters): (&Scene, &dyn Intersect, &[Meter]),
    sums: &[Vec<DaylightSums>],
    all: &Coefficients,
    year: &Year,
    thresholds: &Thresholds,
) -> Vec<PointYear> {
    let of_meter = |(meter, batches): (&Meter, &Vec<DaylightSums>)| {
        let mut counter = Counter::default();
        for hour in &year.hours {
            let straight = hour
                .sun
                .map_or(0.0, |sun| f64::from(straight_sun(scene, accel, meter, sun.toward)));
            let own = HourLightAt::new(hour, batches, all.paths_of_batch, straight);
            counter.add(hour, &own, thresholds);
        }
        counter.point()
    };
    meters.par_iter().zip(sums).map(of_meter).collect()
}

/// Seconds of [`of_meters`], about: a product and a sum for each meter, hour, batch and bin.
pub(super) fn seconds(meters: usize, year: &Year, threads: usize) -> f64 {
    /// Products of a thread in a second.
    const PER_SECOND: f64 = 1.5e9;
    let hours = year.hours.iter().filter(|hour| !hour.sky.is_empty()).count();
    (meters * hours * BATCHES * year.bins()) as f64 / (PER_SECOND * threads as f64)
}

/// Light of an hour at a meter.
struct HourLightAt {
    /// Illuminances and irradiances by each batch, without straight sunlight, lx and W/m^2.
    lux: [f64; BATCHES],
    watts: [f64; BATCHES],
    /// Straight sunlight, lx and W/m^2.
    sunlight: f64,
    sunlight_watts: f64,
}

impl HourLightAt {
    /// The light by the sums of batches of so many paths, with straight sunlight of so much of a
    /// surface that faces the sun.
    fn new(hour: &HourLight, batches: &[DaylightSums], paths: u64, straight: f64) -> Self {
        let mut own =
            Self { lux: [0.0; BATCHES], watts: [0.0; BATCHES], sunlight: 0.0, sunlight_watts: 0.0 };
        let Some((ground, patches)) = hour.sky.split_last() else { return own };
        for (batch, sums) in batches.iter().enumerate() {
            let (by_ground, by_patches) = sums.sky.split_last().expect("there is a ground");
            let sky: f32 = by_patches.iter().zip(patches).map(|(own, light)| own * light).sum();
            let (sky, by_ground) = (f64::from(sky), f64::from(*by_ground));
            let [sun, sun_watts] = hour.sun.map_or([0.0; 2], |sun| {
                let own = f64::from(sums.suns[sun.group]);
                [own * f64::from(sun.lux), own * sun.watts]
            });
            own.lux[batch] = (sky + by_ground * f64::from(*ground) + sun) / paths as f64;
            let watts = sky * hour.watts_per_lumen + by_ground * hour.ground_watts + sun_watts;
            own.watts[batch] = watts / paths as f64;
        }
        if let Some(sun) = hour.sun {
            own.sunlight = straight * f64::from(sun.lux);
            own.sunlight_watts = straight * sun.watts;
        }
        own
    }

    /// The illuminance, with half of the width of its interval.
    fn reading(&self) -> HourReading {
        let [mean, expanded] = mean_of_batches(&self.lux);
        HourReading { value: mean + self.sunlight, expanded }
    }
}

/// The mean of batches and half of the width of its interval of 95 %.
fn mean_of_batches(values: &[f64; BATCHES]) -> [f64; 2] {
    let count = BATCHES as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|own| (own - mean).powi(2)).sum::<f64>() / (count - 1.0);
    [mean, student_95(count - 1.0) * (variance / count).sqrt()]
}

/// Hours that count.
#[derive(Default)]
struct Counter {
    hours: f64,
    autonomy: [f64; 3],
    useful: [[f64; 3]; 4],
    sun_hours: f64,
    /// Sums over the hours that count, lx. Errors of different hours have the same paths, so that
    /// means have batches of their own.
    lux: [f64; BATCHES],
    sunlight: f64,
    /// Sums over all hours, W/m^2.
    watts: [f64; BATCHES],
    sunlight_watts: f64,
    sums: [[f64; 24]; 12],
    counts: [[f64; 24]; 12],
}

impl Counter {
    fn add(&mut self, hour: &HourLight, light: &HourLightAt, thresholds: &Thresholds) {
        let own = light.reading();
        let (month, clock) = ((hour.month.clamp(1, 12) - 1) as usize, hour.middle as usize % 24);
        self.sums[month][clock] += own.value;
        self.counts[month][clock] += 1.0;
        self.watts.iter_mut().zip(light.watts).for_each(|(sum, own)| *sum += own);
        self.sunlight_watts += light.sunlight_watts;
        if !thresholds.counts(hour) {
            return;
        }
        self.hours += 1.0;
        self.lux.iter_mut().zip(light.lux).for_each(|(sum, own)| *sum += own);
        self.sunlight += light.sunlight;
        self.sun_hours += f64::from(u8::from(light.sunlight > SUNLIT));
        count(&mut self.autonomy, &own, [thresholds.autonomy, f64::INFINITY]);
        let [low, middle, high] = USEFUL;
        let bounds = [-1.0, low, middle, high, f64::INFINITY];
        for (counts, bounds) in self.useful.iter_mut().zip(bounds.windows(2)) {
            count(counts, &own, [bounds[0], bounds[1]]);
        }
    }

    fn point(&self) -> PointYear {
        let hours = self.hours.max(1.0);
        // The mean of batches with what has no noise, over a number.
        let over = |batches: &[f64; BATCHES], exact: f64, number: f64| {
            let [mean, expanded] = mean_of_batches(batches);
            Estimated { value: (mean + exact) / number, expanded: expanded / number }
        };
        let share = |[value, certain, possible]: [f64; 3]| {
            let percent = |own: f64| 100.0 * own / hours;
            between(percent(value), percent(certain), percent(possible))
        };
        let mean_at = |month: usize, clock: usize| {
            self.sums[month][clock] / self.counts[month][clock].max(1.0)
        };
        PointYear {
            mean: over(&self.lux, self.sunlight, hours),
            autonomy: share(self.autonomy),
            useful: self.useful.map(share),
            sun_hours: self.sun_hours,
            irradiation: over(&self.watts, self.sunlight_watts, 1e3),
            by_month: std::array::from_fn(|month| std::array::from_fn(|own| mean_at(month, own))),
        }
    }
}

/// Adds an hour to those from the first to the second bound: by its value, certainly, and possibly.
fn count([value, certain, possible]: &mut [f64; 3], own: &HourReading, [from, to]: [f64; 2]) {
    let HourReading { value: lux, expanded } = *own;
    let (low, high) = (lux - expanded, lux + expanded);
    *value += f64::from(u8::from((from..to).contains(&lux)));
    *certain += f64::from(u8::from(low >= from && high < to));
    *possible += f64::from(u8::from(high >= from && low < to));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hours_count_certainly_or_possibly() {
        let mut counts = [0.0; 3];
        for (value, expanded) in [(310.0, 5.0), (310.0, 20.0), (290.0, 20.0), (100.0, 5.0)] {
            count(&mut counts, &HourReading { value, expanded }, [300.0, f64::INFINITY]);
        }
        assert_eq!(counts, [2.0, 1.0, 3.0]);
        let own = between(50.0, 25.0, 75.0);
        assert_eq!((own.value, own.expanded), (50.0, 25.0));
    }

    #[test]
    fn impossible_thresholds_are_refused() {
        let check = |autonomy, occupied| Thresholds { autonomy, occupied }.check().is_ok();
        assert!(Thresholds::default().check().is_ok());
        assert!(!check(0.0, [8.0, 18.0]) && !check(f64::NAN, [8.0, 18.0]));
        assert!(!check(300.0, [18.0, 8.0]) && !check(300.0, [8.0, 25.0]));
    }

    #[test]
    fn interval_of_batches_is_that_of_student() {
        let values = std::array::from_fn(|batch| 10.0 + (batch % 2) as f64);
        let [mean, expanded] = mean_of_batches(&values);
        // The sample variance is 16/15 of a quarter.
        let expected = student_95(15.0) * (0.25 * 16.0 / 15.0 / 16.0f64).sqrt();
        assert!((mean - 10.5).abs() < 1e-12 && (expanded - expected).abs() < 1e-12);
    }
}
