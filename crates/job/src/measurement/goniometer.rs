//! A goniophotometer: the luminous intensity distribution of a model by the light paths that leave
//! it.
//!
//! Directions are nodes of a grid of C planes and angles gamma. A path of flux `Phi` in the
//! direction `w` adds `Phi b(w)` to each node, where `b` is the node's hat function: the weight
//! with which bilinear interpolation uses the node's value at `w`. The value of a node is the sum
//! over the integral of `b` over all directions. Values interpolated between the nodes then have
//! exactly the flux of all paths, because the hat functions add up to 1.

use bdpm_core::accel::{Intersect, Ray};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::base::rng::{Rng, Stream, StreamKey};
use bdpm_core::scene::bsdf::{BsdfSample, Lobe, Transport};
use bdpm_core::scene::{Emission, Emitter, IntensityDistribution, Photometry, Scene};
use bdpm_core::transport::free_flight::MediumVertex;
use bdpm_core::transport::path_state::{History, PathState};
use bdpm_core::transport::roulette::survives;
use bdpm_core::transport::step::{PathVertex, Role, Segment, Walker, walk};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Light paths per batch. It is fixed, so that results do not depend on the number of threads.
const BATCH: u32 = 4096;
/// Batches whose sums are in memory at a time.
const BATCHES: u32 = 64;
/// Maximum number of groups of iterations whose sums are kept apart.
const GROUPS: usize = 8;

/// The directions in which a goniophotometer measures.
#[derive(Clone, Debug)]
pub struct GoniometerGrid {
    /// Steps of gamma from 0 to 180 degrees.
    gammas: usize,
    /// C planes over a turn.
    planes: usize,
    /// Axes of the luminaire in the scene: C0, C90, up.
    axes: DMat3,
}

impl GoniometerGrid {
    /// A grid with these steps, degrees. `axes` has unit vectors along C0, C90 and up.
    ///
    /// # Errors
    /// If a step does not divide 180 (gamma) or 360 degrees (C), or is below 0.1 degrees.
    pub fn new(gamma_step: f64, c_step: f64, axes: DMat3) -> Result<Self> {
        let count = |step: f64, whole: f64, least: usize| {
            let count = (whole / step).round();
            let fits = step >= 0.1 && (count * step - whole).abs() < 1e-6;
            (fits && count >= least as f64).then_some(count as usize)
        };
        let steps = (count(gamma_step, 180.0, 2), count(c_step, 360.0, 1));
        let (Some(gammas), Some(planes)) = steps else {
            let problem = format!("the steps of the angles are {gamma_step} and {c_step} degrees");
            let advice =
                "give a step of gamma that divides 180 and one of C that divides 360, at least 0.1";
            return Err(Error::new(problem, advice));
        };
        Ok(Self { gammas, planes, axes })
    }

    fn nodes(&self) -> usize {
        (self.gammas + 1) * self.planes
    }

    /// Returns true if the nodes of a row are one direction. The first of them stands for all.
    fn is_pole(&self, row: usize) -> bool {
        row == 0 || row == self.gammas
    }

    /// Calls `add` with the index of each node and its weight at a unit direction of the scene.
    fn splat(&self, direction: DVec3, mut add: impl FnMut(usize, f64)) {
        let [x, y, up] = [0, 1, 2].map(|axis| self.axes.col(axis).dot(direction));
        let gamma = x.hypot(y).atan2(-up) / PI * self.gammas as f64;
        let turn = (y.atan2(x) / TAU).rem_euclid(1.0) * self.planes as f64;
        let row = (gamma as usize).min(self.gammas - 1);
        let down = (gamma - row as f64).clamp(0.0, 1.0);
        let column = (turn as usize).min(self.planes - 1);
        let across = (turn - column as f64).clamp(0.0, 1.0);
        for (row, weight) in [(row, 1.0 - down), (row + 1, down)] {
            if self.is_pole(row) {
                add(row * self.planes, weight);
                continue;
            }
            for (plane, part) in [(column, 1.0 - across), (column + 1, across)] {
                add(row * self.planes + plane % self.planes, weight * part);
            }
        }
    }

