//! Where Criterion's results are.
#![allow(dead_code)] // each bench takes its part

use std::path::PathBuf;
use std::process::Command;

/// The folder that Criterion writes to, found as it does.
pub fn criterion_home() -> PathBuf {
    let variable = |name: &str| std::env::var_os(name).map(PathBuf::from);
    let target = || variable("CARGO_TARGET_DIR").or_else(target_folder);
    variable("CRITERION_HOME")
        .or_else(|| Some(target()?.join("criterion")))
        .unwrap_or_else(|| "target/criterion".into())
}

/// Cargo's own answer: a configuration file may have moved the folder.
fn target_folder() -> Option<PathBuf> {
    let mut cargo = Command::new(std::env::var_os("CARGO")?);
    let output = cargo.args(["metadata", "--format-version", "1", "--no-deps"]).output().ok()?;
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).ok()?;
    Some(metadata["target_directory"].as_str()?.into())
}

/// Median of a benchmark of this run, seconds.
pub fn median(group: &str, name: &str) -> Option<f64> {
    let folder = |name: &str| name.replace('/', "_");
    let file = criterion_home().join(folder(group)).join(folder(name)).join("new/estimates.json");
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(file).ok()?).ok()?;
    Some(json["median"]["point_estimate"].as_f64()? * 1e-9)
}
