//! The choice between an array of cells and hashed cells.

use super::PhotonGrid;
use crate::base::math::Bounds;
use crate::transport::photon::Photon;

/// Minimum bound on the cells of an array: as many stay in the caches.
const SMALL: usize = 1 << 14;
/// Minimum bound on the cells of an array in a sparse map, in which few queries read cells.
const SMALL_SPARSE: usize = 1 << 12;
/// Cells per photon of larger arrays.
const CELLS: usize = 2;
/// Width of the cells over the narrowest width up to which cells hold few photons more.
const WIDE: f32 = 2.0;

/// Samples over the square root of the number of photons: pairs of samples grow in proportion to
/// the photons.
const SAMPLES: f32 = 8.0;
/// Minimum number of photons per sample.
const MIN_STEP: usize = 8;
/// Mean number of photons in the cell of a photon above which photons are crowded: reading as many
/// takes as long as waiting for the scattered memory of a hashed grid.
const MAX_NEIGHBORS: f32 = 64.0;
/// Number of photons in any cell above which photons are crowded: a view may show that cell alone.
const MAX_IN_A_CELL: usize = 4096;
/// Samples of one cell up to which their number may be an accident of sampling.
const FEW_SAMPLES: usize = 4;

impl PhotonGrid {
    /// The grid for `count` photons within `bounds`. Most queries of a `sparse` map do not read
    /// cells.
    ///
    /// Neighboring queries read neighboring cells of an array, and meet few rows of wide cells.
    /// Where photons crowd in small parts of space, cells must be as narrow as queries allow. These
    /// are too many for an array.
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

    /// Estimates from a sample of the photons whether cells hold too many of them.
    fn is_crowded(&self, slices: &[&[Photon]], count: usize) -> bool {
        let step = (((count as f32).sqrt() / SAMPLES) as usize).max(MIN_STEP);
        let photons = slices.iter().copied().flatten().step_by(step);
        let mut cells: Vec<u32> =
            photons.map(|photon| self.bucket(self.cell(photon.position.into()))).collect();
        cells.sort_unstable();
        let samples = || cells.chunk_by(|one, next| one == next).map(<[u32]>::len);
        // Share of the pairs of samples in one cell: the probability that two photons are
        // neighbors.
        let pairs: usize = samples().map(|samples| samples * (samples - 1)).sum();
        let all = cells.len() * (cells.len() - 1);
        let neighbors = count as f32 * pairs as f32 / all.max(1) as f32;
        let most = samples().max().filter(|&samples| samples > FEW_SAMPLES);
        neighbors > MAX_NEIGHBORS || most.is_some_and(|samples| samples * step > MAX_IN_A_CELL)
    }
}
