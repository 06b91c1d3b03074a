//! Whether every strategy makes the same image of a scene of this project, the path tracer's where
//! it finds one, and whether formula (1) predicts its noise.

use crate::common::committed::{self, TRACED};
use crate::common::images::{Difference, Subject};
use crate::common::strategies::ALL;
use crate::common::table::Table;
use crate::common::{accel, by_way};
use bdpm::noise::Measure;
use bdpm::noise::summary::NoiseSummary;
use bdpm::render::RenderConfig;
use bdpm::settings::Kernel;
use bdpm::{Renderer, Settings};

/// A scene's name, and what it takes to tell something about it.
pub struct Case {
    pub name: &'static str,
    /// Merge radius as a share of the scene size.
    pub radius: f32,
    /// Light paths per iteration.
    pub light_paths: u32,
    /// Iterations that teach light paths where to start.
    pub guide: u32,
    /// Iterations of each image.
    pub iterations: u64,
    /// Iterations that measure noise, of fewer paths.
    pub measured: u64,
    /// Share of the pixels that count: those with the least noise.
    pub quiet: f64,
    /// Largest standard error of the mean, relative, so that the test says something.
    pub error: f64,
    /// Largest mean square of the pixels' deviations.
    pub z2: f64,
}

impl Default for Case {
    fn default() -> Self {
        Self {
            name: "",
            radius: 0.01,
            light_paths: 100_000,
            guide: 0,
            iterations: 10,
            measured: 200,
            quiet: 1.0,
            error: 0.03,
            z2: 3.0,
        }
    }
}

/// Factor on the samples, for longer runs by hand: CONTRIBUTING.md.
fn factor() -> u64 {
    std::env::var("BDPM_SCENES").map_or(1, |text| text.parse().expect("a number in BDPM_SCENES"))
}

impl Case {
    pub fn check(&self) {
        let (scene, settings) = committed::small(self.name);
        let radius = self.radius * scene.size();
        let settings = Settings {
            radius,
            caustic_radius: radius,
            kernel: Kernel::Disc,
            light_paths: self.light_paths,
            guide: self.guide,
            camera_paths: 64,
            ..settings
        };
        let accel = accel(&scene);
        let (settings, accel) = (&settings, &accel);
        let region = &self.region(Subject { scene: &scene, accel, settings, region: &[] });
        let compared = committed::compared(self.name, &scene);
        let compared = compared.as_ref().unwrap_or(&scene);
        self.check_images(Subject { scene: compared, accel, settings, region });
        self.check_noise(Subject { scene: &scene, accel, settings, region });
    }

    /// Pixels of little noise relative to their value, by a run of their own.
    fn region(&self, subject: Subject) -> Vec<usize> {
        let pilot = subject.rendered(Settings { seed: 1000, ..subject.settings.clone() }, 16);
        // Edges of lamps have little noise beside their own light, and most of that of the image.
        let most = pilot.mean.iter().sum::<f64>() / pilot.mean.len() as f64;
        let noise = |i: &usize| pilot.variance[*i] / pilot.mean[*i].min(most).powi(2).max(1e-30);
        let mut pixels: Vec<usize> = (0..pilot.mean.len()).collect();
        pixels.sort_by(|i, j| noise(i).total_cmp(&noise(j)));
        pixels.truncate((self.quiet * pixels.len() as f64).ceil() as usize);
        pixels
    }

    fn check_images(&self, subject: Subject) {
        let Subject { scene, settings, region, .. } = subject;
        let name = self.name;
        let resolution = [settings.width, settings.height];
        let mut expected =
            TRACED.contains(&name).then(|| Table::of(name, scene, resolution).pixels(region));
        for ((direct, merge_vertex), seed) in ALL.into_iter().zip(10..) {
            let settings = by_way(Settings { direct, merge_vertex, seed, ..settings.clone() });
            let subject = Subject { settings: &settings, ..subject };
            let found = subject.extrapolated(self.iterations * factor());
            // Without a path tracer the first strategy is what the others are held against.
            let expected = expected.get_or_insert_with(|| found.clone());
            let difference = found.against(expected);
            let what = format!("{name} {direct:?} k = {merge_vertex}: {difference}");
            println!("{what}");
            let Difference { off, error, z2, .. } = difference;
            assert!(error < self.error, "says little: {what}");
            // Along edges the kernel loses area in proportion to the radius.
            assert!(off.abs() < 4.0 * error + 5e-3, "{what}");
            assert!(z2 < self.z2, "{what}");
        }
    }

    /// The variance by the coefficients of one run over the sampled one of the same.
    fn check_noise(&self, Subject { scene, accel, settings, region }: Subject) {
        let settings = Settings {
            light_paths: settings.light_paths / 10,
            camera_paths: settings.camera_paths / 2,
            ..settings.clone()
        };
        let renderer = Renderer::new(scene, accel, settings).unwrap();
        let mut renderer = renderer.configure(RenderConfig::with_pixel_batches()).unwrap();
        for _ in 0..self.measured * factor() {
            renderer.iterate(Measure::Pairs);
        }
        let image = renderer.block().noise_image().unwrap();
        let summary = NoiseSummary::new(&image, region);
        let [pooled, mean] = [&summary.pooled_rms, &summary.mean_rms].map(|compared| {
            // Deviation of the variance, with its standard error.
            (compared.ratio.corrected.powi(2) - 1.0, 2.0 * compared.ratio.error)
        });
        println!("{} noise: mean {mean:+.4?}, pooled {pooled:+.4?}", self.name);
        let (off, error) = mean;
        assert!(error < 0.02, "{}: {error} says little", self.name);
        assert!(off.abs() < 0.03 + 2.0 * error, "{}: {off:+.4} +- {error:.4}", self.name);
    }
}
