//! The guide of a scene before anything is learned: a share of the light paths starts toward the
//! surfaces that cast caustics. On a large ground, no other path of a short render would meet a
//! gem of glass. theory.md (40f)

use super::{Cell, Guide, Node};
use crate::base::math::{Bounds, luminance, uniform_disc, uniform_triangle};
use crate::base::rng::{Stream, StreamKey};
use crate::scene::lights::{Emitter, Lights, PrimarySample, below_one};
use crate::scene::{Scene, Triangle};
use crate::simd::LANES;
use crate::simd::sobol::ScrambledSobol;
use glam::Vec3;
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Share of the light paths that is aimed. The noise of all other light grows by its reciprocal's
/// complement, 25 %; the guide that is learned changes it.
const AIMED_SHARE: f64 = 0.2;

/// Radius of the ball of aimed rays, over that of the ball around a group of casters: no cell that
/// a caster's edge shares with its surroundings is left unaimed.
const MARGIN: f32 = 1.2;

/// Rays toward each group of casters from each light.
const RAYS: usize = 4096;

/// Rays that estimate the flux toward a group.
const FLUX_RAYS: usize = LANES;

/// Maximum number of lights that are aimed, those of the largest power: lamps may have a million
/// triangles, each of which is a light.
const MOST_LIGHTS: usize = 256;

/// Maximum number of pairs of a light and a group of casters; those that receive the most flux.
const MOST_PAIRS: usize = 32;

/// Minimum number of rays in a cell: fewer say little about its density.
const LEAST_RAYS: usize = 24;

/// Rays of a division from which on several threads look for its best cut.
const MANY_RAYS: usize = 2048;

/// Cells per pair of a light and a group.
const CELLS_PER_PAIR: usize = 96;

/// Minimum gain of a division, in nats over all rays.
const LEAST_GAIN: f64 = 2e-3;

/// Parts of a cell without rays are kept unless they are wider than so many mean gaps between its
/// rays, and than a share of their extent: narrow ones are gaps by chance, and paths that start in
/// them would carry far more flux than all others.
const CHANCE_GAPS: f64 = 8.0;
const LEAST_EMPTY: f64 = 0.05;

/// The aimed rays must be this much denser than unguided ones somewhere, or no aim is needed.
const WORTHWHILE: f64 = 16.0;

/// An aimed ray.
#[derive(Clone, Copy, Debug)]
struct AimedRay {
    /// Numbers that start it.
    place: PrimarySample,
    /// Its share of all aimed rays.
    share: f64,
}

/// A cell of the numbers, its rays, and its best division.
struct Division {
    cell: Cell,
    rays: Vec<AimedRay>,
    share: f64,
    node: u32,
    gain: f64,
    side: usize,
    middle: f64,
}

impl Guide {
    /// Aims a share of the light paths of a scene at its casters. `None` if there are none, or if
    /// light paths meet them often by themselves.
    pub fn aimed(scene: &Scene) -> Option<Self> {
        let lights = scene.lights();
        let rays = aimed_rays(lights, &scene.caustic_casters());
        if rays.is_empty() {
            return None;
        }
        let most = rays.len().div_ceil(RAYS) * CELLS_PER_PAIR;
        let (divisions, nodes) = divide(rays, lights, most);
        let aimed = |own: &Division| own.share / own.cell.volume();
        if divisions.iter().map(aimed).fold(0.0, f64::max) < WORTHWHILE {
            return None;
        }
        let with_density = |own: &Division| {
            let density = 1.0 - AIMED_SHARE + AIMED_SHARE * aimed(own);
            Cell { density, ..own.cell }
        };
        Some(Self::of_cells(divisions.iter().map(with_density).collect(), nodes, 1.0))
    }
}

/// Numbers that fill the unit cube evenly, [`RAYS`] of them: Sobol points. Each pair of sides has
/// to be filled evenly, or a box of it without rays looks empty.
fn even_numbers() -> Vec<PrimarySample> {
    let set = ScrambledSobol::new(StreamKey::new(0, Stream::Aim, 0).rng(0));
    let unit = |bits: u32| f64::from(bits) / f64::powi(2.0, 32);
    let groups = (0..RAYS).step_by(LANES).map(|first| set.points(first as u32));
    groups.flat_map(|group| (0..LANES).map(move |i| group.map(|side| unit(side[i])))).collect()
}

