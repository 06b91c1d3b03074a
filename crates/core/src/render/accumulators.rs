//! The list of all statistics that a render keeps per pixel, beside the sums of the image itself.
//!
//! Each statistic has a file of its own, which implements [`PixelStatistic`], and one line in one
//! of the two lists below. Blocks, tiles, workers, merges, checkpoints and the memory check go over
//! these lists and name no statistic.

use crate::base::math::Rgb;
use crate::film::annulus::FoldSums;
use crate::film::features::{CompactDepth, DenoiseFeatures, DepthSample};
use crate::film::folds::FoldedBuffer;
use crate::film::halves::LuminanceSum;
use crate::film::light_components::{CAUSTICS, CompactLight, DIRECT, EMISSION, LightComponents};
use crate::film::seen_lights::SeenLight;
use crate::film::statistic::{
    CurrentIteration, PixelSample, PixelStatistic, StatisticRequest, StatisticTile,
};
use crate::noise::film::{NoiseFilm, PixelMeasurement};
use crate::settings::Settings;
use serde::{Deserialize, Serialize};
use std::iter;

/// Result of one iteration for one pixel: the sample of each kind of statistic.
#[derive(Clone, Copy, Debug, Default)]
pub struct IterationSample {
    /// Value and layers of the pixel.
    pub pixel: PixelSample,
    /// Coefficients of the pixel, if they are measured.
    pub measurement: PixelMeasurement,
}

impl IterationSample {
    /// Adds another sample, without its layers.
    fn add(&mut self, other: &Self) {
        let Self { pixel, measurement } = other;
        self.pixel.value += pixel.value;
        if let Some(own) = pixel.annulus {
            let sums = self.pixel.annulus.get_or_insert_default();
            sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        }
        let sums = &mut self.measurement;
        sums.coefficients += measurement.coefficients;
        sums.value += measurement.value;
        sums.nested.iter_mut().zip(measurement.nested).for_each(|(sum, own)| *sum += own);
    }

    /// Multiplies values by `scale`, and coefficients and nested differences by `measured`.
    fn scaled(self, scale: f64, measured: f64) -> Self {
        let PixelMeasurement { coefficients, value, nested } = self.measurement;
        let pixel = PixelSample {
            value: self.pixel.value * scale,
            annulus: self.pixel.annulus.map(|sums| sums.map(|sum| sum * scale)),
            aovs: None,
        };
        let measurement = PixelMeasurement {
            coefficients: coefficients * measured,
            value: value * scale,
            nested: nested.map(|sum| sum * measured),
        };
        Self { pixel, measurement }
    }
}

/// Sums of the samples of each cell of a tile, during one iteration.
#[derive(Debug, Default)]
pub struct CellSamples {
    /// Sums of the samples of the pixels of each cell, without layers.
    sums: Vec<CellSum>,
}

#[derive(Clone, Copy, Debug, Default)]
struct CellSum {
    sample: IterationSample,
    /// Number of pixels.
    pixels: u32,
    /// Number of those that were measured.
    measured: u32,
}

impl CellSamples {
    /// Starts a tile of this many cells.
    pub fn start(&mut self, cells: usize) {
        self.sums.clear();
        self.sums.resize(cells, Default::default());
    }

    /// Adds the sample of a pixel of a cell. A pixel that was not measured has no coefficients and
    /// nested differences.
    pub fn add(&mut self, cell: usize, sample: &IterationSample, is_measured: bool) {
        let sum = &mut self.sums[cell];
        sum.sample.add(sample);
        sum.pixels += 1;
        sum.measured += u32::from(is_measured);
    }

    /// Mean sample of each cell that has one, with the index of the cell.
    pub fn means(&self) -> impl Iterator<Item = (usize, IterationSample)> {
        let mean = |(cell, sum): (usize, &CellSum)| {
            let CellSum { sample, pixels, measured } = *sum;
            let scale = |count: u32| f64::from(count.max(1)).recip();
            (pixels > 0).then(|| (cell, sample.scaled(scale(pixels), scale(measured))))
        };
        self.sums.iter().enumerate().filter_map(mean)
    }
}

impl AsRef<PixelSample> for IterationSample {
    fn as_ref(&self) -> &PixelSample {
        &self.pixel
    }
}

impl AsRef<PixelMeasurement> for IterationSample {
    fn as_ref(&self) -> &PixelMeasurement {
        &self.measurement
    }
}

