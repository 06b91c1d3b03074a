//! `bdpm render --layers`, `--denoise`, and `bdpm denoise`.

use crate::common::program_output::{assert_refused, json, succeed};
use bdpm::base::math::Rgb;
use bdpm::film::aov::AovSelection;
use bdpm::image_io::{Image, read_exr, write_exr};
use bdpm::output::denoise::{Validation, Window, denoise};
use bdpm::settings::PartialSettings;
use bdpm::{RenderJob, Stop};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box-classic");

fn run(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.args(arguments).stdin(Stdio::null());
    command
}

/// A small image at fixed counts, `more` being further arguments.
fn render(output: &Path, more: &[&str]) -> Output {
    let mut command = run(&["render", SCENE, "--accel", "bvh", "--json", "--quiet"]);
    command.args(["--light-paths", "300", "--camera-paths", "1", "--resolution", "40x30"]);
    command.arg("--output").arg(output).args(more).output().unwrap()
}

fn folder() -> (tempfile::TempDir, impl Fn(&str) -> PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_owned();
    (folder, move |name| path.join(name))
}

fn info(image: &Path) -> Value {
    json(&run(&["info", "--json"]).arg(image).output().unwrap())
}

fn names(image: &Image) -> Vec<&str> {
    let mut names: Vec<&str> = image.layers.iter().map(|layer| &layer.name[..]).collect();
    names.sort_unstable();
    names
}

const ALL: [&str; 11] = [
    "", "albedo", "alpha", "caustics", "depth", "direct", "emission", "indirect", "normal",
    "position", "rms",
];

#[test]
fn layers_are_those_that_are_asked_for_and_light_adds_up() {
    let (_folder, at) = folder();
    let path = at("a.exr");
    let choices: [(&[&str], Vec<&str>); 3] = [
        (&[], ALL.into()),
        (&["--layers", "none"], vec!["", "rms"]),
        (&["--layers", "depth,direct"], vec!["", "depth", "direct", "rms"]),
    ];
    let mut images = Vec::new();
    for (more, expected) in choices {
        json(&render(&path, &[&["--iterations", "3"][..], more].concat()));
        let image = read_exr(&path).unwrap();
        assert_eq!(names(&image), expected);
        images.push(image.layer("").unwrap().to_rgb().unwrap());
        if more.is_empty() {
            let light = ["emission", "direct", "indirect", "caustics"]
                .map(|name| image.layer(name).unwrap().to_rgb().unwrap());
            for (pixel, value) in images[0].iter().enumerate() {
                let sum: glam::Vec3 = light.iter().map(|light| light[pixel]).sum();
                assert!((sum - value).abs().max_element() <= 1e-5 * value.max_element(), "{pixel}");
            }
        }
    }
    assert!(images.iter().all(|image| *image == images[0]), "layers change no image");
}