    /// Integral of the hat function of a node over all directions, sr.
    fn solid_angle(&self, row: usize) -> f64 {
        let step = PI / self.gammas as f64;
        let at = row as f64 * step;
        // Integrals of (1 - |t - at|/step) sin t, by parts
        let rise = |from: f64, to: f64, slope: f64| {
            let value = |t: f64| {
                let hat = 1.0 + slope * (t - at);
                slope * t.sin() - hat * t.cos()
            };
            value(to) - value(from)
        };
        let mut integral = 0.0;
        if row > 0 {
            integral += rise(at - step, at, 1.0 / step);
        }
        if row < self.gammas {
            integral += rise(at, at + step, -1.0 / step);
        }
        if self.is_pole(row) { integral * TAU } else { integral * TAU / self.planes as f64 }
    }
}

/// Sums over the light paths of some iterations.
#[derive(Clone, Debug)]
pub struct Goniometer {
    grid: GoniometerGrid,
    seed: u64,
    /// Light paths of each iteration.
    light_paths: u32,
    iterations: u64,
    /// For each node the sum over iterations of its flux, W, and of the square.
    nodes: Vec<[f64; 2]>,
    /// For each group of iterations the number of its iterations, and the flux of each node.
    /// Iterations take turns in joining the groups.
    groups: Vec<(u64, Vec<f64>)>,
    /// Sum over iterations of the flux of all paths that leave, W, and of the square.
    total: [f64; 2],
}

/// A value with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// The mean over the iterations.
    pub value: f64,
    /// Standard error of the mean; NaN after one iteration.
    pub error: f64,
}

/// Flux of the nodes that the paths of a batch leave in, W, and of all of them.
struct BatchSums<'a> {
    grid: &'a GoniometerGrid,
    nodes: Vec<f64>,
    total: f64,
}

impl Goniometer {
    /// Begins to measure a scene that has light sources of its own only.
    ///
    /// # Errors
    /// If there is an environment or parallel light, which no direction of the model is measured
    /// for.
    pub fn new(scene: &Scene, grid: GoniometerGrid, seed: u64, light_paths: u32) -> Result<Self> {
        let lights = scene.lights();
        let is_parallel = |emitter: &Emitter| matches!(emitter, Emitter::Directional(_));
        if lights.has_environment() || lights.emitters().iter().any(is_parallel) {
            let problem = "the scene has an environment, a sky or parallel light";
            return Err(Error::new(problem, "leave only the lamps of the luminaire in the scene"));
        }
        if scene.filling_medium().is_some() {
            let problem = "the scene is filled with a medium, in which light does not leave";
            return Err(Error::new(problem, "remove the medium between all objects"));
        }
        let nodes = vec![[0.0; 2]; grid.nodes()];
        let groups = Vec::new();
        Ok(Self { grid, seed, light_paths, iterations: 0, nodes, groups, total: [0.0; 2] })
    }

    /// Number of iterations so far.
    pub fn iterations(&self) -> u64 {
        self.iterations
    }

    /// Traces the light paths of another iteration. The result does not depend on the number of
    /// threads.
    pub fn iterate(&mut self, scene: &Scene, accel: &dyn Intersect) {
        let key = StreamKey::new(self.seed, Stream::Goniometer, self.iterations);
        let count = self.light_paths.div_ceil(BATCH);
        let mut nodes = vec![0.0; self.grid.nodes()];
        let mut total = 0.0;
        // The sums of some batches at a time are in memory.
        for first in (0..count).step_by(BATCHES as usize) {
            let batches = first..count.min(first + BATCHES);
            let sums: Vec<BatchSums> = batches
                .into_par_iter()
                .map(|batch| {
                    let paths = batch * BATCH..self.light_paths.min((batch + 1) * BATCH);
                    self.trace(scene, accel, paths.map(|path| key.rng(path.into())))
                })
                .collect();
            for batch in sums {
                nodes.iter_mut().zip(&batch.nodes).for_each(|(sum, own)| *sum += own);
                total += batch.total;
            }
        }
        let per_path = 1.0 / f64::from(self.light_paths);
        let add = |[sum, square]: &mut [f64; 2], flux: f64| {
            *sum += flux * per_path;
            *square += (flux * per_path).powi(2);
        };
        let group = (self.iterations % GROUPS as u64) as usize;
        if group == self.groups.len() {
            self.groups.push((0, vec![0.0; nodes.len()]));
        }
        let (count, of_group) = &mut self.groups[group];
        *count += 1;
        of_group.iter_mut().zip(&nodes).for_each(|(sum, flux)| *sum += flux * per_path);
        self.nodes.iter_mut().zip(nodes).for_each(|(sums, flux)| add(sums, flux));
        add(&mut self.total, total);
        self.iterations += 1;
    }

