//! Everything that the report tells, from the files of a complete experiment.

use super::comparisons::{Evidence, findings};
use super::estimators;
use super::estimators::Row;
use super::findings::Finding;
use super::folder::{Experiment, Folder};
use super::implied::{Inconsistency, inconsistencies};
use super::optimum::Optima;
use super::part::Part;
use super::tables::{Cell, cells};
use super::terms::Terms;
use crate::base::atomic::write_atomically;
use crate::base::error::{Error, Result};
use crate::noise::file::NoiseFile;
use crate::noise::region;
use crate::timing::Timings;
use crate::timing::fit::fit;
use serde::Serialize;

/// The numbers; the pictures are made from `noise`.
#[derive(Clone, Debug, Serialize)]
pub struct Results {
    /// What was measured with what.
    pub experiment: Experiment,
    /// Rendering time of all parts, seconds.
    pub seconds: f64,
    /// Figures 2 and 3, at `N_B = 25` and `100`.
    pub terms: [Terms; 2],
    /// Tables 1 and 2.
    pub cells: Vec<Cell>,
    /// The time model, fitted to the cells as in the paper.
    pub timings: Timings,
    /// The minimum of Figure 4.
    pub optima: Optima,
    /// Halves beside all pairs.
    pub estimators: Vec<Row>,
    /// What is the same.
    pub findings: Vec<Finding>,
    /// Where the paper contradicts itself.
    pub inconsistencies: Vec<Inconsistency>,
    /// The noise of every pixel at `N_B = 25` and `100`.
    #[serde(skip)]
    pub noise: [NoiseFile; 2],
    /// Pixels of the region.
    #[serde(skip)]
    pub region: Vec<usize>,
}

impl Results {
    /// Reads the files of a complete experiment.
    ///
    /// # Errors
    /// If one cannot be read, or the times cannot be fitted.
    pub fn new(folder: &Folder, experiment: Experiment) -> Result<Self> {
        let [few, halves, many, ..] = Part::all()[..] else {
            unreachable!("the list begins with these three")
        };
        let load = |part: &Part| folder.load_noise(part);
        let (few, halves, many) = (load(&few)?, load(&halves)?, load(&many)?);
        let region = region::pixels(&experiment.identity.region, &few.noise)?;
        let setup = experiment.identity.setup.clone();
        let samples: Vec<_> = experiment.done.iter().flat_map(|done| done.times.clone()).collect();
        let timings = Timings::new(fit(&samples, setup.pixels())?, setup);

        let terms = [&few.noise, &many.noise].map(|noise| Terms::new(noise, &region));
        let cells = cells(&experiment.done, &few.noise, &region, &timings.model);
        let optima = Optima::new(&few.noise, &region, timings.model);
        if halves.noise.iterations != few.noise.iterations {
            return Err(Error::new(
                "the parts in this folder are not of the same experiment",
                "measure anew with another folder as --output",
            ));
        }
        let estimators = estimators::compare(&few.noise, &halves.noise, &region);
        let evidence = Evidence {
            noise: [&few.noise, &many.noise],
            region: &region,
            terms: &terms,
            cells: &cells,
            model: &timings.model,
            optima: &optima,
        };
        let findings = findings(&evidence);
        Ok(Self {
            seconds: experiment.done.iter().map(|done| done.seconds).sum(),
            experiment,
            terms,
            cells,
            timings,
            optima,
            estimators,
            findings,
            inconsistencies: inconsistencies(),
            noise: [few, many],
            region,
        })
    }

    /// Writes `results.json`, `table-1-and-2.csv` and `findings.csv`.
    ///
    /// # Errors
    /// If a file cannot be written; names it.
    pub fn write_data(&self, folder: &Folder) -> Result<()> {
        let json = serde_json::to_string_pretty(self).expect("plain numbers and texts");
        write_atomically(&folder.path("results.json"), |file| writeln!(file, "{json}"))?;
        self.write_cells(folder)?;
        self.write_findings(folder)
    }

    fn write_cells(&self, folder: &Folder) -> Result<()> {
        write_csv(folder, "table-1-and-2.csv", &CELL_COLUMNS, &self.cells, |cell| {
            let [camera, light, merge, rest] = cell.parts;
            let error = |error: Option<f64>| error.unwrap_or(f64::NAN);
            let numbers = [
                f64::from(cell.light_paths),
                f64::from(cell.camera_paths),
                cell.iterations as f64,
                cell.sampled.value,
                error(cell.sampled.error),
                cell.formula.value,
                error(cell.formula.error),
                cell.mean_of_roots.value,
                error(cell.mean_of_roots.error),
                cell.time.value,
                error(cell.time.error),
                camera,
                light,
                merge,
                rest,
                cell.model_time,
                cell.after.value,
                error(cell.after.error),
                cell.model_after.value,
                error(cell.model_after.error),
            ];
            numbers.map(|number| number.to_string()).to_vec()
        })
    }

    fn write_findings(&self, folder: &Folder) -> Result<()> {
        write_csv(folder, "findings.csv", &FINDING_COLUMNS, &self.findings, |finding| {
            let number = |x: Option<f64>| x.map_or(String::new(), |x| x.to_string());
            vec![
                finding.name.clone(),
                finding.printed.to_string(),
                number(finding.implied),
                finding.here.value.to_string(),
                number(finding.here.error),
                finding.tolerance.to_string(),
                finding.verdict.text().into(),
                finding.reason.clone(),
            ]
        })
    }
}

const CELL_COLUMNS: [&str; 20] = [
    "light_paths",
    "camera_paths",
    "iterations",
    "rms_sampled",
    "rms_sampled_error",
    "rms_formula",
    "rms_formula_error",
    "mean_of_roots_sampled_over_formula",
    "mean_of_roots_sampled_over_formula_error",
    "seconds",
    "seconds_error",
    "seconds_camera",
    "seconds_light",
    "seconds_merge",
    "seconds_rest",
    "seconds_model",
    "rms_after_1000_s",
    "rms_after_1000_s_error",
    "rms_after_1000_s_model",
    "rms_after_1000_s_model_error",
];

const FINDING_COLUMNS: [&str; 8] =
    ["quantity", "printed", "implied", "here", "here_error", "tolerance", "verdict", "reason"];

fn write_csv<T>(
    folder: &Folder,
    name: &str,
    columns: &[&str],
    rows: &[T],
    fields: impl Fn(&T) -> Vec<String>,
) -> Result<()> {
    write_atomically(&folder.path(name), |file| {
        let mut csv = csv::Writer::from_writer(file);
        csv.write_record(columns)?;
        for row in rows {
            csv.write_record(fields(row))?;
        }
        csv.flush()
    })
}
