//! The merge bias of a render by a render of the same paths at a tiny radius.

use bdpm::accel::Intersect;
use bdpm::base::math::LUMINANCE;
use bdpm::film::radiance::Film;
use bdpm::noise::Measure;
use bdpm::noise::film::BATCHES;
use bdpm::noise::merge_bias::MergeBias;
use bdpm::render::RenderConfig;
use bdpm::settings::{Kernel, PartialSettings};
use bdpm::{Renderer, Scene, Settings};
use std::sync::Arc;

/// The radius of references, as a share of the scene size.
pub const TINY: f32 = 0.002;

/// Merging at the first vertex, so that the map has all that is indirect; the radius is a share of
/// the scene size.
pub fn settings(
    scene: &Arc<Scene>,
    defaults: &PartialSettings,
    radius: f32,
    kernel: Kernel,
) -> Settings {
    let wishes = PartialSettings { resolution: Some([64, 64]), ..PartialSettings::default() };
    let settings = Settings::resolve(&wishes, defaults, scene.size()).expect("a committed scene");
    let radius = radius * scene.size();
    Settings {
        kernel,
        radius,
        caustic_radius: radius,
        merge_vertex: 1,
        light_paths: 200_000,
        camera_paths: 8,
        ..settings
    }
}

/// Mean square with its standard error, relative to the luminance of each pixel: theory.md (70a).
#[derive(Clone, Copy, Debug)]
pub struct Square {
    pub value: f64,
    pub error: f64,
}

/// The bias as it is, and as the render itself estimates it.
#[derive(Clone, Copy, Debug)]
pub struct Biases {
    pub real: Square,
    pub estimated: Square,
}

/// Sums of each batch of iterations, pixel by pixel, with the luminance of their number of
/// iterations.
pub type Batches = Vec<Vec<f64>>;

/// Renders so many iterations in each batch.
fn batches(renderer: &mut Renderer, iterations: u64, measure: Measure) -> Batches {
    let mut before = vec![0.0; renderer.film().pixels()];
    (0..BATCHES)
        .map(|_| {
            for _ in 0..iterations {
                renderer.iterate(measure);
            }
            let sums = sums(renderer.film());
            let own = sums.iter().zip(&before).map(|(sum, before)| sum - before).collect();
            before = sums;
            own
        })
        .collect()
}

fn sums(film: &Film) -> Vec<f64> {
    film.sums.map_rows(|pixel| pixel.radiance.dot(LUMINANCE.as_dvec3()))
}

/// Renders what biases are measured against: batches of iterations at the radius of the settings.
pub fn reference(
    scene: &Arc<Scene>,
    accel: &Arc<dyn Intersect>,
    settings: Settings,
    iterations: u64,
) -> Batches {
    batches(&mut Renderer::new(scene, accel, settings).unwrap(), iterations, Measure::Off)
}

/// The bias of a render whose paths are those of `reference`, so that most of their noise cancels.
///
/// The mean square has products of different batches only, to which noise adds nothing: theory.md
/// (69).
pub fn biases(
    scene: &Arc<Scene>,
    accel: &Arc<dyn Intersect>,
    settings: Settings,
    reference: &Batches,
    iterations: u64,
) -> Biases {
    let renderer = Renderer::new(scene, accel, settings).unwrap();
    let mut renderer = renderer.configure(RenderConfig::with_pixel_batches()).unwrap();
    let found = batches(&mut renderer, iterations, Measure::Pairs);
    let n = iterations as f64;
    let pixels = found[0].len();
    let total = |batches: &Batches, i: usize| {
        batches.iter().map(|batch| batch[i]).sum::<f64>() / (n * BATCHES as f64)
    };
    let luminances: Vec<f64> = (0..pixels).map(|i| total(reference, i)).collect();
    let mean = luminances.iter().sum::<f64>() / pixels as f64;
    let weight = |l: f64| (l * l + 0.01 * mean * mean).recip() / pixels as f64;
    // Without the batch of this number.
    let square = |left_out: usize| {
        let k = (BATCHES - usize::from(left_out < BATCHES)) as f64;
        let of_pixel = |i: usize| {
            let (mut sum, mut squares) = (0.0, 0.0);
            for batch in (0..BATCHES).filter(|&batch| batch != left_out) {
                let difference = (found[batch][i] - reference[batch][i]) / n;
                sum += difference;
                squares += difference * difference;
            }
            weight(luminances[i]) * (sum * sum - squares) / (k * (k - 1.0))
        };
        (0..pixels).map(of_pixel).sum::<f64>()
    };
    let without: Vec<f64> = (0..BATCHES).map(square).collect();
    let middle = without.iter().sum::<f64>() / BATCHES as f64;
    let scatter: f64 = without.iter().map(|s| (s - middle).powi(2)).sum();
    let share = (BATCHES - 1) as f64 / BATCHES as f64;
    let real = Square { value: square(BATCHES), error: (share * scatter).sqrt() };

    let all: Vec<usize> = (0..pixels).collect();
    let own = MergeBias::new(&renderer.block().noise_image().unwrap(), &all).relative;
    // The error of the square that this is the root of.
    let error = (2.0 * own.value * own.error).max(own.error.powi(2));
    let estimated = Square { value: own.value.powi(2), error };
    Biases { real, estimated }
}
