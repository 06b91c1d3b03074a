//! Chooses the path counts that minimize the cost of an image, from all measurements so far.

use super::denoised_noise::left_by_denoiser;
use super::neighbor_counts::by_neighbors;
use super::optimize::measured::of_neighborhoods;
use super::optimize::{
    CountLimits, MAX_CAMERA_PATHS, NEAR_OPTIMUM, Objective, PerPixel, Problem, Uniform,
};
use super::stopping::{Convergence, Stop, luminances};
use crate::timing::TimeModel;
use bdpm_core::film::cells::CellGrid;
use bdpm_core::film::counts::{CameraCounts, Counts};
use bdpm_core::film::radiance::{box_filter, luminance_weights};
use bdpm_core::noise::Coefficients;
use bdpm_core::render::Renderer;
use bdpm_core::render::block::{self, Block, CombinedImage};
use bdpm_core::settings::Settings;
use serde::{Deserialize, Serialize};

/// If fewer iterations of a large image fit in the rest of the time, their counts are chosen such
/// that a whole number of them does: a single iteration is a notable part of the time.
const FEW_ITERATIONS: f64 = 16.0;

/// Minimum number of iterations that should fit in the time after a choice of counts: some of them
/// are measured, and counts may be chosen again among them.
pub const MIN_ITERATIONS_AFTER_CHOICE: f64 = 64.0;

/// Minimum number of iterations of each of several processes, so that none ends long before
/// another.
const MIN_ITERATIONS_OF_RANK: f64 = 8.0;

/// [`MIN_ITERATIONS_AFTER_CHOICE`] for `ranks` processes that share the iterations.
pub fn min_iterations_after_choice(ranks: u32) -> f64 {
    MIN_ITERATIONS_AFTER_CHOICE.max(MIN_ITERATIONS_OF_RANK * f64::from(ranks))
}

/// Minimum time of the light paths, over that of one camera path per pixel. Few light paths make
/// disks of single photons, whose noise short trials see too rarely. So many cost at most this
/// share of the time.
const LEAST_LIGHT_TIME: f64 = 0.07;

/// Minimum number of suffix paths that fill a cache: with fewer, most cells have too few records,
/// so that camera paths go on as if there were no cache. theory.md, section 11c
pub const LEAST_SUFFIX_PATHS: u32 = 8192;

/// Number of light paths below which they take less than [`LEAST_LIGHT_TIME`], 0 if they take no
/// time; with a cache not less than [`LEAST_SUFFIX_PATHS`].
pub fn least_light_paths(times: &TimeModel, has_cache: bool) -> f64 {
    let [base, per_light_path] = times.in_light_paths(1.0);
    let least = LEAST_LIGHT_TIME * base / per_light_path;
    let least = if least.is_finite() { least } else { 0.0 };
    if has_cache { least.max(LEAST_SUFFIX_PATHS.into()) } else { least }
}

/// Minimum share of the time that a new block must save. A smaller gain is lost to the block's own
/// weight.
const WORTHWHILE: f64 = 0.02;

/// Minimum share of the time that counts per pixel must save. They follow the noise of the data
/// that they are chosen from, so their predicted gain is too large.
const WORTHWHILE_PER_PIXEL: f64 = 0.05;

/// Degrees of freedom of the mean over a neighborhood, relative to those of a single pixel, whose
/// values have heavy tails. Middle of the range in which `examples/optimum_table.rs` shows no
/// difference beyond its noise.
const PRIOR_FREEDOM: f64 = 200.0;

/// Predicted costs: time times variance of an iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ExpectedCosts {
    /// Time of an iteration at the chosen counts, seconds.
    pub tau: f64,
    /// Cost of one light path and one camera path per pixel.
    pub one_path_each: f64,
    /// Minimum cost of counts that are equal in every pixel.
    pub uniform: f64,
}

/// A choice of counts.
pub struct CountChoice {
    pub counts: Counts,
    pub costs: ExpectedCosts,
    /// True if the counts save enough time to start a new block.
    pub is_worthwhile: bool,
}

/// Chooses the counts of the next block from the blocks so far.
pub struct CountChooser<'a> {
    /// The image so far.
    pub renderer: &'a Renderer,
    /// Convergence of that image.
    pub convergence: Convergence,
    /// Conditions that end the render.
    pub stop: &'a Stop,
    /// Rendering time of this run, seconds.
    pub elapsed: f64,
    /// Times of an iteration.
    pub times: TimeModel,
    pub options: CountOptions,
}

