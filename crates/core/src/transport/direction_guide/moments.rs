//! Moments of contributions by direction, and the densities that they ask for.

use super::DirectionSample;
use super::cell::{BINS, center, density_of, nearest_bins};
use std::f32::consts::PI;

/// Samples for which the directions of the surroundings count.
const PRIOR_SAMPLES: f32 = 4.0;

/// Shape over the bins of one moment; it sums to 1.
type Shape = [f32; BINS];

/// Shapes of first and second moments of contributions over the bins: of all paths, and of each
/// half of them.
#[derive(Clone, Debug)]
pub struct Moments([[Shape; 2]; 3]);

/// All paths.
pub const ALL: usize = 0;

/// The half of a path, and the other one.
pub fn halves(path: u32) -> [usize; 2] {
    if path.is_multiple_of(2) { [1, 2] } else { [2, 1] }
}

/// Solid angles of the bins, sr, as at their centers.
pub fn solid_angles() -> [f32; BINS] {
    std::array::from_fn(|bin| density_of(center(bin)).recip())
}

impl Moments {
    /// Equal moments in all directions.
    pub fn even() -> Self {
        let shape = solid_angles().map(|solid_angle| solid_angle / (4.0 * PI));
        Self([[shape; 2]; 3])
    }

    /// Moments of some samples, where few of them resemble those of their surroundings.
    /// theory.md (44c)
    #[must_use]
    pub fn of<'a>(&self, samples: impl Iterator<Item = &'a DirectionSample>) -> Self {
        let (mut sums, mut squares) = ([[[0.0; BINS]; 2]; 3], [[0.0; 2]; 3]);
        for sample in samples {
            let first = sample.contribution.abs();
            let scores = [first, first * first * sample.pdf_w];
            let bins = nearest_bins(sample.wi);
            for half in [ALL, halves(sample.path)[0]] {
                for (moment, score) in scores.into_iter().enumerate() {
                    squares[half][moment] += score * score;
                    for (bin, share) in bins {
                        sums[half][moment][bin] += share * score;
                    }
                }
            }
        }
        let mut own = self.clone();
        for (half, own) in own.0.iter_mut().enumerate() {
            for (moment, own) in own.iter_mut().enumerate() {
                mix(own, &sums[half][moment], squares[half][moment]);
            }
        }
        own
    }

    /// Probabilities of the bins for the paths of a half. theory.md (44b)
    pub fn probs(&self, half: usize, solid_angles: &[f32; BINS]) -> [f32; BINS] {
        let [first, second] = &self.0[half];
        let roots: Shape = std::array::from_fn(|bin| (second[bin] * solid_angles[bin]).sqrt());
        let total: f32 = roots.iter().sum();
        std::array::from_fn(|bin| 0.5 * (roots[bin] / total + first[bin]))
    }
}

/// Mixes a shape with these sums of scores, whose squares have the sum `squares`.
fn mix(shape: &mut Shape, sums: &Shape, squares: f32) {
    let total: f32 = sums.iter().sum();
    if !(total > 0.0 && squares > 0.0) {
        return;
    }
    // As many samples of equal scores would have the same relative variance.
    let effective = total * total / squares;
    for (shape, sum) in shape.iter_mut().zip(sums) {
        *shape = (effective * sum / total + PRIOR_SAMPLES * *shape) / (effective + PRIOR_SAMPLES);
    }
}
