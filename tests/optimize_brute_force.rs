//! The optimizer against exhaustive search over all whole counts.

use bdpm::noise::Coefficients;
use bdpm::optimize::{Bounds, Objective, PerPixel, Problem, Uniform};
use bdpm::rng::{Rng, Stream, StreamKey};
use bdpm::time_model::TimeModel;
use std::ops::RangeInclusive;

const OBJECTIVES: [Objective; 4] =
    [Objective::Pooled, Objective::Relative, Objective::MeanRms, Objective::MaxRms];

const SLACK: f64 = 0.01;

/// Costs may differ by rounding errors.
const ROUNDING: f64 = 1.0 + 1e-12;

fn rng(index: u64) -> Rng {
    StreamKey::new(1, Stream::Test, 0).rng(index)
}

/// A number over several orders of size, sometimes 0.
fn size(rng: &mut Rng, least: f64, most: f64) -> f64 {
    let value = least * (most / least).powf(rng.next_f64());
    if rng.next_f64() < 0.12 { 0.0 } else { value }
}

fn whole(rng: &mut Rng, range: RangeInclusive<u32>) -> u32 {
    range.start() + (rng.next_f64() * f64::from(range.end() - range.start() + 1)) as u32
}

fn coefficients(rng: &mut Rng) -> Coefficients {
    Coefficients { a: size(rng, 0.1, 1e3), b: size(rng, 0.01, 10.0), f: size(rng, 0.01, 10.0) }
}

/// A random problem with what exhaustive search needs to know of it.
struct Case {
    problem: Problem,
    pixels: usize,
    light_paths: RangeInclusive<u32>,
    camera_paths: RangeInclusive<u32>,
    iteration_time: f64,
}

impl Case {
    fn new(
        rng: &mut Rng,
        objective: Objective,
        pixels: usize,
        [light_paths, camera_paths]: [RangeInclusive<u32>; 2],
    ) -> Self {
        let coefficients: Vec<_> = (0..pixels).map(|_| coefficients(rng)).collect();
        let luminance: Vec<_> = (0..pixels).map(|_| size(rng, 1e-3, 10.0)).collect();
        let time = TimeModel {
            fixed: size(rng, 0.01, 10.0),
            light_path: size(rng, 1e-3, 1.0),
            camera_path: size(rng, 1e-3, 1.0),
            look_up: size(rng, 1e-3, 0.1),
            merge_pair: size(rng, 1e-5, 0.1),
            pixels: (pixels + whole(rng, 0..=2) as usize) as f64,
        };
        let middle =
            |range: &RangeInclusive<u32>| (*range.start() as f64 + *range.end() as f64) / 2.0;
        let limit = time.iteration(middle(&light_paths), middle(&camera_paths));
        let iteration_time = match whole(rng, 0..=2) {
            0 => limit * rng.next_f64(),
            _ => f64::INFINITY,
        };
        let bounds = Bounds {
            light_paths: light_paths.clone(),
            camera_paths: camera_paths.clone(),
            iteration_time,
        };
        let problem = Problem::new(&coefficients, &luminance, objective, time, &bounds);
        Self { problem, pixels, light_paths, camera_paths, iteration_time }
    }

    fn uniform(&self) -> Vec<Uniform> {
        let lines = self.light_paths.clone();
        let all = lines.flat_map(|n| self.camera_paths.clone().map(move |m| (n, m)));
        let all = all.map(|(n, m)| self.problem.evaluate_uniform(n, m));
        all.filter(|u| u.iteration_time <= self.iteration_time).collect()
    }

    fn per_pixel(&self) -> Vec<PerPixel> {
        let mut counts = vec![Vec::new()];
        for _ in 0..self.pixels {
            let longer = |counts: Vec<u32>| {
                self.camera_paths.clone().map(move |n| [&counts[..], &[n]].concat())
            };
            counts = counts.into_iter().flat_map(longer).collect();
        }
        let lines = self.light_paths.clone();
        let all = lines.flat_map(|n| counts.iter().map(move |counts| (n, counts)));
        let all = all.map(|(n, counts)| self.problem.evaluate(n, counts.clone()));
        all.filter(|p| p.iteration_time <= self.iteration_time).collect()
    }
}

