//! Sums over disjoint subsets of the iterations, so that an estimate from some of them can be
//! tested on the others.

use super::cells::CellGrid;
use super::statistic::{CurrentIteration, PixelSample, PixelStatistic, StatisticRequest};
use super::tiled_buffer::{Accumulate, TiledBuffer};
use crate::settings::Settings;
use bdpm_base::math::Rgb;
use bytemuck::Zeroable;
use serde::{Deserialize, Serialize};

/// Folds for cross-validation of the denoiser.
pub const DENOISE_FOLDS: usize = 8;

/// Sums over the iterations of each of `n` folds. Iteration `i` belongs to fold `i % n`. A
/// statistic without cross-validation has one fold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FoldedBuffer<T> {
    folds: Vec<TiledBuffer<T>>,
    iterations: Vec<u64>,
}

/// Sums of one pixel that make a [`PixelStatistic`].
pub trait FoldedStatistic: Accumulate + Clone + Zeroable {
    /// Share of the memory that is written.
    const WRITTEN: f64 = 1.0;

    /// Number of folds that `request` includes; 0 if it does not include this statistic.
    fn folds(request: &StatisticRequest) -> usize;

    /// Whether an image with these settings can have this number of folds.
    fn is_possible(folds: usize, settings: &Settings) -> bool;
}

impl<T> FoldedBuffer<T> {
    /// Number of iterations of each fold.
    pub fn iterations(&self) -> &[u64] {
        &self.iterations
    }

    /// Number of iterations of all folds.
    pub fn total(&self) -> u64 {
        self.iterations.iter().sum()
    }

    /// Sums of each fold over its iterations.
    pub fn folds(&self) -> &[TiledBuffer<T>] {
        &self.folds
    }

    /// Sums of each fold, of the pixel with index `at` in tile order.
    pub fn at(&self, at: usize) -> impl Iterator<Item = &T> {
        self.folds.iter().map(move |fold| &fold.values()[at])
    }

    fn fold_of(&self, iteration: CurrentIteration) -> usize {
        (iteration.number % self.folds.len() as u64) as usize
    }
}

impl<T: FoldedStatistic> PixelStatistic for FoldedBuffer<T> {
    type Tile<'a>
        = &'a mut [T]
    where
        T: 'a;

    fn start(request: &StatisticRequest) -> Option<Self> {
        let n = T::folds(request);
        let folds = || (0..n).map(|_| TiledBuffer::of_cells(grid::<T>(request.settings)));
        (n > 0).then(|| Self { folds: folds().collect(), iterations: vec![0; n] })
    }

    fn bytes_per_pixel(request: &StatisticRequest) -> f64 {
        let bytes = T::WRITTEN * (T::folds(request) * size_of::<T>()) as f64;
        bytes / grid::<T>(request.settings).pixels_per_cell()
    }

    fn fits(statistic: Option<&Self>, settings: &Settings) -> bool {
        let Some(Self { folds, iterations }) = statistic else {
            return T::is_possible(0, settings);
        };
        !folds.is_empty()
            && T::is_possible(folds.len(), settings)
            && iterations.len() == folds.len()
            && folds.iter().all(|fold| fold.fits_cells(grid::<T>(settings)))
    }

    fn tiles_mut(&mut self, iteration: CurrentIteration) -> Vec<&mut [T]> {
        let fold = self.fold_of(iteration);
        self.folds[fold].tiles_mut().into_iter().map(|(_, sums)| sums).collect()
    }

    fn end_iteration(&mut self, iteration: CurrentIteration) {
        let fold = self.fold_of(iteration);
        self.iterations[fold] += 1;
    }

    fn can_merge(one: Option<&Self>, other: Option<&Self>) -> bool {
        let [one, other] = [one, other].map(|buffer| buffer.map_or(0, |own| own.folds.len()));
        one == other
    }

    fn merge(&mut self, other: &Self) {
        self.folds.iter_mut().zip(&other.folds).for_each(|(own, other)| own.merge(other));
        self.iterations.iter_mut().zip(&other.iterations).for_each(|(n, m)| *n += m);
    }
}

/// The cells or pixels whose sums are kept.
fn grid<T: Accumulate>(settings: &Settings) -> CellGrid {
    let resolution = settings.resolution();
    if T::BY_CELL { CellGrid::of(resolution) } else { CellGrid::single_pixels(resolution) }
}

/// Sum of the radiance of a pixel, for the error of the denoised image; W/(m^2 sr).
impl Accumulate for Rgb {
    #[inline]
    fn add_sample(&mut self, sample: &PixelSample) {
        *self += sample.value.as_vec3();
    }

    #[inline]
    fn merge(&mut self, other: &Self) {
        *self += *other;
    }
}

impl FoldedStatistic for Rgb {
    fn folds(request: &StatisticRequest) -> usize {
        if request.aovs.folds { DENOISE_FOLDS } else { 0 }
    }

    fn is_possible(folds: usize, _settings: &Settings) -> bool {
        [0, DENOISE_FOLDS].contains(&folds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::aov::AovSelection;
    use crate::film::statistic::{BatchGrain, StatisticTile};
    use crate::settings::PartialSettings;
    use glam::DVec3;

    fn settings() -> Settings {
        let partial = PartialSettings { resolution: Some([20, 3]), ..Default::default() };
        Settings::resolve(&partial, &Default::default(), 1.0).unwrap()
    }

    /// The second pixel of each tile has the iteration's number as its value.
    fn folded(iterations: std::ops::Range<u64>) -> FoldedBuffer<Rgb> {
        let aovs = AovSelection { folds: true, ..AovSelection::default() };
        let (settings, grain) = (&settings(), BatchGrain::Tile);
        let request = StatisticRequest {
            settings,
            aovs,
            grain,
            measured_before: None,
            independent_paths: false,
        };
        let mut folds = FoldedBuffer::<Rgb>::start(&request).unwrap();
        for number in iterations {
            let iteration = CurrentIteration { number, is_measured: false };
            let value = DVec3::splat(number as f64);
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
        assert_eq!((folds.iterations(), folds.total()), (&[2, 2, 2, 1, 1, 1, 1, 1][..], 11));
        let sums: Vec<f32> = folds.at(1).map(|sum| sum.x).collect();
        assert_eq!(sums, [8.0, 10.0, 12.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        assert!(folds.at(0).all(|sum| *sum == Rgb::ZERO));
    }

    #[test]
    fn merged_folds_equal_those_of_all_iterations() {
        let mut merged = folded(0..5);
        merged.merge(&folded(5..11));
        assert_eq!(merged, folded(0..11));
    }

    #[test]
    fn folds_fit_their_own_number_and_resolution_only() {
        let mut folds = folded(0..1);
        let fits = |folds: &FoldedBuffer<Rgb>, settings: &Settings| {
            <FoldedBuffer<Rgb> as PixelStatistic>::fits(Some(folds), settings)
        };
        assert!(fits(&folds, &settings()));
        assert!(!fits(&folds, &Settings { height: 4, ..settings() }));
        assert!(!FoldedBuffer::can_merge(Some(&folds), None));
        folds.folds.pop();
        folds.iterations.pop();
        assert!(!fits(&folds, &settings()));
    }
}
