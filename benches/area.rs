//! Areas of surfaces around gather points: the first time, when they are worked out, and later; and
//! merging divided by them over merging divided by discs, in turn. `BDPM_SCENE` takes another scene
//! than `scenes/cornell-box`.

#![allow(missing_docs)]

mod paired;
mod squares;
mod subject;

use bdpm::Settings;
use bdpm::accel::Intersect;
use bdpm::scene::Scene;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings;
use bdpm::simd::{LANES, Mask, Vec3s};
use bdpm::transport::area::{Areas, Query};
use bdpm::transport::kernel::MergeKernel;
use bdpm::transport::light_paths::LightPaths;
use bdpm::transport::merge::{Merge, MergeOptions, MergeOutput};
use bdpm::transport::photon_map::PhotonMap;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use paired::{Ratio, measures, timed};
use squares::Squares;
use std::hint::black_box;
use std::sync::Arc;

const LIGHT_PATHS: [u32; 2] = [1000, 100_000];
/// Rounds in which both sides take turns.
const TURNS: usize = 11;

/// Sixteen gather points.
#[derive(Clone, Copy, Default)]
struct Packet {
    position: Vec3s,
    facet: [u32; LANES],
    wanted: Mask,
}

fn subject() -> (Arc<Scene>, Settings) {
    let (scene, mut settings) = subject::scene();
    (settings.width, settings.height, settings.camera_paths) = (512, 512, 4);
    settings.merge_vertex = 1;
    settings.kernel = settings::Kernel::Area;
    (scene, settings)
}

/// The gather points of squares of the image.
fn packets(squares: &Squares, areas: &Areas) -> Vec<Packet> {
    let mut packets = vec![Packet::default()];
    let mut lane = 0;
    squares.each(|paths| {
        for point in paths.gather_points.iter() {
            if lane == LANES {
                packets.push(Packet::default());
                lane = 0;
            }
            let packet = packets.last_mut().expect("one");
            packet.position.set(lane, point.position);
            packet.facet[lane] = areas.number(point.facet.mesh, point.facet.side);
            packet.wanted[lane] = true;
            lane += 1;
        }
    });
    packets
}

fn ask(areas: &Areas, packets: &[Packet], settings: &Settings) {
    let radii = [settings.radius, settings.caustic_radius];
    for Packet { position, facet, wanted } in packets {
        black_box(areas.areas(&Query { position, facet, wanted }, &radii));
    }
}

fn area(criterion: &mut Criterion) {
    let (scene, settings) = subject();
    let accel: &Arc<dyn Intersect> = &build(Backend::Embree, &scene).unwrap();
    let squares = Squares::new(&scene, accel, &settings, 2048);
    let areas = Areas::of_scene(&scene, &**accel, settings.reach());
    let packets = packets(&squares, &areas);
    let points = packets.iter().flat_map(|packet| packet.wanted).filter(|&wanted| wanted).count();

    let mut group = criterion.benchmark_group("area");
    group.throughput(Throughput::Elements(points as u64)).sample_size(20);
    ask(&areas, &packets, &settings);
    group.bench_function("known", |bencher| bencher.iter(|| ask(&areas, &packets, &settings)));
    group.finish();
    if !measures() {
        return;
    }
    let new = Areas::of_scene(&scene, &**accel, settings.reach());
    let first = timed(|| ask(&new, &packets, &settings)).as_secs_f64();
    let later = timed(|| ask(&areas, &packets, &settings)).as_secs_f64();
    let each = |seconds: f64| 1e9 * seconds / points as f64;
    let memory = areas.memory();
    println!(
        "{points} points: {:.0} ns each the first time, {:.0} ns later; {:.1} MB and {:.1} MB for these",
        each(first),
        each(later),
        1e-6 * memory.fixed as f64,
        1e-6 * memory.kept as f64
    );
    for light_paths in LIGHT_PATHS {
        let mut light = LightPaths::default();
        light.trace(&scene, &**accel, &settings, light_paths, 0);
        let mut map = PhotonMap::default();
        let kernels = [
            MergeKernel::discs([settings.caustic_radius, settings.radius]),
            MergeKernel::new(&settings, Some(&areas)),
        ];
        map.build(&light, settings.radius);
        let [disc, area] = kernels
            .map(|kernel| Merge::new(&map, settings.merge_vertex, kernel, MergeOptions::default()));
        let time = |merge: &Merge| {
            let mut gathered = MergeOutput::default();
            squares.time(|paths| merge.gather(paths, &mut gathered))
        };
        let ratio = Ratio::of(TURNS, || time(&area), || time(&disc));
        println!("merging {light_paths} light paths, areas over discs: {ratio}");
    }
}

criterion_group!(benches, area);
criterion_main!(benches);
