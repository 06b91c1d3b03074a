//! `bdpm render --part` and `bdpm merge`: an image of several machines.

use crate::common::desk::Desk;
use crate::common::program_output::{assert_refused, json, succeed};
use bdpm::image_io::{Value, read_exr};
use bdpm::noise::file::NoiseFile;
use bdpm::output::checkpoint::Checkpoint;
use std::fs;
use std::process::Output;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");
const OTHER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box-classic");

impl Desk {
    fn run(&self, arguments: &str) -> Output {
        let mut command = self.program(env!("CARGO_BIN_EXE_bdpm"));
        command.args(arguments.split_whitespace()).output().unwrap()
    }

    fn render_of(&self, scene: &str, arguments: &str) -> Output {
        let small = "--accel bvh --resolution 24x18 --light-paths 300 --camera-paths 2";
        self.run(&format!("render {scene} {small} {arguments}"))
    }

    /// Part `i` of 3 of 40 iterations, in `i.ckpt`.
    fn part(&self, i: u32, more: &str) {
        let files = format!("--output part{i}.exr --checkpoint {i}.ckpt");
        succeed(&self.render_of(SCENE, &format!("{files} --part {i}/3 --iterations 40 {more}")));
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.at(name)).unwrap()
    }
}

#[test]
fn parts_make_the_image_and_the_noise_of_one_run() {
    let desk = Desk::new();
    let whole = "--output whole.exr --iterations 40 --noise whole.n.exr --json";
    let told = json(&desk.render_of(SCENE, whole));
    (1..=3).for_each(|i| desk.part(i, "--noise part.n.exr"));
    let files = "--noise all.n.exr --checkpoint all.ckpt --json";
    let report = json(&desk.run(&format!("merge 3.ckpt 1.ckpt 2.ckpt --output all.exr {files}")));
    assert_eq!((&report["iterations"], &report["files"]), (&40.into(), &3.into()));
    assert_eq!(report["missing"], serde_json::json!([]));
    desk.assert_same_image("all.exr", "whole.exr");
    let near = |name: &str, precision: f64| {
        let [one, two] = [&report[name], &told[name]].map(|value| value.as_f64().unwrap());
        assert!((one / two - 1.0).abs() < precision, "{name}: {one} {two}");
    };
    near("mean_luminance", 1e-12);
    near("rms", 1e-12);
    for layer in ["albedo", "normal", "depth", "position", "direct", "emission", "rms"] {
        let [one, two] = ["all.exr", "whole.exr"].map(|name| desk.values(name, layer));
        let size = two.iter().fold(0.0f32, |most, x| most.max(x.abs()));
        for (a, b) in one.iter().zip(two) {
            assert!((a - b).abs() <= 1e-5 * size, "{layer}: {a} {b}");
        }
    }
    let [merged, one] = ["all.exr", "whole.exr"].map(|name| read_exr(&desk.at(name)).unwrap());
    // Checkpoints do not hold the camera.
    let mut without_camera = one.metadata.clone();
    assert!(without_camera.remove("camera").is_some());
    assert_eq!(merged.metadata, without_camera);

    // The coefficients, with their batches and what belongs to them.
    let [noise, other] =
        ["all.n.exr", "whole.n.exr"].map(|n| NoiseFile::read(&desk.at(n)).unwrap());
    assert_eq!(noise.noise.counts, other.noise.counts);
    assert_eq!((&noise.facts, &noise.regions), (&other.facts, &other.regions));
    let all: Vec<usize> = (0..24 * 18).collect();
    let [a, b] = [&noise, &other].map(|file| file.noise.mean_coefficients(&all));
    for (a, b) in [(a.a, b.a), (a.b, b.b), (a.f, b.f)] {
        assert!((a - b).abs() <= 1e-6 * b.abs(), "{a} {b}");
    }

    // Equal parts make equal files; a merged image goes on as one that was never apart.
    let again = "merge 1.ckpt 2.ckpt 3.ckpt --output again.exr --checkpoint again.ckpt -q";
    assert_eq!(succeed(&desk.run(again)), "");
    assert_eq!(desk.bytes("all.ckpt"), desk.bytes("again.ckpt"));
    assert_eq!(desk.bytes("all.exr"), desk.bytes("again.exr"));
    succeed(&desk.render_of(SCENE, "--resume all.ckpt --iterations 50 --output on.exr"));
    succeed(&desk.render_of(SCENE, "--iterations 50 --output straight.exr"));
    desk.assert_same_image("on.exr", "straight.exr");
}