#[test]
fn a_denoised_image_is_a_layer_with_its_error_and_a_resumed_one_is_the_same() {
    let (_folder, at) = folder();
    let [raw, whole, resumed] = ["raw.exr", "whole.exr", "resumed.exr"].map(&at);
    let checkpoint = at("c.ckpt").to_string_lossy().into_owned();
    json(&render(&raw, &["--iterations", "24"]));
    let report = json(&render(&whole, &["--iterations", "24", "--denoise"]));
    let error = &report["denoised"]["error"];
    assert_eq!(error["parts"], 8, "{report}");
    let (squared, raw_squared) =
        (error["squared"].as_f64().unwrap(), error["raw"].as_f64().unwrap());
    assert!(error["standard_error"].as_f64().unwrap() > 0.0 && squared < raw_squared, "{report}");
    let (plain, info) = (info(&raw), info(&whole));
    let stated = &info["bdpm"]["denoised_error"];
    assert_eq!(stated["total"], report["denoised"]["total_error"], "{info}");
    assert_eq!(stated["interval"], report["denoised"]["interval"], "{info}");
    assert!(stated["interval"]["high"].as_f64().unwrap() > 0.0, "{info}");
    assert!(plain["bdpm"]["denoised_error"].is_null(), "{plain}");
    let shown = run(&["info"]).arg(&whole).output().unwrap();
    let shown = succeed(&shown);
    assert!(shown.contains("denoised error    ") && shown.contains("before denoising"), "{shown}");
    let (raw, image) = (read_exr(&raw).unwrap(), read_exr(&whole).unwrap());
    let channels = |image: &Image, layer: &str| image.layer(layer).unwrap().channels.clone();
    assert_eq!(channels(&raw, ""), channels(&image, "noisy"), "the raw image is kept");
    assert_eq!(channels(&image, "denoised"), channels(&image, ""), "other programs show it");
    let mut expected = ALL.to_vec();
    expected.extend(["denoised", "denoised_error", "denoised_mix", "noisy"]);
    expected.sort_unstable();
    assert_eq!(names(&image), expected);
    assert_ne!(channels(&image, ""), channels(&raw, ""));
    // The preview is of what was denoised.
    let png = |path: &Path| std::fs::read(path.with_extension("png")).unwrap();
    assert_ne!(png(&at("raw.exr")), png(&whole));

    let begin = ["--iterations", "10", "--denoise", "--checkpoint", &checkpoint];
    json(&render(&resumed, &begin));
    let go_on = ["--iterations", "24", "--denoise", "--resume", &checkpoint];
    json(&render(&resumed, &go_on));
    let image = (image, read_exr(&resumed).unwrap());
    assert_eq!(image.0.layers, image.1.layers);
}

#[test]
fn denoiser_that_destroys_the_image_leaves_the_raw_image() {
    let loaded = bdpm::load(Path::new(SCENE)).unwrap();
    let settings = PartialSettings {
        resolution: Some([40, 30]),
        light_paths: Some(2000),
        camera_paths: Some(4),
        ..PartialSettings::default()
    };
    let stop = Stop::iterations(16);
    let aovs = AovSelection { folds: true, ..AovSelection::default() };
    let result = RenderJob::new(&loaded).settings(settings).stop(stop).aovs(aovs).render().unwrap();
    let image = result.state.image();
    for folds in [8, 4, 2] {
        let black = |_: Window, radiance: &[Rgb]| Ok(vec![Rgb::splat(1e-3); radiance.len()]);
        let delivered = denoise(&image, Validation::folds(folds), black).unwrap();
        let error = delivered.error.unwrap().whole;
        assert_eq!(error.folds, folds);
        assert!(error.unmixed > 4.0 * error.raw && error.squared <= error.raw, "{error:?}");
        assert!(error.raw_share > 0.9, "{error:?}");
        let perfect = |_: Window, _: &[Rgb]| Ok(result.image.clone());
        assert!(!denoise(&image, Validation::folds(folds), perfect).unwrap().is_raw);
    }
    let unknown =
        denoise(&image, Validation::folds(0), |_, radiance| Ok(radiance.to_vec())).unwrap();
    assert!(unknown.error.is_none());
}

/// A denoiser that leaves nothing leaves what pixels see of the lamp, and nothing of the light on
/// surfaces.
#[test]
fn light_sources_that_pixels_see_are_not_denoised() {
    let loaded = bdpm::load(Path::new(SCENE)).unwrap();
    let settings = PartialSettings {
        resolution: Some([40, 30]),
        light_paths: Some(500),
        camera_paths: Some(2),
        ..PartialSettings::default()
    };
    let aovs = AovSelection { folds: true, light: true, ..AovSelection::default() };
    let job = RenderJob::new(&loaded).settings(settings).stop(Stop::iterations(9)).aovs(aovs);
    let result = job.render().unwrap();
    let image = result.state.image();
    let mut given = Vec::new();
    let black = |_: Window, rest: &[Rgb]| {
        given = rest.to_vec();
        Ok(vec![Rgb::ZERO; rest.len()])
    };
    let left = denoise(&image, Validation::folds(0), black).unwrap().image;
    let film = &image.blocks()[0].film;
    let light = image.blocks()[0].statistics.light.as_ref().unwrap();
    let mut emission = vec![Rgb::ZERO; left.len()];
    film.sums.zip_pixels(&mut emission, |emission, at| {
        *emission = (light.at(at).next().unwrap().emission / 9.0).as_vec3();
    });
    let (mut lit, mut off) = (0, 0.0f32);
    for (((left, emission), given), raw) in left.iter().zip(&emission).zip(&given).zip(image.mean())
    {
        lit += usize::from(emission.x > 0.0);
        off = off.max((*left - *emission).abs().max_element() / raw.max_element().max(1.0));
        off = off.max((*given + *left - raw).abs().max_element() / raw.max_element().max(1.0));
    }
    assert!(lit > 5 && lit < left.len() / 4, "{lit} pixels see the lamp");
    assert!(off < 1e-5, "{off}");
}

