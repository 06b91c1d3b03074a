//! Interface of a statistic that is kept per pixel: start, add iterations, merge with other sums.
//!
//! `crates/core/src/render/accumulators.rs` lists all statistics. Everything that a render does
//! with each of them goes over that list. A new statistic takes one file, with a type of sums that
//! implements [`FoldedStatistic`], and one line there.
//!
//! [`FoldedStatistic`]: super::folds::FoldedStatistic

use super::annulus::CLASSES;
use super::aov::{AovSample, AovSelection};
use super::tiled_buffer::Accumulate;
use crate::settings::Settings;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Resolution at which batches of measured iterations are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum BatchGrain {
    /// Batches of each pixel, 384 bytes: standard errors of any function of single pixels.
    Pixel,
    /// Batches of each tile: standard errors of sums over many pixels. Large images keep the sums
    /// of [cells](super::cells).
    #[default]
    Tile,
}

/// Conditions that decide which statistics are kept.
#[derive(Clone, Copy, Debug)]
pub struct StatisticRequest<'a> {
    /// Settings of the image.
    pub settings: &'a Settings,
    /// Layers to be kept beside the image.
    pub aovs: AovSelection,
    /// Resolution of the batches of measured iterations.
    pub grain: BatchGrain,
    /// While an iteration is measured: iterations of the block that were measured before it, here
    /// or by other processes.
    pub measured_before: Option<u64>,
    /// Camera paths draw independent numbers: `RenderConfig::independent_paths` of the renderer.
    pub independent_paths: bool,
}

/// The iteration that is being added.
#[derive(Clone, Copy, Debug)]
pub struct CurrentIteration {
    /// Its number among the iterations of the whole image.
    pub number: u64,
    /// Whether the noise coefficients are measured.
    pub is_measured: bool,
}

/// Result of one iteration for one pixel.
#[derive(Clone, Copy, Debug, Default)]
pub struct PixelSample {
    /// The pixel's value `L_iter`, W/(m^2 sr).
    pub value: DVec3,
    /// Part of the value from photons in the outer annulus, by photon class; `None` if it is not
    /// kept.
    pub annulus: Option<[DVec3; CLASSES]>,
    /// Means over the pixel's camera paths of light components and features; `None` if nothing is
    /// kept or one of them is not finite.
    pub aovs: Option<AovSample>,
}

/// A statistic of each pixel, summed over iterations.
pub trait PixelStatistic: Clone {
    /// Sums of one tile during an iteration.
    type Tile<'a>: StatisticTile
    where
        Self: 'a;

    /// Sums of no iteration; `None` if `request` does not include this statistic.
    fn start(request: &StatisticRequest) -> Option<Self>;

    /// Memory per pixel that `request` takes.
    fn bytes_per_pixel(request: &StatisticRequest) -> f64;

    /// Whether the sums, or their absence, are possible for an image with these settings. They may
    /// come from a file.
    fn fits(statistic: Option<&Self>, settings: &Settings) -> bool;

    /// All tiles, in the order of the image's tiles; none if `iteration` does not add to them.
    fn tiles_mut(&mut self, iteration: CurrentIteration) -> Vec<Self::Tile<'_>>;

    /// Counts an iteration that all tiles have added.
    fn end_iteration(&mut self, iteration: CurrentIteration);

    /// Whether the sums of two parts of an image can be merged.
    fn can_merge(one: Option<&Self>, other: Option<&Self>) -> bool;

    /// Adds the sums of other iterations of the same image.
    fn merge(&mut self, other: &Self);
}

/// One tile of a [`PixelStatistic`].
pub trait StatisticTile {
    /// Result of one iteration for one pixel.
    type Sample;

    /// Whether the values are those of [cells](super::cells), each the mean over its pixels.
    fn is_by_cell(&self) -> bool;

    /// Adds one iteration to the tile's pixel or cell `index`.
    fn add_sample(&mut self, index: usize, sample: &Self::Sample);
}

impl<T: Accumulate> StatisticTile for &mut [T] {
    type Sample = PixelSample;

    #[inline]
    fn is_by_cell(&self) -> bool {
        T::BY_CELL
    }

    #[inline]
    fn add_sample(&mut self, index: usize, sample: &PixelSample) {
        self[index].add_sample(sample);
    }
}
