//! Parts of an image, rendered apart and merged: all that is kept is what one run keeps.

use crate::common::automatic::*;
use bdpm::Stop;
use bdpm::adaptive::count_policy::CountPolicy;
use bdpm::adaptive::plan::{Plan, Rendered, Step};
use bdpm::base::iteration_set::IterationSet;
use bdpm::film::aov::AovSelection;
use bdpm::film::counts::{CameraCounts, Counts};
use bdpm::film::folds::DENOISE_FOLDS;
use bdpm::noise::film::{BatchCounts, BatchGrain, BatchSums, NoiseFilm};
use bdpm::noise::schedule::MeasureSchedule;
use bdpm::output::checkpoint::{Checkpoint, ShardedImage};
use bdpm::output::merge::{Merged, merge};
use bdpm::render::block::{Block, CombinedImage};
use bdpm::render::{PartialRender, RenderConfig};
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::provenance::Provenance;
use bdpm::{Renderer, Settings};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const ALL: AovSelection = AovSelection { light: true, features: true, folds: true, halves: false };

fn small() -> (Arc<bdpm::Scene>, Settings) {
    let (scene, settings) = scene();
    (scene, Settings { width: 24, height: 18, light_paths: 300, camera_paths: 2, ..settings })
}

/// Renders the iterations `own` and keeps all there is.
fn part(
    folder: &Path,
    own: IterationSet,
    (grain, mut policy): (BatchGrain, CountPolicy),
    sharded: Option<ShardedImage>,
) -> PathBuf {
    let (scene, settings) = small();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let renderer = Renderer::new(&scene, &accel, settings.clone()).unwrap();
    let config = RenderConfig { grain, aovs: ALL, ..RenderConfig::default() };
    let mut renderer = renderer.configure(config).unwrap();
    renderer.assign(own.clone());
    while renderer.iterations() < own.count() {
        let measure = policy.prepare(&mut renderer, &Stop::default(), 0.0).unwrap();
        renderer.iterate(measure);
    }
    let (backend, fingerprint) = ("bvh".into(), scene.fingerprint());
    let origin =
        Provenance { version: "1".into(), scene: "box".into(), fingerprint, backend, settings };
    let checkpoint = Checkpoint {
        shared: Cow::Borrowed(renderer.shared()),
        plan: policy.plan().cloned(),
        sharded,
        ..Checkpoint::new(origin, renderer.blocks())
    };
    let path = folder.join(format!("{own}.ckpt"));
    checkpoint.save(&path).unwrap();
    path
}

/// Whether two sums of the same terms differ by no more than order of addition explains.
#[track_caller]
fn assert_near(one: f64, other: f64, size: f64, precision: f64, what: &str) {
    assert!((one - other).abs() <= precision * size, "{what}: {one} {other}");
}

/// Sums over the image, and each of its sums, of a merged block against those of one run.
fn assert_same(merged: &Block, whole: &Block) {
    assert_eq!((merged.first, &merged.numbers), (whole.first, &whole.numbers));
    assert_eq!(merged.counts, whole.counts);
    for (own, other) in merged.film.sums.values().iter().zip(whole.film.sums.values()) {
        for axis in 0..3 {
            let [one, two] = [own, other].map(|sums| sums.radiance[axis]);
            assert_near(one, two, two, 1e-12, "radiance");
        }
        assert_near(own.luminance2, other.luminance2, other.luminance2, 1e-12, "square");
    }
    let [(one, error), (two, other_error)] =
        [merged, whole].map(|block| block.film.pooled_variance().unwrap());
    assert_near(one, two, two, 1e-12, "pooled variance");
    // Squared deviations in other terms give an error that is as good, but another number.
    assert!(error / other_error > 0.5 && error / other_error < 2.0, "{error} {other_error}");

    assert_eq!(merged.statistics.noise.is_some(), whole.statistics.noise.is_some());
    if let (Some(noise), Some(others)) = (&merged.statistics.noise, &whole.statistics.noise) {
        assert_same_noise(noise, others);
    }
    let [light, others] =
        [merged, whole].map(|block| block.statistics.light.as_ref().unwrap().folds()[0].values());
    for (own, other) in light.iter().zip(others) {
        for (one, two) in [
            (own.direct, other.direct),
            (own.caustics, other.caustics),
            (own.emission, other.emission),
        ] {
            assert_near(one.x, two.x, two.x, 1e-12, "light");
        }
    }
    let [folds, others] = [merged, whole].map(|block| block.statistics.folds.as_ref().unwrap());
    assert_eq!(folds.iterations(), others.iterations());
    for pixel in 0..merged.film.pixels() {
        for (own, other) in folds.at(pixel).zip(others.at(pixel)) {
            assert_near(own.y.into(), other.y.into(), other.y.into(), 1e-5, "fold");
        }
    }
}

