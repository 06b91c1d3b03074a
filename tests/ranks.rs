//! Renders by several processes under `mpirun`, more of them than this machine may have processors.

#[allow(dead_code)] // renders by processes use a part of it
#[path = "common/desk.rs"]
mod desk;

use bdpm::noise::file::NoiseFile;
use bdpm::output::checkpoint::Checkpoint;
use desk::Desk;
use serde_json::Value;
use std::fs;
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");
const SMALL: &str = "--accel bvh --resolution 24x18 --light-paths 300 --camera-paths 2 --threads 1";

/// Every number of processes that is tried.
const COUNTS: [u32; 4] = [1, 2, 3, 5];

impl Desk {
    /// A render by so many processes; 0 is one without `mpirun`.
    fn command(&self, ranks: u32, arguments: &str) -> Command {
        let program = env!("CARGO_BIN_EXE_bdpm");
        let mut command = match ranks {
            0 => self.program(program),
            _ => {
                let mut command = self.program("mpirun");
                command.args(["-n", &ranks.to_string(), program]);
                command
            }
        };
        // Open MPI's: as root in containers, and more processes than processors.
        command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
        command.env("OMPI_MCA_rmaps_base_oversubscribe", "1");
        command.args(["render", SCENE]).args(arguments.split_whitespace());
        command
    }

    #[track_caller]
    fn render(&self, ranks: u32, arguments: &str) -> Value {
        let output = self.command(ranks, &format!("{arguments} --json")).output().unwrap();
        let shown = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{ranks}: {shown}");
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// That two images differ in the last place at most, and layers by as little as sums of so many
    /// iterations in another order do. Albedo and normal are summed in single precision: each
    /// addition rounds by at most half a unit in the last place, 2^-24 of the sum, and equal values
    /// round in the same direction.
    #[track_caller]
    fn assert_same_layers(&self, one: &str, other: &str, iterations: u64) {
        self.assert_same_image(one, other);
        let bound = (iterations as f32 / (1u32 << 24) as f32).max(1e-5);
        for layer in ["albedo", "normal", "depth", "position", "direct", "rms"] {
            let [a, b] = [one, other].map(|name| self.values(name, layer));
            let size = b.iter().fold(0.0f32, |most, x| most.max(x.abs()));
            let far = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(far <= bound * size, "{layer}: {far} of {size}");
        }
    }
}

/// Waits until `is_so`, for at most a minute.
fn wait_until(mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < Duration::from_secs(60), "nothing happened for a minute");
        sleep(Duration::from_millis(20));
    }
}

fn signal(name: &str, process: u32) {
    let done = Command::new("kill").args([name, &process.to_string()]).status().unwrap();
    assert!(done.success());
}

#[test]
fn any_number_of_ranks_renders_the_same_image() {
    let desk = Desk::new();
    let of = |n: u32| format!("{SMALL} --iterations 100 --output {n}.exr --noise {n}.n.exr");
    let one = desk.render(0, &of(0));
    let mean = |report: &Value, name: &str| report[name].as_f64().unwrap();
    for ranks in COUNTS {
        let report = desk.render(ranks, &of(ranks));
        assert_eq!(report["ranks"], ranks);
        for name in ["iterations", "new_iterations", "stopped_by", "rays", "settings"] {
            assert_eq!(report[name], one[name], "{name}");
        }
        for name in ["mean_luminance", "rms"] {
            let ratio = mean(&report, name) / mean(&one, name);
            assert!((ratio - 1.0).abs() < 1e-12, "{name}: {ratio}");
        }
        desk.assert_same_layers(&format!("{ranks}.exr"), "0.exr", 100);
        let noise = [0, ranks].map(|n| NoiseFile::read(&desk.at(&format!("{n}.n.exr"))).unwrap());
        assert_eq!(noise[0].noise.iterations, noise[1].noise.iterations);
        let all: Vec<usize> = (0..24 * 18).collect();
        let [a, b] = [0, 1].map(|i: usize| noise[i].noise.mean_coefficients(&all).b);
        assert!((a - b).abs() <= 1e-6 * b.abs(), "{a} {b}");
    }
}

#[test]
fn a_render_goes_on_with_another_number_of_ranks() {
    let desk = Desk::new();
    desk.render(0, &format!("{SMALL} --iterations 60 --output whole.exr"));
    let part = |iterations: u32| {
        format!("--iterations {iterations} --checkpoint c.ckpt --output part.exr")
    };
    desk.render(3, &format!("{SMALL} {}", part(7)));
    for (ranks, iterations) in [(5, 9), (0, 14), (2, 31), (1, 33), (3, 60)] {
        let report =
            desk.render(ranks, &format!("--threads 1 --resume c.ckpt {}", part(iterations)));
        assert_eq!(report["iterations"], iterations);
    }
    desk.assert_same_layers("part.exr", "whole.exr", 60);
    // The second of two parts, by two ranks.
    let share = format!("{SMALL} --part 2/2 --iterations 60 --output p.exr");
    desk.render(2, &format!("{share} --checkpoint two.ckpt"));
    desk.render(0, &format!("{share} --checkpoint one.ckpt"));
    let [one, two] = ["one", "two"].map(|name| {
        let checkpoint = Checkpoint::load(&desk.at(&format!("{name}.ckpt"))).unwrap();
        checkpoint.blocks[0].numbers.clone()
    });
    assert_eq!((one.to_string(), two.to_string()), ("30 to 59".into(), "30 to 59".into()));
}

