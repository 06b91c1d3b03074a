//! Systematic difference between two estimates of one image by different methods, whatever their
//! noise: theory.md, section 22b.
//!
//! Both estimates come in halves with independent noise. The product of the differences of the
//! halves is then an unbiased estimate of the squared difference of the means.

use super::significance::normal_quantile;
pub use super::tile_map::{DifferentRegion, TileMap};
use crate::film::radiance::{box_filter, luminance_weights, total};
use crate::film::windows::sum_of_squared_sums;
use serde::{Deserialize, Serialize};

/// Sides of the tiles, cells.
const SIDES: [u32; 5] = [1, 2, 4, 8, 16];

/// Minimum number of tiles of a scale: their scatter decides about its error.
const MIN_TILES: usize = 16;

/// Side of the tiles of the map, pixels, if there are enough of them.
const MAP_SIDE: u32 = 16;

/// Minimum number of tiles of the map.
const MIN_MAP_TILES: usize = 64;

/// Number of independent parts of the image's own noise. Neighboring pixels share photons, so that
/// the noise of an image is not independent from tile to tile.
const IMAGE_PARTS: f64 = 4.0;

/// Relative difference that is never significant: of sums in single precision.
const ROUNDING: f64 = 1e-4;

/// Score from which on a tile belongs to a region that differs, over the score of a single tile
/// that is significant.
const REGION_SHARE: f64 = 0.6;

/// Luminance of the other estimate, over that of the image, up to which it counts in weights.
const MOST_OF_IMAGE: f64 = 4.0;

/// Squares of pixels whose means are compared, in rows from the top left. Pixels beyond the last
/// full cell are left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Cells {
    /// Cells across.
    pub width: u32,
    /// Cells down.
    pub height: u32,
    /// Pixels along each side of a cell.
    pub side: u32,
}

impl Cells {
    /// Number of cells.
    #[inline]
    pub fn len(self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Whether there is no cell.
    #[inline]
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }
}

/// The image that is compared: luminance of each cell, W/(m^2 sr).
#[derive(Clone, Copy, Debug)]
pub enum Compared<'a> {
    /// Two images whose noise is independent. The image is their mean.
    Halves([&'a [f64]; 2]),
    /// One image, and the variance of each cell. The noise of different cells is independent.
    Single(&'a [f64], &'a [f64]),
}

/// Two estimates of one image.
#[derive(Clone, Copy, Debug)]
pub struct Estimates<'a> {
    /// The cells.
    pub cells: Cells,
    /// The image that is compared.
    pub image: Compared<'a>,
    /// Both halves of the other estimate, whose noise is independent in all cells. Luminance of
    /// each cell, W/(m^2 sr).
    pub audit: [&'a [f64]; 2],
    /// Variance of a cell of one half of the other estimate.
    pub audit_variance: &'a [f64],
    /// Luminance that both estimates have beside these values, W/(m^2 sr).
    pub common: Option<&'a [f64]>,
    /// Difference of each cell that is not a fault, W/(m^2 sr): of light that the other estimate
    /// does not know well.
    pub tolerance: Option<&'a [f64]>,
}

/// Squared systematic difference at one scale, relative to the squared luminance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScaleDifference {
    /// Side of the tiles, pixels.
    pub side: u32,
    /// Number of tiles.
    pub tiles: usize,
    /// Estimate of the mean over tiles of the squared relative difference. Negative values are
    /// noise. theory.md (98).
    pub square: f64,
    /// Standard error of `square` if both methods agree. theory.md (98b).
    pub error: f64,
    /// Part of `square` that is not a fault.
    pub tolerated: f64,
}

impl ScaleDifference {
    /// Number of standard errors by which the difference exceeds what is tolerated.
    #[inline]
    pub fn score(&self) -> f64 {
        (self.square - self.tolerated) / self.error
    }
}

/// Difference of the means over all cells.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeanDifference {
    /// Mean luminance of the image over that of the other estimate.
    pub ratio: f64,
    /// Standard error of `ratio`.
    pub error: f64,
}

/// Systematic difference between two estimates of an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Difference {
    /// By scale, the smallest tiles first.
    pub scales: Vec<ScaleDifference>,
    /// Of the means; `None` if the other estimate is black.
    pub mean: Option<MeanDifference>,
    /// Differences of single tiles.
    pub map: TileMap,
}