/// Rays from all lights to the balls around groups of casters.
fn aimed_rays(lights: &Lights, casters: &[Bounds]) -> Vec<AimedRay> {
    let prob = &lights.by_power.prob;
    let mut strongest: Vec<usize> = (0..prob.len()).collect();
    strongest.sort_by(|&one, &other| prob[other].total_cmp(&prob[one]));
    strongest.truncate(MOST_LIGHTS);
    let (numbers, mut pairs) = (even_numbers(), Vec::new());
    for light in strongest {
        for caster in casters {
            let ball = Ball::around(caster);
            let flux = lights.flux_to(light, &ball, &numbers[..FLUX_RAYS]);
            if flux > 0.0 && flux.is_finite() {
                pairs.push((flux, light, ball));
            }
        }
    }
    pairs.sort_by(|one, other| other.0.total_cmp(&one.0));
    pairs.truncate(MOST_PAIRS);
    // The best density of starts is in proportion to the root of what they contribute.
    let total: f64 = pairs.iter().map(|(flux, ..)| flux.sqrt()).sum();
    let of_pair = |&(flux, light, ball): &(f64, usize, Ball)| {
        let place = |numbers: &PrimarySample| {
            let ray = lights.aimed_ray(light, &ball, *numbers)?;
            Some(lights.numbers_of(light, &ray, *numbers))
        };
        let places: Vec<PrimarySample> = numbers.iter().filter_map(place).collect();
        let share = flux.sqrt() / total / places.len().max(1) as f64;
        places.into_iter().map(move |place| AimedRay { place, share })
    };
    pairs.par_iter().flat_map_iter(of_pair).collect()
}

/// A ray from a light to a ball around casters.
#[derive(Clone, Copy, Debug)]
struct Ray {
    origin: Vec3,
    direction: Vec3,
    /// Point of the ball that it meets.
    target: Vec3,
}

/// A ball around a group of casters.
#[derive(Clone, Copy, Debug)]
struct Ball {
    center: Vec3,
    radius: f32,
}

impl Ball {
    fn around(caster: &Bounds) -> Self {
        Self { center: caster.center(), radius: MARGIN * caster.enclosing_radius() }
    }

    /// Point of the disc across a unit direction, whose radius is that of the ball times `scale`.
    fn across(&self, direction: Vec3, scale: f32, numbers: [f64; 2]) -> Vec3 {
        let [x, y] = uniform_disc(numbers.map(below_one));
        let (right, up) = direction.any_orthonormal_pair();
        self.center + scale * self.radius * (x * right + y * up)
    }

    /// The ray from a point to one of the ball; `None` from inside, where every ray meets it.
    fn ray_from(&self, origin: Vec3, numbers: [f64; 2]) -> Option<Ray> {
        let away = self.center - origin;
        let (distance2, radius2) = (away.length_squared(), self.radius * self.radius);
        // The cone of the tangents meets the disc in a circle of this radius.
        let scale = (distance2 / (distance2 - radius2)).sqrt();
        let target = self.across(away.normalize_or_zero(), scale, numbers);
        let direction = (target - origin).normalize_or_zero();
        (distance2 > radius2).then_some(Ray { origin, direction, target })
    }
}

impl Emitter {
    /// A ray of the light to a ball; `None` if it does not emit along that ray.
    fn aimed_ray(&self, ball: &Ball, [u, v, a, b, _]: PrimarySample) -> Option<Ray> {
        let from_triangle = |shape: &Triangle, numbers: [f64; 2]| {
            let ray = ball.ray_from(shape.point(uniform_triangle(numbers.map(below_one))), [u, v]);
            ray.filter(|ray| ray.direction.dot(shape.normal) > 0.0)
        };
        match self {
            Self::Directional(light) => {
                let direction = light.direction;
                let target = ball.across(direction, 1.0, [u, v]);
                Some(Ray { origin: target, direction, target })
            }
            Self::Triangle { shape, .. } => from_triangle(shape, [a, b]),
            Self::Textured(panel) => from_triangle(&panel.shape, [a, b]),
            Self::Opening(lamp) => {
                let (index, rest, _) = lamp.choose(Triangle::area, a)?;
                from_triangle(&lamp.triangles()[index], [rest, b])
            }
            Self::Point { position, .. } => ball.ray_from(*position, [u, v]),
            Self::Luminaire(lamp) => ball.ray_from(lamp.position, [u, v]),
            Self::Spot(spot) => ball.ray_from(spot.position, [u, v]),
        }
        .filter(|ray| self.irradiance(ray.origin, ray.direction, ray.target) > 0.0)
    }
}