/// Compares the measured noise likewise.
fn assert_same_noise(noise: &NoiseFilm, others: &NoiseFilm) {
    assert_eq!(noise.iterations, others.iterations);
    let scale: f64 = others.sums().values().iter().map(|p| p.coefficients.a.abs()).sum();
    for (own, other) in noise.sums().values().iter().zip(others.sums().values()) {
        for (one, two) in [
            (own.coefficients.a, other.coefficients.a),
            (own.coefficients.b, other.coefficients.b),
            (own.coefficients.f, other.coefficients.f),
            (own.deviations2, other.deviations2),
            (own.nested2, other.nested2),
        ] {
            assert_near(one, two, two.abs().max(1e-6 * scale), 1e-11, "noise");
        }
        assert_near(own.value, other.value, other.value, 1e-12, "value");
    }
    for (own, other) in noise.batches().zip(others.batches()) {
        let variance = |batches: &[BatchSums]| -> f64 {
            batches.iter().map(|batch| f64::from(batch.variance)).sum()
        };
        assert_near(variance(own), variance(other), variance(other), 1e-5, "variance");
        for (own, other) in own.iter().zip(other) {
            let size = other.coefficients.iter().fold(1e-9 * scale, |m, x| m.max(x.abs().into()));
            for (one, two) in own.coefficients.iter().zip(other.coefficients) {
                // Where a gap was filled, they are dealt out to other batches.
                if noise.counts() == others.counts() {
                    assert_near((*one).into(), two.into(), size, 1e-5, "batch");
                }
            }
        }
    }
}

/// That no value differs by more than a unit in the last place.
fn assert_same_image(merged: &Checkpoint, whole: &Checkpoint) {
    let image = |checkpoint: &Checkpoint| {
        let weights = match &checkpoint.plan {
            Some(plan) => plan.weights(&checkpoint.blocks),
            None => vec![1.0],
        };
        CombinedImage::new(&checkpoint.blocks, weights).mean()
    };
    for (one, two) in image(merged).iter().zip(image(whole)) {
        for axis in 0..3 {
            let [one, two] = [one[axis], two[axis]].map(f32::to_bits);
            assert!(one.abs_diff(two) <= 1, "{one} {two}");
        }
    }
    let [own, other] = [merged, whole].map(|all| all.shared.features.as_ref().unwrap());
    let [hits, other_hits] = [merged, whole].map(|all| all.shared.first_hits.as_ref().unwrap());
    for pixel in 0..whole.blocks[0].film.pixels() {
        for fold in 0..DENOISE_FOLDS {
            let [one, two] = [own, other].map(|features| features.mean(pixel, |f| f == fold));
            assert!((one.albedo - two.albedo).length() < 1e-5);
            assert!((one.normal - two.normal).length() < 1e-5);
        }
        assert!((hits.mean_hit(pixel).0 - other_hits.mean_hit(pixel).0).length() < 1e-5);
    }
}

