//! Tiles of the image under way, and how threads share them.

use crate::film::annulus::AnnulusTile;
use crate::film::aov::{FeatureTile, LightComponents, PartTile};
use crate::film::radiance::{PixelSums, Tile};
use crate::noise::film::NoiseTile;

/// A tile of the image under way.
#[derive(Debug)]
pub struct TileSums<'a> {
    /// Which.
    pub tile: Tile,
    /// Sums over iterations of each of its pixels.
    pub sums: &'a mut [PixelSums],
    /// What is measured of it, if anything is.
    pub noise: Option<NoiseTile<'a>>,
    /// Sum over its pixels of [`PixelSums::deviation`] of this iteration.
    pub deviation: f64,
    /// What merges beyond half the radii bring, if that is taken off.
    pub beyond: Option<AnnulusTile<'a>>,
    /// What is kept beside.
    pub layers: LayerTile<'a>,
}

/// What is kept of a tile beside its sums, as far as it is; see [`AovSelection`](crate::film::aov::AovSelection).
#[derive(Debug, Default)]
pub struct LayerTile<'a> {
    /// Light by kind.
    pub light: Option<&'a mut [LightComponents]>,
    /// What is seen.
    pub features: Option<FeatureTile<'a>>,
    /// The part that the iteration belongs to.
    pub part: Option<PartTile<'a>>,
}

/// Tiles that one thread takes at a time: many at first, so that many camera paths are merged together, and
/// fewer toward the end, so that no thread waits long for another.
pub struct Shares<'a, 'b> {
    rest: &'a mut [TileSums<'b>],
    /// Most at a time.
    most: usize,
    /// Shares that what is left is divided into.
    parts: usize,
}

impl<'a, 'b> Shares<'a, 'b> {
    /// Of all `tiles`, for the threads of the current rayon pool.
    pub fn new(tiles: &'a mut [TileSums<'b>], most: usize) -> Self {
        let parts = 2 * rayon::current_num_threads();
        Self { rest: tiles, most: most.max(1), parts }
    }
}

impl<'a, 'b> Iterator for Shares<'a, 'b> {
    type Item = &'a mut [TileSums<'b>];

    fn next(&mut self) -> Option<Self::Item> {
        let share = self.rest.len().div_ceil(self.parts).min(self.most);
        (share > 0).then(|| self.rest.split_off_mut(..share).expect("there are as many"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::radiance::Film;

    #[test]
    fn shares_are_all_tiles_and_shrink_toward_the_end() {
        let mut film = Film::new(160, 160);
        let tile = |(tile, sums)| TileSums {
            tile,
            sums,
            noise: None,
            deviation: 0.0,
            beyond: None,
            layers: LayerTile::default(),
        };
        let mut tiles: Vec<TileSums> = film.tiles_mut().into_iter().map(tile).collect();
        for (most, first, count) in [(7, 7, 100), (1000, 25, 100), (0, 1, 100), (5, 1, 1)] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
            let shares = pool.install(|| Shares::new(&mut tiles[..count], most));
            let sizes: Vec<usize> = shares.map(|share| share.len()).collect();
            assert_eq!(sizes.iter().sum::<usize>(), count);
            assert_eq!((sizes[0], *sizes.last().unwrap()), (first, 1));
            assert!(sizes.is_sorted_by(|one, next| one >= next), "{sizes:?}");
        }
    }
}
