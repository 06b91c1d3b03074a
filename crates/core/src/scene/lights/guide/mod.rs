//! Guides the starts of light paths: more start where they contribute more to the image.
//!
//! The random numbers that start a light path are a point of a unit cube, [`PrimarySample`]. A
//! guide divides the cube into cells of uniform density. [`learn`](Guide::learn) chooses cells and
//! densities from the contributions of earlier light paths. Flux is divided by the density, so that
//! no guide changes the mean. theory.md, section 10a.

mod aim;
mod learn;

use super::{Emission, Lights, PrimarySample};
use glam::Vec3;
pub use learn::GuideSample;

/// A density of the starts of light paths, uniform within cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Guide {
    cells: Vec<Cell>,
    /// The tree whose leaves are the cells; the first node is its root.
    nodes: Vec<Node>,
    /// Expected second moment of contributions, over that of unguided light paths.
    expected: f64,
}

/// A box of the unit cube.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cell {
    low: PrimarySample,
    size: PrimarySample,
    /// Density of starts in the cell, relative to an unguided start.
    density: f64,
}

/// A node of the tree of cells.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Node {
    /// The cell with this index.
    Leaf(u32),
    /// Cells below and above `middle` on a side of the cube, in the nodes `below` and `below + 1`.
    /// The share of light paths that start below is `share`.
    Split { side: u8, middle: f64, below: u32, share: f64 },
}

/// A box of the unit cube, of no size on sides where its ends are equal.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Lower ends.
    pub low: PrimarySample,
    /// Upper ends.
    pub high: PrimarySample,
}

/// A start of a light path.
#[derive(Clone, Copy, Debug)]
pub struct GuidedStart {
    /// Point of the cube.
    pub place: PrimarySample,
    /// Density there, relative to an unguided start.
    pub density: f64,
}

impl Cell {
    const ALL: Self = Self { low: [0.0; 5], size: [1.0; 5], density: 1.0 };

    fn volume(&self) -> f64 {
        self.size.iter().product()
    }
}

impl Guide {
    /// The guide of density 1: light paths start in proportion to the emitted power.
    pub fn even() -> Self {
        Self::of_cells(vec![Cell::ALL], vec![Node::Leaf(0)], 1.0)
    }

    /// A guide of cells that fill the cube and whose densities have the mean 1, and their tree, in
    /// which nodes come before those below them.
    fn of_cells(cells: Vec<Cell>, mut nodes: Vec<Node>, expected: f64) -> Self {
        // Shares of all light paths, from the leaves up
        let mut shares = vec![0.0; nodes.len()];
        for (index, node) in nodes.iter_mut().enumerate().rev() {
            shares[index] = match node {
                Node::Leaf(cell) => {
                    let cell = &cells[*cell as usize];
                    cell.density * cell.volume()
                }
                Node::Split { below, share, .. } => {
                    let [low, high] = [shares[*below as usize], shares[*below as usize + 1]];
                    *share = low / (low + high);
                    low + high
                }
            };
        }
        Self { cells, nodes, expected }
    }

    /// Expected second moment of contributions, over that of unguided light paths. It is an
    /// estimate from the samples that the guide was learned from, hence lower than the true ratio.
    pub fn expected(&self) -> f64 {
        self.expected
    }

    /// Index of the cell that holds a point.
    fn cell_of(&self, place: &PrimarySample) -> usize {
        let mut node = 0;
        loop {
            match self.nodes[node as usize] {
                Node::Leaf(cell) => return cell as usize,
                Node::Split { side, middle, below, .. } => {
                    node = below + u32::from(place[usize::from(side)] >= middle);
                }
            }
        }
    }

    /// Density of starts at a point, relative to an unguided start.
    pub fn density(&self, place: &PrimarySample) -> f64 {
        self.cells[self.cell_of(place)].density
    }

    /// Number of cells.
    pub fn cell_count(&self) -> usize {
        self.cells.len()
    }

    /// Mean density over a box, relative to an unguided start.
    pub fn mean_density(&self, extent: Extent) -> f64 {
        self.mean_below(0, extent)
    }