#[test]
fn parts_merged_in_any_order_are_the_image_of_one_run() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir(&path).unwrap();
        path
    };
    for grain in [BatchGrain::Pixel, BatchGrain::Tile] {
        let folder = at(&format!("{grain:?}"));
        let whole = part(
            &folder,
            IterationSet::from(0..75),
            (grain, CountPolicy::Fixed(MeasureSchedule::default())),
            None,
        );
        let whole = Checkpoint::load(&whole).unwrap();
        // Uneven parts, one of them interrupted twice.
        let ranges = [0..8, 8..31, 31..33, 33..75];
        let parts = ranges.map(|range| {
            part(
                &folder,
                IterationSet::from(range),
                (grain, CountPolicy::Fixed(MeasureSchedule::default())),
                None,
            )
        });
        let mut orders = vec![parts.to_vec()];
        orders.push(parts.iter().rev().cloned().collect());
        orders.push([2, 0, 3, 1].map(|i: usize| parts[i].clone()).to_vec());
        let merged: Vec<Merged> = orders.iter().map(|order| merge(order).unwrap()).collect();
        assert!(merged.iter().all(|other| other.checkpoint == merged[0].checkpoint));
        let Merged { checkpoint, missing, unreadable, files } = &merged[0];
        assert!(missing.is_empty() && unreadable.is_empty() && *files == 4);
        assert_same(&checkpoint.blocks[0], &whole.blocks[0]);
        assert_same_image(checkpoint, &whole);
        // 8 of the pilot, then every eighth.
        for block in [&whole.blocks[0], &checkpoint.blocks[0]] {
            assert_eq!(*block.statistics.noise.as_ref().unwrap().counts(), BatchCounts::of(17));
        }

        // Merging is the same in steps.
        let [first, last] = [&parts[..2], &parts[2..]].map(|parts| merge(parts).unwrap());
        assert_eq!(last.missing, ["iterations 0 to 30"]);
        let halves = [(first, "first"), (last, "last")].map(|(half, name)| {
            let path = folder.join(name);
            half.checkpoint.save(&path).unwrap();
            path
        });
        assert_same(&merge(&halves).unwrap().checkpoint.blocks[0], &whole.blocks[0]);
    }
}

#[test]
fn parts_of_a_plan_are_weighted_as_it_says_and_gaps_are_filled() {
    let folder = tempfile::tempdir().unwrap();
    let map = CameraCounts::PerPixel((0..24 * 18).map(|i| 1 + i % 3).collect());
    let step = |light_paths, camera_paths, iterations, weight| Step {
        counts: Counts { light_paths, camera_paths },
        rendered: Some(Rendered { iterations, weight }),
    };
    let steps = vec![
        step(300, CameraCounts::Uniform(2), 9, 0.5),
        step(200, map, 14, 1.0),
        step(100, CameraCounts::Uniform(1), 17, 0.25),
    ];
    let replay = || (BatchGrain::Tile, CountPolicy::Plan(Plan { steps: steps.clone() }));
    let sharded = ShardedImage { iterations: 40, shards: 3 };
    let one = part(folder.path(), IterationSet::from(0..40), replay(), None);
    let one = Checkpoint::load(&one).unwrap();
    let parts = [0, 1, 2].map(|i| part(folder.path(), sharded.shard(i), replay(), Some(sharded)));
    let merged = merge(&parts).unwrap();
    let firsts = merged.checkpoint.blocks.iter().map(|block| block.first);
    assert_eq!(firsts.collect::<Vec<_>>(), [0, 9, 23]);
    assert_eq!((merged.missing.len(), merged.checkpoint.sharded), (0, None));
    merged.checkpoint.blocks.iter().zip(&one.blocks[..]).for_each(|(m, w)| assert_same(m, w));
    assert_same_image(&merged.checkpoint, &one);

    // The middle part is missing: a run that goes on renders it, in two blocks, and ends with the
    // same.
    let lacking = merge(&[&parts[0], &parts[2]].map(Clone::clone)).unwrap();
    assert_eq!(lacking.missing, ["part 2/3 (iterations 13 to 25)"]);
    assert_eq!(lacking.checkpoint.sharded, Some(sharded));
    let (scene, settings) = small();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let mut renderer = Renderer::new(&scene, &accel, settings).unwrap();
    let Checkpoint { blocks, shared, plan, .. } = lacking.checkpoint;
    renderer.resume(PartialRender::new(blocks.into_owned(), shared.into_owned())).unwrap();
    assert_eq!(renderer.config().aovs, ALL);
    let mut policy = CountPolicy::Plan(plan.unwrap());
    while renderer.iterations() < 40 {
        let measure = policy.prepare(&mut renderer, &Stop::default(), 0.0).unwrap();
        renderer.iterate(measure);
    }
    renderer.blocks().iter().zip(&one.blocks[..]).for_each(|(m, w)| assert_same(m, w));
}
