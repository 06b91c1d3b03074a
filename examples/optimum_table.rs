//! How good the automatically chosen counts are: renders at them, at counts around them and at
//! naive ones, and compares the noise after equal time.
//!
//! ```sh
//! cargo run --release --example optimum_table -- scenes/cornell-box --time 2m
//! ```
//!
//! Counts are chosen as `bdpm render --auto` first does. All settings then take turns with other
//! random numbers, so that nothing of what the choice rests on is used again. The noise after a
//! time `T` is `sqrt(tau V / T)`, with the median time `tau` and the sampled pooled variance `V` of
//! an iteration.

use bdpm::accel::Intersect;
use bdpm::adaptive::autopilot::FIRST_ITERATIONS;
use bdpm::adaptive::autopilot::{Autopilot, AutopilotState, CountOptions};
use bdpm::adaptive::optimize::{CountLimits, MAX_CAMERA_PATHS, NEAR_OPTIMUM, Objective, Problem};
use bdpm::adaptive::stopping::Stop;
use bdpm::adaptive::technique::{self, End, FreeParameters};
use bdpm::film::counts::{CameraCounts, Counts};
use bdpm::film::radiance::box_filter;
use bdpm::load::load;
use bdpm::noise::{Coefficients, Measure};
use bdpm::render::block;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::PartialSettings;
use bdpm::timing::TimeModel;
use bdpm::{Renderer, Result, Scene, Settings};
use clap::Parser;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Measures how good the automatically chosen counts are.
#[derive(Parser)]
struct Args {
    /// Scenes: files, or folders that hold scene.toml
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Width and height of the images in pixels
    #[arg(long, default_value_t = 128)]
    side: u32,
    /// Time for each scene, besides the pilots
    #[arg(long, default_value = "2m", value_parser = bdpm::base::duration::positive_time)]
    time: Duration,
}

/// Fewest rounds; in each, every setting has its turn.
const MIN_ROUNDS: usize = 32;
/// Independent measurements of the coefficients, for the variance by formula (1) and its error.
const CHECKS: usize = 8;
/// The chosen counts, which all others are compared with, also have a turn after this many others.
const REFERENCE_EVERY: usize = 8;
/// Fewest iterations at the chosen counts in `--time`.
const MIN_ITERATIONS: f64 = 64.0;
/// Factors of each of the chosen counts in the grid.
const FACTORS: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];
/// One-sided 90 % of a normal distribution, standard deviations.
const Z90: f64 = 1.2816;

/// A pair of counts to compare.
struct Candidate {
    name: String,
    counts: Counts,
}

/// Counts, coefficients and times that a pilot measured.
struct Pilot {
    counts: Counts,
    /// Coefficients of each pixel, pooled over its neighborhood.
    coefficients: Vec<Coefficients>,
    time: TimeModel,
    most_light_paths: u32,
}

impl Pilot {
    /// Iterates up to the first choice of `autopilot`, whose times are of a sample of the image.
    fn new(
        mut autopilot: Autopilot,
        goal: &Stop,
        mut renderer: Renderer,
        time: TimeModel,
    ) -> Result<Self> {
        let start = Instant::now();
        for _ in 0..=FIRST_ITERATIONS {
            let measure = autopilot.prepare(&mut renderer, goal, start.elapsed().as_secs_f64());
            if renderer.film().iterations < FIRST_ITERATIONS {
                renderer.iterate(measure);
            }
        }
        let counts = renderer.block().counts.clone();
        let settings = renderer.settings();
        let measured = block::coefficients(renderer.blocks()).expect("the pilot measures");
        let values: Vec<_> = measured.iter().map(|c| [c.a, c.b, c.f]).collect();
        let pooled = box_filter(&values, settings.width, settings.height);
        Ok(Self {
            counts,
            coefficients: pooled.into_iter().map(|[a, b, f]| Coefficients { a, b, f }).collect(),
            time,
            most_light_paths: renderer.most_light_paths(),
        })
    }

    fn problem(&self, camera_paths: RangeInclusive<u32>, iteration_time: f64) -> Problem {
        let light_paths = 2..=self.most_light_paths;
        let bounds = CountLimits { light_paths, camera_paths, iteration_time };
        let luminance = vec![1.0; self.coefficients.len()];
        Problem::new(&self.coefficients, &luminance, Objective::Pooled, self.time, &bounds)
    }
}

