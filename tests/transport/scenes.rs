//! The scenes of this project, small: every strategy makes the same image of them, the path tracer's
//! where it finds one, and formula (1) predicts their noise.
//!
//! `BDPM_SCENES=16 cargo test --release --test transport scenes -- --nocapture --test-threads 1` takes 16 times
//! the iterations, for the table in `docs/scenes.md`.

use crate::common::images::{Difference, Subject};
use crate::common::{MIS, accel, by_way};
use bdpm::accel::Intersect;
use bdpm::import::load;
use bdpm::noise::Measure;
use bdpm::noise::film::BatchGrain;
use bdpm::noise::summary::NoiseSummary;
use bdpm::scene::Arrangement;
use bdpm::settings::{Direct, Kernel, PartialSettings};
use bdpm::{Renderer, Scene, Settings};
use std::path::Path;

/// A scene's name, and what it takes to tell something about it.
struct Case {
    name: &'static str,
    /// Merge radius as a share of the scene size.
    radius: f32,
    /// Light paths per iteration.
    light_paths: u32,
    /// Iterations of each image.
    iterations: u64,
    /// Paths of the path tracer in each pixel, in multiples of 64.
    paths: u32,
    /// The least [`factor`] for which these suffice; infinite if the path tracer misses some light.
    traced_from: f64,
    /// Without lights that no ray can hit: the path tracer misses their caustics.
    lamps_alone: bool,
    /// Share of the pixels that count: those with the least noise.
    quiet: f64,
    /// Largest standard error of the mean, relative, so that the test says something.
    error: f64,
    /// Largest mean square of the pixels' deviations.
    z2: f64,
}