/// Means over one tile.
#[derive(Clone, Copy, Debug, Default)]
struct Tile {
    /// Differences of both halves.
    differences: [f64; 2],
    /// Variance of the other estimate, one half.
    audit_variance: f64,
    /// Variance of the image, from its halves or given.
    image_variance: f64,
    /// Bias of the product of the differences by the noise of a single image.
    product_bias: f64,
    weight: f64,
    luminance: f64,
    tolerance: f64,
}

impl Tile {
    fn difference(&self) -> f64 {
        0.5 * (self.differences[0] + self.differences[1])
    }
}

impl Estimates<'_> {
    /// Both halves of the image.
    fn halves(&self) -> [&[f64]; 2] {
        match self.image {
            Compared::Halves(halves) => halves,
            Compared::Single(image, _) => [image, image],
        }
    }

    /// Weights of the cells, and the mean of both estimates in each. The weights are (70a) by the
    /// mean of both, pooled over 5 by 5 cells, where the other estimate counts at most as (98j):
    /// a rare hit would make its own noise look small, but not the light that it balances.
    fn weights(&self) -> (Vec<f64>, Vec<f64>) {
        let halves = self.halves();
        let values = |cell: usize| {
            let common = self.common.map_or(0.0, |own| own[cell]);
            let mean = |[one, other]: [&[f64]; 2]| 0.5 * (one[cell] + other[cell]) + common;
            [mean(halves), mean(self.audit)]
        };
        let both: Vec<_> = (0..self.cells.len()).map(values).collect();
        let mean_audit = both.iter().map(|[_, audit]| audit).sum::<f64>() / both.len() as f64;
        let weighted = |[image, audit]: [f64; 2]| {
            let most = MOST_OF_IMAGE * image.max(0.0) + mean_audit;
            (0.5 * (image + audit.min(most))).max(0.0)
        };
        let pooled = box_filter(&both, self.cells.width, self.cells.height);
        let pooled: Vec<f64> = pooled.into_iter().map(weighted).collect();
        let mean = |[image, audit]: [f64; 2]| 0.5 * (image + audit);
        (luminance_weights(&pooled), both.into_iter().map(mean).collect())
    }

    /// Means over the tiles of `side` by `side` cells that are complete, in row order.
    fn tiles(&self, side: u32, weights: &[f64], luminance: &[f64]) -> Vec<Tile> {
        let Cells { width, height, .. } = self.cells;
        let halves = self.halves();
        let cells = f64::from(side * side);
        let of_tile = |x: u32, y: u32| {
            let (mut tile, mut image_difference) = (Tile::default(), 0.0);
            for row in y * side..(y + 1) * side {
                for column in x * side..(x + 1) * side {
                    let cell = row as usize * width as usize + column as usize;
                    let both = halves.iter().zip(&self.audit);
                    for (sum, (image, audit)) in tile.differences.iter_mut().zip(both) {
                        *sum += image[cell] - audit[cell];
                    }
                    tile.audit_variance += self.audit_variance[cell];
                    image_difference += halves[0][cell] - halves[1][cell];
                    if let Compared::Single(_, variance) = self.image {
                        tile.image_variance += variance[cell];
                    }
                    tile.weight += weights[cell];
                    tile.luminance += luminance[cell];
                    tile.tolerance += self.tolerance.map_or(0.0, |own| own[cell]);
                }
            }
            tile.differences = tile.differences.map(|sum| sum / cells);
            tile.audit_variance /= cells * cells;
            match self.image {
                Compared::Halves(_) => {
                    tile.image_variance = (0.5 * image_difference / cells).powi(2);
                }
                Compared::Single(..) => {
                    tile.image_variance /= cells * cells;
                    tile.product_bias = tile.image_variance;
                }
            }
            tile.weight /= cells;
            tile.luminance /= cells;
            tile.tolerance /= cells;
            tile
        };
        let rows = 0..height / side;
        rows.flat_map(|y| (0..width / side).map(move |x| (x, y)))
            .map(|(x, y)| of_tile(x, y))
            .collect()
    }

    /// theory.md (98), (98a), (98b)
    fn at_scale(&self, side: u32, tiles: &[Tile]) -> ScaleDifference {
        let count = tiles.len() as f64;
        let (mut square, mut variance, mut own_noise, mut tolerated) = (0.0, 0.0, 0.0, 0.0);
        for tile in tiles {
            let [one, other] = tile.differences;
            square += tile.weight * (one * other - tile.product_bias);
            tolerated += tile.weight * tile.tolerance.powi(2);
            let (audit, image) = (tile.audit_variance, tile.image_variance);
            let of_product = match self.image {
                Compared::Halves(_) => {
                    own_noise += tile.weight * 2.0 * image;
                    (audit + 2.0 * image).powi(2)
                }
                Compared::Single(..) => audit * audit + 2.0 * image * (audit + image),
            };
            variance += tile.weight.powi(2) * of_product;
        }
        let common = (own_noise / count).powi(2) / IMAGE_PARTS;
        ScaleDifference {
            side: side * self.cells.side,
            tiles: tiles.len(),
            square: square / count,
            error: (variance / (count * count) + common).sqrt() + ROUNDING.powi(2),
            tolerated: tolerated / count,
        }
    }

    /// theory.md (98c)
    fn mean_difference(&self) -> Option<MeanDifference> {
        let count = self.cells.len() as f64;
        let halves = self.halves();
        let mean = |[one, other]: [&[f64]; 2]| {
            0.5 * (total(one, |own| *own) + total(other, |own| *own)) / count
        };
        let common = self.common.map_or(0.0, |own| total(own, |own| *own) / count);
        let (image, audit) = (mean(halves) + common, mean(self.audit) + common);
        let tolerance = self.tolerance.map_or(0.0, |own| total(own, |own| *own) / count);
        let of_audit = 0.5 * total(self.audit_variance, |own| *own) / (count * count);
        let of_image = match self.image {
            Compared::Single(_, variance) => total(variance, |own| *own) / (count * count),
            Compared::Halves([one, other]) => {
                let noise: Vec<f64> = one.iter().zip(other).map(|(a, b)| 0.5 * (a - b)).collect();
                let size = (self.cells.width, self.cells.height);
                sum_of_squared_sums(&noise, size) / (count * count)
            }
        };
        (audit > 0.0).then(|| MeanDifference {
            ratio: image / audit,
            error: (of_audit + of_image + tolerance * tolerance).sqrt() / audit + ROUNDING,
        })
    }

    fn map(&self, side: u32, tiles: &[Tile]) -> TileMap {
        let (width, height) = (self.cells.width / side, self.cells.height / side);
        let variances: Vec<_> = tiles.iter().map(|tile| [tile.image_variance]).collect();
        // Two halves know the noise of one tile badly.
        let pooled = match self.image {
            Compared::Halves(_) => box_filter(&variances, width, height),
            Compared::Single(..) => variances,
        };
        // Where light is rare, a tile without it looks less noisy than it is.
        let audit: Vec<_> = tiles.iter().map(|tile| [tile.audit_variance]).collect();
        let pooled = pooled.into_iter().zip(box_filter(&audit, width, height));
        let score = |(tile, ([image], [around])): (&Tile, ([f64; 1], [f64; 1]))| {
            // One bright path in one half is no fault of both.
            let image = image.max(tile.image_variance);
            let difference = tile.difference();
            let excess = (difference.abs() - tile.tolerance).max(0.0);
            let error = (0.5 * tile.audit_variance.max(around) + image).sqrt()
                + ROUNDING * tile.luminance.abs();
            if excess > 0.0 { (difference.signum() * excess / error) as f32 } else { 0.0 }
        };
        TileMap {
            side: side * self.cells.side,
            width,
            height,
            scores: tiles.iter().zip(pooled).map(score).collect(),
            differences: tiles.iter().map(|tile| tile.difference() as f32).collect(),
            luminances: tiles.iter().map(|tile| tile.luminance as f32).collect(),
        }
    }
}

