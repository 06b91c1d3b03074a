//! A [`NoiseImage`] as an EXR file with layers, so that noise can be predicted without rendering.
//!
//! | layer | channels | content |
//! |---|---|---|
//! | (default) | `R`, `G`, `B` | the image, W/(m^2 sr) |
//! | `L` | `Y` | luminance of the image |
//! | `C2`, `B`, `F` | `Y` | the paper's averages, `a + b + f + L^2`, `b + L^2`, `f + L^2` |
//! | `a`, `b`, `f` | `Y` | the coefficients |
//! | `V` | `predicted`, `sampled` | variance of one iteration by (1), and sampled |
//! | `bias` | `Y`, `error` | merge bias and standard error |
//! | `nested` | `first`, `second`, `error` | `L(r) - L(r/sqrt 2)`, its standard error, and `L(r/sqrt 2) - L(r/2)` |
//! | `batch00` to `batch15` | `a`, `b`, `f`, `V`, `first`, `second` | means over the batch's iterations |
//!
//! The attribute `bdpm.batches` holds the numbers of iterations of the batches, `n0 n1 ... n15`,
//! and then the batch of the first iteration. Without it iterations were assigned in turn,
//! beginning with batch 0.

use super::film::{BATCHES, BatchCounts, NoiseFilm};
use super::image::{NoiseImage, NoiseSample, PixelEstimate};
use super::region::{rectangles_from_text, rectangles_to_text};
use super::{Coefficients, Measure};
use crate::film::counts::Counts;
use crate::film::radiance::Film;
use crate::settings::Region;
use crate::settings::provenance::Provenance;
use bdpm_base::error::{Error, Result};
use bdpm_base::math::Rgb;
use bdpm_base::memory::{GIB, available_memory};
use bdpm_image::{Image, Layer, Metadata, Value};
use std::path::Path;

/// Attribute with the mean number of photons per light path.
pub const PHOTONS_PER_LIGHT_PATH: &str = "photons_per_light_path";

/// Attribute with the numbers of iterations of the batches.
const BATCH_COUNTS: &str = "batches";

/// Channels of the layers of batches, in the order of [`NoiseSample::to_array`].
const BATCH_CHANNELS: [&str; 6] = ["a", "b", "f", "V", "first", "second"];

/// Prefix of the names of regions in the metadata.
const REGION: &str = "region.";

/// The result of a noise measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseFile {
    /// The measured noise.
    pub noise: NoiseImage,
    /// The image itself, row by row.
    pub pixels: Vec<Rgb>,
    /// The scene's named regions.
    pub regions: Vec<Region>,
    /// Scene and settings of the measurement; counts and iterations are added when it is written.
    pub facts: Metadata,
}

impl NoiseFile {
    /// The `noise` that `estimator` measured while `film` was rendered, with the scene and settings
    /// that reproduce it.
    pub fn new(
        (provenance, regions): (&Provenance, &[Region]),
        film: &Film,
        noise: NoiseImage,
        estimator: Measure,
    ) -> Self {
        let mut facts = provenance.to_metadata();
        facts.insert("iterations".into(), Value::Number(film.iterations as f64));
        let estimator = serde_json::to_value(estimator).expect("a plain name");
        let estimator = estimator.as_str().unwrap_or_default().to_owned();
        facts.insert("estimator".into(), Value::Text(estimator));
        Self { noise, pixels: film.mean(), regions: regions.to_vec(), facts }
    }

    /// Metadata of an image with the scene and settings of the measurement, but with these counts.
    pub fn facts_with(&self, counts: &Counts) -> Metadata {
        let camera_paths = counts.camera_paths.mean().round();
        let mut facts = self.facts.clone();
        facts.insert("light_paths".into(), Value::Number(counts.light_paths.into()));
        facts.insert("camera_paths".into(), Value::Number(camera_paths));
        facts
    }

    /// Writes all layers and metadata.
    ///
    /// # Errors
    /// If the file cannot be written; names it.
    pub fn write(&self, path: &Path) -> Result<()> {
        bdpm_image::write_exr(path, &self.to_image())
    }

    /// Reads a file that [`Self::write`] wrote.
    ///
    /// # Errors
    /// If the file cannot be read or is another EXR file; names it.
    pub fn read(path: &Path) -> Result<Self> {
        Self::from_image(bdpm_image::read_exr(path)?).map_err(|e| e.at(path))
    }