#[test]
fn counts_are_chosen_for_all_and_the_plan_is_the_image() {
    let desk = Desk::new();
    let size = "--accel bvh --resolution 32x32 --threads 1";
    // A plan makes the image before it is denoised.
    let chosen = desk.render(3, &format!("{size} --time 5s --no-denoise --output chosen.exr"));
    assert_eq!((&chosen["stopped_by"], &chosen["automatic"]), (&"time".into(), &true.into()));
    let blocks = chosen["blocks"].as_array().unwrap();
    let iterations: u64 = blocks.iter().map(|block| block["iterations"].as_u64().unwrap()).sum();
    assert_eq!(chosen["iterations"], iterations);
    for ranks in [0, 2, 5] {
        let again = desk.render(ranks, "--plan chosen.exr --threads 1 --output again.exr");
        assert_eq!(again["iterations"], iterations);
        desk.assert_same_layers("again.exr", "chosen.exr", iterations);
    }
    // A target ends it as well, once it is reached.
    let target = "--iterations 100000 --target-rms 10% --output target.exr";
    let reached = desk.render(2, &format!("{SMALL} {target}"));
    assert_eq!(reached["stopped_by"], "target");
    assert!(reached["relative_rms"].as_f64().unwrap() < 0.1);
}

/// A render that goes on until something happens to it, from its checkpoint's 8 iterations.
fn begin(desk: &Desk, ranks: u32) -> Child {
    desk.render(2, &format!("{SMALL} --iterations 8 --checkpoint c.ckpt --output a.exr"));
    let go_on = "--resume c.ckpt --checkpoint c.ckpt --iterations 100000000 --threads 1";
    let mut command = desk.command(ranks, &format!("{go_on} --output a.exr --quiet"));
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// Processes of the program below `mpirun`, by their ranks.
fn processes(child: &Child, ranks: u32) -> Vec<u32> {
    let mut found = Vec::new();
    wait_until(|| {
        let children = format!("/proc/{0}/task/{0}/children", child.id());
        let children = fs::read_to_string(children).unwrap_or_default();
        let is_program = |id: &u32| {
            fs::read_to_string(format!("/proc/{id}/comm")).is_ok_and(|name| name == "bdpm\n")
        };
        found = children.split_whitespace().map(|id| id.parse().unwrap()).collect();
        found.retain(is_program);
        found.len() == ranks as usize
    });
    found.sort_unstable();
    found
}

/// Whether the process has used the processor for more than half a second: it renders.
fn is_at_work(process: u32) -> bool {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    fields.get(11).and_then(|ticks| ticks.parse::<u64>().ok()).is_some_and(|ticks| ticks > 50)
}

#[test]
fn a_rank_that_dies_ends_the_run_and_spares_the_checkpoint() {
    for dies in [0, 2] {
        let desk = Desk::new();
        let mut run = begin(&desk, 3);
        let processes = processes(&run, 3);
        wait_until(|| processes.iter().all(|process| is_at_work(*process)));
        signal("-KILL", processes[dies]);
        let mut status = None;
        wait_until(|| {
            status = run.try_wait().unwrap();
            status.is_some()
        });
        assert!(!status.unwrap().success());
        wait_until(|| processes.iter().all(|id| !fs::exists(format!("/proc/{id}")).unwrap()));
        // A checkpoint is written every minute; what it held is whole, and goes on.
        assert!(Checkpoint::load(&desk.at("c.ckpt")).is_ok());
        let rest = desk.render(2, "--resume c.ckpt --iterations 20 --threads 1 --output on.exr");
        assert_eq!(rest["iterations"], 20);
        desk.render(0, &format!("{SMALL} --iterations 20 --output whole.exr"));
        desk.assert_same_layers("on.exr", "whole.exr", 20);
    }
}

#[test]
fn termination_signal_writes_the_finished_iterations() {
    let desk = Desk::new();
    let run = begin(&desk, 3);
    let processes = processes(&run, 3);
    wait_until(|| processes.iter().all(|process| is_at_work(*process)));
    // As schedulers do: each process is asked.
    processes.iter().for_each(|process| signal("-TERM", *process));
    let Output { status, .. } = run.wait_with_output().unwrap();
    assert!(status.success(), "{status}");
    let checkpoint = Checkpoint::load(&desk.at("c.ckpt")).unwrap();
    let block = &checkpoint.blocks[0];
    assert!(block.film.iterations > 8);
    // Going on fills what the others had not come to.
    let wanted = block.numbers.ranges().last().unwrap().end.max(block.film.iterations + 3);
    let more = format!("--resume c.ckpt --iterations {wanted} --threads 1 --output on.exr");
    desk.render(2, &more);
    desk.render(0, &format!("{SMALL} --iterations {wanted} --output whole.exr"));
    desk.assert_same_layers("on.exr", "whole.exr", wanted);
}

#[test]
fn error_ends_all_ranks_and_is_reported_once() {
    let desk = Desk::new();
    for (arguments, problem) in [
        (format!("{SMALL} --output a.txt"), "a.txt"),
        (format!("{SMALL} --environment none.exr --output a.exr"), "none.exr"),
        (format!("{SMALL} --noise a.exr --output a.exr"), "the same file"),
    ] {
        let output = desk.command(3, &arguments).output().unwrap();
        let shown = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success(), "{shown}");
        assert!(shown.contains(problem) && shown.contains("help: "), "{shown}");
        assert_eq!(shown.matches("error: ").count(), 1, "{shown}");
    }
}
