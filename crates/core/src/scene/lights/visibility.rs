//! Learned visibility of clusters of lights: estimates of irradiance ignore occlusion, which
//! depends on the cluster and on the region of space.
//!
//! Space is a grid of cubic cells. A cell has a factor for each slot: a child of one of the first
//! nodes of the light tree or a distant light. The probability of a choice is proportional to the
//! estimate times the factor. It stays positive, so that no visibility changes a mean. theory.md
//! (17a).

use super::regions::{RegionProbs, RegionVisibility};
use super::tree_node::WIDE;
use super::{ChosenLight, LightSample, Lights, Receiver};
use crate::base::rng::Rng;
use crate::simd::LANES;
use glam::{UVec3, Vec3};

/// Nodes of the tree whose children have factors.
pub(super) const LEARNED_NODES: usize = 8;

/// Number of slots of a cell.
const SLOTS: usize = LEARNED_NODES * WIDE;

/// Maximum number of distant lights with factors: the first node has a single child and lends them
/// its other slots.
pub(super) const MOST_DISTANT: usize = WIDE - 1;

/// Cells along the longest side of the grid.
const CELLS: f32 = 20.0;

/// Cells along each side of a block: cells with few tests resemble their block.
const BLOCK: u32 = 4;

/// Tests that the visibility of the surrounding block, or of the whole scene, counts for.
pub(super) const PRIOR_TESTS: f32 = 3.0;

/// Minimum factor: clusters that no test found visible are still chosen.
const LEAST_FACTOR: f32 = 0.1;

/// Share of the receivers on each side of the grid, along each axis, that it leaves out: they use
/// the cells at its border. Few receivers may be far from all others.
const LEFT_OUT: f32 = 0.01;

/// Slot of a child of a node.
pub(super) fn node_slot(node: u32, child: u32) -> u8 {
    (node as usize * WIDE) as u8 + child as u8
}

/// Node and child of a slot.
pub(super) fn place_of(slot: u8) -> (usize, usize) {
    (slot as usize / WIDE, slot as usize % WIDE)
}

/// Slot of the distant light of this number, less than [`MOST_DISTANT`].
pub(super) fn distant_slot(number: usize) -> u8 {
    number as u8 + 1
}

/// Factors of all slots at the receivers of one cell, in units of 1/255.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Factors([[u8; WIDE]; LEARNED_NODES]);

impl Factors {
    /// Factors from a function of the slot.
    pub fn from_slots(mut factor: impl FnMut(usize) -> u8) -> Self {
        let mut slots = 0..SLOTS;
        Self(
            [(); LEARNED_NODES]
                .map(|()| [(); WIDE].map(|()| factor(slots.next().expect("one each")))),
        )
    }

    /// Factors of a node's children; `None` if they were not learned.
    #[inline(always)] // part of vectorized code
    pub fn of_node(&self, node: u32) -> Option<[f32; WIDE]> {
        self.0.get(node as usize).map(|own| own.map(|factor| f32::from(factor) * (1.0 / 255.0)))
    }

    /// Factor of the distant light of this number.
    #[inline]
    pub fn of_distant(&self, number: usize) -> f32 {
        let factor = self.0[0][1..].get(number).copied().unwrap_or(u8::MAX);
        f32::from(factor) * (1.0 / 255.0)
    }
}

/// A grid of cubic cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    /// Corner of the first cell, scene units.
    low: Vec3,
    /// Side of a cell, scene units, and its inverse.
    side: f32,
    inverse_side: f32,
    /// Cells along each axis.
    count: UVec3,
}

impl Grid {
    /// A grid around most of these receivers.
    fn around(receivers: &[Receiver]) -> Self {
        let [mut low, mut high] = [Vec3::ZERO; 2];
        for axis in 0..3 {
            let mut all: Vec<f32> = receivers.iter().map(|at| at.position[axis]).collect();
            all.sort_unstable_by(f32::total_cmp);
            let left_out = (LEFT_OUT * all.len() as f32) as usize;
            if let (Some(first), Some(last)) =
                (all.get(left_out), all.get((all.len() - left_out).saturating_sub(1)))
            {
                (low[axis], high[axis]) = (*first, *last);
            }
        }
        let side = ((high - low).max_element() / CELLS).max(f32::MIN_POSITIVE);
        let count = ((high - low) / side).ceil().clamp(Vec3::ONE, Vec3::splat(CELLS)).as_uvec3();
        Self { low, side, inverse_side: side.recip(), count }
    }

