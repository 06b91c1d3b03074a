//! Merging beside a k-d tree (`kiddo`) and Embree's point queries that do the same look-ups, and
//! building the map beside copying and sorting the same bytes: in turn, so that ratios hold where
//! the speed of the machine changes.
//!
//! All three find the same photons around the gather points of `scenes/cornell-box` and add up the
//! same pairs, which is asserted. `BDPM_SCENE` takes another scene.

#![allow(missing_docs)]

mod paired;
mod raw;
mod squares;
mod subject;

use bdpm::Settings;
use bdpm::base::math::{Rgb, disc_area};
use bdpm::scene::backend::{Backend, build};
use bdpm::transport::camera_paths::CameraPaths;
use bdpm::transport::gather::GatherPoint;
use bdpm::transport::kernel::MergeKernel;
use bdpm::transport::light_paths::LightPaths;
use bdpm::transport::merge::{Merge, MergeOptions, MergeOutput};
use bdpm::transport::photon::{Photon, PhotonClass};
use bdpm::transport::photon_map::PhotonMap;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DVec3, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use paired::{Ratio, measures, timed};
use raw::points::RawPoints;
use squares::Squares;
use std::cell::RefCell;
use std::hint::black_box;
use std::time::Duration;
use subject::scene;

const LIGHT_PATHS: [u32; 3] = [1000, 100_000, 1_000_000];
/// The reference that the map is compared with.
const OTHERS: [&str; 2] = ["kiddo", "point queries"];

/// Rounds in which both sides take turns.
const TURNS: usize = 11;

/// All pairs together.
#[derive(Default)]
struct Sum {
    light: DVec3,
    pairs: u64,
}

/// Merges as [`Merge`] does, photons within the radius being found by `look_up(position, found)`.
fn merge_by(
    paths: &CameraPaths,
    (photons, settings): (&[Photon], &Settings),
    mut look_up: impl FnMut(Vec3, &mut dyn FnMut(u32)),
) -> Sum {
    let kernel = disc_area(settings.radius).recip();
    let mut sum = Sum::default();
    for point in paths.gather_points.iter() {
        assert_eq!(point.view, GatherPoint::NO_VIEW, "this bench merges Lambertian surfaces");
        let weight = point.weight * kernel;
        let last = point.vertex == settings.merge_vertex;
        let mut light = Rgb::ZERO;
        look_up(point.position, &mut |index| {
            let photon = &photons[index as usize];
            if (last || photon.class() == PhotonClass::Caustic) && photon.cosine(point.normal) > 0.0
            {
                sum.pairs += 1;
                light += weight * photon.flux;
            }
        });
        sum.light += light.as_dvec3();
    }
    sum
}

#[track_caller]
fn assert_same(
    what: &str,
    squares: &Squares,
    merge: &mut dyn FnMut(&CameraPaths) -> Sum,
    expected: &Sum,
) {
    let mut sum = Sum::default();
    squares.each(|paths| {
        let Sum { light, pairs } = merge(paths);
        sum.light += light;
        sum.pairs += pairs;
    });
    assert_eq!(sum.pairs, expected.pairs, "{what}");
    let off = (sum.light - expected.light).abs().max_element();
    assert!(off <= 1e-5 * expected.light.max_element(), "{what}: {off}");
}

fn merging(criterion: &mut Criterion) {
    let (scene, mut settings) = scene();
    (settings.width, settings.height, settings.camera_paths) = (512, 512, 4);
    let accel = build(Backend::Embree, &scene).unwrap();
    let mut gathered = MergeOutput::default();
    // Photons found and seconds per look-up.
    let (mut own, mut times) = (Vec::new(), [Vec::new(), Vec::new()]);
    for light_paths in LIGHT_PATHS {
        let mut light = LightPaths::default();
        light.trace(&scene, &*accel, &settings, light_paths, 0);
        let photons: Vec<Photon> = light.photons().flatten().copied().collect();
        let positions: Vec<Vec3> = photons.iter().map(|photon| photon.position).collect();

        let mut map = PhotonMap::default();
        map.build(&light, settings.radius);
        let kernel = MergeKernel::disc(settings.radius);
        let merge = Merge::new(&map, settings.merge_vertex, kernel, MergeOptions::default());
        let squares = Squares::new(&scene, &accel, &settings, merge.batch_size(false));
        let subject = (&photons[..], &settings);
        let (mut look_ups, mut expected) = (0, Sum::default());
        squares.each(|paths| {
            look_ups += paths.gather_points.iter().count();
            merge.gather_pairs(paths, &mut gathered, |gathered, complete| {
                expected.pairs += gathered.pairs.len() as u64;
                expected.light +=
                    gathered.sums[complete].iter().map(|sum| sum.as_dvec3()).sum::<DVec3>();
            });
        });
        let points: Vec<[f32; 3]> = positions.iter().map(Vec3::to_array).collect();
        let tree: ImmutableKdTree<f32, 3> = ImmutableKdTree::new_from_slice(&points).unwrap();
        let mut scratch = tree.create_scratch::<SquaredEuclidean<f32>>();
        let radius2 = settings.radius * settings.radius;
        let mut kiddo = |paths: &CameraPaths| {
            merge_by(paths, subject, |position, found| {
                tree.query(&position.to_array())
                    .within::<SquaredEuclidean<f32>>(radius2)
                    .unsorted()
                    .without_distances()
                    .with_scratch(&mut scratch)
                    .visit(|result| found(result.item));
            })
        };
        assert_same("kiddo", &squares, &mut kiddo, &expected);

        let embree = RawPoints::new(&positions);
        let mut queries = |paths: &CameraPaths| {
            merge_by(paths, subject, |position, found| {
                embree.within(position, settings.radius, found);
            })
        };
        assert_same("Embree", &squares, &mut queries, &expected);

        let mut group = criterion.benchmark_group(format!("look-ups/{light_paths}"));
        group.throughput(Throughput::Elements(look_ups as u64));
        group.bench_function("map", |bencher| {
            let mut time = || squares.time(|paths| merge.gather(paths, &mut gathered));
            bencher.iter_custom(|times| (0..times).map(|_| time()).sum());
        });
        group.finish();
        building(criterion, (&light, light_paths), &photons, settings.radius);
        if !measures() {
            continue;
        }
        let look_ups = look_ups as f64;
        let found = expected.pairs as f64 / look_ups;
        println!("{light_paths} light paths, {found:.3} found per look-up");
        let others: [&mut dyn FnMut(&CameraPaths) -> Sum; 2] = [&mut kiddo, &mut queries];
        for ((name, other), times) in OTHERS.iter().zip(others).zip(&mut times) {
            let ratio = Ratio::of(
                TURNS,
                || squares.time(|paths| _ = black_box(other(paths))),
                || squares.time(|paths| merge.gather(paths, &mut gathered)),
            );
            let map = ratio.seconds[1] / look_ups;
            println!("  {name} over the map's {:.1} ns per look-up: {ratio}", map * 1e9);
            own.push([found, map]);
            times.push([found, map * ratio.median]);
        }
    }
    for (name, times) in std::iter::once(("map", &own)).chain(OTHERS.into_iter().zip(&times)) {
        if !times.is_empty() {
            let [look_up, found] = fit(times);
            println!("{name}: {look_up:.1} ns per look-up, {found:.2} ns per found photon");
        }
    }
}

