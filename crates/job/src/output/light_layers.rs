//! The light of single sources in image files: as images of their own, and as layers of mixtures.

use super::recorded_error::{RecordedDenoisedError, RecordedError};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::image_io::{Image, Layer, Metadata, NOISY, Value};
use bdpm_core::settings::provenance::Provenance;
use std::collections::BTreeSet;

/// Beginning of the names of layers that have the light of a single source.
pub(super) const LIGHT: &str = "light.";

/// Layer of an image of chosen light sources with the variance of each pixel's luminance. Unlike
/// the layer `rms`, it is no mean over neighbors, so that sums with other weights are right.
pub const VARIANCE: &str = "variance";

/// Attribute of an image with the names of its only light sources.
pub const LIGHTS: &str = "lights";

/// The image of one light source, or of several that are dimmed together.
#[derive(Clone, Debug)]
pub struct LightImage {
    /// Name of the light.
    pub name: String,
    /// Radiance of each pixel, W/(m^2 sr); denoised, if the image was.
    pub(super) radiance: Vec<Rgb>,
    /// Variance of the luminance of each pixel before denoising, if it is known.
    pub(super) variance: Option<Vec<f32>>,
    pub(super) errors: LightErrors,
}

/// Errors that an image states.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LightErrors {
    /// Relative RMS of the merge bias.
    pub(super) bias: f64,
    /// Relative RMS error after denoising; `None` if the image was not denoised, and not a number
    /// if it was and the error is not known.
    pub(super) denoised: Option<f64>,
    /// Number that chose the random numbers; `None` if it is not known.
    pub(super) seed: Option<u64>,
}

/// Name of a light in names of layers, in which the last dot separates the channel.
fn layer_name(name: &str) -> String {
    name.replace('.', "_")
}

/// Largest size of the name of a light, bytes: names of channels in EXR files have up to 255.
const LONGEST_NAME: usize = 200;

/// Checks that lights can be layers of one image.
///
/// # Errors
/// If a name is too long, or two lights have one. Dots in names count as underscores.
pub fn check_names<'a>(names: impl Iterator<Item = &'a str>) -> Result<()> {
    let mut known = BTreeSet::new();
    for name in names {
        if name.len() > LONGEST_NAME {
            let problem = format!("the name of the light `{name}` is too long for a layer");
            return Err(Error::new(problem, format!("give it at most {LONGEST_NAME} bytes")));
        }
        if !known.insert(layer_name(name)) {
            let problem = format!("two images have the light `{name}`");
            return Err(Error::new(problem, "give each light a name of its own, and once"));
        }
    }
    Ok(())
}

/// The lights of an image: its layers of single lights, or itself.
pub(super) fn lights_of(name: &str, image: Image) -> Result<Vec<LightImage>> {
    let variance_of = |prefix: &str| {
        let layer = image.layer(&format!("{prefix}{VARIANCE}"))?;
        layer.channel("Y").map(<[f32]>::to_vec)
    };
    let lights: Vec<LightImage> = image
        .layers
        .iter()
        .filter_map(|layer| {
            Some(LightImage {
                name: layer.name.strip_prefix(LIGHT)?.to_owned(),
                // Layers of variances have no colors.
                radiance: layer.to_rgb()?,
                variance: variance_of(&format!("{}.", layer.name)),
                errors: LightErrors::read(&layer.name, &image.metadata),
            })
        })
        .collect();
    if !lights.is_empty() {
        return Ok(lights);
    }
    let radiance = image.layer("").and_then(Layer::to_rgb).ok_or_else(|| {
        Error::new(format!("`{name}` has no channels R, G and B"), "give an RGB image")
    })?;
    let own = match image.metadata.get(LIGHTS) {
        Some(Value::Text(lights)) => lights,
        _ => name,
    };
    let (name, variance) = (layer_name(own), variance_of(""));
    Ok(vec![LightImage { name, radiance, variance, errors: LightErrors::of(&image) }])
}

impl LightErrors {
    /// Those of an image of a render.
    fn of(image: &Image) -> Self {
        let Image { metadata, .. } = image;
        let error = RecordedError::read(metadata);
        let denoised = RecordedDenoisedError::read(metadata).map(|own| own.total);
        // An enlarged picture has no layers.
        let is_denoised =
            image.layer(NOISY).is_some() || image.layer("rms").is_none() && denoised.is_some();
        Self {
            bias: error.map_or(0.0, |own| own.bias),
            denoised: is_denoised.then(|| denoised.unwrap_or(f64::NAN)),
            seed: Provenance::from_metadata(metadata).ok().map(|own| own.settings.seed),
        }
    }

    pub(super) fn record(&self, layer: &str, metadata: &mut Metadata) {
        let mut add = |fact: &str, value| metadata.insert(format!("{layer} {fact}"), value);
        add("bias", Value::Number(self.bias));
        if let Some(error) = self.denoised {
            add("denoised error", Value::Text(error.to_string()));
        }
        if let Some(seed) = self.seed {
            add("seed", Value::Text(seed.to_string()));
        }
    }

    /// The errors that [`Self::record`] added.
    fn read(layer: &str, metadata: &Metadata) -> Self {
        let fact = |fact: &str| metadata.get(&format!("{layer} {fact}"));
        let text = |name: &str| match fact(name) {
            Some(Value::Text(text)) => Some(text),
            _ => None,
        };
        let bias = match fact("bias") {
            Some(&Value::Number(bias)) => bias,
            _ => 0.0,
        };
        let denoised = text("denoised error").and_then(|text| text.parse().ok());
        Self { bias, denoised, seed: text("seed").and_then(|text| text.parse().ok()) }
    }
}

impl LightImage {
    /// Radiance of each pixel, W/(m^2 sr).
    pub fn radiance(&self) -> &[Rgb] {
        &self.radiance
    }

    /// Whether the error of the image is known.
    pub fn has_error(&self) -> bool {
        match self.errors.denoised {
            Some(error) => error.is_finite(),
            None => self.variance.is_some(),
        }
    }

    /// Standard error of a pixel's luminance before denoising; not a number if it is not known.
    pub(super) fn rms_at(&self, pixel: usize) -> f64 {
        self.variance.as_ref().map_or(f64::NAN, |own| f64::from(own[pixel]).max(0.0).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_that_cannot_be_layers_of_one_image_are_refused() {
        assert!(check_names(["a", "b", "variance", "x.variance"].into_iter()).is_ok());
        let shown = |names: &[&str]| check_names(names.iter().copied()).unwrap_err().to_string();
        assert!(shown(&["a", "b", "a"]).contains("two images have the light `a`"));
        assert!(shown(&["a.b", "a_b"]).contains("two images have the light `a_b`"));
        assert!(shown(&["a", &"b".repeat(201)]).contains("too long"));
    }
}