impl Lights {
    /// A ray of a light to a ball; `None` if it does not emit along that ray.
    fn aimed_ray(&self, light: usize, ball: &Ball, numbers: PrimarySample) -> Option<Ray> {
        match self.emitters().get(light) {
            Some(emitter) => emitter.aimed_ray(ball, numbers),
            None => {
                let [u, v, a, b, _] = numbers;
                let toward = self.chosen_environment().sample([a, b]).direction;
                let target = ball.across(toward, 1.0, [u, v]);
                Some(Ray { origin: target, direction: -toward, target })
            }
        }
    }

    /// Estimate by rays of these numbers of the flux from a light to a ball, W. It only shares out
    /// aimed paths.
    fn flux_to(&self, light: usize, ball: &Ball, numbers: &[PrimarySample]) -> f64 {
        let disc = std::f32::consts::PI * ball.radius * ball.radius;
        let irradiance = |numbers: &PrimarySample| {
            let Some(ray) = self.aimed_ray(light, ball, *numbers) else { return 0.0 };
            match self.emitters().get(light) {
                Some(emitter) => emitter.irradiance(ray.origin, ray.direction, ray.target),
                None => luminance(self.chosen_environment().integral()),
            }
        };
        let sum: f32 = numbers.iter().map(irradiance).sum();
        f64::from(sum / numbers.len() as f32 * disc)
    }

    /// The numbers that start an aimed light path.
    fn numbers_of(&self, light: usize, ray: &Ray, numbers: PrimarySample) -> PrimarySample {
        let [u, v, a, b, choice] = numbers;
        let own = match self.emitters().get(light) {
            Some(emitter) => emitter.emission_numbers(ray.origin, ray.direction),
            None => self.chosen_environment().emission_numbers(ray.origin, ray.direction).map(Some),
        };
        let [from, to] = self.by_power.interval(light);
        let mut place = [from + (to - from) * choice, u, v, a, b];
        for (number, own) in place[1..].iter_mut().zip(own) {
            *number = own.unwrap_or(*number).clamp(0.0, 1.0f64.next_down());
        }
        place
    }
}

/// Divides the cube so that the rays are dense in few cells. Also returns the tree of the cells.
///
/// Lights that are aimed have cells of their own: in a cell of two lights, what few rays of the one
/// leave out would look empty beside many of the other.
fn divide(rays: Vec<AimedRay>, lights: &Lights, most: usize) -> (Vec<Division>, Vec<Node>) {
    let interval = |ray: &AimedRay| {
        let (light, _) = lights.choose_by_power(ray.place[0]);
        lights.by_power.interval(light)
    };
    let mut ends: Vec<f64> = rays.iter().flat_map(interval).collect();
    ends.sort_by(f64::total_cmp);
    ends.dedup();
    let mut nodes = vec![Node::Leaf(0)];
    let mut open = Division::new(Cell::ALL, rays, 0);
    let mut heap = BinaryHeap::new();
    for end in ends.into_iter().filter(|end| *end > 0.0 && *end < 1.0) {
        open = Division { side: 0, middle: end, ..open };
        let [below, above] = open.cut(&mut nodes);
        heap.push(below);
        open = above;
    }
    heap.push(open);
    let mut done = Vec::new();
    while let Some(open) = heap.pop() {
        if open.gain < LEAST_GAIN || heap.len() + done.len() + 2 > most {
            done.push(open);
        } else {
            heap.extend(open.cut(&mut nodes));
        }
    }
    for (cell, open) in (0..).zip(&done) {
        nodes[open.node as usize] = Node::Leaf(cell);
    }
    (done, nodes)
}