/// The map, by one thread and two, and what bounds it from below: a copy and a counting sort.
fn building(
    criterion: &mut Criterion,
    (light, light_paths): (&LightPaths, u32),
    photons: &[Photon],
    radius: f32,
) {
    let [one, two] =
        [1, 2].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap());
    let mut map = PhotonMap::default();
    let mut group = criterion.benchmark_group(format!("build/{light_paths}"));
    group.throughput(Throughput::Elements(photons.len() as u64));
    group.bench_function("1 thread", |bencher| {
        bencher.iter_custom(|times| {
            one.install(|| {
                timed(|| {
                    (0..times).for_each(|_| {
                        map.build(light, radius);
                    })
                })
            })
        });
    });
    group.finish();
    if !measures() {
        return;
    }
    let (mut copy, mut sorted) = (photons.to_vec(), photons.to_vec());
    let keys = keys(photons, 2.0 * radius);
    let mut starts = vec![0u32; keys.iter().max().map_or(0, |&last| last as usize + 2)];
    let mut copy_and_sort = || {
        copy.copy_from_slice(black_box(photons));
        starts.fill(0);
        keys.iter().for_each(|&key| starts[key as usize + 1] += 1);
        let mut sum = 0;
        for start in &mut starts {
            sum += *start;
            *start = sum;
        }
        for (photon, &key) in copy.iter().zip(&keys) {
            let place = &mut starts[key as usize];
            sorted[*place as usize] = *photon;
            *place += 1;
        }
    };
    // Each for milliseconds at a time, on its thread: waking one up takes longer than a small map.
    let times = 1_000_000u32.div_ceil(light_paths);
    let mut build = |pool: &rayon::ThreadPool| {
        pool.install(|| {
            timed(|| {
                (0..times).for_each(|_| {
                    map.build(light, radius);
                })
            })
        })
    };
    let sort = || timed(|| (0..times).for_each(|_| copy_and_sort()));
    let over_sort = Ratio::of(TURNS, || build(&one), sort);
    let speed = photons.len() as f64 * f64::from(times) / over_sort.seconds[0] * 1e-6;
    println!("build {light_paths}: {speed:.0} million photons/s, over copy and sort {over_sort}");
    let build = RefCell::new(build);
    let on = |pool| (build.borrow_mut())(pool);
    println!("  one thread over two: {}", Ratio::of(TURNS, || on(&one), || on(&two)));
}

/// The cells of a plain grid.
fn keys(photons: &[Photon], cell: f32) -> Vec<u32> {
    let corner = photons.iter().fold(Vec3::INFINITY, |corner, photon| corner.min(photon.position));
    let cells = || photons.iter().map(|photon| ((photon.position - corner) / cell).as_uvec3());
    let size = cells().fold(glam::UVec3::ZERO, glam::UVec3::max) + 1;
    cells().map(|cell| (cell.z * size.y + cell.y) * size.x + cell.x).collect()
}

/// Fits `time per look-up = a + b found per look-up` to all sizes by least squares of relative
/// errors; nanoseconds.
fn fit(points: &[[f64; 2]]) -> [f64; 2] {
    let [mut xx, mut xf, mut ff, mut x, mut f] = [0.0; 5];
    for &[found, time] in points {
        let (u, v) = (time.recip(), found / time);
        (xx, xf, ff, x, f) = (xx + u * u, xf + u * v, ff + v * v, x + u, f + v);
    }
    let determinant = xx * ff - xf * xf;
    [(x * ff - f * xf) / determinant, (xx * f - xf * x) / determinant].map(|t| t * 1e9)
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_secs(1));
    targets = merging
}
criterion_main!(benches);
