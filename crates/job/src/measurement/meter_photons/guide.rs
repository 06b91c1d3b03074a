//! A guide for the starts of light paths that arrive at meters: a histogram over the light and the
//! first two uniform numbers of its emission.

use bdpm_core::base::rng::Rng;
use bdpm_core::scene::Lights;

/// Share of the starts that no guide changes, so that all light has a positive density.
const UNGUIDED: f64 = 0.2;

/// Maximum number of cells.
const MOST_CELLS: usize = 1 << 22;

/// Cells of a histogram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GuideGrid {
    lights: usize,
    side: usize,
}

/// The start of a light path: the light, the uniform numbers of its emission, and the density with
/// which they were drawn over the unguided one.
#[derive(Clone, Copy, Debug)]
pub struct GuidedStart {
    pub light: usize,
    /// Probability of the light without a guide.
    pub prob: f32,
    pub at: [f64; 4],
    pub density: f64,
    /// Cell of the histogram.
    pub cell: usize,
}

/// Probabilities of the cells; without them, starts are not guided.
#[derive(Clone, Debug)]
pub struct StartGuide {
    grid: GuideGrid,
    /// Upper ends of the intervals of the cells, in [0, 1].
    ends: Vec<f64>,
}

impl GuideGrid {
    /// A grid for these lights, with at most `side` cells along each number.
    pub fn new(lights: usize, side: usize) -> Self {
        let mut side = side;
        while side > 1 && lights * side * side > MOST_CELLS {
            side /= 2;
        }
        Self { lights, side }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.lights * self.side * self.side
    }

    fn cell(&self, light: usize, [a, b, ..]: [f64; 4]) -> usize {
        let index = |x: f64| ((x * self.side as f64) as usize).min(self.side - 1);
        (light * self.side + index(a)) * self.side + index(b)
    }

    /// Calls `add` with each cell of the same light around a cell; rows and columns close.
    fn around(&self, cell: usize, mut add: impl FnMut(usize)) {
        let [light, row, column] =
            [cell / (self.side * self.side), cell / self.side % self.side, cell % self.side];
        for down in 0..3 {
            for right in 0..3 {
                let [row, column] =
                    [row + down, column + right].map(|at| (at + self.side - 1) % self.side);
                add((light * self.side + row) * self.side + column);
            }
        }
    }

    /// Draws a start in proportion to the power of the lights.
    pub fn start(&self, lights: &Lights, rng: &mut Rng) -> GuidedStart {
        let (light, prob) = lights.choose_emitter(rng.next_f64());
        let at = [(); 4].map(|()| rng.next_f64());
        GuidedStart { light, prob, at, density: 1.0, cell: self.cell(light, at) }
    }
}

impl StartGuide {
    /// A guide toward the cells whose paths arrived: `arrived` counts them, `lights` are the
    /// lights. `None` if there is none.
    pub fn new(grid: GuideGrid, lights: &Lights, arrived: &[u32]) -> Option<Self> {
        // Neighbors of cells that arrived may arrive as well.
        let mut weights = vec![0.0; grid.len()];
        for (cell, count) in arrived.iter().enumerate().filter(|(_, count)| **count > 0) {
            let power = f64::from(lights.emitter_prob(cell / (grid.side * grid.side)));
            grid.around(cell, |near| weights[near] += power * f64::from(*count).sqrt());
        }
        let total: f64 = weights.iter().sum();
        let mut sum = 0.0;
        let ends = weights.iter().map(|weight| {
            sum += weight / total;
            sum
        });
        (total > 0.0).then(|| Self { grid, ends: ends.collect() })
    }

    /// Draws a start. `cells` is the grid that its cell is in.
    pub fn start(&self, cells: GuideGrid, lights: &Lights, rng: &mut Rng) -> GuidedStart {
        let mut start = self.grid.start(lights, rng);
        if rng.next_f64() >= UNGUIDED {
            let u = rng.next_f64();
            let side = self.grid.side as f64;
            let cell = self.ends.partition_point(|end| *end <= u).min(self.ends.len() - 1);
            start.light = cell / (self.grid.side * self.grid.side);
            start.prob = lights.emitter_prob(start.light);
            start.at[0] = ((cell / self.grid.side % self.grid.side) as f64 + start.at[0]) / side;
            start.at[1] = ((cell % self.grid.side) as f64 + start.at[1]) / side;
            start.cell = cell;
        }
        let own = start.cell;
        let begin = if own == 0 { 0.0 } else { self.ends[own - 1] };
        let unguided = f64::from(start.prob) / (self.grid.side * self.grid.side) as f64;
        start.density = UNGUIDED + (1.0 - UNGUIDED) * (self.ends[own] - begin) / unguided;
        start.cell = cells.cell(start.light, start.at);
        start
    }
}
