//! The program as its users meet it: files, streams, exit codes.

use bdpm::film::aov::AovSelection;
use bdpm::image_io::{Value, read_exr};
use bdpm::noise::Measure;
use bdpm::output::layers::LayerSelection;
use bdpm::scene::backend::Backend;
use bdpm::settings::PartialSettings;
use bdpm::{RenderJob, Stop};
use std::fs;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

pub const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");

/// A small, quick render.
const SMALL: [&str; 6] = ["--resolution", "24x18", "--light-paths", "500", "--camera-paths", "1"];

pub fn bdpm(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.args(arguments).stdin(Stdio::null());
    command
}

/// Renders the small scene with the BVH, which every build has.
pub fn render(output: &Path, more: &[&str]) -> Command {
    let mut command = bdpm(&["render", SCENE, "--accel", "bvh", "--output"]);
    command.arg(output).args(SMALL).args(more);
    command
}

pub fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

fn run(mut command: Command) -> Output {
    command.output().unwrap()
}

pub fn succeed(command: Command) -> Output {
    let output = run(command);
    assert!(output.status.success(), "{}", text(&output.stderr));
    output
}

/// Runs it, expecting exit code `code`, nothing on stdout and an error with help on stderr.
fn fail(command: Command, code: i32) -> String {
    let output = run(command);
    let shown = text(&output.stderr).to_owned();
    assert_eq!(output.status.code(), Some(code), "{shown}");
    assert!(output.stdout.is_empty(), "{}", text(&output.stdout));
    assert!(shown.lines().any(|line| line.starts_with("error: ")), "{shown}");
    assert!(shown.contains("help"), "{shown}");
    shown
}

pub fn json(output: &Output) -> serde_json::Value {
    let shown = text(&output.stdout);
    assert_eq!(shown.lines().count(), 1, "{shown}");
    serde_json::from_str(shown).unwrap()
}

/// Every channel's bits.
pub fn bits(path: &Path) -> Vec<u32> {
    let image = read_exr(path).unwrap();
    let channels = image.layers.iter().flat_map(|layer| &layer.channels);
    channels.flat_map(|(_, values)| values.iter().map(|value| value.to_bits())).collect()
}

pub fn folder() -> (TempDir, impl Fn(&str) -> PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_owned();
    (folder, move |name| path.join(name))
}

