//! Readings of all meters of a measurement.

use super::darkness::{are_certainly_dark, are_dark};
use super::extremes::{Estimated, extremes, factor_of_all};
use super::polarization::note as polarization_note;
use super::reading::{Reading, quantity, unit};
use super::render_meters::{JobReadings, OfSet, technique};
use super::warnings::unknown_bias;
use bdpm_core::scene::{MeterKind, MeterSet, Requirement, Scene};
use glam::{DVec3, Vec3};
use std::time::Duration;

/// Share of the mean of a set below which the uncertainty of a meter is not compared with its own
/// value.
const LEAST_SHARE: f64 = 0.01;

/// Number of sets that a note names.
const NAMED: usize = 5;

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
    /// Meters whose readings under all lights, or the uncertainties of these, are unknown: the
    /// names of their sets and their numbers.
    pub fn unknown(&self) -> Vec<(&str, usize)> {
        let is_unknown = |own: &&Reading| !own.is_known() || !own.has_uncertainty();
        let of_set = |set: &SetReadings| set.readings.iter().filter(is_unknown).count();
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
        if are_dark(&own.readings) && !are_certainly_dark(&own.readings) {
            let iterations = own.result.state.status.iterations;
            let text = format!("{name}: no light reached a meter in {iterations} iterations");
            self.warnings.push(text);
            self.reached = false;
        }
        let open: usize = own.open.iter().sum();
        if open > 0 {
            let sets = self.sets.iter().filter(|set| set.kind == own.kind);
            let names = sets.zip(&own.open).filter(|(_, open)| **open > 0);
            let names: Vec<String> = names.map(|(set, _)| format!("`{}`", set.name)).collect();
            self.warnings.push(format!(
                "{name}: not enough light seen by {open} of {} meters of {} ({}): few paths carry much of it, so that \
                 the interval is open above and holds less often than 95 %",
                own.readings.iter().map(|(readings, _)| readings.len()).sum::<usize>(),
                quantity(own.kind),
                list(&names)
            ));
            self.reached = false;
        }
        let neglected = own.neglected_polarization;
        self.warnings.extend(neglected.map(|worst| polarization_note(name, worst)));
        if let Some(failure) = own.result.failure() {
            self.warnings.push(format!("the measurement ended too early: {failure}"));
            self.reached = false;
        }
    }
}

/// The first names, and how many more there are.
fn list(names: &[String]) -> String {
    let shown = names.len().min(NAMED);
    match names.len() - shown {
        0 => names.join(", "),
        more => format!("{} and {more} others", names[..shown].join(", ")),
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
    /// Whether they are daylight factors, percent.
    pub is_daylight_factor: bool,
    /// What is required of them.
    pub requirement: Requirement,
    /// Unified glare rating of an eye at each meter, which looks along its normal, if it is
    /// required; `None` for eyes with no luminaire in view.
    pub ugr: Vec<Option<Estimated>>,
    /// Readings of all meters, row by row.
    pub readings: Vec<Reading>,
    /// Number of meters whose intervals are open above.
    pub open: usize,
    /// Mean over the meters.
    pub mean: Reading,
    /// Names of groups of lights with the readings of all meters and their mean, if lights were
    /// measured apart.
    pub groups: Vec<(String, Vec<Reading>, Reading)>,
    /// Number of meters whose intervals are open above, under each of the groups.
    pub open_of_groups: Vec<usize>,
}

impl SetReadings {
    /// Readings of a single meter at the origin.
    pub fn single(name: &str, kind: MeterKind, reading: Reading) -> Self {
        let (readings, mean) = (vec![reading], reading);
        let (name, places) = (name.to_owned(), vec![MeterPlace::default()]);
        let (is_daylight_factor, requirement) = (false, Requirement::default());
        let (grid, open, groups, open_of_groups) = ([1, 1], 0, Vec::new(), Vec::new());
        Self {
            name,
            kind,
            grid,
            places,
            is_daylight_factor,
            requirement,
            ugr: Vec::new(),
            readings,
            open,
            mean,
            groups,
            open_of_groups,
        }
    }

    /// Unit of the readings.
    pub fn unit(&self) -> &'static str {
        if self.is_daylight_factor { "%" } else { unit(self.kind) }
    }

    /// Name of the quantity.
    pub fn quantity(&self) -> &'static str {
        if self.is_daylight_factor { "daylight factor" } else { quantity(self.kind) }
    }

    /// Minimum and maximum of the true values; unknown if one reading is.
    pub fn extremes(&self) -> [Estimated; 2] {
        extremes(&self.readings)
    }

    /// Factor on the widths of the intervals of the meters, with which all of them hold with a
    /// probability of 95 % at once. theory.md (5d)
    pub fn factor_of_all(&self) -> f64 {
        factor_of_all(self.readings.len())
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

    /// Ends the measurement. Illuminances become daylight factors, percent of that outdoors, if it
    /// is given, lx.
    pub(super) fn finish(&mut self, outdoors: Option<f64>, by_light: bool) {
        if !by_light {
            self.groups.clear();
            self.open_of_groups.clear();
        }
        let Some(outdoors) = outdoors else { return };
        let share = |own: &Reading| own.times(100.0 / outdoors);
        self.readings = self.readings.iter().map(share).collect();
        self.mean = share(&self.mean);
        self.is_daylight_factor = true;
    }

    /// Adds the readings of a group of lights. Sums with an unknown reading are unknown.
    pub(super) fn add_group(
        &mut self,
        name: &str,
        readings: Vec<Reading>,
        mean: Reading,
        open: usize,
    ) {
        self.open += open;
        if self.readings.is_empty() {
            (self.readings, self.mean) = (readings.clone(), mean);
        } else {
            let sums = self.readings.iter().zip(&readings).map(|(a, b)| a.plus(b)).collect();
            (self.readings, self.mean) = (sums, self.mean.plus(&mean));
        }
        self.groups.push((name.into(), readings, mean));
        self.open_of_groups.push(open);
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
        is_daylight_factor: false,
        requirement: set.requirement,
        ugr: Vec::new(),
        readings: Vec::new(),
        open: 0,
        mean: Reading::default(),
        groups: Vec::new(),
        open_of_groups: Vec::new(),
    }
}

/// The largest relative uncertainty of the sets. Meters without light count only until it is
/// `late`.
pub(super) fn worst_of(sets: &[OfSet], means_only: bool, is_late: bool) -> f64 {
    let of_set = |(readings, mean): &OfSet| {
        // Unknown values are NaN.
        let counts = |own: &&Reading| !is_late || own.value > 0.0;
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
