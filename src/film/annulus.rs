//! What merges beyond half the merge radii bring to each pixel, summed up so that the bias which they add can be told
//! from their noise: theory.md, section 17a.
//!
//! All sums are stored as those of the image are: tile after tile, rows within a tile.

use super::radiance::{Tile, luminance};
use crate::base::math::Rgb;
use crate::settings::policy::{LEFT_AT_HALF, LEFT_AT_HALF_OF_DISCS};
use crate::settings::{Kernel, Settings};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Classes of photons, each with its merge radius.
const CLASSES: usize = 2;

/// Iterations are dealt out to so many parts in turn: what one tells of the bias is taken off the other.
pub const FOLDS: usize = 2;

/// Sums over iterations of what photons of one class bring.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Moments {
    /// Of the radiance beyond half the radius, W/(m^2 sr).
    pub sum: Rgb,
    /// Of the square of its luminance.
    pub squares: f32,
    /// Of the product of its luminance with that of the pixel's value.
    pub products: f32,
}

/// Sums over the iterations of one side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Side {
    /// Of the luminance of the pixel's value, W/(m^2 sr).
    pub value: f32,
    /// By class of photons.
    pub classes: [Moments; CLASSES],
}

/// Sums of all pixels of a block.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Annulus {
    pixels: Vec<[Side; FOLDS]>,
    iterations: [u64; FOLDS],
    /// The bias that is left at half the radius over that beyond it, by class of photons, as is typical.
    pub left_at_half: [f64; CLASSES],
}

/// Those of a tile under way.
#[derive(Debug)]
pub struct AnnulusTile<'a> {
    side: usize,
    pixels: &'a mut [[Side; FOLDS]],
}

/// The bias that is typically left at half the radius, over that beyond it, by class of photons.
pub fn left_at_half(kernel: Kernel) -> [f64; CLASSES] {
    match kernel {
        Kernel::Area => LEFT_AT_HALF,
        Kernel::Disc => LEFT_AT_HALF_OF_DISCS,
    }
}

impl AnnulusTile<'_> {
    /// Adds an iteration's value to the pixel of this number within the tile, and the part of it beyond half the radii.
    #[inline]
    pub fn add(&mut self, pixel: usize, value: DVec3, beyond: [DVec3; CLASSES]) {
        if !beyond.iter().all(|beyond| beyond.is_finite()) {
            return;
        }
        let side = &mut self.pixels[pixel][self.side];
        let value = luminance(value);
        side.value += value as f32;
        for (moments, beyond) in side.classes.iter_mut().zip(beyond) {
            let own = luminance(beyond);
            moments.sum += beyond.as_vec3();
            moments.squares += (own * own) as f32;
            moments.products += (own * value) as f32;
        }
    }
}

impl Annulus {
    /// Bytes of a pixel.
    pub const BYTES: usize = FOLDS * size_of::<Side>();

    /// Of no iteration, at these settings.
    pub fn new(pixels: usize, settings: &Settings) -> Self {
        let left_at_half = left_at_half(settings.kernel);
        let pixels = vec![<[Side; FOLDS]>::default(); pixels];
        Self { pixels, iterations: [0; FOLDS], left_at_half }
    }

    /// Whether it fits an image of so many pixels.
    pub fn fits(&self, pixels: usize) -> bool {
        self.pixels.len() == pixels
    }

    /// Tiles to add the iteration of this number, among those of all blocks, to.
    pub(crate) fn tiles_mut(
        &mut self,
        tiles: impl Iterator<Item = Tile>,
        iteration: u64,
    ) -> Vec<AnnulusTile<'_>> {
        let side = Self::side(iteration);
        let mut rest = &mut self.pixels[..];
        let take = |tile: Tile| {
            let pixels = rest.split_off_mut(..tile.len()).expect("there are as many");
            AnnulusTile { side, pixels }
        };
        tiles.map(take).collect()
    }

    /// Takes note that all tiles have it.
    pub(crate) fn end_iteration(&mut self, iteration: u64) {
        self.iterations[Self::side(iteration)] += 1;
    }

    fn side(iteration: u64) -> usize {
        (iteration % FOLDS as u64) as usize
    }

    /// Iterations of each side.
    pub fn iterations(&self) -> [u64; FOLDS] {
        self.iterations
    }

    /// Sums of each pixel, as they are stored.
    pub fn pixels(&self) -> &[[Side; FOLDS]] {
        &self.pixels
    }

    /// Adds those of other iterations.
    pub(crate) fn merge(&mut self, other: &Self) {
        for (own, new) in self.pixels.iter_mut().flatten().zip(other.pixels.iter().flatten()) {
            own.value += new.value;
            for (own, new) in own.classes.iter_mut().zip(&new.classes) {
                own.sum += new.sum;
                own.squares += new.squares;
                own.products += new.products;
            }
        }
        self.iterations.iter_mut().zip(other.iterations).for_each(|(n, m)| *n += m);
    }
}