    /// Mean density over the part of a box in the cells below a node.
    fn mean_below(&self, node: u32, extent: Extent) -> f64 {
        let mut node = node;
        loop {
            let (side, middle, below) = match self.nodes[node as usize] {
                Node::Leaf(cell) => return self.cells[cell as usize].density,
                Node::Split { side, middle, below, .. } => (usize::from(side), middle, below),
            };
            let (low, high) = (extent.low[side], extent.high[side]);
            if low >= middle {
                node = below + 1;
            } else if high <= middle {
                node = below;
            } else {
                let (mut first, mut second) = (extent, extent);
                (first.high[side], second.low[side]) = (middle, middle);
                let share = (middle - low) / (high - low);
                return share * self.mean_below(below, first)
                    + (1.0 - share) * self.mean_below(below + 1, second);
            }
        }
    }

    /// The start of a light path for uniform numbers. Each cut of the tree stretches the part of
    /// the number on its side that the start lies in, so that numbers that fill the cube evenly
    /// also fill the cells evenly. theory.md, section 10a.
    #[inline]
    pub fn start(&self, mut numbers: PrimarySample) -> GuidedStart {
        let mut node = 0;
        loop {
            match self.nodes[node as usize] {
                Node::Leaf(cell) => {
                    let Cell { low, size, density } = &self.cells[cell as usize];
                    let mut place = *low;
                    for ((place, size), number) in place.iter_mut().zip(size).zip(numbers) {
                        *place += size * number;
                    }
                    return GuidedStart { place, density: *density };
                }
                Node::Split { side, below, share, .. } => {
                    let number = &mut numbers[usize::from(side)];
                    if *number < share {
                        (*number, node) = (*number / share, below);
                    } else {
                        (*number, node) = ((*number - share) / (1.0 - share), below + 1);
                    }
                    *number = number.min(1.0f64.next_down());
                }
            }
        }
    }
}

impl Lights {
    /// Starts a light path from uniform numbers with the density of `guide`; also returns the
    /// light's index.
    ///
    /// # Panics
    /// If there are no lights.
    pub fn emit_guided(&self, guide: &Guide, numbers: PrimarySample) -> (usize, Emission) {
        let GuidedStart { place, density } = guide.start(numbers);
        let (index, emission) = self.emit_at(place);
        // theory.md (40a)
        (index, Emission { flux: emission.flux / density as f32, ..emission })
    }

    /// Density of light paths of the light with this index along a ray, relative to unguided ones:
    /// the factor that a guide in the weights gives to the density of emission. It is a mean over
    /// the numbers that the ray leaves open. theory.md (40c)
    pub(super) fn guide_density(&self, index: usize, [origin, direction]: [Vec3; 2]) -> f32 {
        let Some(guide) = &self.weighted_guide else { return 1.0 };
        let numbers = match self.emitters.get(index) {
            Some(emitter) => emitter.emission_numbers(origin, direction),
            None => self.chosen_environment().emission_numbers(origin, direction).map(Some),
        };
        let [from, to] = self.by_power.interval(index);
        let mut extent = Extent { low: [from; 5], high: [to; 5] };
        for (side, number) in (1..).zip(numbers) {
            (extent.low[side], extent.high[side]) = number.map_or((0.0, 1.0), |u| (u, u));
        }
        guide.mean_density(extent) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Stream, StreamKey};
    use crate::scene::lights::primary_sample;

    /// Contribution of a light path that starts at `place`.
    fn contribution(place: &PrimarySample) -> f64 {
        let near = |side: usize, from: f64, to: f64| (from..to).contains(&place[side]);
        if near(0, 0.7, 0.75) && near(3, 0.2, 0.8) { 1.0 + place[4] } else { 0.01 }
    }

    /// Samples of light paths that start with the density of `guide`.
    fn samples(guide: &Guide, index: u64, count: usize) -> Vec<GuideSample> {
        let mut rng = StreamKey::new(9, Stream::Test, index).rng(0);
        let one = || {
            let start = guide.start(primary_sample(&mut rng));
            GuideSample { start, square: (contribution(&start.place) / start.density).powi(2) }
        };
        std::iter::repeat_with(one).take(count).collect()
    }

    fn mean(values: impl Iterator<Item = f64>) -> [f64; 2] {
        let (mut n, mut sum, mut square) = (0.0, 0.0, 0.0);
        for value in values {
            n += 1.0;
            sum += value;
            square += value * value;
        }
        let mean: f64 = sum / n;
        [mean, ((square / n - mean * mean) / n).sqrt()]
    }

