//! One pixel at a fixed number of light paths: what its camera paths gain.

use super::Objective;

/// `V = rest + scaled/n` of a pixel, squared luminance.
#[derive(Clone, Copy)]
pub(super) struct Pixel {
    pub(super) rest: f64,
    pub(super) scaled: f64,
}

impl Pixel {
    pub(super) fn variance(&self, n: f64) -> f64 {
        self.rest + self.scaled / n
    }

    /// What one pixel adds to the sum that the aggregate is made of.
    pub(super) fn term(&self, objective: Objective, n: f64) -> f64 {
        match objective {
            Objective::MeanRms => self.variance(n).sqrt(),
            _ => self.variance(n),
        }
    }

    /// What camera path `n + 1` gains: the decrease of [`Self::term`], without its cancellation.
    /// For `max-rms` the variance before it, as only a pixel above the threshold needs another
    /// path.
    /// theory.md (85).
    pub(super) fn gain(&self, objective: Objective, n: f64) -> f64 {
        let decrease = self.scaled / (n * (n + 1.0));
        match objective {
            Objective::Pooled | Objective::Relative => decrease,
            Objective::MeanRms if decrease == 0.0 => 0.0,
            Objective::MeanRms => {
                decrease / (self.variance(n).sqrt() + self.variance(n + 1.0).sqrt())
            }
            Objective::MaxRms => self.variance(n),
        }
    }

    /// The same without whole numbers: minus the derivative of [`Self::term`].
    /// theory.md (83).
    pub(super) fn rate(&self, objective: Objective, n: f64) -> f64 {
        match objective {
            Objective::Pooled | Objective::Relative => self.scaled / (n * n),
            Objective::MeanRms if self.scaled == 0.0 => 0.0,
            Objective::MeanRms => self.scaled / (2.0 * n * n * self.variance(n).sqrt()),
            Objective::MaxRms => self.variance(n),
        }
    }

    /// The `n` from 0 to `most` at which [`Self::rate`] is `threshold`.
    /// theory.md (84).
    pub(super) fn demand(&self, objective: Objective, threshold: f64, most: f64) -> f64 {
        let Self { rest, scaled } = *self;
        if scaled == 0.0 || threshold == f64::INFINITY {
            return 0.0;
        }
        let n = match objective {
            Objective::Pooled | Objective::Relative => (scaled / threshold).sqrt(),
            Objective::MaxRms if threshold > rest => scaled / (threshold - rest),
            Objective::MaxRms => most,
            // rest n^4 + scaled n^3 = q^2, solved by Newton's method. Either summand alone gives a
            // number that is too high by at most 26 %, from where a convex function leads down.
            Objective::MeanRms => {
                let q = scaled / (2.0 * threshold);
                let start = (q / rest.sqrt()).sqrt().min((q / (2.0 * threshold)).cbrt()).min(most);
                (0..4).fold(start, |n, _| {
                    let square = n * n;
                    let excess = square * n * (rest * n + scaled) - q * q;
                    n - excess / (square * (4.0 * rest * n + 3.0 * scaled))
                })
            }
        };
        n.min(most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OBJECTIVES: [Objective; 3] = [Objective::Pooled, Objective::MeanRms, Objective::MaxRms];

    fn pixels() -> impl Iterator<Item = Pixel> {
        let values = [0.0, 1e-9, 1e-3, 1.0, 1e6];
        values.into_iter().flat_map(move |rest| values.map(|scaled| Pixel { rest, scaled }))
    }

    #[test]
    fn the_demand_has_the_rate_asked_for() {
        for pixel in pixels().filter(|p| p.scaled > 0.0) {
            for objective in OBJECTIVES {
                for n in [1.0, 1.5, 7.0, 1e3, 1e6] {
                    // Where `rest` is nearly all, the variance does not tell the count.
                    if objective == Objective::MaxRms && pixel.rest * n > 1e6 * pixel.scaled {
                        continue;
                    }
                    let rate = pixel.rate(objective, n);
                    let demand = pixel.demand(objective, rate, 1e9);
                    assert!((demand / n - 1.0).abs() < 1e-6, "{objective:?} {n} {demand}");
                }
            }
        }
    }

    #[test]
    fn a_gain_is_a_difference_between_its_rates() {
        for pixel in pixels() {
            for objective in [Objective::Pooled, Objective::MeanRms] {
                for n in [1.0, 2.0, 30.0] {
                    let gain = pixel.gain(objective, n);
                    let difference = pixel.term(objective, n) - pixel.term(objective, n + 1.0);
                    let error = (gain - difference).abs();
                    assert!(error <= 1e-15 * pixel.term(objective, n), "{gain} {difference}");
                    assert!(gain <= pixel.rate(objective, n));
                    assert!(gain >= pixel.rate(objective, n + 1.0));
                }
            }
        }
    }
}
