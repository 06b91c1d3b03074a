//! `mix --report`: a page whose numbers are those of the images and of `mix`.

use crate::common::html::assert_whole;
use crate::common::program_output::{assert_refused, json, succeed};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bdpm::base::math::Rgb;
use bdpm::base::rng::{Stream, StreamKey};
use bdpm::image_io::{Image, Layer, Metadata, Value, half_value, read_exr, write_exr};
use bdpm::output::light_sample::{MixtureSample, SampleSquare, SampledLight};
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// A name with all characters that HTML knows.
const NAME: &str = "a<b>&\"c'";

fn bdpm(folder: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.current_dir(folder).args(args).stdin(Stdio::null()).output().unwrap()
}

/// Renders the office with two groups into `a.exr`.
fn render(folder: &Path, more: &[&str]) {
    let scene = format!("{}/scenes/office", env!("CARGO_MANIFEST_DIR"));
    let groups = format!("--light-groups={NAME}=*left,rest=panel-middle+*right");
    let own = ["render", &scene, &groups, "--output", "a.exr", "--quiet", "--accel", "bvh"];
    let counts = ["--resolution", "48x36", "--light-paths", "1500", "--camera-paths", "2"];
    succeed(&bdpm(folder, &[&own[..], &counts, &["--iterations", "6"], more].concat()));
}

/// A tag of the page, such as `<main`, and all behind it that is no tag.
fn tags<'a>(html: &'a str, start: &str) -> Vec<&'a str> {
    html.split(start).skip(1).map(|rest| rest.split('>').next().unwrap()).collect()
}

/// The value of an attribute of a tag.
fn attribute(tag: &str, name: &str) -> Option<String> {
    let value = tag.split(&format!(" {name}=\"")).nth(1)?.split('"').next().unwrap();
    let pairs = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&amp;", "&")];
    Some(pairs.iter().fold(value.to_owned(), |text, (from, to)| text.replace(from, to)))
}

fn number(tag: &str, name: &str) -> Option<f64> {
    attribute(tag, name).map(|own| own.parse().unwrap())
}

fn words(tag: &str, name: &str) -> Option<Vec<u16>> {
    let text = attribute(tag, name)?;
    let bytes = STANDARD.decode(text.strip_prefix("base64,").unwrap()).unwrap();
    Some(bytes.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect())
}

/// What a page has of a light.
struct PageLight {
    name: String,
    start: String,
    radiance: Vec<f64>,
}

/// Size of the picture, lights, and the sample from which the script computes errors.
fn read(html: &str) -> ((usize, usize), Vec<PageLight>, MixtureSample) {
    assert_whole(html);
    let main = tags(html, "<main")[0];
    let picture = ["data-width", "data-height"].map(|name| number(main, name).unwrap() as usize);
    let size = attribute(main, "data-size").unwrap();
    let (width, height) = size.split_once(',').unwrap();
    let square = |text: &str| {
        let numbers: Vec<f64> = text.split(',').map(|own| own.parse().unwrap()).collect();
        let pixels = [0, 1, 2, 3].map(|at| numbers[at] as u32);
        SampleSquare { pixels, weight: numbers[4] }
    };
    let tags_of_lights = tags(html, "<div class=\"light\"");
    let scale = |tag: &str| number(tag, "data-scale").unwrap();
    let sample = MixtureSample {
        size: (width.parse().unwrap(), height.parse().unwrap()),
        squares: attribute(main, "data-squares").unwrap().split(' ').map(square).collect(),
        lights: tags_of_lights
            .iter()
            .map(|tag| SampledLight {
                scale: scale(tag),
                luminance: words(tag, "data-luminance").unwrap(),
                rms: words(tag, "data-rms"),
                mean: number(tag, "data-mean").unwrap(),
                bias: number(tag, "data-bias").unwrap(),
                denoised: number(tag, "data-denoised"),
                seed: attribute(tag, "data-seed").map(|own| own.parse().unwrap()),
            })
            .collect(),
        clean_share: number(main, "data-clean-share"),
        largest_difference: 0.0,
    };
    let starts = html.split("<div class=\"light\"").skip(1);
    let light = |(tag, body): (&&str, &str)| {
        let (values, unit) = (words(tag, "data-radiance").unwrap(), scale(tag));
        PageLight {
            name: attribute(tag, "data-name").unwrap(),
            start: attribute(tags(body, "<input")[1], "value").unwrap(),
            radiance: values.iter().map(|own| unit * f64::from(half_value(*own))).collect(),
        }
    };
    ((picture[0], picture[1]), tags_of_lights.iter().zip(starts).map(light).collect(), sample)
}