impl Difference {
    /// Compares two estimates. `None` if the image has too few cells.
    ///
    /// # Panics
    /// If a list does not have one value for each cell.
    pub fn new(estimates: &Estimates) -> Option<Self> {
        let Cells { width, height, side: pixels } = estimates.cells;
        let lengths = estimates.halves().into_iter().chain(estimates.audit);
        assert!(lengths.into_iter().all(|values| values.len() == estimates.cells.len()));
        let (weights, luminance) = estimates.weights();
        let count = |side: u32| (width / side) as usize * (height / side) as usize;
        let scales: Vec<u32> = SIDES.into_iter().filter(|side| count(*side) >= MIN_TILES).collect();
        let fits = |side: &u32| side * pixels <= MAP_SIDE && count(*side) >= MIN_MAP_TILES;
        let map_side = scales.iter().copied().filter(fits).max().or(scales.first().copied())?;
        let mut map = None;
        let scales = scales.into_iter().map(|side| {
            let tiles = estimates.tiles(side, &weights, &luminance);
            if side == map_side {
                map = Some(estimates.map(side, &tiles));
            }
            estimates.at_scale(side, &tiles)
        });
        let scales = scales.collect();
        Some(Self { scales, mean: estimates.mean_difference(), map: map? })
    }

    /// The scale at which the difference stands out most from its error.
    #[inline]
    pub fn strongest(&self) -> &ScaleDifference {
        let scales = self.scales.iter();
        scales.max_by(|a, b| a.score().total_cmp(&b.score())).expect("there is a scale")
    }

