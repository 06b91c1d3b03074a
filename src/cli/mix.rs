//! `bdpm mix IMAGE...`: images of single light sources, each as bright as wanted.

use super::image_file_args::{ImageFileArgs, image_name};
use super::luminance_files::{luminance_layer, record_efficacy, write_luminance};
use super::outputs::{self, Attempts, Output};
use super::{preview, reported};
use bdpm::base::error::{Error, Result};
use bdpm::base::math::{Rgb, luminance};
use bdpm::image_io::{self, ExrFormat};
use bdpm::load::matches;
use bdpm::output::light_layers::LightImage;
use bdpm::output::light_mix::{LightImages, Mixture, MixtureError};
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Mix these images of `render --lights`, or the image of `render --light-groups`
    #[arg(value_name = "IMAGE", required = true)]
    images: Vec<PathBuf>,
    /// Multiply a light by a number, or by R,G,B; * in its name stands for any characters
    #[arg(long, value_name = "LIGHT=FACTOR", value_parser = factor)]
    set: Vec<(String, Rgb)>,
    /// Write the mixture to this file, and a PNG preview beside it
    #[arg(long, short, value_name = "OUT.exr", value_parser = image_name)]
    output: PathBuf,
    #[command(flatten)]
    files: ImageFileArgs,
    /// Show only errors
    #[arg(long, short)]
    quiet: bool,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// A light of a mixture.
#[derive(Serialize)]
pub struct MixedLight {
    name: String,
    factor: [f32; 3],
    /// Whether the error of its image is known.
    has_error: bool,
}

/// The result.
#[derive(Serialize)]
pub struct MixReport {
    exr: String,
    png: String,
    lights: Vec<MixedLight>,
    /// W/(m^2 sr).
    mean_luminance: f64,
    /// Relative error, if it is known.
    error: Option<MixtureError>,
}

/// Reads a light with its factor, such as `lamp=.3` or `sky=1,.9,.8`.
fn factor(text: &str) -> Result<(String, Rgb)> {
    let wrong = || {
        let advice = "give a light and a factor, such as lamp=0.3 or lamp=1,0.8,0.6";
        Error::new(format!("`{text}` is not a factor of a light"), advice)
    };
    let (name, factor) = text.rsplit_once('=').ok_or_else(wrong)?;
    let channels = factor.split(',').map(|number| number.trim().parse::<f32>().ok());
    let channels = channels.collect::<Option<Vec<f32>>>().ok_or_else(wrong)?;
    let factor = match channels[..] {
        [all] => Rgb::splat(all),
        [r, g, b] => Rgb::new(r, g, b),
        _ => return Err(wrong()),
    };
    let is_brightness = factor.is_finite() && factor.min_element() >= 0.0;
    if name.is_empty() || !is_brightness { Err(wrong()) } else { Ok((name.to_owned(), factor)) }
}

pub fn run(args: &Args) -> Result<String> {
    let beside = preview::beside(&args.output);
    let false_color = args.files.false_color(&args.output);
    let files = |png| {
        let mut all = vec![
            Output::new("--output", &args.output, Some("exr")),
            Output::new("the preview of --output", png, Some("png")),
        ];
        let path = false_color.as_deref();
        all.extend(path.map(|path| Output::new("the file of --photometric", path, None)));
        all
    };
    outputs::check(&files(&beside))?;
    let read = |path: &PathBuf| Ok((light_name(path), image_io::read_exr(path)?));
    let images = args.images.iter().map(read).collect::<Result<Vec<_>>>()?;
    let png = preview::aside(&beside)?;
    outputs::spare_inputs(&files(&png))?;
    let lights = LightImages::new(images)?;
    let report = write(&lights, &args.set, (&args.output, &png), &args.files)?;
    Ok(reported((args.json, args.quiet), &report, || report.text()))
}