    /// Traces paths to their ends.
    fn trace(
        &self,
        scene: &Scene,
        accel: &dyn Intersect,
        rngs: impl Iterator<Item = Rng>,
    ) -> BatchSums<'_> {
        let nodes = vec![0.0; self.grid.nodes()];
        let mut sums = BatchSums { grid: &self.grid, nodes, total: 0.0 };
        walk(&mut sums, (scene, accel), rngs.map(|rng| start(scene, accel, rng)));
        sums
    }

    fn measured(&self, [sum, square]: [f64; 2], factor: f64) -> Measured {
        let n = self.iterations as f64;
        let mean = sum / n;
        let error = ((square / n - mean * mean).max(0.0) / (n - 1.0)).sqrt();
        Measured { value: factor * mean, error: factor * error }
    }

    /// Luminous flux that leaves, lm.
    pub fn flux(&self) -> Measured {
        self.measured(self.total, f64::from(LUMENS_PER_WATT))
    }

    /// Angles gamma of the rows of [`Self::intensities`], degrees.
    pub fn gammas(&self) -> Vec<f64> {
        (0..=self.grid.gammas).map(|i| 180.0 * i as f64 / self.grid.gammas as f64).collect()
    }

    /// C planes of the columns of [`Self::intensities`], degrees; the last is below 360.
    pub fn planes(&self) -> Vec<f64> {
        (0..self.grid.planes).map(|j| 360.0 * j as f64 / self.grid.planes as f64).collect()
    }

    /// Intensity of each node, cd, row by row. The poles are one direction each.
    pub fn intensities(&self) -> Vec<Measured> {
        let planes = self.grid.planes;
        let mut all = Vec::with_capacity(self.grid.nodes());
        for (row, nodes) in self.nodes.chunks(planes).enumerate() {
            let factor = f64::from(LUMENS_PER_WATT) / self.grid.solid_angle(row);
            if self.grid.is_pole(row) {
                let pole = self.measured(nodes[0], factor);
                all.extend(std::iter::repeat_n(pole, planes));
            } else {
                all.extend(nodes.iter().map(|sums| self.measured(*sums, factor)));
            }
        }
        all
    }

    /// Intensities of independent groups of iterations: the number of iterations of each, and the
    /// intensity of each node, cd, in the order of [`Self::intensities`].
    pub fn groups(&self) -> Vec<(u64, Vec<f64>)> {
        let planes = self.grid.planes;
        let of_row = |iterations: f64, row: usize, nodes: &[f64]| -> Vec<f64> {
            let factor = f64::from(LUMENS_PER_WATT) / self.grid.solid_angle(row) / iterations;
            let is_pole = self.grid.is_pole(row);
            (0..planes).map(|plane| factor * nodes[if is_pole { 0 } else { plane }]).collect()
        };
        let of_group = |(iterations, nodes): &(u64, Vec<f64>)| {
            let rows = nodes.chunks(planes).enumerate();
            let values = rows.flat_map(|(row, nodes)| of_row(*iterations as f64, row, nodes));
            (*iterations, values.collect())
        };
        self.groups.iter().map(of_group).collect()
    }

    /// The measured distribution, cd, bilinear between the nodes. Its flux is that of all paths.
    pub fn distribution(&self) -> IntensityDistribution {
        let radians =
            |angles: Vec<f64>| -> Vec<f64> { angles.into_iter().map(f64::to_radians).collect() };
        let mut planes = self.planes();
        planes.push(360.0);
        let values = self.intensities();
        let rows = values.chunks(self.grid.planes);
        let closed = rows.flat_map(|row| row.iter().chain(&row[..1]).map(|node| node.value));
        let values = closed.collect();
        let own = IntensityDistribution::new(
            Photometry::C,
            radians(self.gammas()),
            radians(planes),
            values,
        );
        own.expect("ascending angles and finite sums")
    }
}