    /// The difference at the scale of the map.
    #[inline]
    pub fn at_map(&self) -> &ScaleDifference {
        let at_map = self.scales.iter().find(|own| own.side == self.map.side);
        at_map.expect("the map has one of the scales")
    }

    /// Score from which on a difference is significant, if equal methods may be called different
    /// with the probability `risk` over all scales, the mean, and this number of looks at one
    /// image: theory.md (98d).
    #[inline]
    pub fn threshold(&self, risk: f64, looks: u32) -> f64 {
        let tests = (self.scales.len() + 2) as f64 * f64::from(looks.max(1));
        normal_quantile(1.0 - risk / tests)
    }

    /// Whether the difference at any scale is significant, as [`Self::threshold`] defines it.
    #[inline]
    pub fn is_significant(&self, risk: f64, looks: u32) -> bool {
        self.strongest().score() > self.threshold(risk, looks)
    }

    /// Number of standard errors between the ratio of the means and 1.
    #[inline]
    pub fn mean_score(&self) -> f64 {
        self.mean.map_or(0.0, |mean| ((mean.ratio - 1.0) / mean.error).abs())
    }

    /// Score from which on a single tile differs significantly, if one of all tiles of equal
    /// methods may do so with the probability `risk`.
    #[inline]
    pub fn tile_threshold(&self, risk: f64) -> f64 {
        normal_quantile(1.0 - 0.5 * risk / self.map.scores.len() as f64)
    }

    /// Mean over the image of the luminance by which the image exceeds the other estimate in tiles
    /// that score at least 2, W/(m^2 sr).
    #[inline]
    pub fn excess(&self) -> f64 {
        self.difference_where(|score| score > 2.0)
    }

    /// Whether the image is brighter than the other estimate where they differ: in tiles that score
    /// at least 2. In others, rare hits of the other estimate may balance it, unless its mean is
    /// higher by this number of standard errors.
    #[inline]
    pub fn is_brighter(&self, threshold: f64) -> bool {
        let excess = self.excess();
        let is_darker = self.mean.is_some_and(|own| own.ratio < 1.0 - threshold * own.error);
        !is_darker && excess > 0.0 && excess + self.difference_where(|score| score < -2.0) > 0.0
    }

    /// Mean over the image of the differences in tiles with these scores, W/(m^2 sr).
    fn difference_where(&self, counts: impl Fn(f32) -> bool) -> f64 {
        let of = self.map.scores.iter().zip(&self.map.differences);
        let sum: f64 =
            of.filter(|(score, _)| counts(**score)).map(|(_, own)| f64::from(*own)).sum();
        sum / self.map.scores.len() as f64
    }

    /// Connected parts of the image that differ, that with the largest squared relative difference
    /// first. Each has a tile that is significant at this `risk`.
    pub fn regions(&self, risk: f64) -> Vec<DifferentRegion> {
        let threshold = self.tile_threshold(risk) as f32;
        let mut regions = self.map.connected(threshold, threshold * REGION_SHARE as f32);
        let importance = |region: &DifferentRegion| -> f64 {
            let share = |tile: &usize| {
                f64::from(self.map.differences[*tile] / self.map.luminances[*tile].max(1e-30))
            };
            region.tiles.iter().map(|tile| share(tile).powi(2)).sum()
        };
        regions.sort_by(|a, b| importance(b).total_cmp(&importance(a)));
        regions
    }
}

#[cfg(test)]
#[path = "difference_tests.rs"]
mod tests;
