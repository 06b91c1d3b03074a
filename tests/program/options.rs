//! Options of `bdpm render` for a window, files and descriptions, and commands for shells and
//! manuals.

use super::render::{SCENE, bdpm, bits, folder, json, names, succeed, text};
use crate::common::program_output::assert_refused;
use bdpm::image_io::{Value, read_exr};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

const SMALL: [&str; 8] =
    ["--accel", "bvh", "--resolution", "24x18", "--light-paths", "300", "--camera-paths", "2"];

/// Renders the small scene in `folder`.
fn render(folder: &Path, more: &[&str]) -> Command {
    let mut command = bdpm(&["render", SCENE]);
    command.current_dir(folder).args(SMALL).args(more);
    command
}

fn output(mut command: Command) -> Output {
    command.output().unwrap()
}

/// Asserts that the command line is refused with these words.
fn assert_wrong_usage(command: Command, words: &str) {
    let output = output(command);
    let shown = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{shown}");
    assert!(shown.contains(words), "{shown}");
}

#[test]
fn default_output_is_named_after_the_scene_in_the_current_folder() {
    let (folder, at) = folder();
    let report = json(&succeed(render(folder.path(), &["--iterations", "1", "--json"])));
    assert_eq!(
        (&report["exr"], &report["png"]),
        (&"cornell-box.exr".into(), &"cornell-box.png".into())
    );
    assert_eq!(names(&folder), ["cornell-box.exr", "cornell-box.png"]);
    // An environment map of this name is an input, which is not replaced.
    fs::rename(at("cornell-box.exr"), at("room.exr")).unwrap();
    let scene = Path::new(SCENE).join("cornell-box.obj");
    fs::copy(scene, at("room.obj")).unwrap();
    let before = fs::read(at("room.exr")).unwrap();
    let mut command = bdpm(&["render", "room.obj", "--environment", "room.exr"]);
    // Without notes about what the scene lacks
    command.current_dir(folder.path()).args(SMALL).args(["--iterations", "1", "--quiet"]);
    assert_refused(&output(command), "--output would replace a file that was read", "give");
    assert_eq!(fs::read(at("room.exr")).unwrap(), before);
}

/// A picture's name stands for the image beside it, and a region is a crop.
#[test]
fn pictures_and_regions_are_named_as_elsewhere() {
    let (folder, at) = folder();
    let own = ["--iterations", "1", "--region", "2,3,8,6", "--output", "box.png", "--json"];
    let report = json(&succeed(render(folder.path(), &own)));
    assert_eq!((&report["exr"], &report["png"]), (&"box.exr".into(), &"box.png".into()));
    assert_eq!(names(&folder), ["box.exr", "box.png"]);
    let image = read_exr(&at("box.exr")).unwrap();
    assert_eq!((image.width, image.height), (8, 6));
}

/// Only commands that have the option name it.
#[test]
fn notes_about_the_default_camera_name_the_option_that_places_it() {
    let (_folder, at) = folder();
    let scene = Path::new(SCENE).join("cornell-box.obj");
    let scene = scene.to_str().unwrap();
    let path = at("a.exr");
    let image = path.to_str().unwrap();
    let notes = |arguments: &[&str]| text(&output(bdpm(arguments)).stderr).to_owned();
    let few = [&["render", scene, "--output", image, "--iterations", "1"][..], &SMALL].concat();
    let shown = notes(&few);
    assert!(shown.contains("no camera; added one") && shown.contains("--look-at"), "{shown}");
    let shown = notes(&["compare", image, "--scene", scene, "--time", "0.1"]);
    assert!(shown.contains("no camera; added one") && !shown.contains("--look-at"), "{shown}");
}

#[test]
fn crop_renders_a_window_of_the_full_image() {
    let (folder, at) = folder();
    let crop = ["--crop", "5,4,10,8", "--iterations", "2", "--json"];
    let report =
        json(&succeed(render(folder.path(), &[&crop[..], &["--output", "a.exr"]].concat())));
    let settings = &report["settings"];
    assert_eq!((&settings["width"], &settings["height"]), (&10.into(), &8.into()));
    assert_eq!(settings["crop"], "at 5,4 of 24x18");
    let image = read_exr(&at("a.exr")).unwrap();
    assert_eq!((image.width, image.height), (10, 8));
    assert_eq!(image.metadata["crop"], Value::Text("at 5,4 of 24x18".into()));
    // The first surfaces are those of the full image: depths differ by the jitter within pixels
    // only.
    succeed(render(folder.path(), &["--iterations", "2", "--output", "full.exr"]));
    let depth = |name: &str| {
        let image = read_exr(&at(name)).unwrap();
        image.layer("depth").unwrap().channel("Z").unwrap().to_vec()
    };
    let (part, full) = (depth("a.exr"), depth("full.exr"));
    let near = (0..80).filter(|i| {
        let (x, y) = (i % 10 + 5, i / 10 + 4);
        (part[*i] / full[y * 24 + x] - 1.0).abs() < 0.05
    });
    assert!(near.count() > 60, "{part:?}");
    // The whole image is no crop.
    let whole = ["--crop", "0,0,24,18", "--iterations", "2", "--output", "whole.exr"];
    succeed(render(folder.path(), &whole));
    assert_eq!(bits(&at("whole.exr")), bits(&at("full.exr")));
}

