//! Learned visibility of the regions of an environment: from most points of a room, a window shows
//! a small part of the sky. theory.md (17c).

use super::environment::{REGIONS, REGIONS_ACROSS};
use super::visibility::{Grid, PRIOR_TESTS};
use crate::simd::LANES;
use std::hint::black_box;

/// Regions that have a common prior in a cell: two across and two down.
const COARSE: usize = REGIONS / 4;

/// Share of choices of a region that goes evenly to all: light from a region that no test found
/// visible then weighs at most ten times as much as without learning, before the weights of hits.
const EVEN_REGIONS: f32 = 0.1;

/// Units of the most probable region, so that those of all regions fit in 16 bits.
const UNITS: f32 = 255.0;

/// Probabilities of the environment's regions at the receivers of one cell.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct RegionProbs {
    /// Upper end of the interval of each row of regions; the last one is the number of all units.
    rows: [u16; REGIONS_ACROSS],
    /// Upper end of the interval of each region, row by row.
    ends: [[u16; REGIONS_ACROSS]; REGIONS_ACROSS],
}

/// The first interval that ends after `unit`. A count has no branch to predict, and all ends are
/// in one line of the cache.
#[inline]
fn interval_of(unit: u16, ends: &[u16; REGIONS_ACROSS]) -> usize {
    let before: u16 = ends.iter().map(|&end| u16::from(end <= unit)).sum();
    usize::from(before).min(REGIONS_ACROSS - 1)
}

impl RegionProbs {
    /// Probabilities in proportion to `weights`, none of which is 0.
    fn new(weights: impl Iterator<Item = f32> + Clone) -> Self {
        let most = weights.clone().fold(0.0, f32::max);
        let (mut sum, mut ends) = (0, [[0; REGIONS_ACROSS]; REGIONS_ACROSS]);
        for (end, weight) in ends.as_flattened_mut().iter_mut().zip(weights) {
            sum += (UNITS * weight / most).round().max(1.0) as u16;
            *end = sum;
        }
        Self { rows: ends.map(|row| row[REGIONS_ACROSS - 1]), ends }
    }

    /// Number of all units.
    #[inline]
    fn units(&self) -> u16 {
        self.rows[REGIONS_ACROSS - 1]
    }

    /// Chooses a region of each of at most [`LANES`] probabilities by its uniform number; also
    /// returns its probability over its share of the power. The probabilities of all cells are
    /// larger than the caches: waiting for all rows together, then for all regions together, costs
    /// little more than waiting for one of them.
    pub fn choose_each(of: &[&Self], numbers: &[f64], chosen: &mut [(usize, f32)]) {
        black_box(of.iter().fold(0, |all, own| all | own.units()));
        let mut choices = [(0, 0); LANES];
        for (choice, (own, u)) in choices.iter_mut().zip(of.iter().zip(numbers)) {
            let unit = (u * f64::from(own.units())) as u16;
            *choice = (unit, interval_of(unit, &own.rows));
        }
        let ends = of.iter().zip(&choices).map(|(own, &(_, row))| own.ends[row][0]);
        black_box(ends.fold(0, |all, end| all | end));
        for (chosen, (own, &(unit, row))) in chosen.iter_mut().zip(of.iter().zip(&choices)) {
            let region = row * REGIONS_ACROSS + interval_of(unit, &own.ends[row]);
            *chosen = (region, own.density(region));
        }
    }

    /// Probability of a region over its share of the power.
    #[inline]
    pub fn density(&self, region: usize) -> f32 {
        let ends = self.ends.as_flattened();
        let begin = if region == 0 { 0 } else { ends[region - 1] };
        let all = f32::from(self.units());
        f32::from(ends[region] - begin) * REGIONS as f32 / all
    }
}

/// The regions' probabilities by cells of space.
#[derive(Clone, Debug)]
pub(super) struct RegionVisibility {
    /// Probabilities of the whole grid, of blocks with tests, and of cells with tests.
    probs: Vec<RegionProbs>,
    /// Mean of the factors of each of `probs`, in [0, 1].
    mean_factors: Vec<f32>,
    /// Index of each cell in `probs`: its own, that of its block, or that of the whole.
    index: Vec<u32>,
}

/// Numbers of tests of each region, and sums of their results.
#[derive(Clone, Debug)]
struct Counts {
    tested: [f32; REGIONS],
    sum: [f32; REGIONS],
}

/// The coarse region that contains a region.
fn coarse(region: usize) -> usize {
    let [x, y] = [region % REGIONS_ACROSS / 2, region / REGIONS_ACROSS / 2];
    y * (REGIONS_ACROSS / 2) + x
}

/// Sums over the regions of each coarse one.
fn coarse_sums(of: &[f32; REGIONS]) -> [f32; COARSE] {
    let mut sums = [0.0; COARSE];
    for (region, value) in of.iter().enumerate() {
        sums[coarse(region)] += value;
    }
    sums
}

impl Counts {
    const NONE: Self = Self { tested: [0.0; REGIONS], sum: [0.0; REGIONS] };

    fn add(&mut self, region: usize, result: f32) {
        self.tested[region] += 1.0;
        self.sum[region] += result;
    }