pub fn names(folder: &TempDir) -> Vec<String> {
    let entries = fs::read_dir(folder.path()).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_render_writes_both_images_and_says_how_it_was_made() {
    let (folder, at) = folder();
    let more = ["--iterations", "3", "--seed", "18446744073709551615", "--radius", "7.5", "--json"];
    let output = succeed(render(&at("a.exr"), &more));
    assert_eq!(names(&folder), ["a.exr", "a.png"]);

    let report = json(&output);
    assert_eq!(report["iterations"], 3);
    assert_eq!(report["stopped_by"], "iterations");
    assert_eq!(report["settings"]["seed"], u64::MAX);
    assert_eq!(report["settings"]["radius"], 7.5);
    assert_eq!(report["non_finite"], 0);
    assert_eq!(report["exr"], at("a.exr").to_str().unwrap());
    assert!(report["rays"].as_u64().unwrap() > 3 * 24 * 18);
    for phase in ["load", "build", "light", "camera", "merge", "render", "write"] {
        assert!(report["seconds"][phase].as_f64().unwrap() > 0.0, "{phase}");
    }

    let image = read_exr(&at("a.exr")).unwrap();
    assert_eq!((image.width, image.height), (24, 18));
    let pixels = image.layer("").unwrap().to_rgb().unwrap();
    let sum: f64 = pixels.iter().map(|p| f64::from(bdpm::base::math::luminance(*p))).sum();
    let mean = sum / pixels.len() as f64;
    let told = report["mean_luminance"].as_f64().unwrap();
    assert!(told > 0.0 && (mean / told - 1.0).abs() < 1e-5, "{mean} and {told}");
    for (name, expected) in [
        ("iterations", Value::Number(3.0)),
        ("light_paths", Value::Number(500.0)),
        ("camera_paths", Value::Number(1.0)),
        ("radius", Value::Number(7.5)),
        ("direct", Value::Text("connect".into())),
        ("seed", Value::Text(u64::MAX.to_string())),
        ("backend", Value::Text("bvh".into())),
        ("version", Value::Text(env!("CARGO_PKG_VERSION").into())),
    ] {
        assert_eq!(image.metadata.get(name), Some(&expected), "{name}");
    }
    assert!(image.metadata.contains_key("scene") && image.metadata.contains_key("fingerprint"));

    let png = png::Decoder::new(BufReader::new(fs::File::open(at("a.png")).unwrap()));
    let mut reader = png.read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((info.width, info.height), (24, 18));
    assert!(bytes.iter().any(|&byte| byte > 100), "the preview shows something");
}

#[test]
fn the_image_depends_on_the_seed_and_not_on_the_threads() {
    let (_folder, at) = folder();
    let image = |name: &str, threads: &str, seed: &str| {
        let more = ["--iterations", "2", "--threads", threads, "--seed", seed, "--quiet"];
        succeed(render(&at(name), &more));
        bits(&at(name))
    };
    let one = image("1.exr", "1", "5");
    assert_eq!(one, image("2.exr", "2", "5"));
    assert_eq!(one, image("3.exr", "3", "5"));
    assert_ne!(one, image("4.exr", "3", "6"));
}

#[test]
fn a_resumed_image_is_the_same_bit_for_bit() {
    let (_folder, at) = folder();
    let checkpoint = at("c.ckpt");
    let checkpoint = checkpoint.to_str().unwrap();
    succeed(render(&at("whole.exr"), &["--iterations", "5"]));
    succeed(render(&at("part.exr"), &["--iterations", "2", "--checkpoint", checkpoint]));
    let more = ["--iterations", "5", "--resume", checkpoint, "--threads", "3", "--json"];
    let report = json(&succeed(render(&at("rest.exr"), &more)));
    assert_eq!((&report["iterations"], &report["new_iterations"]), (&5.into(), &3.into()));
    assert_eq!(bits(&at("whole.exr")), bits(&at("rest.exr")));
    assert_ne!(bits(&at("whole.exr")), bits(&at("part.exr")));
    // Settings that are not given come from the checkpoint, the backend too.
    let mut bare = bdpm(&["render", SCENE, "--iterations", "5", "--resume", checkpoint]);
    bare.arg("--output").arg(at("bare.exr"));
    succeed(bare);
    assert_eq!(bits(&at("whole.exr")), bits(&at("bare.exr")));
    // Nothing is left to do for as many iterations as there are; fewer are impossible.
    succeed(render(&at("same.exr"), &["--iterations", "2", "--resume", checkpoint]));
    assert_eq!(bits(&at("part.exr")), bits(&at("same.exr")));
    let fewer = render(&at("x.exr"), &["--iterations", "1", "--resume", checkpoint]);
    assert!(fail(fewer, 1).contains("holds 2 iterations"));
}

/// What guides learn from is part of the settings: a resumed image and a replay learn again.
#[test]
fn a_guided_image_is_the_same_resumed_and_replayed() {
    let own: &[&str] = &["--strategy", "single", "--light-paths", "500"];
    let guide = ["--guide", "9"];
    let (_folder, at) = folder();
    let (straight, resumed, replayed) = (at("a.exr"), at("b.exr"), at("c.exr"));
    let (checkpoint, plan) = (at("a.ckpt"), straight.to_string_lossy().into_owned());
    let checkpoint = checkpoint.to_str().unwrap();
    let small = ["--resolution", "24x18", "--camera-paths", "1", "--seed", "4"];
    let plain = [own, &small].concat();
    let guided = [&plain[..], &guide].concat();
    let render = |image: &Path, settings: &[&str], more: &[&str]| {
        let mut command = bdpm(&["render", SCENE, "--accel", "bvh", "--output"]);
        command.arg(image).args(settings).args(more);
        succeed(command)
    };
    render(&straight, &guided, &["--iterations", "6"]);
    render(&resumed, &guided, &["--iterations", "3", "--checkpoint", checkpoint]);
    let resume = ["--resume", checkpoint, "--iterations", "6", "--threads", "1"];
    render(&resumed, &[], &resume);
    assert_eq!(bits(&straight), bits(&resumed));
    render(&replayed, &[], &["--plan", &plan, "--threads", "1"]);
    assert_eq!(bits(&straight), bits(&replayed));
    render(&replayed, &plain, &["--iterations", "6"]);
    assert_ne!(bits(&straight), bits(&replayed));
}

#[test]
fn noise_is_measured_on_the_way_and_kept_by_checkpoints() {
    let (_folder, at) = folder();
    let noise = |name: &str| at(name).to_str().unwrap().to_owned();
    let (whole, half, rest) = (noise("whole.n.exr"), noise("half.n.exr"), noise("rest.n.exr"));
    let checkpoint = noise("a.ckpt");
    let two = ["--camera-paths", "2"];
    let begin = |name: &str, more: &[&str]| {
        let mut command = bdpm(&["render", SCENE, "--accel", "bvh", "--resolution", "12x10"]);
        command.args(["--light-paths", "300", "--output"]).arg(at(name)).args(more);
        command
    };
    let output = succeed(begin(
        "whole.exr",
        &[&two[..], &["--iterations", "40", "--noise", &whole, "--json"]].concat(),
    ));
    let start = [&two[..], &["--iterations", "13", "--noise", &half]].concat();
    succeed(begin("half.exr", &[&start[..], &["--checkpoint", &checkpoint]].concat()));
    let go_on = ["--resume", &checkpoint, "--iterations", "40", "--noise", &rest];
    succeed(begin("rest.exr", &go_on));
    assert_eq!(bits(&at("whole.exr")), bits(&at("rest.exr")));
    assert_eq!(bits(Path::new(&whole)), bits(Path::new(&rest)));

    // The rms layer: pooled squares, so its mean square is that of the image but for the border.
    let image = read_exr(&at("whole.exr")).unwrap();
    let rms = image.layer("rms").unwrap().channel("Y").unwrap();
    let told = json(&output)["rms"].as_f64().unwrap();
    let square: f64 = rms.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>() / 120.0;
    assert!(told > 0.0 && (square.sqrt() / told - 1.0).abs() < 0.3, "{square} {told}");

    // Without --noise the checkpoint keeps sums by tile only; with one camera path there are none.
    let plain = noise("plain.ckpt");
    let small = [&two[..], &["--iterations", "2", "--checkpoint", &plain]].concat();
    succeed(begin("plain.exr", &small));
    let shown = fail(begin("b.exr", &["--resume", &plain, "--noise", &rest]), 1);
    assert!(shown.contains("lacks the noise of single pixels"), "{shown}");
    let shown = fail(begin("b.exr", &["--camera-paths", "1", "--noise", &rest]), 1);
    assert!(shown.contains("cannot measure the noise with 1 camera path"), "{shown}");
}

#[test]
fn another_image_is_not_continued() {
    let (_folder, at) = folder();
    let checkpoint = at("c.ckpt");
    let checkpoint = checkpoint.to_str().unwrap();
    succeed(render(&at("a.exr"), &["--iterations", "1", "--checkpoint", checkpoint]));
    let plan = at("a.exr");
    let plan = plan.to_str().unwrap();
    for (flag, value, expected) in [
        ("--seed", "77", "seed is 1, not 77"),
        ("--radius", "3", "not 3"),
        ("--merge-vertex", "1", "merge-vertex is 2, not 1"),
        ("--direct", "photon-map", "not \"photon-map\""),
    ] {
        let shown = fail(render(&at("b.exr"), &["--resume", checkpoint, flag, value]), 1);
        assert!(shown.contains(expected) && shown.contains("c.ckpt"), "{shown}");
    }
    for (option, file, advice) in
        [("--resume", checkpoint, "start a new image"), ("--plan", plan, "without a plan")]
    {
        let classic = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box-classic");
        let mut other = bdpm(&["render", classic, "--output"]);
        other.arg(at("b.exr")).args([option, file]);
        let shown = fail(other, 1);
        assert!(shown.contains("its scene is `cornell-box`"), "{shown}");
        assert!(shown.contains(advice), "{shown}");
        assert_eq!(shown.contains("resum"), option == "--resume", "{shown}");
    }
    fs::write(at("notes.txt"), "no checkpoint").unwrap();
    let foreign = render(&at("b.exr"), &["--resume", at("notes.txt").to_str().unwrap()]);
    assert!(fail(foreign, 1).contains("notes.txt: this is not a checkpoint"));
    assert!(!at("b.exr").exists());
}

#[test]
fn compare_distinguishes_equal_from_different_images() {
    let (_folder, at) = folder();
    succeed(render(&at("a.exr"), &["--iterations", "1"]));
    succeed(render(&at("b.exr"), &["--iterations", "1", "--seed", "2"]));
    let compare = |a: &str, b: &str, more: &[&str]| {
        let mut command = bdpm(&["compare"]);
        command.arg(at(a)).arg(at(b)).args(more);
        command
    };
    let same = json(&succeed(compare("a.exr", "a.exr", &["--json"])));
    assert_eq!((&same["rmse"], &same["max_difference"]), (&0.0.into(), &0.0.into()));
    assert_eq!(same["mean_ratio"], 1.0);
    let other = json(&succeed(compare("a.exr", "b.exr", &["--json"])));
    assert!(other["rmse"].as_f64().unwrap() > 0.0 && other["relative_mse"].as_f64().unwrap() > 0.0);
    let shown = succeed(compare("a.exr", "a.exr", &[]));
    assert!(text(&shown.stdout).contains("the images are equal"), "{}", text(&shown.stdout));

    let mut wide = bdpm(&["render", SCENE, "--resolution", "25x18", "--iterations", "1"]);
    wide.args(["--accel", "bvh", "--light-paths", "500", "--output"]).arg(at("wide.exr"));
    succeed(wide);
    let shown = fail(compare("a.exr", "wide.exr", &["--json"]), 1);
    assert!(shown.contains("24x18 and 25x18"), "{shown}");
    assert!(fail(compare("a.exr", "none.exr", &[]), 1).contains("none.exr"));
    assert!(fail(compare("a.exr", "a.png", &[]), 1).contains("a.png"));
}

#[test]
fn output_problems_are_found_before_rendering() {
    let (folder, at) = folder();
    fs::create_dir(at("folder.exr")).unwrap();
    fs::create_dir(at("b.png")).unwrap();
    fs::write(at("old.jpg"), "old").unwrap();
    fs::write(at("old.exr"), "old").unwrap();
    let before = names(&folder);
    // Rendering would take days; only a check before it can fail.
    let refuse = |name: &str, more: &[&str], expected: &str| {
        let mut command = render(&at(name), &["--time", "10days"]);
        command.args(more);
        let shown = fail(command, 1);
        assert!(shown.contains(expected), "{name}: {shown}");
    };
    refuse("missing/a.exr", &[], "missing");
    refuse("folder.exr", &[], "is a folder");
    refuse("b.exr", &[], "b.png");
    refuse("old.jpg", &[], "does not end in .exr");
    refuse("old.exr", &["--checkpoint", at("none/c").to_str().unwrap()], "none/c");
    refuse("old.exr", &["--checkpoint", at("old.exr").to_str().unwrap()], "the same file");
    refuse("old.exr", &["--resume", at("none").to_str().unwrap()], "cannot read");
    assert_eq!(names(&folder), before);
    assert_eq!(fs::read(at("old.jpg")).unwrap(), b"old");
    assert_eq!(fs::read(at("old.exr")).unwrap(), b"old");
}

#[test]
fn quiet_is_quiet_and_json_is_alone_on_stdout() {
    let (_folder, at) = folder();
    let quiet = succeed(render(&at("a.exr"), &["--iterations", "1", "--quiet"]));
    assert!(quiet.stdout.is_empty() && quiet.stderr.is_empty());
    let both = succeed(render(&at("a.exr"), &["--iterations", "1", "--quiet", "--json"]));
    assert!(both.stderr.is_empty(), "{}", text(&both.stderr));
    assert_eq!(json(&both)["new_iterations"], 1);
    let plain = succeed(render(&at("a.exr"), &["--iterations", "1"]));
    assert!(text(&plain.stdout).contains("a.exr") && text(&plain.stdout).ends_with('\n'));
    assert!(!text(&plain.stderr).contains('\x1b'), "no terminal codes in a pipe");
}

#[test]
fn info_describes_the_scene_and_the_settings() {
    let more = ["info", SCENE, "--accel", "bvh", "--radius", "1%", "--direct", "photon-map"];
    let shown = succeed(bdpm(&more));
    for part in ["triangles", "backend", "lights", "camera", "bounds", "photon-map"] {
        assert!(text(&shown.stdout).contains(part), "{part}: {}", text(&shown.stdout));
    }
    // Settings that automatic rendering chooses are left out, unless an option fixes them.
    let has_row = |name: &str| text(&shown.stdout).lines().any(|line| line.starts_with(name));
    assert!(["width", "height", "seed", "radius", "direct"].into_iter().all(has_row));
    assert!(!["light paths", "caustic radius", "strategy", "guide"].into_iter().any(has_row));
    let report = json(&succeed(bdpm(&[&more[..], &["--json"]].concat())));
    assert_eq!(report["settings"]["strategy"], "single");
    let size = report["size"].as_f64().unwrap();
    let radius = report["settings"]["radius"].as_f64().unwrap();
    assert!((radius / (0.01 * size) - 1.0).abs() < 1e-6, "{radius} of {size}");
    assert!(report["accel"]["bytes"].as_u64().unwrap() > 0);
    assert_eq!(report["accel"]["triangles"], report["triangles"]);
}

#[test]
fn wrong_usage_has_exit_code_2_and_help() {
    let (_folder, at) = folder();
    for (flag, value) in [
        ("--resolution", "12"),
        ("--iterations", "0"),
        ("--iterations", "x"),
        ("--time", "soon"),
        ("--time", "0s"),
        ("--threads", "0"),
        ("--radius", "-1"),
        ("--radius", "0%"),
        ("--direct", "guess"),
        ("--strategy", "russian"),
        ("--accel", "gpu"),
    ] {
        let mut command = bdpm(&["render", SCENE, flag, value, "--output"]);
        command.arg(at("a.exr"));
        assert!(fail(command, 2).contains(value), "{flag}");
    }
    // A plan has counts of its own.
    fail(render(&at("a.exr"), &["--plan", "b.exr"]), 2);
    assert!(!at("a.exr").exists());
}

#[test]
fn renderer_errors_have_help() {
    let (_folder, at) = folder();
    let refuse = |more: &[&str], expected: &str| {
        let mut command = bdpm(&["render", SCENE, "--accel", "bvh", "--json", "--output"]);
        command.arg(at("a.exr")).args(more);
        let shown = fail(command, 1);
        assert!(shown.contains(expected), "{shown}");
    };
    refuse(&["--camera-paths", "0"], "0 camera paths");
    refuse(&["--resolution", "0x5"], "0x5");
    refuse(&["--merge-vertex", "1000"], "1000");
    let mut missing = bdpm(&["render", "no/such/scene.toml", "--output"]);
    missing.arg(at("a.exr"));
    assert!(fail(missing, 1).contains("no/such/scene.toml"));
    assert!(!at("a.exr").exists());
}

#[cfg(not(feature = "embree"))]
#[test]
fn a_program_without_embree_says_so() {
    let shown = fail(bdpm(&["info", SCENE, "--accel", "embree"]), 1);
    assert!(shown.contains("built without Embree") && shown.contains("backend bvh"), "{shown}");
}

#[cfg(unix)]
#[test]
fn a_reader_that_goes_away_is_no_panic() {
    let mut command = bdpm(&["info", SCENE, "--accel", "bvh"]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(!text(&output.stderr).contains("panic"), "{}", text(&output.stderr));
}

#[test]
fn image_and_noise_files_of_the_library_are_those_of_the_program() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    let counts = ["--resolution", "24x18", "--light-paths", "500", "--camera-paths", "2"];
    for (subcommand, name) in [("render", "image.exr"), ("analyze", "noise.exr")] {
        let mut command = bdpm(&[subcommand, SCENE, "--accel", "bvh", "--iterations", "4"]);
        command.args(counts).arg("--output").arg(at(name));
        succeed(command);
    }
    let settings = PartialSettings {
        resolution: Some([24, 18]),
        light_paths: Some(500),
        camera_paths: Some(2),
        ..PartialSettings::default()
    };
    let loaded = bdpm::load(SCENE).unwrap();
    let layers = LayerSelection::new(&[]);
    let job = RenderJob::new(&loaded)
        .settings(settings)
        .backend(Some(Backend::Bvh))
        .stop(Stop::iterations(4))
        .aovs(layers.aovs());
    let image = job.clone().render().unwrap().to_image_file(&layers);
    let measured = job.aovs(AovSelection::default()).measure_always(Measure::Pairs);
    let noise = measured.render().unwrap().noise_file(Measure::Pairs).unwrap().to_image();
    for (name, own) in [("image.exr", image), ("noise.exr", noise)] {
        let written = read_exr(&at(name)).unwrap();
        assert_eq!(own.metadata, written.metadata, "{name}");
        assert_eq!(own.layers.len(), written.layers.len(), "{name}");
        for layer in &own.layers {
            let other = written.layer(&layer.name).unwrap();
            for (channel, values) in &layer.channels {
                assert_eq!(other.channel(channel), Some(&values[..]), "{name}: {}", layer.name);
            }
        }
    }
}

/// A sheet just above a floor: discs leak light between them, and areas do not.
#[test]
fn discs_among_near_layers_are_noted() {
    let (folder, at) = folder();
    let file = folder.path().join("layers.obj");
    let sheet = |y: f32, half: f32| {
        format!(
            "v -{half} {y} -{half}\nv -{half} {y} {half}\nv {half} {y} {half}\nv {half} {y} -{half}\n"
        )
    };
    let obj = format!("{}{}f 1 2 3 4\nf 5 6 7 8\n", sheet(0.0, 2.0), sheet(0.001, 1.0));
    std::fs::write(&file, obj).unwrap();
    for (kernel, is_noted) in [("disc", true), ("area", false)] {
        let mut command = bdpm(&["render", file.to_str().unwrap(), "--look-at", "0,3,0.1,0,0,0"]);
        command.args(["--environment", "1", "--iterations", "1", "--resolution", "8x8"]);
        command.args(["--kernel", kernel, "--output"]).arg(at("a.exr"));
        let output = command.output().unwrap();
        let shown = text(&output.stderr);
        assert!(output.status.success(), "{shown}");
        assert_eq!(shown.contains("discs leak light"), is_noted, "{kernel}: {shown}");
    }
}