#[test]
fn a_missing_part_is_named_and_can_be_rendered_later() {
    let desk = Desk::new();
    (1..=3).for_each(|i| desk.part(i, ""));
    let lacking = desk.run("merge 1.ckpt 3.ckpt --output lacking.exr --checkpoint lacking.ckpt");
    assert!(succeed(&lacking).contains("27 iterations from 2 files"));
    let warned = String::from_utf8(lacking.stderr).unwrap();
    assert!(warned.contains("warning: part 2/3 (iterations 13 to 25) is missing"), "{warned}");
    let iterations = &read_exr(&desk.at("lacking.exr")).unwrap().metadata["iterations"];
    assert_eq!(*iterations, Value::Number(27.0));
    // A right image of fewer iterations: the mean of the parts'.
    let means = ["part1.exr", "part3.exr", "lacking.exr"].map(|name| desk.values(name, ""));
    for ((one, three), both) in means[0].iter().zip(&means[1]).zip(&means[2]) {
        let mean = (13.0 * one + 14.0 * three) / 27.0;
        assert!((mean - both).abs() <= 1e-6 * mean, "{mean} {both}");
    }
    // It comes later, as a part or by going on; a part that was interrupted goes on as well.
    succeed(&desk.run("merge lacking.ckpt 2.ckpt --output late.exr"));
    succeed(&desk.render_of(SCENE, "--resume lacking.ckpt --iterations 40 --output on.exr"));
    succeed(&desk.render_of(SCENE, "--iterations 40 --output whole.exr"));
    desk.assert_same_image("late.exr", "whole.exr");
    desk.assert_same_image("on.exr", "whole.exr");

    let begin = "--output x.exr --checkpoint half.ckpt --part 2/3 --iterations 40 --time 1ms";
    let begun = json(&desk.render_of(SCENE, &format!("{begin} --json")));
    assert_eq!((&begun["stopped_by"], &begun["iterations"]), (&"time".into(), &1.into()));
    let short = desk.run("merge 1.ckpt half.ckpt 3.ckpt --output x.exr");
    let warned = String::from_utf8(short.stderr).unwrap();
    assert!(warned.contains("warning: iterations 14 to 25 of part 2/3 is missing"), "{warned}");
    let go_on = "--resume half.ckpt --checkpoint half.ckpt --part 2/3 --output x.exr --json";
    let rest = json(&desk.render_of(SCENE, go_on));
    assert_eq!((&rest["iterations"], &rest["new_iterations"]), (&13.into(), &12.into()));
    assert_eq!(desk.bytes("half.ckpt"), desk.bytes("2.ckpt"));
}

#[test]
fn damaged_part_is_named_and_spoils_nothing() {
    let desk = Desk::new();
    (1..=3).for_each(|i| desk.part(i, ""));
    succeed(&desk.run("merge 1.ckpt 3.ckpt --output rest.exr"));
    let whole = desk.bytes("2.ckpt");
    let end = whole.len();
    // Magic, version, what it is of, sums, checksum; and a file that was cut.
    let damaged = [3, 9, 14, end / 2, end - 3].map(|position| {
        let mut bytes = whole.clone();
        bytes[position] ^= 0x10;
        bytes
    });
    for (index, bytes) in
        damaged.iter().map(|bytes| &bytes[..]).chain([&whole[..end - 9], &[]]).enumerate()
    {
        fs::write(desk.at("bad.ckpt"), bytes).unwrap();
        let output =
            desk.run("merge 1.ckpt bad.ckpt 3.ckpt --output all.exr --checkpoint all.ckpt");
        let shown = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{index}: {shown}");
        assert!(
            shown.contains("error: bad.ckpt: ") && shown.contains("\nhelp: "),
            "{index}: {shown}"
        );
        assert!(shown.contains("part 2/3 (iterations 13 to 25) is missing"), "{index}: {shown}");
        assert!(shown.contains("written: all.exr"), "{index}: {shown}");
        assert_eq!(desk.bytes("all.exr"), desk.bytes("rest.exr"), "{index}");
        assert_eq!(Checkpoint::load(&desk.at("all.ckpt")).unwrap().blocks[0].film.iterations, 27);
    }
    // None that can be read: nothing is written.
    fs::remove_file(desk.at("all.exr")).unwrap();
    assert_refused(&desk.run("merge bad.ckpt --output all.exr"), "bad.ckpt", "give a checkpoint");
    assert!(!desk.at("all.exr").exists());
}

