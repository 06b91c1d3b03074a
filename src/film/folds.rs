//! Sums over disjoint subsets of the iterations, so that an estimate from some of them can be tested
//! on the others.

use super::statistic::{CurrentIteration, PixelStatistic, StatisticRequest};
use super::tiled_buffer::{Accumulate, TiledBuffer};
use crate::base::math::Rgb;
use crate::settings::Settings;
use serde::{Deserialize, Serialize};

/// Folds for cross-validation of the denoiser.
pub const DENOISE_FOLDS: usize = 8;

/// Sums over the iterations of each of `n` folds. Iteration `i` belongs to fold `i % n`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FoldedBuffer<T> {
    folds: Vec<TiledBuffer<T>>,
    iterations: Vec<u64>,
}

impl<T: Clone + Default + Accumulate> FoldedBuffer<T> {
    /// Sums of no iteration.
    pub fn new(resolution: (u32, u32), folds: usize) -> Self {
        Self { folds: vec![TiledBuffer::new(resolution); folds], iterations: vec![0; folds] }
    }

    /// Whether there are `folds` folds of an image of this resolution. They may come from a file.
    pub fn fits(&self, resolution: (u32, u32), folds: usize) -> bool {
        self.folds.len() == folds
            && self.iterations.len() == folds
            && self.folds.iter().all(|fold| fold.fits(resolution))
    }

    /// Iterations of each fold.
    pub fn iterations(&self) -> &[u64] {
        &self.iterations
    }

    /// Sums of each fold over its iterations.
    pub fn folds(&self) -> &[TiledBuffer<T>] {
        &self.folds
    }

    /// Sums of all folds of the pixel with index `at` in tile order.
    pub fn at(&self, at: usize) -> impl Iterator<Item = &T> {
        self.folds.iter().map(move |fold| &fold.values()[at])
    }

    fn fold_of(&self, iteration: u64) -> usize {
        (iteration % self.folds.len() as u64) as usize
    }

    /// Tiles of the fold that `iteration` belongs to.
    pub fn tiles_mut(&mut self, iteration: u64) -> Vec<&mut [T]> {
        let fold = self.fold_of(iteration);
        self.folds[fold].tiles_mut().into_iter().map(|(_, sums)| sums).collect()
    }

    /// Counts an iteration that all tiles have added.
    pub fn end_iteration(&mut self, iteration: u64) {
        let fold = self.fold_of(iteration);
        self.iterations[fold] += 1;
    }

    /// Adds the sums of other iterations in as many folds.
    pub fn merge(&mut self, other: &Self) {
        self.folds.iter_mut().zip(&other.folds).for_each(|(own, other)| own.merge(other));
        self.iterations.iter_mut().zip(&other.iterations).for_each(|(n, m)| *n += m);
    }
}

/// Radiance by fold, for the error of the denoised image; W/(m^2 sr).
pub type RadianceFolds = FoldedBuffer<Rgb>;

impl PixelStatistic for RadianceFolds {
    type Tile<'a> = &'a mut [Rgb];

    fn start(request: &StatisticRequest) -> Option<Self> {
        request.aovs.folds.then(|| Self::new(request.settings.resolution(), DENOISE_FOLDS))
    }

    fn bytes_per_pixel(request: &StatisticRequest) -> usize {
        if request.aovs.folds { DENOISE_FOLDS * size_of::<Rgb>() } else { 0 }
    }

    fn fits(&self, settings: &Settings) -> bool {
        self.fits(settings.resolution(), DENOISE_FOLDS)
    }

    fn tiles_mut(&mut self, iteration: CurrentIteration) -> Vec<&mut [Rgb]> {
        self.tiles_mut(iteration.number)
    }

    fn end_iteration(&mut self, iteration: CurrentIteration) {
        self.end_iteration(iteration.number);
    }

    fn merge(&mut self, other: &Self) {
        self.merge(other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::statistic::{PixelSample, StatisticTile};
    use glam::DVec3;

    /// The second pixel of each tile has the iteration's number as its value.
    fn folded(iterations: std::ops::Range<u64>) -> FoldedBuffer<Rgb> {
        let mut folds = FoldedBuffer::new((20, 3), DENOISE_FOLDS);
        for iteration in iterations {
            let value = DVec3::splat(iteration as f64);
            for tile in &mut folds.tiles_mut(iteration) {
                tile.add_sample(1, &PixelSample { value, ..PixelSample::default() });
            }
            folds.end_iteration(iteration);
        }
        folds
    }

    #[test]
    fn iterations_go_to_the_folds_in_turn() {
        let folds = folded(0..11);
        assert_eq!(folds.iterations(), [2, 2, 2, 1, 1, 1, 1, 1]);
        let sums: Vec<f32> = folds.at(1).map(|sum| sum.x).collect();
        assert_eq!(sums, [8.0, 10.0, 12.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        assert!(folds.at(0).all(|sum| *sum == Rgb::ZERO));
        assert!(folds.fits((20, 3), DENOISE_FOLDS) && !folds.fits((20, 3), 4));
    }

    #[test]
    fn merged_folds_equal_those_of_all_iterations() {
        let mut merged = folded(0..5);
        merged.merge(&folded(5..11));
        assert_eq!(merged, folded(0..11));
    }
}