/// Starts a light path.
fn start(scene: &Scene, accel: &dyn Intersect, mut rng: Rng) -> Segment {
    let Emission { origin, direction, flux } = scene.lights().emit(&mut rng);
    let around = scene.media().map(|media| media.at(scene, accel, origin)).unwrap_or_default();
    let history = History::default().within(around);
    let state = PathState { rng, weight: flux, inverse_start: 1.0, path: 0, history };
    (Ray::new(origin, direction), state)
}

impl Role for BatchSums<'_> {
    const TRANSPORT: Transport = Transport::Flux;

    fn at_surface(&mut self, vertex: &PathVertex, rng: &mut Rng) -> Option<BsdfSample> {
        vertex.surface.scatter_flux(vertex.at, rng)
    }

    fn arrive_in_medium(&mut self, _vertex: &MediumVertex, _state: &mut PathState) -> bool {
        true
    }

    fn survives(&self, weight: Rgb, _lobe: Option<Lobe>, state: &mut PathState) -> bool {
        survives(weight, state)
    }
}

impl Walker for BatchSums<'_> {
    fn leave_scene(&mut self, ray: &Ray, state: &PathState) {
        let flux = f64::from(luminance(state.weight));
        let direction = ray.direction.as_dvec3().normalize_or_zero();
        self.grid.splat(direction, |node, weight| self.nodes[node] += flux * weight);
        self.total += flux;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(gamma_step: f64, c_step: f64) -> GoniometerGrid {
        GoniometerGrid::new(gamma_step, c_step, DMat3::IDENTITY).unwrap()
    }

    #[test]
    fn hat_functions_add_up_to_1_and_their_integrals_to_the_sphere() {
        for (gamma, c) in [(2.5, 15.0), (90.0, 360.0), (10.0, 90.0)] {
            let grid = grid(gamma, c);
            let nodes = |row| if grid.is_pole(row) { 1.0 } else { grid.planes as f64 };
            let all: f64 = (0..=grid.gammas).map(|row| grid.solid_angle(row) * nodes(row)).sum();
            assert!((all - 4.0 * PI).abs() < 1e-9, "{all}");
            for direction in [DVec3::X, DVec3::NEG_Z, DVec3::Z, DVec3::new(0.3, -0.5, 0.2)] {
                let mut sum = 0.0;
                grid.splat(direction.normalize(), |_, weight| sum += weight);
                assert!((sum - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn nodes_receive_their_own_direction_alone() {
        let grid = grid(30.0, 45.0);
        // gamma = 60 and C = 135 degrees
        let (sin, cos) = 60f64.to_radians().sin_cos();
        let half = 0.5f64.sqrt();
        let mut found = vec![0.0; grid.nodes()];
        grid.splat(DVec3::new(-sin * half, sin * half, -cos), |node, weight| found[node] += weight);
        assert!((found[2 * 8 + 3] - 1.0).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn steps_that_do_not_divide_the_sphere_are_refused() {
        for (gamma, c) in [(7.0, 15.0), (5.0, 50.0), (0.0, 15.0), (f64::NAN, 15.0), (0.05, 15.0)] {
            assert!(GoniometerGrid::new(gamma, c, DMat3::IDENTITY).is_err(), "{gamma} {c}");
        }
    }
}
