//! A measurement as JSON.

use bdpm::Measurement;
use bdpm::measurement::{Estimated, Judged, Reading, SetReadings};
use serde::Serialize;

/// A measurement. All uncertainties are in the units of the values.
#[derive(Serialize)]
pub struct MeasureReport<'a> {
    scene: &'a str,
    /// Probability of the intervals `value +- expanded`.
    probability: f64,
    /// Largest allowed expanded uncertainty over the value.
    target_error: Option<f64>,
    /// True if all meters reached the target.
    reached: bool,
    seconds: f64,
    /// Group of lights, quantity, technique and counts of each render job.
    techniques: &'a [String],
    /// Light that is missing.
    notes: &'a [String],
    meters: Vec<SetReport<'a>>,
}

#[derive(Serialize)]
struct SetReport<'a> {
    name: &'a str,
    quantity: &'static str,
    unit: &'static str,
    columns: u32,
    rows: u32,
    mean: ReadingReport,
    /// Minimum, maximum and uniformities of the true values, each with half of the width of its
    /// interval.
    minimum: f64,
    minimum_expanded: f64,
    maximum: f64,
    maximum_expanded: f64,
    /// Minimum over the mean.
    uniformity: f64,
    uniformity_expanded: f64,
    /// Minimum over the maximum.
    diversity: f64,
    diversity_expanded: f64,
    /// Row by row: positions in the coordinates of the scene's file, and unit vectors along the
    /// normals of planes or the axes of cones.
    positions: Vec<[f64; 3]>,
    normals: Vec<[f32; 3]>,
    /// Row by row.
    readings: Vec<ReadingReport>,
    /// Row by row, where it is required: the unified glare rating of an eye at each meter, which
    /// looks along its normal; none for eyes with no luminaire in view.
    ugr: &'a [Option<Estimated>],
    /// What is required of the set, with what was found and a verdict: `met`, `not-met` or
    /// `not-decided`.
    requirements: Vec<Judged>,
    /// Factor on the mean in `requirements`.
    maintenance_factor: f64,
    /// Readings under each group of lights alone. Their errors are independent.
    groups: Vec<GroupReport<'a>>,
}

#[derive(Serialize)]
struct GroupReport<'a> {
    name: &'a str,
    mean: ReadingReport,
    readings: Vec<ReadingReport>,
}

#[derive(Serialize)]
struct ReadingReport {
    #[serde(flatten)]
    reading: Reading,
    indirect: f64,
}

impl From<&Reading> for ReadingReport {
    fn from(reading: &Reading) -> Self {
        Self { reading: *reading, indirect: reading.indirect() }
    }
}

impl<'a> MeasureReport<'a> {
    /// The report of a measurement in the scene of this name.
    pub fn new(scene: &'a str, target_error: Option<f64>, measurement: &'a Measurement) -> Self {
        Self {
            scene,
            probability: 0.95,
            target_error,
            reached: measurement.reached,
            seconds: measurement.time.as_secs_f64(),
            techniques: &measurement.techniques,
            notes: &measurement.warnings,
            meters: measurement.sets.iter().map(SetReport::new).collect(),
        }
    }
}

impl<'a> SetReport<'a> {
    fn new(set: &'a SetReadings) -> Self {
        let [minimum, maximum] = set.extremes();
        let (uniformity, diversity) = (set.uniformity(), set.diversity());
        let readings = |own: &[Reading]| own.iter().map(ReadingReport::from).collect();
        let group = |(name, own, mean): &'a (String, Vec<Reading>, Reading)| GroupReport {
            name,
            mean: mean.into(),
            readings: readings(own),
        };
        Self {
            name: &set.name,
            quantity: set.quantity(),
            unit: set.unit(),
            columns: set.grid[0],
            rows: set.grid[1],
            mean: (&set.mean).into(),
            minimum: minimum.value,
            minimum_expanded: minimum.expanded,
            maximum: maximum.value,
            maximum_expanded: maximum.expanded,
            uniformity: uniformity.value,
            uniformity_expanded: uniformity.expanded,
            diversity: diversity.value,
            diversity_expanded: diversity.expanded,
            positions: set.places.iter().map(|place| place.position.to_array()).collect(),
            normals: set.places.iter().map(|place| place.normal.to_array()).collect(),
            readings: readings(&set.readings),
            ugr: &set.ugr,
            requirements: set.judged(),
            maintenance_factor: set.requirement.maintenance,
            groups: set.groups.iter().map(group).collect(),
        }
    }
}
