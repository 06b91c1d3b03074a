//! Mixtures of images that have the light of single sources each.
//!
//! Light adds up: an image with all lights is the sum of images with one of them each, and dimming
//! a light multiplies its image. Images of different random numbers have independent noise, so that
//! the variance of a mixture is known for any brightness: theory.md (19e).

use super::light_layers::{LIGHT, LIGHTS, LightImage, VARIANCE, check_names, lights_of};
use super::recorded_error::{RecordedDenoisedError, RecordedError};
use bdpm_auto::adaptive::stopping::without_noise;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::film::radiance::{box_filter, luminance_weights};
use bdpm_core::image_io::{DisplayWindow, Image, Layer, Metadata, Value};
use bdpm_core::settings::Crop;
use rayon::prelude::*;

/// Layers that do not depend on lights.
const CONSTANT: [&str; 5] = ["albedo", "normal", "depth", "position", "alpha"];

/// Attribute with the part of the image that is rendered.
const CROP: &str = "crop";

/// Attributes about the camera and the colors, which mixtures keep.
const KEPT: [&str; 5] =
    ["camera", "camera projection", "camera field of view", CROP, "negative values"];

/// Images of lights, of one size.
#[derive(Clone, Debug)]
pub struct LightImages {
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// The images.
    pub lights: Vec<LightImage>,
    /// Layers that do not depend on lights, of the first image that has any.
    constant: Vec<Layer>,
    /// Attributes that mixtures keep.
    metadata: Metadata,
}

/// A mixture.
#[derive(Clone, Debug)]
pub struct Mixture {
    /// Radiance of each pixel, W/(m^2 sr).
    pub radiance: Vec<Rgb>,
    /// Noise before denoising as luminance, W/(m^2 sr), pooled over 5 by 5 pixels, if it is known.
    pub rms: Option<Vec<f32>>,
    /// Error of `radiance`, if it is known.
    pub error: Option<MixtureError>,
}

/// Relative RMS error of a mixture, weighted as errors of images are.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct MixtureError {
    /// Noise and bias together.
    pub total: f64,
    /// Noise alone; of denoised lights all of their error.
    pub noise: f64,
    /// Merge bias alone. Biases of lights are taken to add up.
    pub bias: f64,
    /// Whether a light is denoised.
    pub is_denoised: bool,
}

impl LightImages {
    /// The lights of image files, each with its name, or a name for those that have none. A mixture
    /// has the lights that it was mixed from.
    ///
    /// # Errors
    /// If there are no images, their sizes differ, an image has no radiance, or two lights have one
    /// name.
    pub fn new(images: Vec<(String, Image)>) -> Result<Self> {
        let Some((_, first)) = images.first() else {
            return Err(Error::new("there is no image to mix", "give images of light sources"));
        };
        let size = (first.width, first.height);
        let is_constant = |layer: &&Layer| CONSTANT.contains(&&layer.name[..]);
        let has_constant =
            |(_, image): &&(String, Image)| image.layers.iter().any(|own| is_constant(&own));
        let constant = images.iter().find(has_constant).map(|(_, image)| &image.layers[..]);
        let constant = constant.unwrap_or_default().iter().filter(is_constant);
        let kept = first.metadata.iter().filter(|(name, _)| KEPT.contains(&&name[..]));
        let mut all = Self {
            size,
            lights: Vec::new(),
            constant: constant.cloned().collect(),
            metadata: kept.map(|(name, value)| (name.clone(), value.clone())).collect(),
        };
        for (name, image) in images {
            if (image.width, image.height) != size {
                let problem = format!(
                    "`{name}` has {}x{} pixels, and the first image {}x{}",
                    image.width, image.height, size.0, size.1
                );
                return Err(Error::new(problem, "render all lights at one size"));
            }
            if image.metadata.get(CROP) != all.metadata.get(CROP) {
                let problem = format!("`{name}` shows another part of the image than the first");
                return Err(Error::new(problem, "render all lights with one --crop"));
            }
            all.lights.extend(lights_of(&name, image)?);
        }
        check_names(all.lights.iter().map(|light| &light.name[..]))?;
        Ok(all)
    }

