use super::*;
use crate::output::light_layers::{LIGHTS, VARIANCE};
use crate::output::recorded_error::{RecordedDenoisedError, RecordedError};
use bdpm_core::base::rng::{Stream, StreamKey};
use bdpm_core::image_io::{Image, Layer, Metadata, Value};

const SIZE: (u32, u32) = (640, 480);

/// Places of the lights in the image, and the noise of each over its luminance.
const LIGHTS_AT: [([f32; 2], f32); 3] = [([0.2, 0.3], 0.05), ([0.8, 0.2], 0.2), ([0.6, 0.9], 0.6)];

/// The image of a light that fades with distance, with edges, noise, and bright single pixels.
fn image(index: usize, denoised: Option<f64>) -> Image {
    let ([x, y], noise) = LIGHTS_AT[index];
    let mut rng = StreamKey::new(index as u64 + 1, Stream::Test, 0).rng(0);
    let (mut radiance, mut variance) = (Vec::new(), Vec::new());
    for pixel in 0..SIZE.0 * SIZE.1 {
        let (column, row) = ((pixel % SIZE.0) as f32, (pixel / SIZE.0) as f32);
        let (dx, dy) = (column / SIZE.0 as f32 - x, row / SIZE.1 as f32 - y);
        let albedo =
            if (column as u32 / 20 + row as u32 / 15).is_multiple_of(2) { 0.8 } else { 0.1 };
        let mean = albedo / (0.02 + dx * dx + dy * dy);
        let sigma = noise * mean * (1.0 + 2.0 * rng.next_1d());
        let error = sigma * ((0..12).map(|_| rng.next_1d()).sum::<f32>() - 6.0);
        let rare = if rng.next_1d() < 0.002 { 20.0 * mean } else { 0.0 };
        radiance.push(Rgb::splat(mean + error + rare));
        variance.push(sigma * sigma + rare * rare);
    }
    let variance = Layer { name: VARIANCE.into(), channels: vec![("Y".into(), variance)] };
    let name = ["key", "fill", "rim"][index];
    let mut metadata = Metadata::from([(LIGHTS.into(), Value::Text(name.into()))]);
    RecordedError { total: 0.1, noise: 0.1, bias: 0.02, interval: None }.record(&mut metadata);
    let mut layers = vec![Layer::rgb("", &radiance), variance];
    if let Some(total) = denoised {
        RecordedDenoisedError { total, interval: None }.record(&mut metadata);
        layers.push(Layer::rgb(bdpm_core::image_io::NOISY, &radiance));
    }
    Image { width: SIZE.0, height: SIZE.1, layers, metadata }
}

fn lights(denoised: Option<f64>) -> LightImages {
    let of = |index: usize| (index.to_string(), image(index, denoised.filter(|_| index == 1)));
    let mut lights = LightImages::new((0..3).map(of).collect()).unwrap();
    for (seed, light) in lights.lights.iter_mut().enumerate() {
        light.errors.seed = Some(seed as u64);
    }
    lights
}

/// Maximum relative differences of total, noise and bias over many mixtures.
fn differences(lights: &LightImages, sample: &MixtureSample) -> [f64; 3] {
    let mut rng = StreamKey::new(9, Stream::Test, 0).rng(0);
    let mut largest = [0.0f64; 3];
    for mixture in 0..15 {
        let mut factors = [0; 3].map(|_| 2.0 * rng.next_1d());
        factors[mixture % 3] *= [1.0, 0.1, 0.0][mixture / 5];
        let own = sample.error(&factors.map(f64::from)).unwrap();
        let exact = lights.mixture(&factors.map(Rgb::splat)).error.unwrap();
        assert_eq!(own.is_denoised, exact.is_denoised);
        let pairs = [(own.total, exact.total), (own.noise, exact.noise), (own.bias, exact.bias)];
        for (largest, (own, exact)) in largest.iter_mut().zip(pairs) {
            *largest = largest.max((own / exact - 1.0).abs());
        }
    }
    largest
}

/// Numbers of pixels are rounded to 11 bits.
#[test]
fn sample_of_all_pixels_has_the_errors_of_the_image() {
    for denoised in [None, Some(0.05)] {
        let lights = lights(denoised);
        let sample = lights.sample(1 << 22);
        assert!(sample.clean_share.is_none() && sample.squares.len() == 1);
        let all = differences(&lights, &sample);
        assert!(all.iter().all(|own| *own < 1e-3), "{all:?}");
    }
}

#[test]
fn sample_of_squares_has_the_errors_of_the_image() {
    for denoised in [None, Some(0.05)] {
        let lights = lights(denoised);
        // As much as a page has: room for half of the pixels.
        let bytes = 1_700_000;
        let sample = lights.sample(bytes);
        let stored: usize = sample.lights.iter().map(|own| 4 * own.luminance.len()).sum();
        assert!(sample.clean_share.is_some() && stored <= bytes, "{stored}");
        let all = differences(&lights, &sample);
        assert!(all[0] < 0.02, "{all:?}");
        assert!(sample.largest_difference < 0.02, "{}", sample.largest_difference);
        // The errors of all lights together and of each alone are exact.
        for factors in [[1.0; 3], [1.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 2.0]] {
            let exact = lights.mixture(&factors.map(|own| Rgb::splat(own as f32))).error.unwrap();
            let own = sample.error(&factors).unwrap();
            assert!((own.total / exact.total - 1.0).abs() < 1e-6, "{own:?} {exact:?}");
        }
    }
}

#[test]
fn sample_of_an_unknown_error_states_none() {
    let mut lights = lights(None);
    lights.lights[1].variance = None;
    for bytes in [1 << 22, 100_000] {
        let sample = lights.sample(bytes);
        assert!(sample.error(&[1.0; 3]).is_none());
        assert!(sample.error(&[1.0, 0.0, 1.0]).is_some(), "the light is off");
        assert_eq!(sample.error(&[0.0; 3]).unwrap().total, 0.0);
    }
    lights.lights.iter_mut().for_each(|own| own.variance = None);
    assert!(lights.sample(100_000).error(&[1.0; 3]).is_none());
}
