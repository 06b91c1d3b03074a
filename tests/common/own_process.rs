//! Tests of the memory that a process takes: each runs in a process of its own, because tests
//! beside it would count.

use std::process::Command;

/// The path of the test that a process is for.
const KEY: &str = "BDPM_OWN_PROCESS";

/// Runs a test by the path that `module_path!` and its name make, in a process that runs nothing
/// else. Its output is part of the failure.
#[track_caller]
pub fn run(path: &str, test: impl FnOnce()) {
    if std::env::var(KEY).is_ok_and(|own| own == path) {
        return test();
    }
    // The first part is the name of the program.
    let (_, name) = path.split_once("::").unwrap();
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args([name, "--exact", "--nocapture", "--test-threads=1"]).env(KEY, path);
    let output = command.output().unwrap();
    let text =
        [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    let text = text.concat();
    assert!(output.status.success() && text.contains("1 passed"), "{path} failed:\n{text}");
}

/// Peak memory of this process, bytes, if the system reports it (Linux).
pub fn peak_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}