    /// Mean result of each region. Its prior is that of the surroundings, scaled like that of its
    /// coarse region. theory.md (17d)
    fn means(&self, surroundings: &[f32; REGIONS]) -> [f32; REGIONS] {
        let mean = |sum: f32, tested: f32, prior: f32| {
            (sum + PRIOR_TESTS * prior) / (tested + PRIOR_TESTS)
        };
        let (sums, tested) = (coarse_sums(&self.sum), coarse_sums(&self.tested));
        let around = coarse_sums(surroundings).map(|sum| 0.25 * sum);
        let scale: [f32; COARSE] = std::array::from_fn(|coarse| {
            mean(sums[coarse], tested[coarse], around[coarse]) / around[coarse]
        });
        std::array::from_fn(|region| {
            let prior = (scale[coarse(region)] * surroundings[region]).min(1.0);
            mean(self.sum[region], self.tested[region], prior)
        })
    }
}

impl RegionVisibility {
    /// Learns from cells, regions, and the results of tests, of at most 1: the second moments of
    /// connections.
    pub fn learn(grid: &Grid, results: impl Iterator<Item = (usize, usize, f32)>) -> Self {
        let mut results: Vec<_> = results.collect();
        // Cells of one block are together, and their tests stay in order.
        results.sort_by_key(|&(cell, ..)| (grid.block(cell), cell));
        let counted = |results: &[(usize, usize, f32)]| {
            let mut counts = Counts::NONE;
            results.iter().for_each(|&(_, region, result)| counts.add(region, result));
            counts
        };
        let mut own =
            Self { probs: Vec::new(), mean_factors: Vec::new(), index: vec![0; grid.len()] };
        let whole = counted(&results).means(&[1.0; REGIONS]);
        own.push(&whole);
        let mut blocks = vec![0; grid.block_count()];
        for block in results.chunk_by(|one, next| grid.block(one.0) == grid.block(next.0)) {
            let means = counted(block).means(&whole);
            blocks[grid.block(block[0].0)] = own.push(&means);
            for cell in block.chunk_by(|one, next| one.0 == next.0) {
                own.index[cell[0].0] = own.push(&counted(cell).means(&means));
            }
        }
        for (cell, index) in own.index.iter_mut().enumerate() {
            if *index == 0 {
                *index = blocks[grid.block(cell)];
            }
        }
        own
    }

    /// Adds probabilities from second moments. Returns their index.
    /// theory.md (17c)
    fn push(&mut self, means: &[f32; REGIONS]) -> u32 {
        let factors = means.map(f32::sqrt);
        let mean = factors.iter().sum::<f32>() / REGIONS as f32;
        let even = EVEN_REGIONS * mean;
        let weights = factors.iter().map(|factor| even + (1.0 - EVEN_REGIONS) * factor);
        self.probs.push(RegionProbs::new(weights));
        self.mean_factors.push(mean);
        self.probs.len() as u32 - 1
    }

    /// Probabilities in a cell.
    #[inline]
    pub fn at(&self, cell: usize) -> &RegionProbs {
        &self.probs[self.index[cell] as usize]
    }

    /// Mean of the factors in a cell: the root of the second moment for the best probabilities, in
    /// [0, 1].
    pub fn mean_factor(&self, cell: usize) -> f32 {
        self.mean_factors[self.index[cell] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probabilities_are_in_proportion_to_weights() {
        let weight = |region: usize| 1.0 + (region % 7) as f32;
        let probs = RegionProbs::new((0..REGIONS).map(weight));
        let total: f32 = (0..REGIONS).map(weight).sum();
        let mut next = 0.0;
        for region in 0..REGIONS {
            let prob = probs.density(region) / REGIONS as f32;
            assert!((prob * total / weight(region) - 1.0).abs() < 0.02, "{region}");
            // The first and the last unit of its interval, and one between
            let unit = 0.5 / f64::from(probs.units());
            let end = next + f64::from(prob);
            let numbers = [next + unit, 0.5 * (next + end), end - unit];
            let mut chosen = [(0, 0.0); 3];
            RegionProbs::choose_each(&[&probs; 3], &numbers, &mut chosen);
            assert_eq!(chosen, [(region, probs.density(region)); 3]);
            next = end;
        }
        assert!((next - 1.0).abs() < 1e-5);
    }

    #[test]
    fn few_tests_resemble_their_surroundings_and_many_do_not() {
        let surroundings: [f32; REGIONS] =
            std::array::from_fn(|region| if region % REGIONS_ACROSS < 8 { 0.8 } else { 0.01 });
        assert_eq!(Counts::NONE.means(&surroundings), surroundings);
        // A test of one region says something about its neighbors in the same coarse region.
        let mut few = Counts::NONE;
        few.add(0, 0.0);
        let means = few.means(&surroundings);
        assert!(means[0] < means[1] && means[1] < surroundings[1] && means[2] == surroundings[2]);
        let mut many = Counts::NONE;
        (0..1000).for_each(|_| many.add(20, 0.5));
        assert!((many.means(&surroundings)[20] - 0.5).abs() < 1e-2);
    }
}
