//! One measurement from two of other iterations.

use super::{BATCHES, BatchGrain, NoiseFilm, PixelNoise};
use crate::film::radiance::Tile;

impl NoiseFilm {
    /// Adds what other iterations of the same block measured, at the same grain.
    ///
    /// The squared deviations from two means become those from the mean of all by `(m_1 - m_2)^2 n_1 n_2/(n_1 + n_2)`
    /// (Chan, Golub and LeVeque 1979). This has the variance as its expectation, as the part of any iteration but the
    /// first: it is that of the first one of the others, which had none. theory.md (62).
    pub(crate) fn merge(&mut self, other: &Self, tiles: impl Iterator<Item = Tile>) {
        if other.iterations == 0 {
            return;
        }
        if self.iterations == 0 {
            self.clone_from(other);
            return;
        }
        let counts = [self.iterations, other.iterations].map(|n| n as f64);
        let lead = usize::from(other.counts.first);
        let (mut at, mut group) = (0, 0);
        for tile in tiles {
            let (mut of_tile, here) = (0.0, at..at + tile.len());
            for (own, new) in self.pixels[here.clone()].iter_mut().zip(&other.pixels[here]) {
                let between = own.merge(new, counts);
                match self.grain {
                    BatchGrain::Pixel => {
                        self.batches[group * BATCHES + lead].variance += between as f32;
                        group += 1;
                    }
                    BatchGrain::Tile => of_tile += between,
                }
            }
            if self.grain == BatchGrain::Tile {
                self.batches[group * BATCHES + lead].variance += of_tile as f32;
                group += 1;
            }
            at += tile.len();
        }
        for (own, new) in self.batches.iter_mut().zip(&other.batches) {
            own.coefficients.iter_mut().zip(new.coefficients).for_each(|(sum, x)| *sum += x);
            own.variance += new.variance;
            own.nested.iter_mut().zip(new.nested).for_each(|(sum, d)| *sum += d);
        }
        self.counts.iterations.iter_mut().zip(other.counts.iterations).for_each(|(n, m)| *n += m);
        self.iterations += other.iterations;
    }
}

impl PixelNoise {
    /// Adds the sums over other iterations and returns what their mean's distance adds to the squared deviations.
    fn merge(&mut self, other: &Self, [n, m]: [f64; 2]) -> f64 {
        let between = (self.value / n - other.value / m).powi(2) * n * m / (n + m);
        self.coefficients += other.coefficients;
        self.value += other.value;
        self.deviations2 += other.deviations2 + between;
        self.nested.iter_mut().zip(other.nested).for_each(|(sum, d)| *sum += d);
        self.nested2 += other.nested2;
        between
    }
}
