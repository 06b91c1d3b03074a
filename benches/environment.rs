//! Sampling of an environment map, and its radiance and density in a direction. A map of 4096x2048
//! pixels exceeds the caches of most processors.

#![allow(missing_docs)]

use bdpm::Scene;
use bdpm::base::math::uniform_sphere;
use bdpm::base::rng::{Stream, StreamKey};
use bdpm::load::load;
use bdpm::scene::{Environment, Receiver};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use std::path::Path;
use std::sync::Arc;

const SAMPLES: usize = 1 << 14;

/// A scene under a sky with a sun, over darker ground.
fn scene(width: u32, height: u32) -> Scene {
    let pixel = |i: u32| {
        let (column, row) = (i % width, i / width);
        let noise = (i.wrapping_mul(2_654_435_761) >> 20) as f32 / 4096.0;
        let is_sun = row.abs_diff(height / 4) * 512 < height && column * 512 < width;
        let sky = if is_sun { 1e4 } else { 0.2 + noise };
        Vec3::new(0.5, 0.7, 1.0) * if 2 * row < height { sky } else { 0.1 * noise }
    };
    let pixels = (0..width * height).map(pixel).collect();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box");
    let scene = Arc::unwrap_or_clone(load(folder).expect("a scene of the project").scene);
    scene.with_environment(Environment::new(width, height, pixels, 30.0))
}

fn bench_environment(criterion: &mut Criterion) {
    for (width, height) in [(1024, 512), (4096, 2048)] {
        let scene = scene(width, height);
        let lights = scene.lights();
        let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
        let mut group = criterion.benchmark_group(format!("environment-{width}x{height}"));
        group.throughput(Throughput::Elements(SAMPLES as u64));
        group.bench_function("sample", |bencher| {
            let mut sampled = || {
                // The first number chooses the last light, which is the environment.
                let place = [1.0 - 1e-9, rng.next_f64(), rng.next_f64(), 0.5, 0.5];
                let (_, emission) = lights.emit_at(place);
                emission.direction + emission.flux
            };
            bencher.iter(|| (0..SAMPLES).map(|_| sampled()).sum::<Vec3>());
        });
        group.bench_function("radiance-and-pdf", |bencher| {
            let at = Receiver { position: scene.bounds().center(), normal: None };
            let mut seen = || {
                let direction = uniform_sphere(rng.next_2d());
                {
                    let (radiance, pdf_w) = lights.environment_sight(direction, at);
                    radiance * pdf_w
                }
            };
            bencher.iter(|| (0..SAMPLES).map(|_| seen()).sum::<Vec3>());
        });
        group.finish();
    }
}

criterion_group!(benches, bench_environment);
criterion_main!(benches);