    /// Converts to layers and metadata.
    pub fn to_image(&self) -> Image {
        let Self { noise, pixels, regions, facts } = self;
        let counts = (f64::from(noise.light_paths), f64::from(noise.camera_paths));
        let values = |of: &dyn Fn(&PixelEstimate) -> f64| -> Vec<f32> {
            noise.pixels.iter().map(|pixel| of(pixel) as f32).collect()
        };
        let all = noise.bias();
        let bias = |of: usize| all.iter().map(|bias| bias[of] as f32).collect::<Vec<_>>();
        let layer = |name: &str, channels: Vec<(&str, Vec<f32>)>| Layer {
            name: name.into(),
            channels: channels.into_iter().map(|(n, v)| (n.to_owned(), v)).collect(),
        };
        let one = |name: &str, of: &dyn Fn(&PixelEstimate, Coefficients, f64) -> f64| {
            let of =
                |p: &PixelEstimate| of(p, p.noise.coefficients, p.luminance2(noise.iterations));
            layer(name, vec![("Y", values(&of))])
        };
        let mut layers = vec![
            Layer::rgb("", pixels),
            one("L", &|p, _, _| p.luminance),
            one("C2", &|_, c, l2| c.a + c.b + c.f + l2),
            one("B", &|_, c, l2| c.b + l2),
            one("F", &|_, c, l2| c.f + l2),
            one("a", &|_, c, _| c.a),
            one("b", &|_, c, _| c.b),
            one("f", &|_, c, _| c.f),
            layer(
                "V",
                vec![
                    ("predicted", values(&|p| p.noise.coefficients.variance(counts.0, counts.1))),
                    ("sampled", values(&|p| p.noise.sampled)),
                ],
            ),
            layer(
                "nested",
                vec![
                    ("first", values(&|p| p.noise.nested[0])),
                    ("second", values(&|p| p.noise.nested[1])),
                    ("error", values(&|p| p.nested_error)),
                ],
            ),
            layer("bias", vec![("Y", bias(0)), ("error", bias(1))]),
        ];
        layers.extend((0..BATCHES).map(|batch| batch_layer(noise, batch)));
        let mut metadata = facts.clone();
        metadata.extend([
            ("light_paths".into(), Value::Number(counts.0)),
            ("camera_paths".into(), Value::Number(counts.1)),
            ("iterations".into(), Value::Number(noise.iterations as f64)),
            (BATCH_COUNTS.into(), Value::Text(counts_to_text(&noise.counts))),
        ]);
        for Region { name, rectangles } in regions {
            let text = rectangles_to_text(rectangles);
            metadata.insert(format!("{REGION}{name}"), Value::Text(text));
        }
        Image { width: noise.width, height: noise.height, layers, metadata }
    }

    /// Converts from layers and metadata.
    ///
    /// # Errors
    /// If a layer or attribute is missing.
    pub fn from_image(image: Image) -> Result<Self> {
        let channel = |layer: &str, name: &str| channel(&image, layer, name);
        let count = |name: &str, least: f64, most: f64| match image.metadata.get(name) {
            Some(&Value::Number(n)) if n >= least && n <= most && n.fract() == 0.0 => Ok(n),
            _ => Err(missing(&format!("valid attribute bdpm.{name}"))),
        };
        let light_paths = count("light_paths", 2.0, f64::from(u32::MAX))? as u32;
        let camera_paths = count("camera_paths", 2.0, f64::from(u32::MAX))? as u32;
        let iterations = count("iterations", 2.0, (1u64 << 53) as f64)? as u64;
        let [a, b, f] = [channel("a", "Y")?, channel("b", "Y")?, channel("f", "Y")?];
        let (luminance, sampled) = (channel("L", "Y")?, channel("V", "sampled")?);
        let [first, second] = [channel("nested", "first")?, channel("nested", "second")?];
        let nested_error = channel("nested", "error")?;
        let sample = |channels: &[&[f32]; 6], i: usize| {
            NoiseSample::from_array(channels.map(|list| f64::from(list[i])))
        };
        let all = [a, b, f, sampled, first, second];
        let estimate = |i: usize| PixelEstimate {
            luminance: f64::from(luminance[i]),
            noise: sample(&all, i),
            nested_error: f64::from(nested_error[i]),
        };
        let pixels: Vec<_> = (0..luminance.len()).map(estimate).collect();
        let mut batches = vec![[NoiseSample::default(); BATCHES]; pixels.len()];
        for batch in 0..BATCHES {
            let name = batch_name(batch);
            let channels = BATCH_CHANNELS.map(|of| channel(&name, of));
            let channels: Vec<&[f32]> = channels.into_iter().collect::<Result<_>>()?;
            let channels = channels.try_into().expect("as many channels as names");
            for (i, pixel) in batches.iter_mut().enumerate() {
                pixel[batch] = sample(&channels, i);
            }
        }
        let (mut facts, regions) = facts_and_regions(&image.metadata)?;
        let counts = match image.metadata.get(BATCH_COUNTS) {
            None => Some(BatchCounts::of(iterations)),
            Some(Value::Text(text)) => counts_from_text(text, iterations),
            Some(_) => None,
        };
        let counts =
            counts.ok_or_else(|| missing(&format!("valid attribute bdpm.{BATCH_COUNTS}")))?;
        for key in ["light_paths", "camera_paths", "iterations", BATCH_COUNTS] {
            facts.remove(key);
        }
        let rgb = image.raw().and_then(Layer::to_rgb);
        let rgb = rgb.ok_or_else(|| missing("channels R, G and B"))?;
        let Image { width, height, .. } = image;
        let noise = NoiseImage {
            width,
            height,
            light_paths,
            camera_paths,
            iterations,
            pixels,
            batches,
            counts,
        };
        Ok(Self { noise, pixels: rgb, regions, facts })
    }
}

