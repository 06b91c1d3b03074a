//! Makes the pictures of the documentation from EXR images and PNG files: labels, strips, error
//! maps.
//!
//! ```sh
//! cargo run --release --example picture -- strip OUT.jpg A.exr 'label of A' B.exr 'label of B'
//! cargo run --release --example picture -- errors OUT.jpg IMAGE.exr REFERENCE.exr 'label of IMAGE'
//! cargo run --release --example picture -- facts RESULT.json
//! ```
//!
//! `strip` puts images side by side, with the exposure of the first and each with its label.
//! `LAYER@FILE.exr` names another layer, and `result@FILE.exr` is the denoised image if there is
//! one, else the image. `errors` shows an image, its reported error and its true error on one
//! scale. `facts` prints time, promise and errors of a result. The quality of the JPEG file is the
//! best one with at most 400 KB.
//!
//! Labels can take facts from a result of `bdpm render --json`. `@FILE.json` becomes the promised
//! and the measured error. `TEXT@FILE.json` becomes the text, the time, and the error of the layer.

use bdpm::base::math::Rgb;
use bdpm::film::radiance::{box_filter, luminance};
use bdpm::image_io::{Image, auto_exposure, read_exr, tone_map};
use image::codecs::jpeg::JpegEncoder;
use image::{RgbImage, imageops};
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
use serde_json::Value;
use std::error::Error;
use std::path::Path;

/// Maximum size of a picture, bytes.
const MAX_BYTES: usize = 400_000;
/// Width of a picture for which text has its original size, pixels. Twice the width doubles it.
const WIDTH_OF_LABELS: u32 = 640;
/// Pixels between images of a strip.
const GAP: u32 = 8;
/// Error at the end of the scale of error maps, relative to the luminance.
const SCALE: f64 = 0.2;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Draws white text on black at the lower left corner. Large pictures, which pages show smaller,
/// get larger text.
///
/// # Errors
/// If the text is wider than the picture.
fn label(picture: &mut RgbImage, text: &str) -> Result<()> {
    let (weight, size) = (FontWeight::Regular, RasterHeight::Size16);
    let scale = (picture.width() / WIDTH_OF_LABELS).max(1);
    let (advance, line) =
        (scale * get_raster_width(weight, size) as u32, scale * size.val() as u32);
    let margin = 4 * scale;
    let top = picture.height().saturating_sub(line + 2 * margin);
    let width = text.chars().count() as u32 * advance + 2 * margin;
    if width > picture.width() {
        let (own, most) = (picture.width(), picture.width().saturating_sub(2 * margin) / advance);
        let problem =
            format!("the label `{text}` is too long for {own} pixels: {most} letters fit");
        return Err(problem.into());
    }
    for y in top..picture.height() {
        for x in 0..width {
            picture.put_pixel(x, y, image::Rgb([0; 3]));
        }
    }
    for (index, character) in text.chars().enumerate() {
        let Some(glyph) = get_raster(character, weight, size) else { continue };
        let left = margin + index as u32 * advance;
        for y in 0..line {
            for x in 0..advance {
                let ink = glyph.pixel((x / scale) as usize, (y / scale) as usize);
                let (x, y) = (left + x, top + margin + y);
                if let Some(ink) = ink
                    && y < picture.height()
                {
                    picture.put_pixel(x, y, image::Rgb([ink; 3]));
                }
            }
        }
    }
    Ok(())
}

/// Writes a PNG file, or a JPEG file with the best quality that keeps it within [`MAX_BYTES`].
fn write(path: &str, picture: &RgbImage) -> Result<()> {
    if path.ends_with(".png") {
        return Ok(picture.save(path)?);
    }
    for quality in (10..=95).rev().step_by(5) {
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, quality).encode_image(picture)?;
        if bytes.len() <= MAX_BYTES || quality == 10 {
            std::fs::write(path, bytes)?;
            break;
        }
    }
    Ok(())
}

fn colors(image: &Image, layer: &str) -> Result<Vec<Rgb>> {
    let found = image.layer(layer).and_then(|layer| layer.to_rgb());
    found.ok_or_else(|| format!("there is no layer `{layer}` of colors").into())
}

fn picture(image: &Image, pixels: &[Rgb], exposure: f32) -> RgbImage {
    RgbImage::from_fn(image.width, image.height, |x, y| {
        image::Rgb(tone_map(pixels[(y * image.width + x) as usize], exposure))
    })
}

fn percent(value: &Value) -> Option<String> {
    value.as_f64().map(|value| format!("{:.1} %", 100.0 * value))
}

/// The result of `bdpm render --json`.
fn result_of(path: &str) -> Result<Value> {
    Ok(serde_json::from_str(&std::fs::read_to_string(path)?)?)
}

/// The error of the image, or that of its layer `denoised`. Short renders do not know it.
fn stated_error(result: &Value, is_denoised: bool) -> String {
    let error = match is_denoised {
        true => &result["denoised"]["total_error"],
        false => &result["error"]["total"],
    };
    percent(error).unwrap_or_else(|| "unknown".into())
}

fn seconds(result: &Value) -> Result<String> {
    let seconds = result["seconds"]["total"].as_f64().ok_or("the result has no time")?;
    Ok(format!("{seconds:.0} s"))
}

