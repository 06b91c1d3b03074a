//! `bdpm tone IMAGE OUT.png`.

use super::image_file_args::ToneArgs;
use super::outputs::{self, Output};
use super::{json, say};
use bdpm::base::error::{Error, Result};
use bdpm::base::math::Rgb;
use bdpm::image_io::{self, Image, Layer, WhiteBalance, read_exr, read_exr_display};
use bdpm::import::read_radiance;
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
#[command(mut_arg("tonemap", |arg| arg.help("Map the colors by this curve")))]
#[command(mut_arg("exposure", |arg| arg.help(
    "Brighten by this many stops, beyond the automatic exposure or --white"
)))]
pub struct Args {
    /// Read this .exr or .hdr image
    image: PathBuf,
    /// Write this 8-bit sRGB picture
    #[arg(value_name = "OUT.png")]
    output: PathBuf,
    #[command(flatten)]
    tone: ToneArgs,
    /// Show this radiance as display white, instead of the automatic exposure
    #[arg(long, value_name = "RADIANCE", value_parser = radiance)]
    white: Option<f32>,
    /// Make gray: auto (the mean), light of this many kelvins, pixel X,Y or color R,G,B
    #[arg(long, value_name = "AUTO|KELVIN|X,Y|R,G,B", allow_hyphen_values = true)]
    white_balance: Option<WhiteBalance>,
    /// Show this layer [default: `denoised` if there is one, else the image]
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
}

/// Name of the image itself for `--layer`, which has the empty name in files.
const IMAGE: &str = "image";

/// Layer of the denoised image.
const DENOISED: &str = "denoised";

#[derive(Serialize)]
struct ToneReport<'a> {
    image: String,
    png: String,
    layer: &'a str,
    width: u32,
    height: u32,
    /// Factor from radiance to display values, where 1 is white.
    exposure: f32,
    /// The color that became gray, if the white is balanced.
    white_balance: Option<Gray>,
}

#[derive(Serialize)]
struct Gray {
    /// CIE chromaticities.
    x: f64,
    y: f64,
    /// Correlated color temperature, kelvin, if the color has one.
    kelvin: Option<f64>,
}

pub fn run(args: &Args) -> Result<String> {
    let output = [Output::new("OUT.png", &args.output, Some("png"))];
    outputs::check(&output)?;
    let shown = read(&args.image, args.layer.as_deref())?;
    outputs::spare_inputs(&output)?;
    let Shown { name: layer, size: (width, height), mut pixels } = shown;
    let broken = pixels.iter().filter(|pixel| !pixel.is_finite()).count();
    if broken > 0 {
        say(&format!("note: {broken} pixels are not finite, and may become black"));
    }
    let balance = args.white_balance.map(|balance| balance.adaptation(width, &pixels));
    let balance = balance.transpose().map_err(|error| error.at(&args.image))?;
    if let Some(balance) = &balance {
        balance.apply(&mut pixels);
    }
    let mapping = args.tone.mapping();
    let exposure = match args.white {
        Some(white) => (mapping.stops.exp2() / white).clamp(f32::MIN_POSITIVE, f32::MAX),
        None => mapping.exposure(&pixels),
    };
    image_io::write_png_exposed(&args.output, (width, height), &pixels, mapping, exposure)?;
    let name = |path: &Path| path.to_string_lossy().into_owned();
    let white_balance = balance.map(|balance| {
        let [x, y] = balance.chromaticity();
        Gray { x, y, kelvin: balance.correlated_temperature() }
    });
    let (image, png) = (name(&args.image), name(&args.output));
    let report = ToneReport { image, png, layer: &layer, width, height, exposure, white_balance };
    Ok(if args.json { json(&report) } else { text(&report) })
}

/// A layer of an image.
struct Shown {
    name: String,
    size: (u32, u32),
    pixels: Vec<Rgb>,
}

