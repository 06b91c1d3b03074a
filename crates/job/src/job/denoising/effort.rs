//! How much a denoiser does within a time.

use crate::output::denoise::{Quality, TILE};
use bdpm_core::film::folds::DENOISE_FOLDS;

/// Minimum number of tiles in which the error is estimated, if it is not estimated in the whole
/// image.
const MIN_TILES: usize = 4;

/// Time of the error of a single run over that of the run.
const SINGLE_SHARE: f64 = 0.15;

/// Effort of denoising an image with its error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    pub quality: Quality,
    /// Whether noisy guides are denoised first. Otherwise, the denoiser uses noisy guides.
    pub prefilter: bool,
    /// Number of folds that are left out in turn; 0 leaves the error unknown.
    pub folds: usize,
    /// Number of tiles in which the error is estimated; `None` for the whole image.
    pub tiles: Option<usize>,
}

/// Effort without a limit of time.
pub const FULL: Effort =
    Effort { quality: Quality::High, prefilter: true, folds: DENOISE_FOLDS, tiles: None };

/// Effort for a given time that is long enough, and for the checks of a target with fewer folds. In
/// short renders, higher qualities and denoised guides take several times as long and do not reduce
/// the error: docs/measurements/denoising.md.
pub const FAST: Effort =
    Effort { quality: Quality::Fast, prefilter: false, folds: DENOISE_FOLDS, tiles: None };

impl Effort {
    /// The best effort for an image of this number of pixels whose time is at most `runs` times
    /// that of a run of [`Quality::Fast`] on the whole image; `None` if not even one run fits.
    pub fn within(runs: f64, pixels: f64) -> Option<Self> {
        let folds = |folds| Self { folds, ..FAST };
        // As many tiles as fit, for half of the image at most.
        let tile = f64::from(TILE * TILE);
        let fitting =
            ((runs - 1.0) * pixels / (DENOISE_FOLDS as f64 * tile)).min(0.5 * pixels / tile);
        let tiles = fitting.max(0.0) as usize;
        let tiled = (tiles >= MIN_TILES).then_some(Self { tiles: Some(tiles), ..FAST });
        [Some(FAST), Some(folds(DENOISE_FOLDS / 2)), tiled, Some(folds(2)), Some(folds(0))]
            .into_iter()
            .flatten()
            .find(|effort| effort.runs(pixels) <= runs)
    }

    /// The only run that a short render of a large image has time for, with its error in as many
    /// tiles as take little more; without its error if these are too few.
    pub fn single(pixels: f64) -> Self {
        let tile = f64::from(TILE * TILE);
        let tiles = (SINGLE_SHARE * pixels / (DENOISE_FOLDS as f64 * tile)) as usize;
        match tiles >= MIN_TILES {
            true => Self { tiles: Some(tiles), ..FAST },
            false => Self { folds: 0, ..FAST },
        }
    }

    /// Effort for the checks of a target: four folds of a small image, or tiles of a large one.
    pub fn of_check(pixels: f64) -> Self {
        Self::within((DENOISE_FOLDS / 2 + 1) as f64, pixels).expect("several runs fit")
    }

    /// Time as a factor of a run of [`Quality::Fast`] on the whole image. Measured:
    /// docs/measurements/denoising.md.
    pub fn runs(self, pixels: f64) -> f64 {
        let run = match self.quality {
            Quality::Fast => 1.0,
            Quality::High => 4.7,
        };
        let prefilter = if self.prefilter { 2.0 * run } else { 0.0 };
        let share = self.tiles.map_or(1.0, |tiles| tiles as f64 * f64::from(TILE * TILE) / pixels);
        prefilter + run * (self.folds as f64 * share + 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effort_is_the_best_one_that_fits() {
        let (small, large) = (128.0 * 128.0, 1024.0 * 1024.0);
        let within = |runs: f64, pixels: f64| {
            let effort = Effort::within(runs, pixels)?;
            assert!(effort.runs(pixels) <= runs);
            Some((effort.folds, effort.tiles))
        };
        assert_eq!(within(9.0, small), Some((8, None)));
        assert_eq!(within(5.0, small), Some((4, None)));
        assert_eq!(within(3.0, small), Some((2, None)));
        assert_eq!(within(4.9, large), Some((8, Some(31))));
        assert_eq!(within(1.6, large), Some((8, Some(4))));
        assert_eq!(within(1.4, large), Some((0, None)));
        assert_eq!(within(0.9, large), None);
        assert!(FULL.runs(small) > FAST.runs(small));
    }
}