/// The extent of rays along a side of a cell. Ends of the cell that are near count as met.
fn extent(rays: &[AimedRay], cell: &Cell, side: usize) -> [f64; 2] {
    let numbers = rays.iter().map(|ray| ray.place[side]);
    let low = numbers.clone().fold(f64::INFINITY, f64::min);
    let high = numbers.fold(f64::NEG_INFINITY, f64::max);
    let gap = (high - low) / rays.len() as f64;
    let empty = (CHANCE_GAPS * gap).max(LEAST_EMPTY * (high - low)) + 1e-12;
    let room = 0.5 * empty;
    let (begin, end) = (cell.low[side], cell.low[side] + cell.size[side]);
    [
        if low - begin < empty { begin } else { low - room },
        if end - high < empty { end } else { high + room },
    ]
}

impl Division {
    fn new(cell: Cell, rays: Vec<AimedRay>, node: u32) -> Self {
        let share = rays.iter().map(|ray| ray.share).sum();
        let mut own = Self { cell, rays, share, node, gain: 0.0, side: 0, middle: 0.0 };
        if own.rays.len() < LEAST_RAYS {
            return own;
        }
        let of_side = |side| own.cuts(side);
        let cuts: Vec<_> = match own.rays.len() {
            MANY_RAYS.. => (0..5).into_par_iter().map(of_side).collect(),
            _ => (0..5).map(of_side).collect(),
        };
        for (side, cuts) in cuts.into_iter().enumerate() {
            cuts.into_iter().for_each(|[gain, middle]| own.consider(gain, side, middle));
        }
        own
    }

    /// Gains and places of the cuts of a side that are considered.
    fn cuts(&self, side: usize) -> [[f64; 2]; 3] {
        let [low, high] = extent(&self.rays, &self.cell, side);
        let (begin, size) = (self.cell.low[side], self.cell.size[side]);
        // Cuts off what no ray meets on either end.
        let kept = [(low, begin + size - low), (high, high - begin)];
        let [first, second] = kept.map(|(middle, kept)| [self.share * (size / kept).ln(), middle]);
        let middle = 0.5 * (low + high);
        [first, second, [self.gain_of_halves(side, middle), middle]]
    }

    fn consider(&mut self, gain: f64, side: usize, middle: f64) {
        let (begin, end) = (self.cell.low[side], self.cell.low[side] + self.cell.size[side]);
        if gain > self.gain && middle > begin && middle < end {
            (self.gain, self.side, self.middle) = (gain, side, middle);
        }
    }

    /// Information that the extents of both halves of the rays add, in nats. What a half alone
    /// could cut off counts: projections of a ball move with the direction.
    fn gain_of_halves(&self, side: usize, middle: f64) -> f64 {
        let (below, above): (Vec<AimedRay>, Vec<AimedRay>) =
            self.rays.iter().partition(|ray| ray.place[side] < middle);
        if below.len().min(above.len()) < LEAST_RAYS {
            return 0.0;
        }
        let volume = |rays: &[AimedRay]| {
            (0..5)
                .map(|side| {
                    let [low, high] = extent(rays, &self.cell, side);
                    (high - low) / self.cell.size[side]
                })
                .product::<f64>()
        };
        let all = volume(&self.rays);
        let gain = |rays: &[AimedRay]| {
            let share: f64 = rays.iter().map(|ray| ray.share).sum();
            share * (share * all / (self.share * volume(rays))).ln()
        };
        gain(&below) + gain(&above)
    }

    /// The parts below and above the middle, with new nodes.
    fn cut(self, nodes: &mut Vec<Node>) -> [Self; 2] {
        let Self { cell, rays, side, middle, node, .. } = self;
        let below = nodes.len() as u32;
        nodes[node as usize] = Node::Split { side: side as u8, middle, below, share: 0.5 };
        nodes.extend([Node::Leaf(0); 2]);
        let (lower, upper) = rays.into_iter().partition(|ray| ray.place[side] < middle);
        let mut cells = [cell; 2];
        cells[0].size[side] = middle - cell.low[side];
        cells[1].size[side] = cell.low[side] + cell.size[side] - middle;
        cells[1].low[side] = middle;
        [Self::new(cells[0], lower, below), Self::new(cells[1], upper, below + 1)]
    }
}

impl Ord for Division {
    fn cmp(&self, other: &Self) -> Ordering {
        self.gain.total_cmp(&other.gain)
    }
}

impl PartialOrd for Division {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Division {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Division {}

#[cfg(test)]
mod tests;