/// The error for an image without a layer or attribute.
fn missing(what: &str) -> Error {
    Error::new(
        format!("this image has no measured noise: {what} is missing"),
        "give the .exr file that `bdpm analyze` wrote",
    )
}

/// The values of a channel.
fn channel<'a>(image: &'a Image, layer: &str, name: &str) -> Result<&'a [f32]> {
    let values = image.layer(layer).and_then(|layer| layer.channel(name));
    values.ok_or_else(|| missing(&format!("channel {layer}.{name}")))
}

/// The channels of a batch.
fn batch_layer(noise: &NoiseImage, batch: usize) -> Layer {
    let channel = |(index, name): (usize, &str)| {
        let value = |batches: &[NoiseSample; BATCHES]| batches[batch].to_array()[index] as f32;
        (name.to_owned(), noise.batches.iter().map(value).collect())
    };
    let channels = BATCH_CHANNELS.into_iter().enumerate().map(channel).collect();
    Layer { name: batch_name(batch), channels }
}

/// The metadata without the regions, and the regions.
fn facts_and_regions(metadata: &Metadata) -> Result<(Metadata, Vec<Region>)> {
    let (mut facts, mut regions) = (metadata.clone(), Vec::new());
    for (key, value) in metadata {
        if let (Some(name), Value::Text(text)) = (key.strip_prefix(REGION), value) {
            let rectangles = rectangles_from_text(text)?;
            regions.push(Region { name: name.into(), rectangles });
            facts.remove(key);
        }
    }
    Ok((facts, regions))
}

fn counts_to_text(counts: &BatchCounts) -> String {
    let all = counts.iterations.iter().copied().chain([u64::from(counts.first)]);
    all.map(|n| n.to_string()).collect::<Vec<_>>().join(" ")
}

/// Reads the text of [`counts_to_text`], for `iterations` iterations in total.
fn counts_from_text(text: &str, iterations: u64) -> Option<BatchCounts> {
    let numbers: Vec<u64> = text.split(' ').map(|n| n.parse().ok()).collect::<Option<_>>()?;
    let (first, counts) = numbers.split_last()?;
    let counts =
        BatchCounts { iterations: counts.try_into().ok()?, first: (*first).try_into().ok()? };
    let sum = counts.iterations.iter().try_fold(0u64, |sum, n| sum.checked_add(*n))?;
    (sum == iterations && counts.is_consistent()).then_some(counts)
}

fn batch_name(batch: usize) -> String {
    format!("batch{batch:02}")
}

/// Peak memory of measuring, evaluating and writing the noise, bytes per pixel: the sums, the
/// [`NoiseImage`], and all channels twice while they are compressed.
pub const fn bytes_per_pixel() -> usize {
    let image = size_of::<PixelEstimate>() + BATCHES * size_of::<NoiseSample>();
    let channels = 3 + 7 + 2 + 2 + 5 * BATCHES;
    NoiseFilm::BYTES_OF_PIXEL + image + 2 * channels * size_of::<f32>()
}

/// Refuses a resolution whose noise does not fit in the memory that is available.
///
/// # Errors
/// Names the memory needed and available, GiB.
pub fn check_memory(width: u32, height: u32) -> Result<()> {
    let needed = bytes_per_pixel() as f64 * f64::from(width) * f64::from(height);
    match available_memory() {
        Some(available) if needed > available => Err(Error::new(
            format!(
                "measuring the noise of {width}x{height} pixels takes about {:.1} GiB of memory, \
                 but {:.1} GiB are available",
                needed / GIB,
                available / GIB
            ),
            "lower the resolution: coefficients hardly depend on it",
        )),
        _ => Ok(()),
    }
}
