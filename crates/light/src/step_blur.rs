//! What the steps of a goniophotometer blur: each of its intensities is a mean over the directions
//! within a step, which lowers narrow beams.
//!
//! The mean over a hat function of the width `h` has the value `f + h^2 f''/12`, and an average
//! over neighbors with the weights 1/6, 2/3, 1/6 adds `h^2 f''/6`. Half of the change by this
//! average therefore is the blur. At a pole, the average has half of the pole and half of the ring
//! around it.

/// Share of the greatest intensity that steps may blur.
const ALLOWED: f64 = 0.01;

/// Share that suggested steps blur.
const AIM: f64 = 0.005;

/// Steps that are suggested, degrees.
const STEPS: [f64; 9] = [10.0, 5.0, 2.5, 2.0, 1.0, 0.5, 0.25, 0.2, 0.1];

/// Shares by which steps lower the greatest intensity of a distribution; narrow beams lose more.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepBlur {
    /// By the step of gamma.
    pub gamma: f64,
    /// By the step of C.
    pub c: f64,
}

impl StepBlur {
    /// The blur at the greatest of these intensities at the nodes of a grid: gamma from 0 to 180
    /// degrees, row by row, in so many C planes of a whole turn.
    ///
    /// # Panics
    /// If the nodes are no rows of planes.
    pub fn new(planes: usize, values: &[f64]) -> Self {
        assert!(planes > 0 && values.len().is_multiple_of(planes), "rows of planes");
        let greatest = (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b]));
        let at = greatest.unwrap_or_default();
        let (row, plane, last) = (at / planes, at % planes, values.len() / planes - 1);
        let value = |row: usize, plane: usize| values[row * planes + plane % planes];
        let ring = |row: usize| (0..planes).map(|own| value(row, own)).sum::<f64>() / planes as f64;
        let own = values.get(at).copied().unwrap_or_default();
        // Half of the change by the average over neighbors
        let (gamma, c) = if last == 0 {
            (0.0, 0.0)
        } else if row == 0 || row == last {
            (0.25 * (own - ring(if row == 0 { 1 } else { last - 1 })), 0.0)
        } else {
            let across = value(row, plane + 1) + value(row, plane + planes - 1);
            let along = value(row - 1, plane) + value(row + 1, plane);
            ((2.0 * own - along) / 12.0, (2.0 * own - across) / 12.0)
        };
        let share = |lost: f64| if lost > 0.0 { lost / (own + lost) } else { 0.0 };
        Self { gamma: share(gamma), c: share(c) }
    }

    /// Returns true if a share is more than is allowed and more than noise makes likely; `error` is
    /// the relative standard error of the greatest intensity.
    fn is_coarse(share: f64, error: f64) -> bool {
        // A greatest node is above its neighbors by some standard errors, of which the blur has a
        // quarter or less.
        share > ALLOWED && share > error
    }

    /// A note if steps, degrees, are too coarse for the beam; `error` is the relative standard
    /// error of the greatest intensity.
    pub fn note(&self, [gamma_step, c_step]: [f64; 2], error: f64) -> Option<String> {
        let options = [("--gamma-step", self.gamma, gamma_step), ("--c-step", self.c, c_step)];
        let coarse = options.into_iter().filter(|(_, share, _)| Self::is_coarse(*share, error));
        let finer = |(name, share, step): (&str, f64, f64)| {
            let wanted = step * (AIM / share).sqrt();
            let finest = STEPS[STEPS.len() - 1];
            let step = STEPS.into_iter().find(|own| *own <= wanted).unwrap_or(finest);
            format!("{name} {step}")
        };
        let advice: Vec<String> = coarse.map(finer).collect();
        (!advice.is_empty()).then(|| {
            format!(
                "the beam is narrow for the steps of {gamma_step} degrees of gamma and {c_step} of C: intensities in the \
                 files are means over a step, which lowers the greatest by at least {:.1} % and widens the beam: give {}",
                100.0 * (self.gamma + self.c),
                advice.join(" and ")
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLANES: usize = 24;

    /// Means over steps of 5 degrees of a beam with this beam angle around the nadir, degrees.
    fn beam(angle: f64) -> Vec<f64> {
        let own = |gamma: f64| (-4.0 * 2f64.ln() * (gamma / angle).powi(2)).exp();
        let of_row = |row: usize| {
            let (mut sum, mut weights) = (0.0, 0.0);
            for sample in 0..2000 {
                let off = (f64::from(sample) + 0.5) / 1000.0 - 1.0;
                let gamma = 5.0 * (row as f64 + off);
                let weight = (1.0 - off.abs()) * gamma.to_radians().sin();
                if weight > 0.0 && gamma < 180.0 {
                    (sum, weights) = (sum + weight * own(gamma), weights + weight);
                }
            }
            sum / weights
        };
        (0..37).flat_map(|row| [of_row(row); PLANES]).collect()
    }

    #[test]
    fn blur_of_a_beam_is_what_it_lost() {
        for angle in [60.0, 40.0, 23.0] {
            let values = beam(angle);
            let (lost, blur) = (1.0 - values[0], StepBlur::new(PLANES, &values));
            assert!((blur.gamma / lost - 1.0).abs() < 0.15 && blur.c == 0.0, "{angle}: {blur:?}");
        }
    }

    #[test]
    fn note_suggests_a_step_only_for_narrow_beams() {
        let steps = [5.0, 15.0];
        let note = |angle: f64, error: f64| StepBlur::new(PLANES, &beam(angle)).note(steps, error);
        assert_eq!(note(60.0, 0.0), None);
        let narrow = note(23.0, 0.0).unwrap();
        assert!(
            narrow.contains("at least 3.4 %") && narrow.ends_with("give --gamma-step 1"),
            "{narrow}"
        );
        assert_eq!(note(23.0, 0.2), None, "noise");
        assert!(note(8.0, 0.0).unwrap().contains("--gamma-step 0.5"));
    }

    #[test]
    fn blur_across_planes_is_that_of_the_step_of_c() {
        let mut values = vec![0.1; 37 * PLANES];
        let at = |row: usize, plane: usize| row * PLANES + plane;
        // Beside the first plane, so that planes close.
        for (row, plane, value) in
            [(9, 0, 1.0), (8, 0, 1.0), (10, 0, 1.0), (9, 1, 0.4), (9, 23, 0.4)]
        {
            values[at(row, plane)] = value;
        }
        // The last of equal maxima counts.
        values[at(9, 0)] = 1.0 + 1e-9;
        let blur = StepBlur::new(PLANES, &values);
        assert!(blur.gamma < 1e-6 && (blur.c - 0.1 / 1.1).abs() < 1e-6, "{blur:?}");
        assert!(blur.note([5.0, 15.0], 0.0).unwrap().ends_with("give --c-step 2.5"));
        let even = StepBlur::new(PLANES, &[1.0; 37 * PLANES]);
        assert_eq!(even, StepBlur { gamma: 0.0, c: 0.0 });
    }
}