    pub(super) fn len(&self) -> usize {
        self.count.element_product() as usize
    }

    /// Index of the cell of a receiver. It is the cell half a side in front of the surface, so that
    /// both sides of a thin wall have different cells.
    #[inline]
    pub(super) fn cell(&self, at: Receiver) -> usize {
        let front = at.normal.map_or(Vec3::ZERO, |normal| 0.5 * self.side * normal);
        let cell = ((at.position + front - self.low) * self.inverse_side).max(Vec3::ZERO);
        let [x, y, z] = cell.as_uvec3().min(self.count - 1).to_array();
        ((z * self.count.y + y) * self.count.x + x) as usize
    }

    /// Index of the block that contains a cell.
    pub(super) fn block(&self, cell: usize) -> usize {
        let (cell, blocks) = (cell as u32, self.count.map(|count| count.div_ceil(BLOCK)));
        let [x, y] = [cell % self.count.x, cell / self.count.x % self.count.y];
        let z = cell / self.count.x / self.count.y;
        let [x, y, z] = [x, y, z].map(|cells| cells / BLOCK);
        ((z * blocks.y + y) * blocks.x + x) as usize
    }

    pub(super) fn block_count(&self) -> usize {
        self.count.map(|count| count.div_ceil(BLOCK)).element_product() as usize
    }
}

/// A shadow ray that tests visibility.
#[derive(Clone, Copy, Debug)]
pub struct VisibilityTest {
    /// The vertex.
    pub at: Receiver,
    /// The point on a light.
    pub light: LightSample,
    /// Slots whose visibility it shows, as a set of bits.
    slots: u64,
    /// The region of the environment, if that is the light.
    region: Option<usize>,
}

impl VisibilityTest {
    /// Cosine at the vertex, 0 if its surface faces away, 1 if it receives light from both sides.
    pub fn cos(&self) -> f32 {
        self.at.normal.map_or(1.0, |normal| normal.dot(self.light.wi).max(0.0))
    }
}

/// Numbers of tests of each slot.
#[derive(Clone, Copy, Debug)]
struct Counts {
    tested: [f32; SLOTS],
    /// Sum of the results.
    visible: [f32; SLOTS],
}

impl Counts {
    const NONE: Self = Self { tested: [0.0; SLOTS], visible: [0.0; SLOTS] };

    fn add(&mut self, slots: u64, result: f32) {
        let mut rest = slots;
        while rest != 0 {
            let slot = rest.trailing_zeros() as usize;
            self.tested[slot] += 1.0;
            self.visible[slot] += result;
            rest &= rest - 1;
        }
    }

    /// Mean result of each slot, with that of the surroundings as a prior.
    /// theory.md (17b)
    fn visibility(&self, prior: &[f32; SLOTS]) -> [f32; SLOTS] {
        std::array::from_fn(|slot| {
            let visible = self.visible[slot] + PRIOR_TESTS * prior[slot];
            visible / (self.tested[slot] + PRIOR_TESTS)
        })
    }
}

/// Factors on the estimates of lights, by cells of space.
#[derive(Clone, Debug)]
pub struct Visibility {
    grid: Grid,
    cells: Vec<Factors>,
    /// Regions of the environment, if there is one.
    regions: Option<RegionVisibility>,
}

