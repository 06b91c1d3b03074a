//! Choosing by what was measured does not bias the image.

use crate::common::Estimate;
use bdpm::film::radiance::luminance;
use bdpm::job::thread_pool;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::provenance::Provenance;
use bdpm::settings::{Bias, PartialSettings};
use bdpm::{RenderJob, RenderResult, Settings, Stop, load};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

const SIDE: u32 = 96;
/// Pixels along the side of a block.
const BLOCK: u32 = 16;
const RENDERS: u64 = 32;
const SECONDS: f64 = 0.5;

/// Mean luminance of each block of pixels.
fn block_means(result: &RenderResult) -> Vec<f64> {
    let across = SIDE / BLOCK;
    let mut means = vec![0.0; (across * across) as usize];
    for (pixel, value) in result.image.iter().enumerate() {
        let (x, y) = (pixel as u32 % SIDE, pixel as u32 / SIDE);
        let block = (y / BLOCK * across + x / BLOCK) as usize;
        means[block] += luminance(value.as_dvec3()) / f64::from(BLOCK * BLOCK);
    }
    means
}

/// The plan of each automatic render, rendered again with another seed, has the same mean. Which
/// plans there are depends on measured times; the statement holds for any. Guide and bias
/// correction are part of it, as in every render without options.
#[test]
fn automatic_renders_have_the_mean_of_their_replays() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box-classic");
    let loaded = load(&folder).unwrap();
    let threads = Arc::new(thread_pool(0).unwrap());
    let accel = build(Backend::default(), &loaded.scene).unwrap();
    let job = RenderJob::new(&loaded)
        .acceleration(Backend::default(), accel)
        .threads(threads)
        .at_least(2);
    let mut differences: Vec<Vec<f64>> = vec![Vec::new(); ((SIDE / BLOCK) as usize).pow(2)];
    let mut chosen = Vec::new();
    for seed in 0..RENDERS {
        let at = |seed| PartialSettings {
            resolution: Some([SIDE; 2]),
            seed: Some(seed),
            ..PartialSettings::default()
        };
        let time = Stop::time(Duration::from_secs_f64(SECONDS));
        let automatic = job.clone().settings(at(seed)).stop(time).render().unwrap();
        let technique = automatic.selection().unwrap().best().technique;
        chosen.push((technique.describe(), automatic.state.provenance.settings.bias));

        let made_by = Provenance {
            settings: Settings { seed: seed + 1000, ..automatic.state.provenance.settings.clone() },
            ..automatic.state.provenance.clone()
        };
        let replay = job.clone().settings(at(seed + 1000));
        let replay = replay.plan(automatic.plan.clone(), made_by, Path::new("replay"));
        let replayed = replay.render().unwrap();
        assert_eq!(replayed.plan, automatic.plan);
        let pairs = block_means(&automatic).into_iter().zip(block_means(&replayed));
        differences.iter_mut().zip(pairs).for_each(|(all, (a, b))| all.push(a - b));
    }
    // The test is about renders as users make them.
    assert!(chosen.iter().any(|(_, bias)| *bias == Bias::Reduce), "{chosen:?}");
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
    // Blocks share light paths, so that a quarter of the 36 are independent, or more. Student's t
    // has the variance 31/29.
    let independent = count / 4.0;
    assert!(mean.abs() < 4.0 / independent.sqrt(), "{mean} {scores:?}");
    assert!((square - 31.0 / 29.0).abs() < 4.0 * (2.0 / independent).sqrt(), "{square} {scores:?}");
}
