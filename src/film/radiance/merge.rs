//! One image from two of other iterations.

use super::{Deviations, Film, PixelSums, luminance};
use rayon::prelude::*;

/// Pixels that a thread takes at once.
const CHUNK: usize = 4096;

impl Film {
    /// Adds the iterations of another image of the same pixels.
    pub(crate) fn merge(&mut self, other: &Self) {
        let [n, m] = [self.iterations, other.iterations].map(|n| n as f64);
        let both = n * m > 0.0;
        let chunks = self.sums.par_chunks_mut(CHUNK).zip(other.sums.par_chunks(CHUNK));
        let between: Vec<f64> = chunks
            .map(|(sums, others)| {
                let add = |(own, new): (&mut PixelSums, &PixelSums)| {
                    let [one, two] = [luminance(own.radiance), luminance(new.radiance)];
                    own.radiance += new.radiance;
                    own.luminance2 += new.luminance2;
                    if both { (one / n - two / m).powi(2) * n * m / (n + m) } else { 0.0 }
                };
                sums.iter_mut().zip(others).map(add).sum()
            })
            .collect();
        self.deviations.merge(&other.deviations, both.then(|| between.iter().sum()));
        self.iterations += other.iterations;
    }
}

impl Deviations {
    /// Adds those of other iterations, and what tells the distance `between` both means, which has the same
    /// expectation (Chan, Golub and LeVeque 1979): the sum is that of all iterations one after another.
    /// theory.md (62).
    fn merge(&mut self, other: &Self, between: Option<f64>) {
        self.count += other.count;
        self.sum += other.sum;
        self.sum2 += other.sum2;
        if let Some(between) = between {
            self.add(between, 1);
        }
    }
}