#[test]
fn images_of_different_crops_are_not_mixed() {
    let (folder, at) = folder();
    let run = |more: &[&str]| output(render(folder.path(), more));
    let begin =
        ["--crop", "5,4,10,8", "--iterations", "2", "--checkpoint", "a.ckpt", "--output", "a.exr"];
    assert!(run(&begin).status.success());
    let resume = |crop: &[&str]| {
        let more = ["--resume", "a.ckpt", "--iterations", "3", "--output", "b.exr"];
        run(&[&more[..], crop].concat())
    };
    assert_refused(&resume(&["--crop", "6,4,10,8"]), "its crop is \"at 5,4 of 24x18\"", "resume");
    // Without a crop of its own, the render continues that of the checkpoint.
    let same: [&[&str]; 2] = [&[], &["--crop", "5,4,10,8"]];
    for crop in same {
        assert!(resume(crop).status.success());
        assert_eq!(read_exr(&at("b.exr")).unwrap().width, 10);
    }
    let mut plan = bdpm(&["render", SCENE, "--plan", "a.exr", "--crop", "1,1,10,8"]);
    plan.current_dir(folder.path());
    assert_refused(&output(plan), "this plan is for another image", "scene and settings");
    let mut plan = bdpm(&["render", SCENE, "--plan", "a.exr", "--output", "c.exr"]);
    plan.current_dir(folder.path());
    succeed(plan);
    assert_eq!(bits(&at("c.exr")), bits(&at("a.exr")));
    for (part, crop) in [("1/2", "5,4,10,8"), ("2/2", "6,4,10,8")] {
        let file = format!("{}.ckpt", &part[..1]);
        let more = ["--part", part, "--crop", crop, "--iterations", "4", "--checkpoint", &file];
        assert!(run(&more).status.success());
    }
    let mut merge = bdpm(&["merge", "1.ckpt", "2.ckpt", "--output", "m.exr"]);
    merge.current_dir(folder.path());
    assert_refused(&output(merge), "no part of the same image: its crop", "same settings");
}

#[test]
fn bad_values_and_conflicts_are_refused_before_rendering() {
    let (folder, _) = folder();
    let refuse = |more: &[&str], words: &str| {
        assert_wrong_usage(render(folder.path(), more), words);
    };
    for bad in ["1,2,3", "1,2,3,4,5", "1,2,0,4", "1,2,3,0", "-1,2,3,4", "a,2,3,4", ""] {
        refuse(&["--crop", bad], "--crop <X,Y,W,H>");
    }
    for outside in ["20,4,5,8", "5,11,10,8", "4000000000,0,4000000000,1"] {
        let refused = output(render(folder.path(), &["--crop", outside]));
        assert_refused(&refused, "not within 24x18 pixels", "crop within the resolution");
    }
    refuse(&["--exposure", "bright"], "--exposure <STOPS>");
    refuse(&["--exposure", "inf"], "--exposure <STOPS>");
    refuse(&["--tonemap", "aces"], "[possible values: srgb, agx, filmic]");
    refuse(&["--exr-compression", "dwaa"], "[possible values: none, rle, zips, zip, piz]");
    refuse(&["--verbose", "--quiet"], "cannot be used with");
    let part = output(render(folder.path(), &["--part", "1/2", "--iterations", "4"]));
    assert_refused(&part, "a part needs a checkpoint", "--checkpoint part.ckpt");
    assert!(names(&folder).is_empty());
}

