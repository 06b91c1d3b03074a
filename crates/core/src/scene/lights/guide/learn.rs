//! Learns the cells of a guide from the contributions of light paths.
//!
//! Let light paths start with the density `g`, and let `m` be the second moment of the
//! contributions of paths from one point of the cube. The second moment of all contributions is the
//! integral of `m/g`. For cells of volume `v` and mass `m v` it is minimal if `g` is proportional
//! to the root of `m`. Its value is then the square of the sum of `sqrt(v * mass)`: cells are cut
//! where this sum falls most. theory.md, section 10a.

use super::{Cell, Guide, GuidedStart, Node};
use crate::scene::lights::PrimarySample;
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::ops::Range;

/// Contribution of a light path.
#[derive(Clone, Copy, Debug)]
pub struct GuideSample {
    /// Start of the path.
    pub start: GuidedStart,
    /// Weighted sum over the image of its squared contributions.
    pub square: f64,
}

/// Maximum number of cells.
const MOST_CELLS: usize = 4096;

/// Share of the light paths that starts as before learning, so that none is missed: contributions
/// that were not learned have at most the reciprocal times the noise.
const BASE_SHARE: f64 = 0.2;

/// Number of parts along a side whose masses decide about a cut: halves alone would miss a peak in
/// the middle.
const PARTS: usize = 8;

/// A cell is cut if the gain exceeds this factor times the gain of pure noise.
const CERTAINTY: f64 = 3.0;

/// Minimum gain of a cut, relative to the sum over all cells.
const LEAST_GAIN: f64 = 1e-4;

/// Start of a path, and its part of the second moment.
#[derive(Clone, Copy, Debug)]
struct Moment {
    place: PrimarySample,
    mass: f64,
}

/// A cell that can be cut.
struct SplittableCell {
    cell: Cell,
    /// Range of the paths that start in the cell.
    moments: Range<usize>,
    /// Its node in the tree of cells.
    node: u32,
    /// Density before anything was learned.
    base: f64,
    mass: f64,
    /// Gain of cutting the cell, and the side to cut.
    gain: f64,
    side: usize,
}

impl Guide {
    /// Learns the guide that minimizes the second moment of contributions; paths that contribute
    /// nothing may be left out of `samples`. A share of the light paths starts with the density
    /// `base`. theory.md (40b).
    pub fn learn(samples: &[GuideSample], base: &Self) -> Self {
        let moment = |GuideSample { start, square }: &GuideSample| Moment {
            place: start.place,
            mass: square * start.density,
        };
        let moments = samples.iter().map(moment);
        let mut moments: Vec<_> = moments.filter(|moment| moment.mass > 0.0).collect();
        let (cells, nodes) = cut(&mut moments, base);
        let root = |open: &SplittableCell| (open.mass * open.cell.volume()).sqrt();
        let sum: f64 = cells.iter().map(root).sum();
        let with_density = |open: &SplittableCell| {
            let share = if sum > 0.0 { root(open) / sum } else { open.cell.volume() };
            let learned = share / open.cell.volume();
            let density = BASE_SHARE * open.base + (1.0 - BASE_SHARE) * learned;
            Cell { density, ..open.cell }
        };
        let dense: Vec<Cell> = cells.iter().map(with_density).collect();
        let (mut own, mut before) = (0.0, 0.0);
        for (open, cell) in cells.iter().zip(&dense) {
            own += open.mass / cell.density;
            before += open.mass / open.base;
        }
        Self::of_cells(dense, nodes, if before > 0.0 { own / before } else { 1.0 })
    }
}