/// How counts are chosen.
#[derive(Clone, Copy, Debug)]
pub struct CountOptions {
    /// True if camera paths may differ between pixels.
    pub per_pixel: bool,
    /// The image is denoised: what counts is the noise that is left.
    pub denoises: bool,
    /// Known times, which replace the measured ones.
    pub times: Option<TimeModel>,
}

impl CountChooser<'_> {
    /// The best counts from all measurements so far.
    pub fn choose(&self) -> CountChoice {
        let Self { renderer, stop, .. } = self;
        let (blocks, settings) = (renderer.blocks(), renderer.settings());
        let measured = block::coefficients(blocks).expect("the first iteration measures");
        let grid = CellGrid::of(settings.resolution());
        let smoothed = smoothed(blocks, &measured, grid);
        let (luminance, scale) = luminance(stop.objective, blocks, grid);
        let (smoothed, left) = self.noise_that_counts(smoothed, &luminance);
        // The model knows independent iterations only.
        let scale = self.convergence.set_factor * scale;
        let scale =
            scale / left * pooled_share(stop.objective, &smoothed, &renderer.block().counts, grid);
        let (fewest, most) = renderer.allowed_light_paths().bounds().into_inner();
        let least = match settings.shares_light() {
            true => {
                let least = least_light_paths(&self.times, settings.has_cache());
                (least as u32).clamp(fewest, most)
            }
            false => fewest,
        };
        let problem = |cells: &[Coefficients], iteration_time| {
            let bounds = CountLimits {
                light_paths: least..=most,
                camera_paths: 1..=MAX_CAMERA_PATHS,
                iteration_time,
            };
            Problem::new(cells, &luminance, stop.objective, self.times, &bounds)
                .of_squares(grid.pixels_per_cell())
        };
        let longest = self.longest_iteration(|time| problem(&smoothed, time), scale);
        let pooled = problem(&smoothed, longest);
        let uniform = pooled.shortest_uniform(NEAR_OPTIMUM);
        let per_pixel = match settings.shares_light() {
            true => Some(pooled.shortest_per_pixel(NEAR_OPTIMUM)),
            false => self.noise_of_paths(grid).and_then(|noise| {
                by_neighbors(noise, grid.size(), |cells| problem(cells, longest), &uniform)
            }),
        };
        let (mut counts, cost) = self.best_counts(&uniform, per_pixel, grid);
        let one_path_each = scale * pooled.evaluate_uniform(settings.pixels() as u32, 1).cost;
        // The cost of the present counts is measured from the samples of the block.
        // theory.md (88)
        let present_tau = self.times.at(&renderer.block().counts);
        let present = self.convergence.per_iteration.unwrap_or(0.0) * present_tau;
        let mut is_worthwhile = scale * cost < present * (1.0 - WORTHWHILE);
        let chosen = if is_worthwhile { &counts } else { &renderer.block().counts };
        if let Some(fitting) = self.fitting_counts(chosen) {
            (counts, is_worthwhile) = (fitting, true);
        }
        let tau = if is_worthwhile { self.times.at(&counts) } else { present_tau };
        let costs = ExpectedCosts { tau, one_path_each, uniform: scale * uniform.cost };
        CountChoice { is_worthwhile, counts, costs }
    }

    /// Coefficients of the noise that counts, from those of the image, and its share of the
    /// variance at the present counts.
    fn noise_that_counts(
        &self,
        noise: Vec<Coefficients>,
        luminance: &[f64],
    ) -> (Vec<Coefficients>, f64) {
        if !self.options.denoises {
            return (noise, 1.0);
        }
        let Settings { strategy, merge_vertex, .. } = *self.renderer.settings();
        let of = |own: &Coefficients| left_by_denoiser(strategy, merge_vertex, *own, (1.0, 0.0));
        let left: Vec<_> = noise.iter().map(of).collect();
        let Counts { light_paths, camera_paths } = &self.renderer.block().counts;
        let weights = self.stop.objective.weights(luminance);
        let variance = |cells: &[Coefficients]| {
            let weighted = cells.iter().zip(&weights).map(|(own, weight)| *own * *weight);
            let sum: Coefficients = weighted.sum();
            sum.variance(f64::from(*light_paths), camera_paths.mean())
        };
        let share = variance(&left) / variance(&noise);
        (left, if share > 0.0 { share } else { 1.0 })
    }

    /// Maximum time of an iteration, seconds: enough of them must fit in the remaining time. If a
    /// target ends the render, this time depends on the counts.
    fn longest_iteration(&self, problem: impl Fn(f64) -> Problem, scale: f64) -> f64 {
        let mut max_time = f64::INFINITY;
        let min_time = problem(max_time).least_sensible_time();
        // A few rounds suffice for convergence.
        for _ in 0..4 {
            let best = problem(max_time).uniform();
            let (variance, tau) = (best.variance * scale, best.iteration_time);
            let rest = self.convergence.forecast(self.stop, variance, tau, self.elapsed);
            let share =
                // theory.md (86), (90)
                rest.map_or(f64::INFINITY, |rest| {
                    rest.seconds / min_iterations_after_choice(self.renderer.config().ranks)
                });
            max_time = share.max(min_time);
        }
        max_time
    }

    /// The variance of a camera path of path tracing in each cell; `None` before it is known.
    fn noise_of_paths(&self, grid: CellGrid) -> Option<Vec<f64>> {
        let Block { film, counts, .. } = self.renderer.block();
        let paths = |cell| f64::from(counts.camera_paths.at(grid.first_pixel(cell)));
        let variance = film.cell_variance()?.into_iter().enumerate();
        let of_path =
            |(cell, variance): (usize, f64)| variance * film.iterations as f64 * paths(cell);
        Some(variance.map(of_path).collect())
    }

    /// The counts of `uniform`, or those per cell if they are better by enough, with their cost.
    fn best_counts(
        &self,
        uniform: &Uniform,
        per_pixel: Option<PerPixel>,
        grid: CellGrid,
    ) -> (Counts, f64) {
        let allowed = self.renderer.allowed_light_paths();
        let is_better = |own: &PerPixel| own.cost < uniform.cost * (1.0 - WORTHWHILE_PER_PIXEL);
        if let Some(best) = per_pixel.filter(|own| self.options.per_pixel && is_better(own)) {
            let camera_paths = CameraCounts::PerPixel(grid.expanded(&best.camera_paths));
            let light_paths = allowed.nearest(best.light_paths);
            return (Counts { light_paths, camera_paths }, best.cost);
        }
        let light_paths = allowed.nearest(uniform.light_paths);
        (Counts::uniform(light_paths, uniform.camera_paths), uniform.cost)
    }

    /// In large images, `chosen` with light paths with which a whole number of iterations fills the
    /// remaining time; `None` if nothing needs to change.
    fn fitting_counts(&self, chosen: &Counts) -> Option<Counts> {
        let Self { renderer, stop, .. } = self;
        let left = stop.time.map(|time| time.as_secs_f64() - self.elapsed);
        let left = left.filter(|_| is_large(renderer) && renderer.settings().shares_light())?;
        let light_paths = fitting_light_paths(&self.times, chosen, left)?;
        let light_paths = renderer.allowed_light_paths().at_most(light_paths);
        Some(Counts { light_paths, ..chosen.clone() })
    }
}

