//! Merging beside a k-d tree (`kiddo`) and Embree's point queries that do the same look-ups, and
//! building the map beside copying and sorting the same bytes. Ratios are printed at the end.
//!
//! All three find the same photons around the gather points of `scenes/cornell-box` and add up the
//! same pairs, which is asserted. `BDPM_SCENE` takes another scene.

#![allow(missing_docs)]

mod home;
mod paired;
mod raw;
mod squares;
mod subject;

use bdpm::Settings;
use bdpm::accel::backend::{Backend, build};
use bdpm::camera_paths::CameraPaths;
use bdpm::gather::GatherPoint;
use bdpm::light_paths::LightPaths;
use bdpm::math::{Rgb, disc_area};
use bdpm::merge::{Gathered, Merge};
use bdpm::photon::{Photon, PhotonClass};
use bdpm::photon_map::PhotonMap;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DVec3, Vec3};
use home::median;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use raw::points::RawPoints;
use squares::Squares;
use std::cell::RefCell;
use std::hint::black_box;
use std::time::Duration;
use subject::scene;

const LIGHT_PATHS: [u32; 3] = [1000, 100_000, 1_000_000];
const STRUCTURES: [&str; 3] = ["map", "kiddo", "embree point queries"];

/// Look-ups, pairs found and photons, for each number of light paths.
type Counts = RefCell<Vec<[u64; 3]>>;

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
            if (last || photon.class() == PhotonClass::EveryVertex) && photon.faces(point.normal) {
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

fn merging(criterion: &mut Criterion, counts: &Counts) {
    let (scene, mut settings) = scene();
    (settings.width, settings.height, settings.camera_paths) = (512, 512, 4);
    let accel = build(Backend::Embree, &scene).unwrap();
    let mut gathered = Gathered::default();
    for light_paths in LIGHT_PATHS {
        let mut light = LightPaths::default();
        light.trace(&scene, &*accel, &settings, light_paths, 0);
        let photons: Vec<Photon> = light.photons().flatten().copied().collect();
        let positions: Vec<Vec3> = photons.iter().map(|photon| photon.position).collect();

        let mut map = PhotonMap::default();
        map.build(&light, settings.radius);
        let merge = Merge::new(&map, settings.merge_vertex);
        let squares = Squares::new(&scene, &*accel, &settings, merge.together(false));
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
        counts.borrow_mut().push([look_ups as u64, expected.pairs, photons.len() as u64]);

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
        let mut bench = |name: &str, work: &mut dyn FnMut(&CameraPaths)| {
            group.bench_function(name, |bencher| {
                bencher.iter_custom(|times| (0..times).map(|_| squares.time(&mut *work)).sum());
            });
        };
        bench(STRUCTURES[0], &mut |paths| merge.gather(paths, &mut gathered));
        bench(STRUCTURES[1], &mut |paths| {
            black_box(kiddo(paths));
        });
        bench(STRUCTURES[2], &mut |paths| {
            black_box(queries(paths));
        });
        group.finish();
        building(criterion, (&light, light_paths), &photons, settings.radius);
    }
}

/// The map, by one thread and two, and what bounds it from below: a copy and a counting sort.
fn building(
    criterion: &mut Criterion,
    (light, light_paths): (&LightPaths, u32),
    photons: &[Photon],
    radius: f32,
) {
    let mut group = criterion.benchmark_group(format!("build/{light_paths}"));
    group.throughput(Throughput::Elements(photons.len() as u64));
    for (threads, name) in [(1, "1 thread"), (2, "2 threads")] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut map = PhotonMap::default();
        pool.install(|| map.build(light, radius)); // takes the memory
        group.bench_function(name, |bencher| {
            bencher.iter(|| pool.install(|| map.build(light, radius)));
        });
    }
    let (mut copy, mut sorted) = (photons.to_vec(), photons.to_vec());
    let keys = keys(photons, 2.0 * radius);
    let mut starts = vec![0u32; keys.iter().max().map_or(0, |&last| last as usize + 2)];
    group.bench_function("copy and counting sort", |bencher| {
        bencher.iter(|| {
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
        });
    });
    group.finish();
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

fn ratios(counts: &Counts) {
    let counts = counts.borrow();
    let mut fits = STRUCTURES.map(|_| Vec::new());
    println!("\nlight paths, found per look-up: nanoseconds per look-up, and over the map");
    for (light_paths, &[look_ups, pairs, _]) in LIGHT_PATHS.into_iter().zip(&*counts) {
        let group = format!("look-ups/{light_paths}");
        let (look_ups, pairs) = (look_ups as f64, pairs as f64);
        let Some(map) = median(&group, STRUCTURES[0]) else { continue };
        print!("{light_paths:8} {:7.3}:", pairs / look_ups);
        for (name, fits) in STRUCTURES.iter().zip(&mut fits) {
            let Some(time) = median(&group, name) else { continue };
            print!("  {name} {:.1} ({:.2})", time / look_ups * 1e9, time / map);
            fits.push([pairs / look_ups, time / look_ups]);
        }
        println!();
    }
    for (name, points) in STRUCTURES.iter().zip(&fits) {
        if points.len() > 1 {
            let [look_up, found] = fit(points);
            println!("{name}: {look_up:.1} ns per look-up, {found:.2} ns per found photon");
        }
    }
    for (light_paths, &[.., photons]) in LIGHT_PATHS.into_iter().zip(&*counts) {
        let group = format!("build/{light_paths}");
        let time = |name| median(&group, name).unwrap_or(f64::NAN);
        let one = time("1 thread");
        println!(
            "build {light_paths:8}: {:.0} million photons/s, {:.2} times copy and sort, \
             {:.2} times 2 threads",
            photons as f64 / one * 1e-6,
            one / time("copy and counting sort"),
            one / time("2 threads"),
        );
    }
}

fn all(criterion: &mut Criterion) {
    let counts = Counts::default();
    merging(criterion, &counts);
    ratios(&counts);
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_secs(1));
    targets = all
}
criterion_main!(benches);
