//! Means over the meters of a set in each iteration, and light that was hardly seen. Meters share
//! light paths, so that the variance of their mean does not follow from those of the single meters.

use super::reading::SampleTail;
use crate::job::RenderState;
use bdpm_core::film::radiance::luminance;
use bdpm_core::noise::rare_light::RareLight;
use std::ops::Range;

/// Sums over the iterations of a block.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    count: f64,
    sum: f64,
    squares: f64,
}

impl Moments {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    /// Variance of one iteration; `None` before the second one.
    fn variance(&self) -> Option<f64> {
        let spread = self.squares - self.sum * self.sum / self.count;
        (self.count > 1.0).then(|| spread.max(0.0) / (self.count - 1.0))
    }
}

/// Means of some sets of meters in all iterations of an image.
#[derive(Clone, Debug)]
pub struct MeanSeries {
    /// Columns of the image, for each set.
    sets: Vec<Range<usize>>,
    /// Moments of each set, for each block.
    blocks: Vec<Vec<Moments>>,
    /// Sum of each set over the iterations of the latest block.
    latest: Vec<f64>,
    /// Sum of each meter over the iterations of the latest block.
    latest_of_meters: Vec<f64>,
    /// Values of each meter in all iterations, by classes; then those of each set; for each block.
    rare: Vec<Vec<RareLight>>,
}

impl MeanSeries {
    /// An empty series of sets of meters in these columns of the image.
    pub fn new(sets: Vec<Range<usize>>) -> Self {
        let meters = sets.last().map_or(0, |set| set.end);
        Self {
            blocks: Vec::new(),
            latest: Vec::new(),
            latest_of_meters: vec![0.0; meters],
            rare: Vec::new(),
            sets,
        }
    }

    /// Light that few iterations carry, of each meter and then of the mean of each set. Iterations
    /// have the weights of their blocks: those of few paths count little.
    pub fn tails(&self, weights: &[f64]) -> Vec<SampleTail> {
        let of_one = |index: usize| {
            let (mut unseen, mut total) = (0.0, 0.0);
            // Second and third central moment of the weighted sum.
            let [mut second, mut third] = [0.0; 2];
            for (block, weight) in self.rare.iter().zip(weights) {
                let (rare, count) = (&block[index], block[index].count() as f64);
                unseen += weight * count * rare.unseen();
                total += weight * count;
                let [variance, cube] = rare.central_moments();
                second += weight.powi(2) * count * variance;
                third += weight.powi(3) * count * cube;
            }
            SampleTail {
                unseen: if total > 0.0 { unseen / total } else { 0.0 },
                skewness: if second > 0.0 { third / second.powf(1.5) } else { 0.0 },
            }
        };
        (0..self.latest_of_meters.len() + self.sets.len()).map(of_one).collect()
    }

    /// Adds the latest iteration. Starts again if the image did.
    pub fn add(&mut self, state: &RenderState) {
        let blocks = state.renderer.blocks();
        let film = &blocks[blocks.len() - 1].film;
        if blocks.len() < self.blocks.len() || film.iterations == 1 && blocks.len() == 1 {
            self.blocks.clear();
            self.rare.clear();
        }
        if blocks.len() > self.blocks.len() {
            self.latest_of_meters.fill(0.0);
            let count = self.latest_of_meters.len() + self.sets.len();
            self.rare.resize(blocks.len(), vec![RareLight::default(); count]);
            self.blocks.resize(blocks.len(), vec![Moments::default(); self.sets.len()]);
            self.latest = vec![0.0; self.sets.len()];
        }
        let sums = film.sums.map_rows(|pixel| luminance(pixel.radiance));
        let moments = self.blocks.last_mut().expect("resized");
        let rare = self.rare.last_mut().expect("resized");
        let (of_meters, of_sets) = rare.split_at_mut(self.latest_of_meters.len());
        for ((sum, latest), rare) in sums.iter().zip(&mut self.latest_of_meters).zip(of_meters) {
            rare.add(sum - *latest);
            *latest = *sum;
        }
        let sets = self.sets.iter().zip(&mut self.latest).zip(moments).zip(of_sets);
        for (((set, latest), moments), rare) in sets {
            let sum = sums[set.clone()].iter().sum::<f64>() / set.len() as f64;
            moments.add(sum - *latest);
            rare.add(sum - *latest);
            *latest = sum;
        }
    }

    /// Variance of the weighted mean over all iterations, of each set; 0 before the second
    /// iteration of any block.
    pub fn variances(&self, weights: &[f64]) -> Vec<f64> {
        let blocks = || self.blocks.iter().zip(weights);
        let of_set = |set: usize| {
            let total: f64 = blocks().map(|(block, weight)| weight * block[set].count).sum();
            // Weights are reciprocals of variances: a block of one iteration has the variance
            // `typical` over its weight.
            let known =
                blocks().filter_map(|(block, weight)| Some(weight * block[set].variance()?));
            let (sum, count) = known.fold((0.0, 0.0), |(sum, count), own| (sum + own, count + 1.0));
            let typical = if count > 0.0 { sum / count } else { 0.0 };
            let term = |(block, weight): (&Vec<Moments>, &f64)| {
                let variance = block[set].variance().unwrap_or(typical / weight);
                weight * weight * block[set].count * variance
            };
            blocks().map(term).sum::<f64>() / (total * total)
        };
        (0..self.sets.len()).map(of_set).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks of one kind have the skewness of one block of all their samples.
    #[test]
    fn skewness_of_blocks_is_that_of_all_samples() {
        let series = |blocks: &[&[f64]]| {
            let block = |values: &&[f64]| {
                let mut rare = RareLight::default();
                values.iter().for_each(|value| rare.add(*value));
                vec![rare; 2]
            };
            let rare = blocks.iter().map(block).collect();
            MeanSeries { rare, ..MeanSeries::new(std::iter::once(0..1).collect()) }
        };
        // One of four, of 1: third moment 3/32, variance 3/16; over the root of the number.
        let one = [0.0, 0.0, 0.0, 1.0];
        let expected = (3.0 / 32.0) / (3.0f64 / 16.0).powf(1.5);
        for (blocks, root) in [(vec![&one[..]], 2.0), (vec![&one[..]; 4], 4.0)] {
            let weights = vec![2.5; blocks.len()];
            let tails = series(&blocks).tails(&weights);
            assert_eq!(tails.len(), 2);
            assert!((tails[0].skewness - expected / root).abs() < 1e-9, "{tails:?}");
        }
        assert_eq!(series(&[&[1.0, 1.0]]).tails(&[1.0])[0], SampleTail::default());
    }

    #[test]
    fn variance_of_weighted_blocks_is_that_of_their_mean() {
        let block = |values: &[f64]| {
            let mut moments = Moments::default();
            values.iter().for_each(|value| moments.add(*value));
            vec![moments]
        };
        let blocks = vec![block(&[1.0, 3.0]), block(&[2.0, 2.5, 1.5])];
        let series = MeanSeries { blocks, ..MeanSeries::new(std::iter::once(0..1).collect()) };
        // Sample variances 2 and 0.25.
        let [variance] = series.variances(&[0.5, 4.0])[..] else { unreachable!() };
        let expected = (0.25 * 2.0 * 2.0 + 16.0 * 3.0 * 0.25) / 13.0f64.powi(2);
        assert!((variance - expected).abs() < 1e-12, "{variance} {expected}");
        let single = MeanSeries { blocks: vec![block(&[1.0])], ..series };
        assert_eq!(single.variances(&[1.0]), [0.0]);
    }
}