#[test]
fn preview_follows_tone_curve_and_exposure_and_the_image_does_not() {
    let (folder, at) = folder();
    let pixels = |more: &[&str]| {
        let fixed = ["--iterations", "2", "--output", "a.exr"];
        succeed(render(folder.path(), &[&fixed[..], more].concat()));
        let file = std::io::BufReader::new(fs::File::open(at("a.png")).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        (bytes, bits(&at("a.exr")))
    };
    let (plain, image) = pixels(&[]);
    let sum = |bytes: &[u8]| bytes.iter().map(|&byte| u32::from(byte)).sum::<u32>();
    let (brighter, same) = pixels(&["--exposure", "1"]);
    assert!(sum(&brighter) > sum(&plain) && same == image);
    let (darker, same) = pixels(&["--exposure", "-1"]);
    assert!(sum(&darker) < sum(&plain) && same == image);
    let mut seen = vec![plain.clone()];
    for curve in ["agx", "filmic"] {
        let (bytes, same) = pixels(&["--tonemap", curve]);
        assert!(!seen.contains(&bytes) && same == image, "{curve}");
        seen.push(bytes);
    }
    assert!(pixels(&["--tonemap", "srgb", "--exposure", "0"]).0 == plain);
}

#[test]
fn half_precision_and_compressions_keep_the_image() {
    let (folder, at) = folder();
    let render = |name: &str, more: &[&str]| {
        let fixed = ["--iterations", "4", "--output", name];
        succeed(render(folder.path(), &[&fixed[..], more].concat()));
        fs::metadata(at(name)).unwrap().len()
    };
    let full = render("full.exr", &[]);
    for compression in ["none", "rle", "zips", "zip", "piz"] {
        let size = render("a.exr", &["--exr-compression", compression]);
        assert_eq!(bits(&at("a.exr")), bits(&at("full.exr")), "{compression}");
        assert!(compression != "none" || size > full, "{size}");
    }
    assert!(render("half.exr", &["--half"]) < full);
    let [half, full] = ["half.exr", "full.exr"].map(|name| read_exr(&at(name)).unwrap());
    assert_eq!(half.metadata, full.metadata);
    for (a, b) in half.layers.iter().zip(&full.layers) {
        let is_color = a.channel("R").is_some();
        for ((_, a), (_, b)) in a.channels.iter().zip(&b.channels) {
            // 11 bits of precision, and subnormal numbers below 6e-5
            let near = |(a, b): (&f32, &f32)| (a - b).abs() <= b.abs() / 2048.0 + 6e-8;
            assert!(a.iter().zip(b).all(near));
            assert!(is_color || a == b);
        }
    }
    // The plan of a half image repeats the full image.
    let mut again = bdpm(&["render", SCENE, "--plan", "half.exr", "--output", "again.exr"]);
    again.current_dir(folder.path());
    succeed(again);
    assert_eq!(bits(&at("again.exr")), bits(&at("full.exr")));
}

#[test]
fn dry_run_describes_the_render_and_writes_nothing() {
    let (folder, at) = folder();
    let dry = |more: &[&str]| {
        let output = succeed(render(folder.path(), &[more, &["--dry-run"]].concat()));
        assert!(names(&folder).is_empty(), "{more:?}");
        text(&output.stdout).to_owned()
    };
    let shown = dry(&["--iterations", "8", "--crop", "5,4,10,8"]);
    for part in [
        "10x8 pixels, at 5,4 of 24x18",
        "merging at vertex",
        "300 light paths, 2 camera paths per pixel",
        "after 8 iterations",
        "MiB for the image",
        "cornell-box.exr and cornell-box.png",
        "nothing was rendered",
    ] {
        assert!(shown.contains(part), "{part}: {shown}");
    }
    let path = dry(&["--iterations", "8", "--strategy", "path"]);
    assert!(path.contains(" 2 camera paths per pixel") && !path.contains("light paths"), "{path}");
    let shown = dry(&["--time", "3s", "--output", "new.exr", "--checkpoint", "c.ckpt"]);
    assert!(shown.contains("after 3.0s") && shown.contains("new.exr"), "{shown}");
    // A plain number is seconds.
    let shown = dry(&["--time", "2.5", "--output", "new.exr"]);
    assert!(shown.contains("after 2.5s"), "{shown}");
    let mut automatic = bdpm(&["render", SCENE, "--dry-run", "--json", "--report", "r.html"]);
    automatic.current_dir(folder.path());
    let report = json(&succeed(automatic));
    assert_eq!((&report["automatic"], &report["target_error"]), (&true.into(), &0.01.into()));
    assert_eq!(report["chosen_by_pilot"][0], "strategy");
    assert!(report["memory"].as_f64().unwrap() > 0.0 && report["seconds"].is_null(), "{report}");
    assert!(names(&folder).is_empty());
    // Problems are found as before a render.
    let crop = output(render(folder.path(), &["--dry-run", "--crop", "0,0,99,99"]));
    assert_refused(&crop, "not within 24x18 pixels", "crop");
    let to = at("none/a.exr");
    let refused = output(render(folder.path(), &["--dry-run", "--output", to.to_str().unwrap()]));
    assert_eq!(refused.status.code(), Some(1));
}

#[test]
fn verbose_dry_run_shows_known_settings_with_their_origin() {
    let (folder, _) = folder();
    let shown = |arguments: &[&str]| {
        let mut command = bdpm(&["render", SCENE, "--accel", "bvh", "--dry-run", "-v"]);
        command.current_dir(folder.path()).args(arguments);
        text(&succeed(command).stderr).to_owned()
    };
    let fixed = shown(&["--iterations", "8", "--resolution", "24x18"]);
    for part in ["settings of the command line: ", "width 24", "strategy single", "seed 1"] {
        assert!(fixed.contains(part), "{part}: {fixed}");
    }
    // Settings that are not chosen yet have no value to show.
    let open = shown(&["--time", "3s", "--radius", "2"]);
    assert!(open.contains("settings of the command line: radius 2.0\n"), "{open}");
    assert!(open.contains("seed 1") && !open.contains("strategy"), "{open}");
    assert!(names(&folder).is_empty());
}

#[test]
fn options_of_other_renderers_are_answered_with_ours() {
    let render = |more: &[&str]| bdpm(&[&["render", SCENE][..], more].concat());
    for option in ["--spp", "--samples", "--samples-per-pixel"] {
        for words in ["use `--time`", "`--camera-paths` fixes"] {
            assert_wrong_usage(render(&[option, "64"]), words);
        }
    }
    for option in ["--width", "--height=480", "--size"] {
        assert_wrong_usage(render(&[option, "640"]), "use `--resolution WxH`");
    }
    assert_wrong_usage(bdpm(&["box.glb"]), "did you mean `bdpm render box.glb`?");
    assert_wrong_usage(bdpm(&[SCENE]), "did you mean `bdpm render ");
    // Where there is nothing to tell, clap's own tips remain.
    assert_wrong_usage(render(&["--tim", "3s"]), "a similar argument exists: '--time'");
    assert_wrong_usage(bdpm(&["rendr"]), "a similar subcommand exists: 'render'");
}

#[test]
fn help_states_the_defaults_of_the_command() {
    let entry = |subcommand: &str, option: &str| {
        let help = succeed(bdpm(&[subcommand, "--help"]));
        let help = text(&help.stdout);
        let start = format!("--{option} <");
        let (_, rest) = help.split_once(&start).unwrap_or_else(|| panic!("{subcommand} {option}"));
        rest.split("\n      --").next().unwrap().to_owned()
    };
    assert!(entry("render", "time").contains("[default: no limit]"));
    assert!(entry("render", "target-error").contains("[default: 1%, none with another limit]"));
    for (option, fixed) in [
        ("strategy", "single"),
        ("light-paths", "scene file, else 100000"),
        ("camera-paths", "scene file, else 4"),
        ("radius", "0.5%"),
        ("caustic-radius", "a quarter of --radius"),
        ("sobol-set", "1"),
        ("splitting", "1"),
        ("bias", "reduce if radii are chosen, else keep"),
        ("direct", "connect"),
        ("merge-vertex", "2"),
        ("guide", "0"),
        ("light-visibility", "0"),
    ] {
        for subcommand in ["render", "info"] {
            let help = entry(subcommand, option);
            assert!(help.contains("[default: chosen]"), "{subcommand} {option}: {help}");
        }
        // The pilot does not choose discs.
        assert!(entry("render", "kernel").contains("[default: area]"));
        // `analyze` renders with the settings as they are.
        let help = entry("analyze", option);
        assert!(help.contains(&format!("[default: {fixed}]")), "analyze {option}: {help}");
    }
}

#[test]
fn verbose_render_reports_settings_with_their_origin_and_times() {
    let (folder, _) = folder();
    let shown = succeed(render(folder.path(), &["--iterations", "2", "--verbose"]));
    let shown = text(&shown.stderr);
    for part in [
        "read the scene in ",
        "settings of the command line: ",
        "light paths 300",
        "settings of the scene file: ",
        "default settings: ",
        "iteration 1, after ",
        "times: reading ",
    ] {
        assert!(shown.contains(part), "{part}: {shown}");
    }
    let mut automatic = bdpm(&["render", SCENE, "--accel", "bvh", "--resolution", "16x12"]);
    automatic.current_dir(folder.path()).args(["--time", "500ms", "-v"]);
    let shown = succeed(automatic);
    let shown = text(&shown.stderr);
    assert!(shown.contains("\nchosen: ") && shown.contains("settings of the pilot: "), "{shown}");
}

#[test]
fn render_minimizes_every_objective_of_optimize() {
    let (folder, _) = folder();
    for objective in ["relative", "pooled", "mean-rms", "max-rms"] {
        let mut command = bdpm(&["render", SCENE, "--accel", "bvh", "--resolution", "16x12"]);
        command.current_dir(folder.path());
        command.args(["--time", "500ms", "--json", "--quiet", "--objective", objective]);
        let report = json(&succeed(command));
        assert_eq!(report["automatic"], true, "{objective}");
        assert!(report["mean_luminance"].as_f64().unwrap() > 0.0, "{objective}: {report}");
    }
    let default = |subcommand: &str| {
        let help = succeed(bdpm(&[subcommand, "--help"]));
        let help = text(&help.stdout).to_owned();
        let values = help.split("--objective <OBJECTIVE>").nth(1).unwrap();
        values.split_inclusive("[default: relative]").next().unwrap().to_owned()
    };
    assert_eq!(default("render"), default("optimize"));
}

#[test]
fn short_help_is_short_and_long_help_has_groups() {
    let shown = |option: &str| text(&succeed(bdpm(&["render", option])).stdout).to_owned();
    let (short, long) = (shown("-h"), shown("--help"));
    assert!(short.lines().count() < 45, "{short}");
    assert!(short.trim_end().ends_with("`--help` shows all options."), "{short}");
    assert!(!short.contains("--kernel") && long.contains("--kernel"));
    let (_, options) = short.split_once("Main options").unwrap();
    let names = options.lines().filter_map(|line| line.split("--").nth(1));
    let first: Vec<_> = names.map(|name| name.split(' ').next().unwrap()).take(3).collect();
    assert_eq!(first, ["output", "time", "resolution"], "{short}");
    let mut rest = &long[..];
    for heading in [
        "Main options",
        "Scene",
        "Image",
        "When to stop",
        "Output",
        "Continue and distribute",
        "Expert",
    ] {
        let (_, after) = rest.split_once(&format!("\n{heading}")).expect(heading);
        rest = after;
    }
}

#[test]
fn completions_and_manual_pages_cover_all_commands() {
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = succeed(bdpm(&["completions", shell]));
        let script = text(&script.stdout);
        let options = ["caustic-radius", "exr-compression", "reproduce"];
        assert!(options.iter().all(|option| script.contains(option)), "{shell}");
    }
    assert_wrong_usage(bdpm(&["completions", "none"]), "possible values");
    let (folder, at) = folder();
    let printed = succeed(bdpm(&["man", at("man/one").to_str().unwrap()]));
    let pages = fs::read_dir(at("man/one")).unwrap();
    let pages: Vec<_> = pages.map(|entry| entry.unwrap().path()).collect();
    assert_eq!(text(&printed.stdout).lines().count(), pages.len());
    assert_eq!(pages.len(), 20);
    for page in &pages {
        let text = fs::read_to_string(page).unwrap();
        assert!(text.contains(".TH") && text.contains("SYNOPSIS"), "{}", page.display());
    }
    let render = fs::read_to_string(at("man/one/bdpm-render.1")).unwrap();
    assert!(render.contains("target\\-error"), "{render}");
    // Options that `-h` leaves out have their text, too
    assert!(render.contains("Refuse a scene") && !render.contains("EXTRA"), "{render}");
    fs::write(at("file"), "").unwrap();
    let refused = output(bdpm(&["man", at("file").to_str().unwrap()]));
    assert_refused(&refused, "file: cannot create the folder", "");
    drop(folder);
}

/// Names of files come from shells, which complete what is in a folder.
#[test]
fn arguments_do_not_control_the_terminal() {
    let hostile = "a\x1b[2J\u{202e}b\u{2066}";
    for arguments in [
        vec!["info", hostile],
        vec!["render", "scene", hostile, hostile],
        vec!["render", &format!("--{hostile}")],
        vec![hostile],
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_bdpm")).args(&arguments).output().unwrap();
        assert!(!output.status.success());
        let shown = String::from_utf8(output.stderr).unwrap();
        assert!(shown.contains("\u{fffd}b\u{fffd}"), "{arguments:?}: {shown:?}");
        assert!(!shown.contains(['\x1b', '\u{202e}', '\u{2066}']), "{arguments:?}: {shown:?}");
    }
}
