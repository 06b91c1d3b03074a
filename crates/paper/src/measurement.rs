//! The measurements of the experiment.

use super::published::{CAMERA_PATHS, LIGHT_PATHS, TABLE_1, TABLE_1_CAMERA_PATHS, TABLE_2};
use bdpm_core::noise::Measure;
use serde::{Deserialize, Serialize};

/// Share of the time for each of the three measurements of the noise in every pixel.
const NOISE_SHARE: f64 = 0.2;

/// Share of the time for all cells of the tables.
const CELLS_SHARE: f64 = 0.36;

/// One in this many iterations of a cell does not measure the noise: its time is that of
/// production.
const TIMED_EVERY: u64 = 3;

/// Iterations at one pair of counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Measurement {
    /// Purpose of the iterations.
    pub purpose: Purpose,
    /// `N_F`.
    pub light_paths: u32,
    /// `N_B`.
    pub camera_paths: u32,
}

/// Purpose of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Purpose {
    /// The noise of every pixel from all pairs: Figures 1 to 3, and all predictions.
    Pairs,
    /// The noise of every pixel by the paper's halves, from the paths of the first measurement.
    Halves,
    /// A cell of Table 1 or 2: noise of the region, and times.
    Cell,
}

impl Measurement {
    /// All measurements, in order.
    pub fn all() -> Vec<Self> {
        let measurement =
            |purpose, light_paths, camera_paths| Self { purpose, light_paths, camera_paths };
        let [few, many] = CAMERA_PATHS;
        let noise = [(Purpose::Pairs, few), (Purpose::Halves, few), (Purpose::Pairs, many)];
        let mut all: Vec<Self> =
            noise.into_iter().map(|(purpose, n)| measurement(purpose, LIGHT_PATHS, n)).collect();
        for (n_light, _) in TABLE_1 {
            all.extend(TABLE_1_CAMERA_PATHS.map(|n| measurement(Purpose::Cell, n_light, n)));
        }
        for row in TABLE_2 {
            let cell = measurement(Purpose::Cell, row.light_paths, few);
            if !all.contains(&cell) {
                all.push(cell);
            }
        }
        all
    }

    /// Share of the experiment's time.
    pub fn share(&self) -> f64 {
        match self.purpose {
            Purpose::Pairs | Purpose::Halves => NOISE_SHARE,
            Purpose::Cell => {
                let cells = Self::all().iter().filter(|p| p.purpose == Purpose::Cell).count();
                CELLS_SHARE / cells as f64
            }
        }
    }

    /// How iteration number `iteration` measures the noise.
    pub fn measure(&self, iteration: u64) -> Measure {
        match self.purpose {
            Purpose::Pairs => Measure::Pairs,
            Purpose::Halves => Measure::Halves,
            Purpose::Cell if iteration % TIMED_EVERY == TIMED_EVERY - 1 => Measure::Off,
            Purpose::Cell => Measure::Pairs,
        }
    }

    /// Seed of the random numbers. Measurements are independent, so that each can test predictions
    /// of another. Only the two estimators of the noise get the same paths.
    pub fn seed(&self, seed: u64) -> u64 {
        let source = match self.purpose {
            Purpose::Halves => Self { purpose: Purpose::Pairs, ..*self },
            Purpose::Pairs | Purpose::Cell => *self,
        };
        let index = Self::all().iter().position(|measurement| *measurement == source);
        seed.wrapping_add(index.expect("all measurements are listed") as u64)
    }

    /// Name of the measurement in file names.
    pub fn name(&self) -> String {
        let purpose = match self.purpose {
            Purpose::Pairs => "pairs",
            Purpose::Halves => "halves",
            Purpose::Cell => "cell",
        };
        format!("{purpose}-{}x{}", self.light_paths, self.camera_paths)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn cells_of_both_tables_are_measured_once_with_their_own_seeds() {
        let all = Measurement::all();
        assert_eq!(all.len(), 3 + 24 + 1);
        let names: HashSet<_> = all.iter().map(Measurement::name).collect();
        assert_eq!(names.len(), all.len());
        let seeds: HashSet<_> = all.iter().map(|measurement| measurement.seed(u64::MAX)).collect();
        assert_eq!(seeds.len(), all.len() - 1);
        assert_eq!(all[0].seed(7), all[1].seed(7));
        let share: f64 = all.iter().map(Measurement::share).sum();
        assert!(share > 0.9 && share < 1.0, "some time is for the report: {share}");
    }

    #[test]
    fn third_of_the_iterations_of_cells_is_timed() {
        let cell = Measurement { purpose: Purpose::Cell, light_paths: 100, camera_paths: 5 };
        let off = (0..300).filter(|&i| cell.measure(i) == Measure::Off).count();
        assert_eq!(off, 100);
    }
}
