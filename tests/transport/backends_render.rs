//! Whole renders by both backends, and by any number of threads.
#![cfg(feature = "embree")]

use crate::common::mean_luminance;
use bdpm::base::math::luminance;
use bdpm::load::load;
use bdpm::noise::Measure;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::Direct;
use bdpm::{Renderer, Scene, Settings};
use std::path::Path;
use std::sync::Arc;

fn cornell_box(name: &str) -> (Arc<Scene>, Settings) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    let loaded = load(&path).unwrap();
    let settings =
        Settings::resolve(&Default::default(), &loaded.defaults, loaded.scene.size()).unwrap();
    let settings = Settings { width: 64, height: 64, light_paths: 5000, ..settings };
    (loaded.scene, settings)
}

fn scenes() -> [(Arc<Scene>, Settings); 2] {
    ["cornell-box", "cornell-box-classic"].map(cornell_box)
}

#[test]
fn backends_with_one_seed_give_nearly_the_same_pixels() {
    for (scene, settings) in scenes() {
        let image = |backend| {
            let accel = build(backend, &scene).unwrap();
            let mut renderer = Renderer::new(&scene, &accel, settings.clone()).unwrap();
            for _ in 0..4 {
                renderer.iterate(Measure::Off);
            }
            renderer.film().mean()
        };
        let (embree, bvh) = (image(Backend::Embree), image(Backend::Bvh));
        let close = |(a, b): &(&_, &_)| {
            let (a, b) = (luminance(**a), luminance(**b));
            (a - b).abs() <= 1e-4 * a.abs().max(b.abs())
        };
        let agreeing = embree.iter().zip(&bvh).filter(close).count();
        println!("{}: {agreeing} of {} pixels agree", scene.name, bvh.len());
        assert!(agreeing as f64 >= 0.99 * bvh.len() as f64, "{agreeing} of {}", bvh.len());
    }
}

#[test]
fn different_seeds_agree_within_the_noise() {
    for (scene, settings) in scenes() {
        for direct in [Direct::Connect, Direct::PhotonMap] {
            let mean = |backend, seed| {
                let settings = Settings { direct, seed, width: 32, height: 32, ..settings.clone() };
                mean_luminance(&scene, &build(backend, &scene).unwrap(), settings, 60)
            };
            let (embree, bvh) = (mean(Backend::Embree, 1), mean(Backend::Bvh, 2));
            let error = embree.error.hypot(bvh.error);
            assert!(error < 0.02 * bvh.mean, "{embree:?} {bvh:?} say little");
            assert!((embree.mean - bvh.mean).abs() < 4.0 * error, "{embree:?} {bvh:?}");
        }
    }
}

#[test]
fn measured_images_are_the_same_bits_for_any_number_of_threads_and_as_without_measuring() {
    // The last has so many photons that look-ups are done region by region, for many tiles at once.
    let (scene, settings) = cornell_box("cornell-box");
    let many = (scene, Settings { light_paths: 300_000, ..settings });
    for (scene, settings) in scenes().into_iter().chain([many]) {
        let accel = build(Backend::Embree, &scene).unwrap();
        let render = |threads, measure| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut renderer = Renderer::new(&scene, &accel, settings.clone()).unwrap();
            for _ in 0..2 {
                pool.install(|| renderer.iterate(measure));
            }
            (renderer.film().clone(), renderer.block().statistics.noise.clone())
        };
        let off = render(2, Measure::Off).0;
        for measure in [Measure::Pairs, Measure::Halves] {
            let (film, noise) = render(1, measure);
            assert!(film == off, "{measure:?} changes the image");
            assert!(noise.is_some());
            for threads in [2, 5] {
                let found = render(threads, measure);
                assert!(found == (film.clone(), noise.clone()), "{measure:?}, {threads} threads");
            }
        }
    }
}
