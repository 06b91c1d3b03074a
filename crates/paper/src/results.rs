//! All results of a complete experiment, from its files.

use super::comparisons::{Evidence, findings};
use super::estimators;
use super::estimators::EstimatorRow;
use super::findings::Finding;
use super::folder::{Experiment, Folder};
use super::implied::{Inconsistency, inconsistencies};
use super::measurement::Measurement;
use super::optimum::Optima;
use super::tables::{Cell, cells};
use super::terms::Terms;
use bdpm_auto::adaptive::optimize::predict::Predicted;
use bdpm_auto::timing::Timings;
use bdpm_auto::timing::fit::fit;
use bdpm_core::base::atomic::write_atomically;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::noise::file::NoiseFile;
use bdpm_core::noise::region;
use serde::Serialize;
use std::path::Path;

/// The numbers; the pictures are made from `noise`.
#[derive(Clone, Debug, Serialize)]
pub struct Results {
    /// The measurements and their conditions.
    pub experiment: Experiment,
    /// Rendering time of all measurements, seconds.
    pub seconds: f64,
    /// Figures 2 and 3, at `N_B = 25` and `100`.
    pub terms: [Terms; 2],
    /// Tables 1 and 2.
    pub cells: Vec<Cell>,
    /// The time model, fitted to the cells as in the paper.
    pub timings: Timings,
    /// The minimum of Figure 4.
    pub optima: Optima,
    /// Halves and all pairs.
    pub estimators: Vec<EstimatorRow>,
    /// Comparisons with the paper.
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
        let [few, halves, many, ..] = Measurement::all()[..] else {
            unreachable!("the list begins with these three")
        };
        let load = |measurement: &Measurement| folder.load_noise(measurement);
        let (few, halves, many) = (load(&few)?, load(&halves)?, load(&many)?);
        let region = region::pixels(&experiment.conditions.region, &few.noise)?;
        let setup = experiment.conditions.setup.clone();
        let samples: Vec<_> = experiment.done.iter().flat_map(|done| done.times.clone()).collect();
        let timings = Timings { setup: Some(setup.clone()), ..fit(&samples, setup.pixels())? };

        let terms = [&few.noise, &many.noise].map(|noise| Terms::new(noise, &region));
        let cells = cells(&experiment.done, &few.noise, &region, &timings.model);
        let optima = Optima::new(&few.noise, &region, timings.model);
        if halves.noise.iterations != few.noise.iterations {
            return Err(Error::new(
                "the files in this folder belong to different experiments",
                "measure again in another folder",
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
        let row = |cell: &Cell| {
            let [camera, light, merge, rest] = cell.parts;
            let error = |predicted: Predicted| predicted.error.unwrap_or(f64::NAN);
            let columns = [
                ("light_paths", f64::from(cell.light_paths)),
                ("camera_paths", f64::from(cell.camera_paths)),
                ("iterations", cell.iterations as f64),
                ("rms_sampled", cell.sampled.value),
                ("rms_sampled_error", error(cell.sampled)),
                ("rms_formula", cell.formula.value),
                ("rms_formula_error", error(cell.formula)),
                ("mean_of_roots_sampled_over_formula", cell.mean_of_roots.value),
                ("mean_of_roots_sampled_over_formula_error", error(cell.mean_of_roots)),
                ("seconds", cell.time.value),
                ("seconds_error", error(cell.time)),
                ("seconds_camera", camera),
                ("seconds_light", light),
                ("seconds_merge", merge),
                ("seconds_rest", rest),
                ("seconds_model", cell.model_time),
                ("rms_after_1000_s", cell.after.value),
                ("rms_after_1000_s_error", error(cell.after)),
                ("rms_after_1000_s_model", cell.model_after.value),
                ("rms_after_1000_s_model_error", error(cell.model_after)),
            ];
            columns.map(|(name, value)| (name, value.to_string()))
        };
        write_csv(&folder.path("table-1-and-2.csv"), self.cells.iter().map(row))
    }

    fn write_findings(&self, folder: &Folder) -> Result<()> {
        let number = |x: Option<f64>| x.map_or(String::new(), |x| x.to_string());
        let row = |finding: &Finding| {
            [
                ("quantity", finding.name.clone()),
                ("printed", finding.printed.to_string()),
                ("implied", number(finding.implied)),
                ("here", finding.here.value.to_string()),
                ("here_error", number(finding.here.error)),
                ("tolerance", finding.tolerance.to_string()),
                ("verdict", finding.verdict.text().into()),
                ("reason", finding.reason.clone()),
            ]
        };
        write_csv(&folder.path("findings.csv"), self.findings.iter().map(row))
    }
}

/// Writes rows of named fields; the first row gives the header.
fn write_csv<const N: usize>(
    path: &Path,
    rows: impl Iterator<Item = [(&'static str, String); N]>,
) -> Result<()> {
    let rows: Vec<_> = rows.collect();
    write_atomically(path, |file| {
        let mut csv = csv::Writer::from_writer(file);
        if let Some(first) = rows.first() {
            csv.write_record(first.iter().map(|(name, _)| name))?;
        }
        for row in &rows {
            csv.write_record(row.iter().map(|(_, field)| field))?;
        }
        csv.flush()
    })
}