/// The counts to compare: the chosen ones, those around them, naive ones, and counts per pixel.
fn candidates(
    scene: &Arc<Scene>,
    accel: &Arc<dyn Intersect>,
    settings: &Settings,
    time: Duration,
) -> Result<Vec<Candidate>> {
    let goal = Stop { time: Some(time / 2), ..Stop::default() };
    let end = End::Time(0.5 * time.as_secs_f64());
    let base = Renderer::new(scene, accel, settings.clone())?;
    let (chosen, _) = technique::choose(&base, FreeParameters::NONE, end, false)?;
    let autopilot = |per_pixel| {
        let options = CountOptions { per_pixel, denoises: false, times: None };
        Autopilot::new(AutopilotState::new(chosen.best().times, 0.0), options)
    };
    let renderer = || base.with_settings(chosen.best().apply(settings));
    let pilot = Pilot::new(autopilot(false), &goal, renderer()?, chosen.best().times)?;
    let longest = time.as_secs_f64() / MIN_ITERATIONS;
    let problem = pilot.problem(1..=MAX_CAMERA_PATHS, longest);

    let mut all: Vec<Candidate> = Vec::new();
    let mut add = |name: &str, light_paths: u32, camera_paths: u32| {
        let counts = Counts::uniform(light_paths, camera_paths);
        match all.iter_mut().find(|candidate| candidate.counts == counts) {
            Some(same) if !name.is_empty() => same.name += &format!(", {name}"),
            Some(_) => {}
            None => {
                all.push(Candidate { name: name.into(), counts });
            }
        }
    };
    let (n_light, n_camera) = (pilot.counts.light_paths, pilot.counts.camera_paths.least());
    add("chosen", n_light, n_camera);
    let times = |count: u32, factor: f64| (f64::from(count) * factor).round() as u32;
    for camera in FACTORS {
        for light in FACTORS {
            add("", times(n_light, light).max(2), times(n_camera, camera).max(1));
        }
    }
    add("one light path per pixel, N_B = 1", settings.pixels() as u32, 1);
    let single = pilot.problem(1..=1, longest).shortest_uniform(NEAR_OPTIMUM);
    add("best N_F for N_B = 1", single.light_paths, 1);
    add("scene file", settings.light_paths, settings.camera_paths);

    let mut map = Pilot::new(autopilot(true), &goal, renderer()?, chosen.best().times)?.counts;
    let mut name = "per pixel";
    if let CameraCounts::Uniform(_) = map.camera_paths {
        let best = problem.shortest_per_pixel(NEAR_OPTIMUM);
        let camera_paths = CameraCounts::PerPixel(best.camera_paths);
        map = Counts { light_paths: best.light_paths, camera_paths };
        name = "per pixel, which the automatic choice declined";
    }
    all.push(Candidate { name: name.into(), counts: map });
    Ok(all)
}

/// Iterations at one pair of counts.
struct Run {
    renderer: Renderer,
    seconds: Vec<f64>,
}

/// Time and variance of an iteration.
struct Cost {
    /// Median time, seconds, and its relative error.
    tau: (f64, f64),
    /// Sampled variance, and its relative error.
    sampled: (f64, f64),
    /// Variance by formula (1) from the coefficients of each check.
    by_formula: Vec<f64>,
}

impl Run {
    fn iterate(&mut self) {
        let times = self.renderer.iterate(Measure::Off).times;
        self.seconds.push(times.wall.as_secs_f64());
    }

    fn cost(&self, checks: &[Vec<Coefficients>]) -> Cost {
        let (variance, error) = self.renderer.film().pooled_variance().expect("many iterations");
        let mut sorted = self.seconds.clone();
        sorted.sort_by(f64::total_cmp);
        // The true median lies one sigma to either side, in ranks (n -+ sqrt n)/2.
        let n = sorted.len();
        let low = (0.5 * (n as f64 - (n as f64).sqrt())) as usize;
        let (tau, tau_error) = (sorted[n / 2], 0.5 * (sorted[n - 1 - low] - sorted[low]));
        let formula = |check: &Vec<_>| block::pooled_variance(check, &self.renderer.block().counts);
        Cost {
            tau: (tau, tau_error / tau),
            sampled: (variance, error / variance),
            by_formula: checks.iter().map(formula).collect(),
        }
    }
}

/// Lets all candidates take turns, each with a seed of its own, and so do the checks.
fn measure(
    scene: &Arc<Scene>,
    accel: &Arc<dyn Intersect>,
    settings: &Settings,
    candidates: &[Candidate],
    time: Duration,
) -> Result<Vec<Cost>> {
    let run = |(seed, counts): (u64, &Counts)| {
        let settings = Settings { seed, ..settings.clone() };
        let mut renderer = Renderer::new(scene, accel, settings)?;
        renderer.begin_block(counts.clone())?;
        Ok(Run { renderer, seconds: Vec::new() })
    };
    let seeds = settings.seed + 1..;
    let all = candidates.iter().map(|candidate| &candidate.counts);
    let mut runs: Vec<_> = seeds.zip(all).map(run).collect::<Result<_>>()?;
    let seeds = settings.seed + 1 + runs.len() as u64..;
    let chosen = std::iter::repeat_n(&candidates[0].counts, CHECKS);
    let mut checks: Vec<_> = seeds.zip(chosen).map(run).collect::<Result<_>>()?;
    let start = Instant::now();
    let mut rounds = 0;
    while rounds < MIN_ROUNDS || start.elapsed() < time {
        for index in 0..runs.len() {
            runs[index].iterate();
            if index > 0 && index % REFERENCE_EVERY == 0 {
                runs[0].iterate();
            }
        }
        checks[rounds % CHECKS].renderer.iterate(Measure::Pairs);
        rounds += 1;
    }
    let known = |run: &Run| block::coefficients(run.renderer.blocks()).expect("measured");
    let checks: Vec<_> = checks.iter().map(known).collect();
    Ok(runs.iter().map(|run| run.cost(&checks)).collect())
}