/// Checks a least cost and a shortest iteration, each given as `[time, cost]`, against all counts.
fn check(all: &[[f64; 2]], best: [f64; 2], shortest: [f64; 2], limit: f64, shown: &str) {
    if all.is_empty() {
        // Even the fewest paths take too long, and these are chosen.
        assert_eq!(best, shortest, "{shown}");
        return;
    }
    assert!(best[0] <= limit && shortest[0] <= limit, "too long: {best:?} {shortest:?} {shown}");
    let least = all.iter().map(|[_, cost]| *cost).fold(f64::INFINITY, f64::min);
    assert!(best[1] <= least * ROUNDING, "{} times {least}: {shown}", best[1] / least);
    let most = least * (1.0 + SLACK) * ROUNDING;
    let least_time = all.iter().filter(|[_, cost]| *cost <= most).map(|[time, _]| *time);
    let least_time = least_time.fold(f64::INFINITY, f64::min);
    assert!(shortest[1] <= most * ROUNDING, "{} times {most}: {shown}", shortest[1] / most);
    let factor = shortest[0] / least_time;
    assert!(shortest[0] <= least_time * ROUNDING, "{factor} times {least_time}: {shown}");
    // Equal costs everywhere, or none: the shortest iteration of all.
    if all.iter().all(|[_, cost]| (cost - least).abs() <= 1e-14 * least) {
        let least_time = all.iter().map(|[time, _]| *time).fold(f64::INFINITY, f64::min);
        assert!(best[0] <= least_time * ROUNDING, "{best:?} {least_time} {shown}");
    }
}

fn bounds(rng: &mut Rng, most: [u32; 2]) -> [RangeInclusive<u32>; 2] {
    most.map(|most| {
        let least = whole(rng, 1..=3);
        least..=least.max(whole(rng, 1..=most))
    })
}

#[test]
fn uniform_counts_are_the_best_of_all() {
    for index in 0..4000 {
        let rng = &mut rng(index);
        let pixels = whole(rng, 1..=5) as usize;
        let bounds = bounds(rng, [40, 12]);
        let case = Case::new(rng, OBJECTIVES[index as usize % 4], pixels, bounds);
        let [best, shortest] = [case.problem.uniform(), case.problem.shortest_uniform(SLACK)];
        let pair = |u: &Uniform| [u.iteration_time, u.cost];
        let all: Vec<_> = case.uniform().iter().map(pair).collect();
        let shown = format!("{index} {best:?} {shortest:?} {:?}", case.problem);
        check(&all, pair(&best), pair(&shortest), case.iteration_time, &shown);
    }
}

#[test]
fn counts_per_pixel_are_the_best_of_all() {
    for index in 0..4000 {
        let rng = &mut rng(10_000 + index);
        let pixels = whole(rng, 1..=3) as usize;
        let bounds = bounds(rng, if pixels == 3 { [12, 6] } else { [30, 10] });
        let case = Case::new(rng, OBJECTIVES[index as usize % 4], pixels, bounds);
        let [best, shortest] = [case.problem.per_pixel(), case.problem.shortest_per_pixel(SLACK)];
        let pair = |p: &PerPixel| [p.iteration_time, p.cost];
        let all: Vec<_> = case.per_pixel().iter().map(pair).collect();
        let shown = format!("{index} {best:?} {shortest:?} {:?}", case.problem);
        check(&all, pair(&best), pair(&shortest), case.iteration_time, &shown);
        assert!(best.cost <= case.problem.uniform().cost * ROUNDING, "uniform: {shown}");
    }
}
