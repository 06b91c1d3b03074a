//! `bdpm reproduce`: what it refuses. The quick experiment from beginning to end is
//! `tests/check/report.rs`.

use crate::common::program_output::assert_refused;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn reproduce(output: &Path, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.current_dir(env!("CARGO_MANIFEST_DIR")).args(["reproduce", "--output"]).arg(output);
    command.args(more).stdin(Stdio::null()).output().unwrap()
}

#[test]
fn invalid_options_are_refused_before_rendering() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("new");
    for option in ["--light-paths", "--camera-paths"] {
        let found = reproduce(&output, &[option, "7"]);
        assert_refused(&found, "path counts from the paper", "--time");
    }
    let found = reproduce(&output, &["scenes/keyhole"]);
    assert_refused(&found, "no region `side-walls`", "rectangle");
    let found = reproduce(&output, &["nowhere"]);
    assert_refused(&found, "nowhere", "check the path");
    assert!(!output.exists());
}