/// Time, promise and errors of a result, for the documentation.
fn facts(path: &str) -> Result<String> {
    let result = result_of(path)?;
    let mut facts = vec![seconds(&result)?];
    for (name, error) in [
        ("promised", &result["promise"]["error"]),
        ("error", &result["error"]["total"]),
        ("denoised error", &result["denoised"]["total_error"]),
    ] {
        facts.extend(percent(error).map(|error| format!("{name} {error}")));
    }
    Ok(facts.join(", "))
}

/// The text of a label, of an image or of its layer `denoised`.
fn label_text(label: &str, is_denoised: bool) -> Result<String> {
    let Some((text, path)) = label.split_once('@') else { return Ok(label.into()) };
    let result = result_of(path)?;
    let error = stated_error(&result, is_denoised);
    if !text.is_empty() {
        return Ok(format!("{text}, {}: error {error}", seconds(&result)?));
    }
    Ok(match percent(&result["promise"]["error"]) {
        Some(promised) => format!("promised {promised}, measured {error}"),
        None => format!("measured {error}"),
    })
}

fn side_by_side(pictures: &[RgbImage]) -> RgbImage {
    let width: u32 = pictures.iter().map(|p| p.width() + GAP).sum();
    let height = pictures.iter().map(RgbImage::height).max().unwrap_or(0);
    let white = image::Rgb([255; 3]);
    let mut all = RgbImage::from_pixel(width.saturating_sub(GAP), height, white);
    let mut left = 0;
    for picture in pictures {
        imageops::replace(&mut all, picture, i64::from(left), 0);
        left += picture.width() + GAP;
    }
    all
}

fn strip(output: &str, inputs: &[String]) -> Result<()> {
    let mut exposure = None;
    let mut pictures = Vec::new();
    for two in inputs.chunks(2) {
        let (mut layer, path) = two[0].split_once('@').unwrap_or(("", &two[0]));
        let is_exr = path.ends_with(".exr");
        let mut one = if is_exr {
            let image = read_exr(Path::new(path))?;
            if layer == "result" {
                layer = image.layer("denoised").map_or("", |_| "denoised");
            }
            let pixels = colors(&image, layer)?;
            let exposure = *exposure.get_or_insert_with(|| auto_exposure(&pixels));
            picture(&image, &pixels, exposure)
        } else {
            image::open(path)?.to_rgb8()
        };
        match two.get(1).map(String::as_str) {
            // PNG files may have captions of their own.
            None | Some("") if is_exr && inputs.len() > 2 => {
                return Err("label each image of a strip".into());
            }
            None | Some("") => {}
            Some(text) => label(&mut one, &label_text(text, layer == "denoised")?)?,
        }
        pictures.push(one);
    }
    write(output, &side_by_side(&pictures))
}

/// Reported and true error of each pixel relative to its luminance, pooled over 5 by 5 pixels.
fn relative_errors(image: &Image, reference: &Image) -> Result<[Vec<f64>; 2]> {
    let size = |image: &Image| (image.width, image.height);
    if size(image) != size(reference) {
        return Err("the images differ in size".into());
    }
    let luminances = |image| -> Result<Vec<f64>> {
        Ok(colors(image, "")?.iter().map(|c| luminance(c.as_dvec3())).collect())
    };
    let (own, truth) = (luminances(image)?, luminances(reference)?);
    let mean = truth.iter().sum::<f64>() / truth.len() as f64;
    let rms =
        image.layer("rms").and_then(|layer| layer.channel("Y")).ok_or("there is no layer rms")?;
    let weight = |i: usize| 1.0 / (truth[i] * truth[i] + 0.01 * mean * mean);
    let squares: Vec<[f64; 3]> = (0..truth.len())
        .map(|i| {
            let (noise, difference) = (f64::from(rms[i]), own[i] - truth[i]);
            [noise * noise * weight(i), difference * difference * weight(i), 0.0]
        })
        .collect();
    let pooled = box_filter(&squares, image.width, image.height);
    Ok([0, 1].map(|k| pooled.iter().map(|p| p[k].max(0.0).sqrt()).collect()))
}

fn errors(output: &str, image: &str, reference: &str, name: &str) -> Result<()> {
    let (image, reference) = (read_exr(Path::new(image))?, read_exr(Path::new(reference))?);
    let pixels = colors(&image, "")?;
    let mut pictures = vec![picture(&image, &pixels, auto_exposure(&pixels))];
    label(&mut pictures[0], &label_text(name, false)?)?;
    let scale = colorgrad::preset::viridis();
    let names = ["reported error", "true error"];
    for (name, errors) in names.into_iter().zip(relative_errors(&image, &reference)?) {
        let mut map = RgbImage::from_fn(image.width, image.height, |x, y| {
            let share = errors[(y * image.width + x) as usize] / SCALE;
            let [r, g, b, _] = colorgrad::Gradient::at(&scale, share.min(1.0) as f32).to_rgba8();
            image::Rgb([r, g, b])
        });
        label(&mut map, &format!("{name}, 0 to {:.0} %", 100.0 * SCALE))?;
        pictures.push(map);
    }
    write(output, &side_by_side(&pictures))
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.split_first() {
        Some((command, [output, inputs @ ..])) if command == "strip" && !inputs.is_empty() => {
            strip(output, inputs)
        }
        Some((command, [output, image, reference, name])) if command == "errors" => {
            errors(output, image, reference, name)
        }
        Some((command, [result])) if command == "facts" => {
            println!("{}", facts(result)?);
            Ok(())
        }
        _ => Err("usage: picture strip OUT.jpg (IMAGE LABEL)... | \
                  errors OUT.jpg IMAGE REFERENCE LABEL | facts RESULT.json"
            .into()),
    }
}
