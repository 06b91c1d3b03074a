//! The scenes of this project, small: every strategy makes the same image of them, the path tracer's
//! where it finds one, and formula (1) predicts their noise.
//!
//! `BDPM_SCENES=16 cargo test --release --test scenes -- --nocapture --test-threads 1` takes 16 times
//! the iterations, for the table in `docs/scenes.md`.

mod common;

use bdpm::accel::Intersect;
use bdpm::noise::Measure;
use bdpm::noise::film::BatchGrain;
use bdpm::noise::image::NoiseImage;
use bdpm::noise::summary::Summary;
use bdpm::scene::load;
use bdpm::settings::{Direct, RenderDefaults};
use bdpm::{Renderer, Scene, Settings};
use common::accel;
use common::images::{Difference, Pixels};
use std::path::Path;

/// A scene's name, and what it takes to tell something about it.
struct Case {
    name: &'static str,
    /// Merge radius as a share of the scene size.
    radius: f32,
    /// Light paths per iteration.
    light_paths: u32,
    iterations: u64,
    /// Paths of the path tracer in each pixel, in multiples of 64; 0 if it misses some of the light.
    paths: u32,
}

/// Pixels across.
const WIDTH: u32 = 16;

fn factor() -> u32 {
    std::env::var("BDPM_SCENES").map_or(1, |text| text.parse().expect("a number in BDPM_SCENES"))
}

impl Case {
    fn load(&self) -> (Scene, Settings) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(self.name);
        let loaded = load(&path).unwrap();
        let [width, height] = loaded.defaults.resolution.unwrap_or([1, 1]);
        let resolution = Some([WIDTH, (WIDTH * height / width).max(1)]);
        let wishes = RenderDefaults { resolution, ..RenderDefaults::default() };
        let size = loaded.scene.size();
        let settings = Settings::resolve(&wishes, &loaded.defaults, size).unwrap();
        let (radius, light_paths) = (self.radius * size, self.light_paths);
        let settings = Settings { radius, light_paths, camera_paths: 64, ..settings };
        (loaded.scene, settings)
    }

    fn check(&self) {
        let (scene, settings) = self.load();
        let accel = accel(&scene);
        self.check_images(&scene, &*accel, &settings);
        self.check_noise(&scene, &*accel, &settings);
    }

    fn check_images(&self, scene: &Scene, accel: &dyn Intersect, settings: &Settings) {
        let Self { name, paths, iterations, .. } = *self;
        let (paths, iterations) = (paths * factor(), iterations * u64::from(factor()));
        let mut expected = (paths > 0).then(|| Pixels::traced(scene, accel, settings, paths));
        let mut seed = 10;
        for (direct, merge_vertex) in [
            (Direct::Connect, 1),
            (Direct::Connect, 2),
            (Direct::PhotonMap, 1),
            (Direct::PhotonMap, 2),
        ] {
            seed += 2;
            let settings = Settings { direct, merge_vertex, seed, ..settings.clone() };
            let found = Pixels::extrapolated(scene, accel, &settings, iterations);
            // Without a path tracer the first strategy is what the others are held against.
            let expected = expected.get_or_insert_with(|| found.clone());
            let Difference { off, error, z2 } = found.against(expected);
            println!("{name} {direct:?} k = {merge_vertex}: {off:+.4} +- {error:.4}, z^2 {z2:.2}");
            assert!(error < 0.05, "{name} {direct:?} {merge_vertex}: {error} says little");
            // Along edges the kernel loses area in proportion to the radius.
            assert!(off.abs() < 4.0 * error + 5e-3, "{name} {direct:?} {merge_vertex}: {off}");
            if false {};
            println!("{z2}");
            assert!(z2 < 200.0, "{name} {direct:?} {merge_vertex}: {z2}");
        }
    }

    /// The variance by the coefficients of one run over the sampled one of the same.
    fn check_noise(&self, scene: &Scene, accel: &dyn Intersect, settings: &Settings) {
        let counts = (settings.light_paths / 10, settings.camera_paths);
        let settings = Settings { light_paths: counts.0, ..settings.clone() };
        let pixels: Vec<usize> = (0..settings.pixels()).collect();
        let renderer = Renderer::new(scene, accel, settings).unwrap();
        let mut renderer = renderer.with_batches(BatchGrain::Pixel);
        for _ in 0..10 * self.iterations * u64::from(factor()) {
            renderer.iterate(Measure::Pairs);
        }
        let image = NoiseImage::new(renderer.film(), renderer.noise().unwrap(), counts);
        let ratio = Summary::new(&image, &pixels).pooled_rms.ratio;
        // Of the variance.
        let (off, error) = (ratio.value.powi(2) - 1.0, 2.0 * ratio.error);
        println!("{} variance: {off:+.4} +- {error:.4}", self.name);
        assert!(error < 0.015, "{}: {error} says little", self.name);
        assert!(off.abs() < 0.03, "{}: {off:+.4} +- {error:.4}", self.name);
    }
}

#[test]
fn cornell_box() {
    let (radius, light_paths) = (0.01, 40_000);
    Case { name: "cornell-box", radius, light_paths, iterations: 60, paths: 4096 }.check();
}

#[test]
fn keyhole() {
    let (radius, light_paths) = (0.01, 200_000);
    Case { name: "keyhole", radius, light_paths, iterations: 60, paths: 4096 }.check();
}

#[test]
fn materials() {
    let (radius, light_paths) = (0.01, 100_000);
    Case { name: "materials", radius, light_paths, iterations: 40, paths: 4096 }.check();
}

#[test]
fn caustic_sphere() {
    let (radius, light_paths) = (0.01, 100_000);
    Case { name: "caustic-sphere", radius, light_paths, iterations: 40, paths: 4096 }.check();
}

#[test]
fn point_caustic() {
    let (radius, light_paths) = (0.01, 100_000);
    Case { name: "point-caustic", radius, light_paths, iterations: 40, paths: 0 }.check();
}

#[test]
fn hall() {
    let (radius, light_paths) = (0.005, 200_000);
    Case { name: "hall", radius, light_paths, iterations: 20, paths: 1024 }.check();
}