/// Luminance of each cell for the allocation of camera paths, and the mean of the weights that
/// follow from it.
fn luminance(objective: Objective, blocks: &[Block], grid: CellGrid) -> (Vec<f64>, f64) {
    let (width, height) = grid.size();
    let image = CombinedImage::new(blocks, vec![1.0; blocks.len()]);
    let unfiltered: Vec<_> = luminances(&image).into_iter().map(|l| [l]).collect();
    let luminance: Vec<f64> =
        box_filter(&unfiltered, width, height).into_iter().map(|[l]| l).collect();
    let scale = match objective {
        Objective::Relative => {
            luminance_weights(&luminance).iter().sum::<f64>() / luminance.len() as f64
        }
        _ => 1.0,
    };
    (luminance, scale)
}

/// Pooled variance over the objective at the present counts, as predicted. Costs are compared with
/// sampled variances, which are pooled, so both agree at these counts. 1 for objectives that are
/// means themselves.
fn pooled_share(
    objective: Objective,
    cells: &[Coefficients],
    counts: &Counts,
    grid: CellGrid,
) -> f64 {
    if matches!(objective, Objective::Pooled | Objective::Relative) {
        return 1.0;
    }
    let variances = || {
        let n_light = f64::from(counts.light_paths);
        let n_camera = move |cell| counts.camera_paths.at(grid.first_pixel(cell)).into();
        let cells = cells.iter().enumerate();
        cells.map(move |(cell, own)| own.variance(n_light, n_camera(cell)))
    };
    let share = Objective::Pooled.aggregate(variances()) / objective.aggregate(variances());
    if share.is_finite() && share > 0.0 { share } else { 1.0 }
}