    /// Place of the pixels in the whole image, if they are a part of it.
    pub fn window(&self) -> Option<DisplayWindow> {
        let Some(Value::Text(text)) = self.metadata.get(CROP) else { return None };
        Crop::from_text(text).map(|Crop { origin, full }| DisplayWindow { origin, size: full })
    }

    /// The mixture in which each light has its factor of this list, for each channel.
    pub fn mixture(&self, factors: &[Rgb]) -> Mixture {
        let MixtureMap { radiance, variance, squares, is_denoised, .. } = self.map(factors);
        let (width, height) = self.size;
        let rms = variance.map(|variance| {
            let variance: Vec<[f64; 1]> = variance.into_iter().map(|own| [own]).collect();
            let pooled = box_filter(&variance, width, height);
            pooled.into_iter().map(|[own]| own.max(0.0).sqrt() as f32).collect()
        });
        let mean =
            |part: usize| squares.iter().map(|own| own[part]).sum::<f64>() / squares.len() as f64;
        Mixture { radiance, rms, error: MixtureError::of([mean(0), mean(1)], is_denoised) }
    }

    /// The pixels of a mixture, with their errors.
    pub(super) fn map(&self, factors: &[Rgb]) -> MixtureMap {
        let pixels = self.lights[0].radiance.len();
        let lights: Vec<(&LightImage, Rgb)> =
            self.lights.iter().zip(factors.iter().copied()).collect();
        let sum = |pixel: usize| -> Rgb {
            lights.iter().map(|(own, factor)| own.radiance[pixel] * *factor).sum()
        };
        let radiance: Vec<Rgb> = (0..pixels).into_par_iter().map(sum).collect();
        let shining: Vec<Shining> = lights
            .iter()
            .filter(|(_, factor)| factor.abs().max_element() > 0.0)
            .map(|(own, factor)| Shining::new(own, f64::from(factor.abs().max_element())))
            .collect();
        let noise = |pixel: usize| variance(shining.iter().map(|own| own.noise_at(pixel)));
        let is_known = shining.iter().all(|own| own.light.variance.is_some());
        let variance: Option<Vec<f64>> =
            is_known.then(|| (0..pixels).into_par_iter().map(noise).collect());
        let mut clean = luminances(&radiance);
        if let Some(variance) = &variance {
            clean = without_noise(&clean, variance, None, self.size);
        }
        let squares = squares(&shining, &luminance_weights(&clean));
        let is_denoised = shining.iter().any(|own| own.light.errors.denoised.is_some());
        MixtureMap { radiance, variance, clean, squares, is_denoised }
    }

    /// The file of a mixture, with the lights as layers that add up to the image.
    pub fn image(&self, factors: &[Rgb], mixture: &Mixture) -> Image {
        let (width, height) = self.size;
        let mut layers = vec![Layer::rgb("", &mixture.radiance)];
        let single =
            |name: String, values: Vec<f32>| Layer { name, channels: vec![("Y".into(), values)] };
        layers.extend(mixture.rms.iter().map(|rms| single("rms".into(), rms.clone())));
        let mut metadata = self.metadata.clone();
        for (light, factor) in self.lights.iter().zip(factors) {
            let name = format!("{LIGHT}{}", light.name);
            let scaled: Vec<Rgb> = light.radiance.iter().map(|own| *own * *factor).collect();
            layers.push(Layer::rgb(&name, &scaled));
            let factor = factor.abs().max_element();
            if let Some(variance) = &light.variance {
                let scaled = variance.iter().map(|own| factor * factor * own).collect();
                layers.push(single(format!("{name}.{VARIANCE}"), scaled));
            }
            light.errors.record(&name, &mut metadata);
        }
        layers.extend(self.constant.iter().cloned());
        let names: Vec<&str> = self.lights.iter().map(|own| &own.name[..]).collect();
        metadata.insert(LIGHTS.into(), Value::Text(names.join(", ")));
        let version = env!("CARGO_PKG_VERSION");
        metadata.insert("version".into(), Value::Text(version.into()));
        match mixture.error {
            Some(MixtureError { total, is_denoised: true, .. }) => {
                RecordedDenoisedError { total, interval: None }.record(&mut metadata);
            }
            Some(MixtureError { total, noise, bias, .. }) => {
                RecordedError { total, noise, bias, interval: None }.record(&mut metadata);
            }
            None => {}
        }
        Image { width, height, layers, metadata }
    }
}