#[test]
fn error_in_sampled_tiles_matches_the_error_of_the_whole_image() {
    let loaded = bdpm::load(Path::new(SCENE)).unwrap();
    let (width, height) = (400, 300);
    let settings = PartialSettings {
        resolution: Some([width, height]),
        light_paths: Some(500),
        camera_paths: Some(1),
        ..PartialSettings::default()
    };
    let aovs = AovSelection { folds: true, ..AovSelection::default() };
    let job = RenderJob::new(&loaded).settings(settings).stop(Stop::iterations(8));
    let result = job.aovs(aovs).render().unwrap();
    let image = result.state.image();
    // A blur along rows that is narrower than the margin of a tile stands in for the denoiser.
    let blur = |window: Window, radiance: &[Rgb]| {
        let columns = window.width as usize;
        let mean = |row: &[Rgb], x: usize| {
            let near = &row[x.saturating_sub(3)..(x + 4).min(columns)];
            near.iter().copied().sum::<Rgb>() / near.len() as f32
        };
        let row = |row: &[Rgb]| (0..columns).map(|x| mean(row, x)).collect::<Vec<_>>();
        Ok(radiance.chunks(columns).flat_map(row).collect())
    };
    let error = |validation| denoise(&image, validation, blur).unwrap().error.unwrap();
    for folds in [8, 2] {
        let whole = error(Validation::folds(folds)).whole;
        assert_eq!(whole.tiles, None);
        let seeds = 20;
        let (mut sum, mut squares, mut largest) = (0.0, 0.0, 0.0f64);
        for seed in 0..seeds {
            let sampled = error(Validation { folds, tiles: Some(5), seed });
            assert!(sampled.map.is_empty() && sampled.whole.tiles.unwrap() >= 4);
            let ratio = sampled.whole.unmixed / whole.unmixed;
            (sum, squares) = (sum + ratio, squares + ratio * ratio);
            largest =
                largest.max((ratio - 1.0).abs() * whole.unmixed / sampled.whole.unmixed_error);
        }
        let mean = sum / seeds as f64;
        let standard_error = ((squares / seeds as f64 - mean * mean) / seeds as f64).sqrt();
        assert!((mean - 1.0).abs() < 4.0 * standard_error, "{mean} +- {standard_error}");
        assert!(largest < 4.0, "{largest} standard errors");
    }
}

#[test]
fn layers_missing_from_a_checkpoint_are_refused() {
    let (_folder, at) = folder();
    let path = at("a.exr");
    let checkpoint = at("c.ckpt").to_string_lossy().into_owned();
    json(&render(&path, &["--iterations", "2", "--layers", "none", "--checkpoint", &checkpoint]));
    for (more, lacks) in [
        (&["--denoise"][..], "lacks the folds for the denoiser"),
        (&["--layers", "albedo"][..], "lacks some of the layers"),
    ] {
        let output =
            render(&path, &[&["--iterations", "3", "--resume", &checkpoint][..], more].concat());
        assert_refused(&output, lacks, "start a new image");
    }
    json(&render(&path, &["--iterations", "3", "--resume", &checkpoint]));
    assert_eq!(names(&read_exr(&path).unwrap()), ["", "rms"]);
}

#[test]
fn missing_denoiser_is_reported_before_rendering() {
    let (folder, at) = folder();
    let mut command = run(&["render", SCENE, "--denoise", "--quiet", "--output"]);
    let output = command.arg(at("a.exr")).env("OIDN_DIR", folder.path()).output().unwrap();
    assert_refused(&output, "OIDN_DIR", "unset it");
    assert!(!at("a.exr").exists());
}