impl Visibility {
    /// Learns from tests of `lights` and whether their rays reached them. The grid is that around
    /// `receivers`.
    pub fn learn(
        lights: &Lights,
        receivers: &[Receiver],
        tests: &[(VisibilityTest, bool)],
    ) -> Self {
        let grid = Grid::around(receivers);
        let faces = tests.iter().filter(|(test, _)| test.cos() > 0.0);
        let results = faces.map(|(test, visible)| {
            let result = f32::from(u8::from(*visible));
            (grid.cell(test.at), test.slots, result)
        });
        let rounded = |factor: f32| (255.0 * factor).round().max(1.0) as u8;
        let cell =
            |own: &[f32; SLOTS]| Factors::from_slots(|slot| rounded(own[slot].max(LEAST_FACTOR)));
        let mut cells: Vec<Factors> = learn(&grid, results).iter().map(cell).collect();
        let regions = lights.by_estimate.environment_number().map(|number| {
            // The second moment of connections with a region is in proportion to the squared
            // cosine.
            let results = tests.iter().filter_map(|(test, visible)| {
                let result = if *visible { test.cos() * test.cos() } else { 0.0 };
                Some((grid.cell(test.at), test.region?, result))
            });
            let learned = RegionVisibility::learn(&grid, results);
            for (index, cell) in cells.iter_mut().enumerate() {
                if let Some(factor) = cell.0[0][1..].get_mut(number) {
                    *factor = rounded(learned.mean_factor(index));
                }
            }
            learned
        });
        Self { grid, cells, regions }
    }

    /// Factors at a receiver.
    #[inline]
    pub(super) fn factors(&self, at: Receiver) -> &Factors {
        &self.cells[self.grid.cell(at)]
    }

    /// Probabilities of the environment's regions at a receiver, if there is an environment.
    #[inline]
    pub(super) fn regions(&self, at: Receiver) -> Option<&RegionProbs> {
        Some(self.regions.as_ref()?.at(self.grid.cell(at)))
    }
}

/// Learns the root of the second moment of each slot in each cell, from cells, sets of slots, and
/// the results of tests, of at most 1. theory.md (17a)
fn learn(grid: &Grid, results: impl Iterator<Item = (usize, u64, f32)>) -> Vec<[f32; SLOTS]> {
    let mut whole = Counts::NONE;
    let mut blocks = vec![Counts::NONE; grid.block_count()];
    let mut cells = vec![Counts::NONE; grid.len()];
    for (cell, slots, result) in results {
        for counts in [&mut whole, &mut blocks[grid.block(cell)], &mut cells[cell]] {
            counts.add(slots, result);
        }
    }
    let whole = whole.visibility(&[1.0; SLOTS]);
    let blocks: Vec<_> = blocks.iter().map(|block| block.visibility(&whole)).collect();
    let own = |(cell, counts): (usize, &Counts)| {
        counts.visibility(&blocks[grid.block(cell)]).map(f32::sqrt)
    };
    cells.iter().enumerate().map(own).collect()
}

impl Lights {
    /// Slots whose visibility can be learned.
    pub fn visibility_slots(&self) -> Vec<u8> {
        self.by_estimate.slots()
    }

    /// Returns true if vertices choose among several lights or directions of an environment.
    pub fn has_choice(&self) -> bool {
        self.has_environment() || self.visibility_slots().len() > 1
    }

    /// The slots of the tree as a whole and of distant lights, if there are any.
    pub fn outermost_visibility_slots(&self) -> Vec<u8> {
        self.visibility_slots().into_iter().filter(|&slot| usize::from(slot) < WIDE).collect()
    }

    /// For each of at most [`LANES`] pairs of a slot and a vertex, chooses a light of the slot to
    /// test its visibility, by a generator of its own. Adds the tests to `tests`; lights that
    /// cannot light the vertex need none.
    pub fn add_visibility_tests(
        &self,
        places: &[(u8, Receiver)],
        rngs: &mut [Rng],
        tests: &mut Vec<VisibilityTest>,
    ) {
        let (mut chosen, mut slots) = ([None; LANES], [0; LANES]);
        for (number, (&(slot, at), rng)) in places.iter().zip(rngs.iter_mut()).enumerate() {
            if let Some((index, own)) = self.by_estimate.choose_in(slot, at, rng.next_f64()) {
                chosen[number] = Some(ChosenLight { index, prob: 1.0, at });
                slots[number] = own;
            }
        }
        let mut samples = [None; LANES];
        self.connect_each_chosen(&chosen[..places.len()], rngs, &mut samples[..places.len()]);
        for (number, chosen) in chosen.iter().enumerate() {
            let (Some(chosen), Some(light)) = (chosen, samples[number]) else { continue };
            let is_environment = chosen.index == self.emitters.len();
            let region = is_environment.then(|| self.chosen_environment().region(light.wi));
            tests.push(VisibilityTest { at: chosen.at, light, slots: slots[number], region });
        }
    }
}