/// Whether the pixels of the image share statistics.
pub fn is_large(renderer: &Renderer) -> bool {
    !CellGrid::of(renderer.settings().resolution()).is_single_pixels()
}

/// Light paths with which a whole number of iterations takes `left` seconds; `None` if that number
/// is at least [`FEW_ITERATIONS`], or if it would take another number of camera paths. The number
/// of iterations is the nearest one. If that leaves too few light paths, it is the next smaller
/// one.
fn fitting_light_paths(times: &TimeModel, counts: &Counts, left: f64) -> Option<u32> {
    let n_light = f64::from(counts.light_paths);
    let [base, per_light_path] = times.in_light_paths(counts.camera_paths.mean());
    let number = left / (base + per_light_path * n_light);
    if number >= FEW_ITERATIONS {
        return None;
    }
    let fitting = |number: f64| (left / number.max(1.0) - base) / per_light_path;
    let [least, most] = FITTING_RATIOS.map(|ratio| ratio * n_light);
    let mut all = [number.round(), number.floor()].map(fitting).into_iter();
    all.find(|own| (least..most).contains(own)).map(|own| own as u32)
}

/// Range of the ratio between fitting and best light paths. More of them cost little where camera
/// paths take most of the time.
const FITTING_RATIOS: [f64; 2] = [0.5, 8.0];

/// Times proportional to `pilot_times` that match the times of the production iterations of all
/// blocks.
pub fn fitted_times(pilot_times: &TimeModel, blocks: &[Block]) -> TimeModel {
    let (mut measured, mut predicted) = (0.0, 0.0);
    for Block { counts, clock, .. } in blocks {
        measured += clock.times.wall.as_secs_f64();
        predicted += clock.iterations as f64 * pilot_times.at(counts);
    }
    let scale = if measured > 0.0 && predicted > 0.0 { measured / predicted } else { 1.0 };
    pilot_times.scaled(scale)
}

/// Coefficients for the allocation of camera paths, at least 0. With few measurements, a cell has
/// those of its 5 by 5 neighborhood. With more, the weight of its own coefficients increases.
fn smoothed(blocks: &[Block], measured: &[Coefficients], grid: CellGrid) -> Vec<Coefficients> {
    let pooled = of_neighborhoods(measured, grid.size());
    let freedom = block::degrees_of_freedom(blocks);
    let mixed = |((&pixel, pooled), freedom): ((&Coefficients, Coefficients), f64)| {
        // theory.md (87)
        let share = freedom / (freedom + PRIOR_FREEDOM);
        (pixel * share + pooled * (1.0 - share)).clamped()
    };
    measured.iter().zip(pooled).zip(freedom).map(mixed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_iterations_of_a_large_image_fill_the_time() {
        let times = TimeModel {
            fixed: 0.1,
            light_path: 1e-6,
            camera_path: 1e-6,
            look_up: 0.0,
            merge_pair: 1e-11,
            pixels: 1e6,
        };
        let counts = Counts::uniform(100_000, 1);
        let tau = |n: u32| times.iteration(n.into(), 1.0);
        assert!((tau(100_000) - 2.2).abs() < 1e-9);
        for (left, number) in [(10.0, 5.0), (11.0, 5.0), (12.0, 5.0), (12.2, 6.0), (2.0, 1.0)] {
            let light_paths = fitting_light_paths(&times, &counts, left).unwrap();
            assert!((number * tau(light_paths) / left - 1.0).abs() < 1e-4, "{left}: {light_paths}");
        }
        // Many iterations end near enough to the time, and one cannot be shortened to any time.
        assert_eq!(fitting_light_paths(&times, &counts, 40.0), None);
        assert_eq!(fitting_light_paths(&times, &counts, 1.2), None);
        // Where camera paths take most of the time, four iterations cannot be shortened, and three
        // are longer.
        let camera = TimeModel { merge_pair: 0.0, ..times };
        let light_paths = fitting_light_paths(&camera, &counts, 4.2).unwrap();
        assert!((3.0 * camera.iteration(light_paths.into(), 1.0) / 4.2 - 1.0).abs() < 1e-4);
    }
}