    #[test]
    fn guided_starts_have_their_reported_density() {
        let guide = Guide::learn(&samples(&Guide::even(), 0, 100_000), &Guide::even());
        assert!(guide.cell_count() > 20, "{}", guide.cell_count());
        let mut rng = StreamKey::new(9, Stream::Test, 1).rng(0);
        let starts: Vec<GuidedStart> =
            (0..200_000).map(|_| guide.start(primary_sample(&mut rng))).collect();
        assert!(starts.iter().all(|s| s.place.iter().all(|x| (0.0..1.0).contains(x))));
        // Estimate means of functions over the cube from guided starts.
        let functions: [fn(&PrimarySample) -> f64; 4] = [
            |_| 1.0,
            |p| p[0] * p[3],
            |p| f64::from(p[1] < 0.3 && p[0] > 0.72),
            |p| (p[2] - 0.5) * p[4],
        ];
        let expected = [1.0, 0.25, 0.3 * 0.28, 0.0];
        for (f, expected) in functions.iter().zip(expected) {
            let [mean, error] = mean(starts.iter().map(|s| f(&s.place) / s.density));
            assert!((mean - expected).abs() < 4.0 * error, "{mean} +- {error}, {expected}");
        }
    }

    #[test]
    fn mean_density_of_a_box_is_that_of_its_points() {
        let guide = Guide::learn(&samples(&Guide::even(), 7, 100_000), &Guide::even());
        let mut rng = StreamKey::new(9, Stream::Test, 8).rng(0);
        for _ in 0..20 {
            // A point on some sides, an interval on others
            let ends = [(); 5].map(|()| {
                let [a, b] = [rng.next_f64(), rng.next_f64()];
                if rng.next_1d() < 0.4 { [a, a] } else { [a.min(b), a.max(b)] }
            });
            let extent = Extent { low: ends.map(|[low, _]| low), high: ends.map(|[_, high]| high) };
            let point = || {
                let place = ends.map(|[low, high]| low + (high - low) * rng.next_f64());
                guide.mean_density(Extent { low: place, high: place })
            };
            let [expected, error] = mean(std::iter::repeat_with(point).take(20_000));
            let off = (guide.mean_density(extent) - expected).abs();
            assert!(off < 4.5 * error.max(0.0) + 1e-9, "{extent:?}: {off}, {expected} +- {error}");
        }
        let all = Extent { low: [0.0; 5], high: [1.0; 5] };
        assert!((guide.mean_density(all) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn learned_guide_comes_near_the_minimum_second_moment() {
        let even = Guide::even();
        let first = Guide::learn(&samples(&even, 2, 20_000), &even);
        let both = [samples(&even, 2, 20_000), samples(&first, 3, 60_000)].concat();
        let guide = Guide::learn(&both, &even);
        let moment = |guide: &Guide, index| {
            mean(samples(guide, index, 200_000).iter().map(|sample| sample.square))
        };
        let [plain, _] = moment(&even, 4);
        let [guided, error] = moment(&guide, 5);
        // The minimum is the squared mean.
        let (inside, outside) = (0.05 * 0.6 * 1.5, 0.01 * (1.0 - 0.05 * 0.6));
        let least = f64::powi(inside + outside, 2);
        println!("{plain} {guided} +- {error}, least {least}");
        // A fifth of the light paths start evenly, also where nothing contributes: 1/0.8 of the
        // minimum.
        assert!(guided < 1.6 * least && guided > least - 4.0 * error);
        assert!(plain > 20.0 * guided, "{plain} {guided}");
    }

    #[test]
    fn noise_alone_gives_an_even_guide() {
        // Equal values everywhere, but a few that are a thousand times as large.
        let even = Guide::even();
        let mut some = samples(&even, 6, 5000);
        for (index, sample) in some.iter_mut().enumerate() {
            sample.square = if index % 500 == 3 { 1000.0 } else { 1.0 };
        }
        assert_eq!(Guide::learn(&some, &even).cell_count(), 1);
        assert_eq!(Guide::learn(&[], &even).cell_count(), 1);
        // Equal values of a few hundred paths.
        some.truncate(400);
        some.iter_mut().for_each(|sample| sample.square = 1.0);
        assert!(Guide::learn(&some, &even).cells.iter().all(|c| (0.5..2.0).contains(&c.density)));
    }
}