/// Compares the error of the page with that of `mix` for several mixtures of lights.
fn assert_errors(
    folder: &Path,
    image: &str,
    sample: &MixtureSample,
    names: &[&str],
    tolerance: f64,
) {
    for factors in [[1.0, 1.0], [0.3, 1.0], [0.0, 1.7], [2.0, 0.05]] {
        let factors: Vec<f64> = (0..names.len()).map(|light| factors[light % 2]).collect();
        let set = names.iter().zip(&factors).map(|(name, own)| format!("--set={name}={own}"));
        let set: Vec<String> = set.collect();
        let mut args = vec!["mix", image, "--json", "--output", "mixed.exr"];
        args.extend(set.iter().map(|own| &own[..]));
        let report = json(&bdpm(folder, &args));
        let own = sample.error(&factors).unwrap();
        for (part, own) in [("total", own.total), ("noise", own.noise)] {
            let stated = report["error"][part].as_f64().unwrap();
            assert!((own / stated - 1.0).abs() < tolerance, "{factors:?} {part}: {own} {stated}");
        }
        let pairs = sample.lights.iter().zip(&factors);
        let mean: f64 = pairs.map(|(light, factor)| factor * light.mean).sum();
        let stated = report["mean_luminance"].as_f64().unwrap();
        assert!((mean / stated - 1.0).abs() < 1e-5, "{mean} {stated}");
    }
}

#[test]
fn page_has_the_radiance_of_every_light_and_the_errors_of_mixtures() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for more in [&["--no-denoise"][..], &[]] {
        render(folder, more);
        let set = format!("--set={NAME}=0.333");
        let own = ["mix", "a.exr", &set, "--report", "a page.html", "--json"];
        let report = json(&bdpm(folder, &own));
        assert_eq!(report["report"], "a page.html");
        assert!(report["exr"].is_null() && report["png"].is_null(), "{report}");
        let html = fs::read_to_string(folder.join("a page.html")).unwrap();
        assert!(!html.contains("a<b>"), "names are escaped");
        let (size, lights, sample) = read(&html);
        assert_eq!(size, (48, 36));
        let names: Vec<&str> = lights.iter().map(|own| &own.name[..]).collect();
        assert!(names.len() == 2 && names.contains(&NAME), "{names:?}");
        let image = read_exr(&folder.join("a.exr")).unwrap();
        for light in &lights {
            let start = if light.name == NAME { "0.333" } else { "1" };
            assert_eq!(light.start, start);
            let layer = image.layer(&format!("light.{}", light.name)).unwrap();
            let pixels = layer.to_rgb().unwrap();
            let layer: Vec<f64> =
                pixels.iter().flat_map(|own| own.to_array().map(f64::from)).collect();
            let mean = layer.iter().sum::<f64>() / layer.len() as f64;
            assert_eq!(light.radiance.len(), layer.len());
            for (own, exact) in light.radiance.iter().zip(layer) {
                // Half of the last of 11 bits, or of the least number.
                let tolerance = (exact.abs() / 2047.0).max(1e-7 * mean);
                assert!((own - exact).abs() <= tolerance, "{own} {exact}");
            }
        }
        assert_errors(folder, "a.exr", &sample, &names, 1e-3);
    }
}

