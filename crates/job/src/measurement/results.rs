//! Readings of all meters of a measurement.

use super::extremes::{Estimated, extremes};
use super::reading::{Reading, quantity, unit};
use super::render_meters::{JobReadings, OfSet, technique};
use super::warnings::unknown_bias;
use bdpm_core::scene::{MeterKind, MeterSet, Scene};
use glam::{DVec3, Vec3};
use std::time::Duration;

/// Minimum number of camera paths of a meter before none of them with light means that a group of
/// lights does not light it.
const DARK_PATHS: f64 = 16384.0;

/// Share of the mean of a set below which the uncertainty of a meter is not compared with its own
/// value.
const LEAST_SHARE: f64 = 0.01;

/// Readings of all meters.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Sets of meters, in the order of the job.
    pub sets: Vec<SetReadings>,
    /// True if all uncertainties reached the target.
    pub reached: bool,
    /// Wall-clock time.
    pub time: Duration,
    /// Group of lights, quantity, chosen technique and path counts of each render job.
    pub techniques: Vec<String>,
    /// Light that the measurement cannot include.
    pub warnings: Vec<String>,
}

impl Measurement {
    /// Meters whose readings under all lights are unknown, as the names of their sets and their
    /// numbers.
    pub fn unknown(&self) -> Vec<(&str, usize)> {
        let of_set = |set: &SetReadings| set.readings.iter().filter(|own| !own.is_known()).count();
        let sets = self.sets.iter().map(|set| (&set.name[..], of_set(set)));
        sets.filter(|(_, count)| *count > 0).collect()
    }

    /// Adds what a render job of a group of lights reports besides its readings.
    pub(super) fn add(&mut self, name: &str, own: &JobReadings) {
        self.techniques.push(format!("{name}, {}: {}", quantity(own.kind), technique(&own.result)));
        if let Some(photons) = &own.photons {
            self.techniques.push(format!("{name}, by mirrors and through glass: {photons}"));
        }
        let warning = unknown_bias(&own.result).filter(|warning| !self.warnings.contains(warning));
        self.warnings.extend(warning);
        if are_dark(&own.readings) {
            let iterations = own.result.state.status.iterations;
            let text = format!("{name}: no light reached a meter in {iterations} iterations");
            self.warnings.push(text);
            self.reached = false;
        }
        let samples = own.result.state.status.iterations as f64;
        let meters = || own.readings.iter().flat_map(|(readings, _)| readings);
        let count = meters().filter(|reading| reading.saw_little(samples)).count();
        if count > 0 {
            self.warnings.push(format!(
                "{name}: not enough light seen by {count} of {} meters of {}: few paths carry much of it, so that \
                 their intervals hold less often than 95 %",
                meters().count(),
                quantity(own.kind)
            ));
            self.reached = false;
        }
        if let Some(failure) = own.result.failure() {
            self.warnings.push(format!("the measurement ended too early: {failure}"));
            self.reached = false;
        }
    }
}

/// Where a meter is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeterPlace {
    /// Position in the coordinates of the scene's file, scene units.
    pub position: DVec3,
    /// Unit normal of its plane, or unit axis of its cone.
    pub normal: Vec3,
}

/// Readings of a set of meters.
#[derive(Clone, Debug)]
pub struct SetReadings {
    /// Name of the set.
    pub name: String,
    /// Quantity of the meters.
    pub kind: MeterKind,
    /// Columns and rows.
    pub grid: [u32; 2],
    /// Places of all meters, row by row.
    pub places: Vec<MeterPlace>,
    /// Readings of all meters, row by row.
    pub readings: Vec<Reading>,
    /// Mean over the meters.
    pub mean: Reading,
    /// Names of groups of lights with the readings of all meters and their mean, if lights were
    /// measured apart.
    pub groups: Vec<(String, Vec<Reading>, Reading)>,
    /// Meters that some group of lights did not light, in too few camera paths to conclude
    /// anything.
    unseen: Vec<usize>,
}