impl Default for Case {
    fn default() -> Self {
        Self {
            name: "",
            radius: 0.01,
            light_paths: 100_000,
            iterations: 20,
            paths: 4096,
            traced_from: 1.0,
            lamps_alone: false,
            quiet: 1.0,
            error: 0.03,
            z2: 3.0,
        }
    }
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
        let wishes = PartialSettings { resolution, ..PartialSettings::default() };
        let size = loaded.scene.size();
        let settings = Settings::resolve(&wishes, &loaded.defaults, size).unwrap();
        let (radius, light_paths) = (self.radius * size, self.light_paths);
        let settings = Settings {
            radius,
            caustic_radius: radius,
            kernel: Kernel::Disc,
            light_paths,
            camera_paths: 64,
            ..settings
        };
        (loaded.scene, settings)
    }

    /// What images are compared of, where it is not the scene itself.
    fn compared(&self, scene: &Scene) -> Option<Scene> {
        self.lamps_alone.then(|| {
            let (meshes, placements) = (scene.meshes().to_vec(), scene.placements().to_vec());
            let arrangement = Arrangement { meshes, placements };
            let (name, materials) = (scene.name.clone(), scene.materials().to_vec());
            let (camera, regions) = (scene.camera, scene.regions.clone());
            Scene::new(name, arrangement, materials, Vec::new(), camera, regions).unwrap()
        })
    }

    fn check(&self) {
        let (scene, settings) = self.load();
        let accel = accel(&scene);
        let region = self.region(&scene, &*accel, &settings);
        let compared = self.compared(&scene);
        self.check_images(compared.as_ref().unwrap_or(&scene), &*accel, &settings, &region);
        self.check_noise(&scene, &*accel, &settings, &region);
    }

    /// Pixels of little noise relative to their value, by a run of their own.
    fn region(&self, scene: &Scene, accel: &dyn Intersect, settings: &Settings) -> Vec<usize> {
        let subject = Subject { scene, accel, settings, region: &[] };
        let pilot = subject.rendered(Settings { seed: 1000, ..settings.clone() }, 16);
        let noise = |i: &usize| pilot.variance[*i] / pilot.mean[*i].powi(2).max(1e-30);
        let mut pixels: Vec<usize> = (0..pilot.mean.len()).collect();
        pixels.sort_by(|i, j| noise(i).total_cmp(&noise(j)));
        pixels.truncate((self.quiet * pixels.len() as f64).ceil() as usize);
        pixels
    }

    fn check_images(
        &self,
        scene: &Scene,
        accel: &dyn Intersect,
        settings: &Settings,
        region: &[usize],
    ) {
        let (name, factor) = (self.name, factor());
        let subject = Subject { scene, accel, settings, region };
        let is_traced = f64::from(factor) >= self.traced_from;
        let mut expected = is_traced.then(|| subject.traced(self.paths * factor));
        let mut seed = 10;
        for (direct, merge_vertex) in [
            (Direct::Connect, 1),
            (Direct::Connect, 2),
            (Direct::PhotonMap, 1),
            (Direct::PhotonMap, 2),
            (Direct::Connect, MIS),
        ] {
            seed += 2;
            let settings = by_way(Settings { direct, merge_vertex, seed, ..settings.clone() });
            let subject = Subject { settings: &settings, ..subject };
            let found = subject.extrapolated(self.iterations * u64::from(factor));
            // Without a path tracer the first strategy is what the others are held against.
            let expected = expected.get_or_insert_with(|| found.clone());
            let Difference { off, error, z2 } = found.against(expected);
            let what = format!("{name} {direct:?} k = {merge_vertex}");
            println!("{what}: {off:+.4} +- {error:.4}, z^2 {z2:.2}");
            assert!(error < self.error, "{what}: {error} says little");
            // Along edges the kernel loses area in proportion to the radius.
            assert!(off.abs() < 4.0 * error + 5e-3, "{what}: {off} +- {error}");
            assert!(z2 < self.z2, "{what}: {z2}");
        }
    }

    /// The variance by the coefficients of one run over the sampled one of the same.
    fn check_noise(
        &self,
        scene: &Scene,
        accel: &dyn Intersect,
        settings: &Settings,
        region: &[usize],
    ) {
        let counts = (settings.light_paths / 10, settings.camera_paths / 2);
        let (light_paths, camera_paths) = counts;
        let settings = Settings { light_paths, camera_paths, ..settings.clone() };
        let renderer = Renderer::new(scene, accel, settings).unwrap();
        let mut renderer = renderer.with_batches(BatchGrain::Pixel);
        for _ in 0..10 * self.iterations * u64::from(factor()) {
            renderer.iterate(Measure::Pairs);
        }
        let image = renderer.noise_image().unwrap();
        let summary = NoiseSummary::new(&image, region);
        let [pooled, mean] = [&summary.pooled_rms, &summary.mean_rms].map(|compared| {
            // Of the variance.
            (compared.ratio.corrected.powi(2) - 1.0, 2.0 * compared.ratio.error)
        });
        println!("{} noise: mean {mean:+.4?}, pooled {pooled:+.4?}", self.name);
        let (off, error) = mean;
        assert!(error < 0.02, "{}: {error} says little", self.name);
        assert!(off.abs() < 0.03 + 2.0 * error, "{}: {off:+.4} +- {error:.4}", self.name);
    }
}

#[test]
fn cornell_box() {
    Case { name: "cornell-box", light_paths: 40_000, iterations: 60, ..Case::default() }.check();
}

#[test]
fn keyhole() {
    let (light_paths, error, traced_from) = (300_000, 0.07, 16.0);
    Case { name: "keyhole", light_paths, error, traced_from, ..Case::default() }.check();
}

#[test]
fn materials() {
    Case { name: "materials", lamps_alone: true, ..Case::default() }.check();
}

#[test]
fn caustic_sphere() {
    // Edges of the lamp, seen twice.
    let (quiet, traced_from) = (0.8, 16.0);
    Case { name: "caustic-sphere", quiet, traced_from, ..Case::default() }.check();
}

#[test]
fn point_caustic() {
    Case { name: "point-caustic", traced_from: f64::INFINITY, ..Case::default() }.check();
}

#[test]
fn objective() {
    Case { name: "objective", lamps_alone: true, ..Case::default() }.check();
}

#[test]
fn hall() {
    // Flames are smaller than pixels, and a pixel sees few of the light paths.
    let (lamps_alone, quiet, error) = (true, 0.5, 0.12);
    let (radius, paths) = (0.005, 2048);
    // Pixels share few photons here: the squares scatter more than independent ones would.
    let (name, z2) = ("hall", 5.0);
    Case { name, radius, paths, lamps_alone, quiet, error, z2, ..Case::default() }.check();
}
