//! Renders that are asked to end.
#![cfg(unix)]

use super::render::{SCENE, bdpm, bits, folder, json, names, render, succeed, text};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Stdio};

/// Starts a render that would never end, and returns once it has an image.
fn endless(output: &Path, more: &[&str]) -> (std::process::Child, impl BufRead + use<>) {
    let mut command = render(output, &["--time", "10days", "--verbose"]);
    command.args(more).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    while !line.starts_with("iteration ") {
        line.clear();
        assert!(stderr.read_line(&mut line).unwrap() > 0, "it ended too early");
    }
    (child, stderr)
}

/// Asks the program to end. Programs that a shell starts in the background ignore SIGINT, and so
/// may these tests.
fn interrupt(child: &std::process::Child) {
    signal(child, "TERM");
}

fn signal(child: &std::process::Child, name: &str) {
    // The shell's own `kill`: a minimal Debian has no program of that name.
    let script = format!("kill -{name} {}", child.id());
    let status = Command::new("sh").args(["-c", &script]).status();
    let status = status.unwrap();
    assert!(status.success());
}

#[test]
fn interrupt_writes_the_finished_iterations() {
    let (folder, at) = folder();
    let checkpoint = at("c.ckpt");
    let checkpoint = checkpoint.to_str().unwrap();
    let (child, mut stderr) = endless(&at("a.exr"), &["--json", "--checkpoint", checkpoint]);
    interrupt(&child);
    let mut line = String::new();
    stderr.read_line(&mut line).unwrap();
    assert!(line.starts_with("finishing this iteration"), "{line}");
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    let report = json(&output);
    assert_eq!(report["stopped_by"], "interrupt");
    let iterations = report["iterations"].as_u64().unwrap();
    assert!(iterations >= 1);
    assert_eq!(names(&folder), ["a.exr", "a.png", "c.ckpt"]);
    // The image written is that of the same number of iterations, and it can be continued.
    let count = iterations.to_string();
    succeed(render(&at("b.exr"), &["--iterations", &count]));
    assert_eq!(bits(&at("a.exr")), bits(&at("b.exr")));
    let count = (iterations + 1).to_string();
    succeed(render(&at("d.exr"), &["--iterations", &count]));
    succeed(render(&at("e.exr"), &["--iterations", &count, "--resume", checkpoint]));
    assert_eq!(bits(&at("d.exr")), bits(&at("e.exr")));
}

/// As `timeout` does, which sends it to the program and to its group.
#[test]
fn two_signals_at_once_are_one() {
    let (folder, at) = folder();
    let (child, mut stderr) = endless(&at("a.exr"), &[]);
    let kill = format!("kill -TERM {0}; kill -INT {0}; kill -TERM {0}", child.id());
    assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let mut rest = String::new();
    stderr.read_to_string(&mut rest).unwrap();
    assert_eq!(output.status.code(), Some(0), "{rest}");
    assert!(text(&output.stdout).contains("interrupted"), "{}", text(&output.stdout));
    assert_eq!(rest.matches("finishing this iteration").count(), 1, "{rest}");
    assert_eq!(names(&folder), ["a.exr", "a.png"]);
}

/// A render on one thread whose iterations take this many camera paths per pixel.
fn slow(output: &Path, camera_paths: &str) -> Command {
    let mut command = bdpm(&["render", SCENE, "--accel", "bvh", "--resolution", "64x64"]);
    command.args(["--camera-paths", camera_paths, "--light-paths", "1000", "--threads", "1"]);
    command.args(["--verbose", "--output"]).arg(output);
    command.stderr(Stdio::piped()).stdout(Stdio::null());
    command
}

/// Waits for a line that starts so.
fn wait_for(lines: &mut impl Iterator<Item = std::io::Result<String>>, start: &str) {
    let line = lines.find(|line| line.as_ref().unwrap().starts_with(start));
    assert!(line.is_some(), "it ended before `{start}`");
}