/// The pixels of a mixture, with their errors.
pub(super) struct MixtureMap {
    /// Radiance, W/(m^2 sr).
    radiance: Vec<Rgb>,
    /// Variance of the luminance before denoising, if it is known.
    variance: Option<Vec<f64>>,
    /// Luminance without noise, from which the weights follow.
    pub(super) clean: Vec<f64>,
    /// Squared relative errors of noise and of bias.
    pub(super) squares: Vec<[f64; 2]>,
    is_denoised: bool,
}

/// A light of a mixture that is on.
struct Shining<'a> {
    light: &'a LightImage,
    /// Factor of its errors: the largest of all channels.
    factor: f64,
    /// Error of each pixel that is a relative error of 1: the root of the reciprocal weight.
    units: Vec<f64>,
}

impl<'a> Shining<'a> {
    fn new(light: &'a LightImage, factor: f64) -> Self {
        let weights = luminance_weights(&luminances(&light.radiance));
        let units = weights.into_iter().map(|weight| weight.sqrt().recip()).collect();
        Self { light, factor, units }
    }

    /// Seed, and noise of a pixel before denoising.
    fn noise_at(&self, pixel: usize) -> SeededError {
        (self.light.errors.seed, self.factor * self.light.rms_at(pixel))
    }
}

/// An error of a pixel, and the number that chose its random numbers, if that is known.
pub(super) type SeededError = (Option<u64>, f64);

/// Variance of the sum of errors. Errors from the same random numbers may be those of the same
/// paths, and are taken to add up. theory.md (19e)
pub(super) fn variance(errors: impl Iterator<Item = SeededError>) -> f64 {
    let mut sums: Vec<SeededError> = Vec::new();
    for (seed, error) in errors {
        match sums.iter_mut().find(|(other, _)| *other == seed) {
            Some((_, sum)) => *sum += error,
            None => sums.push((seed, error)),
        }
    }
    sums.into_iter().map(|(_, sum)| sum * sum).sum()
}

/// Squared relative errors of noise and of bias of each pixel of a sum of lights that has these
/// weights of squared errors. Errors that are not known are not numbers.
fn squares(lights: &[Shining], weights: &[f64]) -> Vec<[f64; 2]> {
    let at = |pixel: usize| -> [f64; 2] {
        let noise = variance(lights.iter().map(|own| match own.light.errors.denoised {
            Some(error) => (own.light.errors.seed, own.factor * (error * own.units[pixel])),
            None => own.noise_at(pixel),
        }));
        let biased = lights.iter().filter(|own| own.light.errors.denoised.is_none());
        let bias = |own: &Shining| own.factor * own.light.errors.bias * own.units[pixel];
        let bias: f64 = biased.map(bias).sum();
        [noise, bias * bias].map(|square| square * weights[pixel])
    };
    (0..weights.len()).into_par_iter().map(at).collect()
}

