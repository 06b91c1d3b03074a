//! `bdpm denoise IMAGE`.

use super::image_file_args::image_name;
use super::outputs::{self, Attempts, Output};
use super::preview;
use super::settings_args::{QUALITY, word};
use bdpm::base::error::{Error, Result};
use bdpm::base::math::{Rgb, luminance};
use bdpm::base::photometry::LUMENS_PER_WATT;
use bdpm::image_io::{self, Image, Layer, NOISY};
use bdpm::output::denoise::{Guides, Oidn, Quality, denoise_around};
use glam::Vec3;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(clap::Args)]
pub struct Args {
    /// Denoise this EXR image, guided by its layers albedo and normal; the layer emission is kept
    image: PathBuf,
    /// Write the result here, the raw image as `noisy` [default: IMAGE.denoised.exr]
    #[arg(long, short, value_name = "OUT.exr", value_parser = image_name)]
    output: Option<PathBuf>,
    /// Denoise with this effort
    #[arg(long, value_name = "QUALITY", default_value = "high")]
    #[arg(value_parser = word::<Quality>(QUALITY))]
    quality: Quality,
    /// Use this many threads [default: all processors]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct DenoiseReport {
    exr: String,
    png: String,
    denoiser: String,
    /// True if albedo and normals guided the denoiser.
    guided: bool,
    seconds: f64,
}

pub fn run(args: &Args) -> Result<String> {
    let exr = args.output.clone().unwrap_or_else(|| args.image.with_extension("denoised.exr"));
    let beside = preview::beside(&exr);
    let output = |path| Output::new("--output", path, Some("exr"));
    let preview_at = |path| Output::new("the preview of --output", path, Some("png"));
    outputs::check(&[output(&exr), preview_at(&beside)])?;
    let mut image = image_io::read_exr(&args.image)?;
    outputs::spare_inputs(&[output(&exr)])?;
    let png = preview::aside(&beside)?;
    let available = std::thread::available_parallelism().map_or(1, usize::from);
    let mut oidn = Oidn::new(args.threads.map_or(available, usize::from))?;
    oidn.set_quality(args.quality);
    let start = Instant::now();
    let (radiance, guides) = inputs(&image).map_err(|e| e.at(&args.image))?;
    let size = (image.width, image.height);
    let guides = match args.quality {
        Quality::High => oidn.prefilter(size, guides)?,
        Quality::Fast => guides,
    };
    // Light sources that pixels see are left as they are. Layers of this name in files of other
    // programs, which have no metadata of this one, may be anything.
    let emission = image.layer("emission").filter(|_| !image.metadata.is_empty());
    let seen = emission.and_then(Layer::to_rgb).map_or(vec![], finite);
    let pixels = denoise_around(&seen, &radiance, |rest| oidn.denoise(size, rest, &guides))?;
    let (seconds, guided) = (start.elapsed().as_secs_f64(), !guides.albedo.is_empty());
    replace(&mut image, &pixels);
    let mut attempts = Attempts::default();
    attempts.add(&exr, || image_io::write_exr(&exr, &image));
    attempts.add(&png, || image_io::write_png(&png, size.0, size.1, &pixels));
    attempts.finish()?;
    let name = |path: &Path| path.to_string_lossy().into_owned();
    let denoiser = format!("Open Image Denoise {}", oidn.version());
    let report = DenoiseReport { exr: name(&exr), png: name(&png), denoiser, guided, seconds };
    Ok(if args.json { super::json(&report) } else { text(&report) })
}

fn finite(values: Vec<Vec3>) -> Vec<Vec3> {
    values.into_iter().map(|value| if value.is_finite() { value } else { Vec3::ZERO }).collect()
}

/// The radiance, and the guides if the image has both albedo and normals.
fn inputs(image: &Image) -> Result<(Vec<Vec3>, Guides)> {
    let radiance = image
        .raw()
        .and_then(Layer::to_rgb)
        .ok_or_else(|| Error::new("the image has no channels R, G and B", "give an RGB image"))?;
    let albedo = image.layer("albedo").and_then(Layer::to_rgb);
    let normal = image.layer("normal").and_then(|layer| {
        let [x, y, z] = ["X", "Y", "Z"].map(|name| layer.channel(name));
        let (x, y, z) = (x?, y?, z?);
        Some(x.iter().zip(y).zip(z).map(|((&x, &y), &z)| Vec3::new(x, y, z)).collect())
    });
    let guides = albedo.zip(normal).map_or_else(Guides::default, |(albedo, normal)| Guides {
        albedo: finite(albedo),
        normal: finite(normal),
        clean: false, // Their noise is not known.
    });
    Ok((finite(radiance), guides))
}

/// Replaces the image by the denoised one, and keeps the raw one in the layer [`NOISY`]. Other
/// channels, such as alpha, are unchanged.
fn replace(image: &mut Image, denoised: &[Rgb]) {
    // Layers and errors of an earlier denoised image no longer hold.
    image.layers.retain(|layer| !layer.name.starts_with("denoised"));
    image.metadata.retain(|name, _| !name.starts_with("denoised"));
    let is_photometric = image.metadata.contains_key("luminance in lumens per watt");
    let mut raw = Vec::new();
    for layer in &mut image.layers {
        if layer.name.is_empty() {
            let is_color = |(name, _): &(String, Vec<f32>)| ["R", "G", "B"].contains(&&name[..]);
            let channels = std::mem::take(&mut layer.channels);
            let (colors, others): (Vec<_>, Vec<_>) = channels.into_iter().partition(is_color);
            layer.channels = Layer::rgb("", denoised).channels;
            layer.channels.extend(others);
            raw = colors;
        } else if is_photometric && layer.name == "luminance" {
            let values = denoised.iter().map(|pixel| LUMENS_PER_WATT * luminance(*pixel)).collect();
            layer.channels = vec![("Y".into(), values)];
        }
    }
    // An image that was denoised before has its raw image already.
    if image.layer(NOISY).is_none() {
        image.layers.push(Layer { name: NOISY.into(), channels: raw });
    }
}

fn text(report: &DenoiseReport) -> String {
    let DenoiseReport { exr, png, denoiser, guided, seconds } = report;
    let by = if *guided { "guided by albedo and normals" } else { "without albedo and normals" };
    format!(
        "{exr} and {png}: denoised by {denoiser} {by}, in {seconds:.2}s\n\
         the error is not known: render with --denoise to estimate it\n"
    )
}