#[test]
fn interrupt_in_the_first_iteration_ends_the_program_at_once() {
    let (_folder, at) = folder();
    // Iterations take hours, and days.
    for camera_paths in ["4000000", "4294967295"] {
        let mut child = slow(&at("a.exr"), camera_paths).spawn().unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        wait_for(&mut lines, "rendering");
        interrupt(&child);
        wait_for(&mut lines, "error: interrupted before the first iteration was done");
        assert_eq!(child.wait().unwrap().code(), Some(130));
        assert!(!at("a.exr").exists());
    }
}

#[test]
fn a_second_interrupt_ends_the_program_at_once() {
    let (_folder, at) = folder();
    // Iterations take several times as long as two interrupts.
    let mut child = slow(&at("a.exr"), "5000").spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    wait_for(&mut lines, "iteration 1");
    interrupt(&child);
    wait_for(&mut lines, "finishing this iteration");
    // Signals that follow at once are one request.
    interrupt(&child);
    std::thread::sleep(std::time::Duration::from_millis(2500));
    assert!(child.try_wait().unwrap().is_none());
    interrupt(&child);
    assert_eq!(child.wait().unwrap().code(), Some(130));
}

/// The command, started to ignore these signals, as `nohup` starts a program.
#[cfg(target_os = "linux")]
fn ignoring(signals: &str, command: &Command) -> Command {
    let mut shell = Command::new("sh");
    shell.args(["-c", &format!("trap '' {signals}; exec \"$0\" \"$@\"")]);
    shell.arg(command.get_program()).args(command.get_args());
    shell
}

#[cfg(target_os = "linux")]
#[test]
fn ignored_signals_stay_ignored() {
    let (_folder, at) = folder();
    let command = render(&at("a.exr"), &["--time", "10days", "--verbose", "--json"]);
    let mut command = ignoring("HUP INT", &command);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    wait_for(&mut lines, "iteration 1");
    signal(&child, "HUP");
    signal(&child, "INT");
    // A render that took a signal as a request would end with its iteration, of some milliseconds.
    std::thread::sleep(std::time::Duration::from_millis(1500));
    assert!(child.try_wait().unwrap().is_none(), "it ended although the signals are ignored");
    signal(&child, "TERM");
    wait_for(&mut lines, "finishing this iteration");
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    assert_eq!(json(&output)["stopped_by"], "interrupt");
}

#[test]
fn interrupted_rating_of_a_scene_has_a_result() {
    let mut command = bdpm(&["glare", SCENE, "--accel", "bvh", "--target-error", "0.00001%"]);
    command.args(["--json", "--quiet"]).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    // The first iterations of a meter take milliseconds.
    std::thread::sleep(std::time::Duration::from_secs(6));
    assert!(child.try_wait().unwrap().is_none(), "it ended before the interrupt");
    interrupt(&child);
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(json(&output)["vertical_illuminance"]["value"].as_f64().unwrap() > 0.0);
}

#[test]
fn checkpoints_are_written_at_the_given_interval() {
    let (folder, at) = folder();
    let file = at("c.ckpt");
    let more = ["--checkpoint", file.to_str().unwrap(), "--checkpoint-every", "1ms"];
    let (mut child, _stderr) = endless(&at("a.exr"), &more);
    // By default the first one is written after a minute. A kill leaves no other.
    let is_written = (0..2000).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(10));
        file.exists()
    });
    assert!(is_written, "no checkpoint after 20 s");
    child.kill().unwrap();
    child.wait().unwrap();
    succeed(render(&at("b.exr"), &["--resume", file.to_str().unwrap(), "--time", "1s"]));
    assert!(names(&folder).contains(&"b.exr".to_owned()));
    let mut command = render(&at("d.exr"), &["--iterations", "1", "--checkpoint-every", "10s"]);
    let refused = command.output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("--checkpoint <FILE>"), "{}", text(&refused.stderr));
}
