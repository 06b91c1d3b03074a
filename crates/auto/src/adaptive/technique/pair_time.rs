//! Time of a pair of a light path and a camera path, by the merge radius.

use super::Technique;
use super::trial::Trial;
use crate::timing::least_squares::not_negative_parts;
use bdpm_core::settings::MediumQuery;

/// Time of a merge per light path, as a function of the radius. A search in cells reads the photons
/// within a few radii: its time is proportional to the squared radius. A search along segments
/// passes boxes of a tree, of which most hold no photon within the radius: a part of its time is
/// the same at all radii.
#[derive(Clone, Copy, Debug, Default)]
pub struct PairTime {
    /// Seconds, at all radii.
    passing: f64,
    /// Seconds per squared radius, scene units to the power of -2.
    reading: f64,
}

impl PairTime {
    /// Fits the trials of a technique by least squares, since at small radii the time hardly shows.
    pub fn of(technique: Technique, trials: &[Trial]) -> Self {
        let radius = |trial: &Trial| technique.reach(trial.radii);
        let times: Vec<_> = trials.iter().map(|own| [radius(own), own.times.merge_pair]).collect();
        Self::fit(technique.medium_query == Some(MediumQuery::Beams), &times)
    }

    /// Fits pairs of a radius and a time. Of one radius both parts are unknown: the larger one at
    /// smaller radii is on time.
    fn fit(is_along_segments: bool, times: &[[f64; 2]]) -> Self {
        let always = f64::from(u8::from(is_along_segments));
        let columns =
            [vec![always; times.len()], times.iter().map(|[radius, _]| radius * radius).collect()];
        let seconds: Vec<f64> = times.iter().map(|[_, seconds]| *seconds).collect();
        let parts = not_negative_parts(columns, &seconds);
        let [passing, reading] = parts.map(Option::unwrap_or_default);
        Self { passing, reading }
    }

    /// Seconds at a radius, scene units.
    pub fn at(&self, radius: f64) -> f64 {
        self.passing + self.reading * radius * radius
    }

    /// The same law, with this time at a radius.
    #[must_use]
    pub fn through(self, radius: f64, seconds: f64) -> Self {
        let own = self.at(radius);
        if own > 0.0 {
            let factor = seconds / own;
            return Self { passing: factor * self.passing, reading: factor * self.reading };
        }
        let reading = if radius > 0.0 { seconds / (radius * radius) } else { 0.0 };
        Self { passing: 0.0, reading }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_have_a_part_that_no_radius_changes() {
        let law = PairTime { passing: 3.0, reading: 2.0 };
        let times = [0.5, 1.0, 3.0].map(|radius| [radius, law.at(radius)]);
        let [along, in_cells] = [true, false].map(|along| PairTime::fit(along, &times));
        assert!((along.at(0.1) - law.at(0.1)).abs() < 1e-9, "{along:?}");
        assert!(in_cells.passing == 0.0 && (in_cells.at(3.0) / law.at(3.0) - 1.0).abs() < 0.1);
        // One radius, or none at all.
        let one = PairTime::fit(true, &[[2.0, 8.0]]);
        assert_eq!([one.at(2.0), one.at(1.0)], [8.0, 8.0]);
        assert_eq!(PairTime::fit(true, &[[0.0, 0.0]]).at(0.0), 0.0);
        // Neither part is negative.
        for times in [[[1.0, 5.0], [2.0, 4.0]], [[1.0, 1.0], [2.0, 5.0]]] {
            let fitted = PairTime::fit(true, &times);
            assert!(fitted.passing >= 0.0 && fitted.reading >= 0.0, "{fitted:?}");
        }
    }

    #[test]
    fn measured_times_scale_the_law() {
        let law = PairTime { passing: 3.0, reading: 2.0 };
        let measured = law.through(2.0, 5.5);
        assert_eq!([measured.at(2.0), measured.at(1.0)], [5.5, 2.5]);
        let new = PairTime::default().through(2.0, 8.0);
        assert_eq!([new.at(2.0), new.at(1.0), new.through(0.0, 0.0).at(1.0)], [8.0, 2.0, 0.0]);
    }
}