/// Cuts the cells of `base`, the cell of the highest gain first. Also returns the tree of the
/// cells.
fn cut(moments: &mut [Moment], base: &Guide) -> (Vec<SplittableCell>, Vec<Node>) {
    moments.sort_by_cached_key(|moment| base.cell_of(&moment.place));
    let mut node_of = vec![0; base.cells.len()];
    for (node, own) in (0..).zip(&base.nodes) {
        if let Node::Leaf(cell) = own {
            node_of[*cell as usize] = node;
        }
    }
    let (mut heap, mut begin) = (BinaryHeap::new(), 0);
    for (index, (cell, node)) in base.cells.iter().zip(node_of).enumerate() {
        let is_inside = |moment: &Moment| base.cell_of(&moment.place) == index;
        let count = moments[begin..].iter().take_while(|moment| is_inside(moment)).count();
        let range = begin..begin + count;
        heap.push(SplittableCell::new((*cell, cell.density), range, node, moments));
        begin += count;
    }
    let mut nodes = base.nodes.clone();
    let least = LEAST_GAIN * moments.iter().map(|moment| moment.mass).sum::<f64>().sqrt();
    let mut done = Vec::new();
    while let Some(open) = heap.pop() {
        if open.gain <= least || heap.len() + done.len() + 2 > MOST_CELLS + base.cells.len() {
            done.push(open);
        } else {
            let (node, below) = (open.node as usize, nodes.len() as u32);
            let (side, halves) = (open.side as u8, open.halves(below, moments));
            let middle = halves[1].cell.low[usize::from(side)];
            nodes[node] = Node::Split { side, middle, below, share: 0.5 };
            nodes.extend([Node::Leaf(0); 2]);
            heap.extend(halves);
        }
    }
    for (cell, open) in (0..).zip(&done) {
        nodes[open.node as usize] = Node::Leaf(cell);
    }
    (done, nodes)
}

impl SplittableCell {
    /// A cell and its density before learning.
    fn new((cell, base): (Cell, f64), range: Range<usize>, node: u32, moments: &[Moment]) -> Self {
        let own = &moments[range.clone()];
        let (mut mass, mut square, mut parts) = (0.0, 0.0, [[0.0; PARTS]; 5]);
        for moment in own {
            mass += moment.mass;
            square += moment.mass * moment.mass;
            for (side, parts) in parts.iter_mut().enumerate() {
                let share = (moment.place[side] - cell.low[side]) / cell.size[side];
                parts[((share * PARTS as f64) as usize).min(PARTS - 1)] += moment.mass;
            }
        }
        let (mut gain, mut side) = (0.0, 0);
        let part_volume = cell.volume() / PARTS as f64;
        let root = (mass * cell.volume()).sqrt();
        for (number, parts) in parts.iter().enumerate() {
            let cut: f64 = parts.iter().map(|mass| (mass * part_volume).sqrt()).sum();
            if root - cut > gain {
                (gain, side) = (root - cut, number);
            }
        }
        // The gain of as many equal values at random: their spread over the parts lowers the sum of
        // roots by about an eighth of a part's share each.
        let values = if square > 0.0 { mass * mass / square } else { 0.0 };
        let by_chance = root * (PARTS - 1) as f64 / (8.0 * values.max(1.0));
        if gain < CERTAINTY * by_chance {
            gain = 0.0;
        }
        Self { cell, moments: range, node, base, mass, gain, side }
    }

    /// The halves, whose nodes are `below` and `below + 1`.
    fn halves(self, below: u32, moments: &mut [Moment]) -> [Self; 2] {
        let Self { cell, moments: range, base, side, .. } = self;
        let mut size = cell.size;
        size[side] *= 0.5;
        let middle = cell.low[side] + size[side];
        let mut first = range.start;
        for index in range.clone() {
            if moments[index].place[side] < middle {
                moments.swap(index, first);
                first += 1;
            }
        }
        let mut low = cell.low;
        low[side] = middle;
        let [lower, upper] = [cell.low, low].map(|low| (Cell { low, size, ..cell }, base));
        let lower = Self::new(lower, range.start..first, below, moments);
        [lower, Self::new(upper, first..range.end, below + 1, moments)]
    }
}

impl Ord for SplittableCell {
    fn cmp(&self, other: &Self) -> Ordering {
        self.gain.total_cmp(&other.gain)
    }
}

impl PartialOrd for SplittableCell {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for SplittableCell {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for SplittableCell {}