impl SetReadings {
    /// Readings of a single meter at the origin.
    pub fn single(name: &str, kind: MeterKind, reading: Reading) -> Self {
        let (readings, mean) = (vec![reading], reading);
        let (groups, unseen) = (Vec::new(), Vec::new());
        let (name, places) = (name.to_owned(), vec![MeterPlace::default()]);
        Self { name, kind, grid: [1, 1], places, readings, mean, groups, unseen }
    }

    /// Unit of the readings.
    pub fn unit(&self) -> &'static str {
        unit(self.kind)
    }

    /// Minimum and maximum of the true values; unknown if one reading is.
    pub fn extremes(&self) -> [Estimated; 2] {
        extremes(&self.readings)
    }

    /// Uniformity `U_0`: the minimum over the mean.
    pub fn uniformity(&self) -> Estimated {
        self.extremes()[0].over(&(&self.mean).into())
    }

    /// Diversity `U_d`: the minimum over the maximum.
    pub fn diversity(&self) -> Estimated {
        let [least, most] = self.extremes();
        least.over(&most)
    }

    /// Largest relative expanded uncertainty of the meters, or that of the mean. Meters with less
    /// than 1 % of the mean are compared with 1 % of the mean.
    pub fn worst(&self, means_only: bool) -> f64 {
        worst(&self.readings, &self.mean, means_only)
    }

    /// Adds the readings of a group of lights after so many camera paths per meter.
    pub(super) fn add_group(
        &mut self,
        name: &str,
        readings: Vec<Reading>,
        mean: Reading,
        paths: f64,
    ) {
        if paths < DARK_PATHS {
            let dark = (0..).zip(&readings).filter(|(_, own)| own.value == 0.0);
            self.unseen.extend(dark.map(|(index, _)| index));
        }
        if self.readings.is_empty() {
            (self.readings, self.mean) = (readings.clone(), mean);
        } else {
            let sums = self.readings.iter().zip(&readings).map(|(a, b)| a.plus(b)).collect();
            (self.readings, self.mean) = (sums, self.mean.plus(&mean));
        }
        self.groups.push((name.into(), readings, mean));
    }

    /// Makes readings without a contribution unknown, and sums in which a group of lights may be
    /// missing.
    pub(super) fn mark_unseen(&mut self) {
        for index in self.unseen.drain(..) {
            self.readings[index] = Reading::unknown();
        }
        let all = self.readings.iter_mut().chain(std::iter::once(&mut self.mean));
        let of_groups = |(_, own, mean): &mut (String, Vec<Reading>, Reading)| {
            own.iter_mut().for_each(|reading| *reading = reading.if_seen());
            *mean = mean.if_seen();
        };
        all.for_each(|reading| *reading = reading.if_seen());
        self.groups.iter_mut().for_each(of_groups);
    }
}

pub(super) fn empty_readings(set: &MeterSet, scene: &Scene) -> SetReadings {
    let places = set
        .meters
        .iter()
        .map(|meter| MeterPlace { position: scene.in_file(meter.position), normal: meter.normal });
    SetReadings {
        name: set.name.clone(),
        kind: set.kind,
        grid: set.grid,
        places: places.collect(),
        readings: Vec::new(),
        mean: Reading::default(),
        groups: Vec::new(),
        unseen: Vec::new(),
    }
}

/// Returns true if no light was seen.
pub(super) fn are_dark(sets: &[OfSet]) -> bool {
    sets.iter().flat_map(|(readings, _)| readings).all(|reading| reading.value == 0.0)
}

/// The largest relative uncertainty of the sets. Meters without light count only until it is
/// `late`.
pub(super) fn worst_of(sets: &[OfSet], means_only: bool, is_late: bool) -> f64 {
    let of_set = |(readings, mean): &OfSet| {
        let counts = |own: &&Reading| !is_late || own.value != 0.0;
        let readings: Vec<Reading> = readings.iter().filter(counts).copied().collect();
        worst(&readings, mean, means_only)
    };
    sets.iter().map(of_set).fold(0.0, f64::max)
}

pub(super) fn worst(readings: &[Reading], mean: &Reading, means_only: bool) -> f64 {
    if means_only {
        return mean.relative(0.0);
    }
    let least = LEAST_SHARE * mean.value;
    readings.iter().map(|reading| reading.relative(least)).fold(0.0, f64::max)
}
