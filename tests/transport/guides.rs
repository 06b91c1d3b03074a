//! Guided light paths: equal means, less noise, and an image that does not depend on the machine.

use crate::common::boxes;
use crate::common::strategies::{ALL, assert_same_guided};
use crate::common::*;
use bdpm::noise::Measure;
use bdpm::render::RenderConfig;
use bdpm::scene::lights::guide::{Guide, GuideSample, GuidedStart};
use bdpm::settings::{Direct, Settings, Strategy};
use bdpm::{Renderer, Scene};
use std::sync::Arc;

#[test]
fn guided_light_through_a_window_is_the_same_by_every_strategy() {
    assert_same_guided("window", &ALL[..5], 16);
}

#[test]
fn caustics_and_a_room_under_all_lights_are_the_same_with_a_guide() {
    assert_same_guided("glass-ball", &[(Direct::Connect, 1)], 16);
    assert_same_guided("all-lights", &[(Direct::Connect, MIS), (Direct::PhotonMap, 1)], 16);
}

fn window_settings(direct: Direct) -> Settings {
    Settings { direct, light_paths: 20_000, ..settings(12, 12) }
}

/// A guide that sends light paths where they contribute nothing changes only the noise.
#[test]
fn a_wrong_guide_does_not_change_the_mean() {
    let scene = &boxes::named("window");
    let accel = accel(scene);
    let settings = &window_settings(Direct::PhotonMap);
    let start = |place| GuidedStart { place, density: 1.0 };
    let corner = |i: u32| {
        let share = f64::from(i % 100) / 100.0;
        start([0.5, 0.3 * share, 0.2 * (1.0 - share), 0.1 * share, 0.05])
    };
    let wrong: Vec<_> = (0..5000).map(|i| GuideSample { start: corner(i), square: 1.0 }).collect();
    let wrong = Arc::new(Guide::learn(&wrong, &Guide::even()));
    assert!(wrong.cell_count() > 5);
    let blocks = |guide: Option<&Arc<Guide>>, seed: u64| -> Vec<Estimate> {
        let own = Settings { seed, ..settings.clone() };
        let renderer = Renderer::new(scene, &accel, own).unwrap().guided(guide.cloned());
        let mut renderer = renderer;
        (0..400).for_each(|_| drop(renderer.iterate(Measure::Off)));
        let variance = renderer.film().variance_of_mean().unwrap();
        let mean = renderer.film().mean();
        let pixel = |(l, v): (&glam::Vec3, &f64)| Estimate {
            mean: f64::from(bdpm::base::math::luminance(*l)),
            error: v.sqrt(),
        };
        mean.iter().zip(&variance).map(pixel).collect()
    };
    let (plain, guided) = (blocks(None, 1), blocks(Some(&wrong), 2));
    // The window is seen by camera paths alone, with more noise than all else.
    let mut ratios: Vec<f64> =
        plain.iter().zip(&guided).map(|(a, b)| (b.error / a.error).powi(2)).collect();
    ratios.sort_by(f64::total_cmp);
    let ratio = ratios[ratios.len() / 2];
    println!("{} cells, {ratio} times the variance", wrong.cell_count());
    assert!(ratio > 1.5, "it is wrong enough to tell: {ratio}");
    let z2: f64 = plain
        .iter()
        .zip(&guided)
        .map(|(a, b)| ((a.mean - b.mean) / a.error.hypot(b.error)).powi(2))
        .sum::<f64>()
        / plain.len() as f64;
    // 144 squares of about 1, which share light paths.
    assert!((0.5..1.6).contains(&z2), "{z2}");
}

/// `a + f`, pooled, which light paths alone decide.
fn of_light_paths(scene: &Arc<Scene>, settings: Settings) -> f64 {
    let accel = accel(scene);
    let renderer = Renderer::new(scene, &accel, settings).unwrap();
    let mut renderer = renderer.configure(RenderConfig::with_pixel_batches()).unwrap();
    (0..60).for_each(|_| drop(renderer.iterate(Measure::Pairs)));
    let noise = renderer.block().noise_image().unwrap();
    let sum: f64 = noise.pixels.iter().map(|p| p.noise.coefficients).map(|c| c.a + c.f).sum();
    sum / noise.pixels.len() as f64
}

#[test]
fn guided_light_paths_reduce_noise_and_predict_it() {
    let scene = &daylight();
    let settings = Settings { radius: 0.1, caustic_radius: 0.1, ..settings(24, 24) };
    let accel = accel(scene);
    let renderer = Renderer::new(scene, &accel, settings.clone()).unwrap();
    let learned = renderer.learn_guide(|done, _| done < 32).unwrap();
    let plain = of_light_paths(scene, Settings { light_paths: 20_000, ..settings.clone() });
    let guided = of_light_paths(scene, Settings { light_paths: 20_000, guide: 32, ..settings });
    println!(
        "{} cells: {plain} to {guided}, told {}",
        learned.guide.cell_count(),
        learned.second_moment
    );
    assert!(guided < 0.35 * plain, "{plain} {guided}");
    // That is of relative errors at other radii.
    assert!((0.03..0.4).contains(&learned.second_moment), "{}", learned.second_moment);
}

fn daylight() -> Arc<Scene> {
    crate::common::committed::small("daylight").0
}

#[test]
fn guide_depends_neither_on_threads_nor_on_counts_nor_on_the_seed() {
    let scene = &daylight();
    let accel = accel(scene);
    let learned = |threads, own: Settings| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut renderer = Renderer::new(scene, &accel, own).unwrap();
            renderer.iterate(Measure::Off);
            (Arc::clone(renderer.guide().unwrap()), renderer.film().mean())
        })
    };
    let own = Settings { guide: 9, ..settings(20, 20) };
    let one = learned(1, own.clone());
    assert!(one.0.cell_count() > 5);
    assert_eq!(one, learned(3, own.clone()));
    let counts = Settings { light_paths: 300, camera_paths: 1, seed: 8, ..own.clone() };
    assert_eq!(one.0, learned(2, counts).0);
    assert_ne!(one.0, learned(2, Settings { guide: 10, ..own }).0);
}

/// Its camera paths would spend time on densities that no weight has. Other strategies learn again.
#[test]
fn path_tracing_has_no_guide() {
    let scene = &daylight();
    let accel = accel(scene);
    let (strategy, merge_vertex) = (Strategy::Path, 2);
    let own = Settings { guide: 9, strategy, merge_vertex, ..settings(20, 20) };
    let path = Renderer::new(scene, &accel, own.clone()).unwrap();
    let has_guide = |renderer: &Renderer| {
        let (scene, _) = renderer.scene_and_accel();
        (renderer.guide().is_some(), scene.lights().has_weighted_guide())
    };
    assert_eq!(has_guide(&path), (false, false));
    let mis = path.with_settings(Settings { strategy: Strategy::Mis, ..own.clone() }).unwrap();
    assert_eq!(has_guide(&mis), (true, true));
    assert_eq!(has_guide(&mis.with_settings(own).unwrap()), (false, false));
}