/// Reads a layer. Images of this program are their data window,
/// as their previews are; those of other programs their display window.
fn read(path: &Path, layer: Option<&str>) -> Result<Shown> {
    let is_exr = path.extension().is_some_and(|own| own.eq_ignore_ascii_case("exr"));
    if !is_exr {
        if let Some(layer) = layer {
            let problem = format!("there is no layer {layer}: only .exr files have layers");
            return Err(Error::new(problem, "leave out --layer").at(path));
        }
        let read = read_radiance(path)?;
        return Ok(Shown { name: IMAGE.into(), size: read.size, pixels: read.pixels });
    }
    let is_ours = image_io::read_exr_summary(path)?.is_ours();
    let image = if is_ours { read_exr(path)? } else { read_exr_display(path)? };
    let (name, pixels) = shown(&image, layer).map_err(|error| error.at(path))?;
    let name = if name.is_empty() { IMAGE } else { name };
    Ok(Shown { name: name.to_owned(), size: (image.width, image.height), pixels })
}

/// Name and colors of the layer to show. A layer of one channel is gray.
fn shown<'a>(image: &'a Image, requested: Option<&str>) -> Result<(&'a str, Vec<Rgb>)> {
    let layer = match requested {
        Some(IMAGE) => image.layer(""),
        Some(name) => image.layer(name),
        None => image.layer(DENOISED).or_else(|| image.layer("")),
    };
    let colors = |layer: &Layer| match &layer.channels[..] {
        [(_, values)] => Some(values.iter().map(|value| Rgb::splat(*value)).collect()),
        _ => layer.to_rgb(),
    };
    if let Some(layer) = layer
        && let Some(pixels) = colors(layer)
    {
        return Ok((&layer.name, pixels));
    }
    let known = image.layers.iter().filter(|layer| colors(layer).is_some());
    let known = known.map(|layer| if layer.name.is_empty() { IMAGE } else { &layer.name });
    let known: Vec<_> = known.collect();
    let name = requested.unwrap_or(IMAGE);
    let problem = format!("there is no layer {name} with the channels R, G and B, or with one");
    let advice = match &known[..] {
        [] => "give a color image".to_owned(),
        known => format!("give --layer with one of {}", known.join(", ")),
    };
    Err(Error::new(problem, advice))
}

fn text(report: &ToneReport) -> String {
    let ToneReport { png, layer, width, height, exposure, white_balance, .. } = report;
    let layer = if *layer == IMAGE { String::new() } else { format!(" of the layer {layer}") };
    let white = 1.0 / exposure;
    let mut text = format!("{png}: {width}x{height} pixels{layer}, white at radiance {white:.4}\n");
    if let Some(Gray { x, y, kelvin }) = white_balance {
        let kelvin = kelvin.map_or(String::new(), |kelvin| format!(", about {kelvin:.0} K"));
        text += &format!("white balance: x {x:.4}, y {y:.4}{kelvin} became gray\n");
    }
    text
}

/// Reads a radiance above 0.
fn radiance(text: &str) -> std::result::Result<f32, &'static str> {
    let radiance = text.parse::<f32>().ok().filter(|own| *own > 0.0 && own.is_finite());
    radiance.ok_or("give a radiance above 0, such as 2.5")
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm::image_io::Metadata;

    #[test]
    fn shown_layer_is_the_denoised_image_unless_another_is_requested() {
        let layer = |name: &str, value: f32| Layer::rgb(name, &[Rgb::splat(value)]);
        let gray = Layer { name: "depth".into(), channels: vec![("Z".into(), vec![4.0])] };
        let two = |name: &str| (name.to_owned(), vec![0.0]);
        let pair = Layer { name: "pair".into(), channels: vec![two("X"), two("Y")] };
        let mut image = Image {
            width: 1,
            height: 1,
            layers: vec![layer("", 1.0), gray, pair, layer(DENOISED, 3.0)],
            metadata: Metadata::new(),
        };
        let value = |image: &Image, name| shown(image, name).map(|(_, pixels)| pixels[0].x);
        assert_eq!(value(&image, None).unwrap(), 3.0);
        assert_eq!(value(&image, Some("image")).unwrap(), 1.0);
        assert_eq!(value(&image, Some("depth")).unwrap(), 4.0);
        for missing in ["pair", "none"] {
            let error = value(&image, Some(missing)).unwrap_err().to_string();
            assert!(error.contains("one of image, depth, denoised"), "{error}");
        }
        image.layers.pop();
        assert_eq!(value(&image, None).unwrap(), 1.0);
    }

    #[test]
    fn radiances_of_white_are_positive() {
        assert_eq!(radiance("2.5"), Ok(2.5));
        for bad in ["", "0", "-1", "inf", "NaN"] {
            assert!(radiance(bad).is_err(), "{bad}");
        }
    }
}