#[test]
fn parts_of_different_renders_are_refused_by_name() {
    let desk = Desk::new();
    (1..=2).for_each(|i| desk.part(i, ""));
    let other = |name: &str, scene: &str, arguments: &str| {
        let files = format!("--output x.exr --checkpoint {name}.ckpt");
        succeed(&desk.render_of(scene, &format!("{files} {arguments}")));
    };
    other("scene", OTHER, "--part 3/3 --iterations 40");
    other("seed", SCENE, "--part 3/3 --iterations 40 --seed 9");
    other("radius", SCENE, "--part 3/3 --iterations 40 --radius 0.3");
    other("longer", SCENE, "--part 3/3 --iterations 60");
    other("more", SCENE, "--part 4/4 --iterations 40");
    other("again", SCENE, "--part 2/3 --iterations 40");
    other("layers", SCENE, "--part 3/3 --iterations 40 --layers none");
    other("grain", SCENE, "--part 3/3 --iterations 40 --noise x.n.exr");
    other("single", SCENE, "--iterations 2");
    let mut old = Checkpoint::load(&desk.at("2.ckpt")).unwrap();
    old.provenance.version = "0.0.9".into();
    old.save(&desk.at("version.ckpt")).unwrap();
    let automatic = "--accel bvh --resolution 16x16 --time 300ms --output x.exr";
    succeed(&desk.run(&format!("render {SCENE} {automatic} --checkpoint auto.ckpt -q")));
    fs::remove_file(desk.at("x.exr")).unwrap();
    for (name, problem) in [
        ("scene", "scene is"),
        ("seed", "its seed is 9, not 1"),
        ("radius", "its radius is 0.3, not "),
        ("longer", "one of 3 parts of 60 iterations, but 1.ckpt is one of 3 parts of 40"),
        ("more", "one of 4 parts"),
        ("again", "it holds iterations 13 to 25, as 2.ckpt does"),
        ("layers", "one part keeps other layers or noise estimates"),
        ("grain", "one part keeps other layers or noise estimates"),
        ("single", "it holds iterations 0 to 1, as 1.ckpt does"),
        ("version", "program version is 0.0.9"),
        ("auto", "were chosen during the render"),
    ] {
        let output = desk.run(&format!("merge 1.ckpt 2.ckpt {name}.ckpt --output x.exr"));
        assert_refused(&output, &format!("{name}.ckpt: "), "");
        assert_refused(&output, problem, "");
        assert!(!desk.at("x.exr").exists(), "{name}");
    }
    assert_refused(
        &desk.run("merge 1.ckpt --output x.exr --checkpoint 1.ckpt"),
        "would replace",
        "",
    );
    let noise = desk.run("merge 1.ckpt 2.ckpt --output x.exr --noise n.exr");
    assert_eq!(noise.status.code(), Some(1));
    assert!(String::from_utf8(noise.stderr).unwrap().contains("batches of whole tiles"));
    // Parts of what has no parts.
    let files = "--output y.exr --checkpoint y.ckpt";
    for (arguments, problem) in [
        ("--part 1/3", "fixed number of iterations"),
        ("--part 1/3 --iterations 2", "2 iterations are fewer than 3 parts"),
        ("--part 2/3 --resume 1.ckpt", "holds iterations 0 to 12, which are not in part 2/3"),
        ("--part 1/4 --resume 1.ckpt", "one of 3 parts, not of 4"),
        ("--part 1/3 --resume 1.ckpt --iterations 41", "a part of 40 iterations, not of 41"),
        ("--part 1/3 --resume auto.ckpt", "cannot choose"),
    ] {
        let output = if arguments.contains("auto") {
            desk.run(&format!("render {SCENE} {files} {arguments}"))
        } else {
            desk.render_of(SCENE, &format!("{files} {arguments}"))
        };
        assert_refused(&output, problem, "");
    }
    assert_eq!(
        desk.run(&format!("render {SCENE} --output y.exr --part 4/3")).status.code(),
        Some(2)
    );
}

#[test]
fn a_plan_is_rendered_in_parts() {
    let desk = Desk::new();
    let size = "--accel bvh --resolution 24x24";
    let chosen = format!("render {SCENE} {size} --time 2s --output chosen.exr --no-denoise --json");
    let chosen = json(&desk.run(&chosen));
    let again = format!("render {SCENE} --plan chosen.exr");
    for i in 1..=2 {
        let files = format!("--output part.exr --checkpoint {i}.ckpt");
        succeed(&desk.run(&format!("{again} {files} --part {i}/2")));
    }
    let report =
        json(&desk.run("merge 2.ckpt 1.ckpt --output all.exr --checkpoint all.ckpt --json"));
    assert_eq!(report["iterations"], chosen["iterations"]);
    desk.assert_same_image("all.exr", "chosen.exr");
    let plan = |name: &str| read_exr(&desk.at(name)).unwrap().metadata["plan"].clone();
    assert_eq!(plan("all.exr"), plan("chosen.exr"));
    // One part goes on to the whole plan, which its checkpoint holds.
    succeed(&desk.run(&format!("render {SCENE} --resume 1.ckpt --output on.exr")));
    desk.assert_same_image("on.exr", "chosen.exr");
}
