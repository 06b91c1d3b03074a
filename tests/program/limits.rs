//! Inputs without end, renders that do not fit in memory, and renders that take longer than their
//! time.

use crate::common::program_output::{assert_refused, text};
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Output, Stdio};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");

fn command(arguments: &[&str], folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.current_dir(folder).args(arguments).stdin(Stdio::null());
    command
}

fn bdpm(arguments: &[&str], folder: &Path) -> Output {
    command(arguments, folder).output().unwrap()
}

#[cfg(unix)]
#[test]
fn endless_inputs_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let zero = "/dev/zero";
    std::os::unix::fs::symlink(zero, folder.path().join("scene.toml")).unwrap();
    let irregular = "neither a regular file nor a folder";
    let render = ["render", SCENE, "--output", "a.exr"];
    for (arguments, problem) in [
        ([&render[..], &["--resume", zero]].concat(), "this is not a checkpoint"),
        ([&render[..], &["--timings", zero]].concat(), "larger than the 16 MiB"),
        ([&render[..], &["--plan", zero]].concat(), irregular),
        (vec!["render", "scene.toml", "--output", "a.exr"], irregular),
        (vec!["render", ".", "--output", "a.exr"], irregular),
        (vec!["compare", zero, zero], irregular),
        (vec!["predict", zero, "--light-paths", "1", "--camera-paths", "1"], irregular),
        (vec!["optimize", zero, "--timings", zero], "larger than the 16 MiB"),
    ] {
        assert_refused(&bdpm(&arguments, folder.path()), problem, "");
    }
    // A device is not replaced by a file.
    let device = [&render[..], &["--checkpoint", "/dev/null"]].concat();
    assert_refused(
        &bdpm(&device, folder.path()),
        "/dev/null: cannot write: it is a device",
        "file",
    );
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// Times and checkpoints may come through pipes, which end.
#[cfg(unix)]
#[test]
fn pipes_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let small =
        ["--accel", "bvh", "--resolution", "8x8", "--light-paths", "50", "--camera-paths", "1"];
    let begin =
        ["render", SCENE, "--output", "a.exr", "--iterations", "1", "--checkpoint", "a.ckpt"];
    assert!(bdpm(&[&begin[..], &small].concat(), folder.path()).status.success());
    let timings =
        r#"{"fixed":0.5,"light_path":2e-7,"camera_path":3,"look_up":4,"merge_pair":5,"pixels":64}"#;
    fs::write(at("t.json"), timings).unwrap();
    let piped = |file: &str, arguments: &[&str]| {
        let script = format!("cat {file} | \"$0\" \"$@\"");
        let mut command = Command::new("sh");
        command.current_dir(folder.path()).args(["-c", &script, env!("CARGO_BIN_EXE_bdpm")]);
        let output = command.args(arguments).output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
    };
    let go_on =
        ["render", SCENE, "--output", "b.exr", "--iterations", "2", "--resume", "/dev/stdin"];
    piped("a.ckpt", &go_on);
    let predict =
        ["predict", "--coefficients", "1,1,1", "--light-paths", "1", "--camera-paths", "1"];
    piped("t.json", &[&predict[..], &["--timings", "/dev/stdin", "--time", "1s"]].concat());
}

#[cfg(target_os = "linux")]
#[test]
fn textures_count_before_they_are_decoded() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // The beginning gives the size; there are no pixels.
    let file = fs::File::create(at("huge.png")).unwrap();
    let mut writer = png::Encoder::new(file, 16_384, 16_384).write_header().unwrap();
    writer.write_chunk(png::chunk::IDAT, &[]).unwrap();
    drop(writer);
    fs::write(at("a.obj"), "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    fs::write(at("a.mtl"), "newmtl m\nKd 1 1 1\n").unwrap();
    let scene = "[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\nfov_x_deg = 40\n\
                 [materials.m]\nalbedo_texture = \"huge.png\"\n[[mesh]]\nfile = \"a.obj\"\n";
    fs::write(at("scene.toml"), scene).unwrap();
    let limited = |kib: u32| {
        let script = format!("ulimit -v {kib}; exec \"$0\" \"$@\"");
        let mut command = Command::new("sh");
        command.args(["-c", &script, env!("CARGO_BIN_EXE_bdpm"), "info", "--accel", "bvh"]);
        command.arg(folder.path()).output().unwrap()
    };
    let little = limited(3 << 20);
    assert_refused(&little, "16384x16384 texels, which take about 4.0 GiB of memory", "PNG");
    assert!(text(&little.stderr).contains("scene.toml:6"), "{}", text(&little.stderr));
}

#[test]
fn an_iteration_far_longer_than_the_time_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let more = ["--output", "a.exr", "--resolution", "64x64", "--accel", "bvh", "--time", "2s"];
    let refused = |command: &str, counts: [&str; 4], problem: &str| {
        let output = bdpm(&[&[command, SCENE], &more[..], &counts].concat(), folder.path());
        assert_refused(&output, problem, "--camera-paths");
        assert!(
            text(&output.stderr).contains("longer than the time of 2.0 s"),
            "{}",
            text(&output.stderr)
        );
    };
    let counts = ["--light-paths", "1000", "--camera-paths", "4000000"];
    refused("render", counts, "one iteration of 1000 light paths and 4000000 camera paths");
    refused("analyze", counts, "the first 2 iterations of 1000 light paths and 4000000");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn experiment_reports_its_minimum_time() {
    let folder = tempfile::tempdir().unwrap();
    let hasty = ["--output", "out", "--resolution", "32x32", "--time", "1ms"];
    let mut command = command(&[&["reproduce", SCENE], &hasty[..]].concat(), folder.path());
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    let found =
        lines.find(|line| line.starts_with("warning: ")).expect("it ended without a warning");
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(found.contains("the minimum of iterations takes about"), "{found}");
    assert!(found.contains("longer than --time 1ms"), "{found}");
}