/// Name of the light of a file that states none.
fn light_name(path: &Path) -> String {
    path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Mixes lights, those that are not `set` as they are, and writes the files.
pub fn write(
    lights: &LightImages,
    set: &[(String, Rgb)],
    (exr, png): (&Path, &Path),
    files: &ImageFileArgs,
) -> Result<MixReport> {
    let mut factors = vec![Rgb::ONE; lights.lights.len()];
    for (pattern, factor) in set {
        let mut is_known = false;
        for (light, own) in lights.lights.iter().zip(&mut factors) {
            if matches(pattern, &light.name) {
                (*own, is_known) = (*factor, true);
            }
        }
        if !is_known {
            let names: Vec<&str> = lights.lights.iter().map(|light| &light.name[..]).collect();
            let problem = format!("no image has the light `{pattern}`");
            return Err(Error::new(problem, format!("set one of: {}", names.join(", "))));
        }
    }
    let mixture = lights.mixture(&factors);
    let mut image = lights.image(&factors, &mixture);
    let false_color = files.false_color(exr);
    if false_color.is_some() {
        image.layers.push(luminance_layer(&mixture.radiance));
        record_efficacy(&mut image.metadata);
    }
    let mut attempts = Attempts::default();
    let format = ExrFormat { window: lights.window(), ..files.exr_format() };
    attempts.add(exr, || image_io::write_exr_as(exr, &image, format));
    attempts.add(png, || {
        image_io::write_png_as(png, lights.size, &mixture.radiance, files.tone_mapping())
    });
    if let Some(path) = &false_color {
        attempts.add(path, || write_luminance(path, lights.size, &mixture.radiance));
    }
    attempts.finish()?;
    Ok(MixReport::new(lights, &factors, &mixture, (exr, png)))
}

impl MixReport {
    fn new(
        lights: &LightImages,
        factors: &[Rgb],
        mixture: &Mixture,
        (exr, png): (&Path, &Path),
    ) -> Self {
        let name = |path: &Path| path.to_string_lossy().into_owned();
        let light = |(light, factor): (&LightImage, &Rgb)| MixedLight {
            name: light.name.clone(),
            factor: factor.to_array(),
            has_error: light.has_error(),
        };
        let sum: f64 = mixture.radiance.iter().map(|own| f64::from(luminance(*own))).sum();
        Self {
            exr: name(exr),
            png: name(png),
            lights: lights.lights.iter().zip(factors).map(light).collect(),
            mean_luminance: sum / mixture.radiance.len() as f64,
            error: mixture.error,
        }
    }

    pub fn text(&self) -> String {
        let light = |own: &MixedLight| match own.factor {
            [r, g, b] if r == g && g == b => format!("{} {r}", own.name),
            [r, g, b] => format!("{} {r},{g},{b}", own.name),
        };
        let lights: Vec<String> = self.lights.iter().map(light).collect();
        let error = match self.error {
            Some(MixtureError { total, is_denoised: true, .. }) => {
                format!("denoised: relative error {:.2} %", 100.0 * total)
            }
            Some(MixtureError { total, noise, bias, .. }) => format!(
                "relative error {:.2} %: noise {:.2} %, bias {:.2} %",
                100.0 * total,
                100.0 * noise,
                100.0 * bias
            ),
            None => {
                let unknown = self.lights.iter().filter(|own| !own.has_error);
                let names: Vec<&str> = unknown.map(|own| &own.name[..]).collect();
                format!("the error is not known: no image states that of {}", names.join(", "))
            }
        };
        format!(
            "{} and {}: {}; mean luminance {:.4}\n{error}\n",
            self.exr,
            self.png,
            lights.join(", "),
            self.mean_luminance
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_numbers_or_colors_of_at_least_zero() {
        assert_eq!(factor("a lamp=.5").unwrap(), ("a lamp".into(), Rgb::splat(0.5)));
        assert_eq!(factor("a=b=1, 0.5,0").unwrap(), ("a=b".into(), Rgb::new(1.0, 0.5, 0.0)));
        for text in ["lamp", "=1", "lamp=", "lamp=-1", "lamp=1,2", "lamp=nan", "lamp=inf"] {
            assert!(factor(text).unwrap_err().to_string().contains(text), "{text}");
        }
    }
}
