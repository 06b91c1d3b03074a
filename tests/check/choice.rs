//! Choosing by what was measured does not bias the image.

use crate::common::Estimate;
use bdpm::adaptive::autopilot::Autopilot;
use bdpm::adaptive::optimize::Objective;
use bdpm::adaptive::plan::Plan;
use bdpm::adaptive::stopping::{Goal, importance};
use bdpm::adaptive::technique::{self, End, FreeParameters};
use bdpm::adaptive::{Replay, Steer};
use bdpm::film::radiance::luminance;
use bdpm::import::load;
use bdpm::noise::Measure;
use bdpm::render::block::CombinedImage;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::PartialSettings;
use bdpm::{Renderer, Settings};
use std::path::Path;
use std::time::{Duration, Instant};

const SIDE: u32 = 96;
/// Pixels along the side of a block.
const BLOCK: u32 = 16;
const RENDERS: u64 = 32;
const SECONDS: f64 = 0.5;

/// Mean luminance of each block of pixels.
fn block_means(image: &CombinedImage) -> Vec<f64> {
    let across = SIDE / BLOCK;
    let mut means = vec![0.0; (across * across) as usize];
    for (pixel, value) in image.mean().into_iter().enumerate() {
        let (x, y) = (pixel as u32 % SIDE, pixel as u32 / SIDE);
        let block = (y / BLOCK * across + x / BLOCK) as usize;
        means[block] += luminance(value.as_dvec3()) / f64::from(BLOCK * BLOCK);
    }
    means
}

/// Issue "No knobs": the plan of each automatic render, made again with another seed, has the same mean. Which plans
/// there are depends on measured times; what is tested holds for any.
#[test]
fn automatic_renders_have_the_mean_of_their_replays() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box-classic");
    let loaded = load(&folder).unwrap();
    let wishes = PartialSettings { resolution: Some([SIDE; 2]), ..Default::default() };
    let settings = Settings::resolve(&wishes, &loaded.defaults, loaded.scene.size()).unwrap();
    let accel = build(Backend::default(), &loaded.scene).unwrap();
    let base = Renderer::new(&loaded.scene, &accel, settings.clone()).unwrap();
    let mut differences: Vec<Vec<f64>> = vec![Vec::new(); ((SIDE / BLOCK) as usize).pow(2)];
    let mut chosen = Vec::new();
    for seed in 0..RENDERS {
        let start = Instant::now();
        let base = base.with_settings(Settings { seed, ..settings.clone() }).unwrap();
        let choice = technique::choose(&base, FreeParameters::ALL, End::Time(SECONDS)).unwrap();
        let own = choice.best().apply(base.settings());
        chosen.push(choice.best().technique.describe());
        let (time, objective) = (Some(Duration::from_secs_f64(SECONDS)), Objective::Relative);
        let goal = Goal { time, objective, ..Goal::default() };
        let mut pilot = Autopilot::new(goal, choice.best().times);
        let mut renderer = base.with_settings(own.clone()).unwrap();
        while start.elapsed().as_secs_f64() < SECONDS || renderer.iterations() < 2 {
            let elapsed = start.elapsed().as_secs_f64();
            let measure = pilot.steer(&mut renderer, elapsed).unwrap();
            renderer.iterate(measure);
        }
        let importance = importance(renderer.blocks(), objective);
        let weights = pilot.weights(renderer.blocks(), &importance);
        let plan = Plan::of_blocks(renderer.blocks(), &weights);
        let automatic = block_means(&CombinedImage::new(renderer.blocks(), weights));

        let mut again = base.with_settings(Settings { seed: seed + 1000, ..own }).unwrap();
        let mut replay = Replay::new(plan.clone());
        for _ in 0..plan.iterations().unwrap() {
            replay.steer(&mut again, 0.0).unwrap();
            again.iterate(Measure::Off);
        }
        let replayed = CombinedImage::new(again.blocks(), replay.weights(again.blocks(), &[]));
        let pairs = automatic.into_iter().zip(block_means(&replayed));
        differences.iter_mut().zip(pairs).for_each(|(all, (a, b))| all.push(a - b));
    }
    chosen.sort();
    chosen.dedup();
    let scores = differences.iter().map(|samples| {
        let Estimate { mean, error } = Estimate::from_samples(samples);
        mean / error
    });
    let scores: Vec<f64> = scores.collect();
    let count = scores.len() as f64;
    let mean = scores.iter().sum::<f64>() / count;
    let square = scores.iter().map(|z| z * z).sum::<f64>() / count;
    println!("{chosen:?}: mean of z {mean:.3}, of z^2 {square:.3}");
    // Blocks share light paths, so that a quarter of the 36 are independent, or more. Student's t has the
    // variance 31/29.
    let independent = count / 4.0;
    assert!(mean.abs() < 4.0 / independent.sqrt(), "{mean} {scores:?}");
    assert!((square - 31.0 / 29.0).abs() < 4.0 * (2.0 / independent).sqrt(), "{square} {scores:?}");
}