/// RMS after equal time over that of `reference` with its standard error, as sampled.
fn sampled(cost: &Cost, reference: &Cost) -> (f64, f64) {
    let (Cost { tau, sampled, .. }, other) = (cost, reference);
    let ratio = (tau.0 * sampled.0 / (other.tau.0 * other.sampled.0)).sqrt();
    let errors = [tau.1, sampled.1, other.tau.1, other.sampled.1];
    (ratio, 0.5 * ratio * errors.map(|error| error * error).iter().sum::<f64>().sqrt())
}

/// RMS after equal time over that of `reference`, by formula. Common fluctuations cancel.
fn by_formula(cost: &Cost, reference: &Cost) -> (f64, f64) {
    let count = CHECKS as f64;
    let mean = |cost: &Cost| cost.by_formula.iter().sum::<f64>() / count;
    let (own, other) = (mean(cost), mean(reference));
    let pairs = cost.by_formula.iter().zip(&reference.by_formula);
    let deviations: f64 = pairs.map(|(v, w)| (v / own - w / other).powi(2)).sum();
    let error2 =
        deviations / (count * (count - 1.0)) + cost.tau.1.powi(2) + reference.tau.1.powi(2);
    let ratio = (cost.tau.0 * own / (reference.tau.0 * other)).sqrt();
    (ratio, 0.5 * ratio * error2.sqrt())
}

fn print(scene: &Arc<Scene>, settings: &Settings, candidates: &[Candidate], costs: &[Cost]) {
    let Settings { width, height, .. } = settings;
    println!("### {}, {width}x{height} pixels\n", scene.name);
    println!("| counts | N_F | N_B | time of an iteration | RMS, sampled | RMS, by formula |");
    println!("|---|---|---|---|---|---|");
    let reference = &costs[0];
    let mut order: Vec<usize> = (1..candidates.len()).collect();
    order.sort_by_key(|&index| {
        let Counts { light_paths, camera_paths } = &candidates[index].counts;
        (matches!(camera_paths, CameraCounts::PerPixel(_)), camera_paths.least(), *light_paths)
    });
    for index in std::iter::once(0).chain(order) {
        let (Candidate { name, counts }, cost) = (&candidates[index], &costs[index]);
        let camera_paths = match &counts.camera_paths {
            CameraCounts::Uniform(count) => count.to_string(),
            map => format!("{} to {}, mean {:.1}", map.least(), map.most(), map.mean()),
        };
        let rms = |(ratio, error): (f64, f64)| match index {
            0 => "1".into(),
            _ => format!("{ratio:.3} +- {error:.3}"),
        };
        let (sampled, formula) = (rms(sampled(cost, reference)), rms(by_formula(cost, reference)));
        let (tau, light_paths) = (cost.tau.0 / reference.tau.0, counts.light_paths);
        println!("| {name} | {light_paths} | {camera_paths} | {tau:.3} | {sampled} | {formula} |");
    }

    let (map, uniform) = costs.split_last().expect("counts per pixel come last");
    for (way, ratio) in [("sampled", sampled as fn(&_, &_) -> _), ("by formula", by_formula)] {
        // The chosen counts' RMS over that of the others; 1 for themselves.
        let losses = || uniform[1..].iter().map(|cost| ratio(reference, cost));
        let loss = losses().map(|(ratio, _)| ratio).fold(1.0, f64::max);
        // Whichever is truly the best, its own bound is among these.
        let bound = losses().map(|(ratio, error)| ratio + Z90 * error).fold(1.0, f64::max);
        let [loss, bound] = [loss, bound].map(|ratio| 100.0 * (ratio - 1.0));
        let (gain, error) = ratio(reference, map);
        println!(
            "\n{way}: loss against the best of the table {loss:.1} %, at most {bound:.1} % (90 %); \
             RMS over that of counts per pixel {gain:.3} +- {error:.3}"
        );
    }
    println!();
}

fn table(path: &Path, args: &Args) -> Result<()> {
    let loaded = load(path)?;
    let wishes = PartialSettings { resolution: Some([args.side; 2]), ..PartialSettings::default() };
    let settings = Settings::resolve(&wishes, &loaded.defaults, loaded.scene.size())?;
    let scene = loaded.scene;
    let accel = build(Backend::default(), &scene)?;
    let candidates = candidates(&scene, &accel, &settings, args.time)?;
    let costs = measure(&scene, &accel, &settings, &candidates, args.time)?;
    print(&scene, &settings, &candidates, &costs);
    Ok(())
}

fn main() -> Result<()> {
    let args = Args::parse();
    args.scenes.iter().try_for_each(|scene| table(scene, &args))
}
