//! Where two estimates of an image differ: tiles with their scores, and regions of them.

use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Differences of single tiles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TileMap {
    /// Side of the tiles, pixels.
    pub side: u32,
    /// Tiles across.
    pub width: u32,
    /// Tiles down.
    pub height: u32,
    /// Difference of each tile over its standard error, in row order.
    pub scores: Vec<f32>,
    /// Difference of each tile, W/(m^2 sr).
    pub differences: Vec<f32>,
    /// Mean luminance of both estimates of each tile, W/(m^2 sr).
    pub luminances: Vec<f32>,
}

/// A part of the image in which both estimates differ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DifferentRegion {
    /// First column, first row, and the column and row after the last, pixels.
    pub pixels: [u32; 4],
    /// Mean luminance of the image over that of the other estimate.
    pub ratio: f64,
    /// Its tiles in the map.
    #[serde(skip)]
    pub tiles: Vec<usize>,
}

impl TileMap {
    /// Connected tiles with scores of one sign beyond `low`, one of them beyond `high`.
    pub(super) fn connected(&self, high: f32, low: f32) -> Vec<DifferentRegion> {
        let mut is_taken = vec![false; self.scores.len()];
        let mut regions = Vec::new();
        for first in 0..self.scores.len() {
            let score = self.scores[first];
            if is_taken[first] || score.abs() < high {
                continue;
            }
            let (mut tiles, mut next) = (Vec::new(), vec![first]);
            is_taken[first] = true;
            while let Some(tile) = next.pop() {
                tiles.push(tile);
                for other in self.around(tile) {
                    let own = self.scores[other];
                    if !is_taken[other] && own * score > 0.0 && own.abs() >= low {
                        is_taken[other] = true;
                        next.push(other);
                    }
                }
            }
            tiles.sort_unstable();
            regions.push(self.region(tiles));
        }
        regions
    }

    /// Tiles that share a side with a tile.
    fn around(&self, tile: usize) -> impl Iterator<Item = usize> + use<> {
        let (width, count) = (self.width as usize, self.scores.len());
        let column = tile % width;
        let left = (column > 0).then(|| tile - 1);
        let right = (column + 1 < width).then(|| tile + 1);
        let below = Some(tile + width).filter(|below| *below < count);
        [left, right, tile.checked_sub(width), below].into_iter().flatten()
    }

    fn region(&self, tiles: Vec<usize>) -> DifferentRegion {
        let of = |axis: fn(usize, usize) -> usize| -> Range<u32> {
            let places = tiles.iter().map(|tile| axis(*tile, self.width as usize) as u32);
            let (first, last) = places.fold((u32::MAX, 0), |(a, b), own| (a.min(own), b.max(own)));
            first * self.side..(last + 1) * self.side
        };
        let (columns, rows) = (of(|tile, width| tile % width), of(|tile, width| tile / width));
        let sum = |values: &[f32]| tiles.iter().map(|tile| f64::from(values[*tile])).sum::<f64>();
        // The luminances are means of both estimates.
        let (mean, half) = (sum(&self.luminances), 0.5 * sum(&self.differences));
        DifferentRegion {
            pixels: [columns.start, rows.start, columns.end, rows.end],
            ratio: (mean + half) / (mean - half).max(1e-30),
            tiles,
        }
    }
}
