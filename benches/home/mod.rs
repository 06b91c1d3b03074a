//! Where Criterion's results are.

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
