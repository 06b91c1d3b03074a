//! Which grid suits the photons.

use super::Grid;
use crate::base::math::Bounds;
use crate::transport::photon::Photon;

/// Cells of an array, however few the photons: they stay in the caches.
const SMALL: usize = 1 << 14;
/// The same for a sparse map, in which few look-ups search.
const SMALL_SPARSE: usize = 1 << 12;
/// Cells per photon of larger arrays.
const CELLS: usize = 2;
/// Cells up to this much wider than look-ups need do not hold many photons more.
const WIDE: f32 = 2.0;

/// Samples over the root of the number of photons: as many pairs of them as photons, times a constant.
const SAMPLES: f32 = 8.0;
/// Of fewer photons every so many is a sample, at least.
const MIN_STEP: usize = 8;
/// Most photons in the cell of a photon, on average, about: reading them takes as long as waiting for the
/// scattered memory of a hashed grid.
const MOST_NEIGHBORS: f32 = 64.0;
/// Most photons in any cell, about: a view may show that one alone.
const MOST_IN_A_CELL: usize = 4096;
/// Samples in one cell that are not there by chance.
const FEW_SAMPLES: usize = 4;

impl Grid {
    /// For `count` photons within `bounds`; most look-ups do not come to search a `sparse` map.
    ///
    /// Neighboring look-ups read neighboring cells of an array, and meet few rows of wide cells. But where
    /// photons crowd in small parts of space, cells must be as narrow as look-ups allow, and those are too
    /// many for an array.
    pub fn choose(
        slices: &[&[Photon]],
        bounds: Bounds,
        radius: f32,
        count: usize,
        sparse: bool,
    ) -> Self {
        let small = if sparse { SMALL_SPARSE } else { SMALL };
        Self::array(bounds, radius, small.max(CELLS * count))
            .filter(|(array, width)| *width <= WIDE || !array.is_crowded(slices, count))
            .map_or_else(|| Self::hashed(bounds, radius, count), |(array, _)| array)
    }

    /// Whether photons would find many others in their cells, judged by a sample of them.
    fn is_crowded(&self, slices: &[&[Photon]], count: usize) -> bool {
        let step = (((count as f32).sqrt() / SAMPLES) as usize).max(MIN_STEP);
        let photons = slices.iter().copied().flatten().step_by(step);
        let mut cells: Vec<u32> =
            photons.map(|photon| self.bucket(self.cell(photon.position.into()))).collect();
        cells.sort_unstable();
        let samples = || cells.chunk_by(|one, next| one == next).map(<[u32]>::len);
        // Pairs of samples in one cell, of all pairs: the chance of one photon to be another's neighbor.
        let pairs: usize = samples().map(|samples| samples * (samples - 1)).sum();
        let all = cells.len() * (cells.len() - 1);
        let neighbors = count as f32 * pairs as f32 / all.max(1) as f32;
        let most = samples().max().filter(|&samples| samples > FEW_SAMPLES);
        neighbors > MOST_NEIGHBORS || most.is_some_and(|samples| samples * step > MOST_IN_A_CELL)
    }
}