/// Defines a struct with one optional field for each statistic, and the tiles of all of them.
macro_rules! statistics {
    (
        $(#[$meta:meta])* $list:ident, $tile:ident {
            $($(#[$field_meta:meta])* $field:ident: $kind:ty,)*
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        pub struct $list {
            $($(#[$field_meta])* pub $field: Option<$kind>,)*
        }

        #[doc = concat!("One tile of each statistic in [`", stringify!($list), "`].")]
        pub struct $tile<'a> {
            $($field: Option<<$kind as PixelStatistic>::Tile<'a>>,)*
        }

        impl $list {
            /// Starts the statistics that `request` includes and that are not there yet.
            pub fn start(&mut self, request: &StatisticRequest) {
                $(if self.$field.is_none() {
                    self.$field = PixelStatistic::start(request);
                })*
            }

            /// Memory per pixel that `request` takes.
            pub(super) fn bytes_per_pixel(request: &StatisticRequest) -> f64 {
                0.0 $(+ <$kind as PixelStatistic>::bytes_per_pixel(request))*
            }

            /// Whether all statistics belong to an image with these settings.
            pub fn fits(&self, settings: &Settings) -> bool {
                true $(&& PixelStatistic::fits(self.$field.as_ref(), settings))*
            }

            /// Tiles to add `iteration` to, in the order of the image's tiles; without end.
            pub(super) fn tiles_mut(
                &mut self,
                iteration: CurrentIteration,
            ) -> impl Iterator<Item = $tile<'_>> {
                $(let mut $field = self.$field.as_mut()
                    .map(|statistic| statistic.tiles_mut(iteration))
                    .into_iter()
                    .flatten();)*
                iter::repeat_with(move || $tile { $($field: $field.next(),)* })
            }

            /// Counts an iteration that all tiles have added.
            pub(super) fn end_iteration(&mut self, iteration: CurrentIteration) {
                $(if let Some(statistic) = &mut self.$field {
                    statistic.end_iteration(iteration);
                })*
            }

            /// Whether `other` keeps the same statistics.
            pub(super) fn can_merge(&self, other: &Self) -> bool {
                true $(&& PixelStatistic::can_merge(self.$field.as_ref(), other.$field.as_ref()))*
            }

            /// Adds the sums of other iterations; see [`Self::can_merge`].
            pub(super) fn merge(&mut self, other: &Self) {
                $(match (&mut self.$field, &other.$field) {
                    (Some(own), Some(other)) => own.merge(other),
                    (own @ None, other) => own.clone_from(other),
                    (Some(_), None) => {}
                })*
            }
        }

        impl $tile<'_> {
            /// Adds one iteration to the tile's pixel `index`, where every cell is a single pixel.
            #[inline]
            pub fn add_sample(&mut self, index: usize, sample: &IterationSample) {
                $(if let Some(tile) = &mut self.$field {
                    tile.add_sample(index, sample.as_ref());
                })*
            }

            /// Adds one iteration to the statistics of cells or to those of pixels; `index` is that
            /// of the tile's cell or pixel.
            #[inline]
            pub fn add_sample_of(&mut self, by_cell: bool, index: usize, sample: &IterationSample) {
                $(if let Some(tile) = &mut self.$field
                    && tile.is_by_cell() == by_cell
                {
                    tile.add_sample(index, sample.as_ref());
                })*
            }
        }
    };
}

statistics! {
    /// Statistics of a block: the blocks of an image have weights of their own.
    BlockStatistics, BlockStatisticsTile {
        /// Coefficients of the noise, from the measured iterations.
        noise: NoiseFilm,
        /// Emission, direct light and caustics, except in large images.
        light: FoldedBuffer<LightComponents>,
        /// Radiance of each fold of the iterations.
        folds: FoldedBuffer<Rgb>,
        /// Light sources that pixels see, of each fold of the iterations.
        seen_lights: FoldedBuffer<SeenLight>,
        /// Contribution of photons in the outer annulus of the merge discs.
        annulus: FoldedBuffer<FoldSums>,
        /// Luminance of both halves of the iterations, where the annulus does not have it.
        halves: FoldedBuffer<LuminanceSum>,
    }
}

statistics! {
    /// Statistics that do not depend on the path counts: kept once for all blocks of an image.
    SharedStatistics, SharedStatisticsTile {
        /// Albedo and normal, which the denoiser uses.
        features: FoldedBuffer<DenoiseFeatures>,
        /// Position and depth of the first surface, except in large images.
        first_hits: FoldedBuffer<DepthSample>,
        /// Position and depth of the first surface in large images.
        compact_hits: FoldedBuffer<CompactDepth>,
        /// Emission of large images.
        compact_emission: FoldedBuffer<CompactLight<EMISSION>>,
        /// Direct light of large images.
        compact_direct: FoldedBuffer<CompactLight<DIRECT>>,
        /// Caustics of large images.
        compact_caustics: FoldedBuffer<CompactLight<CAUSTICS>>,
    }
}