impl MixtureError {
    /// The error with these squares of noise and bias; `None` if they are not known.
    pub(super) fn of([noise2, bias2]: [f64; 2], is_denoised: bool) -> Option<Self> {
        (noise2 + bias2).is_finite().then(|| Self {
            total: (noise2 + bias2).sqrt(),
            noise: noise2.sqrt(),
            bias: bias2.sqrt(),
            is_denoised,
        })
    }
}

fn luminances(radiance: &[Rgb]) -> Vec<f64> {
    radiance.par_iter().map(|own| f64::from(luminance(*own))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::base::rng::{Rng, Stream, StreamKey};

    const SIZE: (u32, u32) = (40, 30);
    const PIXELS: usize = 1200;

    fn normal(rng: &mut Rng) -> f32 {
        (0..12).map(|_| rng.next_1d()).sum::<f32>() - 6.0
    }

    /// The image of a light of this radiance with noise, as a render would write it.
    fn image(name: &str, (mean, noise): (f32, f32), seed: u64) -> Image {
        let mut rng = StreamKey::new(seed, Stream::Test, 0).rng(0);
        let pixels: Vec<Rgb> =
            (0..PIXELS).map(|_| Rgb::splat(mean + noise * normal(&mut rng))).collect();
        let values = vec![noise * noise; PIXELS];
        let variance = Layer { name: VARIANCE.into(), channels: vec![("Y".into(), values)] };
        let mut metadata = Metadata::from([(LIGHTS.into(), Value::Text(name.into()))]);
        let own = f64::from(noise / mean);
        RecordedError { total: own, noise: own, bias: 0.0, interval: None }.record(&mut metadata);
        let layers = vec![Layer::rgb("", &pixels), variance];
        Image { width: SIZE.0, height: SIZE.1, layers, metadata }
    }

    fn of_seeds(lights: [(&str, (f32, f32), u64); 2]) -> LightImages {
        let images = lights.map(|(name, light, seed)| (name.to_owned(), image(name, light, seed)));
        let mut all = LightImages::new(images.into()).unwrap();
        for (light, (_, _, seed)) in all.lights.iter_mut().zip(lights) {
            light.errors.seed = Some(seed);
        }
        all
    }

    /// Squared errors of mixtures agree with what is stated: twice the variance of a square, over
    /// all pixels and runs.
    #[test]
    fn errors_of_mixtures_are_those_stated() {
        for factors in [[1.0, 1.0], [0.3, 2.0], [0.0, 1.0]] {
            let (mut squares, mut stated, runs) = (0.0, 0.0, 20);
            for run in 0..runs {
                let (key, fill) = ((1.0, 0.1), (0.5, 0.05));
                let all = of_seeds([("key", key, 1 + run), ("fill", fill, 1001 + run)]);
                let mixture = all.mixture(&factors.map(Rgb::splat));
                let truth = factors[0] * 1.0 + factors[1] * 0.5;
                let error = mixture.error.unwrap();
                stated += error.total.powi(2);
                let weight = 1.0 / (1.01 * f64::from(truth).powi(2));
                let square = |own: &Rgb| f64::from(own.x - truth).powi(2) * weight;
                squares += mixture.radiance.iter().map(square).sum::<f64>() / PIXELS as f64;
                assert_eq!(error.bias, 0.0);
                let rms = mixture.rms.unwrap()[7];
                let expected = (0.1 * factors[0]).hypot(0.05 * factors[1]);
                assert!((rms - expected).abs() < 1e-6, "{rms}");
            }
            let ratio = squares / stated;
            // Pixels that noise makes dark have the weights of their neighborhoods, and bright ones
            // their own, which are too small: by .07 at most.
            let error = (2.0 / (PIXELS as f64 * runs as f64)).sqrt();
            assert!((ratio - 1.03).abs() < 4.0 * error + 0.04, "{factors:?}: {ratio}");
        }
    }

    /// Errors of the same random numbers may be those of the same paths, and add up.
    #[test]
    fn errors_of_one_seed_add_up() {
        let lights = |seed| of_seeds([("key", (1.0, 0.1), 3), ("fill", (1.0, 0.1), seed)]);
        let rms = |seed| lights(seed).mixture(&[Rgb::ONE; 2]).rms.unwrap()[0];
        assert!((rms(3) - 0.2).abs() < 1e-6 && (rms(4) - 0.1 * 2f32.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn files_of_mixtures_have_their_lights() {
        let all = of_seeds([("key", (1.0, 0.1), 3), ("fill.2", (0.5, 0.2), 4)]);
        let factors = [Rgb::new(0.5, 1.0, 2.0), Rgb::ONE];
        let mixture = all.mixture(&factors);
        let file = all.image(&factors, &mixture);
        let again = LightImages::new(vec![("file".into(), file)]).unwrap();
        let names: Vec<&str> = again.lights.iter().map(|own| &own.name[..]).collect();
        assert_eq!(names, ["key", "fill_2"]);
        let same = again.mixture(&[Rgb::ONE; 2]);
        assert_eq!(same.radiance, mixture.radiance);
        assert_eq!(same.rms, mixture.rms);
        assert!(again.lights.iter().all(LightImage::has_error));
        let off = again.mixture(&[Rgb::ZERO, Rgb::ONE]);
        assert_eq!(off.radiance, all.lights[1].radiance);
        let twice = all.lights.iter().chain(&all.lights);
        let images = twice.map(|own| (own.name.clone(), image(&own.name, (1.0, 0.1), 1)));
        let shown = LightImages::new(images.collect()).unwrap_err().to_string();
        assert!(shown.contains("two images have the light `key`"), "{shown}");
    }

    /// Names may end as those of layers do.
    #[test]
    fn lights_of_any_name_are_found_in_mixtures() {
        let all = of_seeds([("variance", (1.0, 0.1), 3), ("x.variance", (0.5, 0.2), 4)]);
        let factors = [Rgb::ONE; 2];
        let file = all.image(&factors, &all.mixture(&factors));
        let again = LightImages::new(vec![("file".into(), file)]).unwrap();
        assert_eq!(again.lights.len(), 2);
        assert!(again.lights.iter().all(|own| own.variance.is_some()));
    }

    #[test]
    fn mixtures_of_a_part_of_the_image_know_their_place() {
        let part = |text: &str| {
            let mut image = image(text, (1.0, 0.1), 1);
            image.metadata.insert(CROP.into(), Value::Text(text.into()));
            (text.to_owned(), image)
        };
        let one = "at 3,4 of 80x60";
        let all = LightImages::new(vec![part(one)]).unwrap();
        let window = DisplayWindow { origin: [3, 4], size: [80, 60] };
        assert_eq!(all.window(), Some(window));
        let file = all.image(&[Rgb::ONE], &all.mixture(&[Rgb::ONE]));
        let again = LightImages::new(vec![("file".into(), file)]).unwrap();
        assert_eq!(again.window(), Some(window));
        let other = LightImages::new(vec![part(one), part("at 0,4 of 80x60")]);
        assert!(other.unwrap_err().to_string().contains("another part of the image"));
    }

    #[test]
    fn denoised_lights_have_the_error_of_the_denoiser_or_none() {
        let mut all = of_seeds([("key", (1.0, 0.1), 3), ("fill", (1.0, 0.1), 4)]);
        all.lights[0].errors.denoised = Some(0.05);
        let error = all.mixture(&[Rgb::ONE, Rgb::ZERO]).error.unwrap();
        assert!(error.is_denoised && (error.total - 0.05).abs() < 3e-3, "{error:?}");
        all.lights[0].errors.denoised = Some(f64::NAN);
        assert!(!all.lights[0].has_error() && all.lights[1].has_error());
        assert!(all.mixture(&[Rgb::ONE; 2]).error.is_none());
        assert!(all.mixture(&[Rgb::ZERO, Rgb::ONE]).error.is_some(), "the light is off");
    }
}