#[test]
fn a_target_is_about_the_denoised_image() {
    let (_folder, at) = folder();
    let goal = ["--target-error", "6%", "--denoise"];
    let mut command =
        run(&["render", SCENE, "--accel", "bvh", "--json", "--quiet", "--resolution", "40x30"]);
    let report = json(&command.arg("--output").arg(at("a.exr")).args(goal).output().unwrap());
    assert_eq!(report["stopped_by"], "target", "{report}");
    // On a busy machine the raw image may reach the target before the error of the denoised one is
    // estimated, and is then the result.
    let denoised = &report["denoised"];
    let of_result = match denoised["is_raw"].as_bool().unwrap() {
        true => &report["error"]["total"],
        false => &denoised["total_error"],
    };
    let error = of_result.as_f64().unwrap_or_else(|| panic!("{report}"));
    assert!(error > 0.0 && error < 0.06, "{report}");
}

#[test]
fn any_image_is_denoised_and_unknown_errors_are_not_invented() {
    let (_folder, at) = folder();
    let (image, out, again) = (at("a.exr"), at("b.exr"), at("c.exr"));
    for (layers, guided) in [("all", true), ("none", false)] {
        json(&render(&image, &["--iterations", "4", "--layers", layers]));
        let mut command = run(&["denoise", "--json", "--output"]);
        let report = json(&command.arg(&out).arg(&image).output().unwrap());
        assert_eq!(report["guided"], guided);
        let (raw, denoised) = (read_exr(&image).unwrap(), read_exr(&out).unwrap());
        let channels = |image: &Image, layer: &str| image.layer(layer).unwrap().channels.clone();
        assert_eq!(channels(&denoised, "noisy"), channels(&raw, ""));
        assert_ne!(channels(&denoised, ""), channels(&raw, ""), "other programs show this layer");
        assert!(denoised.layers.iter().all(|layer| !layer.name.starts_with("denoised")));
        assert!(out.with_extension("png").exists());
        // Denoising again begins with the raw image.
        succeed(&run(&["denoise", "--output"]).arg(&again).arg(&out).output().unwrap());
        assert_eq!(read_exr(&again).unwrap().layers, denoised.layers);
    }
    // A smaller network makes another image.
    let fast = at("d.exr");
    let command = &mut run(&["denoise", "--quality", "fast", "--output"]);
    succeed(&command.arg(&fast).arg(&image).output().unwrap());
    let pixels = |path| read_exr(path).unwrap().layer("").unwrap().channels.clone();
    assert_ne!(pixels(&fast), pixels(&out));
    let output = run(&["denoise"]).arg(&image).output().unwrap();
    assert!(succeed(&output).contains("error is not known"));
    assert!(info(&out)["bdpm"]["denoised_error"].is_null());
    let shown = run(&["info"]).arg(&out).output().unwrap();
    assert!(succeed(&shown).contains("denoised error    not known"));
    assert!(at("a.denoised.exr").exists());
    let output = run(&["denoise", "--output"]).arg(&image).arg(&image).output().unwrap();
    assert_refused(&output, "--output", "");
}

/// The layer `emission` of a file of this program is kept. In a file without its metadata, a layer
/// of this name may be anything.
#[test]
fn emission_of_other_programs_is_not_kept() {
    let (_folder, at) = folder();
    let (image, changed, out) = (at("a.exr"), at("b.exr"), at("c.exr"));
    json(&render(&image, &["--iterations", "4", "--layers", "emission"]));
    let denoised = |is_own: bool, has_emission: bool| {
        let mut own = read_exr(&image).unwrap();
        own.layers.retain(|layer| has_emission || layer.name != "emission");
        if !is_own {
            own.metadata.clear();
        }
        write_exr(&changed, &own).unwrap();
        succeed(&run(&["denoise", "--output"]).arg(&out).arg(&changed).output().unwrap());
        read_exr(&out).unwrap().layer("").unwrap().channels.clone()
    };
    let plain = denoised(false, false);
    assert_eq!(denoised(true, false), plain);
    assert_eq!(denoised(false, true), plain);
    assert_ne!(denoised(true, true), plain, "pixels see the lamp");
}
