//! `bdpm mix IMAGE...`: images of single light sources, each as bright as wanted.

use super::image_file_args::{ImageFileArgs, image_name};
use super::luminance_files::{luminance_layer, record_efficacy, write_luminance};
use super::outputs::{self, Attempts, Output};
use super::{mix_page, preview, reported};
use bdpm::base::atomic::write_atomically;
use bdpm::base::error::{Error, Result};
use bdpm::base::math::{Rgb, luminance};
use bdpm::image_io::{self, ExrFormat};
use bdpm::load::matches;
use bdpm::output::light_layers::LightImage;
use bdpm::output::light_mix::{LightImages, Mixture, MixtureError};
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
#[command(mut_arg("exr_compression", |arg| arg.requires("output")))]
#[command(mut_arg("half", |arg| arg.requires("output")))]
#[command(mut_arg("photometric", |arg| arg.requires("output")))]
pub struct Args {
    /// Mix these images of `render --lights`, or the image of `render --light-groups`
    #[arg(value_name = "IMAGE", required = true)]
    images: Vec<PathBuf>,
    /// Multiply a light by a number, or by R,G,B; * in its name stands for any characters
    #[arg(long, value_name = "LIGHT=FACTOR", value_parser = factor)]
    set: Vec<(String, Rgb)>,
    /// Write the mixture to this file, and a PNG preview beside it
    #[arg(long, short, value_name = "OUT.exr", value_parser = image_name)]
    #[arg(required_unless_present = "report")]
    output: Option<PathBuf>,
    /// Write a page with a slider for each light, which shows mixtures and errors
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
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
    exr: Option<String>,
    png: Option<String>,
    /// The page with sliders.
    report: Option<String>,
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
    let (exr, report) = (args.output.as_deref(), args.report.as_deref());
    let beside = exr.map(preview::beside);
    let false_color = exr.and_then(|exr| args.files.false_color(exr));
    outputs::check(&args.outputs(beside.as_deref(), false_color.as_deref()))?;
    let read = |path: &PathBuf| Ok((light_name(path), image_io::read_exr(path)?));
    let images = args.images.iter().map(read).collect::<Result<Vec<_>>>()?;
    let png = beside.as_deref().map(preview::aside).transpose()?;
    outputs::spare_inputs(&args.outputs(png.as_deref(), false_color.as_deref()))?;
    let lights = LightImages::new(images)?;
    let mixed = Mixed::new(&lights, &args.set)?;
    let html = report.map(|_| mix_page::html(&mixed, &args.images, args.files.tone_mapping()));
    let html = html.transpose()?;
    let image = exr.zip(png.as_deref());
    let mut attempts = Attempts::default();
    if let Some(paths) = image {
        mixed.write(paths, &args.files, &mut attempts);
    }
    if let Some((path, html)) = report.zip(html) {
        let save = || write_atomically(path, |file| file.write_all(html.as_bytes()));
        attempts.add(path, save);
    }
    attempts.finish()?;
    let report = mixed.report(image, report);
    Ok(reported((args.json, args.quiet), &report, || report.text()))
}

impl Args {
    /// The files to write.
    fn outputs<'a>(
        &'a self,
        png: Option<&'a Path>,
        false_color: Option<&'a Path>,
    ) -> Vec<Output<'a>> {
        let all = [
            ("--output", self.output.as_deref(), Some("exr")),
            ("the preview of --output", png, Some("png")),
            ("the file of --photometric", false_color, None),
            ("--report", self.report.as_deref(), Some("html")),
        ];
        let output = |(what, path, extension): (_, Option<&'a Path>, _)| {
            path.map(|path| Output::new(what, path, extension))
        };
        all.into_iter().filter_map(output).collect()
    }
}

/// Name of the light of a file that states none.
fn light_name(path: &Path) -> String {
    path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Mixes lights, those that are not `set` as they are, and writes the files.
pub fn write(
    lights: &LightImages,
    set: &[(String, Rgb)],
    image: (&Path, &Path),
    files: &ImageFileArgs,
) -> Result<MixReport> {
    let mixed = Mixed::new(lights, set)?;
    let mut attempts = Attempts::default();
    mixed.write(image, files, &mut attempts);
    attempts.finish()?;
    Ok(mixed.report(Some(image), None))
}

/// Lights with their factors, and their mixture.
pub struct Mixed<'a> {
    pub lights: &'a LightImages,
    pub factors: Vec<Rgb>,
    mixture: Mixture,
}

impl<'a> Mixed<'a> {
    fn new(lights: &'a LightImages, set: &[(String, Rgb)]) -> Result<Self> {
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
        Ok(Self { lights, factors, mixture })
    }

    /// Writes the image, its preview and the picture in false colors.
    fn write(&self, (exr, png): (&Path, &Path), files: &ImageFileArgs, attempts: &mut Attempts) {
        let Self { lights, factors, mixture } = self;
        let mut image = lights.image(factors, mixture);
        let false_color = files.false_color(exr);
        if false_color.is_some() {
            image.layers.push(luminance_layer(&mixture.radiance));
            record_efficacy(&mut image.metadata);
        }
        let format = ExrFormat { window: lights.window(), ..files.exr_format() };
        attempts.add(exr, || image_io::write_exr_as(exr, &image, format));
        attempts.add(png, || {
            image_io::write_png_as(png, lights.size, &mixture.radiance, files.tone_mapping())
        });
        if let Some(path) = &false_color {
            attempts.add(path, || write_luminance(path, lights.size, &mixture.radiance));
        }
    }

    /// The result with these files: image and preview, page.
    fn report(&self, image: Option<(&Path, &Path)>, page: Option<&Path>) -> MixReport {
        let name = |path: &Path| path.to_string_lossy().into_owned();
        let light = |(light, factor): (&LightImage, &Rgb)| MixedLight {
            name: light.name.clone(),
            factor: factor.to_array(),
            has_error: light.has_error(),
        };
        let radiance = &self.mixture.radiance;
        let sum: f64 = radiance.iter().map(|own| f64::from(luminance(*own))).sum();
        MixReport {
            exr: image.map(|(exr, _)| name(exr)),
            png: image.map(|(_, png)| name(png)),
            report: page.map(name),
            lights: self.lights.lights.iter().zip(&self.factors).map(light).collect(),
            mean_luminance: sum / radiance.len() as f64,
            error: self.mixture.error,
        }
    }
}

impl MixReport {
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
        let files = [&self.exr, &self.png, &self.report].map(Option::as_deref);
        let files: Vec<&str> = files.into_iter().flatten().collect();
        format!(
            "{}: {}; mean luminance {:.4}\n{error}\n",
            files.join(" and "),
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