#[test]
fn pages_that_mix_cannot_write_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    render(folder, &["--no-denoise"]);
    let refused = |args: &[&str], problem: &str, advice: &str| {
        let output = bdpm(folder, &[&["mix", "a.exr"], args].concat());
        assert_refused(&output, problem, advice);
    };
    refused(&["--report", "a.html", "--set", "rest=1,0.9,0.8"], "`rest`", "--output");
    refused(&["--report", "a.txt"], "a.txt", "html");
    assert!(!folder.join("a.html").exists());
    let wrong = |args: &[&str], words: &str| {
        let output = bdpm(folder, &[&["mix", "a.exr"], args].concat());
        let shown = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && shown.contains(words), "{shown}");
    };
    wrong(&[], "--output");
    wrong(&["--report", "a.html", "--half"], "--output");
    // An image and a page.
    let both = ["--output", "b.exr", "--report", "b.html", "--quiet"];
    succeed(&bdpm(folder, &[&["mix", "a.exr"], &both[..]].concat()));
    assert!(["b.exr", "b.png", "b.html"].iter().all(|name| folder.join(name).exists()));
}

/// A file of three lights that fade with distance, with an edge and noise.
fn write_large(path: &Path, (width, height): (u32, u32)) {
    let (mut layers, mut metadata) = (Vec::new(), Metadata::new());
    let names = ["key", "fill", "rim"];
    for (index, name) in names.into_iter().enumerate() {
        let mut rng = StreamKey::new(index as u64, Stream::Test, 0).rng(0);
        let center = [[0.2, 0.3], [0.8, 0.2], [0.6, 0.9]][index];
        let (mut radiance, mut variance) = (Vec::new(), Vec::new());
        for pixel in 0..width * height {
            let x = (pixel % width) as f32 / width as f32;
            let y = (pixel / width) as f32 / height as f32;
            let albedo = if (x * 9.0).sin() * (y * 7.0).cos() > 0.2 { 0.7 } else { 0.1 };
            let mean = albedo / (0.05 + (x - center[0]).powi(2) + (y - center[1]).powi(2));
            let sigma = [0.05, 0.15, 0.4][index] * mean * (0.5 + rng.next_1d());
            let error = sigma * ((0..12).map(|_| rng.next_1d()).sum::<f32>() - 6.0);
            radiance.push((mean + error) * Rgb::new(1.0, 0.9, 0.8));
            variance.push(sigma * sigma);
        }
        let layer = format!("light.{name}");
        layers.push(Layer::rgb(&layer, &radiance));
        let channels = vec![("Y".into(), variance)];
        layers.push(Layer { name: format!("{layer}.variance"), channels });
        metadata.insert(format!("{layer} bias"), Value::Number(0.01));
        metadata.insert(format!("{layer} seed"), Value::Text(index.to_string()));
    }
    let whole = vec![Rgb::ONE; (width * height) as usize];
    layers.insert(0, Layer::rgb("", &whole));
    write_exr(path, &Image { width, height, layers, metadata }).unwrap();
}

#[test]
fn pages_of_large_images_are_bounded_and_state_the_errors_of_mixtures() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_large(&folder.join("large.exr"), (640, 360));
    succeed(&bdpm(folder, &["mix", "large.exr", "--report", "large.html", "--quiet"]));
    let html = fs::read_to_string(folder.join("large.html")).unwrap();
    assert!(html.len() < 8_200_000, "{}", html.len());
    let ((width, height), lights, sample) = read(&html);
    assert_eq!((width, height), (640, 360));
    assert!(sample.squares.len() > 500, "{}", sample.squares.len());
    let image = read_exr(&folder.join("large.exr")).unwrap();
    for light in &lights {
        let layer = image.layer(&format!("light.{}", light.name)).unwrap().to_rgb().unwrap();
        for pixel in [0, width * height / 2 + 100, width * height - 1] {
            let (own, exact) = (light.radiance[3 * pixel], f64::from(layer[pixel].x));
            assert!((own / exact - 1.0).abs() < 1e-3, "{own} {exact}");
        }
    }
    let names: Vec<&str> = lights.iter().map(|own| &own.name[..]).collect();
    assert_errors(folder, "large.exr", &sample, &names, 0.02);
}
